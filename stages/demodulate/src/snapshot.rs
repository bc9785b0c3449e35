//! The method `single_shot`: one frame of each f_x in; M_DC, M_AC and phase of every line out, as if phases had been stepped.

use std::borrow::Cow;

use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{Frames, MaskReason, Scene};
use turbid_contract::planes::mean_se;
use turbid_contract::{Ctx, Error, ImageStack, Layer, LayerInfo, LayerKind, Length};
use turbid_optics::elementary::atan2;

use crate::fourier::product;
use crate::layers::OfShot;
use crate::local_fit::{LocalFit, Weights};
use crate::masked::measure_masked;
use crate::params::{Filter, Params};
use crate::pass::of;
use crate::single_shot::{Filter as FilterKind, noise_gain, part};
use crate::unknown;

/// Width of the window, four standard deviations, where none is given: on 78 measured shots of phantoms, hands, feet and organs two periods
/// read every group better than 1.4.
const WINDOW_PERIODS: f64 = 2.0;

/// Modulation, and the phase if wanted.
pub fn run(
    params: &Params,
    frames: &Frames,
    scene: Option<&Scene>,
    ctx: Ctx<'_>,
) -> Result<(ImageStack, Option<ImageStack>), Error> {
    let stack = &frames.0;
    let infos: Vec<&LayerInfo> = stack.layers.iter().map(|layer| &layer.info).collect();
    let shots = shots(&infos)?.into_iter().map(|k| &stack.layers[k]);
    let mut modulation = ImageStack::new(stack.rows(), stack.columns());
    modulation.attributes = stack.attributes.clone();
    let mut phases = ImageStack::new(stack.rows(), stack.columns());
    phases.attributes = stack.attributes.clone();
    let mut seen: Vec<Option<f64>> = Vec::new();
    let mut reaches: Vec<(&LayerInfo, [usize; 2])> = Vec::new();
    for shot in shots {
        let pixel = pixel_size(params, scene)?;
        let carrier = carrier(pixel, &shot.info, [stack.rows(), stack.columns()])?;
        let first = !seen.contains(&shot.info.wavelength_nm);
        seen.push(shot.info.wavelength_nm);
        reaches.push((&shot.info, reach(params, carrier, pixel)));
        let phase = one(params, shot, stack, (carrier, pixel), first, &mut modulation)?;
        phases.layers.extend(phase);
        ctx.checked()?;
    }
    order(&mut modulation);
    order(&mut phases);
    // M_DC at f_x = 0 is that of the first shot.
    let flags = |info: &LayerInfo| {
        let own = |shot: &LayerInfo| {
            shot.wavelength_nm == info.wavelength_nm && (info.f_x_per_mm == Some(0.0) || same_fringe(shot, info))
        };
        let (shot, reach) = reaches.iter().find(|(shot, _)| own(shot))?;
        Some(unknown::of_windows(&unknown::of_layers(stack, [*shot])?, stack.columns(), *reach))
    };
    unknown::pass_on(&mut modulation, flags);
    unknown::pass_on(&mut phases, flags);
    for mask in modulation.layers.iter().filter(|l| l.info.is_pixel_mask() && l.data.iter().all(|&m| m != 0.0)) {
        let reasons = ctx.measure_masked(mask.data.iter().copied());
        ctx.warn(format!("all pixels{} are masked: {reasons}", of(mask.info.wavelength_nm)));
    }
    measure_masked(&modulation, ctx);
    Ok((modulation, ctx.wants("phase").then_some(phases)))
}

/// The layers that are shots, by their places: of each fringe the first phase; others may stand beside it for comparison.
///
/// Error: none of them shows fringes.
pub fn shots(layers: &[&LayerInfo]) -> Result<Vec<usize>, Error> {
    let mut shots: Vec<usize> = Vec::new();
    let fringed = |info: &LayerInfo| info.kind == LayerKind::Value && info.f_x_per_mm.is_some_and(|f| f > 0.0);
    for (k, layer) in layers.iter().enumerate().filter(|(_, info)| fringed(info)) {
        if shots.iter().all(|&s| !same_fringe(layers[s], layer)) {
            shots.push(k);
        }
    }
    if shots.is_empty() {
        return Err(Error::failed_with_hint(
            "the frames hold no fringes (f_x > 0)",
            "single_shot reads one frame with a carrier",
        ));
    }
    Ok(shots)
}

