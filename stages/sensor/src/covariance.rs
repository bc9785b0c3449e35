//! Covariance behind frames that a camera has seen: that of the light, spread by the defocus, and the camera's own noise,
//! which is independent from frame to frame.

use turbid_contract::layers::{is_square, squared};
use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{Covariance, Rig};
use turbid_contract::serde_json::{self, Value, json};
use turbid_contract::{Attributes, Error, Form, ImageStack, LayerInfo, LayerKind};
use turbid_optics::sinusoid;

use crate::blur::Blur;

/// Frames of one spatial frequency, orientation and wavelength.
struct Fringe {
    f_x_per_mm: f64,
    orientation_deg: Option<f64>,
    wavelength_nm: Option<f64>,
    unit: String,
    /// Indices among the value layers, and their phases.
    frames: Vec<usize>,
    phases_rad: Vec<f64>,
}

/// One quantity: a linear combination of the frames of a fringe.
struct Quantity {
    fringe: usize,
    part: &'static str,
    weights: Vec<f64>,
}

/// The quantities that frames are combined to.
pub struct Combined {
    fringes: Vec<Fringe>,
    quantities: Vec<Quantity>,
}

impl Combined {
    /// Errors: frames that do not say f_x or phase, or too few of them.
    pub fn of(frames: &[&LayerInfo]) -> Result<Self, Error> {
        let fringes = fringes(frames)?;
        let mut quantities = Vec::new();
        for (fringe, f) in fringes.iter().enumerate() {
            if f.f_x_per_mm == 0.0 {
                let weights = vec![1.0 / f.frames.len() as f64; f.frames.len()];
                quantities.push(Quantity { fringe, part: "dc", weights });
                continue;
            }
            let weights = sinusoid::weights(&f.phases_rad).ok_or_else(|| {
                Error::failed_with_hint(
                    format!("{} phases at f_x = {} mm^-1 do not fix a sinusoid", f.phases_rad.len(), f.f_x_per_mm),
                    "leave the port `covariance` open, or take three phases or more",
                )
            })?;
            let parts = ["dc", "re", "im"].into_iter().zip(weights);
            quantities.extend(parts.map(|(part, weights)| Quantity { fringe, part, weights }));
        }
        Ok(Self { fringes, quantities })
    }

    /// The layers of their covariance in their order; the indices of a layer's two quantities are its `pair`.
    pub fn layers(&self) -> Vec<LayerInfo> {
        let count = self.quantities.len();
        let of = |i: usize| &self.fringes[self.quantities[i].fringe];
        let light = |i: usize| of(i).wavelength_nm;
        let pairs = (0..count).flat_map(|i| (i..count).map(move |j| [i, j]));
        let same = pairs.filter(|&[i, j]| light(i) == light(j));
        let info = |[i, j]: [usize; 2]| {
            let info = LayerInfo::new("cov", LayerKind::Covariance, squared(&of(i).unit));
            LayerInfo { pair: Some([i as u32, j as u32]), wavelength_nm: light(i), ..info }
        };
        same.map(info).collect()
    }

    /// The attribute that lists them.
    pub fn listed(&self) -> Attributes {
        let listed = self.quantities.iter().map(|q| described(q, &self.fringes[q.fringe])).collect();
        Attributes::from([(QUANTITIES.to_owned(), Value::Array(listed))])
    }

    /// Whether a covariance belongs to frames of this form, as far as the forms tell.
    ///
    /// Errors: another size, rig or unit; a quantity or a pair of them is missing.
    pub fn belongs(&self, covariance: &Form, frames: &Form) -> Result<(), Error> {
        if let (Some(covariance), Some(frames)) = (covariance.pixels, frames.pixels) {
            same_size(covariance, frames)?;
        }
        Rig::shared(&frames.attributes, &covariance.attributes)?;
        if covariance.attribute(QUANTITIES).is_none() {
            return Ok(());
        }
        let source = sources(&covariance.attributes, &self.fringes, &self.quantities)?;
        let Some(layers) = &covariance.layers else { return Ok(()) };
        for info in self.layers() {
            let found = place(layers.iter(), &source, &info)?;
            self.same_unit(&layers[found], &info)?;
        }
        Ok(())
    }

