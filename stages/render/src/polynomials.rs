//! Polynomials that are orthonormal over given points of a line.

/// Orthonormal polynomials p_0 .. p_degree: the sum over the points of p_i p_j is 1 for i = j and 0 elsewhere.
#[derive(Clone, Debug)]
pub struct Polynomials {
    /// Maps the points to about [-1, 1].
    middle: f64,
    scale: f64,
    /// p_0, and (a, b, c) of p_k+1 = (a x - b) p_k - c p_k-1.
    first: f64,
    steps: Vec<(f64, f64, f64)>,
}

impl Polynomials {
    /// At most `degree`, and fewer than there are `points` (ascending, at least one).
    pub fn new(points: &[f64], degree: usize) -> Self {
        let (low, high) = (points[0], points[points.len() - 1]);
        let middle = 0.5 * (low + high);
        let scale = if high > low { 2.0 / (high - low) } else { 1.0 };
        let x: Vec<f64> = points.iter().map(|p| (p - middle) * scale).collect();
        let first = 1.0 / (points.len() as f64).sqrt();
        let mut steps = Vec::new();
        let (mut before, mut now) = (vec![0.0; x.len()], vec![first; x.len()]);
        for _ in 0..degree.min(points.len() - 1) {
            // Stieltjes: orthogonal to the last two, and thereby to all.
            let b: f64 = now.iter().zip(&x).map(|(p, x)| p * p * x).sum();
            let c: f64 = now.iter().zip(&before).zip(&x).map(|((p, q), x)| p * q * x).sum();
            let next: Vec<f64> = (0..x.len()).map(|i| (x[i] - b) * now[i] - c * before[i]).collect();
            let norm = next.iter().map(|p| p * p).sum::<f64>().sqrt();
            steps.push((1.0 / norm, b / norm, c / norm));
            before = now;
            now = next.into_iter().map(|p| p / norm).collect();
        }
        Self { middle, scale, first, steps }
    }

    /// The highest degree.
    pub fn degree(&self) -> usize {
        self.steps.len()
    }

    /// p_0 .. p_degree at a place, which need not be one of the points.
    pub fn at(&self, place: f64) -> Vec<f64> {
        let x = (place - self.middle) * self.scale;
        let mut values = vec![self.first];
        let mut before = 0.0;
        for &(a, b, c) in &self.steps {
            let now = values[values.len() - 1];
            values.push((a * x - b) * now - c * before);
            before = now;
        }
        values
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// On even and uneven points, down to a single one; 1e-12 is rounding, larger where the degree nears the number of points.
    #[test]
    fn they_are_orthonormal_over_the_points() {
        let even: Vec<f64> = (0..64).map(f64::from).collect();
        let uneven = vec![-3.0, 0.0, 0.5, 7.0, 20.0];
        for (points, degree, expected) in [(even, 6, 6), (uneven, 9, 4), (vec![5.0], 3, 0)] {
            let polynomials = Polynomials::new(&points, degree);
            assert_eq!(polynomials.degree(), expected);
            let values: Vec<Vec<f64>> = points.iter().map(|&p| polynomials.at(p)).collect();
            for (i, j) in (0..=expected).flat_map(|i| (0..=expected).map(move |j| (i, j))) {
                let product: f64 = values.iter().map(|v| v[i] * v[j]).sum();
                let unit = if i == j { 1.0 } else { 0.0 };
                assert!((product - unit).abs() < 1e-12, "{i} {j}: {product}");
            }
        }
    }
}
