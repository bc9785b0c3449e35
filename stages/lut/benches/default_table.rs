//! The default table for two f_x: CPU seconds to make it, its error between the nodes, and Monte Carlo against the solver in standard errors:
//! `cargo bench -p turbid-lut --bench default_table [-- PATHS SEEDS]`.

use fearless_simd::Level;
use turbid_lut::monte_carlo::{self, PARTS};
use turbid_lut::{Convention, Nodes, Recipe};

/// Off-grid points compared.
const POINTS: usize = 10_000;

fn recipe(convention: Convention, n: f64) -> Recipe {
    Recipe {
        transport: true,
        f_x: vec![0.0, 0.1],
        mu_a: Nodes::logspace(1e-4, 0.5, 28).0,
        mu_s_prime: Nodes::logspace(0.1, 5.0, 18).0,
        g: 0.8,
        n,
        thickness: None,
        convention,
    }
}

/// CPU seconds of this thread where the system tells, else wall seconds: the machine may be busy.
fn seconds<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let on_cpu = || std::fs::read_to_string("/proc/thread-self/schedstat").ok()?.split(' ').next()?.parse::<f64>().ok();
    let (start, before) = (std::time::Instant::now(), on_cpu());
    let done = work();
    let spent = match (before, on_cpu()) {
        (Some(before), Some(after)) => (after - before) * 1e-9,
        _ => start.elapsed().as_secs_f64(),
    };
    (done, spent)
}

/// Mean, standard deviation and largest magnitude.
fn summary(z: &[f64]) -> String {
    let count = z.len() as f64;
    let mean = z.iter().sum::<f64>() / count;
    let sd = (z.iter().map(|z| (z - mean) * (z - mean)).sum::<f64>() / count).sqrt();
    format!("mean {mean:+.2}, sd {sd:.2}, worst {:.2}", z.iter().fold(0.0, |worst: f64, z| worst.max(z.abs())))
}

fn main() {
    let mut numbers = std::env::args().filter_map(|argument| argument.parse::<u64>().ok());
    let (paths, seeds) = (numbers.next().unwrap_or(400_000), numbers.next().unwrap_or(8));
    for (convention, n) in
        [(Convention::Camera, 1.0), (Convention::Camera, 1.4), (Convention::HemisphericalEntered, 1.4)]
    {
        let recipe = recipe(convention, n);
        let solve = || (0..recipe.rows()).flat_map(|row| recipe.row(row).expect("a medium in range")).collect();
        let (truth, spent): (Vec<f64>, f64) = seconds(solve);
        println!("{convention:?}, n = {n}: {} values by the solver in {spent:.2} CPU s", truth.len());
        if convention == Convention::Camera {
            between(&recipe, &truth);
        }
        against(&recipe, &truth, paths, seeds);
    }
}

/// Error of the interpolated table at points off its nodes.
fn between(recipe: &Recipe, values: &[f64]) {
    let grids = recipe.grids(values).expect("reflectances are positive");
    for (grid, &f_x) in grids.iter().zip(&recipe.f_x) {
        let mut errors: Vec<f64> = (1..=POINTS)
            .map(|i| {
                // Additive recurrence by the plastic number: even coverage without a generator.
                let t = |step: f64| (i as f64 * step).fract();
                let mu_a = 1e-4 * libm::pow(5e3, t(0.754_877_666_246_692_8));
                let mu_s_prime = 0.1 * libm::pow(50.0, t(0.569_840_290_998_053_3));
                let truth = recipe.value(mu_a, mu_s_prime, f_x).expect("a medium in range");
                100.0 * (grid.value(mu_a, mu_s_prime).expect("inside the table") / truth - 1.0).abs()
            })
            .collect();
        errors.sort_by(f64::total_cmp);
        let (median, worst) = (errors[POINTS / 2], errors[POINTS - 1]);
        println!("  f_x = {f_x}: between the nodes, {POINTS} points: median {median:.5} %, worst {worst:.4} %");
    }
}

/// Nodes of one run share its paths, so that their z scores are few; those of several seeds are pooled.
fn against(recipe: &Recipe, truth: &[f64], paths: u64, seeds: u64) {
    let white = monte_carlo::white(recipe);
    let each = paths / PARTS as u64;
    let (mut pooled, mut errors, mut spent) = (Vec::new(), Vec::new(), 0.0);
    for seed in 1..=seeds {
        let (found, spent_here) = seconds(|| {
            let parts: Vec<Vec<f64>> = (0..PARTS as u64)
                .map(|part| {
                    let mut tally = white.tally(Level::new());
                    white.trace([seed as u32, 0], part * each, each, &mut tally);
                    tally.mean(&white)
                })
                .collect();
            monte_carlo::estimate(recipe, &white, &parts).expect("enough paths")
        });
        spent += spent_here;
        let z: Vec<f64> = (0..truth.len()).map(|i| (found.r_d[i] - truth[i]) / found.se[i]).collect();
        println!("  seed {seed}: z of {} nodes: {}", z.len(), summary(&z));
        pooled.extend(z);
        errors.extend(found.se.iter().zip(&found.r_d).map(|(se, r)| 100.0 * se / r));
    }
    errors.sort_by(f64::total_cmp);
    println!("  all seeds: {}", summary(&pooled));
    let (median, worst) = (errors[errors.len() / 2], errors[errors.len() - 1]);
    let per_path = spent / (seeds * each * PARTS as u64) as f64;
    println!(
        "  standard errors at {paths} paths: median {median:.3} %, worst {worst:.3} %; {:.1} us a path: 0.1 % at the median \
         node costs {:.0} CPU s",
        1e6 * per_path,
        per_path * paths as f64 * (median / 0.1) * (median / 0.1)
    );
}
