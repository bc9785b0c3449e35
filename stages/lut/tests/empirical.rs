//! Tables of phantoms: made phantoms come from the transport solver, so that the truth between them is known.

use serde_json::{Value, json};
use turbid_contract::kit::{Inputs, Trial};
use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{Lut, Modulation, Sections, Truth};
use turbid_contract::planes::mean_se;
use turbid_contract::{
    Artifact, Axes, Cells, Ctx, Error, ImageStack, Known, LayerInfo, LayerKind, MemoryHost, Payload, Problems, Stage,
    StageRow, Table,
};
use turbid_lut::BuildLut;
use turbid_optics::{Medium, PhaseFunction, rte};

const F_X: [f64; 2] = [0.0, 0.1];
const G: f64 = 0.5;
const REFERENCE: [f64; 2] = [0.02, 1.5];
/// Pixels of a side of a made image.
const SIDE: usize = 8;

fn camera([mu_a, mu_s_prime]: [f64; 2], f_x: f64) -> f64 {
    rte::reflectance(&Medium { mu_a, mu_s_prime, phase: PhaseFunction::henyey_greenstein(G), n: 1.0 }, None, f_x)
        .unwrap()
        .camera
}

/// Modulation of a medium: reflectance times a vignette times `1 + error`; `se` relative, of every pixel, not known where it is negative.
fn modulation(medium: [f64; 2], error: [f64; 2], se: f64) -> Modulation {
    let mut stack = ImageStack::new(SIDE, SIDE);
    let mut errors = Vec::new();
    for (k, f_x) in F_X.into_iter().enumerate() {
        let mut info = LayerInfo::value("m_ac", "W mm^-2 sr^-1").with_f_x(f_x);
        let m = camera(medium, f_x) * (1.0 + error[k]);
        let vignette = |(row, column): (usize, usize)| 0.3 * (1.0 - 0.002 * (row * row + column) as f64);
        let data = Array2::from_shape_fn((SIDE, SIDE), |at| (m * vignette(at)) as f32);
        let noise = data.mapv(|m| m * se as f32);
        let variances = noise.iter().map(|&e| f64::from(e) * f64::from(e)).sum();
        info.mean_se = mean_se(variances, (SIDE * SIDE) as u64, 1.0);
        errors.push((info.standard_error(), noise));
        stack.push(info, data);
    }
    if se >= 0.0 {
        errors.into_iter().for_each(|(info, data)| stack.push(info, data));
    }
    Modulation(stack)
}

fn truth([mu_a, mu_s_prime]: [f64; 2]) -> Truth {
    let mut stack = ImageStack::new(SIDE, SIDE);
    stack.push(LayerInfo::value("mu_a", "mm^-1"), Array2::from_elem((SIDE, SIDE), mu_a as f32));
    stack.push(LayerInfo::value("mu_s_prime", "mm^-1"), Array2::from_elem((SIDE, SIDE), mu_s_prime as f32));
    // A pixel beside the phantom says nothing.
    let mut mask = Array2::zeros((SIDE, SIDE));
    mask[(0, 0)] = 1.0;
    stack.push(LayerInfo::new("mask", LayerKind::Mask, "1"), mask);
    stack.layers[0].data[(0, 0)] = 0.0;
    Truth(stack)
}

fn axes(a: f64, s: f64) -> Axes {
    Axes::from([("mu_a".to_owned(), json!(a)), ("mu_s_prime".to_owned(), json!(s))])
}

/// Phantoms on a grid; `error` relative of M at both f_x by the phantom's number.
fn phantoms(mu_a: &[f64], mu_s_prime: &[f64], error: impl Fn(usize) -> [f64; 2], se: f64) -> Inputs {
    let mut inputs = Inputs::default();
    for &a in mu_a {
        for &s in mu_s_prime {
            let number = inputs.ports.get("phantoms").map_or(0, Vec::len);
            inputs = inputs.with_at("phantoms", axes(a, s), modulation([a, s], error(number), se));
            inputs = inputs.with_at("truths", axes(a, s), truth([a, s]));
        }
    }
    inputs = inputs.with_at("references", Axes::new(), modulation(REFERENCE, [0.0; 2], 0.0));
    inputs
}

