//! The normal distribution: its share below a value, and the value below which a share lies.

use std::f64::consts::FRAC_1_SQRT_2;

/// Share of the standard normal distribution below `x`; accurate in the lower tail.
pub(crate) fn below(x: f64) -> f64 {
    0.5 * libm::erfc(-x * FRAC_1_SQRT_2)
}

/// The value of the standard normal distribution below which the share `p` in (0, 1) lies.
///
/// Relative error about 1e-16. Source: M. J. Wichura, Algorithm AS 241 (PPND16), Appl. Stat. 37, 477 (1988).
pub fn quantile(p: f64) -> f64 {
    let q = p - 0.5;
    if q.abs() <= 0.425 {
        let r = 0.180_625 - q * q;
        return q * polynomial(&A, r) / polynomial(&B, r);
    }
    let tail = if q < 0.0 { p } else { 1.0 - p };
    let r = libm::sqrt(-libm::log(tail));
    let x = if r <= 5.0 {
        polynomial(&C, r - 1.6) / polynomial(&D, r - 1.6)
    } else {
        polynomial(&E, r - 5.0) / polynomial(&F, r - 5.0)
    };
    if q < 0.0 { -x } else { x }
}

/// The value below which the share `u` lies of that part of the standard normal distribution that is in [first, last].
pub(crate) fn quantile_within(u: f64, first: f64, last: f64) -> f64 {
    // In the upper tail shares crowd below 1; its mirror image has them at 0.
    if first > 0.0 {
        return -quantile_within(1.0 - u, -last, -first);
    }
    let (from, to) = (below(first), below(last));
    let p = from + u * (to - from);
    if p > 0.0 && p < 1.0 { quantile(p).clamp(first, last) } else { first + u * (last - first) }
}

/// Share of the standard normal distribution in [first, last].
pub(crate) fn share(first: f64, last: f64) -> f64 {
    if first > 0.0 { below(-first) - below(-last) } else { below(last) - below(first) }
}

fn polynomial(coefficients: &[f64; 8], x: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * x + c)
}

const A: [f64; 8] = [
    3.387_132_872_796_366_5,
    1.331_416_678_917_843_8e2,
    1.971_590_950_306_551_3e3,
    1.373_169_376_550_946e4,
    4.592_195_393_154_987e4,
    6.726_577_092_700_87e4,
    3.343_057_558_358_813e4,
    2.509_080_928_730_122_7e3,
];
const B: [f64; 8] = [
    1.0,
    4.231_333_070_160_091e1,
    6.871_870_074_920_579e2,
    5.394_196_021_424_751e3,
    2.121_379_430_158_66e4,
    3.930_789_580_009_271e4,
    2.872_908_573_572_194_3e4,
    5.226_495_278_852_854e3,
];
const C: [f64; 8] = [
    1.423_437_110_749_683_5,
    4.630_337_846_156_546,
    5.769_497_221_460_691,
    3.647_848_324_763_204_5,
    1.270_458_252_452_368_4,
    2.417_807_251_774_506e-1,
    2.272_384_498_926_918_4e-2,
    7.745_450_142_783_414e-4,
];
const D: [f64; 8] = [
    1.0,
    2.053_191_626_637_759,
    1.676_384_830_183_803_8,
    6.897_673_349_851e-1,
    1.481_039_764_274_800_8e-1,
    1.519_866_656_361_645_7e-2,
    5.475_938_084_995_345e-4,
    1.050_750_071_644_416_9e-9,
];
const E: [f64; 8] = [
    6.657_904_643_501_103,
    5.463_784_911_164_114,
    1.784_826_539_917_291_3,
    2.965_605_718_285_048_7e-1,
    2.653_218_952_657_612_4e-2,
    1.242_660_947_388_078_4e-3,
    2.711_555_568_743_487_6e-5,
    2.010_334_399_292_288_1e-7,
];
const F: [f64; 8] = [
    1.0,
    5.998_322_065_558_88e-1,
    1.369_298_809_227_358e-1,
    1.487_536_129_085_061_5e-2,
    7.868_691_311_456_133e-4,
    1.846_318_317_510_054_8e-5,
    1.421_511_758_316_446e-7,
    2.044_263_103_389_939_8e-15,
];

#[cfg(test)]
mod tests {
    use super::*;

    /// Against SciPy 1.17's `norm.ppf` and `truncnorm.ppf`.
    #[test]
    fn quantiles_are_those_of_the_normal_distribution() {
        let table = NORMAL;
        for (p, expected) in table {
            let x = quantile(p);
            assert!((x - expected).abs() <= 1e-14 * expected.abs().max(1.0), "{p}: {x}, not {expected}");
            // 1 - p has lost the digits of the tail.
            assert!((below(x) / p - 1.0).abs() < 1e-12 * x.abs().max(1.0), "{p}: {}", below(x));
        }
        for (first, last, u, expected) in TRUNCATED {
            let x = quantile_within(u, first, last);
            assert!((x - expected).abs() <= 1e-10 * expected.abs(), "[{first}, {last}] at {u}: {x}, not {expected}");
        }
    }

    const NORMAL: [(f64, f64); 6] = [
        (1e-10, -6.361340902404056),
        (0.02425, -1.972961051311885),
        (0.3, -0.5244005127080409),
        (0.5, 0.0),
        (0.975, 1.959963984540054),
        (0.9999999999, 6.361340889697422),
    ];
    const TRUNCATED: [(f64, f64, f64, f64); 5] = [
        (1.0, 2.0, 0.5, 1.336440347745247),
        (5.0, 7.0, 0.25, 5.055183121340056),
        (-8.0, -6.0, 0.5, -6.11156496120527),
        (-1.0, 3.0, 0.9, 1.3699619946790393),
        (20.0, 21.0, 0.5, 20.03454167645473),
    ];
}
