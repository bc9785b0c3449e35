//! As many quadrature points as a row needs, the error that they leave, and readings beyond what is unknown.
#![cfg(feature = "stage")]

use std::sync::Arc;

use turbid_contract::{Cells, Ctx, MemoryHost, Stage, Table, serde_json};
use turbid_iad::{CalibrateIad, In, Incidence, Instrument, Model, Params, Slab, unscattered};

fn run(json: &str, csv: &str) -> Table {
    let mut host = MemoryHost::default();
    host.files.insert("file".to_owned(), Arc::from(csv.as_bytes()));
    let params: Params = serde_json::from_str(json).expect(json);
    let input = In { readings: None, source: std::marker::PhantomData };
    CalibrateIad::run(&params, input, Ctx::new(&host)).expect("runs").fit.0
}

fn column(table: &Table, name: &str) -> Vec<Option<f64>> {
    table.maybe_f64s(name).unwrap_or_else(|| panic!("no column {name}"))
}

fn cell(table: &Table, name: &str) -> f64 {
    column(table, name)[0].unwrap_or_else(|| panic!("{name} is unknown: {table:?}"))
}

fn texts<'a>(table: &'a Table, name: &str) -> &'a [String] {
    match table.columns.iter().find(|c| c.name == name).map(|c| &c.cells) {
        Some(Cells::Text(texts)) => texts,
        other => panic!("{name}: {other:?}"),
    }
}

