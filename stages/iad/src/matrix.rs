//! Small matrices on fixed arrays: no allocation, no library, the same bits everywhere.

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
