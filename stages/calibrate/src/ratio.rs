//! The ratio of sample to reference, its errors and its mask, for the layers of one wavelength.

use std::borrow::Cow;

use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{MaskReason, Modulation};
use turbid_contract::planes::mean_se;
use turbid_contract::sharing::Sharing;
use turbid_contract::{Ctx, Error, ImageStack, Layer, LayerInfo, LayerKind, Parts};

use crate::gauss::Gauss;
use crate::plane::Room;
use crate::smooth::{Smooth, Smoothing, Values};

/// A reference whose signal is not above this many of its standard errors cannot be divided by.
const LEAST_REFERENCE_SIGNAL: f64 = 5.0;

/// One side of the ratio: the stack and the layers that make R_d at each f_x of one wavelength.
pub struct Arm {
    /// What belongs to the wavelength.
    pub stack: ImageStack,
    /// Places of the layers in it, in the order of the results.
    pub layers: Vec<usize>,
    /// The same in the whole arm, which covariances point to.
    places: Vec<usize>,
    pub wavelength_nm: Option<f64>,
}

impl Arm {
    /// The arm at one wavelength; `places` are those of its layers in the whole.
    ///
    /// Error: it cannot be read.
    pub fn of(arm: &Parts<'_, Modulation>, places: Vec<usize>, wavelength_nm: Option<f64>) -> Result<Self, Error> {
        let held = arm.places(wavelength_nm);
        let at = |place: &usize| held.iter().position(|held| held == place).expect("it is of this wavelength");
        let layers = places.iter().map(at).collect();
        let stack = arm.channel(wavelength_nm)?.0;
        Ok(Self { stack, layers, places, wavelength_nm })
    }

    fn value(&self, k: usize) -> Cow<'_, [f32]> {
        self.stack.layers[self.layers[k]].pixels()
    }

    fn info(&self, k: usize) -> &LayerInfo {
        &self.stack.layers[self.layers[k]].info
    }

    fn se(&self, k: usize) -> Option<Cow<'_, [f32]>> {
        self.stack.standard_error(self.info(k)).map(Layer::pixels)
    }

    /// Covariance of quantities `i` and `j`: what the stack says; none means independent.
    fn covariance(&self, i: usize, j: usize) -> Option<Cow<'_, [f32]>> {
        let (a, b) = (self.places[i] as u32, self.places[j] as u32);
        let wanted = |l: &&Layer| {
            l.info.kind == LayerKind::Covariance && (l.info.pair == Some([a, b]) || l.info.pair == Some([b, a]))
        };
        self.stack.layers.iter().find(wanted).map(Layer::pixels)
    }

    /// 1 where the standard error of quantity `k` is not known; `None` where it is everywhere.
    fn se_unknown(&self, k: usize) -> Option<Cow<'_, [f32]>> {
        self.stack.se_unknown(self.info(k)).map(Layer::pixels).filter(|flags| flags.iter().any(|&f| f != 0.0))
    }

    fn mask(&self) -> Option<Cow<'_, [f32]>> {
        self.stack.mask(self.wavelength_nm).map(Layer::pixels)
    }
}

/// Layers of one wavelength: R_d at each f_x, their standard errors, the covariance of each pair i < j, the mask.
pub struct Calibrated {
    pub r_d: Vec<(LayerInfo, Array2<f32>)>,
    pub se: Vec<Array2<f32>>,
    pub covariances: Vec<([usize; 2], Array2<f32>)>,
    pub mask: Array2<f32>,
    /// Of each f_x where the standard error is a lower bound only; `None` where it is known at all good pixels.
    pub unknown: Vec<Option<Array2<f32>>>,
}

/// The largest share of a smoothed pixel that may come from pixels without a known error while its own counts as known.
const LARGEST_SHARE: f64 = 0.1;

