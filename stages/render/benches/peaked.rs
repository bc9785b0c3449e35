//! How often two standard errors hold the truth under narrow lobes, and where errors are unknown:
//! `cargo bench -p turbid-render --bench peaked [-- g ..]`. About 90 CPU seconds up to g = 0.98, 30 s for an image at 0.995.

#[path = "../tests/render/peaked.rs"]
#[allow(dead_code, unused_imports, reason = "its tests are not run here")]
mod peaked;
#[path = "../tests/render/setup.rs"]
#[allow(dead_code, reason = "scenes and hosts that the tests share")]
mod setup;

fn main() {
    let asked: Vec<f64> = std::env::args().skip(1).filter_map(|g| g.parse().ok()).collect();
    let lobes = if asked.is_empty() { vec![0.8, 0.9, 0.95, 0.98, 0.995] } else { asked };
    println!("g, paths, images of 16 x 16: within 2 se of the others (%), unknown (%), relative error of the mean (%)");
    for g in lobes {
        for (samples, images) in [(64, 40), (256, 16), (1024, 8)] {
            // A path at g = 0.995 makes 12 times the flights of one at 0.98.
            let images = if g > 0.99 { images / 4 } else { images };
            let found = peaked::found(&peaked::half_space(g, 16), samples, images);
            println!(
                "{g}, {samples}, {images}: {:.1}, {:.1}, {:.1}",
                100.0 * found.within,
                100.0 * found.unknown,
                100.0 * found.mean_se / found.mean
            );
        }
    }
}
