//! The truth of concentrations, as it is written in the pipeline: amounts by object, as images beside those of the estimate.

use std::collections::BTreeMap;

use turbid_contract::ndarray::Array2;
use turbid_contract::payload::MaskReason;
use turbid_contract::{Error, ImageStack, Layer, LayerInfo, LayerKind, Problems, Ratio, serde_json, suggest};

/// Amounts by name of the quantity, in the unit of its layer: uM of haemoglobin, shares of the volume of others, 1 of StO2.
pub type Amounts = BTreeMap<String, Ratio>;

/// Names of all that is seen, where nothing says which object a pixel shows.
pub const ALL: &str = "all";

/// Reports amounts that cannot be.
pub fn check(concentrations: &BTreeMap<String, Amounts>, problems: &mut Problems) {
    for (object, amounts) in concentrations {
        let at = |name: &str| format!("concentrations.{object}.{name}");
        if amounts.is_empty() {
            let way_out = "write {HbO2: 45, Hb: 15}, for example";
            problems.push_with_hint(format!("concentrations.{object}"), "no concentration is named", way_out);
        }
        for (name, &Ratio(value)) in amounts {
            let unit = unit(name).unwrap_or("");
            match name.as_str() {
                "StO2" => {
                    problems.require((0.0..=1.0).contains(&value), at(name), value, "", "lie in [0, 1], or 0 to 100 %")
                }
                "scatter_b" => problems.require(value.is_finite(), at(name), value, "", "be a finite number"),
                _ => problems.require(value >= 0.0 && value.is_finite(), at(name), value, unit, "be >= 0"),
            };
        }
        if let (Some(oxy), Some(deoxy)) = (amounts.get("HbO2"), amounts.get("Hb")) {
            let total = oxy.0 + deoxy.0;
            for (name, said, is) in [("THb", amounts.get("THb"), total), ("StO2", amounts.get("StO2"), oxy.0 / total)] {
                if let Some(said) = said.filter(|said| (said.0 - is).abs() > 1e-6 * is.abs().max(1e-3)) {
                    let message = format!("{name} = {} contradicts HbO2 and Hb, which make it {is:.6}", said.0);
                    problems.push_with_hint(at(name), message, "leave it out: it follows from them");
                }
            }
        }
    }
}

/// The unit that a quantity has wherever it is found; `None` of those that users name.
pub fn unit(name: &str) -> Option<&'static str> {
    match name {
        "HbO2" | "Hb" | "THb" => Some("uM"),
        "water" | "lipid" | "melanin" | "StO2" | "scatter_b" => Some("1"),
        "scatter_a" => Some("mm^-1"),
        _ => None,
    }
}

/// With what follows: THb and StO2 of HbO2 and Hb.
fn completed(amounts: &Amounts) -> BTreeMap<&str, f64> {
    let mut all: BTreeMap<&str, f64> = amounts.iter().map(|(name, value)| (name.as_str(), value.0)).collect();
    if let (Some(&oxy), Some(&deoxy)) = (all.get("HbO2"), all.get("Hb")) {
        all.entry("THb").or_insert(oxy + deoxy);
        // Without haemoglobin there is no saturation.
        if oxy + deoxy > 0.0 {
            all.entry("StO2").or_insert(oxy / (oxy + deoxy));
        }
    }
    all
}

/// The quantities of the estimate that the pipeline says, once for all objects. Errors: a name that the estimate lacks, or has in another unit.
pub fn quantities(concentrations: &BTreeMap<String, Amounts>, estimate: &[LayerInfo]) -> Result<Vec<LayerInfo>, Error> {
    let values: Vec<&LayerInfo> = estimate.iter().filter(|info| info.kind == LayerKind::Value).collect();
    let find = |name: &str| values.iter().find(|info| info.name == name);
    for (object, amounts) in concentrations {
        for name in amounts.keys() {
            let at = format!("concentrations.{object}.{name}");
            let Some(info) = find(name) else {
                let hint = suggest::hint(name, values.iter().map(|info| info.name.as_str())).unwrap_or_default();
                return Err(Error::invalid(at, format!("the estimate has no `{name}`: {hint}")));
            };
            if let Some(wanted) = unit(name).filter(|unit| *unit != info.unit) {
                return Err(Error::failed(format!("{name} is in {}, and {wanted} is wanted", info.unit)));
            }
        }
    }
    let said = |name: &str| concentrations.values().any(|amounts| completed(amounts).contains_key(name));
    let plain = |info: &LayerInfo| LayerInfo::value(info.name.clone(), info.unit.clone());
    Ok(values.into_iter().filter(|info| said(&info.name)).map(plain).collect())
}

