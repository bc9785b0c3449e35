//! One arm of the ratio: M_AC, smoothed where wanted, with its noise, and what a mean over pixels owes to it.

use crate::gauss::{Gauss, Plane};

/// One quantity of an arm at one f_x, smoothed.
pub struct Smooth {
    /// 0 where there is nothing near.
    pub value: Plane,
    /// Variance of `value`; `None` where the noise is not known.
    pub variance: Option<Plane>,
}

/// The smoothing of an arm's planes over its good pixels.
pub struct Smoothing<'a> {
    gauss: &'a Gauss,
    good: &'a Plane,
    sharing: f64,
    /// sum_j w_ij over good pixels.
    weight: Plane,
}

impl<'a> Smoothing<'a> {
    /// `good` is 1 at good pixels and 0 at masked ones. So many pixels as `sharing` are as noisy as one, their errors being common: 1 where
    /// they are independent.
    pub fn new(gauss: &'a Gauss, good: &'a Plane, sharing: f64) -> Self {
        Self { gauss, good, sharing, weight: gauss.sum(good) }
    }

    /// sum_j w_ij x_j over good pixels.
    fn sum(&self, x: &Plane) -> Plane {
        self.gauss.sum(&product(self.good, x))
    }

    /// Smooths a value and its standard error.
    pub fn smooth(&self, value: &Plane, se: Option<&Plane>) -> Smooth {
        let value = quotient(&self.sum(value), &self.weight);
        Smooth { value, variance: se.map(|se| self.covariance(&product(se, se))) }
    }

    /// Smooths the covariance of two quantities of one pixel.
    ///
    /// That of independent pixels falls to sum w^2 / (sum w)^2; it grows by as many of them as share their error.
    pub fn covariance(&self, covariance: &Plane) -> Plane {
        let squares = self.gauss.sum_of_squares(&product(self.good, covariance));
        let weight_squared = product(&self.weight, &self.weight);
        let independent = quotient(&squares, &weight_squared);
        if self.sharing <= 1.0 {
            return independent;
        }
        let pixels = quotient(&weight_squared, &self.gauss.sum_of_squares(self.good));
        zip(&independent, &pixels, |variance, pixels| variance * self.sharing.min(pixels))
    }

    /// The share of what a smoothed pixel is made of that `flags` (0 or 1) marks.
    pub fn share(&self, flags: &Plane) -> Plane {
        quotient(&self.sum(flags), &self.weight)
    }

    /// Variance of sum_i s_i v_i over a smoothed plane v by the arm's own noise: smoothing makes neighbours share it, so their
    /// errors add up instead of averaging out.
    pub fn variance_of_sum(&self, sensitivity: &Plane, se: &Plane) -> f64 {
        let back = self.gauss.sum(&quotient(sensitivity, &self.weight));
        let terms = back.pixels.iter().zip(&se.pixels).zip(&self.good.pixels);
        terms.map(|((back, se), good)| (good * back * se).powi(2)).sum()
    }
}

fn zip(a: &Plane, b: &Plane, f: impl Fn(f64, f64) -> f64) -> Plane {
    Plane { columns: a.columns, pixels: a.pixels.iter().zip(&b.pixels).map(|(&a, &b)| f(a, b)).collect() }
}

fn product(a: &Plane, b: &Plane) -> Plane {
    zip(a, b, |a, b| a * b)
}

