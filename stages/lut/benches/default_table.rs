//! The default table for two f_x: CPU seconds to make it, its error between the nodes, and Monte Carlo against the solver in standard errors:
//! `cargo bench -p turbid-lut --bench default_table [-- PATHS SEEDS [TABLE]]`; of one table (1 to 3) only the last.
//!
//! The nodes of a run share its paths, so that its z scores count as few: how many, the correlation of the parts' deviations tells, and with it how far the
//! deviation of all scores may lie from 1 by chance.

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
    let only = numbers.next();
    let tables = [(Convention::Camera, 1.0), (Convention::Camera, 1.4), (Convention::HemisphericalEntered, 1.4)];
    for (_, (convention, n)) in (1_u64..).zip(tables).filter(|(number, _)| only.is_none_or(|only| only == *number)) {
        let recipe = recipe(convention, n);
        let solve = || (0..recipe.rows()).flat_map(|row| recipe.row(row).expect("a medium in range")).collect();
        let (truth, spent): (Vec<f64>, f64) = seconds(solve);
        println!("{convention:?}, n = {n}: {} values by the solver in {spent:.2} CPU s", truth.len());
        if convention == Convention::Camera && only.is_none() {
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

/// As how many independent ones the deviations of a run's nodes count: N^2 / tr(C^2), C their correlation matrix. The products of two different parts estimate
/// tr(C^2) without bias: with unit variances (sum_i x_pi x_qi)^2 has that mean.
fn independent(deviations: &[Vec<f64>]) -> f64 {
    let (parts, nodes) = (deviations.len(), deviations[0].len());
    let sd: Vec<f64> = (0..nodes)
        .map(|i| (deviations.iter().map(|part| part[i] * part[i]).sum::<f64>() / (parts - 1) as f64).sqrt())
        .collect();
    let product = |p: &[f64], q: &[f64]| (0..nodes).map(|i| p[i] * q[i] / (sd[i] * sd[i])).sum::<f64>() / nodes as f64;
    let pairs = (0..parts).flat_map(|p| (0..p).map(move |q| (p, q)));
    let squares: f64 = pairs.map(|(p, q)| product(&deviations[p], &deviations[q])).map(|x| x * x).sum();
    (parts * (parts - 1)) as f64 / 2.0 / squares
}

fn against(recipe: &Recipe, truth: &[f64], paths: u64, seeds: u64) {
    let white = monte_carlo::white(recipe);
    let each = paths / PARTS as u64;
    let (mut pooled, mut errors, mut spent, mut count) = (Vec::new(), Vec::new(), 0.0, 0.0);
    for seed in 1..=seeds {
        let (parts, spent_here) = seconds(|| {
            let part = |part| {
                let mut tally = white.tally(Level::new());
                white.trace([seed as u32, 0], part * each, each, &mut tally);
                tally.mean(&white)
            };
            (0..PARTS as u64).map(part).collect::<Vec<Vec<f64>>>()
        });
        spent += spent_here;
        let found = monte_carlo::estimate(recipe, &white, &parts).expect("enough paths");
        let (_, deviations) = monte_carlo::deviations(recipe, &white, &parts).expect("enough paths");
        count += independent(&deviations);
        pooled.extend((0..truth.len()).map(|i| (found.r_d[i] - truth[i]) / found.se[i]));
        errors.extend(found.se.iter().zip(&found.r_d).map(|(se, r)| 100.0 * se / r));
    }
    errors.sort_by(f64::total_cmp);
    // Root of a mean of squares that counts as `count` scores: off from 1 by 1 / sqrt(2 count); a mean by 1 / sqrt(count).
    let root = (pooled.iter().map(|z| z * z).sum::<f64>() / pooled.len() as f64).sqrt();
    println!(
        "  {seeds} seeds of {paths} paths, {} z scores that count as {count:.0}: {}; root mean square {root:.2}, expected 1 +- {:.2}, mean 0 +- {:.2}",
        pooled.len(),
        summary(&pooled),
        1.0 / (2.0 * count).sqrt(),
        1.0 / count.sqrt()
    );
    let (median, worst) = (errors[errors.len() / 2], errors[errors.len() - 1]);
    let per_path = spent / (seeds * each * PARTS as u64) as f64;
    println!(
        "  standard errors at {paths} paths: median {median:.3} %, worst {worst:.3} %; {:.1} us a path: 0.1 % at the median \
         node costs {:.0} CPU s",
        1e6 * per_path,
        per_path * paths as f64 * (median / 0.1) * (median / 0.1)
    );
}
