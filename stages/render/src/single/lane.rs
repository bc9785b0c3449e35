//! Sixteen f32 side by side, and the functions of them that a path needs: + - * /, square roots and bit moves only, none fused,
//! so that a lane holds the same bits on every vector unit.

#![allow(clippy::excessive_precision, reason = "coefficients as published")]

use fearless_simd::prelude::*;
use fearless_simd::{f32x16, i32x16, mask32x16, u32x16, u64x8};

/// Lanes of a vector.
pub const LANES: usize = 16;

pub type F<S> = f32x16<S>;
pub type U<S> = u32x16<S>;
pub type M<S> = mask32x16<S>;

/// Three coordinates.
#[derive(Clone, Copy)]
pub struct V<S: Simd> {
    pub x: F<S>,
    pub y: F<S>,
    pub z: F<S>,
}

impl<S: Simd> V<S> {
    #[inline(always)]
    pub fn dot(self, other: Self) -> F<S> {
        self.x * other.x + self.y * other.y + self.z * other.z
    }

    #[inline(always)]
    pub fn minus(self, other: Self) -> Self {
        Self { x: self.x - other.x, y: self.y - other.y, z: self.z - other.z }
    }

    /// self + s other.
    #[inline(always)]
    pub fn plus(self, s: F<S>, other: Self) -> Self {
        Self { x: self.x + s * other.x, y: self.y + s * other.y, z: self.z + s * other.z }
    }

    /// This where `mask` says so, else the other.
    #[inline(always)]
    pub fn or(self, mask: M<S>, other: Self) -> Self {
        Self { x: choose(mask, self.x, other.x), y: choose(mask, self.y, other.y), z: choose(mask, self.z, other.z) }
    }

    /// The largest coordinate.
    #[inline(always)]
    pub fn size(self) -> F<S> {
        self.x.abs().max(self.y.abs().max(self.z.abs()))
    }

    #[inline(always)]
    pub fn times(self, s: F<S>) -> Self {
        Self { x: self.x * s, y: self.y * s, z: self.z * s }
    }

    #[inline(always)]
    pub fn scaled(self, s: [f32; 3]) -> Self {
        Self { x: self.x * s[0], y: self.y * s[1], z: self.z * s[2] }
    }

    /// Its component along a unit vector that all share.
    #[inline(always)]
    pub fn along(self, unit: [f32; 3]) -> F<S> {
        self.x * unit[0] + self.y * unit[1] + self.z * unit[2]
    }

    #[inline(always)]
    pub fn from(self, origin: [f32; 3]) -> Self {
        Self { x: self.x - origin[0], y: self.y - origin[1], z: self.z - origin[2] }
    }
}

/// Runs an expression where it stands, or, where sixteen lanes are four vectors, in a function of its own: with all of it in one
/// function the kernels of such machines would be half of the time that this crate takes to build, and run no faster.
#[inline(always)]
pub fn apart<S: Simd, R>(f: impl FnOnce() -> R) -> R {
    #[inline(never)]
    fn called<R>(f: impl FnOnce() -> R) -> R {
        f()
    }
    if const { size_of::<S::f32s>() == 16 } { called(f) } else { f() }
}

#[inline(always)]
pub fn splat<S: Simd>(simd: S, x: f32) -> F<S> {
    F::splat(simd, x)
}

#[inline(always)]
pub fn choose<S: Simd>(mask: M<S>, yes: F<S>, no: F<S>) -> F<S> {
    mask.select(yes, no)
}

/// ln x for normal x > 0; within 2e-7 of it.
///
/// Coefficients: Cephes `logf` (Moshier 1992).
#[inline(always)]
pub fn ln<S: Simd>(x: F<S>) -> F<S> {
    apart::<S, _>(
        #[inline(always)]
        || {
            const TWO_23: f32 = 8_388_608.0;
            // x = 2^k (1 + f), 1 + f in [sqrt(1/2), sqrt(2)): adding to the bits carries into the exponent at sqrt(2).
            let shifted = x.to_bits() + (0x3F80_0000 - 0x3F35_04F3_u32);
            // In the low bits of 2^23 an integer is a float.
            let k = F::from_bits((shifted >> 23) | 0x4B00_0000) - (TWO_23 + 127.0);
            let f = F::from_bits((shifted & 0x007F_FFFF) + 0x3F35_04F3) - 1.0;
            let z = f * f;
            // Pairs first: half the latency of Horner's rule.
            let (p1, p2) = (f * 1.166_769_99e-1 - 1.242_014_1e-1, f * 1.424_932_3e-1 - 1.666_805_8e-1);
            let (p3, p4) = (f * 2.000_071_5e-1 - 2.499_999_4e-1, f * 7.037_683_6e-2 - 1.151_461e-1);
            let p = ((p4 * z + p1) * z + p2) * z + p3;
            let y = (p * f + 3.333_333_1e-1) * (f * z) - k * 2.121_944_4e-4 - z * 0.5;
            f + y + k * 0.693_359_375
        },
    )
}

