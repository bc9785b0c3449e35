//! Intervals of a share that was counted: where the true share may lie, also where all or none were counted.

/// Probability with which [`fraction`] holds the truth, at least.
pub const CONFIDENCE: f64 = 0.95;

/// The interval [low, high] of the mean of a count over `n` trials whose sums are `sum` and, of its squares, `squares`.
///
/// Of counts that are 0 or 1 it is that of Clopper and Pearson (Biometrika 26, 404, 1934): the shares for which as many or more, and as many
/// or fewer, would be counted with a probability of (1 - CONFIDENCE) / 2 each; exact, so that it holds the truth in CONFIDENCE of cases or more,
/// whatever was counted. A trial that may count several times counts as one of size s = squares / sum, and there are k = sum / s of them:
/// that keeps the mean and the variance (as for scaled Poisson distributions, Boehm and Zech, Nucl. Instrum. Methods A 748, 1, 2014).
/// Where nothing was counted, s is taken as 1.
pub fn fraction(sum: f64, squares: f64, n: f64) -> [f64; 2] {
    let size = if sum > 0.0 { squares / sum } else { 1.0 };
    let k = if sum > 0.0 { sum / size } else { 0.0 };
    let tail = 0.5 * (1.0 - CONFIDENCE);
    // Rounding may leave k just off n.
    let all = n - k < 1e-9 * n;
    let low = if k <= 0.0 { 0.0 } else { quantile(tail, k, if all { 1.0 } else { n - k + 1.0 }) };
    let high = if all { 1.0 } else { quantile(1.0 - tail, k + 1.0, n - k) };
    [size * low, size * high]
}

/// The x at which a variable of the beta distribution (a, b) lies below with this probability: by bisection, to the last bits.
fn quantile(probability: f64, a: f64, b: f64) -> f64 {
    let (mut low, mut high) = (0.0_f64, 1.0_f64);
    while high - low > 4.0 * f64::EPSILON * high {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            break;
        }
        if below(middle, a, b) < probability { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// Regularised incomplete beta function I_x(a, b), by its continued fraction.
///
/// Source: Abramowitz and Stegun, 26.5.8; summed by Lentz's method, from the side where it converges fast.
fn below(x: f64, a: f64, b: f64) -> f64 {
    if x <= 0.0 || x >= 1.0 {
        return x.clamp(0.0, 1.0);
    }
    if x > (a + 1.0) / (a + b + 2.0) {
        return 1.0 - below(1.0 - x, b, a);
    }
    let ln_factor = libm::lgamma(a + b) - libm::lgamma(a) - libm::lgamma(b) + a * libm::log(x) + b * libm::log1p(-x);
    const TINY: f64 = 1e-300;
    let sure = |x: f64| if x.abs() < TINY { TINY } else { x };
    let (mut c, mut d) = (1.0, 1.0 / sure(1.0 - (a + b) * x / (a + 1.0)));
    let mut fraction = d;
    let mut m = 1.0;
    loop {
        for step in [
            m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m)),
            -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0)),
        ] {
            d = 1.0 / sure(1.0 + step * d);
            c = sure(1.0 + step / c);
            fraction *= c * d;
        }
        // It takes some sqrt(max(a, b)) steps.
        if (c * d - 1.0).abs() < 1e-15 || m > 1e6 {
            return libm::exp(ln_factor) * fraction / a;
        }
        m += 1.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Nothing or all of n: 1 - 0.025^(1/n) from the end, in closed form; of 20, 5: Clopper and Pearson's 0.0866 and 0.4910.
    #[test]
    fn ends_are_those_of_clopper_and_pearson() {
        for n in [1.0, 10.0, 1e5, 1e9] {
            // -expm1(ln(0.025) / n), to the digits that lgamma of n leaves.
            let end = -libm::expm1(libm::log(0.025) / n);
            let [low, high] = fraction(0.0, 0.0, n);
            assert!(low == 0.0 && (high / end - 1.0).abs() < 1e-5, "{n}: {high} {end}");
            let [low, high] = fraction(n, n, n);
            assert!(high == 1.0 && ((1.0 - low) / end - 1.0).abs() < 1e-5, "{n}: {low} {end}");
        }
        let [low, high] = fraction(5.0, 5.0, 20.0);
        assert!((low - 0.0866).abs() < 5e-5 && (high - 0.4910).abs() < 5e-5, "{low} {high}");
    }

    /// Over all that may be counted of n trials the interval holds p with the probability that it says, or a larger one.
    #[test]
    fn it_holds_the_truth_as_often_as_it_says() {
        for (n, p) in [(10, 0.03), (10, 0.5), (200, 0.004), (200, 0.37), (100, 0.99)] {
            let (mut chance, mut held) = (f64::powi(1.0 - p, n), 0.0);
            for k in 0..=n {
                let [low, high] = fraction(f64::from(k), f64::from(k), f64::from(n));
                held += if low <= p && p <= high { chance } else { 0.0 };
                chance *= f64::from(n - k) / f64::from(k + 1) * p / (1.0 - p);
            }
            assert!((CONFIDENCE..=1.0 + 1e-12).contains(&held), "{n} {p}: {held}");
        }
    }

    /// Counts of a thousand trials that are each 2 scale the interval by 2; many counts of any size give 1.96 standard errors, to 2 %.
    #[test]
    fn counts_of_several_are_scaled() {
        let [low, high] = fraction(600.0, 1200.0, 1000.0);
        let [one_low, one_high] = fraction(300.0, 300.0, 1000.0);
        assert!((low - 2.0 * one_low).abs() < 1e-12 && (high - 2.0 * one_high).abs() < 1e-12);
        let (n, sum, squares) = (1e6_f64, 7e5, 1.9e6);
        let se = ((squares / n - (sum / n).powi(2)) / n).sqrt();
        let [low, high] = fraction(sum, squares, n);
        assert!(((high - low) / (2.0 * 1.96 * se) - 1.0).abs() < 0.02, "{low} {high} {se}");
    }
}
