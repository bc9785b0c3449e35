//! `pipelines/checks/low_samples.yaml`: means over regions at few paths per pixel, and what is told of pixels that are out.

use crate::metrics::{number, rows};
use crate::space::Space;

const FILE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/pipelines/checks/low_samples.yaml");

/// Eight renders of 24 x 24 pixels with 72 paths, 26 % of noise in M_AC and 60 to 70 % in mu_a: the mean of all of them is the truth to 3 standard errors (a chance of
/// 0.3 % for each quantity), where it was 5.2 standard errors too high as long as each pixel was inverted by itself and those that the table did not hold were dropped. Nearly no pixel is out, and those that
/// the table does not hold by themselves are counted.
#[test]
fn means_are_right_at_few_paths() {
    let space = Space::new();
    space.turbid(&["run", FILE]).ok();
    let summary = rows(&space, FILE, "summary.metrics", &[]);
    let all: Vec<_> = summary.iter().filter(|row| row["region"] == "all").collect();
    assert_eq!(all.len(), 2);
    for row in all {
        let (bias, se) = (number(row, "bias_percent"), number(row, "mean_abs_error_se_percent"));
        println!("{}: bias {bias:+.2} ({se:.2}) %, masked {:.2} %", row["quantity"], number(row, "masked_percent"));
        assert!(bias.abs() < 3.0 * se, "{row:?}");
        assert!(se < 2.0 && number(row, "masked_percent") < 2.0, "{row:?}");
    }
    let shown = space.turbid(&["show", FILE, "maps", "--json"]).json();
    let measures = |name: &str| -> f64 {
        let instances = shown["instances"].as_array().expect("instances");
        instances.iter().filter_map(|i| i["measures"][name]["value"].as_f64()).sum::<f64>() / instances.len() as f64
    };
    assert!(measures("read_along_tangent") > 90.0 && measures("kept_outside_table") > 0.2, "{shown}");
}
