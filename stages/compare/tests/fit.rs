//! A fit of media against its readings, or against what is printed of them.

use turbid_compare::{Compare, In, Params};
use turbid_contract::payload::{Estimate, Expected, Fit, Metrics, Readings};
use turbid_contract::{Cells, Ctx, Error, Known, MemoryHost, Problems, Stage, Table, serde_json};

fn names(names: &[&str]) -> Cells {
    Cells::Text(names.iter().map(|n| (*n).to_owned()).collect())
}

/// Three media; the fit of the third failed.
fn fit() -> Fit {
    let mut table = Table::default();
    table.push("medium", "", names(&["a", "b", "c"]));
    let columns = [
        ("mu_a", [0.011, 0.0, 0.0]),
        ("mu_a_se", [0.0005, 0.0004, 0.0]),
        ("mu_s_prime", [0.9, 2.2, 0.0]),
        ("mu_s_prime_se", [0.1, 0.1, 0.0]),
    ];
    for (name, values) in columns {
        table.push(name, "mm^-1", Cells::F64(values.to_vec()));
    }
    table.push("status", "", names(&["ok", "conservative, no_se", "too_much_light"]));
    Fit(table)
}

/// The same media in another order.
fn readings() -> Readings {
    let mut table = Table::default();
    table.push("medium", "", names(&["c", "b", "a"]));
    table.push("mu_a", "mm^-1", Cells::F64(vec![0.1, 0.0005, 0.01]));
    table.push("mu_s_prime", "mm^-1", Cells::F64(vec![1.0, 2.0, 1.0]));
    Readings(table)
}

fn compare(truth: Option<Readings>, params: &Params) -> Result<(Table, MemoryHost), Error> {
    let host = MemoryHost { wanted: vec!["errors".into()], ..MemoryHost::default() };
    let input =
        In { estimate: Estimate::Fit(fit()), truth: truth.map(Expected::Readings), source: std::marker::PhantomData };
    let out = Compare::run(params, input, Ctx::new(&host))?;
    let errors = out.errors.expect("the picture was wanted").0;
    let mask = errors.mask(None).expect("a mask").pixels();
    assert_eq!((errors.rows(), errors.columns()), (3, 1), "a pixel for each medium");
    assert_eq!(mask.iter().filter(|&&m| m > 0.0).count(), 1, "one medium has no fit");
    assert_eq!(errors.attributes["media"], serde_json::json!(["a", "b", "c"]));
    let Metrics(table) = out.metrics;
    Ok((table, host))
}

fn number(table: &Table, row: usize, name: &str) -> f64 {
    match table.columns.iter().find(|c| c.name == name).map(|c| &c.cells) {
        Some(Cells::MaybeF64(v)) => v[row].unwrap_or_else(|| panic!("{name} of row {row} is not known")),
        Some(Cells::I64(v)) => v[row] as f64,
        other => panic!("{name}: {other:?}"),
    }
}

fn params(json: &str) -> Params {
    serde_json::from_str(json).expect(json)
}

/// Rows are paired by name; a limit counts, a row without a fit is masked; the figures were worked out by hand.
#[test]
fn media_are_paired_by_name() {
    let (table, host) = compare(Some(readings()), &Params::default()).unwrap();
    let Cells::Text(regions) = &table.columns[0].cells else { panic!("{table:?}") };
    assert_eq!(regions, &["a", "a", "b", "b", "c", "c", "all", "all"]);
    let close = |row: usize, name: &str, expected: f64| {
        let found = number(&table, row, name);
        assert!((found - expected).abs() < 1e-9 * expected.abs().max(1.0), "row {row}, {name}: {found}, {expected}");
    };
    for (row, z, truth, bias_percent) in
        [(0, 2.0, 0.01, 10.0), (1, -1.0, 1.0, -10.0), (2, -1.25, 0.0005, -100.0), (3, 2.0, 2.0, 10.0)]
    {
        close(row, "z", z);
        close(row, "truth", truth);
        close(row, "bias_percent", bias_percent);
        close(row, "n", 1.0);
    }
    for row in [4, 5] {
        close(row, "masked_percent", 100.0);
        close(row, "n", 0.0);
        // A fit that failed says nothing: no error of 0 mm^-1, no standard error, no z.
        for name in ["mean", "mean_se", "truth", "bias", "rmse", "p95", "bias_percent", "rmse_percent", "z", "rms_log"]
        {
            assert_eq!(table.maybe_f64s(name).unwrap()[row], None, "row {row}, {name}");
        }
    }
    close(6, "z", ((4.0 + 1.5625) / 2.0_f64).sqrt());
    close(6, "bias", 0.5 * (0.011 - 0.0105));
    close(6, "rms_log", 1.1_f64.ln());
    close(7, "rms_log", ((0.9_f64.ln().powi(2) + 1.1_f64.ln().powi(2)) / 2.0).sqrt());
    close(7, "masked_percent", 100.0 / 3.0);
    assert!(host.warnings.lock().unwrap()[0].contains("1 values lie on the limit 0"));
    assert_eq!(host.measures.lock().unwrap()["unknown: media without a fit"], 1.0);
}