/// R_d = sample / reference x `model`, with `model` the reflectance of the reference at each f_x, and a Gaussian for each arm.
///
/// Errors are known where both arms know theirs; then they hold the noise of both. `corrects` takes off what the noise of
/// the reference adds to the mean of the ratio.
pub fn calibrate(
    arms: [&Arm; 2],
    model: &[f64],
    gauss: [&Gauss; 2],
    corrects: bool,
    room: &Room<'_>,
    ctx: Ctx<'_>,
) -> Result<Calibrated, Error> {
    let sample = arms[0];
    let dim = (sample.stack.rows(), sample.stack.columns());
    let count = sample.layers.len();
    let masks = arms.map(Arm::mask);
    let sharings: [Vec<Sharing>; 2] = arms.map(|arm| (0..count).map(|k| arm.stack.sharing(arm.info(k))).collect());
    let smoothed = |arm: usize| {
        let sharing = sharings[arm].iter().cloned().fold(Sharing::NONE, Sharing::or);
        Smoothing::new(room, gauss[arm], masks[arm].as_deref(), sharing)
    };
    let smoothing = [smoothed(0)?, smoothed(1)?];
    let known = arms.iter().all(|arm| (0..count).all(|k| arm.se(k).is_some()));
    let smooth_all = |arm: usize| -> Result<Vec<Smooth<'_, '_>>, Error> {
        let smooth = |k: usize| smoothing[arm].smooth(arms[arm].value(k), arms[arm].se(k));
        (0..count).map(smooth).collect()
    };
    let smooth = [smooth_all(0)?, smooth_all(1)?];
    let [samples, references] = &smooth;
    let pairs: Vec<[usize; 2]> =
        if known { (0..count).flat_map(|i| (i + 1..count).map(move |j| [i, j])).collect() } else { Vec::new() };
    let covariance =
        |arm: usize, [i, j]: [usize; 2]| arms[arm].covariance(i, j).map(|c| smoothing[arm].covariance(c)).transpose();
    let shared: Result<Vec<[Option<Values<'_, '_>>; 2]>, Error> =
        pairs.iter().map(|&pair| Ok([covariance(0, pair)?, covariance(1, pair)?])).collect();
    let shared = shared?;

    let errors = if known { count } else { 0 };
    let mut planes: Vec<_> = (0..count + errors + pairs.len() + 1).map(|_| Array2::zeros(dim)).collect();
    ctx.fill_planes(&mut planes, |pixels, out| {
        // d R / d M_sample, and R.
        let (mut slope, mut r_d) = (vec![0.0; count], vec![0.0; count]);
        for (o, i) in pixels.enumerate() {
            for k in 0..count {
                let m = references[k].value.at(i);
                slope[k] = model[k] / m;
                if let (true, Some(variance)) = (corrects, &references[k].variance) {
                    // E[1 / M] = (1 + var M / M^2) / E[M] to second order.
                    slope[k] /= 1.0 + variance.at(i) / (m * m);
                }
                r_d[k] = samples[k].value.at(i) * slope[k];
            }
            let carried = masks[0].as_ref().map_or(0.0, |m| m[i]);
            let weak = || smoothing[1].good(i) == 0.0 || references.iter().any(|r| is_weak(r, i));
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
            let slopes = |k: usize| [slope[k], r_d[k] / references[k].value.at(i)];
            for k in 0..count {
                out[k][o] = r_d[k] as f32;
                if known {
                    let variance = |arm: usize| smooth[arm][k].variance.as_ref().map_or(0.0, |v| v.at(i));
                    let [of_sample, of_reference] = slopes(k);
                    let sum = of_sample * of_sample * variance(0) + of_reference * of_reference * variance(1);
                    out[count + k][o] = sum.sqrt() as f32;
                }
            }
            for (p, (&[a, b], shared)) in pairs.iter().zip(&shared).enumerate() {
                let (of_a, of_b) = (slopes(a), slopes(b));
                let part = |arm: usize| shared[arm].as_ref().map_or(0.0, |c| c.at(i) * (of_a[arm] * of_b[arm]));
                out[count + errors + p][o] = (part(0) + part(1)) as f32;
            }
        }
    })?;

    let mask = planes.pop().expect("the mask is the last plane");
    let covariances = pairs.iter().copied().zip(planes.split_off(count + errors)).collect();
    let se = planes.split_off(count);
    let flagged = |arm: usize, k: usize| -> Result<Option<Vec<bool>>, Error> {
        let share = arms[arm].se_unknown(k).filter(|_| known).map(|flags| smoothing[arm].share(flags)).transpose()?;
        Ok(share.map(|share| (0..dim.0 * dim.1).map(|i| share.at(i) > LARGEST_SHARE).collect()))
    };
    let unknown: Result<Vec<Option<Array2<f32>>>, Error> =
        (0..count).map(|k| Ok(flags([flagged(0, k)?, flagged(1, k)?], &mask))).collect();
    let unknown = unknown?;
    let n = mask.iter().filter(|&&m| m == 0.0).count() as u64;
    let mut r_d = Vec::new();
    for (k, data) in planes.into_iter().enumerate() {
        let mut info = LayerInfo::value("r_d", "1");
        info.wavelength_nm = sample.wavelength_nm;
        if known {
            let pixels = data.as_slice().expect("planes are row-major");
            let of_arm = |arm: usize| -> Result<f64, Error> {
                // d mean / d M of each pixel, before smoothing shares it out.
                let value = &smooth[arm][k].value;
                let sensitivity = |i: usize| over(f64::from(pixels[i]), value.at(i));
                let se = arms[arm].se(k).expect("all errors are known");
                smoothing[arm].variance_of_sum(sensitivity, &se, &sharings[arm][k])
            };
            // What an arm does not know of a pixel it may still know of its mean.
            let mean_known = |arm: usize| arms[arm].se_unknown(k).is_none() || arms[arm].info(k).mean_se.is_some();
            if mean_known(0) && mean_known(1) {
                info.mean_se = mean_se(of_arm(0)? + of_arm(1)?, n, 1.0);
            }
        }
        r_d.push((info, data));
    }
    Ok(Calibrated { r_d, se, covariances, mask, unknown })
}

/// 1 at good pixels where either arm is flagged; `None` where there is none.
fn flags(arms: [Option<Vec<bool>>; 2], mask: &Array2<f32>) -> Option<Array2<f32>> {
    let flagged = |i: usize| arms.iter().flatten().any(|flags| flags[i]);
    let mut data = Array2::zeros(mask.dim());
    let good = data.iter_mut().zip(mask).enumerate().filter(|(i, (_, mask))| **mask == 0.0 && flagged(*i));
    let count = good.map(|(_, (flag, _))| *flag = 1.0).count();
    (count > 0).then_some(data)
}

/// r / m, where r is 0 at masked pixels, whatever m.
fn over(r: f64, m: f64) -> f64 {
    if r == 0.0 { 0.0 } else { r / m }
}

fn is_weak(reference: &Smooth<'_, '_>, pixel: usize) -> bool {
    let value = reference.value.at(pixel);
    let se = reference.variance.as_ref().map_or(0.0, |v| v.at(pixel).sqrt());
    value.is_nan() || value <= LEAST_REFERENCE_SIGNAL * se
}
