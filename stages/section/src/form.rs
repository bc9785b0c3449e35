//! What sections will hold, and whether modulation and truth fit.

use turbid_contract::joint::pixel_pitch_of;
use turbid_contract::payload::Rig;
use turbid_contract::serde_json::Value;
use turbid_contract::{Attributes, Error, Form, Forms, Known, LayerInfo, LayerKind, Problems};

use crate::params::Params;

/// Section, neighbour, share of the own section, arc length and mask.
pub fn layers() -> [LayerInfo; 5] {
    [
        LayerInfo::value("section", "1"),
        LayerInfo::value("neighbour", "1"),
        LayerInfo::value("weight", "1"),
        LayerInfo::value("arc_length", "mm"),
        LayerInfo::new("mask", LayerKind::Mask, "1"),
    ]
}

/// What the params say of sections.
pub fn said(params: &Params) -> Attributes {
    let method = ("method".to_owned(), params.method.name().into());
    Attributes::from([("blend".to_owned(), params.blend.into()), method])
}

/// The list of sections is the light's: only a run can tell it.
pub fn describe(params: &Params, known: &Known) -> Forms {
    let pixels = known.form("modulation").and_then(|form| form.pixels);
    let sections = Form { pixels, layers: Some(layers().into()), ..Form::said(said(params)) };
    Forms::from([("sections", sections.with(pixel_pitch_of(&known.fact("truth"))))])
}

/// Places among the layers of a modulation: M_DC of the lowest f_x and M_AC of the highest, of the first wavelength.
///
/// Error: it holds none of either.
pub fn light(layers: &[&LayerInfo]) -> Result<[usize; 2], Error> {
    let of = |name: &str, lowest: bool| {
        let value = |&k: &usize| layers[k].name == name && layers[k].kind == LayerKind::Value;
        let first = (0..layers.len()).find(value).map(|k| layers[k].wavelength_nm);
        let own = (0..layers.len()).filter(value).filter(|&k| Some(layers[k].wavelength_nm) == first);
        let f_x = |k: &usize| layers[*k].f_x_per_mm.unwrap_or(0.0);
        let by_f = |a: &usize, b: &usize| f_x(a).total_cmp(&f_x(b));
        let found = if lowest { own.min_by(by_f) } else { own.max_by(by_f) };
        found.ok_or_else(|| {
            let way_out = "connect the output `modulation` of a demodulation";
            Error::failed_with_hint(format!("the modulation holds no layer `{name}`"), way_out)
        })
    };
    Ok([of("m_dc", true)?, of("m_ac", false)?])
}

/// The layers of the truth that sections are made of.
pub const OF_TRUTH: [&str; 4] = ["height", "normal_z", "object", "mask"];

/// Places of [`OF_TRUTH`] among the layers of a truth.
///
/// Error: one of them is missing.
pub fn shape(layers: &[&LayerInfo]) -> Result<[usize; 4], Error> {
    let mut places = [0; 4];
    for (place, name) in places.iter_mut().zip(OF_TRUTH) {
        *place = layers.iter().position(|info| info.name == name).ok_or_else(|| {
            let way_out = "connect the output `truth` of a render";
            Error::failed_with_hint(format!("the truth holds no layer `{name}`"), way_out)
        })?;
    }
    Ok(places)
}

/// Rows and columns of both.
///
/// Error: they differ.
pub fn same_size(modulation: [u64; 2], truth: [u64; 2]) -> Result<(), Error> {
    if modulation == truth {
        return Ok(());
    }
    let what = format!(
        "the modulation has {} x {} pixels, the truth {} x {}",
        modulation[1], modulation[0], truth[1], truth[0]
    );
    Err(Error::failed_with_hint(what, "both must be seen by the same camera"))
}

/// The places of the objects whose walls are sectioned among those that the truth names; `None` for all.
///
/// Error: one that the scene has not.
pub fn objects(params: &Params, truth: &Attributes) -> Result<Option<Vec<usize>>, Error> {
    let Some(objects) = &params.objects else { return Ok(None) };
    let names: Vec<&str> =
        truth.get(OBJECTS).and_then(Value::as_array).into_iter().flatten().filter_map(Value::as_str).collect();
    let place = |(i, object): (usize, &String)| {
        names.iter().position(|name| name == object).ok_or_else(|| {
            let what = format!("the scene has no object `{object}`; it has {}", names.join(", "));
            Error::invalid(format!("objects.{i}"), what)
        })
    };
    objects.iter().enumerate().map(place).collect::<Result<_, _>>().map(Some)
}

/// The attribute of a truth that names its objects.
pub const OBJECTS: &str = "objects";

/// Reports inputs that do not fit.
pub fn check(params: &Params, known: &Known, problems: &mut Problems) {
    let [modulation, truth] = ["modulation", "truth"].map(|port| known.form(port));
    let layers = |form: Option<&Form>| form.and_then(|form| form.layers.clone());
    if let Some(layers) = layers(modulation)
        && let Err(error) = light(&layers.iter().collect::<Vec<_>>())
    {
        problems.unfit(known, "modulation", error);
    }
    let Some(truth) = truth else { return };
    if let Some(layers) = layers(Some(truth))
        && let Err(error) = shape(&layers.iter().collect::<Vec<_>>())
    {
        problems.unfit(known, "truth", error);
    }
    if truth.attribute(OBJECTS).is_some()
        && let Err(error) = objects(params, &truth.attributes)
    {
        problems.unfit(known, "truth", error);
    }
    if let Err(Error::Failed { what, .. }) = Rig::shared(&known.fact("modulation"), &truth.attributes) {
        let message = format!("`{}` and `{}`: {what}", known.producer("modulation"), known.producer("truth"));
        let way_out = "connect the `truth` of the render that made the frames of the modulation";
        problems.warn_at_input("truth", message, way_out);
    }
    if let (Some(modulation), Some(truth)) = (modulation.and_then(|form| form.pixels), truth.pixels)
        && let Err(error) = same_size(modulation, truth)
    {
        problems.unfit_beside(known, "truth", "modulation", error);
    }
}
