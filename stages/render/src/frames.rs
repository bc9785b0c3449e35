//! From sums over paths to images: frames, their standard errors, covariances, white light.

use serde_json::{Value, json};
use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{Covariance, Frames, White};
use turbid_contract::sharing::{COVARIANCE_OF_M_DC, SHARING};
use turbid_contract::{ImageStack, LayerInfo, LayerKind};

use crate::field::{Field, Watched, relative_error_of};
use crate::projected::{Projected, Quantity, Terms};
use crate::response::ONE;

const RADIANCE: &str = "W mm^-2 sr^-1";

/// What a layer of the frames says under the light of a channel; `projected`: what is projected.
pub fn frame_layer(projected: &LayerInfo, wavelength_nm: Option<f64>) -> LayerInfo {
    LayerInfo { unit: RADIANCE.to_owned(), wavelength_nm, ..projected.clone() }
}

/// The frame under uniform light.
pub fn white_layer(wavelength_nm: Option<f64>) -> LayerInfo {
    LayerInfo { wavelength_nm, ..LayerInfo::value("radiance", RADIANCE) }
}

/// The covariance of two quantities by their indices among those of all channels.
pub fn covariance_layer(pair: [usize; 2], wavelength_nm: Option<f64>) -> LayerInfo {
    let pair = Some(pair.map(|i| i as u32));
    LayerInfo { pair, wavelength_nm, ..LayerInfo::new("cov", LayerKind::Covariance, "W^2 mm^-4 sr^-2") }
}

/// Pairs i <= j of the quantities of a channel.
pub fn pairs(count: usize) -> impl Iterator<Item = [usize; 2]> {
    (0..count).flat_map(move |i| (i..count).map(move |j| [i, j]))
}

/// The attribute that lists the quantities behind a covariance, channel by channel.
pub fn listed(quantities: &[Quantity], wavelengths_nm: &[Option<f64>]) -> (String, Value) {
    let of = |q: &Quantity, wavelength_nm: &Option<f64>| {
        let mut said = json!({"part": q.part, "f_x_per_mm": q.f_x_per_mm, "orientation_deg": q.orientation_deg});
        if let Some(w) = wavelength_nm {
            said["wavelength_nm"] = json!(w);
        }
        said
    };
    let all = wavelengths_nm.iter().flat_map(|wavelength_nm| quantities.iter().map(move |q| of(q, wavelength_nm)));
    ("quantities".to_owned(), Value::Array(all.collect()))
}

/// The estimates of all channels.
pub struct Images<'a> {
    pub projected: &'a Projected,
    pub rows: usize,
    pub columns: usize,
    /// Empty for one channel without a named wavelength.
    pub wavelengths_nm: &'a [f64],
    pub channels: &'a [Box<dyn Field + 'a>],
    /// Paths per traced pixel.
    pub n: u32,
    /// Where the errors of pixels are common: how many times the variance of an image mean exceeds that of independent pixels.
    pub design_effect: Option<f64>,
    /// Wavelengths of channels that share paths, so that their errors are correlated; those that share none are left out.
    pub shared_paths: Vec<Vec<f64>>,
}

impl Images<'_> {
    fn wavelength(&self, channel: usize) -> Option<f64> {
        self.wavelengths_nm.get(channel).copied()
    }

    fn attributes(&self, stack: &mut ImageStack) {
        stack.attributes.insert("samples".to_owned(), json!(self.n));
        if let Some(design_effect) = self.design_effect {
            stack.attributes.insert(SHARING.to_owned(), json!(design_effect));
        }
        if !self.shared_paths.is_empty() {
            stack.attributes.insert("shared_paths_nm".to_owned(), json!(self.shared_paths));
        }
    }

    /// The mean covariance of M_DC at two pixels, over the square of its mean over the image.
    fn covariance_of_m_dc(&self, field: &dyn Field) -> f64 {
        let (dc, n) = (self.projected.watched().0, field.pixels() as f64);
        let of_pixel = |p: usize| dc.iter().map(|&(i, w)| w * field.mean(p, i)).sum::<f64>();
        let mean = (0..field.pixels()).map(of_pixel).sum::<f64>() / n;
        let total: f64 = (0..field.pixels()).map(|p| field.variance(p, dc)).sum();
        let shared = (field.variance_of_mean(dc, total) - total / (n * n)).max(0.0);
        if mean > 0.0 { shared / (mean * mean) } else { 0.0 }
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
        if self.design_effect.is_some() {
            let shared: Vec<f64> = self.channels.iter().map(|field| self.covariance_of_m_dc(field.as_ref())).collect();
            stack.attributes.insert(COVARIANCE_OF_M_DC.to_owned(), json!(shared));
        }
        for channel in 0..self.channels.len() {
            for (info, terms) in &self.projected.frames {
                let wavelength_nm = self.wavelength(channel);
                self.push(&mut stack, frame_layer(info, wavelength_nm), channel, terms);
            }
        }
        Frames(stack)
    }

    /// Covariances of the quantities behind the frames.
    pub fn covariance(&self) -> Covariance {
        let mut stack = ImageStack::new(self.rows, self.columns);
        self.attributes(&mut stack);
        let projected = &self.projected.quantities;
        for (channel, field) in self.channels.iter().enumerate() {
            let first = channel * projected.len();
            for [i, j] in pairs(projected.len()) {
                let info = covariance_layer([first + i, first + j], self.wavelength(channel));
                let data = Array2::from_shape_fn((self.rows, self.columns), |(row, column)| {
                    let pixel = row * self.columns + column;
                    let cov = field.covariance(pixel, &projected[i].terms, &projected[j].terms);
                    (if i == j { cov.max(0.0) } else { cov }) as f32
                });
                stack.push(info, data);
            }
        }
        let wavelengths_nm: Vec<Option<f64>> = (0..self.channels.len()).map(|c| self.wavelength(c)).collect();
        stack.attributes.extend([listed(projected, &wavelengths_nm)]);
        Covariance(stack)
    }

    /// The response to the pattern 1 and the steady light.
    pub fn white(&self) -> White {
        let mut stack = ImageStack::new(self.rows, self.columns);
        self.attributes(&mut stack);
        for channel in 0..self.channels.len() {
            let info = white_layer(self.wavelength(channel));
            let steady = self.projected.layout.steady().map(|i| (i, 1.0));
            let terms: Terms = [(ONE, 1.0)].into_iter().chain(steady).collect();
            self.push(&mut stack, info, channel, &terms);
        }
        White(stack)
    }

    /// SE(M_AC) / M_AC at the highest f_x and its first orientation (of M_DC where no f_x is > 0) of the lit pixel that has more than
    /// this `part` of the others below it (0.5: the median), the worst of the channels; `None` where no pixel is lit.
    pub fn relative_error_of(&self, part: f64) -> Option<f64> {
        let watched = Watched::of(self.projected);
        let errors = self.channels.iter().filter_map(|field| relative_error_of(field.as_ref(), &watched, part));
        errors.max_by(f64::total_cmp)
    }
}
