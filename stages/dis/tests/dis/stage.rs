//! The stage: what `check` finds, and readings as a table.

use serde_json::{Value, json};
use turbid_contract::Ctx;
use turbid_contract::kit::Inputs;
use turbid_contract::{Artifact, Known, MemoryHost, Problems, Stage, StageRow, Table};
use turbid_dis::CalibrateDis;

fn params() -> Value {
    json!({
        "media": {"a": {"A_rho": 25, "S_rho": 4236, "g": 0.8, "n": 1.0}, "b": {"mu_a": 0.1, "mu_s_prime": 1, "g": 0.8, "n": 1.0}},
        "spheres": {
            "diameter": 100,
            "wall_reflectance": 0.98,
            "ports": {
                "entrance": {"square": {"side": 10}},
                "sample": {"square": {"side": 10}},
                "detector": {"round": {"diameter": 10}}
            }
        },
        "sample": {"thickness": 1, "size": [10, 10]},
        "beam": {"collimated": {"diameter": 1}},
        "standard": {"reflectance": 0.99},
        "samples": 20_000
    })
}

/// `params` with the value at `path` replaced (or removed by null).
fn with(path: &str, value: Value) -> Value {
    let mut all = params();
    let mut at = &mut all;
    let (parents, last) = path.rsplit_once('.').unwrap_or(("", path));
    for key in parents.split('.').filter(|key| !key.is_empty()) {
        at = &mut at[key];
    }
    let map = at.as_object_mut().expect("a map");
    if value.is_null() {
        map.remove(last);
    } else {
        map.insert(last.to_owned(), value);
    }
    all
}

fn check(params: &Value) -> (Vec<String>, Vec<String>) {
    let row = StageRow::of::<CalibrateDis>();
    let mut problems = Problems::default();
    row.check(params, &Known::default(), &mut problems);
    let (found, warnings) = problems.into_parts();
    let texts = |list: Vec<turbid_contract::Problem>| list.iter().map(ToString::to_string).collect();
    (texts(found), texts(warnings))
}

fn run(params: &Value, seed: u64) -> Table {
    let host = MemoryHost { seed, ..MemoryHost::default() };
    let made = StageRow::of::<CalibrateDis>().run(params, &Inputs::none(), Ctx::new(&host)).expect("readings");
    match made.into_iter().next() {
        Some(("readings", Artifact::Table(table))) => table,
        other => panic!("{other:?}"),
    }
}

