//! The stage as the engine calls it: layers, masks, flags, what is passed on.

use turbid_chromophores::Chromophores;
use turbid_contract::kit::Trial;
use turbid_contract::ndarray::{Array2, array};
use turbid_contract::payload::{Concentrations, Maps, MaskReason};
use turbid_contract::serde_json::{Value, json};
use turbid_contract::{ImageStack, LayerInfo, LayerKind};
use turbid_optics::chromophore::{Chromophore, reduced_scattering};

use crate::{at, maps};

const WAVELENGTHS: [f64; 4] = [660.0, 730.0, 850.0, 940.0];

/// mu_a of HbO2, Hb (uM) and water at a wavelength.
fn absorption(amounts: [f64; 3], nm: f64) -> f64 {
    let species = [Chromophore::HbO2, Chromophore::Hb, Chromophore::Water];
    species.iter().zip(amounts).map(|(c, x)| x * c.mu_a_per_mm(nm).expect("in the table")).sum()
}

/// One pixel for each of some tissues, all with the same scattering.
fn tissues(amounts: &[[f64; 3]], se: Option<f64>) -> Maps {
    maps(amounts.len(), &WAVELENGTHS, &["mu_a", "mu_s_prime"], &mut |name, k, pixel| {
        let nm = WAVELENGTHS[k];
        let value = if name == "mu_a" { absorption(amounts[pixel], nm) } else { reduced_scattering(1.5, 1.2, nm) };
        (value, se.map(|se| se * value.abs()))
    })
}

fn three() -> Value {
    json!({"chromophores": ["HbO2", "Hb", "water"]})
}

fn made(params: Value, maps: Maps) -> ImageStack {
    let made = Trial::of::<Chromophores>(params).input("maps", maps).run().expect("it runs");
    made.get::<Concentrations>("concentrations").0
}

fn pixels(stack: &ImageStack, name: &str) -> Vec<f32> {
    stack.find(name, None).unwrap_or_else(|| panic!("no layer {name}")).pixels().to_vec()
}

fn mean_se(stack: &ImageStack, name: &str) -> Option<f64> {
    stack.find(name, None).unwrap_or_else(|| panic!("no layer {name}")).info.mean_se
}

fn near(is: f32, exact: f64) -> bool {
    // f32 maps have 6e-8, which unmixing may raise by the condition number, some 10.
    (f64::from(is) - exact).abs() <= 1e-5 * exact.abs().max(1.0)
}

#[test]
fn it_keeps_the_rules() {
    let amounts = [[40.0, 20.0, 0.7], [60.0, 5.0, 0.5], [10.0, 0.0, 0.8]];
    for params in [three(), json!({}), json!({"chromophores": ["Hb", "water"], "fit": "linear", "scattering": true})] {
        for se in [Some(0.02), None] {
            Trial::of::<Chromophores>(params.clone()).input("maps", tissues(&amounts, se)).keeps_the_rules();
        }
    }
}

/// Of noise-free maps all comes back, and saturation with it; layers have their units.
#[test]
fn tissues_come_back() {
    let amounts = [[40.0, 20.0, 0.7], [60.0, 5.0, 0.5], [1.0, 99.0, 0.3]];
    let mut params = three();
    params["scattering"] = json!(true);
    let stack = made(params, tissues(&amounts, Some(0.02)));
    for (pixel, [hbo2, hb, water]) in amounts.into_iter().enumerate() {
        for (name, exact) in [
            ("HbO2", hbo2),
            ("Hb", hb),
            ("water", water),
            ("THb", hbo2 + hb),
            ("StO2", hbo2 / (hbo2 + hb)),
            ("scatter_a", 1.5),
            ("scatter_b", 1.2),
            ("at_bound", 0.0),
            ("mask", 0.0),
        ] {
            assert!(near(pixels(&stack, name)[pixel], exact), "{name}: {:?} {exact}", pixels(&stack, name));
        }
    }
    for (name, unit) in [
        ("HbO2", "uM"),
        ("water", "1"),
        ("THb", "uM"),
        ("StO2", "1"),
        ("scatter_a", "mm^-1"),
        ("scatter_b", "1"),
        ("residual", "mm^-1"),
        ("HbO2_se", "uM"),
        ("scatter_a_se", "mm^-1"),
    ] {
        assert_eq!(stack.find(name, None).expect("it is made").info.unit, unit, "{name}");
    }
    assert_eq!(stack.attributes["wavelengths_nm"], json!(WAVELENGTHS));
    assert!(pixels(&stack, "residual").iter().all(|&r| r < 1e-8));
}

