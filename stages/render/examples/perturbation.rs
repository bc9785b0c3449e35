//! Whether media that differ in scattering may share paths: `cargo run --release -p turbid-render --example perturbation [photons]`.
//!
//! Photons are walked in a half-space of (mu_a, mu_s), g = 0.8, n = 1, until they leave it. For a medium of mu_s (1 + d) one that was scattered n times over
//! the length L weighs (1 + d)^n exp(-(d mu_s + mu_a) L) (Hayakawa et al., Opt. Lett. 26, 1335 (2001)), and exp(-mu_a L) for its own. What is said is how many
//! times the photons it takes for the same error of the reflectance, beside photons of that medium itself: sharing pays for k media where that is below k for each.

use turbid_optics::PhaseFunction;
use turbid_optics::philox::{philox4x32, unit};

use glam::DVec3;

fn main() {
    let photons: u32 = std::env::args().nth(1).map_or(200_000, |n| n.parse().expect("a number of photons"));
    let changes = [0.0, 0.01, 0.03, 0.1, 0.3, -0.03, -0.1];
    println!(
        "mu_a, mu_s; scatterings of what comes back; photons for the same error, times, at mu_s (1 + d), d = {changes:?}"
    );
    for (mu_a, mu_s) in [(0.1, 5.0), (0.025, 4.236), (0.001, 20.0)] {
        let returned = |mu_s: f64, key: u32| -> Vec<(f64, f64)> {
            (0..photons).filter_map(|photon| walk(mu_a, mu_s, photon, key)).collect()
        };
        let walked = returned(mu_s, 1);
        let scatterings = walked.iter().map(|(n, l)| n * libm::exp(-mu_a * l)).sum::<f64>()
            / walked.iter().map(|(_, l)| libm::exp(-mu_a * l)).sum::<f64>();
        let row: Vec<String> = changes
            .iter()
            .map(|d| {
                let shared = walked.iter().map(|(n, l)| libm::exp(n * libm::log1p(*d) - (d * mu_s + mu_a) * l));
                let own = returned(mu_s * (1.0 + d), 2);
                let [shared, own] =
                    [spread(shared, photons), spread(own.iter().map(|(_, l)| libm::exp(-mu_a * l)), photons)];
                format!("{:.2} (R {:.4}, {:.4})", shared.1 / own.1, shared.0, own.0)
            })
            .collect();
        println!("{mu_a}, {mu_s}; {scatterings:.0}; {}", row.join(", "));
    }
}

/// Scatterings and length (mm) of a photon that comes back; `None` of one that is lost in the deep, where less than 1e-6 of it would come back.
fn walk(mu_a: f64, mu_s: f64, photon: u32, key: u32) -> Option<(f64, f64)> {
    let phase = PhaseFunction::henyey_greenstein(0.8);
    let (mut z, mut w, mut length) = (0.0, DVec3::Z, 0.0);
    for n in 0_u32.. {
        let [a, b, c, _] = philox4x32([n, 0, photon, 0], [key, 0]);
        let s = -libm::log(unit(a)) / mu_s;
        if z + s * w.z < 0.0 {
            return Some((f64::from(n), length - z / w.z));
        }
        (z, length) = (z + s * w.z, length + s);
        if mu_a * length > 14.0 {
            return None;
        }
        w = phase.sample(w, unit(b), unit(c));
    }
    None
}

/// Mean over all photons, and the variance of one over its square.
fn spread(weights: impl Iterator<Item = f64>, photons: u32) -> (f64, f64) {
    let n = f64::from(photons);
    let [sum, squares] = weights.fold([0.0; 2], |[sum, squares], x| [sum + x, squares + x * x]);
    let mean = sum / n;
    (mean, (squares / n - mean * mean) / (mean * mean))
}
