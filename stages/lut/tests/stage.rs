//! The stage as the engine calls it: a small table end to end, and every mistake of its params.

use serde_json::{Value, json};
use turbid_contract::kit::Inputs;
use turbid_contract::payload::{Lut, Validity};
use turbid_contract::{Ctx, Known, MemoryHost, Payload, Problems, Stage, StageRow};
use turbid_lut::{BuildLut, Convention, Nodes, Recipe, monte_carlo};
use turbid_optics::{Medium, PhaseFunction, diffusion, rte};

fn build(params: &Value, host: &MemoryHost) -> (Lut, Option<Validity>) {
    let outputs = StageRow::of::<BuildLut>().run(params, &Inputs::none(), Ctx::new(host)).unwrap();
    let find = |port: &str| outputs.iter().find(|(name, _)| *name == port).map(|(_, artifact)| artifact.clone());
    (Lut::from_artifact(find("lut").unwrap()).unwrap(), find("validity").map(|a| Validity::from_artifact(a).unwrap()))
}

fn problems(params: &Value) -> Vec<String> {
    let mut problems = Problems::default();
    StageRow::of::<BuildLut>().check(params, &Known::default(), &mut problems);
    problems.into_parts().0.iter().map(ToString::to_string).collect()
}

/// Every row of the table is the model's value at its node, f_x outermost, mu_s' innermost; attributes tell the rest.
#[test]
fn rows_are_the_models_values() {
    for model in ["rte", "diffusion"] {
        let params = json!({
            "model": model, "f_x": [0, 0.1], "g": 0.5, "n": 1.4, "convention": "hemispherical_entered",
            "mu_a": [0.01, 0.1], "mu_s_prime": {"logspace": [0.5, 2, 3]}
        });
        let (Lut(table), validity) = build(&params, &MemoryHost::default());
        assert!(validity.is_none());
        let column = |name| table.f64s(name).unwrap();
        let names: Vec<&str> = table.columns.iter().map(|c| c.name.as_str()).collect();
        assert_eq!(names, ["mu_a", "mu_s_prime", "f_x", "r_d", "r_d_se", "r_d_bound"]);
        assert_eq!(column("f_x"), [[0.0; 6], [0.1; 6]].concat());
        assert_eq!(column("mu_a"), [[0.01; 3], [0.1; 3], [0.01; 3], [0.1; 3]].concat());
        for i in 0..table.rows() {
            let medium = Medium {
                mu_a: column("mu_a")[i],
                mu_s_prime: column("mu_s_prime")[i],
                phase: PhaseFunction::henyey_greenstein(0.5),
                n: 1.4,
            };
            let solve = if model == "rte" { rte::reflectance } else { diffusion::reflectance };
            let truth = solve(&medium, None, column("f_x")[i]).unwrap().hemispherical_entered;
            assert_eq!(column("r_d")[i], truth);
        }
        assert_eq!(table.attributes["convention"], json!("hemispherical_entered"));
        assert_eq!(table.attributes["model"], json!(model));
        assert_eq!(table.attributes["thickness"], Value::Null);
        assert_eq!(table.attributes["mu_a"], json!([0.01, 0.1]));
    }
}

/// The default range is invertible at (0, 0.1) mm^-1, and the noise gain is worst where absorption is faintest.
#[test]
fn validity_of_the_default_range() {
    let host = MemoryHost { wanted: vec!["validity".into()], ..MemoryHost::default() };
    let params = json!({"model": "diffusion", "f_x": [0, 0.1], "g": 0.8, "n": 1.4});
    let (_, validity) = build(&params, &host);
    let Validity(stack) = validity.unwrap();
    assert_eq!(host.measures.lock().unwrap()["invertible"], 1.0);
    assert!(host.warnings.lock().unwrap().is_empty());
    let gain = &stack.find("noise_gain_mu_a", None).unwrap().data;
    let (rows, columns) = gain.dim();
    assert_eq!((rows, columns), (28, 18));
    // Row 0 is the largest mu_a, the last column the largest mu_s'.
    // R -> 1 as 1 - c sqrt(mu_a / mu_s') there: hardly any signal in mu_a.
    let (faint, strong) = (gain[(rows - 1, columns - 1)], gain[(0, columns - 1)]);
    let largest = gain.iter().fold(0.0f32, |a, &b| a.max(b));
    assert!(faint == largest && faint > 2.0 * strong, "{faint} {strong} {largest}");
    let sign = &stack.find("jacobian_sign", None).unwrap().data;
    assert!(sign.iter().all(|&s| s == sign[(0, 0)] && s != 0.0));
}

