//! Error against time of the transport solver: `cargo bench -p turbid-optics`.

#[path = "../tests/truth/mod.rs"]
mod truth;

use std::time::Instant;

use truth::{Quantity, Truth};
use turbid_optics::{PhaseFunction, rte};

fn main() {
    if std::env::args().any(|a| a == "--orders") {
        return orders();
    }
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
    let (mut worst, mut slowest, mut total, mut beyond, mut bits) = (0.0f64, 0.0f64, 0.0, 0, 0u64);
    for truth in truths {
        let start = Instant::now();
        let response = rte::respond(&truth.medium, truth.thickness, truth.f_x);
        let ms = start.elapsed().as_secs_f64() * 1e3;
        total += ms;
        slowest = slowest.max(ms);
        let (ratio, within) = match response {
            Ok(response) => {
                let value = quantity(truth, &response);
                // FNV-1a: builds for other vector widths must print the same.
                bits = (bits ^ value.to_bits()).wrapping_mul(0x0100_0000_01b3);
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
        "{name}: {} values, worst error / bound {worst:.3}, {beyond} beyond; {:.2} ms per value, slowest {slowest:.2}; bits {bits:016x}",
        truths.len(),
        total / truths.len() as f64
    );
}

/// Worst absolute error and time per value over the degree of the scattering source, by anisotropy and index.
fn orders() {
    let all = [truth::half_spaces(), truth::extremes(), truth::adding_doubling()].concat();
    println!("    g    n degree  values  worst error  / own error    ms");
    for (g, n) in [(-0.9, 1.0), (0.8, 1.0), (0.8, 1.4), (0.9, 1.0), (0.9, 1.4), (0.99, 1.0), (0.99, 1.4), (-0.99, 1.0)]
    {
        let truths: Vec<&Truth> = all
            .iter()
            .filter(|t| {
                t.medium.phase == PhaseFunction::henyey_greenstein(g)
                    && t.medium.n == n
                    && t.error < 2e-5
                    && t.medium.mu_a > 0.0
            })
            .filter(|t| t.thickness.is_none_or(|tau| tau <= 16.0))
            .collect();
        let keep = truths.len().div_ceil(24);
        for degree in [8, 12, 18, 26, 36, 52, 80, 120, 180, 280] {
            let (mut worst, mut ratio, mut ms, mut count) = (0.0f64, 0.0f64, 0.0, 0);
            for truth in truths.iter().step_by(keep) {
                let start = Instant::now();
                let response = rte::respond_with(&truth.medium, truth.thickness, truth.f_x, |kappa| {
                    let orders = rte::Orders::new(&PhaseFunction::henyey_greenstein(g), n, kappa);
                    let modes = orders.modes.min(degree + 1);
                    rte::Orders { degree, cosines: 18 + 6 * degree / 5, modes, ..orders }
                });
                ms += start.elapsed().as_secs_f64() * 1e3;
                count += 1;
                let error = response.map_or(f64::INFINITY, |r| (quantity(truth, &r) - truth.value).abs());
                worst = worst.max(error);
                ratio = ratio.max(error / truth.error);
            }
            println!("{g:5.2} {n:4.2} {degree:6} {count:7} {worst:12.1e} {ratio:12.1e} {:6.2}", ms / f64::from(count));
        }
    }
}

fn quantity(truth: &Truth, response: &rte::Response) -> f64 {
    match truth.quantity {
        Quantity::HemisphericalIncident => response.reflectance.hemispherical_incident,
        Quantity::Camera => response.reflectance.camera,
        Quantity::Transmittance => response.transmittance,
    }
}