/// Readings of the independent doubling code at n = 1.5, as exact readings: sixteen points are percents off; left to choose, the stage is within a
/// thousandth of what 64 points find or says what it leaves uncertain, and what it says holds: the difference to the 64 points is within twice it.
#[test]
fn points_follow_the_row() {
    let mut csv = "m_r,m_r_se,m_t,m_t_se,n,g\n".to_owned();
    let mut truth = Vec::new();
    for line in include_str!("reference/adding_doubling_forward.csv").lines().skip(1) {
        let c: Vec<f64> = line.split(',').map(|x| x.parse().expect("a number")).collect();
        let [albedo, tau, g, n, slide, r, t, ..] = c[..] else { panic!("{line}") };
        if n < 1.5 || slide != 1.0 || !(0.1..1.0).contains(&albedo) || !(0.05..100.0).contains(&tau) || t < 1e-4 {
            continue;
        }
        csv += &format!("{r},0,{t},0,{n},{g}\n");
        truth.push([(1.0 - albedo) * tau, albedo * tau * (1.0 - g)]);
    }
    let fits = ["16", "64"].map(|n| run(&format!(r#"{{"file": "a.csv", "thickness": 1, "N": {n}}}"#), &csv));
    let chosen = run(r#"{"file": "a.csv", "thickness": 1}"#, &csv);
    let [sixteen, sixty_four] = &fits;
    let mut worst = [[0.0_f64; 2]; 2];
    let mut told: f64 = 0.0;
    let mut used = std::collections::BTreeMap::new();
    for i in 0..truth.len() {
        let status = |t: &Table| texts(t, "status")[i].clone();
        if status(sixty_four) != "ok" {
            continue;
        }
        assert_eq!(status(&chosen), "ok", "{i}: {:?}", texts(&chosen, "message")[i]);
        *used.entry(column(&chosen, "N")[i].expect("a row with a fit") as u32).or_insert(0) += 1;
        for (k, name) in ["mu_a", "mu_s_prime"].into_iter().enumerate() {
            let of = |t: &Table, name: &str| column(t, name)[i];
            let fine = of(sixty_four, name).expect("a number");
            let own = of(&chosen, name).expect("a number");
            if status(sixteen) == "ok" {
                worst[0][k] = worst[0][k].max((of(sixteen, name).expect("a number") / fine - 1.0).abs());
            }
            worst[1][k] = worst[1][k].max((own / fine - 1.0).abs());
            let error = of(&chosen, &format!("{name}_model_error")).expect("known");
            let floor = 1e-7 * fine;
            told = told.max((own - fine).abs() / (error + floor));
            assert!((own - fine).abs() <= 2.0 * error + floor, "{i} {name}: {own} +- {error}, 64 points {fine}");
            let se = of(&chosen, &format!("{name}_se")).expect("readings are stated as exact");
            assert!(se >= error, "{i} {name}");
        }
    }
    println!(
        "{} rows; points {used:?}; worst at 16 {:?}, chosen {:?}; difference over stated {told:.2}",
        truth.len(),
        worst[0],
        worst[1]
    );
    assert!(worst[0][0] > 0.02, "sixteen points are no longer coarse here: {worst:?}");
    assert!(worst[1].iter().all(|w| *w < 2e-3), "{worst:?}");
}

/// Without standard errors in the readings those of the fit are unknown, not 0; stated in the params they are known.
#[test]
fn errors_that_nothing_tells_are_unknown() {
    let with = |more: &str| {
        run(&format!(r#"{{"file": "a.csv", "thickness": 1, "n": 1.4, "g": 0.8{more}}}"#), "m_r,m_t\n0.3,0.2\n")
    };
    let silent = with("");
    assert!(
        ["mu_a_se", "mu_s_prime_se", "mu_cov", "g_se"].iter().all(|c| column(&silent, c)[0].is_none()),
        "{silent:?}"
    );
    assert!(cell(&silent, "mu_a_model_error") > 0.0);
    let stated = with(r#", "m_r_se": 1e-3, "m_t_se": 1e-3"#);
    assert!(cell(&stated, "mu_a_se") > cell(&stated, "mu_a_model_error"), "{stated:?}");
    assert_eq!(cell(&stated, "mu_a"), cell(&silent, "mu_a"));
}

fn readings(mu_a: f64, mu_s_prime: f64, g: f64) -> ([f64; 2], f64) {
    let slab = Slab::bare(1.4, g, 1.0);
    let model = Model::<32>::new(&slab, &Instrument::NONE, Incidence::Normal).expect("a slab");
    let read = model.readings(mu_a, mu_s_prime, &Default::default()).expect("readings");
    (read, unscattered(&slab, 1.0, mu_a + mu_s_prime / (1.0 - g)).1)
}

/// With mu_a known both readings count: they agree and the medium comes back with residuals of nothing; or they do not, and the row says what each
/// alone would mean. One alone counts where `from` says so, and the other's residual stands beside it.
#[test]
fn a_known_coefficient_leaves_a_reading_over() {
    let ([m_r, m_t], _) = readings(0.1, 1.5, 0.8);
    let fit = |more: &str, m_t: f64, se: &str| {
        let json = format!(r#"{{"file": "a.csv", "thickness": 1, "n": 1.4, "g": 0.8, "N": 32{more}}}"#);
        run(&json, &format!("m_r,m_r_se,m_t,m_t_se\n{m_r},{se},{m_t},{se}\n"))
    };
    let agree = fit(r#", "mu_a": 0.1"#, m_t, "1e-3");
    assert_eq!(texts(&agree, "status"), ["ok"], "{agree:?}");
    assert!((cell(&agree, "mu_s_prime") - 1.5).abs() < 1e-6 && cell(&agree, "m_t_residual").abs() < 1e-8, "{agree:?}");
    // The error of two readings is smaller than that of either.
    let alone = ["m_r", "m_t"]
        .map(|from| cell(&fit(&format!(r#", "mu_a": 0.1, "from": "{from}""#), m_t, "1e-3"), "mu_s_prime_se"));
    let both = cell(&agree, "mu_s_prime_se");
    let together = 1.0 / (alone[0].powi(-2) + alone[1].powi(-2)).sqrt();
    assert!((both / together - 1.0).abs() < 1e-3, "{both} {alone:?}");

    let off = fit(r#", "mu_a": 0.1"#, 0.5 * m_t, "1e-3");
    assert_eq!(texts(&off, "status"), ["disagree"], "{off:?}");
    let message = &texts(&off, "message")[0];
    assert!(
        message.contains("M_R alone means mu_a = 0.10000, mu_s' = 1.500") && message.contains("M_T alone means"),
        "{message}"
    );
    assert!(cell(&off, "m_r_residual").abs() > 1e-3 && cell(&off, "m_t_residual").abs() > 1e-3);
    let from = fit(r#", "mu_a": 0.1, "from": "m_r""#, 0.5 * m_t, "1e-3");
    assert!(texts(&from, "status") == ["ok"] && (cell(&from, "m_t_residual") - 0.5 * m_t).abs() < 1e-6, "{from:?}");
}

/// With M_U a known mu_a is a constraint, too: mu_a stays what it is, g and mu_s' follow from all three readings.
#[test]
fn a_known_coefficient_beside_unscattered_light() {
    let ([m_r, m_t], m_u) = readings(0.1, 1.5, 0.7);
    let csv = |m_t: f64| format!("m_r,m_r_se,m_t,m_t_se,m_u,m_u_se\n{m_r},1e-3,{m_t},1e-3,{m_u},{}\n", 1e-3 * m_u);
    for (known, value) in [("mu_a", 0.1), ("mu_s_prime", 1.5), ("mu_s", 5.0), ("albedo", 5.0 / 5.1)] {
        let json = format!(r#"{{"file": "a.csv", "thickness": 1, "n": 1.4, "N": 32, "{known}": {value}}}"#);
        let fit = run(&json, &csv(m_t));
        let found = ["mu_a", "mu_s_prime", "g"].map(|name| cell(&fit, name));
        let off = [found[0] - 0.1, found[1] - 1.5, found[2] - 0.7];
        // Readings and model are both those of 32 points.
        assert!(texts(&fit, "status") == ["ok"] && off.iter().all(|x| x.abs() < 1e-6), "{known}: {fit:?}");
        let off = run(&json, &csv(0.6 * m_t));
        assert_eq!(texts(&off, "status"), ["disagree"], "{known}: {off:?}");
    }
}
