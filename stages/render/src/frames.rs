//! From sums over paths to images: frames, their standard errors, covariances, white light.

use std::f64::consts::TAU;

use serde_json::{Value, json};
use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{Covariance, Frames, White};
use turbid_contract::{ImageStack, LayerInfo, LayerKind};
use turbid_optics::elementary::sin_cos_turns;

use crate::light::Carrier;
use crate::moments::Moments;
use crate::params::Params;
use crate::response::{Layout, ONE};

const RADIANCE: &str = "W mm^-2 sr^-1";

/// The sums of all channels, after `n` paths per pixel.
pub struct Images<'a> {
    pub params: &'a Params,
    pub rows: usize,
    pub columns: usize,
    /// Empty for one channel without a named wavelength.
    pub wavelengths_nm: &'a [f64],
    pub layout: Layout,
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

    /// What steady light adds to every frame.
    fn steady(&self) -> impl Iterator<Item = (usize, f64)> {
        self.layout.steady().map(|i| (i, 1.0)).into_iter()
    }

    /// M_DC = L(1)/2 and the steady light.
    fn dc(&self) -> Vec<(usize, f64)> {
        [(ONE, 0.5)].into_iter().chain(self.steady()).collect()
    }

    /// Covariance of two sums of weight x mean response.
    fn covariance_of(&self, channel: usize, pixel: usize, a: &[(usize, f64)], b: &[(usize, f64)]) -> f64 {
        let moments = &self.channels[channel];
        let pairs = a.iter().flat_map(|a| b.iter().map(move |b| (a, b)));
        pairs.map(|(&(i, wi), &(j, wj))| wi * wj * moments.covariance(pixel, i, j, self.n)).sum()
    }

    /// Frame = L(1)/2 + Re(e^{i phase} L(e^{i 2 pi f_x u}))/2 and the steady light, so of the responses (1, re, im, steady) the
    /// weights (1/2, cos(phase)/2, -sin(phase)/2, 1).
    pub fn frames(&self) -> Frames {
        let mut stack = ImageStack::new(self.rows, self.columns);
        self.attributes(&mut stack);
        for channel in 0..self.channels.len() {
            let mut carrier = 0;
            for f in &self.params.f_x {
                let mut info = LayerInfo::value("radiance", RADIANCE).with_f_x(f.0);
                info.wavelength_nm = self.wavelength(channel);
                if f.0 == 0.0 {
                    info.phase_rad = Some(0.0);
                    self.push(&mut stack, info, channel, &self.dc());
                    continue;
                }
                for o in &self.params.orientation_deg {
                    info.orientation_deg = Some(o.0);
                    for k in 0..self.params.phases {
                        let turns = f64::from(k) / f64::from(self.params.phases);
                        info.phase_rad = Some(TAU * turns);
                        let (sin, cos) = sin_cos_turns(turns);
                        let re = self.layout.re(carrier);
                        let mut terms = vec![(ONE, 0.5), (re, 0.5 * cos), (re + 1, -0.5 * sin)];
                        terms.extend(self.steady());
                        self.push(&mut stack, info.clone(), channel, &terms);
                    }
                    carrier += 1;
                }
            }
        }
        Frames(stack)
    }

    /// Covariances of M_DC and of re, im of every carrier.
    pub fn covariance(&self) -> Covariance {
        let carriers = self.params.carriers();
        let mut stack = ImageStack::new(self.rows, self.columns);
        self.attributes(&mut stack);
        let mut quantities = Vec::new();
        let (re, im) = (|i| vec![(self.layout.re(i), 0.5)], |i| vec![(self.layout.re(i) + 1, 0.5)]);
        let terms: Vec<Vec<(usize, f64)>> =
            [self.dc()].into_iter().chain((0..carriers.len()).flat_map(|i| [re(i), im(i)])).collect();
        for channel in 0..self.channels.len() {
            let first = quantities.len();
            let quantity = |part: &str, carrier: Option<&Carrier>| -> Value {
                let mut q = json!({"part": part, "f_x_per_mm": carrier.map_or(0.0, Carrier::f_x)});
                q["orientation_deg"] = json!(carrier.map_or(0.0, Carrier::orientation_deg));
                if let Some(w) = self.wavelength(channel) {
                    q["wavelength_nm"] = json!(w);
                }
                q
            };
            quantities.push(quantity("dc", None));
            for carrier in &carriers {
                quantities.extend(["re", "im"].map(|part| quantity(part, Some(carrier))));
            }
            let q = quantities.len() - first;
            for (i, j) in (0..q).flat_map(|i| (i..q).map(move |j| (i, j))) {
                let mut info = LayerInfo::new("cov", LayerKind::Covariance, "W^2 mm^-4 sr^-2");
                info.pair = Some([(first + i) as u32, (first + j) as u32]);
                info.wavelength_nm = self.wavelength(channel);
                let data = Array2::from_shape_fn((self.rows, self.columns), |(row, column)| {
                    let cov = self.covariance_of(channel, row * self.columns + column, &terms[i], &terms[j]);
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
            let terms: Vec<_> = [(ONE, 1.0)].into_iter().chain(self.steady()).collect();
            self.push(&mut stack, info, channel, &terms);
        }
        White(stack)
    }

    /// Median over the lit pixels of SE(M_AC) / M_AC at the highest f_x and its first orientation (of M_DC where no f_x is
    /// > 0), the worst of the channels; `None` where no pixel is lit.
    pub fn relative_error(&self) -> Option<f64> {
        let carriers = self.params.carriers();
        let highest = carriers.iter().map(Carrier::f_x).fold(0.0, f64::max);
        let carrier = carriers.iter().position(|c| c.f_x() == highest);
        let dc = self.dc();
        let of_channel = |(channel, moments): (usize, &Moments)| {
            let mut errors: Vec<f64> = (0..self.rows * self.columns)
                .filter_map(|pixel| {
                    let cov = |i, j| moments.covariance(pixel, i, j, self.n);
                    let Some(carrier) = carrier else {
                        let mean: f64 = dc.iter().map(|&(i, w)| w * moments.mean(pixel, i, self.n)).sum();
                        let variance = self.covariance_of(channel, pixel, &dc, &dc).max(0.0);
                        return (mean > 0.0).then(|| variance.sqrt() / mean);
                    };
                    let (re, im) = (self.layout.re(carrier), self.layout.re(carrier) + 1);
                    let (x, y) = (moments.mean(pixel, re, self.n), moments.mean(pixel, im, self.n));
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