/// e^x for |x| <= 87; within 2e-7 of it. Beyond that range the result is meaningless: the caller knows its numbers.
///
/// Coefficients: Cephes `expf` (Moshier 1992).
#[inline(always)]
pub fn exp<S: Simd>(x: F<S>) -> F<S> {
    apart::<S, _>(
        #[inline(always)]
        || {
            // Adding 1.5 * 2^23 rounds to the nearest integer, and leaves that integer in the low bits.
            const ROUND: f32 = 12_582_912.0;
            let rounded = x * std::f32::consts::LOG2_E + ROUND;
            let k = rounded - ROUND;
            let r = (x - k * 0.693_359_375) + k * 2.121_944_4e-4;
            let z = r * r;
            let (p0, p1) = (r * 1.987_569_1e-4 + 1.398_199_9e-3, r * 8.333_452e-3 + 4.166_579_6e-2);
            let p2 = r * 1.666_666_5e-1 + 0.5;
            let mantissa = ((p0 * z + p1) * z + p2) * z + r + 1.0;
            F::from_bits(mantissa.to_bits() + (rounded.to_bits() << 23))
        },
    )
}

/// (sin, cos) of 2 pi `turns`, |turns| < 2^20; within 1.2e-7 of the exact values at that argument.
///
/// Coefficients: Cephes `sinf` (Moshier 1992).
#[inline(always)]
pub fn sin_cos_turns<S: Simd>(turns: F<S>) -> (F<S>, F<S>) {
    apart::<S, _>(
        #[inline(always)]
        || {
            const ROUND: f32 = 12_582_912.0;
            let rounded = turns * 4.0 + ROUND;
            let quarter = rounded.to_bits();
            // Exact: within an eighth of a turn of zero.
            let x = (turns - (rounded - ROUND) * 0.25) * std::f32::consts::TAU;
            let z = x * x;
            let sin = x + x * z * (-1.666_665_5e-1 + z * (8.332_161e-3 - z * 1.951_529_6e-4));
            let cos = 1.0 - (z * 0.5 - z * z * (4.166_664_6e-2 + z * (-1.388_731_6e-3 + z * 2.443_315_7e-5)));
            // The quarter turns: swap by the lowest bit, signs by the next.
            let swap = (quarter & 1).simd_eq(1);
            let (s, c) = (choose(swap, cos, sin), choose(swap, sin, cos));
            let sin_sign = (quarter & 2) << 30;
            let cos_sign = ((quarter ^ (quarter << 1)) & 2) << 30;
            (F::from_bits(s.to_bits() ^ sin_sign), F::from_bits(c.to_bits() ^ cos_sign))
        },
    )
}

/// Keys of the rounds of Philox4x32-10.
#[derive(Clone, Copy, Debug)]
pub struct RoundKeys([[u64; 2]; 10]);

impl RoundKeys {
    pub fn of(key: [u32; 2]) -> Self {
        let steps = [0x9E37_79B9_u32, 0xBB67_AE85];
        Self(std::array::from_fn(|i| {
            std::array::from_fn(|k| u64::from(key[k].wrapping_add(steps[k].wrapping_mul(i as u32))))
        }))
    }

    /// The key itself, which is that of the first round.
    pub fn key(&self) -> [u32; 2] {
        self.0[0].map(|half| half as u32)
    }
}

/// Four random numbers in each lane: Philox4x32-10 of `turbid_optics::philox` at (number, high, sample, pixel).
#[inline(always)]
pub fn philox<S: Simd>(simd: S, number: U<S>, high: U<S>, sample: U<S>, pixel: U<S>, keys: &RoundKeys) -> [U<S>; 4] {
    apart::<S, _>(
        #[inline(always)]
        || {
            let (n, h) = (simd.widen_u32x16(number), simd.widen_u32x16(high));
            let (s, p) = (simd.widen_u32x16(sample), simd.widen_u32x16(pixel));
            let (low, upper) = (rounds([n.0, h.0, s.0, p.0], keys), rounds([n.1, h.1, s.1, p.1], keys));
            // No `map`: what is not inlined loses the vector instructions.
            [
                simd.narrow_u64x8(low[0], upper[0]),
                simd.narrow_u64x8(low[1], upper[1]),
                simd.narrow_u64x8(low[2], upper[2]),
                simd.narrow_u64x8(low[3], upper[3]),
            ]
        },
    )
}

