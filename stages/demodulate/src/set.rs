//! Which frames belong together: by wavelength, spatial frequency and orientation, as their layers say.

use turbid_contract::{Error, ImageStack, Layer, LayerInfo, LayerKind};

use crate::diagnostics::Worst;
use crate::phase_shift::Weights;
use crate::unknown_steps;

/// The frames of one spatial frequency and orientation.
pub struct Fringe {
    pub f_x_per_mm: f64,
    /// None at f_x = 0, which has no direction.
    pub orientation_deg: Option<f64>,
    /// Indices into the layers of the frames.
    pub frames: Vec<usize>,
    pub weights: Weights,
    /// At f_x = 0 with phases: weights of the light that does not follow them.
    pub ambient: Option<Vec<f64>>,
}

impl Fringe {
    /// Whether its frames differ by their phases.
    pub fn is_shifted(&self) -> bool {
        self.f_x_per_mm > 0.0 || self.ambient.is_some()
    }
}

/// The frames of one wavelength, fringes by rising f_x, then orientation.
pub struct Channel {
    pub wavelength_nm: Option<f64>,
    pub unit: String,
    pub fringes: Vec<Fringe>,
}

impl Channel {
    /// The pairs of the quantities m_dc (2 k) and m_ac (2 k + 1) of fringe k whose covariance is stored. At f_x = 0 both are M_DC; its covariances
    /// stand once, under m_ac.
    pub fn pairs(&self) -> Vec<[usize; 2]> {
        let stored = |&q: &usize| q % 2 == 1 || self.fringes[q / 2].f_x_per_mm > 0.0;
        let stored: Vec<usize> = (0..2 * self.fringes.len()).filter(stored).collect();
        let behind = |i: usize| stored[i + 1..].iter().map(move |&j| [i, j]);
        let pairs = (0..stored.len()).flat_map(behind);
        pairs.map(|[i, j]| [stored[i], j]).collect()
    }

    /// Takes the steps from the frames, and notes how far they are from what the frames say.
    ///
    /// Errors: frames that do not tell their steps.
    pub fn estimate_steps(&mut self, stack: &ImageStack, worst: &mut Worst) -> Result<(), Error> {
        let mask = stack.mask(self.wavelength_nm).map(Layer::pixels);
        for fringe in self.fringes.iter_mut().filter(|f| f.f_x_per_mm > 0.0) {
            let given: Vec<f64> =
                fringe.frames.iter().map(|&i| stack.layers[i].info.phase_rad.expect("read before")).collect();
            let good = |i: usize| mask.as_ref().is_none_or(|m| m[i] == 0.0);
            let pixels = |&i: &usize| -> Vec<f32> {
                stack.layers[i].pixels().iter().enumerate().filter(|&(i, _)| good(i)).map(|(_, &v)| v).collect()
            };
            let planes: Vec<Vec<f32>> = fringe.frames.iter().map(pixels).collect();
            let planes: Vec<&[f32]> = planes.iter().map(Vec::as_slice).collect();
            let place = format!("the phase steps at f_x = {} mm^-1", fringe.f_x_per_mm);
            let steps =
                unknown_steps::find(&planes, &given).map_err(|what| Error::failed(format!("{place}: {what}")))?;
            fringe.weights = Weights::least_squares(&steps)
                .ok_or_else(|| Error::failed(format!("{place}: those found ({steps:?} rad) fix no sinusoid")))?;
            worst.departs(steps.iter().zip(&given).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max));
        }
        Ok(())
    }
}

