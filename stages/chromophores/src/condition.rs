//! How well wavelengths tell chromophores apart: condition number of their spectra, each of length 1.

/// Largest over smallest singular value of the matrix of columns that are scaled to length 1; infinite where they are dependent.
///
/// 1: each has wavelengths of its own; c: noise of mu_a grows by up to c on its way to a concentration. By Jacobi rotations of the columns themselves,
/// which keep the small singular values (Hestenes, J. SIAM 6, 51 (1958)).
pub fn condition_number(columns: &[Vec<f64>]) -> f64 {
    let mut columns: Vec<Vec<f64>> = columns.iter().map(|column| unit(column)).collect();
    let count = columns.len();
    // Converges quadratically: 5 to 8 sweeps for such sizes.
    for _ in 0..30 {
        let mut turned = false;
        for i in 0..count {
            for k in i + 1..count {
                let [a, b, c] = [(i, i), (k, k), (i, k)].map(|(i, k)| dot(&columns[i], &columns[k]));
                if c.abs() <= 1e-15 * (a * b).sqrt() {
                    continue;
                }
                turned = true;
                let zeta = (b - a) / (2.0 * c);
                let tangent = 1.0_f64.copysign(zeta) / (zeta.abs() + (1.0 + zeta * zeta).sqrt());
                let cosine = 1.0 / (1.0 + tangent * tangent).sqrt();
                let sine = cosine * tangent;
                let (low, high) = columns.split_at_mut(k);
                for (x, y) in low[i].iter_mut().zip(&mut high[0]) {
                    (*x, *y) = (cosine * *x - sine * *y, sine * *x + cosine * *y);
                }
            }
        }
        if !turned {
            break;
        }
    }
    let lengths = columns.iter().map(|column| dot(column, column).sqrt());
    let (least, most) = lengths.fold((f64::INFINITY, 0.0), |(least, most), v| (v.min(least), v.max(most)));
    // What is left of two equal columns is rounding.
    if least <= 1e-14 * most { f64::INFINITY } else { most / least }
}

/// The two columns that are most alike, and the cosine of the angle between them; `None` of fewer than two.
pub fn most_alike(columns: &[Vec<f64>]) -> Option<(usize, usize, f64)> {
    let columns: Vec<Vec<f64>> = columns.iter().map(|column| unit(column)).collect();
    let pairs = (0..columns.len()).flat_map(|i| (i + 1..columns.len()).map(move |k| (i, k)));
    pairs.map(|(i, k)| (i, k, dot(&columns[i], &columns[k]))).max_by(|a, b| a.2.total_cmp(&b.2))
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn unit(column: &[f64]) -> Vec<f64> {
    let norm = dot(column, column).sqrt();
    column.iter().map(|v| if norm > 0.0 { v / norm } else { 0.0 }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two unit columns at the angle t have the singular values sqrt(1 +- cos t), whatever their lengths.
    #[test]
    fn two_columns_have_a_closed_form() {
        for t in [0.1, 0.7, 1.5, 1e-5] {
            let columns = [vec![3.0, 0.0, 0.0], vec![1e-6 * libm::cos(t), 1e-6 * libm::sin(t), 0.0]];
            let exact = libm::cos(t / 2.0) / libm::sin(t / 2.0);
            let is = condition_number(&columns);
            assert!((is / exact - 1.0).abs() < 1e-9, "{t}: {is} {exact}");
            let (i, k, cosine) = most_alike(&columns).expect("there are two");
            assert!((i, k) == (0, 1) && (cosine - libm::cos(t)).abs() < 1e-15);
        }
        assert_eq!(condition_number(&[vec![1.0, 0.0], vec![0.0, 5.0]]), 1.0);
        assert_eq!(condition_number(&[vec![1.0, 2.0], vec![2.0, 4.0]]), f64::INFINITY);
        assert_eq!(condition_number(&[vec![1.0, 0.0], vec![0.0, 0.0]]), f64::INFINITY);
    }
}
