//! Whether reflectance, table, sections and shape belong together: the rules of the run, found before anything runs.

use turbid_contract::layers::{size, wavelengths};
use turbid_contract::payload::{Rig, Scene};
use turbid_contract::{Attributes, Error, Form, Known, Problems};

use crate::choice::{choose, orientation};
use crate::form::errors_known;
use crate::lut::{places, same_meaning, table_f_x, unused};
use crate::params::Params;

/// Reports every joint that does not fit.
pub fn check(params: &Params, known: &Known, problems: &mut Problems) {
    let (reflectance, lut) = (known.fact("reflectance"), known.fact("lut"));
    let layers = known.form("reflectance").and_then(|form| form.layers.as_deref());
    let wavelengths_nm = layers.map(|layers| wavelengths(layers, "r_d"));
    if let Err(error) = same_meaning(&reflectance, &lut, wavelengths_nm.as_deref()) {
        problems.unfit(known, "lut", error);
    }
    if let Some(wavelengths_nm) = wavelengths_nm.filter(|found| !found.is_empty()) {
        let unused = unused(&lut, &wavelengths_nm);
        match (places(&lut, &wavelengths_nm), unused) {
            (Err(error), unused) => problems.unfit(known, "lut", with(error, unused)),
            (Ok(_), Some(unused)) => problems.warn_at_input("lut", unused, "these are left out"),
            (Ok(_), None) => {}
        }
    }
    warn_without_convention(known, problems);
    check_f_x(params, known, &lut, problems);
    check_sections(known, problems);
    if known.is_connected("height") {
        if let Err(error) = correctable(&reflectance, &lut) {
            problems.unfit(known, "height", error);
        }
    } else if known.is_wanted("exposure") {
        let what = "`exposure` is wanted, but without the input `height` no light falls on any shape";
        problems.push_with_hint("", what, "connect `height` and `scene`");
    }
    check_sizes(known, problems);
    for port in ["height", "normals"] {
        if let Err(Error::Failed { what, .. }) = Rig::shared(&reflectance, &known.fact(port)) {
            let message = format!("`{}` and `{}`: {what}", known.producer("reflectance"), known.producer(port));
            let way_out = "connect the shape that the camera of the reflectance sees: pixels are corrected one by one";
            problems.warn_at_input(port, message, way_out);
        }
    }
}

/// Warns of what is described down to its layers or columns, and does not say what its reflectance means.
fn warn_without_convention(known: &Known, problems: &mut Problems) {
    for port in ["reflectance", "lut"] {
        let described = known.form(port).is_some_and(|form| form.layers.is_some() || form.columns.is_some());
        if described && !known.fact(port).contains_key("convention") {
            let message = format!("`{}` does not say its convention", known.producer(port));
            let way_out = "say it: what a camera saw is `camera`; most published tables are `hemispherical_incident`, and differ from that by -9 to +49 %";
            problems.warn_at_input(port, message, way_out);
        }
    }
}

/// The same error with one thing more.
fn with(error: Error, more: Option<String>) -> Error {
    match (error, more) {
        (Error::Failed { what, way_out }, Some(more)) => Error::Failed { what: format!("{what}; {more}"), way_out },
        (error, _) => error,
    }
}

/// The f_x that are read are there, of one orientation where the shape is corrected for, and the table holds them.
fn check_f_x(params: &Params, known: &Known, lut: &Attributes, problems: &mut Problems) {
    let Some(layers) = known.form("reflectance").and_then(|form| form.layers.as_deref()) else { return };
    let choice = match choose(layers, params) {
        Ok(choice) => choice,
        Err(error) => return problems.unfit(known, "reflectance", error),
    };
    if known.is_connected("height")
        && let Err(error) = orientation(layers, &choice)
    {
        problems.unfit(known, "reflectance", error);
    }
    if known.is_wanted("covariance") && !choice.of.iter().all(|(_, places)| errors_known(layers, places)) {
        let what = "it holds no standard errors, and `covariance` is wanted";
        let way_out = "connect the covariance of the frames to demodulate, or leave out what reads `covariance`";
        problems.unfit(known, "reflectance", Error::failed_with_hint(what, way_out));
    }
    if let Some(Err(error)) = lut.get("f_x").map(|all| {
        let all: Vec<f64> = all.as_array().into_iter().flatten().filter_map(|f| f.as_f64()).collect();
        choice.f_x.iter().try_for_each(|&f_x| table_f_x(&all, f_x).map(drop))
    }) {
        problems.unfit(known, "lut", error);
    }
}