fn params(interpolation: &str) -> Value {
    json!({"model": "empirical", "f_x": F_X, "g": G, "n": 1.0, "interpolation": interpolation,
           "reference": {"mu_a": REFERENCE[0], "mu_s_prime": REFERENCE[1]}})
}

fn build(params: &Value, inputs: &Inputs) -> Result<Table, Error> {
    let host = MemoryHost::default();
    let outputs = StageRow::of::<BuildLut>().run(params, inputs, Ctx::new(&host))?;
    let lut = outputs.into_iter().find(|(name, _)| *name == "lut").expect("the port is never left out").1;
    Ok((*Lut::from_artifact(lut)?.0).clone())
}

/// Largest and mean relative error of a table against the solver, over all nodes, %.
fn errors(table: &Table) -> [f64; 2] {
    let column = |name| table.f64s(name).unwrap();
    let (a, s, f_x, r_d) = (column("mu_a"), column("mu_s_prime"), column("f_x"), column("r_d"));
    let step = (table.rows() / 400).max(1);
    let all: Vec<f64> =
        (0..table.rows()).step_by(step).map(|i| 100.0 * (r_d[i] / camera([a[i], s[i]], f_x[i]) - 1.0).abs()).collect();
    [all.iter().fold(0.0, |m, &e| f64::max(m, e)), all.iter().sum::<f64>() / all.len() as f64]
}

const PAPER_A: [f64; 3] = [0.026, 0.06, 0.121];
const PAPER_S: [f64; 3] = [0.93, 2.1, 4.75];
const FIVE_A: [f64; 5] = [0.01, 0.02, 0.04, 0.08, 0.16];
const FIVE_S: [f64; 5] = [0.5, 0.89, 1.58, 2.81, 5.0];

/// Noise-free phantoms: what guides is here the truth itself, so nothing but the f32 of the images is left; in log-log
/// nine phantoms are better than the paper's linear step by far, and twenty-five better again.
#[test]
fn between_phantoms() {
    let none = |_| [0.0; 2];
    let error = |interpolation: &str, a: &[f64], s: &[f64]| {
        errors(&build(&params(interpolation), &phantoms(a, s, none, 0.0)).unwrap())
    };
    let guided = error("guided", &PAPER_A, &PAPER_S);
    let log_log = error("log_log", &PAPER_A, &PAPER_S);
    let five = error("log_log", &FIVE_A, &FIVE_S);
    let paper = error("paper", &PAPER_A, &PAPER_S);
    println!("worst and mean %: guided {guided:?}, log_log {log_log:?}, five {five:?}, paper {paper:?}");
    // Nine values of f32 each rounded by 2^-24, gain of the surface below 2.
    assert!(guided[0] < 100.0 * 4.0 * 2f64.powi(-24), "{guided:?}");
    assert!(log_log[0] < 0.2 * paper[0] && log_log[1] < 0.2 * paper[1], "{log_log:?} {paper:?}");
    assert!(five[1] < 0.2 * log_log[1], "{five:?} {log_log:?}");
}

/// What the reference's model says cancels in the relative convention; a mask hides the pixel beside the phantom.
#[test]
fn relative_tables_hold_ratios() {
    let mut params = params("log_log");
    params["convention"] = json!("relative");
    let table = build(&params, &phantoms(&PAPER_A, &PAPER_S, |_| [0.0; 2], 0.0)).unwrap();
    assert_eq!(table.attributes["convention"], json!("relative"));
    assert_eq!(table.attributes["reference"], json!({"mu_a": 0.02, "mu_s_prime": 1.5}));
    let (r_d, half) = (table.f64s("r_d").unwrap(), table.rows() / 2);
    // First and last node are phantoms: the surface passes through them.
    for (i, medium, f_x) in [(0, [0.026, 0.93], 0.0), (2 * half - 1, [0.121, 4.75], 0.1)] {
        let ratio = camera(medium, f_x) / camera(REFERENCE, f_x);
        assert!((r_d[i] / ratio - 1.0).abs() < 1e-6, "{} {ratio}", r_d[i]);
    }
}

