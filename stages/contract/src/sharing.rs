//! What the errors of pixels have in common.

use crate::artifact::{ImageStack, Layer, LayerInfo};

/// Attribute of images whose errors are common to pixels: [`ImageStack::common_sharing`].
pub const SHARING: &str = "sharing";
/// Attribute of frames: [`ImageStack::covariance_of_m_dc`].
pub const COVARIANCE_OF_M_DC: &str = "m_dc_covariance";
/// Variances of sums that differ by less than this part differ by the rounding of f32 layers.
const ROUNDING: f64 = 1e-3;

/// How often each pixel counts in the variance of a sum over pixels: 1 where its error is its own, as often as there are pixels with the same error where it is theirs.
///
/// The variance of a sum of x over n pixels is sum of factor x var x, and no more than that of errors which are the same in all, n x sum of var x.
#[derive(Clone, Debug, PartialEq)]
pub struct Sharing {
    /// Of all pixels, where there is none of each.
    even: f64,
    of_pixels: Vec<f32>,
}

impl Sharing {
    /// Errors of pixels are their own.
    pub const NONE: Self = Self::even(1.0);

    /// One factor for all pixels.
    pub const fn even(factor: f64) -> Self {
        Self { even: factor, of_pixels: Vec::new() }
    }

    /// Of each pixel.
    pub const fn of_pixels(factors: Vec<f32>) -> Self {
        Self { even: 1.0, of_pixels: factors }
    }

    /// From the part of the variance of the sum over all pixels that is not their own, `shared`; each has a part of it by its weight. `pixels`: these weights (0 of
    /// those that do not count) and the variances.
    pub fn of_shared(shared: f64, pixels: impl Iterator<Item = [f64; 2]> + Clone) -> Self {
        let whole: f64 = pixels.clone().map(|[weight, _]| weight).sum();
        let factor = |[weight, v]: [f64; 2]| {
            if v > 0.0 && whole > 0.0 { (1.0 + shared * weight / whole / v) as f32 } else { 1.0 }
        };
        Self::of_pixels(pixels.map(factor).collect())
    }

    /// Of a pixel.
    pub fn at(&self, pixel: usize) -> f64 {
        self.of_pixels.get(pixel).map_or(self.even, |&factor| f64::from(factor))
    }

    /// The larger of both at each pixel.
    #[must_use]
    pub fn or(self, other: Self) -> Self {
        if self.of_pixels.is_empty() && other.of_pixels.is_empty() {
            return Self::even(self.even.max(other.even));
        }
        let pixels = self.of_pixels.len().max(other.of_pixels.len());
        Self::of_pixels((0..pixels).map(|i| self.at(i).max(other.at(i)) as f32).collect())
    }

    /// Variance of a sum over pixels that count as `n` whole ones, by the pixels and the variances of their parts of it.
    pub fn variance_of_sum(&self, parts: impl Iterator<Item = (usize, f64)>, n: f64) -> f64 {
        let (alone, shared) = parts.fold((0.0, 0.0), |(alone, shared), (i, v)| (alone + v, shared + self.at(i) * v));
        shared.min(n * alone)
    }

    /// How many times the variance of the sum over the pixels that count exceeds that of independent ones, by their standard errors; 1 where there is none.
    pub fn factor(&self, se: &[f32], counts: impl Fn(usize) -> bool) -> f64 {
        let variances = || {
            let parts = se.iter().enumerate().filter(|&(i, _)| counts(i));
            parts.map(|(i, &se)| (i, f64::from(se) * f64::from(se)))
        };
        let (n, alone) = variances().fold((0.0, 0.0), |(n, sum), (_, v)| (n + 1.0, sum + v));
        if alone > 0.0 { self.variance_of_sum(variances(), n) / alone } else { 1.0 }
    }

    /// Standard error of the mean over the pixels that count, by their standard errors; `None` without pixels.
    pub fn mean_se(&self, se: &[f32], counts: impl Fn(usize) -> bool) -> Option<f64> {
        let parts = || se.iter().enumerate().filter(|&(i, _)| counts(i));
        let n = parts().count() as f64;
        let variances = parts().map(|(i, &se)| (i, f64::from(se) * f64::from(se)));
        (n > 0.0).then(|| self.variance_of_sum(variances, n).sqrt() / n)
    }
}

impl ImageStack {
    /// How errors of the value layer `info` are common to pixels, by the standard error of its mean; where that is not known by the attribute [`SHARING`].
    ///
    /// What pixels have in common is the same part of their values everywhere (the same length or angle, of layers in mm or rad), and the rest of a pixel's variance
    /// its own: a noisy rim beside a fitted surface has no part in what the fit's pixels share.
    pub fn sharing(&self, info: &LayerInfo) -> Sharing {
        let (Some(mean_se), Some(se)) = (info.mean_se, self.standard_error(info)) else {
            return Sharing::even(self.common_sharing());
        };
        let mask = self.mask(info.wavelength_nm).map(Layer::pixels);
        let (se, square) = (se.pixels(), |x: f32| f64::from(x) * f64::from(x));
        let good = |i: usize| mask.as_ref().is_none_or(|m| m[i] == 0.0);
        let all = se.iter().enumerate().filter(|&(i, _)| good(i));
        let (n, alone) = all.fold((0.0, 0.0), |(n, sum), (_, &se)| (n + 1.0, sum + square(se)));
        let together = mean_se * n * mean_se * n;
        if together <= (1.0 + ROUNDING) * alone {
            return Sharing::even(if alone > 0.0 { (together / alone).min(1.0) } else { 1.0 });
        }
        let values =
            self.layers.iter().find(|l| l.info == *info).filter(|_| !["mm", "rad"].contains(&info.unit.as_str()));
        let values = values.map(Layer::pixels).filter(|values| values.iter().any(|&v| v != 0.0));
        let weight = |i: usize| if good(i) { values.as_ref().map_or(1.0, |values| square(values[i])) } else { 0.0 };
        Sharing::of_shared(together - alone, se.iter().enumerate().map(|(i, &se)| [weight(i), square(se)]))
    }

