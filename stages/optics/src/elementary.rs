//! ln, exp, sin, cos and atan2 made of + - * / and bit moves: fast, and the same bits on every machine.
//!
//! The system's own differ between machines (it chooses fused variants at run time). Coefficients: FreeBSD msun
//! (`e_log.c`, `k_sin.c`, `k_cos.c`, Sun Microsystems 1993).

#![allow(clippy::excessive_precision, reason = "coefficients as published")]

use std::f64::consts::{FRAC_PI_4, TAU};

/// ln x for normal x > 0; within 1 ulp.
#[inline(always)]
pub fn ln(x: f64) -> f64 {
    const LN2_HIGH: f64 = 6.931_471_803_691_238_164_90e-1;
    const LN2_LOW: f64 = 1.908_214_929_270_587_700_02e-10;
    const TWO_52: f64 = 4_503_599_627_370_496.0;
    // x = 2^k (1 + f) with 1 + f in [sqrt(1/2), sqrt(2)): adding to the bits carries into the exponent at sqrt(2).
    let shifted = x.to_bits().wrapping_add(0x3FF0_0000_0000_0000 - 0x3FE6_A09E_667F_3BCD);
    // In the low bits of 2^52 an integer is a float, on every vector unit.
    let k = f64::from_bits(TWO_52.to_bits() | (shifted >> 52)) - (TWO_52 + 1023.0);
    let f = f64::from_bits((shifted & 0x000F_FFFF_FFFF_FFFF) + 0x3FE6_A09E_667F_3BCD) - 1.0;
    let s = f / (2.0 + f);
    let z = s * s;
    let w = z * z;
    let even =
        w * (3.999_999_999_940_941_908e-1 + w * (2.222_219_843_214_978_396e-1 + w * 1.531_383_769_920_937_332e-1));
    let odd = z
        * (6.666_666_666_666_735_130e-1
            + w * (2.857_142_874_366_239_149e-1
                + w * (1.818_357_216_161_805_012e-1 + w * 1.479_819_860_511_658_591e-1)));
    let half = 0.5 * f * f;
    k * LN2_HIGH - ((half - (s * (half + (even + odd)) + k * LN2_LOW)) - f)
}

/// e^x for |x| <= 700; within 2 ulp. Beyond that range the result is meaningless: the caller knows its numbers.
#[inline(always)]
pub fn exp(x: f64) -> f64 {
    const LN2_HIGH: f64 = 6.931_471_803_691_238_164_90e-1;
    const LN2_LOW: f64 = 1.908_214_929_270_587_700_02e-10;
    // Adding 1.5 * 2^52 rounds to the nearest integer, and leaves that integer in the low bits.
    const ROUND: f64 = 6_755_399_441_055_744.0;
    let rounded = x * std::f64::consts::LOG2_E + ROUND;
    let k = rounded - ROUND;
    let r = (x - k * LN2_HIGH) - k * LN2_LOW;
    // Taylor to r^13: |r| <= ln 2 / 2, so the rest is below 4e-18. Even and odd parts run side by side.
    let z = r * r;
    let even = 1.0
        + z * (1.0 / 2.0
            + z * (1.0 / 24.0
                + z * (1.0 / 720.0 + z * (1.0 / 40_320.0 + z * (1.0 / 3_628_800.0 + z * (1.0 / 479_001_600.0))))));
    let odd = 1.0
        + z * (1.0 / 6.0
            + z * (1.0 / 120.0
                + z * (1.0 / 5_040.0
                    + z * (1.0 / 362_880.0 + z * (1.0 / 39_916_800.0 + z * (1.0 / 6_227_020_800.0))))));
    let mantissa = even + r * odd;
    f64::from_bits(mantissa.to_bits().wrapping_add(rounded.to_bits() << 52))
}

