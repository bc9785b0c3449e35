//! What the reflectance will hold, from the forms of its arms; and arms that do not fit, found before anything runs.

use turbid_contract::layers::{place, standard_error};
use turbid_contract::{Error, Form, Known, LayerInfo, LayerKind, Problems};

use crate::quantity::{Quantity, counterpart, lit, quantities, same_size, same_wavelengths};

/// Reports arms that show different quantities, or images of different sizes; warns where one arm alone knows its standard errors.
pub fn check(known: &Known, problems: &mut Problems) {
    let (sample, reference) = (known.form("sample"), known.form("reference"));
    let pixels = sample.and_then(|form| form.pixels).zip(reference.and_then(|form| form.pixels));
    if let Some(Err(error)) = pixels.map(|(sample, reference)| same_size(sample, reference)) {
        problems.unfit(known, "reference", error);
    }
    let Some((sample, layers)) = with_layers(sample) else { return };
    let wavelengths = match lit(layers) {
        Ok(wavelengths) => wavelengths,
        Err(error) => return problems.unfit(known, "sample", error),
    };
    let Some((reference, others)) = with_layers(reference) else { return };
    match same_wavelengths(layers, others) {
        Err(error) => return problems.unfit(known, "reference", error),
        Ok(Some(unused)) => problems.warn_at_input("reference", unused, "they are left out"),
        Ok(None) => {}
    }
    for q in wavelengths.into_iter().flat_map(|wavelength| quantities(layers, wavelength)) {
        let wanted = &layers[q.layer];
        match counterpart(others, wanted) {
            Err(error) => problems.unfit(known, "reference", error),
            Ok(found) if stands_in(wanted, &others[found]) => {
                let [of, by] = ["sample", "reference"].map(|port| known.producer(port));
                let message = format!(
                    "`{by}` at {} stands beside `{of}` at {}: the mean of fringes and even light are taken for one",
                    place(&others[found]),
                    place(wanted)
                );
                let way_out = "right where even light is half of the full light, as fringes are in the mean; else take both arms with a frame at f_x = 0, or both without";
                problems.warn_at_input("reference", message, way_out);
            }
            Ok(found) => match (sample.has_error_of(wanted), reference.has_error_of(&others[found])) {
                (Some(true), Some(false)) => return one_arm_knows(known, ["sample", "reference"], wanted, problems),
                (Some(false), Some(true)) => return one_arm_knows(known, ["reference", "sample"], wanted, problems),
                _ => {}
            },
        }
    }
}

/// Whether one is of even light and the other the mean of fringes.
fn stands_in(wanted: &LayerInfo, found: &LayerInfo) -> bool {
    let even = |info: &LayerInfo| info.f_x_per_mm.unwrap_or(0.0) == 0.0;
    even(wanted) != even(found)
}

/// A form whose layers are known, with them.
fn with_layers(form: Option<&Form>) -> Option<(&Form, &[LayerInfo])> {
    form.and_then(|form| Some((form, form.layers.as_deref()?)))
}

/// The first port knows the standard error of the quantity `of`, the second does not.
fn one_arm_knows(known: &Known, [knows, lacks]: [&str; 2], of: &LayerInfo, problems: &mut Problems) {
    let [knows, lacking] = [knows, lacks].map(|port| known.producer(port));
    let at = place(of);
    let message = format!(
        "`{lacking}` has no standard error of {} at {at}, `{knows}` has one: the reflectance will have none",
        of.name
    );
    let way_out = "say the noise of the camera that took these frames (`full_well` of import_frames), or connect their `covariance` to demodulate";
    problems.warn_at_input(lacks, message, way_out);
}

/// The form of the reflectance, but for its attributes.
pub fn reflectance(known: &Known) -> Form {
    let pixels = known.form("sample").and_then(|form| form.pixels);
    match layers(known) {
        Ok((layers, perhaps)) => {
            let mut form = Form { pixels, layers: Some(layers), perhaps, ..Form::default() };
            known.form("sample").into_iter().for_each(|sample| form.carry_conditions(sample));
            form
        }
        Err(_) => Form { pixels, ..Form::default() },
    }
}

/// Layers that are there, and those that a run may find. Error: one of the arms is open, or does not fit.
fn layers(known: &Known) -> Result<(Vec<LayerInfo>, Vec<LayerInfo>), Error> {
    let open = || Error::failed("not known yet");
    let of = |port: &str| known.form(port).and_then(|form| form.layers.as_deref()).ok_or_else(open);
    let (sample, reference) = (of("sample")?, of("reference")?);
    let (mut values, mut errors, mut covariances, mut masks) = (vec![], vec![], vec![], vec![]);
    for wavelength_nm in lit(sample)? {
        let found = quantities(sample, wavelength_nm);
        let mut known_errors = true;
        for Quantity { layer, .. } in &found {
            let other = counterpart(reference, &sample[*layer])?;
            known_errors &= standard_error(sample, &sample[*layer]).is_some();
            known_errors &= standard_error(reference, &reference[other]).is_some();
        }
        let first = values.len() as u32;
        values.extend(found.iter().map(|q| r_d(&sample[q.layer], q.f_x_per_mm)));
        if known_errors {
            errors.extend(values[first as usize..].iter().map(LayerInfo::standard_error));
            let count = found.len() as u32;
            for (a, b) in (0..count).flat_map(|a| (a + 1..count).map(move |b| (a, b))) {
                let mut info = LayerInfo::new("cov", LayerKind::Covariance, "1");
                (info.pair, info.wavelength_nm) = (Some([first + a, first + b]), wavelength_nm);
                covariances.push(info);
            }
        }
        let mut mask = LayerInfo::new("mask", LayerKind::Mask, "1");
        mask.wavelength_nm = wavelength_nm;
        masks.push(mask);
    }
    let perhaps = if errors.is_empty() { vec![] } else { values.iter().map(LayerInfo::se_unknown).collect() };
    Ok((values.into_iter().chain(errors).chain(covariances).chain(masks).collect(), perhaps))
}

/// R_d at `f_x_per_mm`, of a layer of the sample.
pub fn r_d(of: &LayerInfo, f_x_per_mm: f64) -> LayerInfo {
    let mut info = LayerInfo::value("r_d", "1").with_f_x(f_x_per_mm);
    info.orientation_deg = of.orientation_deg.filter(|_| f_x_per_mm > 0.0);
    info.wavelength_nm = of.wavelength_nm;
    info
}
