//! From sums over paths to images: frames, their standard errors, covariances, white light.

use serde_json::{Value, json};
use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{Covariance, Frames, White};
use turbid_contract::{ImageStack, LayerInfo, LayerKind};

use crate::field::{Field, Watched, relative_error_of};
use crate::response::ONE;
use crate::shown::{Shown, Terms};

const RADIANCE: &str = "W mm^-2 sr^-1";

/// The estimates of all channels.
pub struct Images<'a> {
    pub shown: &'a Shown,
    pub rows: usize,
    pub columns: usize,
    /// Empty for one channel without a named wavelength.
    pub wavelengths_nm: &'a [f64],
    pub channels: &'a [Box<dyn Field + 'a>],
    /// Paths per traced pixel.
    pub n: u32,
    /// Where the errors of pixels are common: how many times the variance of an image mean exceeds that of independent pixels.
    pub sharing: Option<f64>,
    /// Wavelengths of channels that share paths, so that their errors are correlated; those that share none are left out.
    pub shared_paths: Vec<Vec<f64>>,
}

impl Images<'_> {
    fn wavelength(&self, channel: usize) -> Option<f64> {
        self.wavelengths_nm.get(channel).copied()
    }

    fn attributes(&self, stack: &mut ImageStack) {
        stack.attributes.insert("samples".to_owned(), json!(self.n));
        if let Some(sharing) = self.sharing {
            stack.attributes.insert("sharing".to_owned(), json!(sharing));
        }
        if !self.shared_paths.is_empty() {
            stack.attributes.insert("shared_paths_nm".to_owned(), json!(self.shared_paths));
        }
    }

    /// Adds `sum of weight x response` as a value layer, and its standard error.
    fn push(&self, stack: &mut ImageStack, mut info: LayerInfo, channel: usize, terms: &[(usize, f64)]) {
        let field = &self.channels[channel];
        let pixels = self.rows * self.columns;
        let mut mean = Vec::with_capacity(pixels);
        let mut se = Vec::with_capacity(pixels);
        let mut total = 0.0;
        for pixel in 0..pixels {
            mean.push(terms.iter().map(|&(i, w)| w * field.mean(pixel, i)).sum::<f64>() as f32);
            let variance = field.variance(pixel, terms);
            total += variance;
            se.push(variance.sqrt() as f32);
        }
        info.mean_se = (!field.mean_se_unknown()).then(|| field.variance_of_mean(terms, total).sqrt());
        let unknown = || (0..pixels).map(|pixel| field.se_unknown(pixel));
        let image = |data| Array2::from_shape_vec((self.rows, self.columns), data).expect("one value per pixel");
        let (se_info, unknown_info) = (info.standard_error(), info.se_unknown());
        stack.push(info, image(mean));
        stack.push(se_info, image(se));
        if unknown().any(|unknown| unknown) {
            stack.push(unknown_info, image(unknown().map(|unknown| f32::from(u8::from(unknown))).collect()));
        }
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
        for (channel, field) in self.channels.iter().enumerate() {
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
                    let cov = field.covariance(pixel, &shown[i].terms, &shown[j].terms);
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

    /// SE(M_AC) / M_AC at the highest f_x and its first orientation (of M_DC where no f_x is > 0) of the lit pixel that has more than
    /// this `part` of the others below it (0.5: the median), the worst of the channels; `None` where no pixel is lit.
    pub fn relative_error_of(&self, part: f64) -> Option<f64> {
        let watched = Watched::of(self.shown);
        let errors = self.channels.iter().filter_map(|field| relative_error_of(field.as_ref(), &watched, part));
        errors.max_by(f64::total_cmp)
    }
}
