//! Error against time of the transport solver: `cargo bench -p turbid-optics`.

#[path = "../tests/truth/mod.rs"]
mod truth;

use std::time::Instant;

use truth::{Quantity, Truth};
use turbid_optics::rte;

fn main() {
    let verbose = std::env::args().any(|a| a == "--rows");
    let only: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with("--")).collect();
    for (name, truths) in [
        ("rte_halfspace", truth::half_spaces()),
        ("slab_extreme", truth::extremes()),
        ("adding_doubling", truth::adding_doubling()),
        ("chandrasekhar", truth::chandrasekhar()),
    ] {
        if !only.is_empty() && !only.iter().any(|o| name.contains(o.as_str())) {
            continue;
        }
        measure(name, &truths, verbose);
    }
}

fn measure(name: &str, truths: &[Truth], verbose: bool) {
    let (mut worst, mut slowest, mut total, mut beyond) = (0.0f64, 0.0f64, 0.0, 0);
    for truth in truths {
        let start = Instant::now();
        let response = rte::respond(&truth.medium, truth.thickness, truth.f_x);
        let ms = start.elapsed().as_secs_f64() * 1e3;
        total += ms;
        slowest = slowest.max(ms);
        let (ratio, within) = match response {
            Ok(response) => {
                let value = match truth.quantity {
                    Quantity::HemisphericalIncident => response.reflectance.hemispherical_incident,
                    Quantity::Camera => response.reflectance.camera,
                    Quantity::Transmittance => response.transmittance,
                };
                let ratio = (value - truth.value).abs() / truth.bound();
                let within = ratio <= 1.0;
                if verbose || !within {
                    println!("{ratio:8.3} {ms:7.2} ms  {value:.8} {truth:?}");
                }
                (ratio, within)
            }
            Err(error) => {
                println!("{error}: {truth:?}");
                (f64::INFINITY, false)
            }
        };
        beyond += usize::from(!within);
        worst = worst.max(ratio);
    }
    println!(
        "{name}: {} values, worst error / bound {worst:.3}, {beyond} beyond; {:.2} ms per value, slowest {slowest:.2}",
        truths.len(),
        total / truths.len() as f64
    );
}
