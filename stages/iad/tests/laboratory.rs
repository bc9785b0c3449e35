//! Files of laboratories through the stage: all that the program `iad` reads, and what is known of some of them.
#![cfg(feature = "stage")]

use std::sync::Arc;

use turbid_contract::{Cells, Ctx, Known, MemoryHost, Problems, Stage, Table, serde_json};
use turbid_iad::laboratory::read_rxt;
use turbid_iad::{CalibrateIad, In, Instrument, Losses, Model, Params, Slab, Slide, Spheres, Spot};

const FILES: [(&str, &[u8]); 31] = [
    ("basic_A", include_bytes!("rxt/0_sphere/basic_A.rxt")),
    ("basic_C", include_bytes!("rxt/0_sphere/basic_C.rxt")),
    ("basic_E", include_bytes!("rxt/0_sphere/basic_E.rxt")),
    ("kenlee_A", include_bytes!("rxt/0_sphere/kenlee_A.rxt")),
    ("kenlee_C", include_bytes!("rxt/0_sphere/kenlee_C.rxt")),
    ("newton", include_bytes!("rxt/0_sphere/newton.rxt")),
    ("sample_B", include_bytes!("rxt/0_sphere/sample_B.rxt")),
    ("sevick_B", include_bytes!("rxt/0_sphere/sevick_B.rxt")),
    ("510nm_phantom", include_bytes!("rxt/1_sphere/510nm_phantom.rxt")),
    ("basic_F", include_bytes!("rxt/1_sphere/basic_F.rxt")),
    ("combo_0", include_bytes!("rxt/1_sphere/combo_0.rxt")),
    ("combo_2", include_bytes!("rxt/1_sphere/combo_2.rxt")),
    ("fairway_C", include_bytes!("rxt/1_sphere/fairway_C.rxt")),
    ("fairway_E", include_bytes!("rxt/1_sphere/fairway_E.rxt")),
    ("homa2", include_bytes!("rxt/1_sphere/homa2.rxt")),
    ("il_A", include_bytes!("rxt/1_sphere/il_A.rxt")),
    ("il_C", include_bytes!("rxt/1_sphere/il_C.rxt")),
    ("ink_B", include_bytes!("rxt/1_sphere/ink_B.rxt")),
    ("mutest", include_bytes!("rxt/1_sphere/mutest.rxt")),
    ("royston2", include_bytes!("rxt/1_sphere/royston2.rxt")),
    ("royston3_B", include_bytes!("rxt/1_sphere/royston3_B.rxt")),
    ("royston3_D", include_bytes!("rxt/1_sphere/royston3_D.rxt")),
    ("royston9_A", include_bytes!("rxt/1_sphere/royston9_A.rxt")),
    ("royston9_C", include_bytes!("rxt/1_sphere/royston9_C.rxt")),
    ("sample_C", include_bytes!("rxt/1_sphere/sample_C.rxt")),
    ("sample_F", include_bytes!("rxt/1_sphere/sample_F.rxt")),
    ("terse_A", include_bytes!("rxt/1_sphere/terse_A.rxt")),
    ("tio2_vis", include_bytes!("rxt/1_sphere/tio2_vis.rxt")),
    ("vio_A", include_bytes!("rxt/1_sphere/vio_A.rxt")),
    ("x_bad_data", include_bytes!("rxt/1_sphere/x_bad_data.rxt")),
    ("example2", include_bytes!("rxt/2_sphere/example2.rxt")),
];

fn file(name: &str) -> &'static [u8] {
    FILES.iter().find(|f| f.0 == name).unwrap_or_else(|| panic!("no {name}")).1
}

fn params(json: &str) -> Params {
    serde_json::from_str(json).expect(json)
}

