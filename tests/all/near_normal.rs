//! `pipelines/checks/near_normal.yaml` at a small size: the whole chain against the transport equation, and its standard
//! errors against the spread of independent renders.

use std::collections::BTreeMap;

use serde_json::Value;

use crate::space::Space;

const FILE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/pipelines/checks/near_normal.yaml");

/// The pipeline with some values set to others, in a store of its own.
struct Check {
    space: Space,
    sets: Vec<String>,
}

impl Check {
    fn with(sets: &[&str]) -> Self {
        Self { space: Space::new(), sets: sets.iter().map(|s| s.to_string()).collect() }
    }

    fn turbid(&self, arguments: &[&str]) -> crate::space::Done {
        let mut all = arguments.to_vec();
        self.sets.iter().for_each(|set| all.extend(["--set", set]));
        self.space.turbid(&all)
    }

    /// The instances of a stage as `show` lists them.
    fn instances(&self, stage: &str) -> Vec<Value> {
        self.turbid(&["show", FILE, stage, "--json"]).json()["instances"].as_array().expect("a list").clone()
    }

    /// An exported port as columns of text.
    fn csv(&self, port: &str) -> BTreeMap<String, Vec<String>> {
        self.turbid(&["export", FILE, port, "--to", "x.csv"]).ok();
        let text = std::fs::read_to_string(self.space.path().join("x.csv")).expect("it was just written");
        let mut lines = text.lines();
        let names: Vec<&str> = lines.next().expect("a head").split(',').collect();
        let mut columns: BTreeMap<String, Vec<String>> = names.iter().map(|n| (n.to_string(), vec![])).collect();
        for line in lines {
            for (name, cell) in names.iter().zip(line.split(',')) {
                columns.get_mut(*name).expect("a column of the head").push(cell.to_owned());
            }
        }
        columns
    }
}

fn numbers(column: &[String]) -> Vec<f64> {
    column.iter().map(|cell| cell.parse().unwrap_or_else(|e| panic!("{cell}: {e}"))).collect()
}

/// mu_a and mu_s' in mm^-1 of an instance: the axes hold densities in m^-1, g = 0.8.
fn medium(axes: &Value) -> [f64; 2] {
    // The second 20000 m^-1 on the axis is written in another unit.
    let s_rho = axes["S_rho"].as_f64().unwrap_or(20_000.0);
    [axes["A_rho"].as_f64().expect("a density") / 1000.0, s_rho / 1000.0 * 0.2]
}

/// Image means of calibrated reflectance of six media at three f_x in two independent renders, as z scores of the
/// camera column of the transport solver.
///
/// The three f_x of a render share its paths, so the 36 scores count as 12 at worst: their root mean square is within 1 +-
/// 3.3 / sqrt(2 x 12) and their mean within 3.3 / sqrt(12) (a chance of 1e-3), and none is above 4.5 (2e-4).
#[test]
fn calibrated_reflectance_is_that_of_the_transport_equation() {
    let check = Check::with(&[
        "vars.pixels=[10, 10]",
        "vars.samples=720",
        "vars.reference_samples=400",
        "vars.repeats=[0, 2]",
        "vars.models=[rte]",
        "vars.conventions=[camera]",
    ]);
    check.turbid(&["run", FILE, "reflectance", "nodes"]).ok();
    let nodes = check.csv("nodes.lut");
    let [mu_a, mu_s_prime, f_x, r_d] = ["mu_a", "mu_s_prime", "f_x", "r_d"].map(|name| numbers(&nodes[name]));
    let solver = |[a, s]: [f64; 2], f: f64| {
        let close = |x: f64, y: f64| (x - y).abs() <= 1e-9 * y.abs();
        let same = |i: &usize| close(mu_a[*i], a) && close(mu_s_prime[*i], s) && close(f_x[*i], f);
        r_d[(0..r_d.len()).find(same).unwrap_or_else(|| panic!("({a}, {s}) at {f} is no node"))]
    };
    let mut scores = Vec::new();
    for instance in check.instances("reflectance") {
        let medium = medium(&instance["axes"]);
        let layers = instance["ports"]["reflectance"]["layers"].as_array().expect("layers").clone();
        for layer in layers.iter().filter(|l| l["name"] == "r_d") {
            let number = |name: &str| layer[name].as_f64().unwrap_or_else(|| panic!("{name}: {layer}"));
            assert_eq!(number("pixels"), 100.0, "a masked pixel would choose: {layer}");
            let z = (number("mean") - solver(medium, number("f_x_per_mm"))) / number("mean_se");
            assert!(z.abs() < 4.5, "{medium:?} at f_x {}: z = {z:.1}", layer["f_x_per_mm"]);
            // Errors so large that anything passes are no agreement.
            assert!(number("mean_se") < 0.04 * number("mean"), "{layer}");
            scores.push(z);
        }
    }
    assert_eq!(scores.len(), 36);
    let mean = scores.iter().sum::<f64>() / 36.0;
    let root_mean_square = (scores.iter().map(|z| z * z).sum::<f64>() / 36.0).sqrt();
    assert!(mean.abs() < 3.3 / 12.0_f64.sqrt(), "mean {mean:.2}");
    assert!((root_mean_square - 1.0).abs() < 3.3 / 24.0_f64.sqrt(), "root mean square {root_mean_square:.2}");
}

