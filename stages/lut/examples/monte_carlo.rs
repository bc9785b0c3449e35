//! The Monte Carlo table against the transport solver over the default nodes, in standard errors, with run times:
//! `cargo run --release -p turbid-lut --example monte_carlo [paths [seed]]`.

use std::time::Instant;

use fearless_simd::Level;
use turbid_lut::monte_carlo::{self, PARTS};
use turbid_lut::{Convention, Nodes, Recipe};

fn main() {
    let paths: u64 = std::env::args().nth(1).map_or(1_000_000, |n| n.parse().expect("a number of paths"));
    let seed: u32 = std::env::args().nth(2).map_or(1, |n| n.parse().expect("a seed"));
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    println!(
        "convention, n: s (solver), s ({paths} paths, {threads} threads); standard error median, worst; z mean, sd, worst"
    );
    for (convention, n) in
        [(Convention::Camera, 1.0), (Convention::Camera, 1.4), (Convention::HemisphericalEntered, 1.4)]
    {
        let recipe = Recipe {
            transport: true,
            f_x: vec![0.0, 0.1],
            mu_a: Nodes::logspace(1e-4, 0.5, 28).0,
            mu_s_prime: Nodes::logspace(0.1, 5.0, 18).0,
            g: 0.8,
            n,
            thickness: None,
            convention,
        };
        let began = Instant::now();
        let truth: Vec<f64> = (0..recipe.rows()).flat_map(|row| recipe.row(row).expect("a medium in range")).collect();
        let solver = began.elapsed().as_secs_f64();
        let began = Instant::now();
        let white = monte_carlo::white(&recipe);
        let each = paths / PARTS as u64;
        let parts: Vec<Vec<f64>> = std::thread::scope(|scope| {
            let white = &white;
            let work = move |thread: usize| {
                let parts = (thread..PARTS).step_by(threads).map(|part| {
                    let mut tally = white.tally(Level::new());
                    white.trace([seed, 0], part as u64 * each, each, &mut tally);
                    tally.mean(white)
                });
                parts.collect::<Vec<Vec<f64>>>()
            };
            let workers: Vec<_> = (0..threads).map(|thread| scope.spawn(move || work(thread))).collect();
            workers.into_iter().flat_map(|worker| worker.join().expect("no worker panics")).collect()
        });
        let found = monte_carlo::estimate(&recipe, &white, &parts).expect("enough paths");
        let seconds = began.elapsed().as_secs_f64();
        let z: Vec<f64> = (0..truth.len()).map(|i| (found.r_d[i] - truth[i]) / found.se[i]).collect();
        let count = z.len() as f64;
        let mean = z.iter().sum::<f64>() / count;
        let sd = (z.iter().map(|z| (z - mean).powi(2)).sum::<f64>() / count).sqrt();
        let worst = z.iter().fold(0.0, |worst: f64, z| worst.max(z.abs()));
        let mut errors: Vec<f64> = found.se.iter().zip(&found.r_d).map(|(se, r)| 100.0 * se / r).collect();
        errors.sort_by(f64::total_cmp);
        println!(
            "{convention:?}, {n}: {solver:.1}, {seconds:.1}; {:.3} %, {:.3} %; {mean:+.2}, {sd:.2}, {worst:.2}",
            errors[errors.len() / 2],
            errors[errors.len() - 1]
        );
    }
}