/// What is fixed is taken off; wavelengths may be chosen; a spectrum of one's own counts like those that are known.
#[test]
fn what_is_known_is_taken_off() {
    let maps = || tissues(&[[40.0, 20.0, 0.7]], Some(0.02));
    let stack = made(json!({"fixed": {"water": "70 %"}, "wavelength_nm": [660, 850]}), maps());
    assert!(near(pixels(&stack, "HbO2")[0], 40.0) && near(pixels(&stack, "Hb")[0], 20.0));
    assert_eq!(stack.attributes["wavelengths_nm"], json!([660.0, 850.0]));
    let per_cm = |nm: f64| 10.0 * Chromophore::Water.mu_a_per_mm(nm).expect("in the table");
    let rows: String = WAVELENGTHS.iter().map(|&nm| format!("{nm},{}\n", per_cm(nm))).collect();
    let params = json!({"chromophores": ["HbO2", "Hb", "juice"], "spectra": [{"file": "a/b.csv", "unit": "per_cm"}]});
    let trial = Trial::of::<Chromophores>(params).input("maps", maps());
    let trial = trial.file("spectra.0.file", format!("wavelength_nm,juice\n{rows}").into_bytes());
    trial.keeps_the_rules();
    let stack = trial.run().expect("it runs").get::<Concentrations>("concentrations").0;
    assert!(near(pixels(&stack, "juice")[0], 0.7), "{:?}", pixels(&stack, "juice"));
    assert_eq!(trial.job().canonical().unwrap().pointer("/spectra/0/file"), Some(&json!("b.csv")));
    assert_eq!(trial.job().files()[0].path, "a/b.csv");
}

/// `species` is another word for `chromophores`.
#[test]
fn both_words_mean_the_same() {
    let canonical = |params: Value| Trial::of::<Chromophores>(params).job().canonical().unwrap();
    assert_eq!(canonical(json!({"species": ["Hb"]})), canonical(json!({"chromophores": ["Hb"]})));
}

/// A concentration that would be negative is held at 0: its pixel is counted, the errors of all that is told from mu_a are flagged, those of
/// scattering are not, and means have no error. With `linear` it is below 0, and all errors are known.
#[test]
fn bounds_are_flagged() {
    let amounts = [[40.0, 20.0, 0.7], [40.0, 20.0, -0.1]];
    let mut params = three();
    params["scattering"] = json!(true);
    let stack = made(params.clone(), tissues(&amounts, Some(0.02)));
    assert_eq!((pixels(&stack, "at_bound"), pixels(&stack, "mask")), (vec![0.0, 1.0], vec![0.0, 0.0]));
    assert_eq!(pixels(&stack, "water")[1], 0.0);
    for name in ["HbO2", "Hb", "water", "THb", "StO2"] {
        assert_eq!(pixels(&stack, &format!("{name}_se_unknown")), [0.0, 1.0], "{name}");
        assert_eq!(mean_se(&stack, name), None, "{name}");
    }
    assert!(stack.find("scatter_a_se_unknown", None).is_none() && mean_se(&stack, "scatter_a").is_some());
    params["fit"] = json!("linear");
    let stack = made(params, tissues(&amounts, Some(0.02)));
    assert!(near(pixels(&stack, "water")[1], -0.1) && stack.find("at_bound", None).is_none());
    assert!(stack.find("water_se_unknown", None).is_none() && mean_se(&stack, "water").is_some());
}

/// StO2 near 0 or 1, and of hardly any haemoglobin, has no error of first order: it is flagged, the concentrations are not. With `linear` there is no
/// bound to be near to.
#[test]
fn saturation_near_its_ends_is_flagged() {
    // 2 % of mu_a are some 1 uM of either haemoglobin.
    let amounts = [[40.0, 20.0, 0.7], [40.0, 0.1, 0.7], [0.1, 40.0, 0.7], [0.5, 0.6, 0.7]];
    let flags = |fit: &str| {
        let mut params = three();
        params["fit"] = json!(fit);
        let stack = made(params, tissues(&amounts, Some(0.02)));
        assert!(stack.find("HbO2_se_unknown", None).is_none(), "{fit}");
        assert!(mean_se(&stack, "THb").is_some() && mean_se(&stack, "StO2").is_none(), "{fit}");
        pixels(&stack, "StO2_se_unknown")
    };
    assert_eq!((flags("non_negative"), flags("linear")), (vec![0.0, 1.0, 1.0, 1.0], vec![0.0, 0.0, 0.0, 1.0]));
}

