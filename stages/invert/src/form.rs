//! What maps, their covariance and the exposure will hold, from the forms of reflectance and table.

use turbid_contract::layers::standard_error;
use turbid_contract::pitch::{PIXEL_PITCH_MM, PIXEL_PITCH_RAD};
use turbid_contract::{Attributes, Form, Forms, Known, LayerInfo, LayerKind, serde_json};

use crate::choice::{Choice, choose};
use crate::params::{Outside, Params};

/// The forms of all outputs. Attributes of the maps are those of the reflectance, with the f_x that were read.
pub fn describe(params: &Params, known: &Known) -> Forms {
    let mut attributes = known.fact("reflectance");
    attributes.remove("f_x");
    let pixels = known.form("reflectance").and_then(|form| form.pixels);
    let layers = known.form("reflectance").and_then(|form| form.layers.as_deref());
    let chosen = layers.and_then(|layers| Some((layers, choose(layers, params).ok()?)));
    let Some((layers, choice)) = chosen else {
        return Forms::from([("maps", Form { pixels, ..Form::said(attributes) })]);
    };
    attributes.insert("f_x".to_owned(), choice.f_x.clone().into());
    let pitch = |name: &&str| Some(((*name).to_owned(), attributes.get(*name)?.clone()));
    let pitch: Attributes = [PIXEL_PITCH_MM, PIXEL_PITCH_RAD].iter().filter_map(pitch).collect();
    let mut forms = Forms::new();
    let images =
        |(layers, perhaps), attributes| Form { pixels, layers: Some(layers), perhaps, attributes, ..Form::default() };
    if known.is_connected("height") {
        forms.insert("exposure", images((exposure(&choice.f_x), Vec::new()), pitch));
    }
    let mut of_covariance = attributes.clone();
    of_covariance.insert("quantities".to_owned(), quantities());
    forms.insert("covariance", images((covariance(layers, &choice), Vec::new()), of_covariance));
    forms.insert("maps", images(maps(layers, &choice, params), attributes));
    forms
}

/// The attribute `quantities` of the covariance.
pub fn quantities() -> serde_json::Value {
    serde_json::json!([{"part": "mu_a"}, {"part": "mu_s_prime"}])
}

/// mu_a or mu_s' at a wavelength.
pub fn property(name: &str, wavelength_nm: Option<f64>) -> LayerInfo {
    let mut info = LayerInfo::value(name, "mm^-1");
    info.wavelength_nm = wavelength_nm;
    info
}

/// Whether the standard errors of all layers that are read are there.
pub fn errors_known(layers: &[LayerInfo], places: &[usize]) -> bool {
    places.iter().all(|&k| standard_error(layers, &layers[k]).is_some())
}

fn mask(wavelength_nm: Option<f64>) -> LayerInfo {
    LayerInfo { wavelength_nm, ..LayerInfo::new("mask", LayerKind::Mask, "1") }
}

/// Layers that are there, and flags of unknown errors, which a run may find.
fn maps(layers: &[LayerInfo], choice: &Choice, params: &Params) -> (Vec<LayerInfo>, Vec<LayerInfo>) {
    let (mut values, mut others, mut perhaps) = (Vec::new(), Vec::new(), Vec::new());
    for &(wavelength_nm, ref places) in &choice.of {
        let own = ["mu_a", "mu_s_prime"].map(|name| property(name, wavelength_nm));
        if errors_known(layers, places) {
            others.extend(own.iter().map(LayerInfo::standard_error));
            perhaps.extend(own.iter().map(LayerInfo::se_unknown));
        }
        values.extend(own);
        if params.outside == Outside::Nearest {
            others.push(LayerInfo { wavelength_nm, ..LayerInfo::value("outside", "1") });
        }
        others.push(mask(wavelength_nm));
    }
    (values.into_iter().chain(others).collect(), perhaps)
}

fn covariance(layers: &[LayerInfo], choice: &Choice) -> Vec<LayerInfo> {
    let (mut values, mut masks) = (Vec::new(), Vec::new());
    for &(wavelength_nm, ref places) in &choice.of {
        if errors_known(layers, places) {
            values.extend([[0, 0], [0, 1], [1, 1]].map(|pair| LayerInfo {
                pair: Some(pair),
                wavelength_nm,
                ..LayerInfo::new("cov", LayerKind::Covariance, "mm^-2")
            }));
            masks.push(mask(wavelength_nm));
        }
    }
    values.into_iter().chain(masks).collect()
}

fn exposure(f_x: &[f64]) -> Vec<LayerInfo> {
    let modulated = f_x.iter().filter(|&&f| f > 0.0);
    let mut layers = vec![LayerInfo::value("irradiance", "1")];
    layers.extend(modulated.map(|&f| LayerInfo::value("f_surface", "mm^-1").with_f_x(f)));
    layers.extend([LayerInfo::value("incidence", "rad"), LayerInfo::value("view", "rad"), mask(None)]);
    layers
}
