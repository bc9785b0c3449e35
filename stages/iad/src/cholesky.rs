//! Factors of symmetric positive definite matrices.

#![allow(clippy::needless_range_loop, reason = "rows and columns of one matrix")]

use crate::matrix::{Matrix, dot, zeros};

/// C with C C^T = a.
pub struct Cholesky<const N: usize> {
    /// Row j is column j of C: zero before entry j.
    pub columns: Matrix<N>,
    /// 1 / C_jj: a substitution waits for each unknown in turn, and a product is ready sooner than a quotient.
    inverse: [f64; N],
}

impl<const N: usize> Cholesky<N> {
    /// `None` if a pivot is not above 0.
    pub fn new(mut a: Matrix<N>) -> Option<Self> {
        let mut inverse = [0.0; N];
        for j in 0..N {
            let pivot = a[j][j];
            if pivot <= 0.0 || pivot.is_nan() {
                return None;
            }
            let scale = 1.0 / pivot.sqrt();
            for i in 0..N {
                a[j][i] = if i < j { 0.0 } else { a[j][i] * scale };
            }
            inverse[j] = scale;
            let row = a[j];
            for i in j + 1..N {
                for k in 0..N {
                    a[i][k] -= row[i] * row[k];
                }
            }
        }
        Some(Self { columns: a, inverse })
    }

    /// x with C C^T x = b.
    pub fn solve(&self, b: &[f64; N]) -> [f64; N] {
        let mut x = self.forward(b);
        self.back(&mut x);
        x
    }

    /// x with C x = b.
    pub fn forward(&self, b: &[f64; N]) -> [f64; N] {
        let mut x = *b;
        for j in 0..N {
            x[j] *= self.inverse[j];
            let done = x[j];
            for i in j + 1..N {
                x[i] -= self.columns[j][i] * done;
            }
        }
        x
    }

    /// x with C^T x = b, in place of b.
    pub fn back(&self, x: &mut [f64; N]) {
        for j in (0..N).rev() {
            // Row j is zero before entry j, where the unknowns still to come stand.
            let b = x[j];
            x[j] = 0.0;
            x[j] = (b - dot(&self.columns[j], x)) * self.inverse[j];
        }
    }
}

/// [`Cholesky::columns`] of the symmetric matrix with the off-diagonal entries `-pull` and the row sums `excess`.
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
        let factor = Cholesky::new(a).expect("positive definite");
        let x = factor.solve(&[1.0, -2.0, 0.3]);
        for (row, b) in a.iter().zip([1.0, -2.0, 0.3]) {
            assert!((dot(row, &x) - b).abs() < 1e-14);
        }
        assert!(Cholesky::new([[1.0, 2.0], [2.0, 1.0]]).is_none());
    }
}