/// Phantoms that are off at random by their stated errors make tables that are off by theirs: z over 40 sets.
#[test]
fn standard_errors_cover_the_noise() {
    const SE: f64 = 0.08;
    let (mut squares, mut n) = (0.0, 0);
    let mut random = 0x9e37_79b9_7f4a_7c15_u64;
    let mut normal = move || {
        // Sum of twelve uniforms less 6: variance 1.
        let uniform = |random: &mut u64| {
            *random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (*random >> 11) as f64 / (1_u64 << 53) as f64
        };
        (0..12).map(|_| uniform(&mut random)).sum::<f64>() - 6.0
    };
    for _ in 0..40 {
        // The mean of 64 independent pixels is 8 times better known than one.
        let noise: Vec<[f64; 2]> = (0..9).map(|_| [normal(), normal()].map(|z| z * SE / SIDE as f64)).collect();
        let table = build(&params("log_log"), &phantoms(&PAPER_A, &PAPER_S, |i| noise[i], SE)).unwrap();
        let exact = build(&params("log_log"), &phantoms(&PAPER_A, &PAPER_S, |_| [0.0; 2], SE)).unwrap();
        let column = |table: &Table, name| -> Vec<f64> {
            table.maybe_f64s(name).unwrap().into_iter().map(|cell| cell.expect("known")).collect()
        };
        let (r, se, truth) = (column(&table, "r_d"), column(&table, "r_d_se"), column(&exact, "r_d"));
        // Nodes share phantoms; these four of each f_x are nearly independent of each other.
        for k in [0, 24, 600, 624, 625, 649, 1225, 1249] {
            let z = libm::log(r[k] / truth[k]) / (se[k] / r[k]);
            squares += z * z;
            n += 1;
        }
    }
    let rms = (squares / f64::from(n)).sqrt();
    // 320 values: 1 / sqrt(640) is the spread of their rms.
    assert!((rms - 1.0).abs() < 4.0 * (1.0 / 640f64).sqrt(), "rms z {rms}");
}

#[test]
fn bad_phantoms_are_named() {
    let none = |_| [0.0; 2];
    let fails = |params: &Value, inputs: &Inputs| build(params, inputs).unwrap_err().to_string();
    let few = phantoms(&PAPER_A, &PAPER_S[..1], none, 0.0);
    assert!(fails(&params("guided"), &few).contains("3 phantoms are too few"));
    let line = phantoms(&FIVE_A, &FIVE_S[..1], none, 0.0);
    assert!(fails(&params("log_log"), &line).contains("lie on a line"));
    let good = phantoms(&PAPER_A, &PAPER_S, none, 0.0);
    let mut wide = params("log_log");
    wide["mu_a"] = json!([0.01, 0.1]);
    let message = fails(&wide, &good);
    assert!(
        message.starts_with("mu_a: mu_a from 0.01 to 0.1 mm^-1 reaches beyond the phantoms (0.0260 to 0.1210)"),
        "{message}"
    );
    let mut other = params("log_log");
    other["f_x"] = json!([0, 0.2]);
    let message = fails(&other, &good);
    assert!(
        message.contains("with mu_a = 0.026, mu_s_prime = 0.93 was seen at f_x = 0, 0.1 mm^-1, not at 0.2"),
        "{message}"
    );
    let mut dark = phantoms(&PAPER_A, &PAPER_S, |i| if i == 4 { [-1.0; 2] } else { [0.0; 2] }, 0.0);
    assert!(fails(&params("log_log"), &dark).contains("no modulation in common at f_x = 0 mm^-1"));
    dark.ports.get_mut("references").unwrap().clear();
    assert!(fails(&params("log_log"), &dark).contains("0 of `references` belong to the phantom with mu_a = 0.026"));
    let mut two = phantoms(&PAPER_A, &PAPER_S, none, 0.0);
    let Artifact::Images(stack) = &mut two.ports.get_mut("truths").unwrap()[3].1 else { panic!("a truth is an image") };
    stack.layers[0].data[(3, 3)] = 0.5;
    assert!(fails(&params("log_log"), &two).contains("shows mu_a from"));
}