/// Pixels to each side along rows and columns that a pixel is made of: half a window of four standard deviations, or two of 0.64 periods of a filter.
fn reach(params: &Params, carrier: Carrier, pixel: [f64; 2]) -> [usize; 2] {
    let (cycles, pixel) = (carrier.cycles.abs(), if carrier.along_rows { pixel[0] } else { pixel[1] });
    let pixels = match params.filter {
        Filter::LeastSquares => {
            let amplitude = params.window.map_or(WINDOW_PERIODS / cycles, |w| w.0 / pixel);
            params.mean_window.map_or(amplitude, |w| amplitude.max(w.0 / pixel)) / 2.0
        }
        Filter::Gaussian | Filter::Rectangle => 2.0 * 0.64 / cycles,
    };
    let pixels = libm::ceil(pixels) as usize;
    if carrier.along_rows { [pixels, 0] } else { [0, pixels] }
}

fn same_fringe(a: &LayerInfo, b: &LayerInfo) -> bool {
    a.f_x_per_mm == b.f_x_per_mm && a.orientation_deg == b.orientation_deg && a.wavelength_nm == b.wavelength_nm
}

/// Cycles per pixel along rows or columns, signed by their order in the image; and whether along rows.
#[derive(Clone, Copy)]
pub struct Carrier {
    cycles: f64,
    along_rows: bool,
}

/// mm of a pixel along x and along y, in the plane of the pattern.
pub fn pixel_size(params: &Params, scene: Option<&Scene>) -> Result<[f64; 2], Error> {
    match (params.pixel_mm, scene.and_then(|s| s.camera.as_ref())) {
        (Some(pixel), _) => Ok([pixel.0; 2]),
        (None, Some(c)) => Ok([c.field[0] / f64::from(c.pixels[0]), c.field[1] / f64::from(c.pixels[1])]),
        (None, None) => {
            let hint = "connect a scene that has a camera to the port `scene`, or give pixel_mm";
            Err(Error::failed_with_hint("the size of a pixel in mm is not known", hint))
        }
    }
}

/// The carrier of a shot of so many rows and columns.
///
/// Errors: fringes aslant, fewer than 3 pixels per period, fewer than 4 periods.
pub fn carrier(pixel: [f64; 2], info: &LayerInfo, [rows, columns]: [usize; 2]) -> Result<Carrier, Error> {
    let f_x = info.f_x_per_mm.unwrap_or(0.0);
    let turns = info.orientation_deg.unwrap_or(0.0) / 360.0;
    let (sin, cos) = turbid_optics::elementary::sin_cos_turns(turns);
    let (along_rows, cycles) = if sin.abs() < 1e-9 {
        (true, f_x * pixel[0] * cos)
    } else if cos.abs() < 1e-9 {
        // Rows count downwards, y upwards.
        (false, -f_x * pixel[1] * sin)
    } else {
        let what = format!("fringes at {} deg run neither along rows nor along columns", 360.0 * turns);
        return Err(Error::failed_with_hint(what, "single_shot wants orientation_deg 0 or 90"));
    };
    let periods = cycles.abs() * if along_rows { columns } else { rows } as f64;
    // The band around the carrier ends at 3/2 of it.
    if cycles.abs() > 1.0 / 3.0 || periods < 4.0 {
        let mm = if along_rows { pixel[0] } else { pixel[1] };
        let cycles = cycles.abs();
        let what =
            format!("f_x = {f_x} mm^-1 is {cycles:.4} cycles per pixel of {mm} mm and {periods:.1} in the image");
        return Err(Error::failed_with_hint(
            what,
            "single_shot needs 3 pixels or more per period and 4 periods or more",
        ));
    }
    Ok(Carrier { cycles, along_rows })
}

/// Periods that the windows of a fit hold: that of the fringe, and that of the mean where it is another one.
///
/// Error: fewer than one, which does not tell mean and fringe apart.
pub fn periods(
    params: &Params,
    shot: &LayerInfo,
    carrier: Carrier,
    pixel: [f64; 2],
) -> Result<(f64, Option<f64>), Error> {
    let pixel = if carrier.along_rows { pixel[0] } else { pixel[1] };
    let held = |field: &'static str, window: Option<Length>| {
        let Some(window) = window.filter(|_| params.filter == Filter::LeastSquares) else { return Ok(None) };
        // As for speckle the window is four standard deviations wide.
        let periods = window.0 / pixel * carrier.cycles.abs();
        if periods < 1.0 {
            let f_x = shot.f_x_per_mm.unwrap_or(0.0);
            let what =
                format!("a window of {window} holds {periods:.2} periods of f_x = {f_x} mm^-1; one is the least");
            return Err(Error::invalid(field, what));
        }
        Ok(Some(periods))
    };
    Ok((held("window", params.window)?.unwrap_or(WINDOW_PERIODS), held("mean_window", params.mean_window)?))
}

