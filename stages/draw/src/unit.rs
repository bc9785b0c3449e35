//! Where the points lie in the unit cube.

use turbid_optics::philox::unit;

use crate::hash;
use crate::sobol::{DIMENSIONS, scrambled};

/// How points fill the unit cube.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Every stretch of 2^k indices is spread evenly; more points leave those before as they are.
    Sobol,
    /// Of n points one lies in each n-th of each quantity; another n moves all of them.
    Lhs,
    /// Independent; more points leave those before as they are.
    Random,
}

impl Method {
    pub const NAMES: [(&'static str, Self); 3] = [("sobol", Self::Sobol), ("lhs", Self::Lhs), ("random", Self::Random)];

    /// What a file calls it.
    pub fn name(self) -> &'static str {
        Self::NAMES.iter().find(|(_, method)| *method == self).expect("every method has a name").0
    }

    /// Coordinate of point `index` of `n` for the quantity `name` (a number of its own), the `dimension`-th: inside (0, 1).
    ///
    /// Sobol points beyond 2^32 or dimensions beyond [`DIMENSIONS`] must not be asked for.
    pub(crate) fn coordinate(self, seed: u64, name: u64, dimension: usize, index: u64, n: u64) -> f64 {
        match self {
            Self::Sobol => {
                assert!(dimension < DIMENSIONS, "dimension {dimension}");
                let index = u32::try_from(index).expect("a draw has at most 2^32 points");
                // A counter that no index reaches: the seed of the scrambling is no coordinate of a point.
                let seed = hash::bits(seed, name, u64::MAX)[0];
                unit(scrambled(index, dimension, seed))
            }
            Self::Lhs => {
                let within = unit(hash::bits(seed, name, index)[0]);
                (permuted(index, n, hash::bits(seed, name, u64::MAX)) as f64 + within) / n as f64
            }
            Self::Random => unit(hash::bits(seed, name, index)[0]),
        }
    }
}

/// Place of `index` in a random order of 0..n, without the others: a cipher of a power of four that holds n, walked until
/// it falls below n.
///
/// Source: J. Black and P. Rogaway, "Ciphers with arbitrary finite domains", CT-RSA 2002, methods 2 and 3.
fn permuted(index: u64, n: u64, key: [u32; 4]) -> u64 {
    let half = (64 - (n - 1).leading_zeros()).div_ceil(2).max(1);
    let mask = (1_u64 << half) - 1;
    let mut at = index;
    loop {
        let (mut left, mut right) = (at >> half, at & mask);
        for round in 0..8 {
            let mixed = hash::bits(u64::from(key[0]) << 32 | u64::from(key[1]), u64::from(key[2]) << 32 | round, right);
            (left, right) = (right, (left ^ u64::from(mixed[0])) & mask);
        }
        at = left << half | right;
        if at < n {
            return at;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn orders_hold_every_place_once() {
        for n in [1, 2, 3, 16, 17, 1000] {
            let mut places: Vec<u64> = (0..n).map(|i| permuted(i, n, [1, 2, 3, 4])).collect();
            let moved = places.iter().enumerate().filter(|&(i, &p)| i as u64 != p).count();
            assert!(n < 16 || moved > n as usize / 2, "{n}: {moved} moved");
            places.sort_unstable();
            assert_eq!(places, (0..n).collect::<Vec<_>>());
        }
    }
}
