//! The tables of polars.

use std::fs;

use serde_json::Value;

use crate::space::{PIPELINE, Space};

/// Statistics agree with each other, costs and counts with the build.
#[test]
fn tables_agree_with_the_build() {
    let space = Space::with(&PIPELINE.replace("    shards:", "    keep: {maps.masked: {below: 100}}\n    shards:"));
    let built = space.build("set", &[]);
    let shown = space.turbid(&["dataset", "stats", "p.yaml", "--to", "set", "--json"]).ok();
    let shown: Value = serde_json::from_str(&shown).expect("it is JSON");
    let rows = |key: &str| shown[key].as_array().expect("a list").clone();
    let sum = |rows: &[Value], key: &str| rows.iter().filter_map(|row| row[key].as_f64()).sum::<f64>();
    assert_eq!(sum(&rows("counts"), "n"), 16.0, "every point is counted once");
    let cpu_s = built["cpu_s"].as_f64().expect("a number");
    assert!((sum(&rows("costs"), "cpu_s") - cpu_s).abs() < 1e-9 * cpu_s, "{shown}");
    let kept: Vec<Value> = rows("costs").into_iter().filter(|row| row["reject"] == "").collect();
    assert_eq!(sum(&kept, "samples"), built["samples"].as_f64().expect("a number"));

    // The drawn quantities once by Welford's sums over shards, once by polars over the index.
    let columns = rows("columns");
    let mut compared = 0;
    for row in rows("index") {
        let Some(other) = columns.iter().find(|c| {
            c["split"] == row["split"]
                && (c["column"] == row["column"]
                    || c["column"] == format!("draw.{}", row["column"].as_str().unwrap_or_default()))
                && c["q50"].is_number()
        }) else {
            continue;
        };
        compared += 1;
        for key in ["n", "mean", "sd", "min", "max", "q05", "q25", "q50", "q75", "q95"] {
            let (a, b) = (row[key].as_f64(), other[key].as_f64());
            let near = |a: f64, b: f64| (a - b).abs() <= 1e-12 * a.abs();
            assert!(a == b || a.zip(b).is_some_and(|(a, b)| near(a, b)), "{key}: {row} {other}");
        }
        let order: Vec<f64> =
            ["min", "q05", "q25", "q50", "q75", "q95", "max"].iter().filter_map(|k| row[*k].as_f64()).collect();
        assert!(order.len() == 7 && order.is_sorted(), "{row}");
    }
    // Splits that are there, by mu_a, contrast, patient, lesion_a and width.
    assert!(compared >= 10, "{compared}");
    assert!(
        rows("index").iter().any(|row| row["column"].as_str().is_some_and(|name| name.starts_with("frames."))),
        "measures too"
    );

    let card = fs::read_to_string(space.path("set/README.md")).expect("the build wrote it");
    assert!(card.contains("## Drawn quantities") && card.contains("| train | contrast |"), "{card}");
    let text = space.turbid(&["dataset", "stats", "p.yaml", "--to", "set"]).ok();
    for part in ["columns of the samples", "drawn quantities", "costs", "points", "test_far"] {
        assert!(text.contains(part), "{part}: {text}");
    }
}
