//! ln and exp in f32, of + - * / and bit moves: the same bits in every lane of every machine.
//!
//! The same series as the renderer's, which work on its explicit vectors; these are scalar, for loops that the compiler turns into vectors.

#![allow(clippy::excessive_precision, reason = "coefficients as published")]

/// ln x for normal x > 0; within 2e-7 of it, and within 2 ulp where |ln x| > 1. Of any other x it makes a number that means nothing.
///
/// Coefficients: Cephes `logf` (Moshier 1992).
#[inline(always)]
pub fn ln(x: f32) -> f32 {
    const TWO_23: f32 = 8_388_608.0;
    // x = 2^k (1 + f) with 1 + f in [sqrt(1/2), sqrt(2)): adding to the bits carries into the exponent at sqrt(2).
    let shifted = x.to_bits().wrapping_add(0x3F80_0000 - 0x3F35_04F3);
    // In the low bits of 2^23 an integer is a float, on every vector unit.
    let k = f32::from_bits(TWO_23.to_bits() | (shifted >> 23)) - (TWO_23 + 127.0);
    let f = f32::from_bits((shifted & 0x007F_FFFF) + 0x3F35_04F3) - 1.0;
    let z = f * f;
    // Pairs first: half the latency of Horner's rule.
    let (p1, p2) = (f * 1.166_769_987_4e-1 - 1.242_014_084_6e-1, f * 1.424_932_278_7e-1 - 1.666_805_766_5e-1);
    let (p3, p4) = (f * 2.000_071_476_5e-1 - 2.499_999_399_3e-1, f * 7.037_683_629_2e-2 - 1.151_461_031_0e-1);
    let p = ((p4 * z + p1) * z + p2) * z + p3;
    let y = (p * f + 3.333_333_117_4e-1) * (f * z) - k * 2.121_944_40e-4 - z * 0.5;
    f + y + k * 0.693_359_375
}

/// e^x for |x| <= 87; within 2e-7 of it, relative. Beyond that range the result is meaningless: the caller knows its numbers.
///
/// Coefficients: Cephes `expf` (Moshier 1992).
#[inline(always)]
pub fn exp(x: f32) -> f32 {
    // Adding 1.5 * 2^23 rounds to the nearest integer, and leaves that integer in the low bits.
    const ROUND: f32 = 12_582_912.0;
    let rounded = x * std::f32::consts::LOG2_E + ROUND;
    let k = rounded - ROUND;
    let r = (x - k * 0.693_359_375) + k * 2.121_944_40e-4;
    let z = r * r;
    let (p0, p1) = (r * 1.987_569_150_0e-4 + 1.398_199_950_7e-3, r * 8.333_451_907_3e-3 + 4.166_579_589_4e-2);
    let p2 = r * 1.666_666_545_9e-1 + 5.000_000_120_1e-1;
    let mantissa = ((p0 * z + p1) * z + p2) * z + r + 1.0;
    f32::from_bits(mantissa.to_bits().wrapping_add(rounded.to_bits() << 23))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against libm in f64, over all exponents that reflectances and their ratios have.
    #[test]
    fn ln_is_close() {
        for i in 0..200_000_u32 {
            // Steps of the bits: every exponent from 2^-63 to 2^64, some 1500 mantissas each.
            let x = f32::from_bits(0x2000_0000 + i * 5_368);
            let (ours, exact) = (f64::from(ln(x)), libm::log(f64::from(x)));
            let allowed = (2.0 * f64::from(f32::EPSILON) * exact.abs()).max(2e-7);
            assert!((ours - exact).abs() <= allowed, "ln({x:e}) = {ours}, {exact}");
        }
        assert_eq!(ln(1.0), 0.0);
    }

    /// Against libm in f64, over the range that is promised.
    #[test]
    fn exp_is_close() {
        for i in 0..200_000 {
            let x = (i as f32 - 1e5) * 8.7e-4;
            let (ours, exact) = (f64::from(exp(x)), libm::exp(f64::from(x)));
            assert!((ours / exact - 1.0).abs() <= 2e-7, "exp({x}) = {ours:e}, {exact:e}");
        }
        assert_eq!(exp(0.0), 1.0);
    }
}
