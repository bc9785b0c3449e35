//! The beta distribution on [0, 1].

/// Share of the beta distribution with shapes `alpha` and `beta` (both above 0) below `x` in [0, 1].
///
/// The continued fraction of NIST DLMF 8.17.22, summed by the method of Lentz, on that side where it converges fast.
pub(crate) fn below(x: f64, alpha: f64, beta: f64) -> f64 {
    if x <= 0.0 || x >= 1.0 {
        return if x <= 0.0 { 0.0 } else { 1.0 };
    }
    let log_scale = libm::lgamma(alpha + beta) - libm::lgamma(alpha) - libm::lgamma(beta);
    let front = libm::exp(log_scale + alpha * libm::log(x) + beta * libm::log1p(-x));
    if x < (alpha + 1.0) / (alpha + beta + 2.0) {
        front * fraction(x, alpha, beta) / alpha
    } else {
        1.0 - front * fraction(1.0 - x, beta, alpha) / beta
    }
}

fn fraction(x: f64, a: f64, b: f64) -> f64 {
    const TINY: f64 = 1e-300;
    let kept = |x: f64| if x.abs() < TINY { TINY } else { x };
    let mut c = 1.0;
    let mut d = 1.0 / kept(1.0 - (a + b) * x / (a + 1.0));
    let mut sum = d;
    // It takes O(sqrt(max(a, b))) terms; shapes are bounded where they are read.
    for m in 1..20_000 {
        let m = f64::from(m);
        let even = m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m));
        let odd = -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0));
        let mut change = 1.0;
        for term in [even, odd] {
            d = 1.0 / kept(1.0 + term * d);
            c = kept(1.0 + term / c);
            change = c * d;
            sum *= change;
        }
        if (change - 1.0).abs() < 1e-15 {
            break;
        }
    }
    sum
}

/// The value below which the share `u` in (0, 1) of the beta distribution lies.
///
/// Bisection over all doubles in [0, 1] in the order of their bits: exact to the error of [`below`] also next to 0,
/// where shapes below 1 put most of their weight.
pub(crate) fn quantile(u: f64, alpha: f64, beta: f64) -> f64 {
    let (mut low, mut high) = (0_u64, 1.0_f64.to_bits());
    while high - low > 1 {
        let middle = low + (high - low) / 2;
        if below(f64::from_bits(middle), alpha, beta) < u { low = middle } else { high = middle }
    }
    f64::from_bits(high)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against SciPy 1.17's `beta.ppf`.
    #[test]
    fn quantiles_are_those_of_the_beta_distribution() {
        for (alpha, beta, u, expected) in BETA {
            let x = quantile(u, alpha, beta);
            assert!((x / expected - 1.0).abs() < 1e-11, "({alpha}, {beta}) at {u}: {x}, not {expected}");
        }
    }

    const BETA: [(f64, f64, f64, f64); 6] = [
        (2.0, 5.0, 0.3, 0.18180347131894917),
        (0.5, 0.5, 0.001, 2.4673990709169446e-06),
        (0.1, 3.0, 0.5, 0.00023123990750011818),
        (30.0, 2.0, 0.9, 0.9827119777086992),
        (1.0, 1.0, 0.25, 0.25),
        (200.0, 300.0, 0.01, 0.34973301124554146),
    ];
}
