//! Which frames belong together: by wavelength, spatial frequency and orientation, as their layers say.

use std::borrow::Cow;

use turbid_contract::payload::{Covariance, Frames};
use turbid_contract::{Error, ImageStack, Layer, LayerKind};
use turbid_contract::{serde, serde_json};

use crate::diagnostics::Worst;
use crate::noise::{Block, Element};
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
}

/// The frames of one wavelength, fringes by rising f_x, then orientation.
pub struct Channel {
    pub wavelength_nm: Option<f64>,
    pub unit: String,
    pub fringes: Vec<Fringe>,
}

impl Channel {
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

/// Sorts frames into channels and fringes.
///
/// Errors: no radiance layer, one without f_x or phase, fewer than three different phases.
pub fn channels(frames: &Frames) -> Result<Vec<Channel>, Error> {
    let mut channels: Vec<Channel> = Vec::new();
    for (index, layer) in frames.0.layers.iter().enumerate().filter(|(_, l)| l.info.kind == LayerKind::Value) {
        let info = &layer.info;
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
            }),
        }
    }
    if channels.is_empty() {
        return Err(Error::failed("the frames hold no layer with values"));
    }
    channels.sort_by(|a, b| a.wavelength_nm.partial_cmp(&b.wavelength_nm).expect("wavelengths are finite"));
    for channel in &mut channels {
        channel.fringes.sort_by(|a, b| {
            let key = |f: &Fringe| (f.f_x_per_mm, f.orientation_deg);
            key(a).partial_cmp(&key(b)).expect("f_x and orientations are finite")
        });
        for fringe in &mut channel.fringes {
            fringe.weights = weights(fringe, &frames.0)?;
        }
    }
    Ok(channels)
}

fn weights(fringe: &Fringe, frames: &ImageStack) -> Result<Weights, Error> {
    let f_x = fringe.f_x_per_mm;
    if f_x == 0.0 {
        return Ok(Weights::mean(fringe.frames.len()));
    }
    let phases: Option<Vec<f64>> = fringe.frames.iter().map(|&i| frames.layers[i].info.phase_rad).collect();
    let phases = phases
        .ok_or_else(|| Error::failed(format!("a frame at f_x = {f_x} mm^-1 does not say its phase (phase_rad)")))?;
    Weights::least_squares(&phases).ok_or_else(|| {
        Error::failed_with_hint(
            format!("the {} phases at f_x = {f_x} mm^-1 ({phases:?} rad) do not fix a sinusoid", phases.len()),
            "phase_shift needs at least 3 phases that differ modulo 2 pi",
        )
    })
}

/// Where the noise of (dc, re, im) is known from.
pub enum Noise<'a> {
    /// The renderer's covariance: for each fringe the indices of (dc, re, im) among its quantities.
    Given { pixels: Vec<Option<Cow<'a, [f32]>>>, quantities: Vec<[Option<usize>; 3]>, count: usize },
    /// Standard errors of frames that are independent of each other, by layer index of the frame.
    Frames { se: Vec<Option<Cow<'a, [f32]>>> },
}

impl<'a> Noise<'a> {
    /// From the covariance where one is connected, else from the standard errors of the frames; `None` without either.
    ///
    /// Errors: a covariance of another size, one that lacks a quantity or a pair.
    pub fn of_channel(
        channel: &Channel,
        frames: &'a Frames,
        covariance: Option<&'a Covariance>,
    ) -> Result<Option<Self>, Error> {
        if let Some(Covariance(stack)) = covariance {
            return given(channel, &frames.0, stack).map(Some);
        }
        let mut se = vec![None; frames.0.layers.len()];
        for &index in channel.fringes.iter().flat_map(|f| &f.frames) {
            match frames.0.standard_error(&frames.0.layers[index].info) {
                Some(layer) => se[index] = Some(layer.pixels()),
                None => return Ok(None),
            }
        }
        Ok(Some(Self::Frames { se }))
    }

    /// Covariance between (dc, re, im) of fringes `a` and `b` of the channel.
    pub fn block(&self, channel: &Channel, a: usize, b: usize) -> Block<'_> {
        Block([0, 1, 2].map(|p| [0, 1, 2].map(|q| self.element(channel, (a, p), (b, q)))))
    }

    fn element(&self, channel: &Channel, (a, p): (usize, usize), (b, q): (usize, usize)) -> Element<'_> {
        match self {
            Self::Given { pixels, quantities, count } => match (quantities[a][p], quantities[b][q]) {
                (Some(i), Some(j)) => {
                    let plane = pixels[i.min(j) * count + i.max(j)].as_ref();
                    Element::Given(plane.expect("`given` made sure that all pairs in use are there"))
                }
                _ => Element::Zero,
            },
            Self::Frames { .. } if a != b => Element::Zero,
            Self::Frames { se } => {
                let fringe = &channel.fringes[a];
                let weights = &fringe.weights.weights;
                let se: Vec<&[f32]> =
                    fringe.frames.iter().map(|&i| se[i].as_deref().expect("read for each frame")).collect();
                Element::of_frames(&weights[p], &weights[q], &se)
            }
        }
    }
}