    /// The attribute [`SHARING`]: how many times the variance of the mean of an image exceeds that of independent pixels.
    pub fn common_sharing(&self) -> f64 {
        self.attributes.get(SHARING).and_then(serde_json::Value::as_f64).unwrap_or(1.0)
    }

    /// Of frames, for M_DC of one channel (by its number): the mean covariance of its errors at two pixels, over the square of its mean over the image.
    pub fn covariance_of_m_dc(&self, channel: usize) -> Option<f64> {
        self.attributes.get(COVARIANCE_OF_M_DC)?.get(channel)?.as_f64()
    }
}

#[cfg(test)]
mod tests {
    use ndarray::Array2;

    use super::*;
    use crate::planes::mean_se;

    fn stack(se: &[f32], mean_se: f64) -> (ImageStack, LayerInfo) {
        let mut stack = ImageStack::new(1, se.len());
        let info = LayerInfo { mean_se: Some(mean_se), ..LayerInfo::value("r_d", "1") };
        stack.push(info.clone(), Array2::zeros((1, se.len())));
        stack.push(info.standard_error(), Array2::from_shape_vec((1, se.len()), se.to_vec()).expect("one row"));
        (stack, info)
    }

    /// Independent pixels share nothing; one number seen by all n pixels has the factor n, two of them have no more noise in their mean than one.
    #[test]
    fn common_noise_stays_in_means() {
        let se = [0.5; 4];
        let (independent, info) = stack(&se, mean_se(1.0, 4, 1.0).expect("four pixels"));
        assert_eq!(independent.sharing(&info), Sharing::NONE);
        let (common, info) = stack(&se, 0.5);
        let sharing = common.sharing(&info);
        assert!((0..4).all(|i| (sharing.at(i) - 4.0).abs() < 1e-6));
        assert_eq!(sharing.mean_se(&se, |_| true), Some(0.5));
        assert_eq!(sharing.mean_se(&se, |i| i < 2), Some(0.5));
        assert_eq!(sharing.mean_se(&se, |_| false), None);
    }

    /// Half of an image is one number, the other half noisy pixels of their own: means of either half have the errors of that half. The noisy half is too large by what
    /// the other shares, sqrt(1 + 400^2 x 0.1^2 / 800).
    #[test]
    fn noisy_pixels_do_not_hide_what_others_share() {
        let n = 400_usize;
        let se: Vec<f32> = (0..2 * n).map(|i| if i < n { 0.1 } else { 1.0 }).collect();
        let variance_of_sum = (n as f64 * 0.1).powi(2) + n as f64;
        let (mixed, info) = stack(&se, variance_of_sum.sqrt() / (2 * n) as f64);
        let sharing = mixed.sharing(&info);
        let whole = sharing.mean_se(&se, |_| true).expect("pixels");
        assert!((whole * (2 * n) as f64 / variance_of_sum.sqrt() - 1.0).abs() < 1e-6, "{whole}");
        let fitted = sharing.mean_se(&se, |i| i < n).expect("pixels");
        assert!(fitted > 0.7 * 0.1 && fitted <= 0.1 * (1.0 + 1e-6), "{fitted}");
        let own = sharing.mean_se(&se, |i| i >= n).expect("pixels") * (n as f64).sqrt();
        assert!(own > 1.0 && own < 3.0_f64.sqrt() + 1e-3, "{own}");
    }

    /// What is common is a part of the values: dark pixels share less of it, in lengths they share the same.
    #[test]
    fn common_errors_go_with_the_values() {
        let (mut stack, info) = stack(&[0.5; 4], 0.5);
        stack.layers[0].data = Array2::from_shape_vec((1, 4), vec![1.0, 1.0, 2.0, 0.0]).expect("one row");
        let sharing = stack.sharing(&info);
        assert_eq!([0, 1, 2, 3].map(|i| sharing.at(i)), [3.0, 3.0, 9.0, 1.0]);
        for layer in &mut stack.layers {
            layer.info.unit = "mm".to_owned();
        }
        let sharing = stack.sharing(&LayerInfo { unit: "mm".to_owned(), ..info });
        assert_eq!([0, 1, 2, 3].map(|i| sharing.at(i)), [4.0; 4]);
    }

    /// Of two the larger holds at each pixel.
    #[test]
    fn the_larger_holds() {
        let one = Sharing::of_shared(6.0, [[1.0, 1.0], [1.0, 3.0], [0.0, 0.0]].into_iter());
        let all = one.or(Sharing::even(2.5));
        assert_eq!([0, 1, 2].map(|i| all.at(i)), [4.0, 2.5, 2.5]);
        assert_eq!(Sharing::even(2.0).or(Sharing::NONE), Sharing::even(2.0));
    }
}
