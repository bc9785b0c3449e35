//! The ratio of sample to reference, its errors and its mask, for the layers of one wavelength.

use std::borrow::Cow;

use turbid_contract::ndarray::Array2;
use turbid_contract::payload::MaskReason;
use turbid_contract::planes::mean_se;
use turbid_contract::{Ctx, Error, ImageStack, Layer, LayerInfo, LayerKind};

use crate::gauss::{Gauss, Plane};
use crate::reference::{Reference, Smoothing};

/// A reference whose signal is not above this many of its standard errors cannot be divided by.
const LEAST_REFERENCE_SIGNAL: f64 = 5.0;

/// One side of the ratio: the stack and the layers that make R_d at each f_x of one wavelength.
pub struct Arm<'a> {
    pub stack: &'a ImageStack,
    /// Indices of the layers, in the order of the results.
    pub layers: Vec<usize>,
    pub wavelength_nm: Option<f64>,
}

impl<'a> Arm<'a> {
    fn value(&self, k: usize) -> Cow<'a, [f32]> {
        self.stack.layers[self.layers[k]].pixels()
    }

    fn info(&self, k: usize) -> &'a LayerInfo {
        &self.stack.layers[self.layers[k]].info
    }

    fn se(&self, k: usize) -> Option<Cow<'a, [f32]>> {
        self.stack.standard_error(self.info(k)).map(Layer::pixels)
    }

    /// Covariance of quantities `i` and `j`: what the stack says; none means independent.
    fn covariance(&self, i: usize, j: usize) -> Option<Cow<'a, [f32]>> {
        let (a, b) = (self.layers[i] as u32, self.layers[j] as u32);
        let wanted = |l: &&Layer| {
            l.info.kind == LayerKind::Covariance && (l.info.pair == Some([a, b]) || l.info.pair == Some([b, a]))
        };
        self.stack.layers.iter().find(wanted).map(Layer::pixels)
    }

    fn mask(&self) -> Option<Cow<'a, [f32]>> {
        self.stack.mask(self.wavelength_nm).map(Layer::pixels)
    }
}

/// Layers of one wavelength: R_d at each f_x, their standard errors, the covariance of each pair i < j, the mask.
pub struct Calibrated {
    pub r_d: Vec<(LayerInfo, Array2<f32>)>,
    pub se: Vec<Array2<f32>>,
    pub covariances: Vec<([usize; 2], Array2<f32>)>,
    pub mask: Array2<f32>,
}