/// Two frequencies that say the same cannot be inverted; the table is made, with a warning.
#[test]
fn a_blind_table_warns() {
    let host = MemoryHost::default();
    build(&json!({"model": "diffusion", "f_x": [0, 1e-12], "g": 0.8, "n": 1.4}), &host);
    assert_eq!(host.measures.lock().unwrap()["invertible"], 0.0);
    assert!(host.warnings.lock().unwrap()[0].contains("folds"));
}

#[test]
fn every_mistake_has_its_field() {
    let with = |key: &str, value: Value| {
        let mut params = json!({"model": "rte", "f_x": [0, 0.1], "g": 0.8, "n": 1.4});
        params[key] = value;
        params
    };
    for (key, value, message) in [
        ("model", json!("mie"), "model: there is no choice `mie` here (known: "),
        ("f_x", json!([]), "f_x: f_x has 0 nodes; at least 1 are needed"),
        ("f_x", json!([0.1, 0.0]), "f_x.1: f_x must increase, but 0 follows 0.1 (mm^-1)"),
        ("f_x", json!([-0.1, 0.0]), "f_x.0: f_x = -0.1 mm^-1 must be a finite number >= 0"),
        ("mu_a", json!([0.1]), "mu_a: mu_a has 1 nodes; at least 2 are needed"),
        ("mu_a", json!([0, 0.1]), "mu_a.0: mu_a = 0 mm^-1 must be a finite number > 0 (the axis is logarithmic)"),
        ("mu_a", json!({"logspace": [0.1, 1, 1]}), "mu_a: count = 1 must lie in 2..=10000"),
        ("mu_s_prime", json!([1, 1]), "mu_s_prime.1: mu_s_prime must increase, but 1 follows 1 (mm^-1)"),
        ("mu_s_prime", json!("2 mm"), "mu_s_prime: `2 mm` has the dimension length"),
        ("g", json!(1.0), "g: g = 1 must lie in (-1, 1)"),
        ("g", json!(0.99999), "g: g = 0.99999 must lie within +-0.999 for the transport solver"),
        ("n", json!(0.9), "n: n = 0.9 must be a finite number >= 1"),
        ("thickness", json!(0), "thickness: thickness = 0 mm must be a finite number > 0"),
        (
            "convention",
            json!("lambert"),
            "convention: there is no choice `lambert` here (known: `camera`, `hemispherical_incident`",
        ),
        ("samples", json!(1000), "samples: only `model: monte_carlo` has samples"),
        ("colour", json!(1), "there is no key `colour` here (known: `model`"),
    ] {
        let found = problems(&with(key, value.clone()));
        assert!(found.iter().any(|p| p.contains(message)), "{key} = {value}: {found:?}");
    }
    assert!(problems(&json!({"model": "rte", "f_x": [0], "n": 1.4}))[0].contains("`g` is missing"));
    let slab = json!({"model": "diffusion", "f_x": [0], "g": 0.8, "n": 1.4, "thickness": 2});
    assert!(problems(&slab)[0].contains("only transport and phantoms know slabs"));
}