/// How a line becomes mean and fringe.
enum Parting {
    /// Of the fringe, and of the mean where that has a window of its own.
    Fit(LocalFit, Option<LocalFit>),
    /// A filter, and what it leaves of white noise.
    Filter(FilterKind, f64),
}

impl Parting {
    /// Error: a window that does not tell mean and fringe apart.
    fn new(params: &Params, shot: &Layer, carrier: Carrier, pixel: [f64; 2], length: usize) -> Result<Self, Error> {
        let cycles = carrier.cycles.abs();
        let filter = match params.filter {
            Filter::Gaussian => FilterKind::Gaussian,
            Filter::Rectangle => FilterKind::Rectangle,
            Filter::LeastSquares => {
                let (periods, mean) = periods(params, &shot.info, carrier, pixel)?;
                let fit = |periods: f64| LocalFit::new(cycles, 0.25 * periods / cycles, length);
                return Ok(Self::Fit(fit(periods), mean.map(fit)));
            }
        };
        Ok(Self::Filter(filter, noise_gain(filter, cycles)))
    }

    /// (dc, re, im) of each pixel of a line with their covariance (where `variances` of the pixels are known), or why not;
    /// `reasons` against pixels are 0 where there is none. A fit adds to the variances what it cannot follow.
    fn part(
        &self,
        line: &[f64],
        reasons: &[f32],
        variances: Option<&mut [f64]>,
        cycles: f64,
    ) -> Vec<Result<Pixel, f32>> {
        let good: Vec<bool> = reasons.iter().map(|&r| r == 0.0).collect();
        let of = |k: usize, reach: usize| k.saturating_sub(reach)..(k + reach + 1).min(line.len());
        // The pixel's own reason, or that of the first in reach.
        let reason = |k: usize, reach: usize| match reasons[k] {
            0.0 => reasons[of(k, reach)].iter().copied().find(|&r| r != 0.0),
            own => Some(own),
        };
        match self {
            Self::Fit(fit, mean) => {
                let fitted = |k: usize| {
                    if !good[k] {
                        return Err(reasons[k]);
                    }
                    let lacking = |fit: &LocalFit| reason(k, fit.reach()).unwrap_or(MaskReason::LowSignal.code());
                    let own = fit.weights(k, &good).ok_or_else(|| lacking(fit))?;
                    let mean = mean.as_ref().map(|mean| mean.weights(k, &good).ok_or_else(|| lacking(mean)));
                    Ok((own, mean.transpose()?))
                };
                let fits: Vec<Result<Fitted<'_>, f32>> = (0..line.len()).map(fitted).collect();
                let mut structure = vec![0.0; line.len()];
                let variances = variances.map(|variances| {
                    for (k, found) in fits.iter().enumerate() {
                        let Ok((own, _)) = found else { continue };
                        structure[k] = fit.structure(k, own, line, &good, variances[k]);
                    }
                    variances.iter_mut().zip(&structure).for_each(|(variance, structure)| *variance += structure);
                    &*variances
                });
                let pixel = |(k, found): (usize, Result<Fitted<'_>, f32>)| {
                    let (own, mean) = found?;
                    let weights = mean.map_or(own.clone(), |mean| Cow::Owned(own.with_mean(&mean)));
                    let value = weights.apply(line);
                    let covariance = variances.map(|v| with_structure(weights.covariance(v), value, structure[k]));
                    Ok(Pixel { value, covariance, weights: variances.map(|_| weights.into_owned()) })
                };
                fits.into_iter().enumerate().map(pixel).collect()
            }
            Self::Filter(filter, gain) => {
                let found = part(line, cycles, *filter);
                // Beyond the reach of the filter (3.2 periods) a bad pixel has no weight.
                let reach = libm::ceil(3.2 / cycles) as usize;
                let pixel = |k: usize| {
                    if let Some(reason) = reason(k, reach) {
                        return Err(reason);
                    }
                    let [re, im] = found.fringe[k];
                    let covariance = variances.as_deref().map(|v| {
                        let [dc, ac] = [gain * v[k], 2.0 * gain * v[k]];
                        [[dc, 0.0, 0.0], [0.0, ac, 0.0], [0.0, 0.0, ac]]
                    });
                    Ok(Pixel { value: [found.dc[k], re, im], covariance, weights: None })
                };
                (0..line.len()).map(pixel).collect()
            }
        }
    }
}