/// In words of 64 bits, of which the upper halves hold what the products left: the next product does not look at them.
#[inline(always)]
fn rounds<S: Simd>(mut c: [u64x8<S>; 4], keys: &RoundKeys) -> [u64x8<S>; 4] {
    const LOW: u64 = 0xFFFF_FFFF;
    for [a, b] in keys.0 {
        let (p0, p1) = ((c[0] & LOW) * 0xD251_1F53, (c[2] & LOW) * 0xCD9E_8D57);
        c = [(p1 >> 32) ^ c[1] ^ a, p1, (p0 >> 32) ^ c[3] ^ b, p0];
    }
    c
}

/// Uniform in (0, 1], of 31 bits: fine near 0, where logarithms are large.
#[inline(always)]
pub fn unit<S: Simd>(bits: U<S>) -> F<S> {
    let whole: i32x16<S> = (bits >> 1).bitcast();
    (whole.to_float::<F<S>>() + 0.5) * (1.0 / 2_147_483_648.0)
}

/// Uniform in (0, 1), of the upper 23 bits; the lower eight are left for [`spare`].
#[inline(always)]
pub fn unit_short<S: Simd>(bits: U<S>) -> F<S> {
    let whole = F::from_bits((bits >> 9) | 0x3F80_0000);
    whole - (1.0 - 0.5 / 8_388_608.0)
}

/// Uniform in (0, 1), of the lowest eight bits of three numbers that [`unit_short`] was taken of: independent of them.
#[inline(always)]
pub fn spare<S: Simd>(a: U<S>, b: U<S>, c: U<S>) -> F<S> {
    let joined = ((a & 0xFF) << 15) | ((b & 0xFF) << 7) | ((c & 0xFF) >> 1);
    F::from_bits(joined | 0x3F80_0000) - (1.0 - 0.5 / 8_388_608.0)
}

/// 1 + g^2 - 2 g cos, without loss at g -> 1, cos -> 1.
#[inline(always)]
pub fn hg_denominator<S: Simd>(g: F<S>, cos: F<S>) -> F<S> {
    let rest = 1.0 - g;
    rest * rest + g * 2.0 * (1.0 - cos)
}

