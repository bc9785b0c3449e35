//! The Sobol sequence, and its scrambling by a hash.

use std::sync::OnceLock;

use crate::directions::DIRECTIONS;

/// How many dimensions there are.
pub const DIMENSIONS: usize = DIRECTIONS.len() + 1;

/// Coordinate `dimension` (below [`DIMENSIONS`]) of point `index`, as a fraction of 2^32.
///
/// Points stand in the order of their index, not of its Gray code: point i here is point gray^-1(i) of libraries that
/// go from each point to the next. The first 2^k points are the same set.
///
/// Source: I. M. Sobol', USSR Comput. Math. Math. Phys. 7, 86 (1967); direction numbers: [`crate::directions`].
pub fn sobol(index: u32, dimension: usize) -> u32 {
    let directions = &table()[dimension];
    (0..32).filter(|bit| index >> bit & 1 == 1).fold(0, |sum, bit| sum ^ directions[bit])
}

/// The same, scrambled: each seed gives another sequence with the same equidistribution, whose points are uniform.
///
/// Digits are permuted depending on those before them (nested uniform scrambling, Owen 1995) by a hash in which each bit
/// depends on lower ones only, applied to the reversed bits.
/// Source: B. Burley, "Practical hash-based Owen scrambling", J. Comput. Graph. Tech. 10 (4), 1 (2020), section 2; the
/// constants are N. Vegdahl's (2021), which mix better than those of Laine and Karras.
pub fn scrambled(index: u32, dimension: usize, seed: u32) -> u32 {
    let mut x = sobol(index, dimension).reverse_bits();
    x ^= x.wrapping_mul(0x3d20_adea);
    x = x.wrapping_add(seed);
    x = x.wrapping_mul((seed >> 16) | 1);
    x ^= x.wrapping_mul(0x0552_6c56);
    x ^= x.wrapping_mul(0x53a2_2864);
    x.reverse_bits()
}

/// What each bit of the index adds to each coordinate.
fn table() -> &'static [[u32; 32]] {
    static TABLE: OnceLock<Vec<[u32; 32]>> = OnceLock::new();
    TABLE.get_or_init(|| {
        // The first dimension reverses the bits of the index (van der Corput).
        let first: [u32; 32] = std::array::from_fn(|bit| 1 << (31 - bit));
        std::iter::once(first).chain(DIRECTIONS.iter().map(|&(inner, start)| directions(inner, start))).collect()
    })
}

/// The recurrence of Bratley and Fox, ACM Trans. Math. Softw. 14, 88 (1988), equation 2, on numbers shifted to the top.
fn directions(inner: u32, start: &[u32]) -> [u32; 32] {
    let degree = start.len();
    let mut v = [0_u32; 32];
    for bit in 0..32 {
        v[bit] = if bit < degree {
            start[bit] << (31 - bit)
        } else {
            let before = v[bit - degree];
            let inner = (1..degree).filter(|k| inner >> (degree - 1 - k) & 1 == 1).map(|k| v[bit - k]);
            inner.fold(before ^ before >> degree, |sum, v| sum ^ v)
        };
    }
    v
}
