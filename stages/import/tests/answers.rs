//! Maps, modulation and reflectance of others: units, standard errors, masks, and every mistake.

use serde_json::{Value, json};
use turbid_contract::ImageStack;
use turbid_contract::kit::Trial;
use turbid_contract::payload::{Maps, MaskReason, Modulation, Reflectance};
use turbid_import::{ImportMaps, ImportModulation, ImportReflectance};

const ROWS: usize = 2;
const COLUMNS: usize = 3;

/// A `.npy` file of doubles.
fn npy(rows: usize, columns: usize, value: impl Fn(usize) -> f64) -> Vec<u8> {
    let mut header = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({rows}, {columns}), }}");
    header += &" ".repeat((64 - (11 + header.len()) % 64) % 64);
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend((0..rows * columns).flat_map(|i| value(i).to_le_bytes()));
    bytes
}

fn ramp(from: f64) -> Vec<u8> {
    npy(ROWS, COLUMNS, |i| from + i as f64)
}

fn pixels(stack: &ImageStack, name: &str, f_x: Option<f64>) -> Vec<f32> {
    let found = stack.layers.iter().find(|l| l.info.name == name && l.info.f_x_per_mm == f_x);
    found.unwrap_or_else(|| panic!("no {name}")).pixels().into_owned()
}

fn maps() -> Trial {
    let layers = json!([
        {"quantity": "mu_a", "file": "a.npy", "unit": "cm^-1"},
        {"quantity": "mu_s_prime", "file": "s.npy", "scale": 0.25},
        {"quantity": "mu_a_se", "file": "e.npy", "unit": "cm^-1"},
    ]);
    Trial::of::<ImportMaps>(json!({"layers": layers}))
        .file("layers.0.file", ramp(1.0))
        .file("layers.1.file", ramp(4.0))
        .file("layers.2.file", npy(ROWS, COLUMNS, |_| 0.3))
}

#[test]
fn numbers_are_in_the_units_of_the_layers() {
    let trial = maps();
    trial.passes();
    trial.keeps_the_rules();
    let Maps(stack) = trial.run().unwrap().get("maps");
    assert_eq!(pixels(&stack, "mu_a", None), [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]);
    assert_eq!(pixels(&stack, "mu_s_prime", None), [1.0, 1.25, 1.5, 1.75, 2.0, 2.25]);
    assert_eq!(pixels(&stack, "mu_a_se", None), [0.03; 6]);
    assert!(stack.mask(None).is_none());
    // Independent pixels: the mean of six.
    let mean_se = stack.layers[0].info.mean_se.unwrap();
    assert!((mean_se - 0.03 / 6.0_f64.sqrt()).abs() < 1e-12, "{mean_se}");
}

/// NaN in one quantity is unknown in all of its wavelength; so is what the mask shows.
#[test]
fn what_is_no_number_is_masked() {
    let params = json!({
        "layers": [{"quantity": "mu_a", "file": "a.npy"}, {"quantity": "mu_s_prime", "file": "s.npy"}],
        "mask": {"file": "m.npy"},
    });
    let trial = Trial::of::<ImportMaps>(params)
        .file("layers.0.file", npy(ROWS, COLUMNS, |i| if i == 2 { f64::NAN } else { 0.5 }))
        .file("layers.1.file", npy(ROWS, COLUMNS, |i| if i == 3 { f64::INFINITY } else { 2.0 }))
        .file("mask.file", npy(ROWS, COLUMNS, |i| f64::from(i == 5)));
    trial.keeps_the_rules();
    let Maps(stack) = trial.run().unwrap().get("maps");
    let [bad, out] = [MaskReason::NotFinite, MaskReason::Background].map(MaskReason::code);
    assert_eq!(stack.mask(None).unwrap().pixels().into_owned(), [0.0, 0.0, bad, bad, 0.0, out]);
    assert_eq!(pixels(&stack, "mu_a", None), [0.5, 0.5, 0.0, 0.0, 0.5, 0.0]);
}

