//! What a camera's frames, numbers and covariance will hold, by the form of the ideal frames.

use turbid_contract::joint::pixel_pitch_of;
use turbid_contract::{Form, Forms, Known, LayerInfo, LayerKind, Problems};

use crate::covariance::Combined;

/// The layers of the frames in their order: values, then their standard errors. A camera knows those of its own.
pub fn frame_layers(values: &[&LayerInfo]) -> Vec<LayerInfo> {
    let errors = values.iter().map(|info| info.standard_error());
    values.iter().map(|info| LayerInfo { mean_se: None, ..(*info).clone() }).chain(errors).collect()
}

/// The layer of a memory card's numbers.
pub fn number_layer(info: &LayerInfo) -> LayerInfo {
    LayerInfo { unit: "1".into(), mean_se: None, ..info.clone() }
}

/// The mask of a wavelength: there where a pixel is bad.
pub fn mask(wavelength_nm: Option<f64>) -> LayerInfo {
    LayerInfo { wavelength_nm, ..LayerInfo::new("mask", LayerKind::Mask, "1") }
}

pub fn describe(known: &Known) -> Forms {
    let Some(ideal) = known.form("frames") else { return Forms::new() };
    let pitch = pixel_pitch_of(&ideal.attributes);
    let of_size = |attributes| Form { pixels: ideal.pixels, attributes, ..Form::default() };
    let [mut frames, mut covariance] = [of_size(ideal.attributes.clone()), of_size(pitch.clone())];
    let mut numbers = of_size(pitch);
    // Where the layers of the ideal frames are open, these are.
    if let Some(values) = ideal.values() {
        frames.layers = Some(frame_layers(&values));
        frames.perhaps = perhaps(ideal, &values);
        frames.carry_conditions(ideal);
        numbers.layers = Some(values.iter().copied().map(number_layer).collect());
        if let Ok(combined) = Combined::of(&values) {
            covariance.layers = Some(combined.layers());
            covariance.attributes.extend(combined.listed());
        }
    }
    Forms::from([("frames", frames), ("covariance", covariance), ("numbers", numbers)])
}

/// Masks where a pixel is bad, and flags where the light comes from pixels whose error the ideal frames do not know.
fn perhaps(ideal: &Form, values: &[&LayerInfo]) -> Vec<LayerInfo> {
    let mut masks: Vec<LayerInfo> = Vec::new();
    for mask in values.iter().map(|info| mask(info.wavelength_nm)) {
        if !masks.contains(&mask) {
            masks.push(mask);
        }
    }
    let flagged = values.iter().filter(|info| ideal.may_flag(info));
    masks.into_iter().chain(flagged.map(|info| info.se_unknown())).collect()
}

/// Reports inputs that do not fit.
pub fn check(known: &Known, problems: &mut Problems) {
    let Some(frames) = known.form("frames") else { return };
    let Some(values) = frames.values() else { return };
    // Frames alone go through a camera whatever they show.
    if !known.is_wanted("covariance") {
        return;
    }
    match Combined::of(&values) {
        Err(error) => problems.unfit(known, "frames", error),
        Ok(combined) => {
            if let Some(covariance) = known.form("covariance")
                && let Err(error) = combined.belongs(covariance, frames)
            {
                problems.unfit_beside(known, "covariance", "frames", error);
            }
        }
    }
}
