//! Singular values and vectors of small matrices.

use crate::matrix::{Matrix, dot};

/// Rotates the rows of `a` among each other until they are orthogonal: their lengths are then the singular values,
/// their directions the right singular vectors.
///
/// One-sided Jacobi rotations: each row keeps its digits relative to its own length, however short (Demmel, Veselic,
/// SIAM J. Matrix Anal. Appl. 13, 1204 (1992)). Returns the lengths; the rows come out normalised.
///
/// Orthogonal means to 1e-15 N of the lengths; with `polish` one more sweep rotates by whatever is left, for entries that are
/// themselves far below the lengths.
pub fn orthogonalise<const N: usize>(a: &mut Matrix<N>, polish: bool) -> [f64; N] {
    const SWEEPS: usize = 40;
    let mut tolerance = 1e-15 * N as f64;
    let mut last = false;
    let mut squares = [0.0; N];
    for _ in 0..SWEEPS {
        for (square, row) in squares.iter_mut().zip(a.iter()) {
            *square = dot(row, row);
        }
        let mut rotated = false;
        for round in 0..rounds(N) {
            // Four pairs side by side: their roots and quotients do not wait for each other.
            for first in (0..N / 2).step_by(4) {
                rotated |= rotate_four(a, &mut squares, round, first, tolerance);
            }
        }
        if last || !rotated && !polish {
            break;
        }
        if !rotated {
            (tolerance, last) = (0.0, true);
        }
    }
    let mut lengths = [0.0; N];
    for (length, row) in lengths.iter_mut().zip(a.iter_mut()) {
        *length = dot(row, row).sqrt();
        let inverse = 1.0 / *length;
        for x in row {
            *x *= inverse;
        }
    }
    lengths
}

/// Rounds in which each of `n` rows meets every other one once.
const fn rounds(n: usize) -> usize {
    n - 1 + n % 2
}

/// Pair `k` of a round of the tournament, the lower row first: one row stays (or none, if they are odd in number), the others move on around it.
#[inline]
fn pair(n: usize, round: usize, k: usize) -> (usize, usize) {
    let count = rounds(n);
    let k = k + n % 2;
    if k == 0 {
        return (round, n - 1);
    }
    let (ahead, behind) = (round + k, round + count - k);
    let i = if ahead < count { ahead } else { ahead - count };
    let j = if behind < count { behind } else { behind - count };
    (i.min(j), i.max(j))
}

/// Rotates pairs `first` to `first + 3` of a round where they are not orthogonal to `tolerance`; whether any was.
fn rotate_four<const N: usize>(
    a: &mut Matrix<N>,
    squares: &mut [f64; N],
    round: usize,
    first: usize,
    tolerance: f64,
) -> bool {
    let count = (N / 2 - first).min(4);
    let mut rows = [(0, 0); 4];
    let (mut across, mut low, mut high) = ([0.0; 4], [1.0; 4], [1.0; 4]);
    for k in 0..count {
        let (i, j) = pair(N, round, first + k);
        rows[k] = (i, j);
        (across[k], low[k], high[k]) = (dot(&a[i], &a[j]), squares[i], squares[j]);
    }
    let turns: [bool; 4] = std::array::from_fn(|k| across[k] * across[k] > tolerance * tolerance * low[k] * high[k]);
    if turns == [false; 4] {
        return false;
    }
    let tangents: [f64; 4] = std::array::from_fn(|k| {
        let zeta = (high[k] - low[k]) / (2.0 * across[k]);
        1f64.copysign(zeta) / (zeta.abs() + (1.0 + zeta * zeta).sqrt())
    });
    let cosines = tangents.map(|t| 1.0 / (1.0 + t * t).sqrt());
    for k in (0..count).filter(|&k| turns[k]) {
        let (i, j) = rows[k];
        let (t, cos) = (tangents[k], cosines[k]);
        let sin = cos * t;
        let (head, tail) = a.split_at_mut(j);
        for (x, y) in head[i].iter_mut().zip(tail[0].iter_mut()) {
            (*x, *y) = (cos * *x - sin * *y, sin * *x + cos * *y);
        }
        let moved = t * across[k];
        squares[i] -= moved;
        squares[j] += moved;
        if squares[i] <= 0.1 * moved.abs() || squares[j] <= 0.1 * moved.abs() {
            // The update cancels: take the lengths afresh.
            squares[i] = dot(&a[i], &a[i]);
            squares[j] = dot(&a[j], &a[j]);
        }
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every row meets every other one once in a sweep.
    #[test]
    fn a_tournament_is_complete() {
        for n in 2..=65 {
            let mut met = vec![false; n * n];
            for (round, k) in (0..rounds(n)).flat_map(|round| (0..n / 2).map(move |k| (round, k))) {
                let (i, j) = pair(n, round, k);
                assert!(i < j && !std::mem::replace(&mut met[n * i + j], true), "{n}: {i} {j} in round {round}");
            }
            assert_eq!(met.iter().filter(|met| **met).count(), n * (n - 1) / 2);
        }
    }

    /// Graded rows: lengths down to 1e-100 come out with all digits (the product of the lengths is the determinant).
    #[test]
    fn rotations_keep_short_rows() {
        let mut a = [[3.0, 1.0, 2.0], [1e-50, -2e-50, 1e-50], [2e-100, 0.0, 1e-100]];
        // det = 3 (-2e-150) - 1 (1e-150 - 2e-150) + 2 (4e-150)
        let lengths = orthogonalise(&mut a, false);
        let product = lengths[0] * lengths[1] * lengths[2];
        assert!((product / 3e-150 - 1.0).abs() < 1e-13, "{product:e}");
        for i in 0..3 {
            for j in 0..3 {
                let expected = if i == j { 1.0 } else { 0.0 };
                assert!((dot(&a[i], &a[j]) - expected).abs() < 1e-14, "{i} {j}");
            }
        }
    }
}
