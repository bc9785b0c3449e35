//! Estimates, truths, images and tables that do not go together, found before anything runs.

use turbid_contract::layers::size;
use turbid_contract::payload::{Concentrations, Payload, Rig};
use turbid_contract::{Error, Form, Known, LayerInfo, LayerKind, Problems, serde_json};

use crate::fit::QUANTITIES;
use crate::levels::{label, point, same_quantity, same_unit};
use crate::params::Params;
use crate::shared::shared;
use crate::summary::COLUMNS;
use crate::written::{quantities, unknown_object};

/// Reports an estimate and a truth that share nothing, or are not of one camera; regions of objects that the camera does not see.
pub fn check_compare(params: &Params, known: &Known, problems: &mut Problems) {
    let (Some(estimate), truth) = (known.form("estimate"), known.form("truth")) else { return };
    if let Some(columns) = &estimate.columns {
        let lacks = QUANTITIES.into_iter().find(|name| columns.iter().all(|column| column.name != *name));
        if let Some(name) = lacks {
            problems.unfit(known, "estimate", Error::failed(format!("it has no column {name}")));
        }
    }
    let of_objects = truth.and_then(|truth| truth.attributes.get("objects"));
    let objects: Option<Vec<String>> = of_objects.and_then(|list| serde_json::from_value(list.clone()).ok());
    if !params.concentrations.is_empty() {
        if let Some(Err(error)) = estimate.layers.as_ref().map(|layers| quantities(&params.concentrations, layers)) {
            unfit_field(known, error, problems);
        }
        let open = known.is_connected("truth") && objects.is_none();
        if let (false, Some(error)) = (open, unknown_object(&params.concentrations, objects.as_deref())) {
            unfit_field(known, error, problems);
        }
    }
    let of_concentrations = known.payloads.get("estimate").map(String::as_str) == Some(Concentrations::NAME);
    let Some(truth) = truth else { return };
    if let Some((a, b)) = estimate.pixels.zip(truth.pixels).filter(|(a, b)| a != b) {
        let what = format!("the estimate has {}, the truth {}", size(a), size(b));
        problems.unfit(known, "truth", Error::failed_with_hint(what, "both must be seen by the same camera"));
    }
    if let Err(Error::Failed { what, .. }) = Rig::shared(&estimate.attributes, &truth.attributes) {
        let message = format!("`{}` and `{}`: {what}", known.producer("estimate"), known.producer("truth"));
        let way_out =
            "connect the `truth` of the render that made the frames of the estimate: pixels are compared one by one";
        problems.warn_at_input("truth", message, way_out);
    }
    if let (Some(a), Some(b), true) = (&estimate.layers, &truth.layers, !of_concentrations)
        && let Err(error) = shared(a, b)
    {
        problems.unfit(known, "truth", error);
    }
    if let Some(columns) = &truth.columns {
        let lacks = QUANTITIES.into_iter().find(|name| columns.iter().all(|column| column.name != *name));
        if let Some(name) = lacks {
            let what = format!("the readings do not say {name} of their media");
            problems.unfit(known, "truth", Error::failed_with_hint(what, "name the `media` of the fit"));
        }
    }
    for (name, region) in &params.regions {
        let object = region.object.as_ref().zip(objects.as_ref()).filter(|(object, all)| !all.contains(object));
        if let Some((object, all)) = object {
            let message = format!("the scene has no object `{object}`; it has {}", all.join(", "));
            problems.push(format!("regions.{name}.object"), message);
        }
    }
}

/// What is wrong with a field is told there, without the name of what is connected.
fn unfit_field(known: &Known, error: Error, problems: &mut Problems) {
    match error {
        Error::Invalid(problem) => problems.push(problem.path, problem.message),
        error => problems.unfit(known, "estimate", error),
    }
}

/// Reports tables that are none of `compare`.
pub fn check_summarize(known: &Known, problems: &mut Problems) {
    for form in known.forms("metrics") {
        let Some(columns) = &form.columns else { continue };
        let lacks = COLUMNS.into_iter().find(|name| columns.iter().all(|column| column.name != *name));
        if let Some(name) = lacks {
            let what = format!("the metrics have no column `{name}`");
            let error = Error::failed_with_hint(what, "connect the metrics of a `compare` stage");
            return problems.unfit(known, "metrics", error);
        }
    }
}

/// Reports images without the quantities of `values`, or with these in another unit, on the other ports of `tabulate`, and points without
/// images to subtract.
pub fn check_tabulate(known: &Known, problems: &mut Problems) {
    for port in ["minus", "relative_to"] {
        for (values, axes) in known.forms("values").iter().zip(known.axes("values")) {
            let others = known.forms(port);
            let at =
                known.axes(port).iter().position(|own| own.iter().all(|(name, value)| axes.get(name) == Some(value)));
            let other = if port == "minus" && !others.is_empty() {
                match at {
                    Some(at) => others.get(at),
                    None => {
                        let what = format!("there is nothing at {}", point(axes));
                        return problems.unfit(known, port, Error::failed(what));
                    }
                }
            } else {
                others.first()
            };
            let layers = |form: &Form| form.layers.clone();
            let Some((values, other)) = layers(values).zip(other.and_then(|form| layers(form))) else { continue };
            let value = |info: &&LayerInfo| info.kind == LayerKind::Value;
            for info in values.iter().filter(value) {
                let Some(found) = other.iter().filter(value).find(|o| same_quantity(info, o)) else {
                    let has = other.iter().filter(value).map(label).collect::<Vec<_>>().join(", ");
                    let what = format!("the images have no {}; they have {has}", label(info));
                    return problems.unfit(known, port, Error::failed(what));
                };
                if let Err(error) = same_unit(info, found) {
                    return problems.unfit_beside(known, port, "values", error);
                }
            }
        }
    }
}
