//! Media written by what absorbs in them: the sum over tabulated spectra at the scene's wavelengths, and what is refused.

use serde_json::{Value, json};
use turbid_contract::kit::Trial;
use turbid_contract::payload::Scene;
use turbid_optics::chromophore::{Chromophore, reduced_scattering};
use turbid_scene::SceneStage;

use crate::carcinoma;

fn tissue(medium: Value, wavelength_nm: Value) -> Trial {
    let mut params = carcinoma();
    params["media"]["scc"] = medium;
    params["wavelength_nm"] = wavelength_nm;
    params["camera"]["specular"] = json!("exclude");
    Trial::of::<SceneStage>(params)
}

fn skin() -> Value {
    json!({
        "HbO2": "40 uM", "Hb": 20, "water": "70 %", "lipid": 0.1, "melanin": 0.01,
        "scattering": {"a": "15 /cm", "b": 1.2}, "g": 0.9, "n": 1.4,
    })
}

/// mu_a is the sum of concentration times table, mu_s' the power law; 13 digits are kept.
#[test]
fn media_are_the_sum_of_what_absorbs() {
    let wavelengths = [532.0, 660.0, 801.3, 940.0];
    let made = tissue(skin(), json!(wavelengths)).run().expect("it is a scene");
    let scene: Scene = made.get("scene");
    let medium = &scene.media["scc"];
    let amounts = [40.0, 20.0, 0.7, 0.1, 0.01];
    for (k, &nm) in wavelengths.iter().enumerate() {
        let mu_a: f64 = Chromophore::ALL.iter().zip(amounts).map(|(c, c_i)| c_i * c.mu_a_per_mm(nm).unwrap()).sum();
        let mu_s = reduced_scattering(1.5, 1.2, nm) / (1.0 - 0.9);
        assert!((medium.mu_a[k] / mu_a - 1.0).abs() < 1e-12, "{nm} nm: {} {mu_a}", medium.mu_a[k]);
        assert!((medium.mu_s[k] / mu_s - 1.0).abs() < 1e-12, "{nm} nm: {} {mu_s}", medium.mu_s[k]);
    }
    // 40 uM and 0.04 mM are one scene.
    let mut other = skin();
    other["HbO2"] = json!("0.04 mM");
    assert_eq!(tissue(other, json!(wavelengths)).run().expect("it is a scene").get::<Scene>("scene"), scene);
}

/// What absorbs may stand with any scattering, and a power law with mu_a.
#[test]
fn pairs_may_be_mixed() {
    let wavelengths = json!([660, 850]);
    for medium in [
        json!({"Hb": 50, "mu_s_prime": [1.2, 1.0], "g": 0.8, "n": 1.4}),
        json!({"water": 1, "mu_s": 10, "g": 0.8, "n": 1.33}),
        json!({"mu_a": [0.01, 0.02], "scattering": {"a": 1, "b": 1}, "g": 0.8, "n": 1.4}),
    ] {
        tissue(medium, wavelengths.clone()).passes();
    }
}

#[test]
fn mistakes_of_chromophores_are_named() {
    let two = json!([660, 850]);
    let of = |key: &str, value: Value| {
        let mut medium = skin();
        medium[key] = value;
        medium
    };
    for (medium, wavelengths, at, text) in [
        (of("HbO2", json!(-1)), &two, "media.scc.HbO2", "HbO2 = -1 uM must be >= 0"),
        (of("water", json!(-0.1)), &two, "media.scc.water", "water = -0.1 must lie in [0, 1]"),
        (of("water", json!(70)), &two, "media.scc.water", "share of the volume"),
        (of("lipid", json!(0.4)), &two, "media.scc", "take 1.11 of the volume"),
        (of("scattering", json!({"a": -1, "b": 1})), &two, "media.scc.scattering.a", "a = -1 mm^-1 must be >= 0"),
        (of("scattering", json!({"a": 1, "b": 12})), &two, "media.scc.scattering.b", "[-4, 4]"),
        (of("mu_a", json!(0.1)), &two, "media.scc", "exactly one pair"),
        (of("mu_s", json!(1)), &two, "media.scc", "exactly one pair"),
        (of("Hb", json!("20 mm")), &two, "media.scc.Hb", "dimension length; concentration in uM is wanted"),
        (of("HbO", json!(1)), &two, "media.scc.HbO", "there is no key `HbO` here"),
        (
            json!({"Hb": 1, "mu_s": 1, "g": 0, "n": 1}),
            &json!([1010]),
            "media.scc.Hb",
            "from 250 to 1000 nm, not at 1010 nm",
        ),
        (json!({"Hb": 1, "mu_s": 1, "g": 0, "n": 1}), &json!([]), "media.scc.Hb", "the scene names none"),
        (
            json!({"mu_a": 0.1, "scattering": {"a": 1, "b": 1}, "g": 0, "n": 1}),
            &json!([]),
            "media.scc.scattering",
            "the scene names none",
        ),
    ] {
        let (mistakes, _) = tissue(medium.clone(), wavelengths.clone()).check();
        let told = mistakes.iter().map(ToString::to_string).find(|t| t.starts_with(&format!("{at}: ")));
        assert!(told.as_ref().is_some_and(|told| told.contains(text)), "{at}: {text}: {mistakes:#?}");
    }
}