    /// Error: a given covariance that is not in the square of the unit of its frames; `info`: what is made of it.
    fn same_unit(&self, given: &LayerInfo, info: &LayerInfo) -> Result<(), Error> {
        let [first, _] = info.pair.expect("of two quantities");
        let unit = &self.fringes[self.quantities[first as usize].fringe].unit;
        if is_square(&given.unit, unit) {
            return Ok(());
        }
        let (is, wanted) = (&given.unit, &info.unit);
        let what = format!("the covariance is in {is}, but the frames are in {unit}, whose covariance is in {wanted}");
        Err(Error::failed_with_hint(what, BOTH))
    }
}

const QUANTITIES: &str = "quantities";

/// The way out of covariances of other frames.
const BOTH: &str = "connect frames and covariance of one stage, or leave the port `covariance` open";

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

/// Where the layer stands that the covariance `info` of two quantities is made of; `source`: their indices there.
fn place<'l>(
    mut layers: impl Iterator<Item = &'l LayerInfo>,
    source: &[usize],
    info: &LayerInfo,
) -> Result<usize, Error> {
    let [i, j] = info.pair.expect("of two quantities").map(|k| source[k as usize]);
    let wanted = [i.min(j) as u32, i.max(j) as u32];
    layers.position(|layer| layer.pair == Some(wanted)).ok_or_else(|| {
        Error::failed_with_hint(format!("the covariance lacks the pair of its quantities {i} and {j}"), BOTH)
    })
}

/// The covariance of (dc, re, im) of each fringe. `variances[k]` is what counts as independent noise of frame k: all of it where there is no
/// `given` covariance, else only what the camera added. The given one is spread by the blur and scaled by the square of the
/// pixels' response. Pixels with `bad` set hold 0.
///
/// Errors: frames that do not say f_x or phase, or too few of them; a covariance of another size or unit, or one that lacks what the frames
/// need.
pub fn covariance(
    frames: &[&LayerInfo],
    variances: &[Vec<f64>],
    bad: &[bool],
    (rows, columns): (usize, usize),
    given: Option<(&Covariance, &Blur, &[f64])>,
) -> Result<Covariance, Error> {
    let combined = Combined::of(frames)?;
    let Combined { fringes, quantities } = &combined;
    let source = given.map(|(Covariance(given), ..)| {
        same_size([given.rows(), given.columns()].map(|n| n as u64), [rows, columns].map(|n| n as u64))?;
        sources(&given.attributes, fringes, quantities)
    });
    let source = source.transpose()?;
    let mut stack = ImageStack::new(rows, columns);
    for info in combined.layers() {
        let [a, b] = info.pair.expect("of two quantities").map(|k| &quantities[k as usize]);
        let fringe = &fringes[a.fringe];
        let mut plane = vec![0.0; rows * columns];
        if let (Some((Covariance(given), blur, response)), Some(source)) = (given, &source) {
            let layer = &given.layers[place(given.layers.iter().map(|layer| &layer.info), source, &info)?];
            combined.same_unit(&layer.info, &info)?;
            plane.iter_mut().zip(layer.pixels().iter()).for_each(|(p, &c)| *p = f64::from(c));
            blur.apply(&mut plane, columns);
            plane.iter_mut().zip(response).for_each(|(p, r)| *p *= r * r);
        }
        if a.fringe == b.fringe {
            for (n, &frame) in fringe.frames.iter().enumerate() {
                let weight = a.weights[n] * b.weights[n];
                plane.iter_mut().zip(&variances[frame]).for_each(|(p, v)| *p += weight * v);
            }
        }
        plane.iter_mut().zip(bad).filter(|(_, bad)| **bad).for_each(|(p, _)| *p = 0.0);
        let pixels = plane.iter().map(|&p| p as f32).collect();
        stack.push(info, Array2::from_shape_vec((rows, columns), pixels).expect("one number per pixel"));
    }
    stack.attributes.extend(combined.listed());
    Ok(Covariance(stack))
}