/// Each mistake gets one message, with field, value, unit and rule.
#[test]
fn mistakes_are_named() {
    let port = |d: f64| json!({"round": {"diameter": d}});
    for (path, value, expected) in [
        ("media", json!({}), "media: media is empty; name at least one medium"),
        ("media.a.A_rho", json!(-1), "media.a.A_rho: A_rho = -1 m^-1 must be >= 0"),
        (
            "media.a.mu_a",
            json!(1),
            "media.a: a must have exactly one pair of absorption and scattering (write `mu_a` with `mu_s`, or `mu_a` with `mu_s_prime` (mm^-1), or `A_rho` with `S_rho` (m^-1))",
        ),
        ("media.a.g", json!(1), "media.a.g: g = 1 must lie in (-1, 1)"),
        ("media.a.n", json!(0.9), "media.a.n: n = 0.9 must lie in [1, 10]"),
        ("spheres.diameter", json!(-5), "spheres.diameter: diameter = -5 mm must be > 0"),
        (
            "spheres.wall_reflectance",
            json!(1.01),
            "spheres.wall_reflectance: wall_reflectance = 1.01 must lie in [0, 1]",
        ),
        ("spheres.bounces", json!(0), "spheres.bounces: bounces = 0 must be > 0: no light would leave the wall"),
        ("spheres.neck", json!(-1), "spheres.neck: neck = -1 mm must be >= 0"),
        (
            "spheres.ports.sample",
            port(100.0),
            "spheres.ports.sample: a round port of 100 mm does not fit into a sphere of 100 mm",
        ),
        (
            "spheres.ports.sample",
            json!({"square": {"side": 71}}),
            "spheres.ports.sample: a square port of 71 mm does not fit into a sphere of 100 mm",
        ),
        (
            "spheres.ports.sample",
            json!({}),
            "spheres.ports.sample: a port has exactly one of `round` and `square` (write `round: {diameter: 10}` or `square: {side: 10}`)",
        ),
        ("spheres.ports.exit", port(0.0), "spheres.ports.exit.round.diameter: diameter = 0 mm must be > 0"),
        (
            "spheres.ports.detector.polar_deg",
            json!(12),
            "spheres.ports.detector: detector overlaps sample: their middles are 12.0 deg apart, the circles about them need 13.9 deg (make a port smaller, the sphere larger, or turn the detector by `polar_deg`)",
        ),
        (
            "spheres.ports.detector.polar_deg",
            json!(200),
            "spheres.ports.detector.polar_deg: polar_deg = 200 deg must lie in [0, 180]",
        ),
        (
            "spheres.baffle",
            json!({"diameter": 20, "position": 0.9}),
            "spheres.baffle: a baffle of 20 mm at this place touches the wall of the sphere",
        ),
        (
            "spheres.baffle",
            json!({"diameter": 20, "position": 1}),
            "spheres.baffle.position: position = 1 must lie in (0, 1)",
        ),
        ("sample.thickness", json!(0), "sample.thickness: thickness = 0 mm must be > 0"),
        ("sample.size", json!([10, 0]), "sample.size.1: size = 0 mm must be > 0"),
        ("sample.slides", json!(0.5), "sample.slides: slides = 0.5 must lie in [1, 10]"),
        (
            "beam",
            json!({}),
            "beam: a beam is exactly one of `collimated` and `conical` (write `collimated: {diameter: 1}` or `conical: {half_angle_deg: 3}`)",
        ),
        (
            "beam.collimated.diameter",
            json!(11),
            "beam.collimated.diameter: a beam of 11 mm does not pass an entrance port of 10 mm",
        ),
        (
            "beam",
            json!({"conical": {"half_angle_deg": 90}}),
            "beam.conical.half_angle_deg: half_angle_deg = 90 deg must lie in (0, 90)",
        ),
        ("standard.reflectance", json!(0), "standard.reflectance: reflectance = 0 must lie in (0, 1]"),
        ("standard.taken_as", json!(1.5), "standard.taken_as: taken_as = 1.5 must lie in (0, 1]"),
        ("samples", json!(0), "samples: samples = 0 must be > 0: no photon, no reading"),
        (
            "baffle",
            json!({}),
            "baffle: there is no key `baffle` here (known: `media`, `spheres`, `sample`, `beam`, `standard`, `samples`, `method`)",
        ),
    ] {
        let (mut found, _) = check(&with(path, value.clone()));
        found.dedup();
        // A standard that is wrong is also taken for what it is.
        found.retain(|text| !(path == "standard.reflectance" && text.starts_with("standard.taken_as")));
        let ends = found.len() == 1 && found[0].ends_with(expected);
        assert!(ends, "{path} = {value}: {found:#?}");
    }
    let mut summed = with("spheres.baffle", json!({"diameter": 20}));
    summed["method"] = json!("summed");
    assert!(check(&summed).0[0].starts_with("method: light beside a baffle has no closed form"));
    let mut shaded = with("spheres.baffle", json!({"diameter": 29}));
    shaded["spheres"]["ports"]["detector"]["polar_deg"] = json!(150);
    assert_eq!(check(&shaded).0, ["spheres.baffle: a baffle of 29 mm at this place stands in the beam"]);
    assert!(check(&params()).0.is_empty() && check(&params()).1.is_empty());
}

/// A sample smaller than its port is warned of with the open share; a baffle too small to hide the sample too.
#[test]
fn leaks_are_warned_of() {
    let warned = |params: &Value| check(params).1.join("\n");
    assert!(warned(&with("sample.size", json!([10, 9]))).contains("10.00 % of the port stay open"));
    let mut round = with("spheres.ports.sample", json!({"round": {"diameter": 10}}));
    assert_eq!(warned(&round), "");
    round["sample"]["size"] = json!([50, 5]);
    // Chord area: 1 - (2 / pi) (asin(h) + h sqrt(1 - h^2)) at h = 1/2 is 39.10 %.
    assert!(warned(&round).contains("39.10 %"), "{}", warned(&round));
    assert!(warned(&with("spheres.baffle", json!({"diameter": 4}))).contains("does not hide"));
}

