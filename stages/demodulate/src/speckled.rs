//! The method `speckle`: frames under random light in; M_DC and M_AC at the wanted f_x out, as if fringes had been projected.

use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{Frames, MaskReason, Scene};
use turbid_contract::planes::mean_se;
use turbid_contract::{Ctx, Error, ImageStack, Layer, LayerInfo, LayerKind};

use crate::masked::measure_masked;
use crate::params::Params;
use crate::pass::of;
use crate::snapshot::{order, pixel_size};
use crate::speckle::{Shot, Windows, band};
use crate::unknown;

/// Modulation of every wavelength.
pub fn run(params: &Params, frames: &Frames, scene: Option<&Scene>, ctx: Ctx<'_>) -> Result<ImageStack, Error> {
    let stack = &frames.0;
    let pixel = pixel_size(params, scene)?;
    let mut modulation = ImageStack::new(stack.rows(), stack.columns());
    modulation.attributes = stack.attributes.clone();
    let values = || stack.layers.iter().filter(|l| l.info.kind == LayerKind::Value);
    let mut done: Vec<Option<f64>> = Vec::new();
    for layer in values() {
        if done.contains(&layer.info.wavelength_nm) {
            continue;
        }
        done.push(layer.info.wavelength_nm);
        let shots: Vec<&Layer> = values().filter(|l| l.info.wavelength_nm == layer.info.wavelength_nm).collect();
        if let Some(fringed) = shots.iter().find(|l| l.info.f_x_per_mm.is_some_and(|f| f > 0.0)) {
            let f_x = fringed.info.f_x_per_mm.unwrap_or(0.0);
            return Err(Error::failed_with_hint(
                format!("a frame shows fringes of f_x = {f_x} mm^-1, and speckle wants frames under random light"),
                "say `f_x: 0` of frames under speckle, or take `method: phase_shift`",
            ));
        }
        one(params, stack, &shots, pixel, &mut modulation, ctx)?;
    }
    if done.is_empty() {
        return Err(Error::failed("the frames hold no layer with values"));
    }
    order(&mut modulation);
    measure_masked(&modulation, ctx);
    let half = |mm: f64| libm::ceil(0.5 * params.window.map_or(0.0, |w| w.0) / mm) as usize;
    unknown::pass_on(&mut modulation, |info| {
        let frames = values().map(|l| &l.info).filter(|frame| frame.wavelength_nm == info.wavelength_nm);
        Some(unknown::of_windows(&unknown::of_layers(stack, frames)?, stack.columns(), pixel.map(half)))
    });
    Ok(modulation)
}

