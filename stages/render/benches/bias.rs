//! The bias of the line estimator, in lanes, against point next-event estimation, scene by scene and over all of them:
//! `cargo bench -p turbid-render --bench bias [-- paths per pixel, 50000] [part of a scene's name]`; about an hour of CPU time by default.
//!
//! Both are means of independent paths over the same image. With so many 4 pooled standard errors are below 0.3 %, the bound on the bias: a larger bias ends the
//! program with an error, and so does one of more than 4 standard errors, and stated errors that are not those by which images and pixels scatter.

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
const MOST: f64 = 3e-3;
/// How far the scatter of z of pixels may be from 1; that of images by 4 of its standard errors.
const MOST_OF_SCATTER: f64 = 0.1;

fn main() {
    // Cargo adds an argument of its own.
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with("--")).collect();
    let paths = arguments.iter().find_map(|n| n.parse().ok()).unwrap_or(50_000);
    let part = arguments.iter().find(|a| a.parse::<u32>().is_err()).map_or("", |part| part);
    // Whole rounds of `difference`.
    let paths = (paths / 100_u32).max(1) * 100;
    let mut pool = Pool::default();
    let (mut of_images, mut of_pixels) = (Vec::new(), Vec::new());
    println!("bias, its error, error of the line estimator alone (%); rms of z of pixels");
    let all = [
        odd_worlds::scenes(),
        odd_worlds::shaped_scenes(),
        odd_worlds::curved_scenes(),
        odd_worlds::bent_scenes(),
        odd_worlds::mesh_scenes(),
        odd_worlds::bent_mesh_scenes(),
        odd_worlds::hollow_scenes(),
    ];
    for (name, world) in all.into_iter().flatten().filter(|(name, _)| name.contains(part)) {
        // In series of their own: what is pooled is independent.
        for (series, lit, steady) in [(0, "projector", Steady::NONE), (1, "and lamps", lamps())] {
            let found = difference(&steady, name, &world, paths, series);
            let Difference { bias, error, precision, ref scores } = found;
            of_images.push(bias / error);
            of_pixels.extend(scores);
            let [bias, error, precision] = [bias, error, precision].map(|x| 100.0 * x);
            println!("{bias:+.3} {error:.3} {precision:.3} {:.2} {name}, {lit}", rms(scores));
            pool.add(&found);
        }
    }
    let (bias, error) = pool.bias();
    println!("{:+.4} {:.4} all", 100.0 * bias, 100.0 * error);
    let scatter = [&of_images, &of_pixels].map(|z| rms(z));
    println!(
        "rms of z: {:.3} of {} images, {:.3} of {} responses of pixels",
        scatter[0],
        of_images.len(),
        scatter[1],
        of_pixels.len()
    );
    let within = bias.abs() < 4.0 * error && bias.abs() + 4.0 * error < MOST;
    if !within {
        println!("not shown to be within {} %", 100.0 * MOST);
    }
    let most = [4.0 / (2.0 * of_images.len() as f64).sqrt(), MOST_OF_SCATTER];
    let states_its_errors = scatter.iter().zip(most).all(|(z, most)| (z - 1.0).abs() < most);
    if !states_its_errors {
        println!("z does not scatter by 1 to {:.2} and {:.2}", most[0], most[1]);
    }
    if !(within && states_its_errors) {
        std::process::exit(1);
    }
}

/// Root mean square.
fn rms(z: &[f64]) -> f64 {
    (z.iter().map(|z| z * z).sum::<f64>() / z.len() as f64).sqrt()
}