/// The same params and seed give the same bits, another seed others; a medium's readings do not depend on which others are measured.
#[test]
fn readings_follow_from_params_and_seed() {
    let all = run(&params(), 3);
    assert_eq!(all, run(&params(), 3));
    assert_eq!(all.rows(), 2);
    let m_r = |table: &Table| table.f64s("m_r").expect("m_r").to_vec();
    assert_ne!(m_r(&all), m_r(&run(&params(), 4)));
    let alone = run(&with("media.a", Value::Null), 3);
    assert_eq!(m_r(&alone)[0], m_r(&all)[1]);
}

/// Columns that fit each other: errors above 0, correlation in [-1, 1], and the energy balance's shares as attributes.
#[test]
fn readings_are_consistent() {
    let table = run(&params(), 5);
    let column = |name: &str| -> Vec<f64> {
        let cells = table.maybe_f64s(name).unwrap_or_else(|| panic!("{name}"));
        cells.into_iter().map(|cell| cell.unwrap_or_else(|| panic!("{name} is not known"))).collect()
    };
    for i in 0..2 {
        let (r_se, t_se, cov) = (column("m_r_se")[i], column("m_t_se")[i], column("m_rt_cov")[i]);
        assert!(r_se > 0.0 && t_se > 0.0 && cov < 0.0 && cov * cov < r_se * r_se * t_se * t_se);
        assert!(column("m_r")[i] > 0.0 && column("m_t")[i] > 0.0);
        // A beam of 1 mm in the middle of 10 mm loses next to nothing, diffuse light up to the rim more.
        assert!(column("lost_r")[i].abs() < 0.005 && column("lost_r_diffuse")[i] > 0.01);
        assert!(column("lost_t")[i].abs() < 0.005 && column("lost_t_diffuse")[i] > 0.01);
    }
    assert_eq!(column("mu_a"), [0.025, 0.1]);
    let spheres = &table.attributes["spheres"];
    let round = 0.5 * (1.0 - (1.0f64 - 0.01).sqrt());
    assert!((spheres["detector"].as_f64().expect("a share") - round).abs() < 1e-15);
    assert_eq!(spheres["exit"], 0.0);
}

/// What too few photons, and photons that all miss, do not tell is null: a reading of 0 has no error of 0, and readings that are 0 say so.
#[test]
fn errors_that_are_not_known_are_null() {
    let mut dark = params();
    dark["media"] = json!({"black": {"mu_a": 1000, "mu_s": 1e-9, "g": 0.8, "n": 1.0}});
    dark["samples"] = json!(500);
    let cell = |table: &Table, name: &str| table.maybe_f64s(name).unwrap_or_else(|| panic!("{name}"))[0];
    let found = run(&dark, 1);
    assert_eq!((cell(&found, "m_t"), cell(&found, "m_t_se")), (Some(0.0), None));
    assert_eq!((cell(&found, "lost_t"), cell(&found, "lost_t_se")), (Some(0.0), None));
    let mut few = params();
    few["samples"] = json!(1);
    let found = run(&few, 1);
    for name in ["m_r_se", "m_t_se", "m_rt_cov", "lost_r_se"] {
        assert_eq!(cell(&found, name), None, "{name} of one photon");
    }
}

/// The bytes of VERSION 3: raise it when they change.
#[test]
fn bytes_belong_to_the_version() {
    let mut small = params();
    small["samples"] = json!(1000);
    let table = run(&small, 1);
    let bits = |name: &str| table.maybe_f64s(name).expect("a column")[0].expect("a number").to_bits();
    assert_eq!(
        (CalibrateDis::VERSION, bits("m_r"), bits("lost_t_diffuse")),
        (3, 4_598_915_574_789_579_679, 4_591_525_612_254_495_885)
    );
}
