//! Doubts about the phases that frames say they have, in words: steps too close to each other, steps that the fringes contradict, phases where there
//! is nothing to shift.

use std::f64::consts::TAU;

use turbid_contract::{Ctx, ImageStack, Layer, LayerKind};

use crate::diagnostics::{Diagnosis, Worst, diagnose};
use crate::phase_shift::Weights;
use crate::set::{Channel, Fringe};
use crate::unknown_steps;

/// Ripple of M_AC, percent, above which the frames are asked what their steps were: steps of 90 degrees in place of 120 make 29 %, a lesion of half
/// the brightness over four of six fringes some 3 %.
/// Once and twice a period 5 % are loud: good measurements of hands have 0.2 to 0.9 %. A gamma makes the third under three steps, on even fields too.
const LOUD_RIPPLE: [f64; 3] = [5.0, 5.0, 10.0];
/// Steps further than this from what the frames say are named, degrees.
const LEAST_DEPARTURE: f64 = 5.0;
/// Pixels that are asked for their steps, at most: some hundred rounds take a few milliseconds.
const MOST_PIXELS: usize = 4096;
/// Variance of the phasor over that of as many equal steps, above which the steps hardly fix a sinusoid: three of 0, 30 and 60 degrees have 64, of 0, 90 and 180 1.5.
const LARGE_GAIN: f64 = 10.0;

impl Channel {
    /// Notes ripple and drift of the fringes at each f_x, and warns where frames are not what they say; `given` tells that their steps were not
    /// estimated.
    pub fn diagnose(&self, stack: &ImageStack, given: bool, worst: &mut Worst, ctx: Ctx<'_>) {
        let mut untold = Vec::new();
        for fringe in &self.fringes {
            let found = look(fringe, stack, given, ctx);
            if fringe.f_x_per_mm > 0.0 {
                if found.is_none() {
                    untold.push(fringe.f_x_per_mm.to_string());
                }
                worst.add(found);
            }
        }
        if !untold.is_empty() {
            let light = light(self.wavelength_nm);
            ctx.warn(format!(
                "the image does not show fringes of all phases at f_x = {} mm^-1{light}: whether the steps are what the frames say cannot be told",
                untold.join(", ")
            ));
        }
    }
}

/// What the fringes at one f_x say of themselves; `None` where they do not tell. Warns where it is not what the frames say.
fn look(fringe: &Fringe, stack: &ImageStack, given: bool, ctx: Ctx<'_>) -> Option<Diagnosis> {
    let f_x = fringe.f_x_per_mm;
    let infos = || fringe.frames.iter().map(|&i| &stack.layers[i].info);
    let steps: Vec<f64> = infos().filter_map(|info| info.phase_rad).collect();
    if f_x == 0.0 {
        return None;
    }
    let light = light(stack.layers[fringe.frames[0]].info.wavelength_nm);
    let degrees = in_degrees(&steps);
    let gain = gain(&fringe.weights);
    if given && gain > LARGE_GAIN {
        let largest = steps.iter().copied().fold(0.0, f64::max).to_degrees();
        // Three steps of a third of a turn are 4.19 rad, two of them 2.09.
        let radians = if (2.0..6.3).contains(&largest) { "; are they in radians?" } else { "" };
        ctx.warn(format!(
            "the steps at f_x = {f_x} mm^-1{light} ({degrees} deg) hardly fix a sinusoid: the variance of M_AC is {gain:.0} times that of as many equal steps{radians}"
        ));
    }
    let pixels: Vec<_> = fringe.frames.iter().map(|&i| stack.layers[i].pixels()).collect();
    let planes: Vec<&[f32]> = pixels.iter().map(AsRef::as_ref).collect();
    let found = diagnose(&planes, &fringe.weights)?;
    if found.ripple.iter().zip(LOUD_RIPPLE).any(|(&ripple, loud)| ripple > loud) {
        let [one, two, three] = found.ripple;
        let told = if given { seen_steps(fringe, stack, &steps) } else { None };
        let why = match told {
            Some(seen) => format!("the frames look like steps of {} deg, not of {degrees} deg as they say; `steps: estimated` uses what they look like", in_degrees(&seen)),
            None => "frames of unlike brightness, a gamma, motion, wrong steps, or a sample that varies with the fringe do so".to_owned(),
        };
        ctx.warn(format!(
            "M_AC at f_x = {f_x} mm^-1{light} ripples along the fringe by {one:.1}, {two:.1} and {three:.1} % once, twice and thrice a period: {why}"
        ));
    }
    Some(found)
}

