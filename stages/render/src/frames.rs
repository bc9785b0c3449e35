//! From sums over paths to images: frames, their standard errors, covariances, white light.

use serde_json::{Value, json};
use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{Covariance, Frames, White};
use turbid_contract::{ImageStack, LayerInfo, LayerKind};

use crate::moments::Moments;
use crate::response::ONE;
use crate::shown::{Shown, Terms};

const RADIANCE: &str = "W mm^-2 sr^-1";

/// The sums of all channels, after `n` paths per pixel.
pub struct Images<'a> {
    pub shown: &'a Shown,
    pub rows: usize,
    pub columns: usize,
    /// Empty for one channel without a named wavelength.
    pub wavelengths_nm: &'a [f64],
    pub channels: &'a [Moments],
    pub n: u32,
}

impl Images<'_> {
    fn wavelength(&self, channel: usize) -> Option<f64> {
        self.wavelengths_nm.get(channel).copied()
    }

    fn attributes(&self, stack: &mut ImageStack) {
        stack.attributes.insert("samples".to_owned(), json!(self.n));
    }

    /// Adds `sum of weight x response` as a value layer, and its standard error.
    fn push(&self, stack: &mut ImageStack, mut info: LayerInfo, channel: usize, terms: &[(usize, f64)]) {
        let moments = &self.channels[channel];
        let pixels = self.rows * self.columns;
        let mut mean = Vec::with_capacity(pixels);
        let mut se = Vec::with_capacity(pixels);
        let mut total_variance = 0.0;
        for pixel in 0..pixels {
            mean.push(terms.iter().map(|&(i, w)| w * moments.mean(pixel, i, self.n)).sum::<f64>() as f32);
            // Rounding may leave a sum of squares just below zero.
            let variance = self.covariance_of(channel, pixel, terms, terms).max(0.0);
            total_variance += variance;
            se.push(variance.sqrt() as f32);
        }
        // Pixels have paths of their own, so their errors are independent.
        info.mean_se = Some(total_variance.sqrt() / pixels as f64);
        let image = |data| Array2::from_shape_vec((self.rows, self.columns), data).expect("one value per pixel");
        let se_info = info.standard_error();
        stack.push(info, image(mean));
        stack.push(se_info, image(se));
    }

    /// Covariance of two sums of weight x mean response.
    fn covariance_of(&self, channel: usize, pixel: usize, a: &[(usize, f64)], b: &[(usize, f64)]) -> f64 {
        let moments = &self.channels[channel];
        let pairs = a.iter().flat_map(|a| b.iter().map(move |b| (a, b)));
        pairs.map(|(&(i, wi), &(j, wj))| wi * wj * moments.covariance(pixel, i, j, self.n)).sum()
    }

    /// A frame for every layer of what is shown.
    pub fn frames(&self) -> Frames {
        let mut stack = ImageStack::new(self.rows, self.columns);
        self.attributes(&mut stack);
        for channel in 0..self.channels.len() {
            for (info, terms) in &self.shown.frames {
                let wavelength_nm = self.wavelength(channel);
                let info = LayerInfo { unit: RADIANCE.to_owned(), wavelength_nm, ..info.clone() };
                self.push(&mut stack, info, channel, terms);
            }
        }
        Frames(stack)
    }

    /// Covariances of the quantities behind the frames.
    pub fn covariance(&self) -> Covariance {
        let mut stack = ImageStack::new(self.rows, self.columns);
        self.attributes(&mut stack);
        let shown = &self.shown.quantities;
        let mut quantities = Vec::new();
        for channel in 0..self.channels.len() {
            let first = quantities.len();
            quantities.extend(shown.iter().map(|q| {
                let mut said =
                    json!({"part": q.part, "f_x_per_mm": q.f_x_per_mm, "orientation_deg": q.orientation_deg});
                if let Some(w) = self.wavelength(channel) {
                    said["wavelength_nm"] = json!(w);
                }
                said
            }));
            for (i, j) in (0..shown.len()).flat_map(|i| (i..shown.len()).map(move |j| (i, j))) {
                let mut info = LayerInfo::new("cov", LayerKind::Covariance, "W^2 mm^-4 sr^-2");
                info.pair = Some([(first + i) as u32, (first + j) as u32]);
                info.wavelength_nm = self.wavelength(channel);
                let data = Array2::from_shape_fn((self.rows, self.columns), |(row, column)| {
                    let pixel = row * self.columns + column;
                    let cov = self.covariance_of(channel, pixel, &shown[i].terms, &shown[j].terms);
                    (if i == j { cov.max(0.0) } else { cov }) as f32
                });
                stack.push(info, data);
            }
        }
        stack.attributes.insert("quantities".to_owned(), Value::Array(quantities));
        Covariance(stack)
    }

    /// The response to the pattern 1 and the steady light.
    pub fn white(&self) -> White {
        let mut stack = ImageStack::new(self.rows, self.columns);
        self.attributes(&mut stack);
        for channel in 0..self.channels.len() {
            let mut info = LayerInfo::value("radiance", RADIANCE);
            info.wavelength_nm = self.wavelength(channel);
            let steady = self.shown.layout.steady().map(|i| (i, 1.0));
            let terms: Terms = [(ONE, 1.0)].into_iter().chain(steady).collect();
            self.push(&mut stack, info, channel, &terms);
        }
        White(stack)
    }

    /// Median over the lit pixels of SE(M_AC) / M_AC at the highest f_x and its first orientation (of M_DC where no f_x is
    /// > 0), the worst of the channels; `None` where no pixel is lit.
    pub fn relative_error(&self) -> Option<f64> {
        let (dc, fringe) = self.shown.watched();
        let of_channel = |(channel, moments): (usize, &Moments)| {
            let mean = |pixel: usize, terms: &Terms| -> f64 {
                terms.iter().map(|&(i, w)| w * moments.mean(pixel, i, self.n)).sum()
            };
            let mut errors: Vec<f64> = (0..self.rows * self.columns)
                .filter_map(|pixel| {
                    let cov = |a: &Terms, b: &Terms| self.covariance_of(channel, pixel, a, b);
                    let Some([re, im]) = fringe else {
                        let dc_mean = mean(pixel, dc);
                        return (dc_mean > 0.0).then(|| cov(dc, dc).max(0.0).sqrt() / dc_mean);
                    };
                    let (x, y) = (mean(pixel, re), mean(pixel, im));
                    let m2 = x * x + y * y;
                    // Variance along the phase of the mean.
                    let along = (x * x * cov(re, re) + 2.0 * x * y * cov(re, im) + y * y * cov(im, im)) / m2;
                    (m2 > 0.0).then(|| (along.max(0.0) / m2).sqrt())
                })
                .collect();
            if errors.is_empty() {
                return None;
            }
            let middle = errors.len() / 2;
            Some(*errors.select_nth_unstable_by(middle, f64::total_cmp).1)
        };
        self.channels.iter().enumerate().filter_map(of_channel).max_by(f64::total_cmp)
    }
}
