//! GMRES: a linear system known only through what its matrix does to a vector.

/// Solves `x - apply(x) = b`; `Err` with the relative residual reached if `max_steps` do not suffice.
///
/// `precondition` turns a vector into an approximate solution for it, in place (applied from the right: the residual
/// is the true one). Modified Gram-Schmidt, no restart: memory is one vector per step, convergence is monotone.
pub fn solve_fixed_point(
    b: &[f64],
    mut apply: impl FnMut(&[f64], &mut [f64]),
    precondition: impl Fn(&mut [f64]),
    tolerance: f64,
    max_steps: usize,
) -> Result<Vec<f64>, f64> {
    let n = b.len();
    let norm = dot(b, b).sqrt();
    if norm == 0.0 {
        return Ok(vec![0.0; n]);
    }
    let mut basis: Vec<Vec<f64>> = vec![b.iter().map(|x| x / norm).collect()];
    // Columns of the Hessenberg matrix, already turned to upper triangular; the rotations; the turned right-hand side.
    let mut columns: Vec<Vec<f64>> = Vec::new();
    let mut turns: Vec<(f64, f64)> = Vec::new();
    let mut right = vec![norm];
    for step in 0..max_steps {
        let mut next = vec![0.0; n];
        let mut guess = basis[step].clone();
        precondition(&mut guess);
        apply(&guess, &mut next);
        next.iter_mut().zip(&guess).for_each(|(y, x)| *y = x - *y);
        let mut column = Vec::with_capacity(step + 2);
        for v in &basis {
            let h = dot(v, &next);
            next.iter_mut().zip(v).for_each(|(y, x)| *y -= h * x);
            column.push(h);
        }
        let length = dot(&next, &next).sqrt();
        for (i, &(c, s)) in turns.iter().enumerate() {
            (column[i], column[i + 1]) = (c * column[i] + s * column[i + 1], c * column[i + 1] - s * column[i]);
        }
        let radius = (column[step] * column[step] + length * length).sqrt();
        let (c, s) = (column[step] / radius, length / radius);
        column[step] = radius;
        columns.push(column);
        turns.push((c, s));
        let last = right[step];
        right[step] = c * last;
        right.push(-s * last);
        if right[step + 1].abs() <= tolerance * norm || length <= 1e-15 * radius {
            let mut x = combine(&basis, &columns, &right);
            precondition(&mut x);
            return Ok(x);
        }
        basis.push(next.iter().map(|x| x / length).collect());
    }
    Err(right[max_steps].abs() / norm)
}

fn combine(basis: &[Vec<f64>], columns: &[Vec<f64>], right: &[f64]) -> Vec<f64> {
    let steps = columns.len();
    let mut y = right[..steps].to_vec();
    for i in (0..steps).rev() {
        y[i] /= columns[i][i];
        for j in 0..i {
            y[j] -= columns[i][j] * y[i];
        }
    }
    let mut x = vec![0.0; basis[0].len()];
    for (a, v) in y.iter().zip(basis) {
        x.iter_mut().zip(v).for_each(|(x, v)| *x += a * v);
    }
    x
}

/// Eight partial sums in a fixed order: the same bits at every vector width, and four times faster than one sum.
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut lanes = [0.0; 8];
    let (a_chunks, b_chunks) = (a.chunks_exact(8), b.chunks_exact(8));
    let rest: f64 = a_chunks.remainder().iter().zip(b_chunks.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in a_chunks.zip(b_chunks) {
        for i in 0..8 {
            lanes[i] += a[i] * b[i];
        }
    }
    lanes.iter().sum::<f64>() + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    /// x_i - sum_j a_ij x_j = b_i for a nonsymmetric contraction with a known answer.
    #[test]
    fn solves_a_known_system() {
        let n = 37;
        let a = |i: usize, j: usize| {
            if j == (i + 1) % n {
                0.7
            } else if i == j {
                -0.2
            } else {
                0.001
            }
        };
        let wanted: Vec<f64> = (0..n).map(|i| i as f64 - 7.0).collect();
        let apply = |x: &[f64], y: &mut [f64]| {
            (0..n).for_each(|i| y[i] = (0..n).map(|j| a(i, j) * x[j]).sum());
        };
        let mut ax = vec![0.0; n];
        apply(&wanted, &mut ax);
        let b: Vec<f64> = wanted.iter().zip(&ax).map(|(x, y)| x - y).collect();
        let x = solve_fixed_point(&b, apply, |x| x.iter_mut().for_each(|x| *x *= 1.3), 1e-13, 60).unwrap();
        assert!(x.iter().zip(&wanted).all(|(x, w)| (x - w).abs() < 1e-9), "{x:?}");
        assert!(solve_fixed_point(&b, apply, |_| {}, 1e-13, 2).unwrap_err() > 1e-13);
        assert_eq!(solve_fixed_point(&[0.0; 3], |_, y| y.fill(1.0), |_| {}, 1e-9, 5), Ok(vec![0.0; 3]));
    }
}