/// A medium that truly absorbs nothing has no error in percent: then the picture shows all of the quantity's errors in its unit, and no 0 for it.
#[test]
fn errors_from_a_truth_of_0_are_in_their_unit() {
    let host = MemoryHost { wanted: vec!["errors".into()], ..MemoryHost::default() };
    let all = r#"{"media": {"a": {"mu_a": 0, "mu_s_prime": 1}, "b": {"mu_a": 0.001, "mu_s_prime": 2}, "c": {"mu_a": 1, "mu_s_prime": 1}}}"#;
    let input = In { estimate: Estimate::Fit(fit()), truth: None, source: std::marker::PhantomData };
    let errors = Compare::run(&params(all), input, Ctx::new(&host)).unwrap().errors.expect("the picture was wanted").0;
    let of = |name: &str| errors.find(name, None).unwrap();
    assert_eq!((of("mu_a_error").info.unit.as_str(), of("mu_s_prime_error").info.unit.as_str()), ("mm^-1", "%"));
    assert_eq!(of("mu_a_error").data.iter().copied().collect::<Vec<_>>(), [0.011, -0.001, 0.0]);
}

/// What is printed of media stands in the params.
#[test]
fn media_may_be_named() {
    let all = r#"{"media": {"a": {"mu_a": 0.022, "mu_s_prime": 0.9}, "b": {"mu_a": 1, "mu_s_prime": 1}, "c": {"mu_a": 1, "mu_s_prime": 1}}}"#;
    let (table, _) = compare(None, &params(all)).unwrap();
    assert!((number(&table, 0, "bias_percent") + 50.0).abs() < 1e-9 && number(&table, 1, "bias") == 0.0);
}

#[test]
fn mistakes_are_named() {
    let failed = |truth, json: &str| compare(truth, &params(json)).map(|_| ()).unwrap_err().to_string();
    let only_a = r#"{"media": {"a": {"mu_a": 0.022, "mu_s_prime": 0.9}}}"#;
    assert!(failed(None, only_a).contains("nothing says what the medium `b` is; known are a"));
    let more = r#"{"media": {"d": {"mu_a": 0.022, "mu_s_prime": 0.9}}}"#;
    assert!(failed(None, more).contains("the fit has no medium `d`; it has a, b, c"));
    let mut measured = readings();
    measured.0.columns.truncate(1);
    assert!(failed(Some(measured), "{}").contains("the readings do not say mu_a of their media"));
    let mut twins = readings();
    twins.0.columns[0].cells = names(&["a", "b", "b"]);
    assert!(failed(Some(twins), "{}").contains("two media of the readings are called b"));

    let found = |json: &str, ports: &[(&str, &str)]| {
        let mut known = Known::default();
        known.connected.extend(ports.iter().map(|p| p.0.to_owned()));
        known.payloads.extend(ports.iter().map(|p| (p.0.to_owned(), p.1.to_owned())));
        let mut problems = Problems::default();
        Compare::check(&params(json), &known, &mut problems);
        problems.into_parts().0.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
    };
    assert_eq!(found("{}", &[("estimate", "fit"), ("truth", "readings")]), "");
    assert_eq!(found("{}", &[("estimate", "maps"), ("truth", "truth")]), "");
    assert_eq!(found(only_a, &[("estimate", "fit")]), "");
    assert!(found("{}", &[("estimate", "fit")]).contains("compare needs the input `truth`"));
    assert!(found(only_a, &[("estimate", "fit"), ("truth", "readings")]).contains("give one of them"));
    assert!(found("{}", &[("estimate", "maps"), ("truth", "readings")]).contains("maps need the port `truth`"));
    assert!(found("{}", &[("estimate", "fit"), ("truth", "truth")]).contains("a fit needs its readings"));
    assert!(found(only_a, &[("estimate", "maps")]).contains("`media` is the truth of a fit"));
    let regions = r#"{"regions": {"r": {"erode_px": 1}}}"#;
    assert!(found(regions, &[("estimate", "fit"), ("truth", "readings")]).contains("has no regions"));
    let negative = r#"{"media": {"a": {"mu_a": -1, "mu_s_prime": 0.9}}}"#;
    assert!(found(negative, &[("estimate", "fit")]).contains("media.a.mu_a: mu_a = -1 mm^-1 must be >= 0"));
}
