//! Several wavelengths of which each reads the table of its g and n.

use turbid_contract::kit::Trial;
use turbid_contract::serde_json::{Value, json};

use super::*;

const MEDIA: [[f64; 2]; 2] = [[0.8, 1.4], [0.6, 1.33]];

fn of_medium([g, n]: [f64; 2], f_x: f64, [mu_a, mu_s_prime]: [f64; 2]) -> f64 {
    diffusion::reflectance(&Medium { mu_a, mu_s_prime, phase: PhaseFunction::henyey_greenstein(g), n }, None, f_x)
        .expect("an ordinary half-space")
        .camera
}

/// A table for each medium, one after the other, for these wavelengths.
fn tables(media: &[[f64; 2]], wavelengths: &[f64], of: &[usize]) -> Lut {
    let mut all = lut(&F_X, |a, s, f| of_medium(media[0], f, [a, s]));
    let mut rows = Vec::new();
    for &medium in media {
        let one = lut(&F_X, |a, s, f| of_medium(medium, f, [a, s]));
        rows.extend(one.0.f64s("r_d").unwrap().to_vec());
    }
    let table = all.0.to_mut();
    table.columns[0].cells = Cells::F64(rows);
    let list = |k: usize| json!(of.iter().map(|&t| media[t][k]).collect::<Vec<f64>>());
    let facts = [("g", list(0)), ("n", list(1)), ("wavelengths_nm", json!(wavelengths))];
    table.attributes.extend(facts.map(|(name, value)| (name.to_owned(), value)));
    all
}

/// The reflectance of one medium at each wavelength, g and n as lists.
fn lit(of: &[(f64, usize)], mu: [f64; 2]) -> Reflectance {
    let mut stack = ImageStack::new(1, 1);
    for &(nm, medium) in of {
        for f_x in F_X {
            let info = LayerInfo { wavelength_nm: Some(nm), ..LayerInfo::value("r_d", "1").with_f_x(f_x) };
            stack.push(info, Array2::from_elem((1, 1), of_medium(MEDIA[medium], f_x, mu) as f32));
        }
    }
    let list = |k: usize| json!(of.iter().map(|&(_, medium)| MEDIA[medium][k]).collect::<Vec<f64>>());
    let facts = [("g", list(0)), ("n", list(1)), ("convention", "camera".into())];
    stack.attributes = facts.into_iter().map(|(k, v): (&str, Value)| (k.to_owned(), v)).collect();
    Reflectance(stack)
}

fn trial(reflectance: Reflectance, lut: Lut) -> Trial {
    Trial::of::<Invert>(json!({})).input("reflectance", reflectance).input("lut", lut)
}

fn value(stack: &ImageStack, name: &str, nm: f64) -> f32 {
    let wanted =
        |l: &&Layer| l.info.name == name && l.info.wavelength_nm == Some(nm) && l.info.kind == LayerKind::Value;
    stack.layers.iter().find(wanted).expect("the maps hold it").data[(0, 0)]
}

/// Each wavelength comes back by its own table, bit for bit as from that table alone, whatever their order and whichever else the artifact holds.
#[test]
fn each_wavelength_reads_its_table() {
    let mu = [0.03, 1.1];
    let all = tables(&MEDIA, &[660.0, 730.0, 850.0], &[0, 1, 0]);
    let made = trial(lit(&[(850.0, 0), (730.0, 1), (660.0, 0)], mu), all).run().unwrap();
    let maps: turbid_contract::payload::Maps = made.get("maps");
    for (nm, medium) in [(660.0, 0), (730.0, 1), (850.0, 0)] {
        let table = tables(&MEDIA[medium..=medium], &[nm], &[0]);
        let alone: turbid_contract::payload::Maps = trial(lit(&[(nm, medium)], mu), table).run().unwrap().get("maps");
        for (k, name) in ["mu_a", "mu_s_prime"].into_iter().enumerate() {
            let found = value(&maps.0, name, nm);
            assert_eq!(found, value(&alone.0, name, nm), "{name} at {nm} nm");
            // f32 of R_d, and the spline between 41 nodes.
            assert!((f64::from(found) / mu[k] - 1.0).abs() < 1e-3, "{name} at {nm} nm: {found}");
        }
    }
}

/// Wavelengths that one side has and the other lacks are named, each; g and n that differ with the wavelength at which they do.
#[test]
fn wavelengths_that_do_not_fit_are_named() {
    let mu = [0.03, 1.1];
    let two = || tables(&MEDIA, &[660.0, 850.0], &[0, 1]);
    let lacks = trial(lit(&[(660.0, 0), (730.0, 0), (940.0, 1)], mu), two());
    lacks.refuses(
        "in.lut",
        "the reflectance is of 730 nm, 940 nm, the table is for 660, 850 nm; the table is also for 850 nm",
    );
    let error = lacks.run().map(|_| ()).unwrap_err().to_string();
    assert!(error.contains("730 nm, 940 nm"), "{error}");
    let unused = trial(lit(&[(660.0, 0)], mu), two());
    let (mistakes, warnings) = unused.check();
    let told = warnings.iter().any(|w| w.to_string().contains("the table is also for 850 nm, the reflectance is not"));
    assert!(mistakes.is_empty() && told, "{mistakes:?} {warnings:?}");
    let other = trial(lit(&[(660.0, 0), (850.0, 0)], mu), two());
    other.refuses("in.lut", "the reflectance has g = 0.8 at 850 nm, the table g = 0.6");
    let nameless = trial(reflectance(&[[0.3, 0.2]], None), two());
    nameless.refuses("in.lut", "the reflectance is of a wavelength that is not said");
}

/// Beside a plate a reflectance has no g and n: the table's are taken.
#[test]
fn beside_a_plate_the_table_says_g_and_n() {
    let mu = [0.03, 1.1];
    let mut beside = lit(&[(660.0, 0), (850.0, 1)], mu);
    beside.0.attributes.retain(|name, _| name == "convention");
    let table = || tables(&MEDIA, &[660.0, 850.0], &[0, 1]);
    let silent = trial(beside.clone(), table()).run().map(|_| ()).unwrap_err().to_string();
    assert!(silent.contains("the reflectance does not say its g"), "{silent}");
    beside.0.attributes.insert("reference".to_owned(), json!({"reflectance": 0.99}));
    let maps: turbid_contract::payload::Maps = trial(beside, table()).run().unwrap().get("maps");
    for nm in [660.0, 850.0] {
        let found = value(&maps.0, "mu_a", nm);
        assert!((f64::from(found) / mu[0] - 1.0).abs() < 1e-3, "{nm}: {found}");
    }
}

/// What does not say its convention is warned of, with what is meant by most.
#[test]
fn a_table_without_a_convention_is_warned_of() {
    let mut table = tables(&MEDIA, &[660.0, 850.0], &[0, 1]);
    table.0.to_mut().attributes.remove("convention");
    let (_, warnings) = trial(lit(&[(660.0, 0), (850.0, 1)], [0.03, 1.1]), table).check();
    let told = warnings.iter().map(ToString::to_string).filter(|w| w.contains("convention")).collect::<Vec<_>>();
    assert!(told.len() == 1 && told[0].starts_with("in.lut: `made.lut` does not say its convention"), "{told:?}");
    assert!(told[0].contains("published tables are `hemispherical_incident`"), "{told:?}");
}