/// Sorts frames into channels and fringes, by what their layers say; indices are those of the layers.
///
/// Errors: no radiance layer, one without f_x or phase, fewer than three different phases.
pub fn channels(layers: &[&LayerInfo]) -> Result<Vec<Channel>, Error> {
    let mut channels: Vec<Channel> = Vec::new();
    for (index, info) in layers.iter().enumerate().filter(|(_, info)| info.kind == LayerKind::Value) {
        let f_x = info.f_x_per_mm.ok_or_else(|| {
            Error::failed_with_hint(
                format!("frame {index} (`{}`) does not say its f_x", info.name),
                "frames carry f_x_per_mm and phase_rad in their layers",
            )
        })?;
        let channel = match channels.iter().position(|c| c.wavelength_nm == info.wavelength_nm) {
            Some(known) => &mut channels[known],
            None => {
                let new = Channel { wavelength_nm: info.wavelength_nm, unit: info.unit.clone(), fringes: Vec::new() };
                channels.push(new);
                channels.last_mut().expect("just pushed")
            }
        };
        let orientation = if f_x == 0.0 { None } else { Some(info.orientation_deg.unwrap_or(0.0)) };
        match channel.fringes.iter_mut().find(|f| f.f_x_per_mm == f_x && f.orientation_deg == orientation) {
            Some(fringe) => fringe.frames.push(index),
            None => channel.fringes.push(Fringe {
                f_x_per_mm: f_x,
                orientation_deg: orientation,
                frames: vec![index],
                weights: Weights::mean(1),
                ambient: None,
            }),
        }
    }
    if channels.is_empty() {
        return Err(no_values());
    }
    channels.sort_by(|a, b| a.wavelength_nm.partial_cmp(&b.wavelength_nm).expect("wavelengths are finite"));
    for channel in &mut channels {
        channel.fringes.sort_by(|a, b| {
            let key = |f: &Fringe| (f.f_x_per_mm, f.orientation_deg);
            key(a).partial_cmp(&key(b)).expect("f_x and orientations are finite")
        });
        for fringe in &mut channel.fringes {
            (fringe.weights, fringe.ambient) = weights(fringe, layers)?;
        }
    }
    Ok(channels)
}

/// Frames without a frame.
pub fn no_values() -> Error {
    Error::failed_with_hint("the frames hold no layer with values", "connect frames of a render, a camera or files")
}

fn weights(fringe: &Fringe, layers: &[&LayerInfo]) -> Result<(Weights, Option<Vec<f64>>), Error> {
    let f_x = fringe.f_x_per_mm;
    if f_x == 0.0 {
        return even_light(fringe, layers);
    }
    let phases: Option<Vec<f64>> = fringe.frames.iter().map(|&i| layers[i].phase_rad).collect();
    let phases = phases.ok_or_else(|| {
        Error::failed_with_hint(
            format!("a frame at f_x = {f_x} mm^-1 does not say its phase (phase_rad)"),
            "frames carry f_x_per_mm and phase_rad in their layers",
        )
    })?;
    let weights = Weights::least_squares(&phases).ok_or_else(|| {
        Error::failed_with_hint(
            format!("the {} phases at f_x = {f_x} mm^-1 ({phases:?} rad) do not fix a sinusoid", phases.len()),
            "phase_shift needs at least 3 phases that differ modulo 2 pi",
        )
    })?;
    Ok((weights, None))
}

/// The mean of frames of one phase; of frames whose phases differ the amplitude, with what is left.
fn even_light(fringe: &Fringe, layers: &[&LayerInfo]) -> Result<(Weights, Option<Vec<f64>>), Error> {
    let said: Vec<f64> = fringe.frames.iter().filter_map(|&i| layers[i].phase_rad).collect();
    if said.iter().all(|phase| (phase - said[0]).abs() <= SAME_PHASE_RAD) {
        return Ok((Weights::mean(fringe.frames.len()), None));
    }
    let known = if said.len() == fringe.frames.len() { Weights::amplitude(&said, 0.0) } else { None };
    let (weights, ambient) = known.ok_or_else(|| {
        let degrees = said.iter().map(|phase| format!("{:.4}", phase.to_degrees()));
        let degrees: Vec<String> = degrees.map(|d| d.trim_end_matches('0').trim_end_matches('.').to_owned()).collect();
        let frames = fringe.frames.len();
        Error::failed_with_hint(
            format!("the {frames} frames at f_x = 0 have phases of {} deg, which fix no amplitude", degrees.join(", ")),
            "three phases or more that differ modulo 360 deg take black level and room light off; frames without steps have one phase",
        )
    })?;
    Ok((weights, Some(ambient)))
}

/// Phases closer to each other are one: rounding of degrees.
const SAME_PHASE_RAD: f64 = 1e-9;
