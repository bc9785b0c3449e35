//! How far integrating spheres depart from the energy balance that inverse adding-doubling assumes:
//! `cargo bench --bench spheres [-- PHOTONS]` (400,000 per reading unless told otherwise).
//!
//! First ideal spheres against a table of the balance, as z scores. Then real ones: `calibrate_dis` measures media of the paper in instruments that
//! differ in one thing each; the balance says what they should read, lost light of the same run included, and `calibrate_iad` what the media are then
//! taken for. Least and greatest departure over the media, with the largest standard error.

#[path = "../stages/dis/tests/dis/balance.rs"]
#[allow(dead_code, reason = "the test of the stage judges what is printed here")]
mod balance;
#[path = "../stages/dis/tests/dis/statistics.rs"]
#[allow(dead_code, reason = "what the tests of the stage share")]
mod statistics;

use std::marker::PhantomData;

use serde_json::{Value, json};
use turbid_contract::payload::Readings;
use turbid_contract::{Cells, Ctx, MemoryHost, Stage, Table};
use turbid_dis::CalibrateDis;
use turbid_iad::{CalibrateIad, Experiment, Incidence, Instrument, Lost, Slab, Sphere, Spheres};

const CONE_DEG: f64 = 3.0;

/// The instrument of `pipelines/dis_iad.yaml` with this changed.
fn params(photons: u64, change: &Value) -> Value {
    let medium = |a: f64, s: f64| json!({"A_rho": a, "S_rho": s, "g": 0.8, "n": 1.0});
    let mut all = json!({
        "media": {
            "reference": medium(1.0, 20000.0), "oesophagus": medium(25.0, 4236.0), "carcinoma": medium(96.0, 3721.0),
            "barrett": medium(22.0, 3215.0), "tube": medium(100.0, 5000.0), "tube_quarter": medium(50.0, 20000.0)
        },
        "spheres": {
            "diameter": 100, "wall_reflectance": 0.98,
            "ports": {
                "entrance": {"round": {"diameter": 10}}, "sample": {"round": {"diameter": 10}},
                "detector": {"round": {"diameter": 10}, "sees": "wall"}
            }
        },
        "sample": {"thickness": 1, "size": [10, 10]},
        "beam": {"collimated": {"diameter": 1}},
        "standard": {"reflectance": 0.99},
        "samples": photons
    });
    merge(&mut all, change);
    all
}

/// Puts `change` over `base`; null removes.
fn merge(base: &mut Value, change: &Value) {
    match (base, change) {
        (Value::Object(base), Value::Object(change)) => {
            for (key, value) in change {
                if value.is_null() {
                    base.remove(key);
                } else {
                    merge(base.entry(key.clone()).or_insert(Value::Null), value);
                }
            }
        }
        (base, change) => *base = change.clone(),
    }
}

fn measure(params: &Value) -> Table {
    let host = MemoryHost { seed: 5, ..MemoryHost::default() };
    let params = serde_json::from_value(params.clone()).expect("params");
    CalibrateDis::run(&params, turbid_dis::In { source: PhantomData }, Ctx::new(&host)).expect("readings").readings.0
}

/// What the balance reads of each medium in this light.
fn expected(readings: &Table, light: Incidence) -> Vec<[f64; 2]> {
    let spheres = &readings.attributes["spheres"];
    let number = |name: &str| spheres[name].as_f64().expect("a number");
    let of = |third: &str| Sphere {
        sample: number("sample"),
        third: number(third),
        detector: number("detector"),
        wall_reflectance: number("wall_reflectance"),
        detector_reflectance: 0.0,
        third_reflectance: 0.0,
        sees_sample: spheres["sees_sample"].as_bool().expect("true or false"),
        flat: true,
    };
    let instrument = Instrument {
        spheres: Spheres::Two([of("entrance"), of("exit")]),
        r_standard: readings.attributes["r_standard"].as_f64().expect("a number"),
        straight: true,
        ..Instrument::NONE
    };
    let experiment = Experiment::<32>::lit(&Slab::bare(1.0, 0.8, 1.0), &instrument, light).expect("an instrument");
    let column = |name: &str| readings.maybe_f64s(name).expect("a column");
    let known = |name: &str, i: usize| column(name)[i].unwrap_or_else(|| panic!("{name} is not known"));
    (0..readings.rows())
        .map(|i| {
            let lost = Lost {
                beam: ["lost_r", "lost_t"].map(|name| known(name, i)),
                diffuse: ["lost_r_diffuse", "lost_t_diffuse"].map(|name| known(name, i)),
            };
            experiment.readings(known("mu_a", i), known("mu_s_prime", i), &lost).expect("a medium")
        })
        .collect()
}

