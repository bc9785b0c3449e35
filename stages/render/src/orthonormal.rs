//! Functions made orthonormal over weighted points, one after the other.

/// A function of which less than this part (of its square) is not in those before it is taken for one of them.
const DEPENDENT: f64 = 1e-9;

/// phi = L^-1 b with sum over the points of w b b^T = L L^T (Cholesky): phi_k is a sum of b_0 .. b_k, so the first ones are the same however many follow.
pub struct Orthonormal {
    /// L^-1, column after column from its diagonal down, so that all phi of a place are summed side by side; rows of zeros for functions that depend on those before.
    columns: Vec<Vec<f64>>,
}

impl Orthonormal {
    /// Of the sums w b_k b_l, `[k][l]`.
    pub fn of(gram: &[f64], count: usize) -> Self {
        let mut rows: Vec<Vec<f64>> = Vec::with_capacity(count);
        for k in 0..count {
            // b_k less its parts along the phi before it.
            let mut row = vec![0.0; k + 1];
            row[k] = 1.0;
            for before in &rows {
                let along: f64 = before.iter().enumerate().map(|(l, w)| w * gram[l * count + k]).sum();
                row.iter_mut().zip(before).for_each(|(r, w)| *r -= along * w);
            }
            let dot = |l: usize| row.iter().enumerate().map(|(m, w)| w * gram[l * count + m]).sum::<f64>();
            let square: f64 = row.iter().enumerate().map(|(l, w)| w * dot(l)).sum();
            if square > DEPENDENT * gram[k * count + k] {
                let scale = 1.0 / square.sqrt();
                row.iter_mut().for_each(|w| *w *= scale);
            } else {
                row.fill(0.0);
            }
            rows.push(row);
        }
        Self { columns: (0..count).map(|l| rows[l..].iter().map(|row| row[l]).collect()).collect() }
    }

    /// phi of the first `b`s at a place: as many as there are.
    pub fn at(&self, b: &[f64], into: &mut Vec<f64>) {
        into.clear();
        into.resize(b.len(), 0.0);
        for (l, (column, b)) in self.columns.iter().zip(b).enumerate() {
            into[l..].iter_mut().zip(column).for_each(|(phi, w)| *phi += w * b);
        }
    }

    /// Coefficients of the functions b whose sum is that of the first phi by these.
    pub fn back(&self, coefficients: &[f64]) -> Vec<f64> {
        let of = |(l, column): (usize, &Vec<f64>)| coefficients[l..].iter().zip(column).map(|(c, w)| c * w).sum();
        self.columns[..coefficients.len()].iter().enumerate().map(of).collect()
    }

    /// Whether function k says something that those before it do not.
    pub fn is_new(&self, k: usize) -> bool {
        self.columns[k][0] != 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 1, x, 2 + 3 x, x^2 over weighted points: orthonormal but for the third, which depends on the first two; 1e-12 is rounding.
    #[test]
    fn they_are_orthonormal_over_the_points() {
        let points: Vec<(f64, f64)> = (0..20).map(|i| (0.1 * f64::from(i), 1.0 + f64::from(i % 3))).collect();
        let b = |x: f64| [1.0, x, 2.0 + 3.0 * x, x * x];
        let mut gram = [0.0; 16];
        for &(x, w) in &points {
            (0..16).for_each(|kl| gram[kl] += w * b(x)[kl / 4] * b(x)[kl % 4]);
        }
        let phi = Orthonormal::of(&gram, 4);
        assert_eq!([0, 1, 2, 3].map(|k| phi.is_new(k)), [true, true, false, true]);
        for (k, l) in (0..4).flat_map(|k| (0..4).map(move |l| (k, l))) {
            let mut values = Vec::new();
            let product = points.iter().map(|&(x, w)| {
                phi.at(&b(x), &mut values);
                w * values[k] * values[l]
            });
            let product: f64 = product.sum();
            let expected = if k == l && k != 2 { 1.0 } else { 0.0 };
            assert!((product - expected).abs() < 1e-12, "{k} {l}: {product}");
        }
        let (coefficients, mut values) = ([0.3, -1.2, 0.0, 2.0], Vec::new());
        phi.at(&b(0.7), &mut values);
        let by_phi: f64 = values.iter().zip(coefficients).map(|(phi, c)| phi * c).sum();
        let by_b: f64 = phi.back(&coefficients).iter().zip(b(0.7)).map(|(c, b)| c * b).sum();
        assert!((by_phi - by_b).abs() < 1e-12, "{by_phi} {by_b}");
    }
}
