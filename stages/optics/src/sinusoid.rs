//! The least-squares sinusoid through values at known phases.

/// Smallest pivot of the normal matrix per value, below which the phases do not fix a sinusoid: the noise of the
/// amplitude would be some 1000 times that of a value.
const SMALLEST_PIVOT: f64 = 1e-6;

/// Weights of the values I_n for q = dc, re, im of I_n = dc + re cos(d_n) - im sin(d_n), as `weights[q][n]`: those of dc sum to 1, of re
/// and im to 0. With N equal steps dc is the mean and re + i im = (2/N) sum I_n e^{-i d_n}.
///
/// `None` where the phases do not fix a sinusoid: fewer than three that differ modulo 2 pi.
pub fn weights(phases_rad: &[f64]) -> Option<[Vec<f64>; 3]> {
    let design: Vec<[f64; 3]> = phases_rad.iter().map(|&d| [1.0, libm::cos(d), -libm::sin(d)]).collect();
    let mut normal = [[0.0; 3]; 3];
    for row in &design {
        for i in 0..3 {
            for j in 0..3 {
                normal[i][j] += row[i] * row[j];
            }
        }
    }
    let inverse = invert_spd(&normal, SMALLEST_PIVOT * phases_rad.len() as f64)?;
    Some(inverse.map(|w| design.iter().map(|x| w[0] * x[0] + w[1] * x[1] + w[2] * x[2]).collect()))
}

/// Inverse of a symmetric positive definite 3 x 3 matrix by Gauss-Jordan; `None` if a pivot is not above `least`.
fn invert_spd(matrix: &[[f64; 3]; 3], least: f64) -> Option<[[f64; 3]; 3]> {
    let mut a = *matrix;
    let mut inverse = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    for k in 0..3 {
        let pivot = a[k][k];
        if pivot.is_nan() || pivot <= least {
            return None;
        }
        for j in 0..3 {
            a[k][j] /= pivot;
            inverse[k][j] /= pivot;
        }
        for i in (0..3).filter(|&i| i != k) {
            let factor = a[i][k];
            for j in 0..3 {
                a[i][j] -= factor * a[k][j];
                inverse[i][j] -= factor * inverse[k][j];
            }
        }
    }
    Some(inverse)
}