/// Sections get tables of their own from their own pixels, blended pixels by their shares; the section of a phantom that shows nothing is named.
#[test]
fn sections_have_parts_of_their_own() {
    let mut sections = ImageStack::new(SIDE, SIDE);
    // Rows 0 to 3 are the first section, 4 to 7 the second; row 3 is one half each.
    let plane = |f: &dyn Fn(usize) -> f32| Array2::from_shape_fn((SIDE, SIDE), |(row, _)| f(row));
    sections.push(LayerInfo::value("section", "1"), plane(&|row| f32::from(u8::from(row > 3))));
    sections.push(LayerInfo::value("neighbour", "1"), plane(&|row| f32::from(u8::from(row > 2))));
    sections.push(LayerInfo::value("weight", "1"), plane(&|row| if row == 3 { 0.5 } else { 1.0 }));
    sections.push(LayerInfo::new("mask", LayerKind::Mask, "1"), plane(&|_| 0.0));
    let bounds = |from: f64, to: f64| json!({"from_mm": from, "to_mm": to, "pixels": 32, "m_dc": 1.0});
    sections.attributes.insert("sections".into(), json!([bounds(0.0, 10.0), bounds(10.0, 20.0)]));
    // The second half of the tube returns half as much of the fringe, whatever the medium.
    let mut inputs = phantoms(&PAPER_A, &PAPER_S, |_| [0.0; 2], 0.01);
    for (_, artifact) in inputs.ports.get_mut("phantoms").unwrap() {
        let Artifact::Images(stack) = artifact else { panic!("a modulation is an image") };
        for ((row, _), m) in stack.layers[1].data.indexed_iter_mut() {
            *m *= if row > 3 { 0.5 } else { 1.0 };
        }
    }
    inputs = inputs.with_at("sections", Axes::new(), Sections(sections));
    let table = build(&params("log_log"), &inputs).unwrap();
    let Cells::I64(section) = &table.columns[0].cells else { panic!("the section is a whole number") };
    let (r_d, f_x) = (table.f64s("r_d").unwrap(), table.f64s("f_x").unwrap());
    let half = table.rows() / 2;
    assert!(section[..half].iter().all(|&s| s == 0) && section[half..].iter().all(|&s| s == 1));
    // Weights of the vignette: what row 3 adds to the second section with half its share is the first section's fringe.
    let row_sum = |row: usize| (0..SIDE).map(|column| 1.0 - 0.002 * (row * row + column) as f64).sum::<f64>();
    let rows = |rows: std::ops::Range<usize>| rows.map(row_sum).sum::<f64>();
    let second = (0.5 * rows(4..8) + 0.5 * row_sum(3)) / (rows(4..8) + 0.5 * row_sum(3));
    for i in 0..half {
        let want = if f_x[i] > 0.0 { second } else { 1.0 };
        assert!((r_d[half + i] / r_d[i] / want - 1.0).abs() < 1e-5, "{} {want}", r_d[half + i] / r_d[i]);
    }
    // 28 rows of 8 pixels, a half row counted by its share: 1 % / sqrt(n_eff).
    let se = table.maybe_f64s("r_d_se").unwrap()[0].unwrap() / r_d[0];
    let weights: f64 = rows(0..3) + 0.5 * row_sum(3);
    let squares: f64 = (0..4)
        .map(|row| if row == 3 { 0.25 } else { 1.0 } * (0..SIDE).map(|c| (1.0 - 0.002 * (row * row + c) as f64).powi(2)).sum::<f64>())
        .sum();
    assert!((se / (0.01 * squares.sqrt() / weights) - 1.0).abs() < 1e-3, "{se}");
    let Artifact::Images(stack) = &mut inputs.ports.get_mut("phantoms").unwrap()[2].1 else { panic!("an image") };
    stack.push(LayerInfo::new("mask", LayerKind::Mask, "1"), plane(&|row| if row > 2 { 1.0 } else { 0.0 }));
    let message = build(&params("log_log"), &inputs).unwrap_err().to_string();
    assert!(message.contains("in section 1") && message.contains("fewer sections"), "{message}");
}