/// (sin, cos) of 2 pi `turns`, |turns| < 2^49; within 2e-16 of the exact value at that argument.
#[inline(always)]
pub fn sin_cos_turns(turns: f64) -> (f64, f64) {
    // Adding 1.5 * 2^52 rounds to the nearest integer, and leaves that integer in the low bits.
    const ROUND: f64 = 6_755_399_441_055_744.0;
    let rounded = 4.0 * turns + ROUND;
    let quarter = rounded.to_bits();
    // Exact: within an eighth of a turn of zero.
    let r = turns - 0.25 * (rounded - ROUND);
    let x = TAU * r;
    let z = x * x;
    let sin = x + x
        * z
        * (-1.666_666_666_666_663_243_48e-1
            + z * (8.333_333_333_322_489_461_24e-3
                + z * (-1.984_126_982_985_794_931_34e-4
                    + z * (2.755_731_370_707_006_767_89e-6
                        + z * (-2.505_076_025_340_686_341_95e-8 + z * 1.589_690_995_211_550_102_21e-10)))));
    let cos = 1.0
        - (0.5 * z
            - z * z
                * (4.166_666_666_666_660_190_37e-2
                    + z * (-1.388_888_888_887_410_957_49e-3
                        + z * (2.480_158_728_947_672_941_78e-5
                            + z * (-2.755_731_435_139_066_330_35e-7
                                + z * (2.087_572_321_298_174_827_90e-9 - z * 1.135_964_755_778_819_482_65e-11))))));
    // The quarter turns: swap by the lowest bit, signs by the next, all without a branch.
    let swap = quarter & 1 == 1;
    let (s, c) = if swap { (cos, sin) } else { (sin, cos) };
    let sin_sign = (quarter & 2) << 62;
    let cos_sign = ((quarter ^ (quarter << 1)) & 2) << 62;
    (f64::from_bits(s.to_bits() ^ sin_sign), f64::from_bits(c.to_bits() ^ cos_sign))
}

/// Angle of the point (x, y) in [-pi, pi]; within 4 ulp. (0, 0) has the angle 0; infinite arguments have none (NaN).
#[inline(always)]
pub fn atan2(y: f64, x: f64) -> f64 {
    use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};
    const TAN_EIGHTH: f64 = 0.414_213_562_373_095_048_8;
    let (a, b) = (x.abs(), y.abs());
    let steep = b > a;
    let (low, high) = if steep { (a, b) } else { (b, a) };
    // To |r| <= tan(pi/8): atan(low / high) = pi/4 + atan((low - high) / (low + high)).
    let far = low > TAN_EIGHTH * high;
    let over = if far { low - high } else { low };
    let under = if far { low + high } else { high };
    let r = over / if under > 0.0 { under } else { 1.0 };
    let z = r * r;
    // (atan(r) / r - 1) / z by interpolation in Chebyshev nodes, 5e-18 off at most.
    // In two pieces: nested any deeper it takes the formatter a minute.
    let q = 7.692_183_190_826_087e-2
        + z * (-6.664_511_447_381_948e-2
            + z * (5.858_148_912_802_21e-2
                + z * (-5.085_449_737_940_26e-2 + z * (3.923_165_829_558_719e-2 - z * 1.917_687_911_906_226e-2))));
    let p = -3.333_333_333_333_333e-1
        + z * (1.999_999_999_999_552e-1
            + z * (-1.428_571_428_466_654_2e-1
                + z * (1.111_111_101_525_636_1e-1 + z * (-9.090_904_578_123_903e-2 + z * q))));
    let angle = (if far { FRAC_PI_4 } else { 0.0 }) + (r + r * (z * p));
    let angle = if steep { FRAC_PI_2 - angle } else { angle };
    let angle = if x < 0.0 { PI - angle } else { angle };
    angle.copysign(y)
}