fn given<'a>(channel: &Channel, frames: &ImageStack, stack: &'a ImageStack) -> Result<Noise<'a>, Error> {
    if (stack.rows(), stack.columns()) != (frames.rows(), frames.columns()) {
        return Err(Error::failed(format!(
            "the covariance is {} x {} pixels, the frames are {} x {}",
            stack.columns(),
            stack.rows(),
            frames.columns(),
            frames.rows()
        )));
    }
    let listed: Vec<Quantity> = stack
        .attributes
        .get("quantities")
        .and_then(|list| serde_json::from_value(list.clone()).ok())
        .ok_or_else(|| Error::failed("the covariance does not list its quantities"))?;
    let find = |part: &str, fringe: &Fringe| {
        // A fringe's own M_DC, where it has one, before that of all.
        let own = |q: &&Quantity| q.f_x_per_mm == Some(fringe.f_x_per_mm);
        let is = |q: &&Quantity| q.is(part, fringe, channel.wavelength_nm);
        let mut order = listed.iter().filter(own).chain(listed.iter()).filter(is);
        order
            .next()
            .and_then(|found| listed.iter().position(|q| std::ptr::eq(q, found)))
            .ok_or_else(|| Error::failed(format!("the covariance lacks `{part}` at f_x = {} mm^-1", fringe.f_x_per_mm)))
    };
    let mut quantities = Vec::new();
    for fringe in &channel.fringes {
        let (re, im) = match fringe.f_x_per_mm {
            0.0 => (None, None),
            _ => (Some(find("re", fringe)?), Some(find("im", fringe)?)),
        };
        quantities.push([Some(find("dc", fringe)?), re, im]);
    }
    let count = listed.len();
    let mut pixels: Vec<Option<Cow<'a, [f32]>>> = vec![None; count * count];
    let used: Vec<usize> = quantities.iter().flatten().flatten().copied().collect();
    for layer in stack.layers.iter().filter(|l| l.info.kind == LayerKind::Covariance) {
        let Some([i, j]) = layer.info.pair.map(|pair| pair.map(|k| k as usize)) else { continue };
        if used.contains(&i) && used.contains(&j) && i.max(j) < count {
            pixels[i.min(j) * count + i.max(j)] = Some(Layer::pixels(layer));
        }
    }
    for &i in &used {
        for &j in used.iter().filter(|&&j| j >= i) {
            if pixels[i * count + j].is_none() {
                return Err(Error::failed(format!("the covariance lacks the pair of its quantities {i} and {j}")));
            }
        }
    }
    Ok(Noise::Given { pixels, quantities, count })
}

/// An entry of the covariance's attribute `quantities`.
#[derive(serde::Deserialize)]
struct Quantity {
    part: String,
    #[serde(default)]
    f_x_per_mm: Option<f64>,
    #[serde(default)]
    orientation_deg: Option<f64>,
    #[serde(default)]
    wavelength_nm: Option<f64>,
}

impl Quantity {
    fn is(&self, part: &str, fringe: &Fringe, wavelength_nm: Option<f64>) -> bool {
        // M_DC is the same for every fringe.
        let same_fringe = part == "dc"
            || (self.f_x_per_mm == Some(fringe.f_x_per_mm)
                && Some(self.orientation_deg.unwrap_or(0.0)) == fringe.orientation_deg);
        self.part == part && same_fringe && self.wavelength_nm == wavelength_nm
    }
}