/// Properties may come from a fit whose rows an axis of the phantoms names; a row that failed stops the table.
#[test]
fn fits_give_properties() {
    let mut inputs = Inputs::default();
    let media: Vec<[f64; 2]> = PAPER_A.iter().flat_map(|&a| PAPER_S.iter().map(move |&s| [a, s])).collect();
    let names: Vec<String> = (0..9).map(|i| format!("m{i}")).collect();
    for (name, &medium) in names.iter().zip(&media) {
        let axes = Axes::from([("medium".to_owned(), json!(name))]);
        inputs = inputs.with_at("phantoms", axes, modulation(medium, [0.0; 2], 0.0));
    }
    inputs = inputs.with_at("references", Axes::new(), modulation(REFERENCE, [0.0; 2], 0.0));
    let fit = |status: &str| {
        let mut table = Table::default();
        // As `calibrate_iad` writes them.
        let column = |f: &dyn Fn(&[f64; 2]) -> f64| Cells::MaybeF64(media.iter().map(|m| Some(f(m))).collect());
        table.push("medium", "", Cells::Text(names.clone()));
        table.push("mu_a", "mm^-1", column(&|m| m[0]));
        table.push("mu_s_prime", "mm^-1", column(&|m| m[1]));
        table.push("mu_a_se", "mm^-1", column(&|m| 0.01 * m[0]));
        table.push("mu_s_prime_se", "mm^-1", column(&|_| 0.0));
        table.push("status", "", Cells::Text(vec![status.to_owned(); 9]));
        turbid_contract::payload::Fit(table)
    };
    inputs = inputs.with_at("properties", Axes::new(), fit("ok"));
    let table = build(&params("guided"), &inputs).unwrap();
    // At a corner, which is a phantom: 1 % of mu_a moves ln R by its slope there.
    let slope =
        0.5 * (libm::log(camera([0.026 * 1.01, 0.93], 0.0)) - libm::log(camera([0.026 * 0.99, 0.93], 0.0))).abs();
    let se = table.maybe_f64s("r_d_se").unwrap()[0].unwrap() / table.f64s("r_d").unwrap()[0];
    assert!((se / slope - 1.0).abs() < 0.02, "{se} {slope}");
    inputs.ports.get_mut("properties").unwrap()[0].1 = fit("too_much_light").into_artifact();
    let message = build(&params("log_log"), &inputs).unwrap_err().to_string();
    assert!(message.contains("ended as `too_much_light`"), "{message}");
}

/// The port `design` names the values of the phantoms' axes that give wanted media: here the properties themselves. It is made only where it is wanted.
#[test]
fn wanted_media_have_a_design() {
    let mut params = params("log_log");
    params["wanted"] = json!([{"mu_a": 0.05, "mu_s_prime": "12 cm^-1"}]);
    let run = |wanted: &[&str]| {
        let host = MemoryHost { wanted: wanted.iter().map(|w| w.to_string()).collect(), ..MemoryHost::default() };
        let inputs = phantoms(&PAPER_A, &PAPER_S, |_| [0.0; 2], 0.01);
        let outputs = StageRow::of::<BuildLut>().run(&params, &inputs, Ctx::new(&host)).unwrap();
        outputs.into_iter().find(|(name, _)| *name == "design").map(|(_, artifact)| artifact)
    };
    let Some(Artifact::Table(table)) = run(&["design"]) else { panic!("the design is a table") };
    // Columns hold the wanted media, then the axes, which have the names of the properties here: what was wanted, to the f32 of the truth.
    for (k, expected) in [0.05, 1.2, 0.05, 0.0, 1.2, 0.0].into_iter().enumerate() {
        let Cells::F64(cells) = &table.columns[k].cells else { panic!("numbers") };
        assert!((cells[0] - expected).abs() < 1e-6 * (1.0 + expected), "{}: {}", table.columns[k].name, cells[0]);
    }
    assert!(run(&[]).is_none());
}

