//! Symmetric factorisations on small fixed arrays: no allocation, no library, the same bits everywhere.

#![allow(clippy::needless_range_loop, reason = "rows and columns of one matrix")]

/// Rows of an N x N matrix.
pub type Matrix<const N: usize> = [[f64; N]; N];

pub fn zeros<const N: usize>() -> Matrix<N> {
    [[0.0; N]; N]
}

#[inline]
pub fn dot<const N: usize>(a: &[f64; N], b: &[f64; N]) -> f64 {
    // Four sums side by side, so that the vector unit may be used at fixed bits.
    let mut sums = [0.0; 4];
    let (a4, a_rest) = a.as_chunks::<4>();
    let (b4, b_rest) = b.as_chunks::<4>();
    for (x, y) in a4.iter().zip(b4) {
        for i in 0..4 {
            sums[i] += x[i] * y[i];
        }
    }
    for (x, y) in a_rest.iter().zip(b_rest) {
        sums[0] += x * y;
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3])
}

/// The transposed Cholesky factor (row j is column j of C, C C^T = a) of a symmetric positive definite matrix.
///
/// Row j is zero before entry j. `None` if a pivot is not above 0.
pub fn cholesky<const N: usize>(mut a: Matrix<N>) -> Option<Matrix<N>> {
    for j in 0..N {
        let pivot = a[j][j];
        if pivot <= 0.0 || pivot.is_nan() {
            return None;
        }
        let scale = 1.0 / pivot.sqrt();
        for i in 0..N {
            a[j][i] = if i < j { 0.0 } else { a[j][i] * scale };
        }
        let row = a[j];
        for i in j + 1..N {
            for k in 0..N {
                a[i][k] -= row[i] * row[k];
            }
        }
    }
    Some(a)
}

/// The transposed Cholesky factor of the symmetric matrix with the off-diagonal entries `-pull` and the row sums `excess`.
///
/// Pivots come as sums of `pull` and `excess`, never as differences, so that an excess of 1e-200 keeps all its digits
/// (Grassmann, Taksar, Heyman, Oper. Res. 33, 1107 (1985)): the matrix of a medium that hardly absorbs.
pub fn cholesky_of_sums<const N: usize>(mut pull: Matrix<N>, mut excess: [f64; N]) -> Option<Matrix<N>> {
    let mut factor = zeros();
    for j in 0..N {
        let mut pivot = excess[j];
        for i in j + 1..N {
            pivot += pull[j][i];
        }
        if pivot <= 0.0 || pivot.is_nan() {
            return None;
        }
        let root = pivot.sqrt();
        let row = pull[j];
        factor[j][j] = root;
        for i in j + 1..N {
            let share = row[i] / pivot;
            factor[j][i] = -row[i] / root;
            excess[i] += share * excess[j];
            for k in 0..N {
                pull[i][k] += share * row[k];
            }
        }
    }
    Some(factor)
}

/// Solves C C^T x = b for the transposed factor of [`cholesky`].
pub fn solve<const N: usize>(factor: &Matrix<N>, b: &[f64; N]) -> [f64; N] {
    let mut x = forward_substitute(factor, b);
    for j in (0..N).rev() {
        let mut sum = x[j];
        for i in j + 1..N {
            sum -= factor[j][i] * x[i];
        }
        x[j] = sum / factor[j][j];
    }
    x
}

/// Solves C x = b for the transposed factor of [`cholesky`].
pub fn forward_substitute<const N: usize>(factor: &Matrix<N>, b: &[f64; N]) -> [f64; N] {
    let mut x = *b;
    for j in 0..N {
        x[j] /= factor[j][j];
        let done = x[j];
        for i in j + 1..N {
            x[i] -= factor[j][i] * done;
        }
    }
    x
}

/// Solves C^T x = b for each row b of `rows` and the transposed factor of [`cholesky`].
pub fn back_substitute<const N: usize>(factor: &Matrix<N>, rows: &mut Matrix<N>) {
    for x in rows {
        for j in (0..N).rev() {
            // Row j of the factor is zero before entry j, where the unknowns still to come stand.
            let b = x[j];
            x[j] = 0.0;
            x[j] = (b - dot(&factor[j], x)) / factor[j][j];
        }
    }
}

