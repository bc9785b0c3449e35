//! What imported frames will hold.

use turbid_contract::payload::{CONDITIONS, Rig};
use turbid_contract::pitch::PIXEL_PITCH_MM;
use turbid_contract::{Attributes, Form, Forms, Known, LayerInfo, LayerKind};

use crate::decode::size;
use crate::params::{Params, Shot};

/// What the layer of a file says.
pub fn layer(params: &Params, shot: &Shot) -> LayerInfo {
    // Numbers by exposure time are of another unit than numbers: arms that differ in it are not calibrated with each other.
    let unit = match (params.full_scale, shot.exposure_ms) {
        (Some(_), _) => "W mm^-2 sr^-1",
        (None, Some(_)) => "ms^-1",
        (None, None) => "1",
    };
    let mut info = LayerInfo::value("radiance", unit).with_f_x(shot.f_x);
    info.phase_rad = shot.phase_rad;
    info.orientation_deg = (shot.f_x > 0.0).then_some(shot.orientation_deg);
    info.wavelength_nm = shot.wavelength_nm;
    info
}

/// The mask of a wavelength: there where a pixel is bad.
pub fn mask(wavelength_nm: Option<f64>) -> LayerInfo {
    LayerInfo { wavelength_nm, ..LayerInfo::new("mask", LayerKind::Mask, "1") }
}

/// What the params say of the frames.
pub fn said(params: &Params) -> Attributes {
    let mut attributes = Attributes::new();
    if let Some(pixel) = params.pixel_mm {
        attributes.insert(PIXEL_PITCH_MM.to_owned(), vec![pixel.0 * f64::from(params.bin); 2].into());
    }
    if let Some(name) = &params.rig {
        Rig::named(name.trim()).insert_into(&mut attributes);
    }
    if let Some(conditions) = &params.conditions {
        conditions.said().insert_into(&mut attributes, CONDITIONS);
    }
    attributes
}

/// The size of the frames is that of the first file; it is open where its header cannot be read.
pub fn describe(params: &Params, known: &Known) -> Forms {
    let shots = params.shots();
    let values: Vec<LayerInfo> = shots.iter().map(|shot| layer(params, shot)).collect();
    // Only a camera whose noise is known has standard errors.
    let noise = params.full_well.is_some() || known.is_connected("transfer");
    let errors: Vec<LayerInfo> =
        if noise { values.iter().map(LayerInfo::standard_error).collect() } else { Vec::new() };
    let mut masks: Vec<LayerInfo> = Vec::new();
    for mask in shots.iter().map(|shot| mask(shot.wavelength_nm)) {
        if !masks.contains(&mask) {
            masks.push(mask);
        }
    }
    let first = shots.first().and_then(|shot| Some((shot.variable.as_deref(), known.files.get(&shot.at)?)));
    let whole = first.and_then(|(variable, bytes)| size(&bytes, variable, params.raw).ok());
    let pixels = whole.map(|(columns, rows)| {
        let (columns, rows) = params.crop.map_or((columns, rows), |[_, _, w, h]| (w as usize, h as usize));
        [rows, columns].map(|n| n as u64 / u64::from(params.bin.max(1)))
    });
    let layers = Some([values, errors].concat());
    Forms::from([("frames", Form { pixels, layers, perhaps: masks, ..Form::said(said(params)) })])
}