/// R_d = sample / reference x `model`, with `model` the reflectance of the reference at each f_x.
///
/// Errors are known where both arms know theirs; then they hold the noise of both. `corrects` takes off what the noise of
/// the reference adds to the mean of the ratio.
pub fn calibrate(
    sample: &Arm<'_>,
    reference: &Arm<'_>,
    model: &[f64],
    gauss: &Gauss,
    corrects: bool,
    ctx: Ctx<'_>,
) -> Result<Calibrated, Error> {
    let dim = (sample.stack.rows(), sample.stack.columns());
    let count = sample.layers.len();
    let plane = |pixels: &[f32]| Plane { columns: dim.1, pixels: pixels.iter().map(|&v| f64::from(v)).collect() };
    let reference_mask = reference.mask();
    let good = Plane {
        columns: dim.1,
        pixels: match &reference_mask {
            Some(mask) => mask.iter().map(|&m| if m == 0.0 { 1.0 } else { 0.0 }).collect(),
            None => vec![1.0; dim.0 * dim.1],
        },
    };
    // Rounding of the layers' f32 alone is no sharing.
    let sharing = (0..count).map(|k| reference.stack.sharing(reference.info(k))).fold(1.0, f64::max);
    let smoothing = Smoothing { gauss, good: &good, sharing: if sharing > 1.001 { sharing } else { 1.0 } };
    let (sample_se, reference_se): (Vec<_>, Vec<_>) = (0..count).map(|k| (sample.se(k), reference.se(k))).unzip();
    let known = sample_se.iter().chain(&reference_se).all(Option::is_some);
    let reference_se: Vec<Option<Plane>> = reference_se.iter().map(|se| se.as_ref().map(|se| plane(se))).collect();
    let mut references = Vec::new();
    for (k, se) in reference_se.iter().enumerate() {
        ctx.checked()?;
        references.push(smoothing.reference(&plane(&reference.value(k)), se.as_ref()));
    }
    let pairs: Vec<[usize; 2]> =
        if known { (0..count).flat_map(|i| (i + 1..count).map(move |j| [i, j])).collect() } else { Vec::new() };
    let shared: Vec<_> = pairs
        .iter()
        .map(|&[i, j]| {
            let smooth = |c: Cow<'_, [f32]>| smoothing.smoothed_covariance(&plane(&c)).pixels;
            (sample.covariance(i, j), reference.covariance(i, j).map(smooth))
        })
        .collect();

    let values: Vec<_> = (0..count).map(|k| sample.value(k)).collect();
    let sample_mask = sample.mask();
    let errors = if known { count } else { 0 };
    let mut planes = vec![Array2::zeros(dim); count + errors + pairs.len() + 1];
    ctx.fill_planes(&mut planes, |pixels, out| {
        let mut r_d = vec![0.0; count];
        for (o, i) in pixels.enumerate() {
            for (k, r_d) in r_d.iter_mut().enumerate() {
                *r_d = f64::from(values[k][i]) / references[k].value.pixels[i] * model[k];
                if let (true, Some(variance)) = (corrects, &references[k].variance) {
                    // E[1 / M] = (1 + var M / M^2) / E[M] to second order.
                    let m = references[k].value.pixels[i];
                    *r_d /= 1.0 + variance.pixels[i] / (m * m);
                }
            }
            let carried = sample_mask.as_ref().map_or(0.0, |m| m[i]);
            let weak = || good.pixels[i] == 0.0 || references.iter().any(|r| is_weak(r, i));
            let code = if carried != 0.0 {
                carried
            } else if weak() {
                MaskReason::LowReference.code()
            } else if r_d.iter().any(|r| !r.is_finite()) {
                MaskReason::NotFinite.code()
            } else {
                MaskReason::Good.code()
            };
            out[count + errors + pairs.len()][o] = code;
            if code != 0.0 {
                continue;
            }
            let ratio = |k: usize| r_d[k] / f64::from(values[k][i]);
            for k in 0..count {
                out[k][o] = r_d[k] as f32;
                if let (Some(se), Some(variance)) = (&sample_se[k], &references[k].variance) {
                    // dR = R (dM_s / M_s - dM_r / M_r), written without a division by M_s, which may be small.
                    let of_sample = ratio(k) * f64::from(se[i]);
                    let of_reference = r_d[k] / references[k].value.pixels[i];
                    let sum = of_sample * of_sample + of_reference * of_reference * variance.pixels[i];
                    if known {
                        out[count + k][o] = sum.sqrt() as f32;
                    }
                }
            }
            for (p, (&[a, b], (of_sample, of_reference))) in pairs.iter().zip(&shared).enumerate() {
                let of_sample = of_sample.as_ref().map_or(0.0, |c| f64::from(c[i]) * ratio(a) * ratio(b));
                let scale = r_d[a] / references[a].value.pixels[i] * r_d[b] / references[b].value.pixels[i];
                let of_reference = of_reference.as_ref().map_or(0.0, |c| c[i] * scale);
                out[count + errors + p][o] = (of_sample + of_reference) as f32;
            }
        }
    })?;

    let mask = planes.pop().expect("the mask is the last plane");
    let covariances = pairs.iter().copied().zip(planes.split_off(count + errors)).collect();
    let se = planes.split_off(count);
    let mut r_d = Vec::new();
    for (k, data) in planes.into_iter().enumerate() {
        let mut info = LayerInfo::value("r_d", "1");
        info.wavelength_nm = sample.wavelength_nm;
        if let (true, Some(se), Some(reference_se)) = (known, &sample_se[k], &reference_se[k]) {
            // d mean / d M_reference of each pixel, before smoothing shares it out.
            let sensitivity = Plane {
                columns: dim.1,
                pixels: data.iter().zip(&references[k].value.pixels).map(|(&r, m)| over(f64::from(r), *m)).collect(),
            };
            let n = mask.iter().filter(|&&m| m == 0.0).count() as u64;
            let terms = data.iter().zip(values[k].iter()).zip(se.iter());
            let of_sample: f64 =
                terms.map(|((&r, &m), &se)| over(f64::from(r), f64::from(m)) * f64::from(se)).map(|t| t * t).sum();
            let of_reference = smoothing.variance_of_sum(&references[k], &sensitivity, reference_se);
            let sum = of_sample * sample.stack.sharing(sample.info(k))
                + of_reference * reference.stack.sharing(reference.info(k));
            info.mean_se = mean_se(sum, n, 1.0);
        }
        r_d.push((info, data));
    }
    Ok(Calibrated { r_d, se, covariances, mask })
}

/// r / m, where r is 0 at masked pixels, whatever m.
fn over(r: f64, m: f64) -> f64 {
    if r == 0.0 { 0.0 } else { r / m }
}

fn is_weak(reference: &Reference, pixel: usize) -> bool {
    let value = reference.value.pixels[pixel];
    let se = reference.variance.as_ref().map_or(0.0, |v| v.pixels[pixel].sqrt());
    value.is_nan() || value <= LEAST_REFERENCE_SIGNAL * se
}
