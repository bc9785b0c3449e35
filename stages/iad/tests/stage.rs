//! The stage `calibrate_iad` as the engine calls it.
#![cfg(feature = "stage")]

use std::sync::Arc;

use turbid_contract::payload::Readings;
use turbid_contract::{Cells, Ctx, Known, MemoryHost, Problems, Stage, Table, serde_json};
use turbid_iad::{CalibrateIad, Experiment, In, Instrument, Lost, Params, Slab, Sphere, Spheres};

const RXT: &str = include_str!("../../../pipelines/data/phantom.rxt");

fn params(json: &str) -> Params {
    serde_json::from_str(json).expect(json)
}

fn input(readings: Option<Readings>) -> In<'static> {
    In { readings, source: std::marker::PhantomData }
}

/// Problems of these params, with this file.
fn problems(json: &str, file: Option<&str>, connected: bool) -> Vec<String> {
    let mut known = Known::default();
    known.files.extend(file.map(|text| ("file".to_owned(), Arc::from(text.as_bytes()))));
    known.connected.extend(connected.then(|| "readings".to_owned()));
    let mut problems = Problems::default();
    CalibrateIad::check(&params(json), &known, &mut problems);
    problems.into_parts().0.iter().map(ToString::to_string).collect()
}

fn run(json: &str, file: Option<&str>, readings: Option<Readings>) -> Table {
    let mut host = MemoryHost::default();
    host.files.extend(file.map(|text| ("file".to_owned(), Arc::from(text.as_bytes()))));
    CalibrateIad::run(&params(json), input(readings), Ctx::new(&host)).expect("runs").fit.0
}

/// The cell of a column whose numbers may be unknown.
fn maybe(table: &Table, name: &str, row: usize) -> Option<f64> {
    table.maybe_f64s(name).unwrap_or_else(|| panic!("no column {name}"))[row]
}

/// A cell that holds a number.
fn known(table: &Table, name: &str, row: usize) -> f64 {
    maybe(table, name, row).unwrap_or_else(|| panic!("{name} of row {row} is not known: {table:?}"))
}

fn texts<'a>(table: &'a Table, name: &str) -> &'a [String] {
    match table.columns.iter().find(|c| c.name == name).map(|c| &c.cells) {
        Some(Cells::Text(texts)) => texts,
        other => panic!("{name}: {other:?}"),
    }
}