fn run(with: &str, bytes: &[u8]) -> Table {
    let mut host = MemoryHost { seed: 5, ..MemoryHost::default() };
    host.files.insert("file".to_owned(), Arc::from(bytes));
    let input = In { readings: None, source: std::marker::PhantomData };
    CalibrateIad::run(&params(&format!(r#"{{"file": "a.rxt"{with}}}"#)), input, Ctx::new(&host)).expect("runs").fit.0
}

/// Mistakes and warnings before anything runs.
fn checked(with: &str, bytes: &[u8]) -> [Vec<String>; 2] {
    let mut known = Known::default();
    known.files.insert("file".to_owned(), Arc::from(bytes));
    let mut problems = Problems::default();
    CalibrateIad::check(&params(&format!(r#"{{"file": "a.rxt"{with}}}"#)), &known, &mut problems);
    let (mistakes, warnings) = problems.into_parts();
    [mistakes, warnings].map(|all| all.iter().map(ToString::to_string).collect())
}

fn texts<'a>(table: &'a Table, name: &str) -> &'a [String] {
    match table.columns.iter().find(|c| c.name == name).map(|c| &c.cells) {
        Some(Cells::Text(texts)) => texts,
        other => panic!("{name}: {other:?}"),
    }
}

fn column(table: &Table, name: &str) -> Vec<Option<f64>> {
    table.maybe_f64s(name).unwrap_or_else(|| panic!("no column {name}"))
}

/// Rows of numbers below the header, by eye.
#[test]
fn every_file_is_read() {
    let rows = |name: &str| match name {
        "basic_A" => 5,
        "basic_C" | "basic_E" | "basic_F" => 24,
        "kenlee_A" | "kenlee_C" | "newton" => 6,
        "sevick_B" | "il_A" | "il_C" | "royston2" => 10,
        "sample_B" | "sample_C" | "sample_F" => 21,
        "combo_0" => 486,
        "combo_2" | "terse_A" | "royston3_B" => 2,
        "fairway_C" | "fairway_E" | "ink_B" => 15,
        "mutest" | "example2" => 3,
        "royston3_D" => 5,
        "royston9_A" => 8,
        "royston9_C" => 6,
        "tio2_vis" => 481,
        "vio_A" => 201,
        _ => 0,
    };
    for (name, bytes) in FILES {
        let sheet = read_rxt(bytes).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert!(rows(name) == 0 || sheet.rows() == rows(name), "{name}: {} rows", sheet.rows());
        assert_eq!(sheet.places.len(), sheet.rows(), "{name}");
        let [mistakes, _] = checked("", bytes);
        assert!(mistakes.is_empty(), "{name}: {mistakes:?}");
    }
}

/// What stands in each file's comments: the accurate readings of these media. Absorption and scattering within 0.3 % and 0.5 %: the files
/// hold what another program computed with its own quadrature.
#[test]
fn files_of_known_media_are_inverted() {
    let truths = |bytes: &[u8]| -> Vec<[f64; 3]> {
        let text = std::str::from_utf8(bytes).expect("text");
        // Three numbers in a row's comment; comments of the header are words.
        let told = |l: &str| -> Option<[f64; 3]> {
            let comment = l.split_once('#')?.1;
            let numbers: Option<Vec<f64>> = comment.split_whitespace().map(|x| x.parse().ok()).collect();
            numbers?.try_into().ok()
        };
        text.lines().filter_map(told).collect()
    };
    // mu_s, mu_a, g
    for (name, with) in [("basic_C", ""), ("basic_E", r#", "g": 0.9"#)] {
        let fit = run(with, file(name));
        let (mu_a, mu_s_prime, g) = (column(&fit, "mu_a"), column(&fit, "mu_s_prime"), column(&fit, "g"));
        let truths = truths(file(name));
        assert_eq!(truths.len(), fit.rows(), "{name}");
        for (i, [mu_s, a, g_true]) in truths.into_iter().enumerate() {
            let found = [mu_a[i], mu_s_prime[i], g[i]].map(|x| x.expect("a number"));
            let s = mu_s * (1.0 - g_true);
            assert!(texts(&fit, "status")[i].starts_with("ok"), "{name} {i}: {fit:?}");
            println!("{name} {i}: {found:?} {:?}", [a, s, g_true]);
            assert!(
                (found[0] / a - 1.0).abs() < 3e-3 && (found[1] / s - 1.0).abs() < 5e-3,
                "{name} {i}: {found:?} {a} {s}"
            );
            assert!((found[2] - g_true).abs() < 1e-3, "{name} {i}: {found:?}");
        }
        assert!(column(&fit, "mu_a_se").iter().all(Option::is_none), "no readings' errors are stated");
        assert!(column(&fit, "mu_a_model_error").iter().all(|x| x.is_some_and(|x| x > 0.0 && x < 1e-2)));
    }
    // M_R alone: mu_a over mu_s' of a half-space, mu_s' = 1.
    let fit = run("", file("basic_A"));
    for (i, [a, s, _]) in truths(file("basic_A")).into_iter().enumerate() {
        let ratio = column(&fit, "mu_a_over_mu_s_prime")[i].expect("a ratio");
        println!("basic_A {i}: {ratio} {}", a / s);
        assert_eq!(texts(&fit, "status")[i], "underdetermined");
        assert!((ratio / (a / s) - 1.0).abs() < 1e-2, "{i}: {ratio}");
    }
}

/// The header of all small files here, with what follows it; M_R and M_T of n = 1.4 between slides.
fn small(slides: &str, spheres: u32, rows: &str) -> String {
    format!(
        "IAD1\n1.4 {slides} 5 # n, slides, mm, mm, beam\n0.99 {spheres}\n203.2 12.7 12.7 1 0.96\n203.2 12.7 0 1 0.96\n{rows}\n"
    )
}

/// A slide of thickness 0 is none, and so is one of index 1 or 0.
#[test]
fn slides_without_thickness_are_none() {
    let fit = |slides: &str| column(&run(r#", "g": 0.8"#, small(slides, 0, "2\n0.3 0.2").as_bytes()), "mu_a")[0];
    let none = fit("1 1 1");
    assert_eq!([fit("1.5 1 0"), fit("0 1 1"), fit("1 1 0")], [none; 3]);
    let with = fit("1.5 1 1");
    assert!(with != none && with.is_some());
}

/// Letters name columns in any order; what they say takes the place of the header, row by row, and a share of unscattered light counts without
/// spheres, too.
#[test]
fn letters_mean_what_they_say() {
    let fit = |rows: &str| run(r#", "lost_light": "ignore""#, small("1.5 1 1", 0, rows).as_bytes());
    let plain = run(r#", "g": 0.8"#, small("1.5 1 1", 0, "2\n0.3 0.2").as_bytes());
    let letters = fit("L t r g\n633 0.2 0.3 0.8");
    assert_eq!(
        (column(&letters, "mu_a"), texts(&letters, "medium")),
        (column(&plain, "mu_a"), &["633 nm".to_owned()][..])
    );
    let thick = fit("r t g d\n0.3 0.2 0.8 2");
    let [one, two] = [&plain, &thick].map(|t| column(t, "mu_a")[0].expect("a number"));
    assert!((2.0 * two / one - 1.0).abs() < 1e-9, "twice the thickness, half the coefficient: {one} {two}");
    // Nothing specular in M_R: add what the surfaces reflect and it is the plain row.
    let slab = Slab { top: Slide::clear(1.5), bottom: Slide::clear(1.5), ..Slab::bare(1.4, 0.8, 1.0) };
    let instrument = Instrument { unscattered: [0.0, 0.5], ..Instrument::NONE };
    let model = Model::<32>::new(&slab, &instrument, turbid_iad::Incidence::Normal).expect("a slab");
    let [m_r, m_t] = model.readings(0.1, 1.0, &Default::default()).expect("readings");
    let collected = run(r#", "N": 32"#, small("1.5 1 1", 0, &format!("r t g c C\n{m_r} {m_t} 0.8 0 0.5")).as_bytes());
    let found = column(&collected, "mu_a")[0].expect("a number");
    assert!((found - 0.1).abs() < 1e-6, "{collected:?}");
    // Slanted light, and a wall of the row's own.
    let slanted = fit("r t g i\n0.3 0.2 0.8 40");
    assert!(
        column(&slanted, "mu_a")[0] != column(&plain, "mu_a")[0] && texts(&slanted, "status")[0] == "ok",
        "{slanted:?}"
    );
    let wall = |w: &str| {
        let rows = format!("r t g w W\n0.3 0.2 0.8 {w} {w}");
        column(&run(r#", "lost_light": "ignore""#, small("1.5 1 1", 1, &rows).as_bytes()), "mu_a")[0]
    };
    assert!(wall("0.9") != wall("0.98"));
}

/// Known albedo, optical thickness, mu_s, mu_a: each recovers the medium from M_R alone, and from both readings with nothing left over.
#[test]
fn constraints_of_files() {
    let slab = Slab { top: Slide::clear(1.5), bottom: Slide::clear(1.5), ..Slab::bare(1.4, 0.8, 1.0) };
    let model = Model::<32>::new(&slab, &Instrument::NONE, turbid_iad::Incidence::Normal).expect("a slab");
    let (mu_a, mu_s_prime) = (0.1, 1.5);
    let mu_s = mu_s_prime / 0.2;
    let [m_r, m_t] = model.readings(mu_a, mu_s_prime, &Default::default()).expect("readings");
    for (letter, value) in [('A', mu_a), ('F', mu_s), ('a', mu_s / (mu_s + mu_a)), ('b', mu_s + mu_a)] {
        for rows in [format!("r g {letter}\n{m_r} 0.8 {value}"), format!("r t g {letter}\n{m_r} {m_t} 0.8 {value}")] {
            let fit = run(r#", "N": 32"#, small("1.5 1 1", 0, &rows).as_bytes());
            let found = ["mu_a", "mu_s_prime"].map(|name| column(&fit, name)[0].expect("a number"));
            assert!(
                texts(&fit, "status")[0] == "ok"
                    && (found[0] - mu_a).abs() < 1e-6
                    && (found[1] - mu_s_prime).abs() < 1e-5,
                "{letter}: {fit:?}"
            );
        }
    }
    let both = small("1.5 1 1", 0, "r t g a A\n0.3 0.2 0.8 0.9 0.1");
    let [mistakes, _] = checked("", both.as_bytes());
    assert!(mistakes.len() == 1 && mistakes[0].contains("a.rxt:7:1: mu_a and albedo are both given"), "{mistakes:?}");
    let twice = small("1.5 1 1", 0, "r t u b\n0.3 0.2 0.001 5");
    let [mistakes, _] = checked("", twice.as_bytes());
    assert!(mistakes[0].contains("a.rxt:7:1: the optical thickness is known and M_U says it, too"), "{mistakes:?}");
}

/// A beam of 5 mm on a port of 12.7 mm loses light through slides of 1 mm; the header says so, and the medium comes back within 4 of the errors
/// that the photons leave (of independent random numbers). Left out it is taken for absorption.
#[test]
fn light_lost_beside_the_port_is_reckoned_with() {
    let text = |m: [f64; 2]| small("1.5 1 1", 1, &format!("2\n{} {}", m[0], m[1]));
    let header = read_rxt(text([0.3, 0.2]).as_bytes()).expect("well formed").header.expect("an rxt has one");
    let slab = Slab { top: Slide::clear(1.5), bottom: Slide::clear(1.5), ..Slab::bare(1.4, 0.8, 1.0) };
    let spot = Spot { beam_mm: 5.0, angle: 0.0, ports_mm: [12.7; 2], slides_mm: [1.0; 2] };
    let (mu_a, mu_s_prime) = (0.02, 1.0);
    let (lost, _) = Losses::new(99).lost(&slab, &spot, mu_a, mu_s_prime);
    let model = Model::<32>::new(&slab, &header.instrument, turbid_iad::Incidence::Normal).expect("a slab");
    let readings = text(model.readings(mu_a, mu_s_prime, &lost).expect("readings"));
    let [right, wrong] =
        [r#", "g": 0.8"#, r#", "g": 0.8, "lost_light": "ignore""#].map(|w| run(w, readings.as_bytes()));
    let cell = |table: &Table, name: &str| column(table, name)[0].expect("a number");
    println!(
        "lost {lost:?}: {} +- {}; ignored {}",
        cell(&right, "mu_a"),
        cell(&right, "mu_a_model_error"),
        cell(&wrong, "mu_a")
    );
    assert!((cell(&right, "mu_a") - mu_a).abs() < 4.0 * 1.5 * cell(&right, "mu_a_model_error"), "{right:?}");
    assert!((cell(&right, "mu_s_prime") - mu_s_prime).abs() < 4.0 * 1.5 * cell(&right, "mu_s_prime_model_error"));
    assert!(cell(&right, "mu_a_model_error") < 0.15 * mu_a, "{right:?}");
    assert!(cell(&wrong, "mu_a") > 1.3 * mu_a, "{wrong:?}");
    // A beam wider than its port has no reading of the sample.
    let wide = run("", readings.replacen("1 1 5 #", "1 1 14 #", 1).as_bytes());
    assert!(
        texts(&wide, "status")[0] == "out_of_range" && texts(&wide, "message")[0].contains("sample port"),
        "{wide:?}"
    );
}

/// What a file leaves open is told before anything runs, and where the program that wrote it counts otherwise.
#[test]
fn conventions_are_named() {
    let [_, warnings] = checked("", file("sample_C"));
    let has = |what: &str| warnings.iter().any(|w| w.contains(what));
    assert!(
        has("g = 0, as the program `iad` does") && has("a white standard as 0.959") && has("third port"),
        "{warnings:?}"
    );
    let [_, warnings] = checked(r#", "g": 0.8, "spheres": "none""#, file("sample_C"));
    assert!(warnings.is_empty(), "{warnings:?}");
}

/// The first 50 lines of every file through the whole stage: no panic, finite numbers, and a row without a medium says why and holds none. Rows of `x_bad_data` that no sample can
/// give are named one by one.
#[test]
fn every_row_has_an_answer_or_a_reason() {
    for (name, bytes) in FILES {
        let end = bytes.iter().enumerate().filter(|(_, b)| **b == b'\n').map(|(i, _)| i).nth(50).unwrap_or(bytes.len());
        // The bad rows stand at the end of theirs.
        let bytes = if name == "x_bad_data" { bytes } else { &bytes[..end] };
        let fit = run(r#", "g": 0.8, "lost_light": "ignore""#, bytes);
        let status = texts(&fit, "status");
        let count = |wanted: &str| status.iter().filter(|s| s.split(',').next() == Some(wanted)).count();
        let mut kinds: Vec<&str> = status.iter().map(String::as_str).collect();
        kinds.sort_unstable();
        kinds.dedup();
        let told: Vec<String> =
            kinds.iter().map(|kind| format!("{kind} {}", status.iter().filter(|s| s == kind).count())).collect();
        println!("{name}: {} rows: {}", fit.rows(), told.join(", "));
        for (i, status) in status.iter().enumerate() {
            let first = status.split(',').next().unwrap_or_default();
            let fitted = ["ok", "conservative", "no_scatter", "empty", "ambiguous"].contains(&first);
            assert!(fitted || !texts(&fit, "message")[i].is_empty(), "{name} {i}: {status}");
            let has_numbers = fitted || first == "disagree";
            for column_of in ["mu_a", "mu_s_prime", "g"].map(|c| column(&fit, c)[i]) {
                assert_eq!(column_of.is_some_and(f64::is_finite), has_numbers, "{name} {i}: {status}, {column_of:?}");
            }
        }
        if name == "x_bad_data" {
            assert!(count("ok") < fit.rows(), "{told:?}");
        }
    }
}

/// A small generator of 32 bits (PCG), for mutations that are the same on every machine.
struct Random(u64);

impl Random {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) as usize) % n.max(1)
    }
}

/// Bytes flipped, cut, doubled, moved, replaced by what numbers may look like: the reader answers or names a place in the file, never a panic.
#[test]
fn mutated_files_never_panic() {
    const BITS: [&str; 14] = [
        "-",
        "1e400",
        "nan",
        "inf",
        "0",
        "#",
        "\n",
        "\r",
        "r t u",
        " 8 ",
        "\u{fffd}",
        "1e-320",
        "IAD1",
        "999999999999",
    ];
    let mut random = Random(14);
    let (mut read, mut refused) = (0, 0);
    for (name, bytes) in FILES {
        // The long ones are long in their rows: the first lines hold all that differs.
        let bytes = &bytes[..bytes.len().min(2500)];
        for _ in 0..300 {
            let mut mutant = bytes.to_vec();
            for _ in 0..=random.below(3) {
                let at = random.below(mutant.len());
                match random.below(5) {
                    0 => mutant[at] ^= 1 << random.below(8),
                    1 => mutant.truncate(at),
                    2 => {
                        let end = (at + random.below(40)).min(mutant.len());
                        mutant.drain(at..end);
                    }
                    3 => {
                        let end = (at + random.below(60)).min(mutant.len());
                        let piece = mutant[at..end].to_vec();
                        let to = random.below(mutant.len());
                        mutant.splice(to..to, piece);
                    }
                    _ => {
                        let piece = BITS[random.below(BITS.len())].bytes();
                        mutant.splice(at..at, piece);
                    }
                }
                if mutant.is_empty() {
                    break;
                }
            }
            match read_rxt(&mutant) {
                Ok(sheet) => {
                    read += 1;
                    assert!(
                        sheet.columns.iter().all(|c| c.1.len() == sheet.rows() && c.1.iter().all(|x| x.is_finite())),
                        "{name}"
                    );
                    // What the stage makes of it before it runs.
                    checked(r#", "g": 0.8"#, &mutant);
                }
                Err(error) => {
                    refused += 1;
                    let lines = mutant.iter().filter(|&&b| b == b'\n' || b == b'\r').count() + 2;
                    assert!((1..=lines).contains(&error.line) && error.column > 0, "{name}: {error}");
                }
            }
        }
    }
    assert!(read > 1000 && refused > 1000, "{read} {refused}");
}

/// Spheres with ports that cannot be count only where spheres are used.
#[test]
fn unused_spheres_may_be_anything() {
    let odd = |spheres: u32| small("1.5 1 1", spheres, "2\n0.3 0.2").replace("203.2 12.7 12.7 1 0.96", "0 0 0 0 0");
    assert!(read_rxt(odd(0).as_bytes()).is_ok_and(|s| s.header.is_some_and(|h| h.instrument.spheres == Spheres::None)));
    let error = read_rxt(odd(1).as_bytes()).expect_err("a sphere of 0 mm");
    assert!(
        (error.line, error.column) == (4, 1)
            && error.message.contains("diameter of the reflectance sphere = 0 must be > 0"),
        "{error}"
    );
}