/// Every mistake that can be seen before phantoms are there.
#[test]
fn mistakes_of_params_and_ports() {
    let check = |params: &Value, connected: &[&str]| {
        let mut problems = Problems::default();
        let known = Known { connected: connected.iter().map(|&c| c.to_owned()).collect(), ..Known::default() };
        StageRow::of::<BuildLut>().check(params, &known, &mut problems);
        problems.into_parts().0.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n")
    };
    let good = params("guided");
    assert_eq!(check(&good, &["phantoms", "references", "truths"]), "");
    assert!(check(&good, &["phantoms"]).contains("needs the input `references`"));
    assert!(check(&good, &["phantoms", "references"]).contains("connect one of them"));
    assert!(check(&good, &["phantoms", "references", "truths", "properties"]).contains("connect one of them"));
    let mut bare = good.clone();
    bare.as_object_mut().unwrap().remove("reference");
    assert!(check(&bare, &["phantoms", "references", "truths"]).contains("reference: what phantoms reflect"));
    let rte = json!({"model": "rte", "f_x": F_X, "g": G, "n": 1.0, "convention": "relative", "interpolation": "paper"});
    let mut wanting = good.clone();
    wanting["wanted"] = json!([{"mu_a": 0.0, "mu_s_prime": 1.0}]);
    assert!(check(&wanting, &["phantoms", "references", "truths"]).contains("wanted.0.mu_a"));
    wanting["wanted"] = json!([]);
    assert!(check(&wanting, &["phantoms", "references", "truths"]).contains("wanted names no medium"));
    let found = check(&rte, &["phantoms"]);
    for part in
        ["only `model: empirical` has interpolation", "a model knows no reference phantom", "`phantoms` is connected"]
    {
        assert!(found.contains(part), "{found}");
    }
    assert_eq!(BuildLut::NAME, "build_lut");
}

/// Truths at another wavelength than the phantoms', or without coefficients, say nothing of them: found before the run by the rule of the run.
#[test]
fn truths_are_of_the_phantoms() {
    let trial = |change: &dyn Fn(&mut LayerInfo)| {
        let mut inputs = phantoms(&FIVE_A, &FIVE_S, |_| [0.0; 2], 0.0);
        for (_, truth) in inputs.ports.get_mut("truths").expect("they are there") {
            let Artifact::Images(stack) = truth else { panic!("a truth is an image") };
            stack.layers.iter_mut().for_each(|layer| change(&mut layer.info));
        }
        Trial { inputs, ..Trial::of::<BuildLut>(params("log_log")) }
    };
    trial(&|_| {}).passes();
    for (words, change) in [
        (
            "the truth has mu_a at 650 nm, the phantom was seen at no wavelength",
            &(|info: &mut LayerInfo| info.wavelength_nm = Some(650.0)) as &dyn Fn(&mut LayerInfo),
        ),
        ("the truth has no mu_a", &|info: &mut LayerInfo| info.name = info.name.replace("mu_a", "albedo")),
    ] {
        trial(change).refuses("in.truths", &format!("`made.truths`: {words}"));
        let error = trial(change).run_alone(&MemoryHost::default()).expect_err("it is refused");
        assert!(error.to_string().contains(words), "{error}");
    }
}

/// Phantoms that do not know their errors make a table that does not: null and a warning, and no error of 0 % in the summary of the run. Errors that
/// are 0 are known.
#[test]
fn unknown_errors_are_no_error_of_0() {
    let made = |se: f64| {
        let host = MemoryHost::default();
        let inputs = phantoms(&PAPER_A, &PAPER_S, |_| [0.0; 2], se);
        let made = StageRow::of::<BuildLut>().run(&params("log_log"), &inputs, Ctx::new(&host)).expect("a table");
        let Lut(table) = Lut::from_artifact(made.into_iter().next().expect("a port").1).expect("a table");
        let column = table.maybe_f64s("r_d_se").expect("a column");
        let told = host.measures.lock().expect("no holder panics").contains_key("error: r_d per node");
        let warned = host.warnings.lock().expect("no holder panics").iter().any(|w| w.contains("no standard errors"));
        (column.iter().filter(|se| se.is_some()).count() == table.rows(), column[0], told, warned)
    };
    let (all, first, told, warned) = made(0.01);
    assert!(all && first > Some(0.0) && told && !warned);
    assert_eq!(made(0.0), (true, Some(0.0), true, false));
    assert_eq!(made(-1.0), (false, None, false, true));
}
