//! Numbers as a reader wants them: few digits, powers of ten where they are short, a true minus sign.

use super::text::Text;

/// Decimal exponent of |x|: floor(log10 |x|), exactly; 0 for 0.
pub fn exponent_of(x: f64) -> i32 {
    let text = format!("{:e}", x.abs());
    text.split_once('e').and_then(|(_, e)| e.parse().ok()).unwrap_or(0)
}

/// mantissa x 10^power with `places` digits behind the point (enough for it to be exact).
pub fn decimal(mantissa: i64, power: i32, places: usize) -> String {
    let mut digits = mantissa.unsigned_abs().to_string();
    let shift = power + places as i32;
    if mantissa == 0 {
        // No power of ten makes it longer.
    } else if shift >= 0 {
        digits.extend(std::iter::repeat_n('0', shift as usize));
    } else {
        // More digits than places: they are zeros.
        digits.truncate(digits.len().saturating_sub(shift.unsigned_abs() as usize));
    }
    let digits = format!("{digits:0>width$}", width = places + 1);
    let (whole, part) = digits.split_at(digits.len() - places);
    let sign = if mantissa < 0 { "−" } else { "" };
    if places == 0 { format!("{sign}{whole}") } else { format!("{sign}{whole}.{part}") }
}

/// `value` with `digits` significant digits, as 0.0251 or 2.51 x 10^-5.
pub fn number(value: f64, digits: usize) -> Text {
    let text = format!("{:.*e}", digits - 1, value);
    let Some((mantissa, exponent)) = text.split_once('e') else { return Text::plain(text) };
    let exponent: i32 = exponent.parse().expect("the exponent that format wrote");
    if value == 0.0 {
        Text::plain("0")
    } else if (-3..5).contains(&exponent) {
        let places = (digits as i32 - 1 - exponent).max(0) as usize;
        // From the rounded digits, so that 9.9996 becomes 10.00 and not 9.9996 rounded twice.
        let rounded: f64 = text.parse().expect("the number that format wrote");
        Text::plain(minus(format!("{rounded:.places$}")))
    } else if mantissa == "1" {
        Text::plain("10").sup(minus(exponent.to_string()))
    } else {
        Text::plain(minus(mantissa.to_owned())).join(times_power(exponent))
    }
}

/// `mean` ± `se`, both to the second digit of the error.
pub fn with_error(mean: f64, se: f64) -> Text {
    if !(se > 0.0 && se.is_finite() && mean.is_finite()) {
        return number(mean, 4);
    }
    let largest = exponent_of(mean.abs().max(se));
    let shift = if (-3..5).contains(&largest) { 0 } else { largest };
    let unit: f64 = format!("1e{shift}").parse().expect("a power of ten");
    // No more digits than f32 pixels can carry.
    let places = (1 - exponent_of(se / unit)).clamp(0, 9) as usize;
    let (mean, se) = (minus(format!("{:.places$}", mean / unit)), format!("{:.places$}", se / unit));
    if shift == 0 {
        Text::plain(format!("{mean} ± {se}"))
    } else {
        Text::plain(format!("({mean} ± {se})")).join(times_power(shift))
    }
}

/// x 10^exponent.
pub fn times_power(exponent: i32) -> Text {
    Text::plain("×10").sup(minus(exponent.to_string()))
}

/// The shortest decimals of a given number, such as a spatial frequency.
pub fn plain(value: f64) -> String {
    // Adding 0 makes a negative zero positive.
    minus(format!("{}", (value * 1e6).round() / 1e6 + 0.0))
}

/// The shortest decimals that give the first four digits.
pub fn short(value: f64) -> String {
    let rounded: f64 = format!("{value:.3e}").parse().expect("the number that format wrote");
    minus(format!("{rounded}"))
}

fn minus(text: String) -> String {
    text.replace('-', "−")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_read_well() {
        let cases: [(f64, &str); 9] = [
            (0.0, "0"),
            (0.025_123_4, "0.02512"),
            (9.999_96, "10.00"),
            (-12.5, "−12.50"),
            (12_345.6, "12350"),
            (0.000_999_99, "0.001000"),
            (3.2e-7, "3.200×10−7"),
            (-1e38, "−1.000×1038"),
            (1e-30, "1.000×10−30"),
        ];
        for (value, text) in cases {
            assert_eq!(number(value, 4).letters(), text);
        }
    }

    #[test]
    fn errors_keep_two_digits() {
        assert_eq!(with_error(0.123_456, 0.001_234).letters(), "0.1235 ± 0.0012");
        assert_eq!(with_error(1.234e-6, 5e-9).letters(), "(1.2340 ± 0.0050)×10−6");
        assert_eq!(with_error(0.5, 0.0).letters(), "0.5000");
    }

    #[test]
    fn exponents_are_exact_at_powers_of_ten() {
        for e in -320..=308 {
            assert_eq!(exponent_of(format!("1e{e}").parse().unwrap()), e);
            assert_eq!(exponent_of(format!("-9.99e{e}").parse::<f64>().unwrap().max(-1.7e308)), e.min(308));
        }
    }

    #[test]
    fn decimals_place_the_point() {
        assert_eq!(decimal(25, -1, 1), "2.5");
        assert_eq!(decimal(-5, -3, 3), "−0.005");
        assert_eq!(decimal(20, -1, 0), "2");
        for power in [-4, 0, 1, 5] {
            assert_eq!([0, 1, 2].map(|places| decimal(0, power, places)), ["0", "0.0", "0.00"], "0 x 10^{power}");
        }
        assert_eq!(decimal(3, 2, 0), "300");
    }
}