/// Guards VERSION: the bits of a small table, the same on every machine. If this changes on purpose, raise VERSION.
#[test]
fn bytes_belong_to_the_version() {
    let params = json!({
        "model": "rte", "f_x": [0, 0.1], "g": 0.8, "n": 1.4, "mu_a": [0.01, 0.1], "mu_s_prime": [0.5, 2.0]
    });
    let (Lut(table), _) = build(&params, &MemoryHost::default());
    let bits =
        table.f64s("r_d").unwrap().iter().fold(0u64, |hash, r| (hash ^ r.to_bits()).wrapping_mul(0x0100_0000_01b3));
    assert_eq!((BuildLut::VERSION, format!("{bits:016x}").as_str()), (7, "7bcccf6f0209e333"));
}

/// What the Monte Carlo table reads between its own nodes: the transport solver's T at those nodes, interpolated to the table's,
/// against the solver there. Every fifth node of the default axes.
#[test]
fn interpolation_of_the_white_run_is_below_its_noise() {
    let every_fifth = |nodes: Vec<f64>| nodes.into_iter().step_by(5).collect::<Vec<f64>>();
    let recipe = Recipe {
        transport: true,
        f_x: vec![0.0, 0.1],
        mu_a: every_fifth(Nodes::logspace(1e-4, 0.5, 26).0),
        mu_s_prime: every_fifth(Nodes::logspace(0.1, 5.0, 16).0),
        g: 0.5,
        n: 1.0,
        thickness: None,
        convention: Convention::Camera,
    };
    let white = monte_carlo::white(&recipe);
    let at = |kappa: f64, alpha: f64| {
        rte::reflectance(
            &Medium { mu_a: alpha, mu_s_prime: 1.0, phase: PhaseFunction::henyey_greenstein(0.5), n: 1.0 },
            None,
            kappa,
        )
        .unwrap()
        .camera
    };
    let t: Vec<f64> = white.kappa.iter().flat_map(|&k| white.alpha.iter().map(move |&a| at(k, a))).collect();
    let found = monte_carlo::estimate(&recipe, &white, &[t.clone(), t]).unwrap();
    let mut worst = 0.0f64;
    for row in 0..recipe.rows() {
        for (i, truth) in recipe.row(row).unwrap().into_iter().enumerate() {
            worst = worst.max((found.r_d[row * recipe.mu_s_prime.len() + i] / truth - 1.0).abs());
        }
    }
    assert!(worst < 1e-4, "interpolation adds {worst:.1e}");
    println!("interpolation adds {worst:.1e}");
}

/// Against the transport solver, for both conventions and with internal reflection: nodes share their paths, so only each one's z is
/// judged, and that the paths say anything.
#[test]
fn the_monte_carlo_table_is_the_solvers_within_its_errors() {
    for (convention, n) in [("camera", 1.0), ("camera", 1.4), ("hemispherical_entered", 1.4)] {
        let params = json!({
            "model": "monte_carlo", "samples": 60_000, "f_x": [0, 0.1], "g": 0.8, "n": n, "convention": convention,
            "mu_a": {"logspace": [1e-3, 0.3, 5]}, "mu_s_prime": {"logspace": [0.3, 3, 4]}
        });
        let (Lut(table), _) = build(&params, &MemoryHost { seed: 7, ..MemoryHost::default() });
        let column = |name: &str| -> Vec<f64> {
            table.maybe_f64s(name).unwrap().into_iter().map(|cell| cell.expect("known")).collect()
        };
        let mut precise = 0;
        for i in 0..table.rows() {
            let medium = Medium {
                mu_a: column("mu_a")[i],
                mu_s_prime: column("mu_s_prime")[i],
                phase: PhaseFunction::henyey_greenstein(0.8),
                n,
            };
            let truth = rte::reflectance(&medium, None, column("f_x")[i]).unwrap();
            let truth = if convention == "camera" { truth.camera } else { truth.hemispherical_entered };
            let (r, se) = (column("r_d")[i], column("r_d_se")[i]);
            assert!((r - truth).abs() < 4.5 * se, "{convention}, {n}, node {i}: {r} +- {se}, solver {truth}");
            precise += usize::from(se < 0.02 * r);
        }
        assert!(precise * 4 > table.rows() * 3, "{convention}, {n}: {precise} of {} nodes within 2 %", table.rows());
    }
}