/// Sections and a table that has some come together.
fn check_sections(known: &Known, problems: &mut Problems) {
    let columns = known.form("lut").and_then(|form| form.columns.as_ref());
    let Some(sectioned) = columns.map(|columns| columns.iter().any(|c| c.name == "section")) else { return };
    match (sectioned, known.is_connected("sections")) {
        (true, false) => {
            let what = "the table has sections, and which pixel belongs to which is not known";
            let way_out = "connect the port `sections` to the section_tube that build_lut used";
            problems.unfit(known, "lut", Error::failed_with_hint(what, way_out));
        }
        (false, true) => {
            let what = "there are sections, and the table has none";
            let way_out = "give build_lut and invert the same sections";
            problems.unfit(known, "sections", Error::failed_with_hint(what, way_out));
        }
        _ => {}
    }
}

/// All images are of one camera.
fn check_sizes(known: &Known, problems: &mut Problems) {
    let pixels = |port: &str| known.form(port).and_then(|form| form.pixels);
    let Some(reflectance) = pixels("reflectance") else { return };
    for port in ["sections", "height", "normals"] {
        if let Some(other) = pixels(port).filter(|other| *other != reflectance) {
            let what = format!("it has {}, the reflectance {}", size(other), size(reflectance));
            problems.unfit(known, port, Error::failed_with_hint(what, "both must be seen by the same camera"));
        }
    }
    let scene = known.get::<Scene>("scene").filter(|_| known.is_connected("height"));
    if let Some(camera) = scene.as_ref().and_then(|scene| scene.camera.as_ref()) {
        let [columns, rows] = camera.pixels.map(u64::from);
        if [rows, columns] != reflectance {
            let what =
                format!("the scene's camera has {}, the reflectance {}", size([rows, columns]), size(reflectance));
            let way_out = "connect the scene whose camera took the frames";
            problems.unfit(known, "scene", Error::failed_with_hint(what, way_out));
        }
    }
    let lacks = |form: &Form, wanted: &str| {
        form.layers.as_ref().is_some_and(|layers| layers.iter().all(|layer| layer.name != wanted))
    };
    for (port, wanted) in
        [("height", "height"), ("normals", "normal_x"), ("normals", "normal_y"), ("normals", "normal_z")]
    {
        if known.form(port).is_some_and(|form| lacks(form, wanted)) {
            let way_out = "connect `truth` of render, or what profilometry measures";
            problems.unfit(known, port, Error::failed_with_hint(format!("it has no layer `{wanted}`"), way_out));
        }
    }
}

/// Whether maps of this reflectance can be corrected for a shape by this table, as far as both say.
pub fn correctable(reflectance: &Attributes, lut: &Attributes) -> Result<(), Error> {
    if lut.get("thickness").is_some_and(|d| !d.is_null()) {
        return Err(Error::failed_with_hint(
            "the table is that of a slab, whose thickness cannot be scaled with f_x along the surface",
            "leave `thickness` out of build_lut, or leave out `height`",
        ));
    }
    if lut.contains_key("sections") {
        return Err(Error::failed("the sections of a table already hold what distance and slope do"));
    }
    if let Some(surface) = reflectance.get("fringes_along").and_then(|s| s.as_str()) {
        return Err(Error::failed_with_hint(
            format!(
                "the fringes were predistorted for `{surface}`: f_x is along it already, not in the plane of the pattern"
            ),
            "show a plain sinusoid, or leave out `height` and read the table of a tube with `sections`",
        ));
    }
    Ok(())
}
