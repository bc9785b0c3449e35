//! Interpolation error against build time over the number of nodes: `cargo bench -p turbid-lut`.

use std::time::Instant;

use turbid_lut::{Convention, Nodes, Recipe};

/// Off-grid points compared.
const POINTS: usize = 1000;

fn main() {
    println!("  g    n  f_x        nodes  s (1 core)  ms per value   worst %    mean %");
    for (g, n) in [(0.8, 1.4), (0.8, 1.0), (0.0, 1.4), (0.9, 1.33)] {
        for f_x in [0.0, 0.1, 0.3] {
            for (n_a, n_s) in [(16, 10), (24, 16), (32, 20), (48, 30)] {
                measure(g, n, f_x, n_a, n_s);
            }
        }
    }
}

fn measure(g: f64, n: f64, f_x: f64, n_a: usize, n_s: usize) {
    let recipe = Recipe {
        transport: true,
        f_x: vec![f_x],
        mu_a: Nodes::logspace(1e-4, 0.5, n_a).0,
        mu_s_prime: Nodes::logspace(0.1, 5.0, n_s).0,
        g,
        n,
        thickness: None,
        convention: Convention::Camera,
    };
    let start = Instant::now();
    let values: Vec<f64> = (0..recipe.rows()).flat_map(|row| recipe.row(row).expect("a medium in range")).collect();
    let seconds = start.elapsed().as_secs_f64();
    let grid = &recipe.grids(&values).expect("reflectances are positive")[0];
    let (mut worst, mut sum, mut at) = (0.0f64, 0.0, (0.0, 0.0));
    for i in 1..=POINTS {
        // Additive recurrence by the plastic number: even coverage without a generator.
        let t = |step: f64| (i as f64 * step).fract();
        let mu_a = 1e-4 * libm::pow(5e3, t(0.754_877_666_246_692_8));
        let mu_s_prime = 0.1 * libm::pow(50.0, t(0.569_840_290_998_053_3));
        let truth = recipe.value(mu_a, mu_s_prime, f_x).expect("a medium in range");
        let value = grid.value(mu_a, mu_s_prime).expect("a point inside");
        let error = (value / truth - 1.0).abs() * 100.0;
        sum += error;
        if error > worst {
            (worst, at) = (error, (mu_a, mu_s_prime));
        }
    }
    println!(
        "{g:3.1} {n:4.2} {f_x:4.1} {n_a:6} x {n_s:<4} {seconds:11.3} {:13.3} {worst:9.4} {:9.5}  at {:.1e} {:.2}",
        seconds * 1e3 / values.len() as f64,
        sum / POINTS as f64,
        at.0,
        at.1
    );
}
