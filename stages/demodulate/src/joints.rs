//! Whether the inputs fit: found by their forms, by the rules that a run goes by.

use turbid_contract::payload::Scene;
use turbid_contract::{Error, Form, Known, LayerInfo, Problems};

use crate::given;
use crate::params::{Method, Params};
use crate::set::channels;
use crate::snapshot::{carrier, periods, pixel_size, shots};
use crate::speckled::{by_wavelength, resolved};

/// Reports what does not fit, as far as the inputs are known.
pub fn check(params: &Params, known: &Known, problems: &mut Problems) {
    let pixel = pixel(params, known, problems);
    unread_covariance(params, known, problems);
    let Some(frames) = known.form("frames") else { return };
    let Some(layers) = &frames.layers else { return };
    let layers: Vec<&LayerInfo> = layers.iter().collect();
    let fits = match params.method {
        Method::PhaseShift => channels(&layers).map(|channels| {
            if let Some(covariance) = known.form("covariance")
                && let Err(error) = given::belongs(covariance, frames, &channels)
            {
                problems.unfit_beside(known, "covariance", "frames", error);
            }
        }),
        Method::SingleShot => single_shots(params, frames, &layers, pixel),
        Method::Speckle => by_wavelength(&layers).and_then(|_| pixel.map_or(Ok(()), |pixel| resolved(params, pixel))),
    };
    if let Err(error) = fits {
        problems.unfit(known, "frames", error);
    }
}

/// Warns of a covariance that the method does not read.
fn unread_covariance(params: &Params, known: &Known, problems: &mut Problems) {
    let noise = match params.method {
        Method::PhaseShift => return,
        Method::SingleShot => "the standard errors of the frames",
        Method::Speckle => "the spread of the frames",
    };
    if known.is_connected("covariance") {
        let (covariance, method) = (known.producer("covariance"), params.method.name());
        let message = format!("`{covariance}` is not read: `method: {method}` takes its noise from {noise}");
        let way_out = "leave the port `covariance` open, or take `method: phase_shift`, which reads it";
        problems.warn_at_input("covariance", message, way_out);
    }
}

/// The size of a pixel where it is needed and known.
fn pixel(params: &Params, known: &Known, problems: &mut Problems) -> Option<[f64; 2]> {
    let scene = known.get::<Scene>("scene");
    if params.method == Method::PhaseShift || params.pixel_mm.is_none() && scene.is_none() {
        return None;
    }
    pixel_size(params, scene.as_deref()).map_err(|error| problems.unfit(known, "scene", error)).ok()
}

fn single_shots(params: &Params, frames: &Form, layers: &[&LayerInfo], pixel: Option<[f64; 2]>) -> Result<(), Error> {
    for shot in shots(layers)?.into_iter().map(|k| layers[k]) {
        if let (Some(pixel), Some(size)) = (pixel, frames.pixels) {
            let carrier = carrier(pixel, shot, size.map(|n| n as usize))?;
            periods(params, shot, carrier, pixel)?;
        }
    }
    Ok(())
}