/// ` and 650 nm`, of frames that say their wavelength.
pub fn light(wavelength_nm: Option<f64>) -> String {
    wavelength_nm.map(|nm| format!(" and {nm} nm")).unwrap_or_default()
}

/// The wavelengths at which no frame holds any light, each as ` at 650 nm`; empty where frames say none. A pixel that no light reaches is background
/// or shade; frames in which all of them are so show nothing.
pub fn dark(stack: &ImageStack) -> Vec<String> {
    let values = || stack.layers.iter().filter(|layer| layer.info.kind == LayerKind::Value);
    let mut wavelengths: Vec<Option<f64>> = Vec::new();
    for layer in values() {
        if !wavelengths.contains(&layer.info.wavelength_nm) {
            wavelengths.push(layer.info.wavelength_nm);
        }
    }
    let lit = |layer: &Layer| layer.data.iter().any(|&value| value != 0.0);
    wavelengths.retain(|nm| !values().any(|layer| layer.info.wavelength_nm == *nm && lit(layer)));
    wavelengths.into_iter().map(|nm| nm.map(|nm| format!(" at {nm} nm")).unwrap_or_default()).collect()
}

/// Variance of (re, im) of white frames over that of as many equal steps, 4 / N.
fn gain(weights: &Weights) -> f64 {
    let [dc, re, im] = &weights.weights;
    re.iter().chain(im).map(|w| w * w).sum::<f64>() * dc.len() as f64 / 4.0
}

/// The steps that the frames show, where these are not those that they say.
fn seen_steps(fringe: &Fringe, stack: &ImageStack, given: &[f64]) -> Option<Vec<f64>> {
    let mask = stack.mask(stack.layers[fringe.frames[0]].info.wavelength_nm).map(Layer::pixels);
    let all = stack.rows() * stack.columns();
    // An odd stride walks through all phases of fringes of a few whole pixels.
    let chosen = (0..all).step_by(all.div_ceil(MOST_PIXELS) | 1);
    let chosen: Vec<usize> = chosen.filter(|&i| mask.as_ref().is_none_or(|m| m[i] == 0.0)).collect();
    let pixels = |&k: &usize| -> Vec<f32> {
        let pixels = stack.layers[k].pixels();
        chosen.iter().map(|&i| pixels[i]).collect()
    };
    let planes: Vec<Vec<f32>> = fringe.frames.iter().map(pixels).collect();
    let planes: Vec<&[f32]> = planes.iter().map(Vec::as_slice).collect();
    // From far away the search ends anywhere: equal steps are what most people take.
    let equal = |step: f64| (0..given.len()).map(|k| given[0] + step * k as f64).collect::<Vec<f64>>();
    let starts = [given.to_vec(), equal(TAU / given.len() as f64), equal(0.25 * TAU)];
    let ripple = |steps: &[f64]| {
        let found = diagnose(&planes, &Weights::least_squares(steps)?)?;
        Some(found.ripple.into_iter().fold(0.0, f64::max))
    };
    let found = starts.iter().filter_map(|start| unknown_steps::find(&planes, start).ok());
    let found = found.filter_map(|steps| Some((ripple(&steps)?, steps)));
    let (least, seen) = found.min_by(|a, b| a.0.total_cmp(&b.0))?;
    let departure = seen.iter().zip(given).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max).to_degrees();
    (departure > LEAST_DEPARTURE && 2.0 * least < ripple(given)?).then_some(seen)
}

fn in_degrees(steps: &[f64]) -> String {
    let rounded = |step: &f64| ((10.0 * step.to_degrees()).round() / 10.0).to_string();
    steps.iter().map(rounded).collect::<Vec<_>>().join(", ")
}
