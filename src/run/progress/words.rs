//! Times, rates and labels as people read them, in the room that there is.

use unicode_width::{UnicodeWidthChar, UnicodeWidthStr};

/// `4.2 s`, `65 s`, `12 min`, `18:09 h`, `6 d 4 h`.
pub fn duration(seconds: f64) -> String {
    let s = seconds.max(0.0);
    let minutes = (s / 60.0).round();
    if s < 9.95 {
        format!("{s:.1} s")
    } else if s < 99.5 {
        format!("{s:.0} s")
    } else if minutes < 60.0 {
        format!("{minutes:.0} min")
    } else if minutes < 100.0 * 60.0 {
        format!("{:.0}:{:02.0} h", (minutes / 60.0).floor(), minutes % 60.0)
    } else {
        let hours = (s / 3600.0).round();
        format!("{:.0} d {:.0} h", (hours / 24.0).floor(), hours % 24.0)
    }
}

/// Three digits that count, thousands as `k`, millions as `M`: `0.0123`, `15.3`, `1530`, `15.3 k`, `2.5 M`.
pub fn count(value: f64) -> String {
    let size = value.abs();
    let (scaled, unit) = match size {
        s if s < 9999.5 => (value, ""),
        s if s < 999.5e3 => (value / 1e3, " k"),
        s if s < 999.5e6 => (value / 1e6, " M"),
        s if s < 999.5e9 => (value / 1e9, " G"),
        _ => return format!("{value:.1e}"),
    };
    if value != 0.0 && size < 1e-4 {
        return format!("{value:.1e}");
    }
    // By way of the text, which rounds: 9.996 has its third digit at 0.1.
    let rounded: f64 = format!("{scaled:.2e}").parse().unwrap_or(scaled);
    format!("{rounded}{unit}")
}

/// `15.3 paths per pixel/s`; where a second is too short for them, in a minute or an hour.
pub fn rate(per_second: f64, unit: &str) -> String {
    let (value, time) = match per_second {
        r if r >= 0.1 => (r, "s"),
        r if r * 60.0 >= 0.1 => (r * 60.0, "min"),
        r => (r * 3600.0, "h"),
    };
    format!("{} {unit}/{time}", count(value))
}

/// Whole percent of a part; never 100 before the whole is done.
pub fn percent(part: f64) -> String {
    format!("{:.0} %", (100.0 * part).floor().clamp(0.0, if part < 1.0 { 99.0 } else { 100.0 }))
}

/// A label and what is said of it in at most `width` columns: the middle of the label goes first, its ends tell it from others.
pub fn line(label: &str, told: &str, width: usize) -> String {
    const LEAST: usize = 8;
    let room = width.saturating_sub(told.width() + 4).max(LEAST);
    fitted(&format!("  {}  {told}", shortened(label, room)), width)
}

/// A text without its middle, where it is wider than `width` columns.
pub fn shortened(text: &str, width: usize) -> String {
    if text.width() <= width || width == 0 {
        return text.to_owned();
    }
    let head = fitting(text.chars(), width / 2);
    let tail: Vec<char> = fitting(text.chars().rev(), width - 1 - width / 2);
    head.into_iter().chain(['…']).chain(tail.into_iter().rev()).collect()
}

/// The beginning of a text, where it is wider than `width` columns.
pub fn fitted(text: &str, width: usize) -> String {
    if text.width() <= width || width == 0 {
        return text.to_owned();
    }
    fitting(text.chars(), width - 1).into_iter().chain(['…']).collect()
}

fn fitting(letters: impl Iterator<Item = char>, width: usize) -> Vec<char> {
    let mut taken = 0;
    let fits = |c: &char| {
        taken += c.width().unwrap_or(0);
        taken <= width
    };
    letters.take_while(fits).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_in_the_unit_that_suits_them() {
        let told =
            [0.0, 4.21, 9.96, 65.3, 99.6, 720.0, 3569.0, 3571.0, 65_350.0, 359_900.0, 533_000.0, 1e7].map(duration);
        let expected = [
            "0.0 s",
            "4.2 s",
            "10 s",
            "65 s",
            "2 min",
            "12 min",
            "59 min",
            "1:00 h",
            "18:09 h",
            "99:58 h",
            "6 d 4 h",
            "115 d 18 h",
        ];
        assert_eq!(told, expected);
    }

    #[test]
    fn numbers_have_three_digits_and_no_exponent() {
        let told = [0.0, 0.012_34, 0.9996, 15.3, 999.6, 1530.0, 9996.0, 15_300.0, 2.5e6, 1.234e11].map(count);
        assert_eq!(told, ["0", "0.0123", "1", "15.3", "1000", "1530", "10 k", "15.3 k", "2.5 M", "123 G"]);
        assert_eq!(rate(15.3, "paths per pixel"), "15.3 paths per pixel/s");
        assert_eq!(rate(0.05, "paths per pixel"), "3 paths per pixel/min");
        assert_eq!(rate(0.001, "rows"), "3.6 rows/h");
        assert_eq!([0.0, 0.456, 0.9999, 1.0].map(percent), ["0 %", "45 %", "99 %", "100 %"]);
    }

    /// No line is wider than it may be, whatever the letters; the numbers stay as long as there is room for them.
    #[test]
    fn lines_keep_to_the_width() {
        let label = "frames[inner_diameter=12.5,wavelength_nm=620]";
        let told = "45 %  15.3 paths per pixel/s  12 min left";
        assert_eq!(line(label, told, 100), format!("  {label}  {told}"));
        assert_eq!(line(label, told, 80), format!("  frames[inner_diam…wavelength_nm=620]  {told}"));
        for width in 1..120 {
            for label in [label, "組織[波長=620]の像", ""] {
                let line = line(label, told, width);
                assert!(line.width() <= width, "{width}: {line}");
                assert!(width < 60 || line.ends_with(told), "{width}: {line}");
            }
        }
    }
}
