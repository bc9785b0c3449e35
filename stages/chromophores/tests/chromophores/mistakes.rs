//! What is refused, with its place and the way out, before anything runs.

use turbid_chromophores::Chromophores;
use turbid_contract::LayerInfo;
use turbid_contract::kit::Trial;
use turbid_contract::payload::Maps;
use turbid_contract::serde_json::{Value, json};

use crate::maps;

fn flat(wavelengths: &[f64]) -> Maps {
    maps(1, wavelengths, &["mu_a"], &mut |_, _, _| (0.02, Some(1e-3)))
}

fn trial(params: Value, wavelengths: &[f64]) -> Trial {
    Trial::of::<Chromophores>(params).input("maps", flat(wavelengths))
}

const FOUR: [f64; 4] = [660.0, 730.0, 850.0, 940.0];

#[test]
fn params_are_checked() {
    let known = "known: `HbO2`, `Hb`, `water`, `lipid`, `melanin`";
    for (params, at, text) in [
        (json!({"chromophores": []}), "chromophores", "0 chromophores"),
        (json!({"chromophores": ["HbO2", "Hbb"]}), "chromophores.1", "did you mean `Hb`?"),
        (json!({"chromophores": ["HbO2", "bilirubin"]}), "chromophores.1", known),
        (json!({"chromophores": ["Hb", "Hb"]}), "chromophores.1", "stands twice"),
        (json!({"fixed": {"water": -0.1}}), "fixed.water", "[0, 1]"),
        (json!({"fixed": {"water": 70}}), "fixed.water", "share of the volume"),
        (json!({"fixed": {"water": "3 uM"}}), "fixed.water", "a share of the volume, 0.7 or `70 %`, is wanted"),
        (json!({"fixed": {"Hb": 10}}), "fixed.Hb", "looked for and fixed"),
        (json!({"fixed": {"watr": 1}}), "fixed.watr", "did you mean `water`?"),
        (json!({"largest_condition": 0.5}), "largest_condition", ">= 1"),
        (json!({"wavelength_nm": [660, 800]}), "in.maps", "no mu_a at 800 nm; there is at 660, 730, 850, 940 nm"),
        (json!({"wavelength_nm": [660]}), "in.maps", "one wavelength, 660 nm"),
        (json!({"scattering": true}), "in.maps", "no layer `mu_s_prime` at 660 nm"),
        (json!({"fixedd": {}}), "fixedd", "did you mean `fixed`?"),
        (json!({"fit": "nonnegative"}), "fit", "did you mean `non_negative`?"),
    ] {
        trial(params, &FOUR).refuses(at, text);
    }
}

/// Wavelengths that do not suffice: too few, beyond a spectrum, alike.
#[test]
fn wavelengths_are_checked() {
    let three = json!({"chromophores": ["HbO2", "Hb", "water"]});
    let few = "3 chromophores are looked for at 2 wavelengths, 660, 850 nm";
    trial(three, &[660.0, 850.0]).refuses("chromophores", few);
    let beyond = trial(json!({"chromophores": ["Hb", "water"]}), &[660.0, 1064.0]);
    beyond.refuses("chromophores.0", "reaches from 250 to 1000 nm, not to 1064 nm");
    beyond.refuses("chromophores.0", "nothing is extrapolated");
    trial(json!({"fixed": {"lipid": 0.1}}), &[420.0, 660.0]).refuses("fixed.lipid", "429 to 1098 nm, not to 420 nm");
    trial(json!({}), &[660.0]).refuses("in.maps", "there is one wavelength, 660 nm");
    trial(json!({"largest_condition": 1.5}), &[660.0, 940.0]).refuses("chromophores", "HbO2 and Hb are most alike");
    // Two near neighbours see the same mixture.
    trial(json!({}), &[806.0, 807.0]).refuses("chromophores", "condition number");
    trial(json!({}), &[660.0, 850.0]).passes();
}

/// Maps of something else, or that do not say their wavelength.
#[test]
fn maps_are_checked() {
    let other = maps(1, &FOUR, &["height"], &mut |_, _, _| (0.0, None));
    let trial = |maps: Maps| Trial::of::<Chromophores>(json!({})).input("maps", maps);
    trial(other).refuses("in.maps", "`made.maps`: there is no layer `mu_a`");
    let Maps(mut stack) = flat(&FOUR);
    stack.layers.iter_mut().for_each(|layer| layer.info.wavelength_nm = None);
    stack.layers.truncate(1);
    trial(Maps(stack)).refuses("in.maps", "names no wavelength");
    let Maps(mut stack) = flat(&FOUR);
    stack.layers[1].info = LayerInfo { wavelength_nm: Some(660.0), ..stack.layers[1].info.clone() };
    trial(Maps(stack)).refuses("in.maps", "two layers `mu_a` at 660 nm");
}

/// Files of spectra are named with line and column; a name that one of them may hold is no mistake of its own.
#[test]
fn files_of_spectra_are_checked() {
    let params = json!({"chromophores": ["HbO2", "Hb", "ink"], "spectra": [{"file": "lab/ink.csv", "unit": "per_mm"}]});
    let with = |text: &str| trial(params.clone(), &FOUR).file("spectra.0.file", text.as_bytes().to_vec());
    for (text, told) in [
        ("nm,ink\n600,1\n", "lab/ink.csv:1:1: no column wavelength_nm"),
        ("wavelength_nm,ink\n600,1\n700,nan\n", "lab/ink.csv:3:2: ink = `nan` is not a finite number"),
        ("wavelength_nm,ink\n700,1\n600,1\n", "lab/ink.csv:3:1: wavelength_nm = 600 nm follows 700 nm"),
        ("wavelength_nm,ink,StO2\n600,1,1\n", "may not be called StO2"),
    ] {
        let (mistakes, _) = with(text).check();
        let first = mistakes.first().unwrap_or_else(|| panic!("{told} is expected")).to_string();
        assert!(first.starts_with("spectra.0.file: ") && first.contains(told), "{told}: {first}");
    }
    with("wavelength_nm,inky\n600,1\n1000,2\n").refuses("chromophores.2", "did you mean `inky`?");
    with("wavelength_nm,ink\n600,1\n900,2\n").refuses("chromophores.2", "600 to 900 nm, not to 940 nm");
    with("wavelength_nm,ink\n600,0\n1000,0\n").refuses("chromophores.2", "absorbs nothing");
    with("wavelength_nm,ink\n600,3\n1000,1\n").passes();
    // A file that cannot be read is told by whoever reads it.
    trial(params.clone(), &FOUR).passes();
}
