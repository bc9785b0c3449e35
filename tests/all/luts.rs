//! `pipelines/lut_compare.yaml`: three tables over the same phantoms, as a user runs it.

use crate::metrics::metrics;
use crate::space::Space;

const FILE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/pipelines/lut_compare.yaml");

/// The camera's table and that of phantoms give media back within 4.5 of their standard errors, those of the images and of what IAD says of the phantoms;
/// a table of hemispherical reflectance reads a camera's mu_a 20 to 45 % too high, whatever the noise.
#[test]
fn tables_that_know_the_camera_are_right() {
    let space = Space::new();
    let settings = [
        ["--set", "vars.A=[10, 50, 100]"],
        ["--set", "vars.samples=128"],
        ["--set", "vars.reference_samples=512"],
        ["--set", "vars.photons=20000"],
        ["--set", "vars.pixels=16"],
        ["--set", "stages.hemisphere.with.samples=200000"],
    ]
    .concat();
    let wanted = ["transport_metrics", "hemisphere_metrics", "held_out_metrics", "held_out_linear_metrics"];
    space.turbid(&[&["run", FILE], &wanted[..], &settings].concat()).ok();
    let of = |stage: &str, a: u32, s: u32| {
        let instance = format!("{stage}[A_rho={a},S_rho={s}]");
        let rows = metrics(&space, FILE, &instance, &settings).into_iter().filter(|row| row.region == "block");
        rows.collect::<Vec<_>>()
    };
    let (mut worst, mut held) = (0.0f64, Vec::new());
    for (a, s) in [50, 100].into_iter().flat_map(|a| [5000, 20000].map(|s| (a, s))) {
        for row in of("transport_metrics", a, s) {
            worst = worst.max((row.mean - row.truth).abs() / row.se);
        }
        let hemisphere = &of("hemisphere_metrics", a, s)[0];
        let off = hemisphere.mean / hemisphere.truth - 1.0;
        let se = hemisphere.se / hemisphere.truth;
        assert!(off > 0.19 - 4.5 * se && off < 0.45 + 4.5 * se, "({a}, {s}): mu_a {:+.1} %", 100.0 * off);
    }
    assert!(worst < 4.5, "{worst}");
    for (a, s) in [20, 75].into_iter().flat_map(|a| [8000, 16000].map(|s| (a, s))) {
        for (row, linear) in of("held_out_metrics", a, s).iter().zip(of("held_out_linear_metrics", a, s)) {
            held.push((row.mean - row.truth) / row.se);
            let off = linear.mean / linear.truth - 1.0;
            println!("({a}, {s}) {}: z {:.2}; linear {:+.1} %", row.quantity, held[held.len() - 1], 100.0 * off);
            // R is convex in mu_a: its chord lies above it.
            assert!(row.quantity != "mu_a" || off > 0.0, "({a}, {s}): {off}");
        }
    }
    assert!(held.iter().all(|z| z.abs() < 4.5), "{held:?}");
}
