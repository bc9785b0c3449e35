//! Defocus: a Gaussian point spread over the pixels, the image mirrored at its edges.

/// A normalised Gaussian of `sigma` pixels, cut where it is below 1e-7 of its peak.
#[derive(Clone, Debug, PartialEq)]
pub struct Blur {
    /// From the centre outwards.
    half: Vec<f64>,
}

impl Blur {
    /// `sigma` = 0 leaves images alone.
    pub fn new(sigma: f64) -> Self {
        let reach = (5.7 * sigma).ceil() as usize;
        let mut half: Vec<f64> = (0..=reach)
            .map(|i| {
                let z = if i == 0 { 0.0 } else { i as f64 / sigma };
                libm::exp(-0.5 * z * z)
            })
            .collect();
        let sum = half[0] + 2.0 * half[1..].iter().sum::<f64>();
        half.iter_mut().for_each(|w| *w /= sum);
        Self { half }
    }

    /// The same weights squared: what independent variances become.
    pub fn of_variances(&self) -> Self {
        Self { half: self.half.iter().map(|w| w * w).collect() }
    }

    /// Spreads a row-major image of `columns` columns.
    pub fn apply(&self, image: &mut [f64], columns: usize) {
        if self.half.len() == 1 {
            let weight = self.half[0] * self.half[0];
            image.iter_mut().for_each(|v| *v *= weight);
            return;
        }
        let rows = image.len() / columns;
        let mut line = Vec::new();
        for row in image.chunks_mut(columns) {
            line.clear();
            line.extend_from_slice(row);
            row.iter_mut().enumerate().for_each(|(i, v)| *v = self.at(&line, i));
        }
        for column in 0..columns {
            line.clear();
            line.extend((0..rows).map(|row| image[row * columns + column]));
            (0..rows).for_each(|row| image[row * columns + column] = self.at(&line, row));
        }
    }

    fn at(&self, line: &[f64], i: usize) -> f64 {
        let period = 2 * line.len();
        // Mirrored between the pixels at the edge: each pixel gives away as much as it gets.
        let read = |k: isize| {
            let k = k.rem_euclid(period as isize) as usize;
            line[k.min(period - 1 - k)]
        };
        let i = i as isize;
        let sides = self.half[1..].iter().zip(1..).map(|(w, d)| w * (read(i - d) + read(i + d)));
        self.half[0] * line[i as usize] + sides.sum::<f64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Light is neither made nor lost, also at edges and in images smaller than the spread; a sinusoid in the middle of a
    /// wide image shrinks by exp(-2 (pi f sigma)^2).
    #[test]
    fn light_is_kept_and_fringes_fade() {
        for (rows, columns, sigma) in [(1, 1, 2.0), (3, 5, 4.0), (40, 30, 1.3)] {
            let mut image: Vec<f64> = (0..rows * columns).map(|i| (1 + i * i % 17) as f64).collect();
            let before: f64 = image.iter().sum();
            Blur::new(sigma).apply(&mut image, columns);
            assert!((image.iter().sum::<f64>() / before - 1.0).abs() < 1e-12);
        }
        let (f, sigma) = (0.07, 1.7);
        let turn = 2.0 * std::f64::consts::PI;
        let mut image: Vec<f64> = (0..400).map(|i| 1.0 + libm::cos(turn * f * (f64::from(i) - 200.0))).collect();
        Blur::new(sigma).apply(&mut image, 400);
        let faded = libm::exp(-2.0 * (std::f64::consts::PI * f * sigma).powi(2));
        // What the cut of the Gaussian leaves out.
        assert!((image[200] - 1.0 - faded).abs() < 1e-6, "{}", image[200]);
        let mut same = vec![1.0, 2.0, 4.0];
        Blur::new(0.0).apply(&mut same, 3);
        assert_eq!(same, [1.0, 2.0, 4.0]);
    }
}
