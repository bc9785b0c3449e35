//! What heights and normals will hold; and phases that do not fit the scene, found before anything runs.

use turbid_contract::layers::{size, standard_error};
use turbid_contract::payload::{Rig, Scene};
use turbid_contract::{Attributes, Error, Form, Forms, Known, LayerInfo, LayerKind, Problems, serde_json};

use crate::params::Params;
use crate::phase::{choose, counterpart};

/// Reports phases without the fringes that are asked for, and images of another camera than the scene's.
pub fn check(params: &Params, known: &Known, problems: &mut Problems) {
    let layers = |port: &str| known.form(port).and_then(|form| form.layers.as_deref());
    if let Some(sample) = layers("sample") {
        match (choose(sample, params), layers("reference")) {
            (Err(error), _) => problems.unfit(known, "sample", error),
            (Ok((places, _)), Some(reference)) => {
                match places
                    .iter()
                    .map(|&k| Ok((k, counterpart(reference, &sample[k])?)))
                    .collect::<Result<Vec<_>, _>>()
                {
                    Err(error) => problems.unfit(known, "reference", error),
                    Ok(pairs) => pairs.last().into_iter().for_each(|&pair| errors_of_one(known, pair, problems)),
                }
            }
            (Ok(_), None) => {}
        }
    }
    if let Err(error) = Rig::shared(&known.fact("sample"), &known.fact("reference")) {
        problems.unfit_beside(known, "reference", "sample", error);
    }
    let scene = known.get::<Scene>("scene");
    let Some([columns, rows]) = scene.as_ref().and_then(|s| Some(s.camera.as_ref()?.pixels.map(u64::from))) else {
        return;
    };
    for port in ["sample", "reference"] {
        let pixels = known.form(port).and_then(|form| form.pixels);
        if let Some(pixels) = pixels.filter(|pixels| *pixels != [rows, columns]) {
            let what = format!("it has {}, the camera of the scene {}", size(pixels), size([rows, columns]));
            let way_out = "connect the scene whose camera took the frames";
            problems.unfit(known, port, Error::failed_with_hint(what, way_out));
        }
    }
}

/// Warns where one phase alone knows its standard error; `pair`: the places of sample and reference.
fn errors_of_one(known: &Known, pair: (usize, usize), problems: &mut Problems) {
    let has = |port: &str, place: usize| {
        let form = known.form(port)?;
        form.has_error_of(form.layers.as_ref()?.get(place)?)
    };
    let (lacks, knows, so) = match (has("sample", pair.0), has("reference", pair.1)) {
        (Some(true), Some(false)) => ("reference", "sample", "those of the heights leave its noise out"),
        (Some(false), Some(true)) => ("sample", "reference", "the heights have none"),
        _ => return,
    };
    let [lacking, knowing] = [lacks, knows].map(|port| known.producer(port));
    let message = format!("`{lacking}` has no standard errors, `{knowing}` has: {so}");
    let way_out = "say the noise of the camera that took these frames (`full_well` of import_frames), or connect their `covariance` to demodulate";
    problems.warn_at_input(lacks, message, way_out);
}

/// The forms of all outputs.
pub fn describe(params: &Params, known: &Known) -> Forms {
    let scene = known.get::<Scene>("scene");
    let camera = scene.as_ref().and_then(|scene| scene.camera.as_ref());
    let pixels = camera.map(|camera| camera.pixels.map(u64::from)).map(|[columns, rows]| [rows, columns]);
    let attributes: Attributes = camera.map_or_else(Attributes::new, |camera| {
        let (name, pitch) = camera.pixel_pitch();
        [(name.to_owned(), serde_json::json!(pitch))].into()
    });
    let height = LayerInfo::value("height", "mm");
    let mask = LayerInfo::new("mask", LayerKind::Mask, "1");
    let errors = known.form("sample").and_then(|form| form.layers.as_deref()).and_then(|sample| {
        let (places, _) = choose(sample, params).ok()?;
        Some(standard_error(sample, &sample[*places.last()?]).is_some())
    });
    let layers = errors.map(|errors| {
        let se = errors.then(|| height.standard_error());
        [height.clone()].into_iter().chain(se).chain([mask.clone()]).collect()
    });
    let perhaps = if errors == Some(true) { vec![height.se_unknown()] } else { Vec::new() };
    let images = |layers, perhaps| Form { pixels, layers, perhaps, attributes: attributes.clone(), ..Form::default() };
    let normals = ["normal_x", "normal_y", "normal_z"].map(|name| LayerInfo::value(name, "1"));
    let normals = normals.into_iter().chain([mask]).collect();
    Forms::from([("height", images(layers, perhaps)), ("normals", images(Some(normals), Vec::new()))])
}