/// The shipped file was computed for a sample that loses no light from these media with N = 64 and rounded to five digits: mu_a within 3e-4 mm^-1, mu_s' within 5e-4,
/// g within 2e-4. (A reading moves by 5e-6; here d mu_a / d M_T is up to 10 mm^-1 and N = 32 departs from 64 by 1e-5 in R.)
#[test]
fn the_shipped_file_is_read_back() {
    let fit = run(r#"{"file": "phantom.rxt", "N": 32, "lost_light": "ignore"}"#, Some(RXT), None);
    let truth =
        [(0.060, 2.00, 0.70), (0.045, 1.75, 0.72), (0.020, 1.55, 0.74), (0.010, 1.39, 0.75), (0.006, 1.26, 0.76)];
    let column = |name: &str| (0..fit.rows()).map(|row| known(&fit, name, row)).collect::<Vec<f64>>();
    assert!(texts(&fit, "status").iter().all(|s| s == "ok"), "{fit:?}");
    for (i, (mu_a, mu_s_prime, g)) in truth.into_iter().enumerate() {
        let found = [column("mu_a")[i], column("mu_s_prime")[i], column("g")[i]];
        assert!(
            (found[0] - mu_a).abs() < 3e-4 && (found[1] - mu_s_prime).abs() < 5e-4 && (found[2] - g).abs() < 2e-4,
            "{i}: {found:?}"
        );
    }
}

/// Two spheres of r_w = 0.98 about a slab of n = 1, g = 0.8, 1 mm that loses light: `calibrate_dis` would write the readings of mu_a = 0.025,
/// mu_s' = 0.85 so, with a second row that no medium has.
fn double_sphere() -> Readings {
    let (n, g) = (1.0, 0.8);
    let sphere = Sphere {
        sample: 0.0032,
        third: 0.003,
        detector: 0.001,
        wall_reflectance: 0.98,
        detector_reflectance: 0.0,
        third_reflectance: 0.0,
        sees_sample: false,
        flat: true,
    };
    let instrument = Instrument {
        spheres: Spheres::Two([sphere, Sphere { third: 0.002, ..sphere }]),
        r_standard: 0.99,
        straight: true,
        ..Instrument::NONE
    };
    let lost = Lost { beam: [0.02, 0.01], diffuse: [0.03, 0.02] };
    let experiment = Experiment::<16>::new(&Slab::bare(n, g, 1.0), &instrument).expect("a slab");
    let [m_r, m_t] = experiment.readings(0.025, 0.85, &lost).expect("within range");
    let mut table = Table::default();
    table.push("medium", "", Cells::Text(vec!["healthy".into(), "impossible".into()]));
    let both = |x: f64, y: f64| Cells::F64(vec![x, y]);
    table.push("m_r", "1", both(m_r, 0.9));
    table.push("m_t", "1", both(m_t, 0.9));
    for (name, value) in [("m_r_se", 1e-4), ("m_t_se", 1e-4), ("m_rt_cov", -9e-9), ("lost_r", 0.02), ("lost_t", 0.01)] {
        table.push(name, "1", both(value, value));
    }
    for (name, value) in [("lost_r_diffuse", 0.03), ("lost_t_diffuse", 0.02), ("lost_t_se", 1e-5), ("g", g), ("n", n)] {
        table.push(name, "1", both(value, value));
    }
    let spheres = serde_json::json!({"diameter": 100.0, "wall_reflectance": 0.98, "sample": 0.0032, "entrance": 0.003, "detector": 0.001,
        "exit": 0.002, "sees_sample": false, "baffle": false});
    for (name, value) in [
        ("thickness", 1.0.into()),
        ("slides", serde_json::Value::Null),
        ("r_standard", 0.99.into()),
        ("spheres", spheres),
    ] {
        table.attributes.insert(name.into(), value);
    }
    Readings(table)
}

/// Attributes and lost light are reckoned with; rows that have no medium say so, and of them no number is known.
#[test]
fn readings_of_spheres_with_lost_light() {
    let fit = run("{}", None, Some(double_sphere()));
    assert_eq!(texts(&fit, "status"), ["ok", "too_much_light"]);
    assert!(texts(&fit, "message")[1].contains("exceeds 1"), "{fit:?}");
    let of_first = |name: &str| known(&fit, name, 0);
    assert!(
        (of_first("mu_a") / 0.025 - 1.0).abs() < 1e-7 && (of_first("mu_s_prime") / 0.85 - 1.0).abs() < 1e-7,
        "{fit:?}"
    );
    assert!(["mu_a_se", "mu_s_prime_se"].iter().all(|name| maybe(&fit, name, 0).is_some_and(|se| se > 0.0)), "{fit:?}");
    let numbers = fit.columns.iter().filter(|c| !matches!(c.cells, Cells::Text(_)));
    let of_second: Vec<(&str, Option<f64>)> = numbers.map(|c| (c.name.as_str(), maybe(&fit, &c.name, 1))).collect();
    assert!(of_second.len() > 10 && of_second.iter().all(|(_, cell)| cell.is_none()), "{of_second:?}");
}

/// Where readings do not know an error of theirs the fit does not either; what they know of other rows stays, and params fill what is missing.
#[test]
fn unknown_errors_of_readings_stay_unknown() {
    let mut readings = double_sphere();
    let column = readings.0.columns.iter_mut().find(|c| c.name == "m_t_se").expect("a column");
    column.cells = Cells::MaybeF64(vec![None, Some(1e-4)]);
    let fit = run("{}", None, Some(readings.clone()));
    assert_eq!(texts(&fit, "status")[0], "ok");
    assert_eq!(maybe(&fit, "mu_a_se", 0), None, "{fit:?}");
    let stated = run(r#"{"m_t_se": 1e-4}"#, None, Some(readings));
    assert_eq!(maybe(&stated, "mu_a_se", 0), maybe(&run("{}", None, Some(double_sphere())), "mu_a_se", 0));
    assert!(maybe(&stated, "mu_a_se", 0).is_some());
}

/// Without lost light the same spheres explain the readings by more absorption: the fit gives them back with no loss. Without spheres M_R and
/// M_T are R and T themselves: the fit is that of the library.
#[test]
fn corrections_may_be_switched_off() {
    let readings = double_sphere();
    let number = |name: &str| readings.0.f64s(name).expect("a column")[0];
    let [m_r, m_t] = ["m_r", "m_t"].map(number);
    let fitted = |json: &str| {
        let fit = run(json, None, Some(readings.clone()));
        ["mu_a", "mu_s_prime"].map(|name| known(&fit, name, 0))
    };
    let ignored = fitted(r#"{"lost_light": "ignore"}"#);
    assert!(ignored[0] > 0.03, "what is lost counts as absorbed: {ignored:?}");
    let bare = fitted(r#"{"lost_light": "ignore", "spheres": "none"}"#);
    let slab = Slab::bare(1.0, 0.8, 1.0);
    let plain = Experiment::<16>::new(&slab, &Instrument::NONE).expect("a slab");
    let back = plain.readings(bare[0], bare[1], &Lost::default()).expect("within range");
    assert!((back[0] - m_r).abs() < 1e-8 && (back[1] - m_t).abs() < 1e-8, "{back:?}, {m_r}, {m_t}");
    assert!((bare[1] - ignored[1]).abs() > 0.01, "spheres matter: {bare:?} {ignored:?}");
    assert_eq!(fitted(r#"{"lost_light": "correct"}"#), fitted("{}"));
    let spelt = serde_json::to_value(params(r#"{"spheres": "none", "n": 1}"#)).expect("plain data");
    assert_eq!(spelt["spheres"], "none");
    assert!(spelt.get("lost_light").is_none(), "a default is no part of the key: {spelt}");
}

/// Walls of 1.00 do not tell two media apart: the row holds one, `message` names the other, and `compare` and `build_lut` take neither. With
/// walls of 0.98 the same media have one answer.
#[test]
fn a_second_medium_is_named() {
    let fitted = |wall: f64| {
        let spheres = format!(
            r#"{{"count": 2, "diameter": 100, "sample": 11.3, "entrance": 11.3, "detector": 3, "wall_reflectance": {wall}}}"#
        );
        let json = format!(r#"{{"file": "a.csv", "n": 1, "g": 0.8, "thickness": 1, "N": 8, "spheres": {spheres}}}"#);
        let params = params(&json);
        let instrument = match params.spheres {
            Some(turbid_iad::SpheresChoice::These(spheres)) => spheres.instrument(),
            other => panic!("{other:?}"),
        };
        let experiment = Experiment::<8>::new(&Slab::bare(1.0, 0.8, 1.0), &instrument).expect("a slab");
        let [m_r, m_t] = experiment.readings(0.01, 0.3, &Lost::default()).expect("within range");
        run(&json, Some(&format!("m_r,m_r_se,m_t,m_t_se\n{m_r},1e-4,{m_t},1e-4\n")), None)
    };
    let white = fitted(1.0);
    assert_eq!(texts(&white, "status"), ["ambiguous"], "{white:?}");
    let message = &texts(&white, "message")[0];
    let found = ["mu_a", "mu_s_prime"].map(|name| known(&white, name, 0));
    let told = |name: &str| -> f64 {
        let (_, rest) = message.split_once(&format!("{name} = ")).expect("both are told");
        rest.split(' ').next().and_then(|number| number.parse().ok()).expect("a number")
    };
    let other = [told("mu_a"), told("mu_s'")];
    let is_there = |m: [f64; 2]| (m[0] - 0.01).abs() < 1e-6 && (m[1] - 0.3).abs() < 1e-6;
    assert!(is_there(found) != is_there(other), "{found:?} {message}");
    let grey = fitted(0.98);
    assert_eq!((texts(&grey, "status"), texts(&grey, "message")), (&["ok".to_owned()][..], &[String::new()][..]));
}

/// Readings of spheres that the energy balance does not describe are inverted with a warning that says what it leaves out.
#[test]
fn what_the_balance_leaves_out_is_warned_of() {
    let warned = |json: &str, change: &[(&str, serde_json::Value)]| {
        let mut readings = double_sphere();
        for (name, value) in change {
            readings.0.attributes.get_mut("spheres").expect("spheres were written")[*name] = value.clone();
        }
        let host = MemoryHost::default();
        CalibrateIad::run(&params(json), input(Some(readings)), Ctx::new(&host)).expect("runs");
        host.warnings.lock().expect("no holder panics").join("\n")
    };
    let odd = [("bounces", 4.into()), ("neck", 1.5.into())];
    assert!(warned("{}", &odd).contains("light that ends after 4 bounces and a sample 1.500 mm behind its port"));
    assert!(!warned(r#"{"spheres": "none"}"#, &odd).contains("balance"));
    let plain = [("bounces", serde_json::Value::Null), ("neck", 0.0.into())];
    assert!(!warned("{}", &plain).contains("balance"));
}

#[test]
fn mistakes_are_named_before_anything_runs() {
    let csv = "m_r,m_t\n0.3,0.2\n";
    let one = |json: &str, wanted: &str| {
        let found = problems(json, Some(csv), false);
        assert!(found.len() == 1 && found[0].contains(wanted), "{json}: {found:?}");
    };
    assert!(problems(r#"{"file": "a.csv", "n": 1.4, "g": 0.8, "thickness": 1}"#, Some(csv), false).is_empty());
    one(r#"{"file": "a.csv", "n": 0.9, "g": 0.8, "thickness": 1}"#, "n = 0.9 must be a refractive index >= 1");
    one(r#"{"file": "a.csv", "n": 1.4, "g": 1, "thickness": 1}"#, "g = 1 must lie in (-1, 1)");
    one(r#"{"file": "a.csv", "n": 1.4, "thickness": 1}"#, "g stands neither here nor in the readings");
    one(r#"{"file": "a.csv", "n": 1.4, "g": 0.8}"#, "thickness stands neither here nor");
    one(r#"{"file": "a.csv", "n": 1.4, "g": 0.8, "thickness": 0}"#, "thickness = 0 mm must be > 0");
    one(r#"{"file": "a.txt", "n": 1.4, "g": 0.8, "thickness": 1}"#, "must end in .csv or .rxt");
    one(r#"{"file": "a.csv", "n": 1.4, "g": 0.8, "thickness": 1, "N": 12}"#, "N = 12 must be 8, 16, 32 or 64");
    one(r#"{"file": "a.csv", "n": 1.4, "g": 0.8, "thickness": 1, "mu_a": 0.1, "mu_s_prime": 1}"#, "nothing is left");
    let spheres = |with: &str| {
        format!(
            r#"{{"file": "a.csv", "n": 1.4, "g": 0.8, "thickness": 1, "spheres": {{"count": 2, "diameter": 100, "detector": 3, {with}}}}}"#
        )
    };
    one(&spheres(r#""sample": 10, "wall_reflectance": 1.01"#), "wall_reflectance = 1.01 must lie in [0, 1]");
    one(
        &spheres(r#""sample": 120, "wall_reflectance": 0.98"#),
        "sample = 120 mm must be > 0 and smaller than the sphere",
    );
    let full_of_ports = spheres(r#""sample": 99, "entrance": 99, "wall_reflectance": 0.98"#)
        .replace(r#""detector": 3"#, r#""detector": 99"#);
    one(&full_of_ports, "ports together");
    assert!(problems("{}", None, false)[0].contains("no readings"));
    assert!(problems(r#"{"file": "a.rxt"}"#, Some(RXT), true)[0].contains("give one of them"));
    let broken = problems(r#"{"file": "a.rxt"}"#, Some(&RXT.replacen("IAD1", "IAD7", 1)), false);
    assert!(broken[0].contains("a.rxt:1:1"), "{broken:?}");
    let full = r#"{"file": "a.csv", "n": 1.4, "g": 0.8, "thickness": 1}"#;
    assert!(problems(full, Some("m_r,m_t\n0.3,x\n"), false)[0].contains("a.csv:2:5: m_t = `x` is not a number"));
    one(
        r#"{"file": "a.csv", "n": 1.4, "g": 0.8, "thickness": 1, "spheres": "none", "r_standard": 0.9}"#,
        "r_standard says how spheres scale M_R; with `spheres: none` it says nothing",
    );
    let unread = |json: &str| serde_json::from_str::<Params>(json).expect_err(json).to_string();
    assert!(unread(r#"{"thick": 1}"#).contains("unknown field `thick`"));
    assert!(unread(r#"{"spheres": "nix"}"#).contains("{count: 2, diameter: .., ..}, or none"));
    assert!(unread(r#"{"spheres": {"count": 2, "diametre": 100}}"#).contains("unknown field `diametre`"));
    assert!(unread(r#"{"lost_light": "maybe"}"#).contains("expected `correct` or `ignore`"));
}

/// What becomes of each row of the table of inputs that other programs get wrong, as a laboratory would hand it over: in a file.
///
/// Numbers that are none are refused with line and column, a thickness that cannot be is refused by its key; all else stands in `status`, so that
/// one bad row does not cost the others. The library's own tests hold the numbers against their right answers.
fn outcome(name: &str) -> &'static str {
    match name {
        "MR nan" | "MR inf" => "a.csv:2:1: m_r = ",
        "d=0" | "d=-1" => "must be > 0",
        "R+T=1.1" | "R+T=1+1e-6" | "MR=1.2" => "too_much_light",
        "R+T=1 exactly" | "R = Fresnel only n=1.4 (b->0)" => "conservative",
        "T=0 (opaque)" | "R=1 T=0" | "R=.999999 T=0" => "underdetermined",
        "R=0 no scattering" | "a=0 b=1 n=1.4 (true R T)" => "no_scatter",
        "R=0 T=1 (empty)" => "empty",
        "R below Fresnel n=1.4" | "MR=-0.01" => "below_specular",
        "g=1" | "g=2" => "invalid_g",
        "n=0.9" => "invalid_index",
        "MU=MT (no diffuse T)" => "inconsistent",
        "MU>MT" => "unscattered_exceeds_total",
        _ => "ok",
    }
}

#[test]
fn bad_inputs_in_files_are_answered() {
    let mut rows = 0;
    for line in include_str!("reference/iad_robust_inputs.csv").lines().skip(1) {
        let cells: Vec<&str> = line.split(',').collect();
        let [name, r, t, u, g, n, slide, d] = cells[..] else { panic!("{line}") };
        // The printed digits of this one row are its standard error; a search for g starts at its default where M_U is given.
        let se = if name.starts_with("a=0 b=1") { "5e-8" } else { "0" };
        let mut csv = format!("m_r,m_r_se,m_t,n\n{r},{se},{t},{n}\n");
        if u.is_empty() {
            let g = if g.is_empty() { "0" } else { g };
            csv = format!("m_r,m_r_se,m_t,n,g\n{r},{se},{t},{n},{g}\n");
        } else {
            csv = csv.replace(",n\n", ",n,m_u\n").replace(&format!(",{n}\n"), &format!(",{n},{u}\n"));
        }
        let slides = if slide.is_empty() {
            String::new()
        } else {
            format!(r#", "slides": {{"top": {slide}, "bottom": {slide}}}"#)
        };
        let json = format!(r#"{{"file": "a.csv", "thickness": {d}, "limit_sigmas": 1{slides}}}"#);
        let wanted = outcome(name);
        let found = problems(&json, Some(&csv), false);
        rows += 1;
        if !found.is_empty() {
            assert!(found.len() == 1 && found[0].contains(wanted), "{line}: {found:?}, wanted {wanted}");
            continue;
        }
        let fit = run(&json, Some(&csv), None);
        let (status, message) = (texts(&fit, "status")[0].as_str(), texts(&fit, "message")[0].as_str());
        let status = status.split(',').next().unwrap_or_default();
        assert_eq!(status, wanted, "{line}: {fit:?}");
        let holds = ["ok", "conservative", "no_scatter", "empty"].contains(&status);
        assert_eq!(message.is_empty(), holds, "{line}: {message}");
        let numbers = ["mu_a", "mu_s_prime", "g"].map(|name| maybe(&fit, name, 0));
        assert!(numbers.iter().all(|x| x.is_some_and(f64::is_finite) == holds), "{line}: {numbers:?}");
        let errors = ["mu_a_se", "mu_s_prime_se", "mu_cov"].map(|name| maybe(&fit, name, 0));
        assert!(errors.iter().flatten().all(|x| x.is_finite()), "{line}: {errors:?}");
    }
    assert_eq!(rows, 35);
}

/// M_U that no light can be (less than a photon in 1e30, more than all) is the row's own status: other rows have their fit, and no cell
/// holds what is no number.
#[test]
fn an_impossible_m_u_is_a_status_of_its_row() {
    let rows = ["1e-154", "1e-200", "1e-300", "1e-320", "1.5", "1e18", "1e200", "1e-3"]
        .map(|m_u| format!("0.40677,0.42977,{m_u}"));
    let csv = format!("m_r,m_t,m_u\n0.40677,0.42977,0.001099\n{}\n", rows.join("\n"));
    for se in ["", r#", "m_r_se": 1e-4, "m_t_se": 1e-4, "m_u_se": 1e-5"#] {
        for known in ["", r#", "mu_a": 0.05"#] {
            let json = format!(r#"{{"file": "a.csv", "n": 1.36, "thickness": 1, "N": 8{se}{known}}}"#);
            let fit = run(&json, Some(&csv), None);
            let status = texts(&fit, "status");
            let ok = |i: usize| ["ok", "disagree"].contains(&status[i].as_str());
            assert!(ok(0) && ok(8), "{json}: {status:?}");
            assert!((1..8).all(|i| status[i] == "out_of_range"), "{json}: {status:?}");
            for column in &fit.columns {
                let all_finite = match &column.cells {
                    Cells::F64(v) => v.iter().all(|x| x.is_finite()),
                    Cells::MaybeF64(v) => v.iter().flatten().all(|x| x.is_finite()),
                    _ => true,
                };
                assert!(all_finite, "{json}: {column:?}");
            }
        }
    }
}

/// Figures that guard VERSION: other bits of the same readings need a higher one.
#[test]
fn golden() {
    let fit = run(r#"{"file": "a.csv", "n": 1.4, "g": 0.8, "thickness": 1, "N": 8}"#, Some("m_r,m_t\n0.3,0.2\n"), None);
    let bits = |name: &str| known(&fit, name, 0).to_bits();
    assert_eq!((CalibrateIad::VERSION, bits("mu_a"), bits("mu_s_prime")), (6, GOLDEN[0], GOLDEN[1]));
}

const GOLDEN: [u64; 2] = [4_597_320_000_982_514_088, 4_613_125_528_801_940_972];

/// What a run is going to take goes with the rows of the file, the cube of the points and M_U.
#[test]
fn the_plan_counts_rows_and_points() {
    let seconds = |points: u32, csv: &str| {
        let mut known = Known::default();
        known.files.insert("file".to_owned(), csv.as_bytes().into());
        let text = format!(r#"{{"file": "a.csv", "n": 1.4, "g": 0.8, "thickness": 1, "N": {points}}}"#);
        let params = serde_json::from_str(&text).expect("params");
        CalibrateIad::plan(&params, &known).seconds.expect("an estimate")
    };
    let one = seconds(16, "m_r,m_t\n0.3,0.2\n");
    assert!((seconds(16, "m_r,m_t\n0.3,0.2\n0.3,0.1\n") / one - 2.0).abs() < 1e-12);
    assert!((seconds(32, "m_r,m_t\n0.3,0.2\n") / one - 8.0).abs() < 1e-12);
    assert!(seconds(16, "m_r,m_t,m_u\n0.3,0.2,0.01\n") > one);
}