/// Least and greatest departure, and the largest standard error.
fn range(departures: &[(f64, f64)], digits: usize) -> String {
    let least = departures.iter().map(|d| d.0).fold(f64::INFINITY, f64::min);
    let most = departures.iter().map(|d| d.0).fold(f64::NEG_INFINITY, f64::max);
    let se = departures.iter().map(|d| d.1).fold(0.0, f64::max);
    format!("{least:+.digits$} to {most:+.digits$} ({se:.digits$})")
}

/// Departures of the readings from the balance, and of the fits from the media (mu_s' relative), where there is one.
fn row(name: &str, photons: u64, change: &Value) {
    let params = params(photons, change);
    let light = match params["beam"]["conical"] {
        Value::Null => Incidence::Normal,
        _ => Incidence::Cone(CONE_DEG.to_radians()),
    };
    let readings = measure(&params);
    let of = |table: &Table, name: &str, k: usize| -> f64 {
        table.maybe_f64s(name).expect("a column")[k].unwrap_or_else(|| panic!("{name} of row {k} is not known"))
    };
    let column = |name: &str| (0..readings.rows()).map(|k| of(&readings, name, k)).collect::<Vec<f64>>();
    let expected = expected(&readings, light);
    let reading = |name: &str, i: usize| -> Vec<(f64, f64)> {
        let (found, se) = (column(name), column(&format!("{name}_se")));
        (0..found.len()).map(|k| (found[k] - expected[k][i], se[k])).collect()
    };
    let host = MemoryHost::default();
    let input = turbid_iad::In { readings: Some(Readings(readings.clone())), source: PhantomData };
    let wanted = serde_json::from_value(json!({"N": 32})).expect("params");
    let fit = CalibrateIad::run(&wanted, input, Ctx::new(&host)).expect("a fit").fit.0;
    let Some(Cells::Text(status)) = fit.columns.iter().find(|c| c.name == "status").map(|c| &c.cells) else {
        panic!("a fit has a status");
    };
    let solved: Vec<usize> = (0..status.len()).filter(|&k| status[k] == "ok").collect();
    let found = |name: &str, relative: bool| -> Vec<(f64, f64)> {
        let truth = column(name);
        let unit = |k: usize| if relative { 0.01 * truth[k] } else { 1.0 };
        let with_se =
            |&k: &usize| ((of(&fit, name, k) - truth[k]) / unit(k), of(&fit, &format!("{name}_se"), k) / unit(k));
        solved.iter().map(with_se).collect()
    };
    let fits = match solved.len() {
        0 => "no fit | ".to_owned(),
        n => {
            let rest = if n < status.len() { format!("{n} of {}: ", status.len()) } else { String::new() };
            format!("{rest}{} | {} %", range(&found("mu_a", false), 4), range(&found("mu_s_prime", true), 1))
        }
    };
    println!("| {name} | {} | {} | {fits} |", range(&reading("m_r", 0), 4), range(&reading("m_t", 1), 4));
}

fn main() {
    let photons = std::env::args().filter_map(|a| a.parse().ok()).next().unwrap_or(400_000);
    let z = balance::departures_from_the_table(photons / 10);
    statistics::judge("ideal spheres against the table of the energy balance", &z);

    let square = json!({"square": {"side": 10}, "round": null});
    let square_ports = json!({"entrance": square, "sample": square, "detector": square});
    let baffled = json!({"ports": {"detector": {"sees": "all"}}, "baffle": {"diameter": 22}});
    let cone = json!({"collimated": null, "conical": {"diameter": 1, "half_angle_deg": CONE_DEG}});
    let paper = |more: Value| {
        let mut all = json!({"spheres": {"wall_reflectance": 1.0, "ports": square_ports}, "beam": cone, "standard": {"reflectance": 1.0}});
        merge(&mut all, &more);
        all
    };
    println!("| instrument | M_R | M_T | mu_a, mm^-1 | mu_s' |\n|---|---|---|---|---|");
    row("round ports, detectors see the wall only", photons, &json!({}));
    row("detectors see the sample too", photons, &json!({"spheres": {"ports": {"detector": {"sees": "all"}}}}));
    row("square ports", photons, &json!({"spheres": {"ports": square_ports}}));
    row("the sample 1 mm behind its port", photons, &json!({"spheres": {"neck": 1}}));
    row("baffles of 22 mm, detectors that may see all", photons / 4, &json!({"spheres": baffled}));
    row("a cone of 6 degrees that fills the port", photons, &json!({"beam": cone}));
    row("the paper's: square ports, white walls, the cone", photons, &paper(json!({})));
    row("the paper's, light ends after 4 bounces", photons, &paper(json!({"spheres": {"bounces": 4}})));
    row("the paper's, the sample 10 mm behind its port", photons, &paper(json!({"spheres": {"neck": 10}})));
}
