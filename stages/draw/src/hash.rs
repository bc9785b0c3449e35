//! Seeds of names, and random numbers as a function of where they are used.

use turbid_optics::philox::{key, philox4x32};

/// The number of a name, the same on every machine. Source: FNV-1a, 64 bits (Fowler, Noll, Vo).
pub(crate) fn of_name(name: &str) -> u64 {
    name.bytes().fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}

/// 128 random bits for a seed, a name and an index.
pub(crate) fn bits(seed: u64, name: u64, index: u64) -> [u32; 4] {
    philox4x32([index as u32, (index >> 32) as u32, name as u32, (name >> 32) as u32], key(seed))
}

/// The seed of a set of points: each name (of a stage, say) has one of its own.
pub fn stream(seed: u64, name: &str) -> u64 {
    let bits = bits(seed, of_name(name), u64::MAX - 1);
    u64::from(bits[0]) << 32 | u64::from(bits[1])
}

/// Uniform among `n` numbers: the bias is below n / 2^64.
pub(crate) fn below(n: u64, bits: [u32; 4]) -> u64 {
    let wide = u64::from(bits[0]) << 32 | u64::from(bits[1]);
    ((u128::from(wide) * u128::from(n)) >> 64) as u64
}
