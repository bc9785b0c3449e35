//! Philox4x32-10: random numbers as a function of where they are used, not of what was drawn before.
//!
//! Source: Salmon, Moraes, Dror, Shaw, "Parallel random numbers: as easy as 1, 2, 3", SC'11 (2011).

/// The ten rounds: 128 random bits for a counter and a key.
#[inline(always)]
pub fn philox4x32(mut counter: [u32; 4], mut key: [u32; 2]) -> [u32; 4] {
    for _ in 0..10 {
        let p0 = u64::from(counter[0]) * 0xD251_1F53;
        let p1 = u64::from(counter[2]) * 0xCD9E_8D57;
        counter =
            [(p1 >> 32) as u32 ^ counter[1] ^ key[0], p1 as u32, (p0 >> 32) as u32 ^ counter[3] ^ key[1], p0 as u32];
        key = [key[0].wrapping_add(0x9E37_79B9), key[1].wrapping_add(0xBB67_AE85)];
    }
    counter
}

/// A seed as a key.
pub fn key(seed: u64) -> [u32; 2] {
    [seed as u32, (seed >> 32) as u32]
}

/// Uniform in (0, 1) with 32 bits; never 0 or 1.
#[inline(always)]
pub fn unit(bits: u32) -> f64 {
    (f64::from(bits) + 0.5) * (1.0 / 4_294_967_296.0)
}

/// Uniform in (0, 1) with 23 bits, the lowest eight of each number: as good as independent of the [`unit`] of any of them.
#[inline(always)]
pub fn spare(a: u32, b: u32, c: u32) -> f64 {
    let joined = (a & 0xFF) << 15 | (b & 0xFF) << 7 | (c & 0xFF) >> 1;
    (f64::from(joined) + 0.5) * (1.0 / 8_388_608.0)
}

/// Uniform in (0, 1) with 52 bits: `bits`, refined by the upper 20 bits of `low`; never 0 or 1.
#[inline(always)]
pub fn unit_fine(bits: u32, low: u32) -> f64 {
    let joined = (u64::from(bits) << 20) | u64::from(low >> 12);
    // In the low bits of 2^52 an integer is a float, on every vector unit.
    const TWO_52: f64 = 4_503_599_627_370_496.0;
    ((f64::from_bits(TWO_52.to_bits() | joined) - TWO_52) + 0.5) * (1.0 / TWO_52)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The known answers that the authors publish with Random123.
    #[test]
    fn known_answers() {
        let table = [
            ([0; 4], [0; 2], [0x6627_e8d5, 0xe169_c58d, 0xbc57_ac4c, 0x9b00_dbd8]),
            ([u32::MAX; 4], [u32::MAX; 2], [0x408f_276d, 0x41c8_3b0e, 0xa20b_c7c6, 0x6d54_51fd]),
            (
                [0x243f_6a88, 0x85a3_08d3, 0x1319_8a2e, 0x0370_7344],
                [0xa409_3822, 0x299f_31d0],
                [0xd16c_fe09, 0x94fd_cceb, 0x5001_e420, 0x2412_6ea1],
            ),
        ];
        for (counter, key, expected) in table {
            assert_eq!(philox4x32(counter, key), expected);
        }
    }

    #[test]
    fn units_lie_inside_the_open_interval() {
        assert!(unit(0) > 0.0 && unit(u32::MAX) < 1.0);
        assert!(unit_fine(0, 0) > 0.0 && unit_fine(u32::MAX, u32::MAX) < 1.0);
        assert!((unit_fine(1 << 31, 0) - 0.5).abs() < 1e-15);
    }
}