/// The covariance of (dc, re, im) with what the pixel itself differs by from its window: structure of the sample dims or brightens mean and fringe
/// by the same factor, of variance t^2, and shows as `structure` = t^2 (dc^2 + M_AC^2 / 2) along the line.
fn with_structure(mut covariance: [[f64; 3]; 3], value: [f64; 3], structure: f64) -> [[f64; 3]; 3] {
    let [dc, re, im] = value;
    let factor = structure / (dc * dc + 0.5 * (re * re + im * im));
    if factor > 0.0 {
        (0..3).for_each(|p| (0..3).for_each(|q| covariance[p][q] += factor * value[p] * value[q]));
    }
    covariance
}

/// Weights of a pixel: those of mean and fringe, and those of the mean where it has a window of its own.
type Fitted<'a> = (Cow<'a, Weights>, Option<Cow<'a, Weights>>);

/// What a pixel of a line is made of.
struct Pixel {
    /// dc, re, im
    value: [f64; 3],
    covariance: Option<[[f64; 3]; 3]>,
    /// Those of a fit: its neighbours share pixels, and the error of a mean knows which.
    weights: Option<Weights>,
}

/// Variances of the sums of M_DC and of M_AC over the good pixels of lines.
#[derive(Default)]
struct Sums([f64; 2]);

impl Sums {
    /// Adds a line: its good pixels with the direction of their phasor, and the variances of all.
    fn add(&mut self, pixels: &[(usize, Pixel, [f64; 2])], variances: &[f64]) {
        let mut weights = vec![[0.0; 2]; variances.len()];
        for (k, pixel, [cos, sin]) in pixels {
            match &pixel.weights {
                Some(own) => own.weights.iter().zip(&mut weights[own.first..]).for_each(|(w, sum)| {
                    *sum = [sum[0] + w[0], sum[1] + cos * w[1] + sin * w[2]];
                }),
                // A filter keeps the sum of a line, and takes twice the noise for the fringe.
                None => weights[*k] = [1.0, std::f64::consts::SQRT_2],
            }
        }
        for (w, variance) in weights.iter().zip(variances) {
            self.0 = [self.0[0] + w[0] * w[0] * variance, self.0[1] + w[1] * w[1] * variance];
        }
    }
}