/// The stated bound of each row holds against twice the orders, sharp peaks included (the manual's 1e-5 does not: g = 0.99), and says
/// something: it is no larger than 1e-3 and a hundredth of the value. Where nothing is known of a model's error the bound is unknown.
#[test]
fn rows_state_what_the_solver_leaves_uncertain() {
    let table = |params: &Value| build(params, &MemoryHost::default()).0.0;
    for (g, n) in [(0.99, 1.4), (0.99, 1.0), (0.9, 1.4), (0.5, 1.0)] {
        let params = json!({
            "model": "rte", "f_x": [0], "g": g, "n": n,
            "mu_a": {"logspace": [1e-3, 0.5, 4]}, "mu_s_prime": {"logspace": [0.1, 5, 4]}
        });
        let table = table(&params);
        let column = |name: &str| table.f64s(name).unwrap();
        let bounds = table.maybe_f64s("r_d_bound").unwrap();
        let mut worst: f64 = 0.0;
        for (i, bound) in bounds.iter().enumerate() {
            let medium = Medium {
                mu_a: column("mu_a")[i],
                mu_s_prime: column("mu_s_prime")[i],
                phase: PhaseFunction::henyey_greenstein(g),
                n,
            };
            let twice = |kappa: f64| {
                let own = rte::Orders::new(&medium.phase, n, kappa);
                rte::Orders { degree: 2 * own.degree, cosines: 2 * own.cosines, tolerance: 1e-10, ..own }
            };
            let finer = rte::respond_with(&medium, None, 0.0, twice).unwrap().reflectance.camera;
            let (off, bound) = ((column("r_d")[i] - finer).abs(), bound.unwrap());
            assert!(
                off <= bound && bound < 1e-3 + 0.01 * column("r_d")[i],
                "g = {g}, n = {n}, {medium:?}: off by {off:e}, bound {bound:e}"
            );
            worst = worst.max(off);
        }
        println!(
            "g = {g}, n = {n}: worst {worst:.1e}, bounds up to {:.1e}",
            bounds.iter().flatten().fold(0.0, |a: f64, b| a.max(*b))
        );
    }
    let diffusion =
        json!({"model": "diffusion", "f_x": [0], "g": 0.8, "n": 1.4, "mu_a": [0.01, 0.1], "mu_s_prime": [1, 2]});
    assert!(table(&diffusion).maybe_f64s("r_d_bound").unwrap().iter().all(Option::is_none));
}

fn several(model: &str, g: Value, n: Value, wavelengths: Value) -> Value {
    let mut params = json!({
        "model": model, "f_x": [0, 0.1], "g": g, "n": n,
        "mu_a": {"logspace": [0.01, 0.1, 4]}, "mu_s_prime": {"logspace": [0.5, 2, 4]}
    });
    if !wavelengths.is_null() {
        params["wavelengths_nm"] = wavelengths;
    }
    if model == "monte_carlo" {
        params["samples"] = json!(2000);
    }
    params
}

