//! Error against time over N, forward and inverse: `cargo bench -p turbid-iad`.

#[path = "../tests/truth/mod.rs"]
mod truth;

use std::hint::black_box;
use std::time::Instant;

use truth::{rows, slab};
use turbid_iad::{Inverse, Plan, Reading, Slab};

fn main() {
    println!("forward: us per call (albedo .9-.95, tau 5, g .8, n 1.4; beam and diffuse), worst error by class");
    println!("  N      us   n=1 g<=.9    n=1 rest   n>1 g<=.9    n>1 rest");
    forward::<4>();
    forward::<8>();
    forward::<16>();
    forward::<32>();
    forward::<48>();
    forward::<64>();
    println!(
        "inverse: solves/s over a grid of tissue (n 1.4, g .8), failures, median and most steps; worst error of the table"
    );
    inverse::<8>();
    inverse::<16>();
    inverse::<32>();
    inverse::<64>();
}

/// Least seconds per call of `work`, which makes `calls`.
fn seconds(calls: usize, mut work: impl FnMut()) -> f64 {
    let mut least = f64::INFINITY;
    for _ in 0..15 {
        let start = Instant::now();
        work();
        least = least.min(start.elapsed().as_secs_f64() / calls as f64);
    }
    least
}

fn forward<const N: usize>() {
    let mut worst = [0f64; 4];
    for row in rows(truth::FORWARD) {
        let plan = Plan::<N>::new(&slab(row[3], row[2], row[4])).expect("a slab");
        let r = plan.forward_optical(row[0], row[1]).expect("within range");
        let class = &mut worst[2 * usize::from(row[3] > 1.0) + usize::from(row[2] > 0.9 || row[2] < 0.0)];
        for (value, truth) in [r.ur1, r.ut1, r.uru, r.utu].iter().zip(&row[5..]) {
            *class = class.max((value - truth).abs());
        }
    }
    let plan = Plan::<N>::new(&Slab::bare(1.4, 0.8, 1.0)).expect("a slab");
    let time = seconds(50, || {
        for i in 0..50 {
            let _ = black_box(plan.forward_optical(black_box(0.9 + 0.001 * f64::from(i)), 5.0));
        }
    });
    let [a, b, c, d] = worst;
    println!("{N:3} {:7.1} {a:11.1e} {b:11.1e} {c:11.1e} {d:11.1e}", time * 1e6);
}

fn inverse<const N: usize>() {
    let inverse = Inverse::<N>::new(&Slab::bare(1.4, 0.8, 1.0)).expect("a slab");
    let mut readings = Vec::new();
    for mu_a in [0.001, 0.01, 0.03, 0.1, 0.3, 1.0] {
        for mu_s_prime in [0.5, 1.0, 2.0, 5.0] {
            let r = inverse.plan().forward(mu_a, mu_s_prime).expect("within range");
            readings.push(Reading { m_r: r.ur1, m_t: r.ut1, sigma: 0.0 });
        }
    }
    let mut steps: Vec<usize> = readings.iter().filter_map(|r| inverse.invert(r).ok()).map(|f| f.iterations).collect();
    steps.sort_unstable();
    let time = seconds(readings.len(), || {
        for reading in &readings {
            let _ = black_box(inverse.invert(black_box(reading)));
        }
    });
    let mut tissue = [0f64; 2];
    let (mut wide, mut failures) = ([0f64; 2], readings.len() - steps.len());
    for row in rows(truth::INVERSE) {
        let reading = Reading { m_r: row[5], m_t: row[6], sigma: 0.0 };
        let Ok(fit) = Inverse::<N>::new(&slab(row[3], row[2], row[4])).and_then(|inverse| inverse.invert(&reading))
        else {
            failures += 1;
            continue;
        };
        let off = [(fit.mu_a_per_mm / row[0] - 1.0).abs(), (fit.mu_s_prime_per_mm / row[1] - 1.0).abs()];
        wide = [wide[0].max(off[0]), wide[1].max(off[1])];
        if (0.01..=1.0).contains(&row[0]) && (0.5..=5.0).contains(&row[1]) {
            tissue = [tissue[0].max(off[0]), tissue[1].max(off[1])];
        }
    }
    println!(
        "{N:3} {:8.0}/s  failures {failures}  steps {} {}  tissue mu_a {:.1e} mu_s' {:.1e}  whole table {:.1e} {:.1e}",
        1.0 / time,
        steps[steps.len() / 2],
        steps[steps.len() - 1],
        tissue[0],
        tissue[1],
        wide[0],
        wide[1]
    );
}