/// At f_x = 0 the mean is the amplitude; where both are given they are taken as given.
#[test]
fn even_light_has_one_figure() {
    let layer = |quantity: &str, f_x: f64| json!({"quantity": quantity, "file": "x.npy", "f_x": f_x});
    let trial = |layers: Value| Trial::of::<ImportModulation>(json!({"layers": layers}));
    let one = trial(json!([layer("m_dc", 0.0), layer("m_ac", 0.2)]))
        .file("layers.0.file", ramp(10.0))
        .file("layers.1.file", ramp(20.0));
    one.keeps_the_rules();
    let Modulation(stack) = one.run().unwrap().get("modulation");
    assert_eq!(pixels(&stack, "m_ac", Some(0.0)), pixels(&stack, "m_dc", Some(0.0)));
    let fringe = stack.layers.iter().find(|l| l.info.f_x_per_mm == Some(0.2)).unwrap();
    assert_eq!((fringe.info.name.as_str(), fringe.info.orientation_deg), ("m_ac", Some(0.0)));
    let both = trial(json!([layer("m_dc", 0.0), layer("m_ac", 0.0)]))
        .file("layers.0.file", ramp(10.0))
        .file("layers.1.file", ramp(20.0));
    let Modulation(stack) = both.run().unwrap().get("modulation");
    assert_eq!(pixels(&stack, "m_ac", Some(0.0))[0], 20.0);
    assert_eq!(stack.layers.len(), 2);
}

#[test]
fn reflectance_says_what_it_means() {
    let params = json!({
        "layers": [{"quantity": "r_d", "file": "r.npy", "f_x": 0, "unit": "%"}],
        "convention": "hemispherical_incident",
        "conditions": {"g": 0.8, "n": 1.4},
    });
    let trial = Trial::of::<ImportReflectance>(params.clone()).file("layers.0.file", ramp(20.0));
    trial.passes();
    trial.keeps_the_rules();
    let Reflectance(stack) = trial.run().unwrap().get("reflectance");
    assert_eq!(pixels(&stack, "r_d", Some(0.0))[0], 0.2);
    assert_eq!(stack.attributes["convention"], "hemispherical_incident");
    assert_eq!((&stack.attributes["g"], &stack.attributes["n"]), (&json!(0.8), &json!(1.4)));
    let mut silent = params;
    silent.as_object_mut().unwrap().remove("convention");
    let (mistakes, warnings) = trial.with(silent).check();
    assert!(mistakes.is_empty());
    assert!(warnings.iter().any(|w| w.to_string().contains("states no convention")), "{warnings:?}");
}

#[test]
fn mistakes_are_named() {
    let layer = |more: Value| {
        let mut layer = json!({"quantity": "mu_a", "file": "a.npy"});
        layer.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        layer
    };
    let of = |layers: Value| Trial::of::<ImportMaps>(json!({"layers": layers})).file("layers.0.file", ramp(1.0));
    of(json!([])).refuses("layers", "no layer is named");
    of(json!([layer(json!({"quantity": "mua"}))])).refuses("layers.0.quantity", "none of mu_a, mu_s_prime, height");
    of(json!([layer(json!({"unit": "mm"}))])).refuses("layers.0.unit", "mu_a is in mm^-1");
    of(json!([layer(json!({"unit": "%"}))])).refuses("layers.0.unit", "not in no unit");
    of(json!([layer(json!({"scale": 0}))])).refuses("layers.0.scale", "other than 0");
    of(json!([layer(json!({"page": 0}))])).refuses("layers.0.page", "counted from 1");
    of(json!([layer(json!({"f_x": 0.1}))])).refuses("layers.0.f_x", "leave f_x out");
    of(json!([layer(json!({})), layer(json!({}))])).refuses("layers.1.quantity", "stands twice");
    of(json!([layer(json!({"quantity": "mu_a_se"}))])).refuses("layers.0.quantity", "standard error of nothing");
    let other_size = json!([layer(json!({})), layer(json!({"quantity": "mu_s_prime"}))]);
    of(other_size)
        .file("layers.1.file", npy(3, 3, |_| 1.0))
        .refuses("layers.1.file", "3 x 3 pixels, `a.npy` has 3 x 2");
    let cut = ramp(1.0);
    of(json!([layer(json!({}))]))
        .file("layers.0.file", cut[..cut.len() - 1].to_vec())
        .refuses("layers.0.file", "`a.npy`");
    of(json!([layer(json!({}))]))
        .file("layers.0.file", npy(2, 2, |_| f64::NAN))
        .refuses("layers.0.file", "no pixel of `a.npy` is a finite number");
    Trial::of::<ImportModulation>(json!({"layers": [{"quantity": "m_dc", "file": "a.npy"}]}))
        .file("layers.0.file", ramp(1.0))
        .refuses("layers.0.f_x", "m_dc needs the f_x");
    Trial::of::<ImportMaps>(json!({"layers": [layer(json!({}))], "convention": "camera"}))
        .file("layers.0.file", ramp(1.0))
        .refuses("convention", "only reflectance has a convention");
}