/// a / b, and 0 where b is 0: there is nothing near that pixel.
fn quotient(a: &Plane, b: &Plane) -> Plane {
    zip(a, b, |a, b| if b > 0.0 { a / b } else { 0.0 })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plane(columns: usize, pixel: impl Fn(usize) -> f64, n: usize) -> Plane {
        Plane { columns, pixels: (0..n).map(pixel).collect() }
    }

    /// A constant stays constant whatever the holes; a masked pixel, whatever it holds, has no say.
    #[test]
    fn constants_survive_holes() {
        let n = 12 * 9;
        let good = plane(12, |i| if i % 7 == 3 { 0.0 } else { 1.0 }, n);
        let value = plane(12, |i| if i % 7 == 3 { 1e30 } else { 0.3 }, n);
        let gauss = Gauss::new(1.5);
        let smoothing = Smoothing::new(&gauss, &good, 1.0);
        let smooth = smoothing.smooth(&value, None);
        assert!(smooth.value.pixels.iter().all(|v| (v - 0.3).abs() < 1e-14));
    }

    /// Without smoothing a flag is its pixel's; smoothed it is shared out, by weights that add up to 1, and a masked pixel's has no say.
    #[test]
    fn flags_are_shared_out() {
        let n = 12 * 9;
        let good = plane(12, |i| if i == 40 { 0.0 } else { 1.0 }, n);
        let flags = plane(12, |i| if i == 40 || i == 52 { 1.0 } else { 0.0 }, n);
        let plain = Smoothing::new(&Gauss::new(0.0), &good, 1.0).share(&flags);
        assert!((0..n).all(|i| plain.pixels[i] == if i == 52 { 1.0 } else { 0.0 }));
        let gauss = Gauss::new(1.0);
        let smoothing = Smoothing::new(&gauss, &good, 1.0);
        let own = smoothing.share(&flags).pixels[52];
        // 1 / (2 pi sigma^2), and a little more for the hole and the border.
        assert!((own - 0.159).abs() < 0.03, "{own}");
        assert!(smoothing.share(&good).pixels.iter().all(|s| (s - 1.0).abs() < 1e-12));
    }

    /// Far from the border the variance falls to 1 / (4 pi sigma^2) (a Gaussian cut at 4 sigma: to 0.1 %); without
    /// smoothing it stays.
    #[test]
    fn smoothing_averages_noise_as_the_closed_form() {
        let n = 61 * 61;
        let (good, se) = (plane(61, |_| 1.0, n), plane(61, |_| 0.2, n));
        for sigma in [1.0_f64, 3.0] {
            let gauss = Gauss::new(sigma);
            let smoothing = Smoothing::new(&gauss, &good, 1.0);
            let variance = smoothing.smooth(&good, Some(&se)).variance.unwrap().pixels[n / 2];
            let want = 0.04 / (4.0 * std::f64::consts::PI * sigma * sigma);
            assert!((variance / want - 1.0).abs() < 1e-3, "sigma {sigma}: {variance} for {want}");
        }
        let gauss = Gauss::new(0.0);
        let smoothing = Smoothing::new(&gauss, &good, 1.0);
        assert_eq!(smoothing.smooth(&good, Some(&se)).variance.unwrap().pixels[0], 0.2_f64 * 0.2);
    }

    /// An error that all pixels share stays what it is, whatever the smoothing and the border.
    #[test]
    fn smoothing_leaves_common_noise() {
        let n = 12 * 9;
        let (good, se) = (plane(12, |i| if i == 40 { 0.0 } else { 1.0 }, n), plane(12, |_| 0.2, n));
        let gauss = Gauss::new(2.0);
        let smoothing = Smoothing::new(&gauss, &good, n as f64);
        let variance = smoothing.smooth(&good, Some(&se)).variance.unwrap();
        assert!(variance.pixels.iter().all(|v| (v - 0.04).abs() < 1e-15), "{variance:?}");
    }

    /// var sum_i s_i v_i = s^T W V W^T s, against the matrix written out.
    #[test]
    fn the_variance_of_a_sum_is_the_matrix_product() {
        let (columns, n) = (5, 20);
        let good = plane(columns, |i| if i == 7 { 0.0 } else { 1.0 }, n);
        let se = plane(columns, |i| 0.1 + 0.01 * i as f64, n);
        let s = plane(columns, |i| if i == 7 { 0.0 } else { (i as f64).cos() }, n);
        let gauss = Gauss::new(1.2);
        let smoothing = Smoothing::new(&gauss, &good, 1.0);
        let mut want = 0.0;
        for j in 0..n {
            let unit = plane(columns, |i| if i == j { 1.0 } else { 0.0 }, n);
            let response = smoothing.smooth(&unit, None).value;
            let total: f64 = response.pixels.iter().zip(&s.pixels).map(|(r, s)| r * s).sum();
            want += (total * se.pixels[j]).powi(2);
        }
        let got = smoothing.variance_of_sum(&s, &se);
        assert!((got / want - 1.0).abs() < 1e-12, "{got} for {want}");
    }
}