/// J0(x) for x >= 0; within 1e-7 of the exact value. Source: Abramowitz and Stegun (1964), 9.4.1 and 9.4.3.
#[inline(always)]
pub fn bessel_j0(x: f64) -> f64 {
    let t = (x * (1.0 / 3.0)).min(1.0);
    let t = t * t;
    let near = 1.0
        + t * (-2.249_999_7
            + t * (1.265_620_8 + t * (-0.316_386_6 + t * (0.044_447_9 + t * (-0.003_944_4 + t * 0.000_210_0)))));
    let far = x.max(3.0);
    let t = 3.0 / far;
    let amplitude = 0.797_884_56
        + t * (-0.000_000_77
            + t * (-0.005_527_40 + t * (-0.000_095_12 + t * (0.001_372_37 + t * (-0.000_728_05 + t * 0.000_144_76)))));
    let phase = far - FRAC_PI_4
        + t * (-0.041_663_97
            + t * (-0.000_039_54 + t * (0.002_625_73 + t * (-0.000_541_25 + t * (-0.000_293_33 + t * 0.000_135_58)))));
    let (_, cos) = sin_cos_turns(phase * (1.0 / TAU));
    if x < 3.0 { near } else { amplitude * cos / far.sqrt() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::philox::{philox4x32, unit_fine};

    fn uniforms() -> impl Iterator<Item = f64> {
        (0..20_000).map(|i| {
            let [a, b, ..] = philox4x32([i, 0, 0, 0], [1, 2]);
            unit_fine(a, b)
        })
    }

    /// Against libm (1 ulp): 3 ulp apart at most; e^0 = 1 to the bit.
    #[test]
    fn exp_is_right_to_the_last_bits() {
        assert_eq!(exp(0.0), 1.0);
        for u in uniforms() {
            for x in [2.0 * u - 1.0, 1400.0 * u - 700.0, 1e-9 * u] {
                let (ours, theirs) = (exp(x), libm::exp(x));
                assert!((ours / theirs - 1.0).abs() <= 3.0 * f64::EPSILON, "exp({x}) = {ours}, libm {theirs}");
            }
        }
    }

    /// Against libm, which is good to 1 ulp as well: 2 ulp apart at most.
    #[test]
    fn ln_is_right_to_the_last_bits() {
        let edges =
            [1e-300, 2f64.powi(-53), 0.5f64.sqrt(), 1.0 - 2f64.powi(-53), 1.0, 1.0 + 2f64.powi(-52), 2.0, 1e300];
        for x in uniforms().chain(edges) {
            let expected = libm::log(x);
            assert!((ln(x) - expected).abs() <= 2.0 * f64::EPSILON * expected.abs(), "ln({x:e}) = {:e}", ln(x));
        }
        assert_eq!(ln(1.0), 0.0);
    }

    /// Against libm on a reduced argument; 4e-16 is the rounding of 2 pi r and of the last sum in each.
    #[test]
    fn sin_and_cos_of_turns() {
        for t in uniforms().map(|u| 40.0 * u - 20.0).chain([0.0, 0.125, 0.25, 0.5, 0.75, -0.25, 1e6 + 0.25]) {
            let (s, c) = sin_cos_turns(t);
            let r = t - t.round();
            let (es, ec) = (libm::sin(TAU * r), libm::cos(TAU * r));
            assert!((s - es).abs() <= 4.5e-16 && (c - ec).abs() <= 4.5e-16, "{t}: {s} {es}, {c} {ec}");
            assert!((s * s + c * c - 1.0).abs() <= 4.5e-16);
        }
        assert_eq!(sin_cos_turns(0.25), (1.0, 0.0));
        assert_eq!(sin_cos_turns(-0.5).1, -1.0);
    }

    /// Against libm (1 ulp) all around the circle, at the axes and the seams: 4 ulp apart at most.
    #[test]
    fn atan2_is_right_to_the_last_bits() {
        let near = |y: f64, x: f64| {
            let (ours, theirs) = (atan2(y, x), libm::atan2(y, x));
            assert!(
                (ours - theirs).abs() <= 4.0 * f64::EPSILON * theirs.abs(),
                "atan2({y:e}, {x:e}) = {ours}, {theirs}"
            );
        };
        for u in uniforms() {
            let (s, c) = sin_cos_turns(u);
            for scale in [1e-140, 1.0, 3e-7, 1e140] {
                near(scale * s, scale * c);
                near(scale * s, 1e-9 * scale * c);
            }
        }
        for (y, x) in [(0.0, 1.0), (0.0, -1.0), (1.0, 0.0), (-1.0, 0.0), (1.0, -1.0), (-1.0, 1.0), (0.0, 0.0)] {
            near(y, x);
        }
    }

    /// Against libm, whose own error is below 1e-15; the published bounds are 5e-8 and, of amplitude and phase, 1.6e-8 and 7e-8.
    #[test]
    fn bessel_j0_is_close() {
        for i in 0..200_000 {
            let x = f64::from(i) * 1e-3;
            assert!((bessel_j0(x) - libm::j0(x)).abs() < 1e-7, "J0({x}) = {} against {}", bessel_j0(x), libm::j0(x));
        }
        assert!((bessel_j0(1e6) - libm::j0(1e6)).abs() < 1e-9);
    }
}