/// One artifact holds a table for each pair of g and n that occurs, one after the other, each as it is by itself; wavelengths of the same pair share one. Of
/// one pair the rows are those of a table without wavelengths.
#[test]
fn each_pair_of_g_and_n_has_its_table() {
    let host = || MemoryHost { wanted: vec!["validity".into()], ..MemoryHost::default() };
    for model in ["rte", "diffusion"] {
        let (Lut(all), validity) =
            build(&several(model, json!([0.8, 0.7, 0.8]), json!([1.4, 1.4, 1.4]), json!([660, 730, 850])), &host());
        let names: Vec<&str> = all.columns.iter().map(|c| c.name.as_str()).collect();
        assert_eq!(names, ["g", "n", "mu_a", "mu_s_prime", "f_x", "r_d", "r_d_se", "r_d_bound"]);
        assert_eq!(
            (all.rows(), &all.attributes["g"], &all.attributes["n"]),
            (64, &json!([0.8, 0.7, 0.8]), &json!([1.4, 1.4, 1.4]))
        );
        assert_eq!(all.attributes["wavelengths_nm"], json!([660.0, 730.0, 850.0]));
        let Validity(stack) = validity.unwrap();
        assert_eq!(stack.layers.len(), 6);
        for (k, g) in [0.8, 0.7].into_iter().enumerate() {
            let (Lut(alone), one) = build(&several(model, json!(g), json!(1.4), Value::Null), &host());
            for column in ["mu_a", "mu_s_prime", "f_x", "r_d"] {
                let of = |table: &turbid_contract::Table| table.f64s(column).unwrap().to_vec();
                assert_eq!(of(&all)[32 * k..32 * (k + 1)], of(&alone), "{model} {column} {g}");
            }
            assert_eq!(
                all.maybe_f64s("r_d_bound").unwrap()[32 * k..32 * (k + 1)],
                alone.maybe_f64s("r_d_bound").unwrap()
            );
            assert_eq!(stack.layers[3 * k].data, one.unwrap().0.layers[0].data, "{model} {g}");
            assert_eq!(all.f64s("g").unwrap()[32 * k..32 * (k + 1)], [g; 32]);
        }
    }
    let plain = build(&several("diffusion", json!(0.8), json!(1.4), Value::Null), &host()).0.0.columns.clone();
    let same = build(&several("diffusion", json!([0.8, 0.8]), json!(1.4), json!([660, 850])), &host()).0.0;
    assert_eq!((same.columns.clone(), &same.attributes["g"]), (plain, &json!(0.8)));
}

/// Tables of one Monte Carlo artifact have paths of their own: the first is that of one pair alone, and errors of two with the same g and n nearly are independent.
#[test]
fn monte_carlo_tables_do_not_share_paths() {
    let build = |g: Value, wavelengths: Value| {
        build(&several("monte_carlo", g, json!(1.4), wavelengths), &MemoryHost::default()).0.0
    };
    let all = build(json!([0.8, 0.800_000_1]), json!([660, 850]));
    let alone = build(json!(0.8), Value::Null);
    let of = |table: &turbid_contract::Table| table.f64s("r_d").unwrap().to_vec();
    assert_eq!(of(&all)[..32], of(&alone));
    let se = all.maybe_f64s("r_d_se").unwrap();
    // The same paths would differ by some 1e-7.
    let apart = (0..32).map(|i| (of(&all)[i] - of(&all)[32 + i]).abs() / se[i].unwrap()).fold(0.0, f64::max);
    assert!((0.1..6.0).contains(&apart), "{apart}");
}

#[test]
fn lists_are_for_wavelengths() {
    for (g, n, wavelengths, words) in [
        (json!([0.8, 0.7]), json!(1.4), Value::Null, "g: g is a list, and for which wavelengths is not said"),
        (json!([0.8, 0.7]), json!(1.4), json!([660]), "g: 2 values of g for 1 wavelengths"),
        (json!([0.8, 0.7]), json!([1.4]), json!([660, 850]), "n: 1 values of n for 2 wavelengths"),
        (json!([0.8, 1.2]), json!(1.4), json!([660, 850]), "g.1: g = 1.2 must lie in (-1, 1)"),
        (json!(0.8), json!([1.4, 0.9]), json!([660, 850]), "n.1: n = 0.9 must be a finite number >= 1"),
        (json!([0.8, 0.7]), json!(1.4), json!([660, 660]), "wavelengths_nm.1: 660 nm stands twice"),
    ] {
        let found = problems(&several("diffusion", g, n, wavelengths));
        assert!(found.len() == 1 && found[0].starts_with(words), "{words}: {found:?}");
    }
}