/// Names that are no object of the truth; without a truth all but [`ALL`].
pub fn unknown_object(concentrations: &BTreeMap<String, Amounts>, objects: Option<&[String]>) -> Option<Error> {
    let known = |name: &String| objects.map_or(name == ALL, |objects| objects.contains(name));
    let wrong = concentrations.keys().find(|name| !known(name))?;
    let message = match objects {
        Some(objects) => format!("the scene has no object `{wrong}`; it has {}", objects.join(", ")),
        None => format!(
            "which pixels show `{wrong}` is told by the port `truth` of a render; without it only `{ALL}` may be named"
        ),
    };
    Some(Error::invalid(format!("concentrations.{wrong}"), message))
}

/// Images of the truth. Pixels of objects that are not named have none, and count for no region. `scene` brings the objects, where there is one.
pub fn images(
    concentrations: &BTreeMap<String, Amounts>,
    estimate: &ImageStack,
    scene: Option<&ImageStack>,
) -> Result<ImageStack, Error> {
    let objects: Option<Vec<String>> = scene
        .and_then(|scene| scene.attributes.get("objects"))
        .and_then(|list| serde_json::from_value(list.clone()).ok());
    if let Some(error) = unknown_object(concentrations, objects.as_deref()) {
        return Err(error);
    }
    let size = (estimate.rows(), estimate.columns());
    let layer = |name: &str| scene.and_then(|scene| scene.find(name, None)).map(Layer::pixels);
    let (shown, hidden) = (layer("object"), scene.and_then(|scene| scene.mask(None)).map(Layer::pixels));
    let all: BTreeMap<&str, BTreeMap<&str, f64>> =
        concentrations.iter().map(|(object, amounts)| (object.as_str(), completed(amounts))).collect();
    let of = |pixel: usize| {
        let name = match &objects {
            None => Some(ALL),
            Some(objects) => {
                objects.get(shown.as_ref().map_or(0, |shown| shown[pixel].max(0.0) as usize)).map(String::as_str)
            }
        };
        let seen = hidden.as_ref().is_none_or(|mask| mask[pixel] == 0.0);
        name.filter(|_| seen).and_then(|name| all.get(name))
    };
    let mut stack = ImageStack::new(size.0, size.1);
    let plane =
        |value: &dyn Fn(usize) -> f64| Array2::from_shape_fn(size, |(row, column)| value(row * size.1 + column) as f32);
    for info in quantities(concentrations, &estimate.infos())? {
        let value =
            |pixel: usize| of(pixel).and_then(|amounts| amounts.get(info.name.as_str())).copied().unwrap_or(0.0);
        let data = plane(&value);
        stack.push(info, data);
    }
    if let Some(shown) = &shown {
        stack.push(LayerInfo::value("object", "1"), plane(&|pixel| f64::from(shown[pixel])));
    }
    let mask = |pixel: usize| {
        let carried = hidden.as_ref().map_or(0.0, |mask| f64::from(mask[pixel]));
        let without = if of(pixel).is_some() { 0.0 } else { f64::from(MaskReason::Background.code()) };
        if carried == 0.0 { without } else { carried }
    };
    stack.push(LayerInfo::new("mask", LayerKind::Mask, "1"), plane(&mask));
    for name in ["objects", "field"] {
        let said = scene.and_then(|scene| scene.attributes.get(name)).cloned();
        stack.attributes.extend(said.map(|value| (name.to_owned(), value)));
    }
    Ok(stack)
}
