//! The bias of the line estimator, in lanes, against point next-event estimation, scene by scene and over all of them:
//! `cargo bench -p turbid-render --bench bias [-- paths per pixel, 50000]`; about an hour of CPU time by default.
//!
//! Both are means of independent paths over the same image. With so many the pooled error is below a sixth of 0.5 %, the bound on the bias: a larger bias ends the
//! program with an error, and so does one of more than 4 standard errors.

#[path = "../tests/render/odd_worlds.rs"]
#[allow(dead_code, reason = "not all of it is needed here")]
mod odd_worlds;
#[path = "../../optics/tests/shapes/mod.rs"]
#[allow(dead_code, reason = "not all of it is needed here")]
mod shapes;
#[path = "../tests/render/unbiased.rs"]
#[allow(dead_code, reason = "not all of it is needed here")]
mod unbiased;

use odd_worlds::lamps;
use turbid_render::lamp::Steady;
use unbiased::{Difference, Pool, difference};

/// Relative.
const MOST: f64 = 5e-3;

fn main() {
    // Cargo adds an argument of its own.
    let paths = std::env::args().skip(1).find_map(|n| n.parse().ok()).unwrap_or(50_000);
    // Whole rounds of `difference`.
    let paths = (paths / 100_u32).max(1) * 100;
    let mut pool = Pool::default();
    println!("bias, its error, error of the line estimator alone (%); rms of z of pixels");
    let all = [
        odd_worlds::scenes(),
        odd_worlds::shaped_scenes(),
        odd_worlds::curved_scenes(),
        odd_worlds::bent_scenes(),
        odd_worlds::mesh_scenes(),
        odd_worlds::hollow_scenes(),
    ];
    for (name, world) in all.into_iter().flatten() {
        for (lit, steady) in [("projector", Steady::NONE), ("and lamps", lamps())] {
            let found = difference(&steady, name, &world, paths);
            let Difference { bias, error, precision, ref scores } = found;
            let rms = (scores.iter().map(|z| z * z).sum::<f64>() / scores.len() as f64).sqrt();
            let [bias, error, precision] = [bias, error, precision].map(|x| 100.0 * x);
            println!("{bias:+.3} {error:.3} {precision:.3} {rms:.2} {name}, {lit}");
            pool.add(&found);
        }
    }
    let (bias, error) = pool.bias();
    println!("{:+.4} {:.4} all", 100.0 * bias, 100.0 * error);
    let within = bias.abs() < 4.0 * error && bias.abs() + 4.0 * error < MOST;
    if !within {
        println!("not shown to be within {} %", 100.0 * MOST);
        std::process::exit(1);
    }
}
