//! Where the noise of (dc, re, im) comes from: the renderer's covariance, or the standard errors of the frames.

use std::borrow::Cow;

use turbid_contract::layers::{is_square, squared};
use turbid_contract::payload::{Covariance, Frames, Rig};
use turbid_contract::{Attributes, Error, Form, ImageStack, Layer, LayerInfo, LayerKind};
use turbid_contract::{serde, serde_json};

use crate::noise::{Block, Element};
use crate::set::{Channel, Fringe};

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
    /// Errors: a covariance of another size, rig or unit, one that lacks a quantity or a pair.
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
    let size = |stack: &ImageStack| [stack.rows() as u64, stack.columns() as u64];
    same_size(size(stack), size(frames))?;
    Rig::shared(&frames.attributes, &stack.attributes)?;
    same_unit(stack.layers.iter().map(|layer| &layer.info), channel)?;
    let listed = listed(&stack.attributes)?;
    let (quantities, count) = (places(channel, &listed)?, listed.len());
    let mut pixels: Vec<Option<Cow<'a, [f32]>>> = vec![None; count * count];
    for layer in &stack.layers {
        if let Some([i, j]) = pair(&layer.info).filter(|pair| pair[1] < count) {
            pixels[i * count + j] = Some(Layer::pixels(layer));
        }
    }
    complete(&quantities, |i, j| pixels[i * count + j].is_some())?;
    Ok(Noise::Given { pixels, quantities, count })
}

/// Whether a covariance belongs to frames of these channels, as far as the forms tell.
///
/// Errors: those of [`Noise::of_channel`].
pub fn belongs(covariance: &Form, frames: &Form, channels: &[Channel]) -> Result<(), Error> {
    if let (Some(covariance), Some(frames)) = (covariance.pixels, frames.pixels) {
        same_size(covariance, frames)?;
    }
    Rig::shared(&frames.attributes, &covariance.attributes)?;
    for channel in channels {
        same_unit(covariance.layers.iter().flatten(), channel)?;
    }
    if covariance.attribute(QUANTITIES).is_none() {
        return Ok(());
    }
    let listed = listed(&covariance.attributes)?;
    for channel in channels {
        let quantities = places(channel, &listed)?;
        if let Some(layers) = &covariance.layers {
            let pairs: Vec<[usize; 2]> = layers.iter().filter_map(pair).collect();
            complete(&quantities, |i, j| pairs.contains(&[i, j]))?;
        }
    }
    Ok(())
}

/// The quantities of a layer of covariances, the lower first.
fn pair(info: &LayerInfo) -> Option<[usize; 2]> {
    let [i, j] = info.pair.filter(|_| info.kind == LayerKind::Covariance)?.map(|k| k as usize);
    Some([i.min(j), i.max(j)])
}

/// Rows and columns.
fn same_size(covariance: [u64; 2], frames: [u64; 2]) -> Result<(), Error> {
    if covariance == frames {
        return Ok(());
    }
    let what = format!(
        "the covariance is {} x {} pixels, the frames are {} x {}",
        covariance[1], covariance[0], frames[1], frames[0]
    );
    Err(Error::failed_with_hint(what, BOTH))
}

/// Error: a covariance at the channel's wavelength is not in the square of the unit of its frames.
fn same_unit<'l>(mut layers: impl Iterator<Item = &'l LayerInfo>, channel: &Channel) -> Result<(), Error> {
    let Channel { unit, wavelength_nm, .. } = channel;
    let own = |info: &&LayerInfo| info.kind == LayerKind::Covariance && info.wavelength_nm == *wavelength_nm;
    let Some(other) = layers.find(|info| own(info) && !is_square(&info.unit, unit)) else { return Ok(()) };
    let what = format!(
        "the covariance is in {}, but the frames are in {unit}, whose covariance is in {}",
        other.unit,
        squared(unit)
    );
    Err(Error::failed_with_hint(what, BOTH))
}

/// The way out of covariances of other frames.
const BOTH: &str =
    "connect frames and covariance of one stage, or leave the port `covariance` open: the frames have standard errors";
const QUANTITIES: &str = "quantities";

fn listed(attributes: &Attributes) -> Result<Vec<Quantity>, Error> {
    let listed = attributes.get(QUANTITIES).and_then(|list| serde_json::from_value(list.clone()).ok());
    listed.ok_or_else(|| Error::failed_with_hint("the covariance does not list its quantities", BOTH))
}

/// For each fringe of the channel where (dc, re, im) stand in the list.
fn places(channel: &Channel, listed: &[Quantity]) -> Result<Vec<[Option<usize>; 3]>, Error> {
    let find = |part: &str, fringe: &Fringe| {
        // A fringe's own M_DC, where it has one, before that of all.
        let own = |q: &&Quantity| q.f_x_per_mm == Some(fringe.f_x_per_mm);
        let is = |q: &&Quantity| q.is(part, fringe, channel.wavelength_nm);
        let mut order = listed.iter().filter(own).chain(listed.iter()).filter(is);
        let found = order.next().and_then(|found| listed.iter().position(|q| std::ptr::eq(q, found)));
        found.ok_or_else(|| {
            let fringe = place(Some(fringe.f_x_per_mm), fringe.orientation_deg, channel.wavelength_nm);
            let mut known: Vec<String> = listed.iter().filter(|q| q.part == part).map(Quantity::place).collect();
            known.dedup();
            let known = if known.is_empty() { "nowhere".to_owned() } else { format!("at {}", known.join("; ")) };
            Error::failed_with_hint(format!("the covariance lacks `{part}` at {fringe}: it has it {known}"), BOTH)
        })
    };
    let of = |fringe: &Fringe| {
        let (re, im) = match fringe.f_x_per_mm {
            0.0 => (None, None),
            _ => (Some(find("re", fringe)?), Some(find("im", fringe)?)),
        };
        Ok([Some(find("dc", fringe)?), re, im])
    };
    channel.fringes.iter().map(of).collect()
}

/// Error: the covariance of two quantities in use is not there.
fn complete(quantities: &[[Option<usize>; 3]], has: impl Fn(usize, usize) -> bool) -> Result<(), Error> {
    let used: Vec<usize> = quantities.iter().flatten().flatten().copied().collect();
    for &i in &used {
        for &j in used.iter().filter(|&&j| j >= i) {
            if !has(i, j) {
                let what = format!("the covariance lacks the pair of its quantities {i} and {j}");
                return Err(Error::failed_with_hint(what, BOTH));
            }
        }
    }
    Ok(())
}

fn place(f_x_per_mm: Option<f64>, orientation_deg: Option<f64>, wavelength_nm: Option<f64>) -> String {
    let f_x = f_x_per_mm.map(|f_x| format!("f_x = {f_x} mm^-1"));
    let turned = orientation_deg.filter(|&o| o != 0.0).map(|o| format!("{o} deg"));
    let light = wavelength_nm.map(|w| format!("{w} nm"));
    [f_x, turned, light].into_iter().flatten().collect::<Vec<_>>().join(", ")
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
    fn place(&self) -> String {
        place(self.f_x_per_mm, self.orientation_deg, self.wavelength_nm)
    }

    fn is(&self, part: &str, fringe: &Fringe, wavelength_nm: Option<f64>) -> bool {
        // M_DC is the same for every fringe.
        let same_fringe = part == "dc"
            || (self.f_x_per_mm == Some(fringe.f_x_per_mm)
                && Some(self.orientation_deg.unwrap_or(0.0)) == fringe.orientation_deg);
        self.part == part && same_fringe && self.wavelength_nm == wavelength_nm
    }
}