/// Adds the layers of one shot; gives those of its phase.
fn one(
    params: &Params,
    shot: &Layer,
    stack: &ImageStack,
    (carrier, pixel): (Carrier, [f64; 2]),
    with_f_0: bool,
    out: &mut ImageStack,
) -> Result<Vec<Layer>, Error> {
    let (rows, columns) = (stack.rows(), stack.columns());
    let (count, length) = if carrier.along_rows { (rows, columns) } else { (columns, rows) };
    let place = |line: usize, k: usize| if carrier.along_rows { (line, k) } else { (k, line) };
    let parting = Parting::new(params, shot, carrier, pixel, length)?;
    let plane = || Array2::<f32>::zeros((rows, columns));
    let [mut dc, mut ac, mut phase, mut mask] = [plane(), plane(), plane(), plane()];
    let se = stack.standard_error(&shot.info);
    let [mut dc_se, mut ac_se, mut phase_se, mut shared] = [plane(), plane(), plane(), plane()];
    let carried = stack.mask(shot.info.wavelength_nm);
    let shift = shot.info.phase_rad.unwrap_or(0.0) / std::f64::consts::TAU;
    let (shift_sin, shift_cos) = turbid_optics::elementary::sin_cos_turns(shift);
    let (mut count_good, mut sums) = (0_u64, Sums::default());
    for line in 0..count {
        let values: Vec<f64> = (0..length).map(|k| f64::from(shot.data[place(line, k)])).collect();
        let bad = |k: usize| {
            let carried = carried.map_or(0.0, |m| m.data[place(line, k)]);
            if carried != 0.0 {
                carried
            } else if !values[k].is_finite() {
                MaskReason::NotFinite.code()
            } else if params.saturation.is_some_and(|level| values[k] >= level) {
                MaskReason::Saturated.code()
            } else {
                0.0
            }
        };
        let reasons: Vec<f32> = (0..length).map(bad).collect();
        let clean: Vec<f64> = values.iter().map(|v| if v.is_finite() { *v } else { 0.0 }).collect();
        let square = |k: usize| se.map_or(0.0, |se| f64::from(se.data[place(line, k)]).powi(2));
        let mut variances: Vec<f64> = (0..length).map(|k| if reasons[k] == 0.0 { square(k) } else { 0.0 }).collect();
        let parted = parting.part(&clean, &reasons, se.is_some().then_some(&mut variances), carrier.cycles.abs());
        let mut good = Vec::new();
        for (k, pixel) in parted.into_iter().enumerate() {
            let at = place(line, k);
            let pixel = match pixel {
                Ok(pixel) => pixel,
                Err(reason) => {
                    mask[at] = reason;
                    continue;
                }
            };
            let [mean, re, im] = pixel.value;
            let m_ac = (re * re + im * im).sqrt();
            if mean <= 0.0 || m_ac <= f64::from(f32::EPSILON) * mean {
                mask[at] = MaskReason::LowSignal.code();
                continue;
            }
            (dc[at], ac[at]) = (mean as f32, m_ac as f32);
            // A carrier that falls along the line shows the conjugate.
            let z = if carrier.cycles < 0.0 { [re, -im] } else { [re, im] };
            let z = product(z, [shift_cos, -shift_sin]);
            phase[at] = atan2(z[1], z[0]) as f32;
            let [cos, sin] = [re / m_ac, im / m_ac];
            if let Some(c) = &pixel.covariance {
                let along = cos * cos * c[1][1] + 2.0 * cos * sin * c[1][2] + sin * sin * c[2][2];
                let across = sin * sin * c[1][1] - 2.0 * cos * sin * c[1][2] + cos * cos * c[2][2];
                dc_se[at] = c[0][0].sqrt() as f32;
                ac_se[at] = along.max(0.0).sqrt() as f32;
                phase_se[at] = (across.max(0.0).sqrt() / m_ac) as f32;
                shared[at] = (cos * c[0][1] + sin * c[0][2]) as f32;
            }
            good.push((k, pixel, [cos, sin]));
        }
        count_good += good.len() as u64;
        sums.add(&good, &variances);
    }
    let first = out.layers.iter().filter(|l| l.info.kind == LayerKind::Value).count();
    let OfShot { means, m_ac, covariances, mask: mask_info, phase: info } = OfShot::new(&shot.info, with_f_0, first);
    let mut push = |mut info: LayerInfo, data: &Array2<f32>, own: &Array2<f32>, variance: f64| {
        info.mean_se = if se.is_some() { mean_se(variance, count_good, 1.0) } else { None };
        let error = info.standard_error();
        out.push(info, data.clone());
        if se.is_some() {
            out.push(error, own.clone());
        }
    };
    let [of_dc, of_ac] = sums.0;
    means.into_iter().for_each(|info| push(info, &dc, &dc_se, of_dc));
    push(m_ac, &ac, &ac_se, of_ac);
    for (info, of_fringe) in covariances.into_iter().filter(|_| se.is_some()) {
        // Else one number under several names.
        out.push(info, if of_fringe { shared.clone() } else { dc_se.mapv(|se| se * se) });
    }
    match out.layers.iter_mut().find(|l| l.info == mask_info) {
        // A pixel is good where every shot of its wavelength is.
        Some(known) => known.data.zip_mut_with(&mask, |known, &new| *known = if *known == 0.0 { new } else { *known }),
        None => out.push(mask_info.clone(), mask.clone()),
    }
    let mut phases = vec![Layer { info: info.clone(), data: phase }];
    if se.is_some() {
        phases.push(Layer { info: info.standard_error(), data: phase_se });
    }
    phases.push(Layer { info: mask_info, data: mask });
    Ok(phases)
}

/// Values first, then errors, then masks.
pub fn order(stack: &mut ImageStack) {
    let rank = |kind: LayerKind| match kind {
        LayerKind::Value => 0,
        LayerKind::StandardError => 1,
        LayerKind::Covariance => 2,
        LayerKind::Mask => 3,
        LayerKind::Condition => 4,
    };
    stack.layers.sort_by_key(|l| rank(l.info.kind));
}
