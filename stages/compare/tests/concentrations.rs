//! Concentrations against what the pipeline says they are, by object or for all pixels.

use turbid_compare::{Compare, Tabulate};
use turbid_contract::kit::Trial;
use turbid_contract::ndarray::{Array2, array};
use turbid_contract::payload::{Concentrations, Metrics, Truth};
use turbid_contract::serde_json::{Value, json};
use turbid_contract::{Cells, ImageStack, LayerInfo, LayerKind, Table};

/// Two pixels of each of two objects; HbO2 and Hb as given, what follows from them, and what is left of mu_a.
fn found() -> Concentrations {
    let mut stack = ImageStack::new(2, 2);
    let (oxy, deoxy) = (array![[44.0_f32, 46.0], [18.0, 20.0]], array![[15.0_f32, 15.0], [42.0, 42.0]]);
    let total = &oxy + &deoxy;
    let layers =
        [("HbO2", "uM", oxy.clone()), ("Hb", "uM", deoxy), ("THb", "uM", total.clone()), ("StO2", "1", &oxy / &total)];
    for (name, unit, data) in &layers {
        stack.push(LayerInfo::value(*name, *unit), data.clone());
    }
    stack.push(LayerInfo::value("residual", "mm^-1"), Array2::zeros((2, 2)));
    for (name, unit, data) in layers {
        stack.push(LayerInfo::value(name, unit).standard_error(), data.mapv(|v| 0.05 * v));
    }
    stack.push(LayerInfo::new("mask", LayerKind::Mask, "1"), Array2::zeros((2, 2)));
    Concentrations(stack)
}

fn scene() -> Truth {
    let mut stack = ImageStack::new(2, 2);
    stack.push(LayerInfo::value("mu_a", "mm^-1"), Array2::from_elem((2, 2), 0.1));
    stack.push(LayerInfo::value("object", "1"), array![[0.0, 0.0], [1.0, 1.0]]);
    stack.push(LayerInfo::new("mask", LayerKind::Mask, "1"), Array2::zeros((2, 2)));
    stack
        .attributes
        .extend([("objects", json!(["arm", "vein"])), ("field", json!([20.0, 20.0]))].map(|(k, v)| (k.to_owned(), v)));
    Truth(stack)
}

fn trial(concentrations: Value) -> Trial {
    Trial::of::<Compare>(json!({"concentrations": concentrations})).input("estimate", found())
}

fn texts(table: &Table, name: &str) -> Vec<String> {
    match &table.columns.iter().find(|c| c.name == name).expect("it is a column").cells {
        Cells::Text(texts) => texts.clone(),
        other => panic!("{name}: {other:?}"),
    }
}

fn rows(table: &Table, column: &str) -> Vec<(String, String, Option<f64>)> {
    let values = table.maybe_f64s(column).expect("a column of numbers");
    texts(table, "region").into_iter().zip(texts(table, "quantity")).zip(values).map(|((a, b), c)| (a, b, c)).collect()
}

/// By object, worked out by hand; THb and StO2 follow from HbO2 and Hb; objects that are not named have no row, and what is described is what is made.
#[test]
fn each_object_has_its_truth() {
    let both = json!({"arm": {"HbO2": 45, "Hb": 15}, "vein": {"HbO2": 18, "Hb": 42, "StO2": "30 %"}});
    let trial = trial(both).input("truth", scene());
    trial.passes();
    let Metrics(table) = trial.run().unwrap().get("metrics");
    let truth = rows(&table, "truth");
    let of = |all: &[(String, String, Option<f64>)], region: &str, quantity: &str| {
        all.iter().find(|(r, q, _)| r == region && q == quantity).map(|row| row.2.expect("it is known")).expect("a row")
    };
    for (region, quantity, is) in [
        ("arm", "HbO2", 45.0),
        ("arm", "THb", 60.0),
        ("arm", "StO2", 0.75),
        ("vein", "StO2", 0.3),
        ("vein", "Hb", 42.0),
        ("all", "HbO2", 31.5),
    ] {
        assert!((of(&truth, region, quantity) - is).abs() < 1e-6, "{region} {quantity}");
    }
    let bias = rows(&table, "bias");
    assert!(of(&bias, "arm", "HbO2").abs() < 1e-6 && (of(&bias, "vein", "HbO2") - 1.0).abs() < 1e-6, "{bias:?}");
    assert!(truth.iter().all(|(_, quantity, _)| quantity != "residual"));
    let form = trial.describe().remove("metrics").expect("it is described");
    assert!(form.columns.is_none(), "units differ between rows");
    let one = Trial::of::<Compare>(json!({"concentrations": {"vein": {"HbO2": 18}}}))
        .input("estimate", found())
        .input("truth", scene());
    let Metrics(table) = one.run().unwrap().get("metrics");
    assert_eq!(texts(&table, "region"), ["all", "vein"]);
}

/// Without a scene one truth holds for all pixels.
#[test]
fn all_pixels_have_one_truth() {
    let trial = trial(json!({"all": {"HbO2": 32, "Hb": 28.5}}));
    trial.passes();
    let Metrics(table) = trial.run().unwrap().get("metrics");
    let bias = rows(&table, "bias");
    assert_eq!(bias.iter().map(|row| row.1.as_str()).collect::<Vec<_>>(), ["HbO2", "Hb", "THb", "StO2"]);
    assert!(bias[0].2.unwrap().abs() < 1e-6 && bias[1].2.unwrap().abs() < 1e-6, "{bias:?}");
}

#[test]
fn mistakes_are_named() {
    for (params, path, words) in [
        (json!({}), "concentrations", "what they should be is not said"),
        (json!({"arm": {"HbO2": 45}}), "concentrations.arm", "is told by the port `truth` of a render"),
        (json!({"all": {}}), "concentrations.all", "no concentration is named"),
        (json!({"all": {"HbO2": -1}}), "concentrations.all.HbO2", "HbO2 = -1 uM must be >= 0"),
        (json!({"all": {"StO2": 75}}), "concentrations.all.StO2", "[0, 1]"),
        (json!({"all": {"HbO": 45}}), "concentrations.all.HbO", "did you mean `Hb`?"),
        (json!({"all": {"lipid": 0.1}}), "concentrations.all.lipid", "the estimate has no `lipid`"),
        (
            json!({"all": {"HbO2": 45, "Hb": 15, "StO2": 0.7}}),
            "concentrations.all.StO2",
            "contradicts HbO2 and Hb, which make it 0.75",
        ),
    ] {
        trial(params).refuses(path, words);
    }
    trial(json!({"arm": {"HbO2": 45}, "leg": {"HbO2": 1}}))
        .input("truth", scene())
        .refuses("concentrations.leg", "it has arm, vein");
    let mut other = found();
    other.0.layers[0].info.unit = "1".to_owned();
    let params = json!({"concentrations": {"all": {"HbO2": 45}}});
    Trial::of::<Compare>(params).input("estimate", other).refuses("in.estimate", "HbO2 is in 1, and uM is wanted");
}

/// Concentrations can be tabulated: a row for each quantity, with the errors of its mean.
#[test]
fn concentrations_are_tabulated() {
    let trial = Trial::of::<Tabulate>(json!({})).input("values", found());
    let Metrics(table) = trial.run().unwrap().get("metrics");
    let means = rows(&table, "mean");
    assert_eq!(means[0].1, "HbO2");
    assert!((means[0].2.unwrap() - 32.0).abs() < 1e-6 && (means[2].2.unwrap() - 60.5).abs() < 1e-6, "{means:?}");
    assert_eq!(texts(&table, "unit")[..4], ["uM", "uM", "uM", "1"]);
}
