//! What the table will hold; and phantoms that do not belong together, found before anything runs.

use std::collections::BTreeSet;

use serde_json::{Value, json};
use turbid_contract::layers::{place, size};
use turbid_contract::payload::{CONDITIONS, Rig};
use turbid_contract::{Attributes, Axes, Error, Form, Forms, Known, LayerInfo, PerChannel, Problems, Ratio};

use crate::params::{Model, Params};
use crate::phantoms;
use crate::table::Recipe;
use crate::validity;

/// Columns of the table, with their units.
pub const COLUMNS: [(&str, &str); 6] =
    [("mu_a", "mm^-1"), ("mu_s_prime", "mm^-1"), ("f_x", "mm^-1"), ("r_d", "1"), ("r_d_se", "1"), ("r_d_bound", "1")];

/// Columns that come first where the artifact holds several tables, one after the other.
pub const MEDIUM: [(&str, &str); 2] = [("g", "1"), ("n", "1")];

/// The forms of all outputs. Axes that come from phantoms are open.
pub fn describe(params: &Params, known: &Known) -> Forms {
    let recipes = params.recipes();
    let Some(recipe) = recipes.first() else { return Forms::new() };
    let mut attributes = attributes(params, recipe);
    let measured = params.model == Model::Empirical;
    for (name, axis) in [("mu_a", &recipe.mu_a), ("mu_s_prime", &recipe.mu_s_prime)] {
        if measured || axis.is_empty() {
            attributes.remove(name);
        }
    }
    attributes.extend(known.fact("phantoms").remove_entry(CONDITIONS));
    let sectioned = known.is_connected("sections");
    let section: &[(&str, &str)] = match (sectioned, recipes.len() > 1) {
        (true, _) => &[("section", "")],
        (false, true) => &MEDIUM,
        (false, false) => &[],
    };
    let columns: Vec<(&str, &str)> = section.iter().chain(&COLUMNS).copied().collect();
    let nodes = [recipe.mu_a.len() as u64, recipe.mu_s_prime.len() as u64];
    let rows = (!measured).then(|| (recipes.len() * recipe.f_x.len()) as u64 * nodes[0] * nodes[1]);
    let several = (recipes.len() > 1).then_some(0..recipes.len());
    let layers =
        several.map_or_else(|| validity::layers(None), |k| k.flat_map(|k| validity::layers(Some(k))).collect());
    let validity = if measured { Form::default() } else { Form::images(nodes[0], nodes[1], layers) };
    let lut = Form::table(rows, &columns).with(attributes);
    Forms::from([("lut", lut), ("validity", validity), ("design", design(params, known))])
}

/// What the table says of itself.
pub fn attributes(params: &Params, recipe: &Recipe) -> Attributes {
    let mut attributes = Attributes::new();
    let mut set = |name: &str, value: Value| attributes.insert(name.to_owned(), value);
    set("model", json!(params.model));
    set("convention", json!(params.convention));
    set("f_x", json!(recipe.f_x));
    set("mu_a", json!(recipe.mu_a));
    set("mu_s_prime", json!(recipe.mu_s_prime));
    let wavelengths_nm: Vec<f64> = params.wavelengths_nm.iter().map(|w| w.0).collect();
    let several = params.media().len() > 1;
    let each = |list: &PerChannel<Ratio>, one: f64| match several {
        true => json!((0..wavelengths_nm.len()).filter_map(|k| Some(list.of(k)?.0)).collect::<Vec<f64>>()),
        false => json!(one),
    };
    set("g", each(&params.g, recipe.g));
    set("n", each(&params.n, recipe.n));
    if !wavelengths_nm.is_empty() {
        set("wavelengths_nm", json!(wavelengths_nm));
    }
    set("thickness", json!(recipe.thickness));
    if let Some(reference) = &params.reference {
        set("reference", json!(reference));
    }
    attributes
}

fn design(params: &Params, known: &Known) -> Form {
    let varied = varied(known.axes("phantoms"));
    let mut columns = vec![("wanted_mu_a".to_owned(), "mm^-1"), ("wanted_mu_s_prime".to_owned(), "mm^-1")];
    columns.extend(varied.into_iter().flat_map(|axis| [(axis.clone(), ""), (format!("{axis}_se"), "")]));
    let columns: Vec<(&str, &str)> = columns.iter().map(|(name, unit)| (name.as_str(), *unit)).collect();
    Form::table(params.wanted.as_ref().map(|wanted| wanted.len() as u64), &columns)
}

/// Axes along which the phantoms differ.
fn varied(axes: &[Axes]) -> Vec<String> {
    let names: BTreeSet<&String> = axes.iter().flat_map(|axes| axes.keys()).collect();
    let values =
        |name: &String| axes.iter().filter_map(|axes| Some(axes.get(name)?.to_string())).collect::<BTreeSet<_>>();
    names.into_iter().filter(|name| values(name).len() > 1).cloned().collect()
}

