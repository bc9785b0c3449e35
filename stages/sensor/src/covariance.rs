//! Covariance behind frames that a camera has seen: that of the light, spread by the defocus, and the camera's own noise,
//! which is independent from frame to frame.

use turbid_contract::ndarray::Array2;
use turbid_contract::payload::Covariance;
use turbid_contract::serde_json::{self, Value, json};
use turbid_contract::{Error, ImageStack, LayerInfo, LayerKind};
use turbid_optics::sinusoid;

use crate::blur::Blur;

/// Frames of one spatial frequency, orientation and wavelength.
struct Fringe {
    f_x_per_mm: f64,
    orientation_deg: Option<f64>,
    wavelength_nm: Option<f64>,
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

/// The covariance of (dc, re, im) of each fringe. `variances[k]` is what counts as independent noise of frame k: all of it where there is no
/// `given` covariance, else only what the camera added. The given one is spread by the blur and scaled by the square of the
/// pixels' response. Pixels with `bad` set hold 0.
///
/// Errors: frames that do not say f_x or phase, or too few of them; a covariance that lacks what the frames need.
pub fn covariance(
    frames: &[&LayerInfo],
    variances: &[Vec<f64>],
    bad: &[bool],
    (rows, columns): (usize, usize),
    given: Option<(&Covariance, &Blur, &[f64])>,
) -> Result<Covariance, Error> {
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
    let source = given.map(|(given, ..)| sources(given, &fringes, &quantities)).transpose()?;
    let mut stack = ImageStack::new(rows, columns);
    for i in 0..quantities.len() {
        for j in i..quantities.len() {
            let (a, b) = (&quantities[i], &quantities[j]);
            let (fringe, other) = (&fringes[a.fringe], &fringes[b.fringe]);
            if fringe.wavelength_nm != other.wavelength_nm {
                continue;
            }
            let mut plane = vec![0.0; rows * columns];
            if let (Some((Covariance(given), blur, response)), Some(source)) = (given, &source) {
                let wanted = [source[i].min(source[j]) as u32, source[i].max(source[j]) as u32];
                let layer = given.layers.iter().find(|l| l.info.pair == Some(wanted));
                let layer = layer.ok_or_else(|| Error::failed(format!("the covariance lacks the pair {wanted:?}")))?;
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
            let mut info = LayerInfo::new("cov", LayerKind::Covariance, "W^2 mm^-4 sr^-2");
            info.pair = Some([i as u32, j as u32]);
            info.wavelength_nm = fringe.wavelength_nm;
            let pixels = plane.iter().map(|&p| p as f32).collect();
            stack.push(info, Array2::from_shape_vec((rows, columns), pixels).expect("one number per pixel"));
        }
    }
    let listed: Vec<Value> = quantities.iter().map(|q| described(q, &fringes[q.fringe])).collect();
    stack.attributes.insert("quantities".to_owned(), Value::Array(listed));
    Ok(Covariance(stack))
}

fn described(quantity: &Quantity, fringe: &Fringe) -> Value {
    let mut said = json!({"part": quantity.part, "f_x_per_mm": fringe.f_x_per_mm, "orientation_deg": fringe.orientation_deg.unwrap_or(0.0)});
    if let Some(w) = fringe.wavelength_nm {
        said["wavelength_nm"] = json!(w);
    }
    said
}

fn fringes(frames: &[&LayerInfo]) -> Result<Vec<Fringe>, Error> {
    let mut fringes: Vec<Fringe> = Vec::new();
    for (k, info) in frames.iter().enumerate() {
        let f_x = info.f_x_per_mm.ok_or_else(|| Error::failed(format!("frame {k} does not say its f_x")))?;
        let phase = match (f_x, info.phase_rad) {
            (0.0, phase) => phase.unwrap_or(0.0),
            (_, Some(phase)) => phase,
            _ => return Err(Error::failed(format!("frame {k} at f_x = {f_x} mm^-1 does not say its phase"))),
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
                frames: vec![k],
                phases_rad: vec![phase],
            }),
        }
    }
    Ok(fringes)
}

/// For each quantity its index in the given covariance; M_DC of all fringes may be one.
fn sources(Covariance(given): &Covariance, fringes: &[Fringe], quantities: &[Quantity]) -> Result<Vec<usize>, Error> {
    let listed: Vec<Value> = given
        .attributes
        .get("quantities")
        .and_then(|list| serde_json::from_value(list.clone()).ok())
        .ok_or_else(|| Error::failed("the covariance does not list its quantities"))?;
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
            Error::failed(format!("the covariance lacks `{}` at f_x = {} mm^-1", quantity.part, fringe.f_x_per_mm))
        })
    };
    quantities.iter().map(find).collect()
}