/// Standard errors of mu_a and mu_s' against the spread of ten independent renders of sample and reference, pooled over 144
/// pixels. A variance with 9 x 144 degrees of freedom is off by 4 %, its root by 2 % (some more where pixels share the smoothed
/// reference); the means are within 1 % of the truth or 3 of their standard errors.
#[test]
fn standard_errors_are_the_spread_of_independent_renders() {
    let check = Check::with(&[
        "vars.pixels=[12, 12]",
        "vars.samples=640",
        "vars.reference_samples=256",
        "vars.repeats=[0, 10]",
        "vars.f_x=[0, 0.1]",
        "vars.A_rhos=[96]",
        "vars.S_rhos=[3721]",
        "vars.models=[rte]",
        "vars.conventions=[camera]",
        // Pixels of their own, so that there are 144 of them.
        "stages.frames.with.method=path",
        "stages.table.with.mu_a={logspace: [0.01, 0.4, 16]}",
        "stages.table.with.mu_s_prime={logspace: [0.2, 3, 14]}",
    ]);
    check.turbid(&["run", FILE, "maps"]).ok();
    let instances = check.instances("maps");
    assert_eq!(instances.len(), 10);
    for (name, truth) in [("mu_a", 0.096), ("mu_s_prime", 0.7442)] {
        let (mut stated, mut means) = (0.0, Vec::new());
        let mut pixels = vec![Vec::new(); 144];
        for repeat in 0..10 {
            let port = format!("maps[A_rho=96,S_rho=3721,repeat={repeat},model=rte,convention=camera].maps");
            let maps = check.csv(&port);
            let layer = |wanted: &str| -> Vec<f64> {
                let rows = maps["name"].iter().zip(&maps["value"]).filter(|(name, _)| *name == wanted);
                numbers(&rows.map(|(_, value)| value.clone()).collect::<Vec<_>>())
            };
            assert!(layer("mask").iter().all(|&m| m == 0.0), "a masked pixel would choose");
            let (mu, se) = (layer(name), layer(&format!("{name}_se")));
            stated += se.iter().map(|se| se * se).sum::<f64>() / 1440.0;
            means.push(mu.iter().sum::<f64>() / 144.0);
            pixels.iter_mut().zip(mu).for_each(|(all, mu)| all.push(mu));
        }
        let variance = |values: &[f64]| {
            let mean = values.iter().sum::<f64>() / values.len() as f64;
            values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / (values.len() - 1) as f64
        };
        let spread = pixels.iter().map(|values| variance(values)).sum::<f64>() / 144.0;
        let ratio = (stated / spread).sqrt();
        assert!((ratio - 1.0).abs() < 0.1, "{name}: standard error / spread = {ratio:.3}");
        let off = means.iter().sum::<f64>() / 10.0 - truth;
        let limit = (3.0 * (variance(&means) / 10.0).sqrt()).max(0.01 * truth);
        assert!(off.abs() < limit, "{name}: {off:+.5} of {truth}, limit {limit:.5}");
    }
}