/// Reports outputs that are wanted and cannot be made, and phantoms that do not fit their references, f_x or sections.
pub fn check(params: &Params, known: &Known, problems: &mut Problems) {
    if known.is_wanted("design") && params.wanted.is_none() {
        let way_out = "wanted: [{mu_a: .., mu_s_prime: ..}], or leave out what reads `design`";
        problems.push_with_hint("wanted", "the output `design` is wanted, and no medium to design", way_out);
    }
    if known.is_wanted("validity") && params.f_x.0.len() < 2 {
        let way_out = "give two f_x, or leave out what reads `validity`";
        problems.push_with_hint("f_x", "the output `validity` is wanted, and one f_x has no Jacobian", way_out);
    }
    if params.model != Model::Empirical {
        return;
    }
    for port in ["references", "properties", "truths"].into_iter().filter(|port| known.is_connected(port)) {
        let partners = known.axes("phantoms").iter().map(|axes| phantoms::belonging(known.axes(port), axes, port));
        if let Some(error) = partners.filter_map(Result::err).next() {
            return problems.unfit(known, port, error);
        }
    }
    if let Some((port, error)) = unlike_properties(known, params) {
        problems.unfit(known, port, error);
    }
    let sections = known.form("sections").and_then(|form| form.pixels);
    let mut checked: Vec<(&Form, &Form)> = Vec::new();
    for (form, axes) in known.forms("phantoms").iter().zip(known.axes("phantoms")) {
        let Ok(at) = phantoms::belonging(known.axes("references"), axes, "references") else { continue };
        let Some(reference) = known.forms("references").get(at) else { continue };
        // Phantoms of a sweep have one form: it is looked at once.
        if checked.iter().any(|(a, b)| std::ptr::eq(*a, &**form) && std::ptr::eq(*b, &**reference)) {
            continue;
        }
        checked.push((form, reference));
        for (port, error) in unlike(form, reference, sections, params) {
            problems.unfit(known, port, error);
        }
    }
}

/// Fits and truths that do not say what the phantoms are.
fn unlike_properties(known: &Known, params: &Params) -> Option<(&'static str, Error)> {
    for columns in known.forms("properties").iter().filter_map(|form| form.columns.as_ref()) {
        let lacks = phantoms::OF_A_FIT.into_iter().find(|name| columns.iter().all(|column| column.name != *name));
        if let Some(name) = lacks {
            let what = format!("the fit has no column {name}");
            return Some(("properties", Error::failed_with_hint(what, "connect the fit of a calibrate_iad stage")));
        }
    }
    for (phantom, axes) in known.forms("phantoms").iter().zip(known.axes("phantoms")) {
        let Ok(at) = phantoms::belonging(known.axes("truths"), axes, "truths") else { continue };
        let truth = known.forms("truths").get(at).and_then(|truth| truth.layers.as_ref());
        let Some((phantom, truth)) = phantom.layers.as_ref().zip(truth) else { continue };
        // Where the phantom does not fit, that is told elsewhere.
        let Ok(wavelength_nm) = phantoms::wavelength_nm(phantom, &params.f_x.0) else { continue };
        let says = |quantity: &str| phantoms::true_layer(truth, quantity, wavelength_nm);
        if let Err(error) = says("mu_a").and_then(|_| says("mu_s_prime")) {
            return Some(("truths", error));
        }
    }
    None
}

/// What does not fit of a phantom and its reference, with the port to be blamed.
fn unlike(phantom: &Form, reference: &Form, sections: Option<[u64; 2]>, params: &Params) -> Vec<(&'static str, Error)> {
    let mut found = Vec::new();
    let sizes = |a: Option<[u64; 2]>, b: Option<[u64; 2]>| a.zip(b).filter(|(a, b)| a != b);
    if let Some((a, b)) = sizes(phantom.pixels, reference.pixels) {
        let what = format!("a phantom has {}, its reference {}", size(a), size(b));
        found.push(("references", Error::failed_with_hint(what, "both must be seen by the same camera")));
    }
    if let Some((a, b)) = sizes(phantom.pixels, sections) {
        let what = format!("they are of {}, a phantom has {}", size(b), size(a));
        found.push(("sections", Error::failed_with_hint(what, "both must be seen by the same camera")));
    }
    found.extend(Rig::shared(&phantom.attributes, &reference.attributes).err().map(|error| ("references", error)));
    for &f_x in &params.f_x.0 {
        let of = |form: &Form, name: &str| {
            let layers = form.layers.as_ref()?;
            Some(phantoms::modulation(layers, f_x, name).map(|k| layers[k].clone()))
        };
        let pair = [of(phantom, "the phantom"), of(reference, "the reference")];
        match pair {
            [Some(Err(error)), _] => found.push(("phantoms", error)),
            [_, Some(Err(error))] => found.push(("references", error)),
            [Some(Ok(a)), Some(Ok(b))] => found.extend(unlike_layers(&a, &b).map(|error| ("references", error))),
            _ => {}
        }
    }
    found
}

/// Wavelengths, orientations and units that differ.
fn unlike_layers(a: &LayerInfo, b: &LayerInfo) -> Option<Error> {
    if a.wavelength_nm != b.wavelength_nm || a.orientation_deg != b.orientation_deg {
        let what = format!("a phantom was seen at {}, its reference at {}", place(a), place(b));
        return Some(Error::failed_with_hint(what, "see both in the same light"));
    }
    (a.unit != b.unit).then(|| {
        let what = format!("a phantom is given in {}, its reference in {}", a.unit, b.unit);
        Error::failed_with_hint(what, "import or render both in the same unit")
    })
}