/// Reasons that came in stay, of the first wavelength that has one; no haemoglobin has no saturation; no power law no fit.
#[test]
fn masks_have_reasons() {
    let Maps(mut stack) = tissues(&[[40.0, 20.0, 0.7]; 5], Some(0.02));
    let mask = |nm: f64| LayerInfo { wavelength_nm: Some(nm), ..LayerInfo::new("mask", LayerKind::Mask, "1") };
    stack.push(mask(660.0), array![[0.0, 0.0, 0.0, 0.0, 0.0]]);
    stack.push(mask(850.0), array![[0.0, 4.0, 0.0, 0.0, 0.0]]);
    stack.push(mask(940.0), array![[0.0, 8.0, 0.0, 0.0, 0.0]]);
    let set = |stack: &mut ImageStack, name: &str, pixel: usize, value: f32| {
        let layers = stack.layers.iter_mut().filter(|l| l.info.name == name);
        layers.for_each(|layer| layer.data[[0, pixel]] = value);
    };
    set(&mut stack, "mu_a", 2, f32::NAN);
    set(&mut stack, "mu_a", 3, 0.0);
    set(&mut stack, "mu_s_prime", 4, 0.0);
    let stack = made(json!({"chromophores": ["HbO2", "Hb"], "scattering": true}), Maps(stack));
    let reasons =
        [MaskReason::Good, MaskReason::BelowTable, MaskReason::NotFinite, MaskReason::LowSignal, MaskReason::NoFit];
    assert_eq!(pixels(&stack, "mask"), reasons.map(MaskReason::code));
    for layer in stack.layers.iter().filter(|layer| layer.info.name != "mask") {
        assert!(layer.pixels()[1..].iter().all(|&v| v == 0.0), "{}", layer.info.name);
    }
}

/// Flags of unknown errors are passed on: of mu_a at one wavelength to all that is told from it.
#[test]
fn unknown_errors_are_passed_on() {
    let Maps(mut stack) = tissues(&[[40.0, 20.0, 0.7]; 2], Some(0.02));
    stack.push(at("mu_a", 730.0).se_unknown(), array![[0.0, 1.0]]);
    let mut params = three();
    params["scattering"] = json!(true);
    let stack = made(params, Maps(stack));
    assert_eq!(pixels(&stack, "StO2_se_unknown"), [0.0, 1.0]);
    assert!(stack.find("scatter_b_se_unknown", None).is_none());
    assert_eq!(mean_se(&stack, "StO2"), None);
}

/// Pixels that share their noise have means that are as uncertain as one; conditions and pitch go along.
#[test]
fn what_is_known_of_pixels_is_carried_on() {
    let Maps(mut stack) = tissues(&[[40.0, 20.0, 0.7]; 4], Some(0.02));
    stack.attributes.insert("sharing".to_owned(), json!(4.0));
    stack.attributes.insert("pixel_pitch_mm".to_owned(), json!([0.5, 0.5]));
    stack.push(LayerInfo::new("view_deg", LayerKind::Condition, "deg"), Array2::zeros((1, 4)));
    let stack = made(three(), Maps(stack));
    let (of_mean, se) = (mean_se(&stack, "StO2").expect("it is known"), f64::from(pixels(&stack, "StO2_se")[0]));
    assert!((of_mean / se - 1.0).abs() < 1e-6, "{of_mean} {se}");
    assert_eq!(stack.pixel_pitch_mm(), Some([0.5, 0.5]));
    assert!(stack.find("view_deg", None).is_some());
}

/// What else absorbs shows in the residual, and is told.
#[test]
fn what_is_not_explained_is_told() {
    let Maps(mut stack) = tissues(&[[40.0, 20.0, 0.7]; 4], Some(0.01));
    let layer = stack.layers.iter_mut().find(|l| l.info == at("mu_a", 730.0)).expect("it is there");
    layer.data.mapv_inplace(|v| 1.3 * v);
    let run = Trial::of::<Chromophores>(three()).input("maps", Maps(stack)).run().expect("it runs");
    assert!(run.host.measured("reduced_chi2").expect("a wavelength more than chromophores") > 10.0);
    assert!(run.host.warned().iter().any(|w| w.contains("do not explain mu_a")), "{:?}", run.host.warned());
    let Concentrations(stack) = run.get("concentrations");
    assert!(pixels(&stack, "residual")[0] > 1e-4);
}

/// `plan` says the condition number, which is that of the run.
#[test]
fn the_plan_says_the_condition_number() {
    let trial = Trial::of::<Chromophores>(three()).input("maps", tissues(&[[40.0, 20.0, 0.7]], Some(0.02)));
    let method = trial.plan().method.expect("it has one");
    let measured = trial.run().expect("it runs").host.measured("condition_number").expect("it is measured");
    let said = format!("HbO2, Hb, water at 660, 730, 850, 940 nm: condition number {measured:.3}");
    assert!(method.contains(&said), "{method}");
    println!("{method}");
}