/// Adds the layers of one wavelength.
fn one(
    params: &Params,
    stack: &ImageStack,
    layers: &[&Layer],
    pixel: [f64; 2],
    out: &mut ImageStack,
    ctx: Ctx<'_>,
) -> Result<(), Error> {
    let (rows, columns) = (stack.rows(), stack.columns());
    let window = params.window.map_or(0.0, |w| w.0);
    let pixels: Vec<_> = layers.iter().map(|l| l.pixels()).collect();
    let errors: Vec<_> = layers.iter().map(|l| stack.standard_error(&l.info).map(Layer::pixels)).collect();
    let reasons = reasons(params, stack, layers);
    let good: Vec<bool> = reasons.iter().map(|&r| r == 0.0).collect();
    let shots: Vec<Shot<'_>> =
        pixels.iter().zip(&errors).map(|(value, se)| Shot { value, se: se.as_deref() }).collect();
    // The window's Gaussian holds 95 % of its weight.
    let windows = Windows::new(&good, columns, pixel.map(|mm| 0.25 * window / mm));
    let weights = windows.weights();
    // The mean needs no band: a window of its own, narrower, keeps what it can of the resolution.
    let mean_window = params.mean_window.map_or(0.5 * window, |w| w.0);
    let narrow = Windows::new(&good, columns, pixel.map(|mm| 0.25 * mean_window / mm));
    let (mean, mean_variance) = narrow.m_dc(&shots, &windows);
    let mut mask = reasons;
    let mut found = Vec::new();
    for f_x in &params.f_x {
        let f = pixel.map(|mm| f_x.0 * mm);
        let highest = 1.0 + band(f_x.0 * window);
        if f.iter().any(|&f| highest * f > 0.5) {
            let pixels = format!("{} x {} mm", pixel[0], pixel[1]);
            let seen = format!("f_x = {f_x} (a window of {window} mm sees up to {:.3} mm^-1)", highest * f_x.0);
            return Err(Error::invalid("f_x", format!("{seen} is beyond what pixels of {pixels} resolve")));
        }
        let power = windows.power(&shots, f, f_x.0 * window, &weights);
        for (mask, (&mean, &m_ac)) in mask.iter_mut().zip(mean.iter().zip(&power.m_ac)) {
            if *mask == 0.0 && (mean <= 0.0 || m_ac <= f64::from(f32::EPSILON) * mean) {
                *mask = MaskReason::LowSignal.code();
            }
        }
        found.push((f_x.0, power));
        ctx.checked()?;
    }
    let count = mask.iter().filter(|&&m| m == 0.0).count() as u64;
    // How many pixels share a window: errors of the mean fall with the windows, not with the pixels.
    let sharing = |window: f64| {
        let pixels = 4.0 * std::f64::consts::PI * pixel.iter().map(|mm| 0.25 * window / mm).product::<f64>();
        pixels.max(1.0)
    };
    let (narrow_sharing, wide_sharing) = (sharing(mean_window), sharing(window));
    let plane = |of: &dyn Fn(usize) -> f64| {
        Array2::from_shape_fn((rows, columns), |(r, c)| {
            let i = r * columns + c;
            if mask[i] == 0.0 { of(i) as f32 } else { 0.0 }
        })
    };
    let mut push = |name: &str, f_x: f64, value: &dyn Fn(usize) -> f64, se: &dyn Fn(usize) -> f64, shared: f64| {
        let mut info = LayerInfo::value(name, &layers[0].info.unit).with_f_x(f_x);
        info.wavelength_nm = layers[0].info.wavelength_nm;
        let variances = (0..mask.len()).filter(|&i| mask[i] == 0.0).map(|i| se(i) * se(i)).sum();
        info.mean_se = mean_se(variances, count, shared);
        out.push(info.clone(), plane(value));
        out.push(info.standard_error(), plane(se));
    };
    // One shot alone does not tell how its mean wanders: as the speckle of the lowest frequency that was read does.
    let lowest = found.iter().min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, power)| &power.m_ac);
    let (squares, narrow_weights) = (narrow.sum(|_| 1.0, true), narrow.weights());
    let mean_error = |i: usize| match (&mean_variance, lowest) {
        (Some(variance), _) => variance[i].sqrt(),
        (None, Some(m_ac)) if narrow_weights[i] > 0.0 => m_ac[i] * squares[i].sqrt() / narrow_weights[i],
        _ => 0.0,
    };
    for name in ["m_dc", "m_ac"] {
        push(name, 0.0, &|i| mean[i], &mean_error, narrow_sharing);
    }
    for (f_x, power) in &found {
        push("m_dc", *f_x, &|i| mean[i], &mean_error, narrow_sharing);
        // The power of `samples` directions spreads by 1 / sqrt(samples), its root by half of that.
        push("m_ac", *f_x, &|i| power.m_ac[i], &|i| 0.5 * power.m_ac[i] / power.samples.sqrt(), wide_sharing);
    }
    let mut info = LayerInfo::new("mask", LayerKind::Mask, "1");
    info.wavelength_nm = layers[0].info.wavelength_nm;
    if count == 0 {
        let reasons = ctx.measure_masked(mask.iter().copied());
        ctx.warn(format!("all pixels{} are masked: {reasons}", of(info.wavelength_nm)));
    }
    out.push(info, Array2::from_shape_vec((rows, columns), mask).expect("one number per pixel"));
    Ok(())
}

/// Why pixels have no say: what the frames bring, what is no number, what is saturated.
fn reasons(params: &Params, stack: &ImageStack, layers: &[&Layer]) -> Vec<f32> {
    let carried = stack.mask(layers[0].info.wavelength_nm).map(|m| m.pixels().into_owned());
    let mut reasons = carried.unwrap_or_else(|| vec![0.0; stack.rows() * stack.columns()]);
    for layer in layers {
        let pixels = layer.pixels();
        for (reason, &value) in reasons.iter_mut().zip(pixels.iter()).filter(|(r, _)| **r == 0.0) {
            if !value.is_finite() {
                *reason = MaskReason::NotFinite.code();
            } else if params.saturation.is_some_and(|level| f64::from(value) >= level) {
                *reason = MaskReason::Saturated.code();
            }
        }
    }
    reasons
}