/// A direction scattered from the unit vector `w` by Henyey and Greenstein, for u in (0, 1) and `turns` in [0, 1).
///
/// See `turbid_optics::henyey_greenstein`; one division for the angle and the basis.
#[inline(always)]
pub fn hg_sample<S: Simd>(g: F<S>, w: V<S>, u: F<S>, turns: F<S>) -> V<S> {
    apart::<S, _>(
        #[inline(always)]
        || {
            let simd = g.token();
            let one = splat(simd, 1.0);
            let sign = one.copysign(w.z);
            let (rest, basis) = (1.0 - g, sign + w.z);
            let wide = rest + g * 2.0 * u;
            let inverse = 1.0 / (wide * basis);
            let (ratio, a) = (rest * (inverse * basis), -(inverse * wide));
            let h = ratio * ratio * 2.0 * (1.0 - u) * (g * u + 1.0);
            let (cos_theta, sin_theta) = (1.0 - h, (h * (2.0 - h)).max(splat(simd, 0.0)).sqrt());
            let (sin_phi, cos_phi) = sin_cos_turns(turns);
            let b = w.x * w.y * a;
            let (x, y) = (sin_theta * cos_phi, sin_theta * sin_phi);
            let turned = V {
                x: x * (sign * w.x * w.x * a + 1.0) + y * b + cos_theta * w.x,
                y: x * sign * b + y * (sign + w.y * w.y * a) + cos_theta * w.y,
                z: cos_theta * w.z - x * sign * w.x - y * w.y,
            };
            // One Newton step towards length 1: rounding would drift over millions of turns.
            turned.times(1.5 - turned.dot(turned) * 0.5)
        },
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use fearless_simd::{Level, dispatch};
    use turbid_optics::philox::philox4x32;

    fn over(inputs: impl Iterator<Item = f32>, mut test: impl FnMut(f32, [f32; 4])) {
        let mut lanes = Vec::with_capacity(LANES);
        let mut flush = |lanes: &mut Vec<f32>| {
            lanes.resize(LANES, 1.0);
            let x: [f32; LANES] = lanes.as_slice().try_into().unwrap();
            let y = dispatch!(Level::new(), simd => all(simd, x));
            for (i, &x) in x.iter().enumerate() {
                test(x, y.map(|y| y[i]));
            }
            lanes.clear();
        };
        for x in inputs {
            lanes.push(x);
            if lanes.len() == LANES {
                flush(&mut lanes);
            }
        }
        flush(&mut lanes);
    }

    #[inline(always)]
    fn all<S: Simd>(simd: S, x: [f32; LANES]) -> [[f32; LANES]; 4] {
        let x = F::load_array(simd, x);
        let (sin, cos) = sin_cos_turns(x);
        [ln(x), exp(-x), sin, cos].map(|y| y.to_array())
    }

    /// Every 13th of all f32 in (2^-33, 80), against f64.
    #[test]
    fn functions_keep_their_digits() {
        let (first, last) = (2f32.powi(-33).to_bits(), 80f32.to_bits());
        over((first..last).step_by(13).map(f32::from_bits), |x, [ln, exp, sin, cos]| {
            let exact = f64::from(x);
            let (l, e) = (libm::log(exact), libm::exp(-exact));
            assert!((f64::from(ln) - l).abs() <= 2e-7 * l.abs(), "ln {x:e}: {ln:e}, {l:e}");
            assert!((f64::from(exp) - e).abs() <= 2e-7 * e, "exp -{x:e}: {exp:e}, {e:e}");
            let angle = std::f64::consts::TAU * exact;
            let error = (f64::from(sin) - libm::sin(angle)).abs().max((f64::from(cos) - libm::cos(angle)).abs());
            assert!(error <= 1.2e-7, "turns {x:e}: off by {error:e}");
        });
    }

    /// The lanes' Philox is the scalar one.
    #[test]
    fn random_numbers_are_those_of_a_scalar() {
        let spread = |k: u32| std::array::from_fn::<u32, LANES, _>(|i| (i as u32 + 1).wrapping_mul(k));
        let (number, sample, pixel) = (spread(0x9E37_79B9), spread(7), spread(0x1234_5677));
        let drawn = dispatch!(Level::new(), simd => draw(simd, number, sample, pixel));
        for i in 0..LANES {
            let expected = philox4x32([number[i], 3 << 16, sample[i], pixel[i]], [5, 0xFFFF_FFFF]);
            assert_eq!(drawn.map(|d| d[i]), expected);
        }
    }

    #[inline(always)]
    fn draw<S: Simd>(simd: S, n: [u32; LANES], s: [u32; LANES], p: [u32; LANES]) -> [[u32; LANES]; 4] {
        let [n, s, p] = [n, s, p].map(|x| U::load_array(simd, x));
        philox(simd, n, U::splat(simd, 3 << 16), s, p, &RoundKeys::of([5, 0xFFFF_FFFF])).map(|x| x.to_array())
    }

    /// Angles and lengths after a turn, from every start, to a few roundings; and a walk of a million turns keeps its length.
    #[test]
    fn turning_keeps_angles_and_length() {
        for g in [-0.99f32, -0.5, 0.0, 1e-9, 0.8, 0.99] {
            for (u, turns) in [(1e-7f32, 0.0f32), (0.3, 0.4), (0.9, 0.77), (0.999_999_9, 0.25)] {
                for w in [[0.0f32, 0.0, 1.0], [0.0, 0.0, -1.0], [0.6, -0.64, -0.48], [1e-4, 0.0, -1.0]] {
                    let (e, long) = dispatch!(Level::new(), simd => turn(simd, g, w, u, turns));
                    let length = e.iter().map(|x| x * x).sum::<f32>();
                    assert!((length - 1.0).abs() < 5e-7 && (long - 1.0).abs() < 5e-7, "{length} {long}");
                    let cos = e.iter().zip(w).map(|(&a, b)| f64::from(a) * f64::from(b)).sum::<f64>();
                    let h = turbid_optics::henyey_greenstein::sample_one_minus_cos(f64::from(g), f64::from(u));
                    assert!((1.0 - cos - h).abs() < 6e-7, "g {g}, u {u}, w {w:?}: {cos}, {}", 1.0 - h);
                }
            }
        }
    }

    #[inline(always)]
    fn turn<S: Simd>(simd: S, g: f32, w: [f32; 3], u: f32, turns: f32) -> ([f32; 3], f32) {
        let [x, y, z] = w.map(|x| splat(simd, x));
        let (g, u) = (splat(simd, g), splat(simd, u));
        let e = hg_sample(g, V { x, y, z }, u, splat(simd, turns));
        let mut walk = e;
        for i in 0..1000 {
            walk = hg_sample(g, walk, u, splat(simd, i as f32 * 0.618));
        }
        ([e.x[0], e.y[0], e.z[0]], walk.dot(walk)[0])
    }
}