/// Solves a x = b for each row b of `rows`, by elimination with row pivots; `None` where `a` is singular.
pub fn solve_rows<const N: usize>(mut a: Matrix<N>, rows: Matrix<N>) -> Option<Matrix<N>> {
    // Column i of `right` is row i: elimination then runs along rows.
    let mut right = transposed(&rows);
    for j in 0..N {
        let pivot = (j..N).max_by(|&p, &q| a[p][j].abs().total_cmp(&a[q][j].abs()))?;
        a.swap(j, pivot);
        right.swap(j, pivot);
        if a[j][j] == 0.0 || !a[j][j].is_finite() {
            return None;
        }
        let (row, values) = (a[j], right[j]);
        for i in (0..N).filter(|&i| i != j) {
            let share = a[i][j] / row[j];
            for k in j..N {
                a[i][k] -= share * row[k];
            }
            for k in 0..N {
                right[i][k] -= share * values[k];
            }
        }
    }
    for j in 0..N {
        for x in &mut right[j] {
            *x /= a[j][j];
        }
    }
    Some(transposed(&right))
}

pub fn transposed<const N: usize>(a: &Matrix<N>) -> Matrix<N> {
    std::array::from_fn(|i| std::array::from_fn(|j| a[j][i]))
}

pub fn times<const N: usize>(a: &Matrix<N>, b: &Matrix<N>) -> Matrix<N> {
    let columns = transposed(b);
    std::array::from_fn(|i| std::array::from_fn(|j| dot(&a[i], &columns[j])))
}

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
        for i in 0..N - 1 {
            for j in i + 1..N {
                let across = dot(&a[i], &a[j]);
                if across * across <= tolerance * tolerance * squares[i] * squares[j] {
                    continue;
                }
                rotated = true;
                let zeta = (squares[j] - squares[i]) / (2.0 * across);
                let t = 1f64.copysign(zeta) / (zeta.abs() + (1.0 + zeta * zeta).sqrt());
                let cos = 1.0 / (1.0 + t * t).sqrt();
                let sin = cos * t;
                let (head, tail) = a.split_at_mut(j);
                for (x, y) in head[i].iter_mut().zip(tail[0].iter_mut()) {
                    (*x, *y) = (cos * *x - sin * *y, sin * *x + cos * *y);
                }
                squares[i] -= t * across;
                squares[j] += t * across;
                if squares[i] <= 0.1 * t.abs() * across.abs() || squares[j] <= 0.1 * t.abs() * across.abs() {
                    // The update cancels: take the lengths afresh.
                    squares[i] = dot(&a[i], &a[i]);
                    squares[j] = dot(&a[j], &a[j]);
                }
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
        for x in row {
            *x /= *length;
        }
    }
    lengths
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The smallest singular value of a nearly conservative chain: the exact determinant is the excess of one end, so the
    /// product of the pivots is it, to the last digits, though it is 1e-200 beside entries of 1.
    #[test]
    fn sums_keep_a_tiny_excess() {
        let mut pull = zeros::<4>();
        for i in 0..3 {
            pull[i][i + 1] = 1.0;
            pull[i + 1][i] = 1.0;
        }
        let factor = cholesky_of_sums(pull, [1e-200, 0.0, 0.0, 0.0]).expect("positive");
        let determinant: f64 = (0..4).map(|i| factor[i][i] * factor[i][i]).product();
        assert!((determinant / 1e-200 - 1.0).abs() < 1e-14, "{determinant:e}");
    }

    /// C C^T = a and C C^T x = b; 1e-14 is a few roundings of numbers near 1.
    #[test]
    fn cholesky_solves() {
        let a = [[4.0, 1.0, 0.5], [1.0, 3.0, -0.2], [0.5, -0.2, 2.0]];
        let factor = cholesky(a).expect("positive definite");
        let x = solve(&factor, &[1.0, -2.0, 0.3]);
        for (row, b) in a.iter().zip([1.0, -2.0, 0.3]) {
            assert!((dot(row, &x) - b).abs() < 1e-14);
        }
        assert!(cholesky([[1.0, 2.0], [2.0, 1.0]]).is_none());
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