fn described(quantity: &Quantity, fringe: &Fringe) -> Value {
    let mut said = json!({"part": quantity.part, "f_x_per_mm": fringe.f_x_per_mm, "orientation_deg": fringe.orientation_deg.unwrap_or(0.0)});
    if let Some(w) = fringe.wavelength_nm {
        said["wavelength_nm"] = json!(w);
    }
    said
}

const CARRIED: &str = "frames carry f_x_per_mm and phase_rad in their layers";

fn fringes(frames: &[&LayerInfo]) -> Result<Vec<Fringe>, Error> {
    let mut fringes: Vec<Fringe> = Vec::new();
    for (k, info) in frames.iter().enumerate() {
        let f_x = info.f_x_per_mm;
        let f_x = f_x.ok_or_else(|| Error::failed_with_hint(format!("frame {k} does not say its f_x"), CARRIED))?;
        let phase = match (f_x, info.phase_rad) {
            (0.0, phase) => phase.unwrap_or(0.0),
            (_, Some(phase)) => phase,
            _ => {
                let what = format!("frame {k} at f_x = {f_x} mm^-1 does not say its phase");
                return Err(Error::failed_with_hint(what, CARRIED));
            }
        };
        let same = |f: &&mut Fringe| {
            f.f_x_per_mm == f_x && f.orientation_deg == info.orientation_deg && f.wavelength_nm == info.wavelength_nm
        };
        match fringes.iter_mut().find(same) {
            Some(fringe) => {
                fringe.frames.push(k);
                fringe.phases_rad.push(phase);
            }
            None => fringes.push(Fringe {
                f_x_per_mm: f_x,
                orientation_deg: info.orientation_deg,
                wavelength_nm: info.wavelength_nm,
                unit: info.unit.clone(),
                frames: vec![k],
                phases_rad: vec![phase],
            }),
        }
    }
    Ok(fringes)
}

/// For each quantity its index in the given covariance; M_DC of all fringes may be one.
fn sources(given: &Attributes, fringes: &[Fringe], quantities: &[Quantity]) -> Result<Vec<usize>, Error> {
    let listed: Vec<Value> = given
        .get(QUANTITIES)
        .and_then(|list| serde_json::from_value(list.clone()).ok())
        .ok_or_else(|| Error::failed_with_hint("the covariance does not list its quantities", BOTH))?;
    let number = |said: &Value, name: &str| said.get(name).and_then(Value::as_f64);
    let find = |quantity: &Quantity| {
        let fringe = &fringes[quantity.fringe];
        let part = |said: &&Value| {
            said.get("part").and_then(Value::as_str) == Some(quantity.part)
                && number(said, "wavelength_nm") == fringe.wavelength_nm
        };
        let own = |said: &&Value| {
            number(said, "f_x_per_mm") == Some(fringe.f_x_per_mm)
                && (fringe.f_x_per_mm == 0.0
                    || number(said, "orientation_deg").unwrap_or(0.0) == fringe.orientation_deg.unwrap_or(0.0))
        };
        let found = listed.iter().position(|said| part(&said) && own(&said));
        found.or_else(|| listed.iter().position(|said| part(&said) && quantity.part == "dc")).ok_or_else(|| {
            let light = |w: Option<f64>| w.map_or(String::new(), |w| format!(" of {w} nm"));
            let own = listed.iter().filter(|said| said.get("part").and_then(Value::as_str) == Some(quantity.part));
            let f_x = |said: &Value| {
                let f_x = number(said, "f_x_per_mm").map_or_else(|| "?".to_owned(), |f| f.to_string());
                format!("{f_x} mm^-1{}", light(number(said, "wavelength_nm")))
            };
            let known: Vec<String> = own.map(f_x).collect();
            let known = if known.is_empty() { "nowhere".to_owned() } else { format!("at {}", known.join(", ")) };
            let what = format!(
                "the covariance lacks `{}` at f_x = {} mm^-1{}: it has it {known}",
                quantity.part,
                fringe.f_x_per_mm,
                light(fringe.wavelength_nm)
            );
            Error::failed_with_hint(what, BOTH)
        })
    };
    quantities.iter().map(find).collect()
}
