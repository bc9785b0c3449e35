//! Error against time over N, forward and inverse, and every claim of robustness in full:
//! `cargo bench -p turbid-iad [-- quick] [-- --svg FILE]`.
//!
//! Times are CPU seconds, the least of 15 runs: other programs may share the machine.

mod figure;
#[path = "../tests/truth/mod.rs"]
mod truth;

use std::hint::black_box;
use std::time::Instant;

use cpu_time::{ProcessTime, ThreadTime};
use figure::{Curve, plot};
use truth::{rows, slab};
use turbid_iad::{Experiment, Instrument, Inverse, Measurement, Plan, Reading, Slab, Sphere, Spheres, invert_with_g};

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let quick = arguments.iter().any(|a| a == "quick");
    let svg = arguments.iter().position(|a| a == "--svg").and_then(|i| arguments.get(i + 1));

    println!(
        "forward, us of CPU per call (albedo .9-.95, tau 5, g .8, n 1.4); worst error of UR1, UT1, URU, UTU by class"
    );
    println!("  N   beam + diffuse, with derivatives   n=1 g<=.9    n=1 rest   n>1 g<=.9    n>1 rest");
    let forward = [forward::<4>(), forward::<8>(), forward::<16>(), forward::<32>(), forward::<64>()];
    println!("inverse, tissue (n 1.4, g .8): solves per CPU second; worst error on the readings of another code");
    let inverse = [inverse::<8>(), inverse::<16>(), inverse::<32>(), inverse::<64>()];
    println!("readings of another code with M_U, and behind two spheres: failures; worst relative error");
    readings_with_g::<16>();
    readings_with_g::<32>();
    readings_with_g::<64>();
    readings_of_spheres::<8>();
    readings_of_spheres::<16>();
    readings_of_spheres::<32>();
    readings_of_spheres::<64>();
    println!(
        "round trips, mu_a 1e-4..10, mu_s' .01..20, g -.5...9999, n 1..1.5, slides: failures, worst relative error, steps"
    );
    round_trips::<8>();
    round_trips::<16>();
    round_trips::<32>();
    random_readings(if quick { 20_000 } else { 1_000_000 });
    inputs_that_others_get_wrong();

    let curve =
        |name: &str, dashed, color, points: Vec<(f64, f64)>| Curve { name: name.to_owned(), dashed, color, points };
    let curves = [
        curve("forward, n = 1", false, 0, forward.iter().map(|f| (f.0, f.1[0])).collect()),
        curve("forward, n = 1.33 to 1.5", false, 1, forward.iter().map(|f| (f.0, f.1[2])).collect()),
        curve("inverse, mu_a of tissue", true, 2, inverse.iter().map(|i| (i.0, i.1[0])).collect()),
        curve("inverse, mu_s' of tissue", true, 3, inverse.iter().map(|i| (i.0, i.1[1])).collect()),
    ];
    if let Some(file) = svg {
        std::fs::write(file, plot(&curves)).expect("the figure can be written");
    }
}

/// Least CPU seconds per call of `work`, which makes `calls`.
fn seconds(calls: usize, mut work: impl FnMut()) -> f64 {
    let mut least = f64::INFINITY;
    for _ in 0..15 {
        let start = ThreadTime::now();
        work();
        least = least.min(start.elapsed().as_secs_f64() / calls as f64);
    }
    least
}

/// Seconds per call, and the worst error of each class.
fn forward<const N: usize>() -> (f64, [f64; 4]) {
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
    // tau 5 with albedo a: mu_a = 5 (1 - a), mu_s' = a.
    let albedos: Vec<f64> = (0..50).map(|i| 0.9 + 0.001 * f64::from(i)).collect();
    let both = seconds(50, || {
        for &a in &albedos {
            let _ = black_box(plan.forward(black_box(5.0 * (1.0 - a)), a));
        }
    });
    let slopes = seconds(50, || {
        for &a in &albedos {
            let _ = black_box(plan.forward_jac(black_box(5.0 * (1.0 - a)), a));
        }
    });
    let [a, b, c, d] = worst;
    println!("{N:3} {:10.2} {:20.2} {a:18.1e} {b:11.1e} {c:11.1e} {d:11.1e}", both * 1e6, slopes * 1e6);
    (both, worst)
}

/// Seconds per solve, and the worst relative errors of mu_a and mu_s' in tissue.
fn inverse<const N: usize>() -> (f64, [f64; 2]) {
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
    let mut failures = readings.len() - steps.len();
    let mut tissue = [0f64; 2];
    let mut wide = [0f64; 2];
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
        "{N:3} {:8.0}/s  failures {failures}  steps {} at most {}  tissue mu_a {:.1e} mu_s' {:.1e}  whole table {:.1e} {:.1e}",
        1.0 / time,
        steps[steps.len() / 2],
        steps[steps.len() - 1],
        tissue[0],
        tissue[1],
        wide[0],
        wide[1]
    );
    // Two threads: the CPU time of a solve must not grow; the wall time tells what else the machine did.
    let many: Vec<Reading> =
        readings.iter().cycle().take(readings.len() * if N > 16 { 10 } else { 200 }).copied().collect();
    for threads in [1, 2] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        let (cpu, wall) = (ProcessTime::now(), Instant::now());
        black_box(pool.install(|| inverse.invert_batch(&many)));
        let (cpu, wall) = (cpu.elapsed().as_secs_f64(), wall.elapsed().as_secs_f64());
        let count = many.len() as f64;
        println!("      batch on {threads}: {:.0} per CPU second, {:.0} per second", count / cpu, count / wall);
    }
    (time, tissue)
}

fn readings_with_g<const N: usize>() {
    let (mut worst, mut failures) = ([0f64; 3], 0);
    for row in rows(truth::INVERSE_WITH_G) {
        let reading = Reading { m_r: row[4], m_t: row[5], sigma: 0.0 };
        let Ok(found) = invert_with_g::<N>(&Slab::bare(row[3], 0.5, 1.0), &reading, row[6]) else {
            failures += 1;
            continue;
        };
        let found = [found.fit.mu_a_per_mm, found.fit.mu_s_prime_per_mm, 1.0 - found.g];
        for (i, truth) in [row[0], row[1], 1.0 - row[2]].iter().enumerate() {
            worst[i] = worst[i].max((found[i] / truth - 1.0).abs());
        }
    }
    let [a, s, g] = worst;
    println!("{N:3} M_U      failures {failures}  mu_a {a:.1e}  mu_s' {s:.1e}  1 - g {g:.1e}");
}

/// Spheres of 100 mm, ports of 10 mm square, black detectors of 3 mm. Where two media have the same readings the nearer counts.
fn readings_of_spheres<const N: usize>() {
    let share = |area: f64| area / (std::f64::consts::PI * 100.0 * 100.0);
    for walls in [[0.95, 0.98], [1.0, 1.0]] {
        let (mut worst, mut failures, mut ambiguous, mut count, mut time) = ([0f64; 2], 0, 0, 0u32, 0.0);
        for row in rows(truth::INVERSE_DIS).iter().filter(|row| walls.contains(&row[4])) {
            let first = Sphere {
                sample: share(100.0),
                third: share(100.0),
                detector: 0.25 * 0.03 * 0.03,
                ..Sphere::with_round_ports(100.0, 10.0, 10.0, 3.0, row[4])
            };
            let pair = [first, Sphere { third: 0.0, ..first }];
            let instrument = Instrument { spheres: Spheres::Two(pair), r_standard: row[5], ..Instrument::NONE };
            let experiment = Experiment::<N>::new(&slab(row[3], row[2], 1.0), &instrument).expect("spheres");
            count += 1;
            time += seconds(1, || {
                let _ = black_box(experiment.solve(&Measurement::exact(row[6], row[7])));
            });
            let Ok(solution) = experiment.solve(&Measurement::exact(row[6], row[7])) else {
                failures += 1;
                continue;
            };
            ambiguous += usize::from(solution.other.is_some());
            let off = |[a, s]: [f64; 2]| [(a / row[0] - 1.0).abs(), (s / row[1] - 1.0).abs()];
            let own = off([solution.fit.mu_a_per_mm, solution.fit.mu_s_prime_per_mm]);
            let nearer = solution.other.map(off).filter(|other| other[1] < own[1]).unwrap_or(own);
            worst = [worst[0].max(nearer[0]), worst[1].max(nearer[1])];
        }
        let [a, s] = worst;
        println!(
            "{N:3} r_w {walls:?} failures {failures}  ambiguous {ambiguous}  mu_a {a:.1e}  mu_s' {s:.1e}  {:.2} ms per solve",
            1e3 * time / f64::from(count)
        );
    }
}

fn round_trips<const N: usize>() {
    let (mut worst, mut failures, mut steps) = (0f64, 0, Vec::new());
    for g in [-0.5, 0.0, 0.5, 0.8, 0.9, 0.99, 0.9999] {
        for (n, n_slide) in [(1.0, 1.0), (1.33, 1.0), (1.4, 1.0), (1.4, 1.5), (1.5, 1.0)] {
            let inverse = Inverse::<N>::new(&slab(n, g, n_slide)).expect("a slab");
            for mu_a in [1e-4, 1e-3, 0.01, 0.1, 1.0, 10.0] {
                for mu_s_prime in [0.01, 0.1, 0.5, 1.0, 2.0, 5.0, 20.0] {
                    let r = inverse.plan().forward(mu_a, mu_s_prime).expect("within range");
                    match inverse.invert(&Reading { m_r: r.ur1, m_t: r.ut1, sigma: 0.0 }) {
                        Ok(fit) => {
                            steps.push(fit.iterations);
                            worst = worst.max((fit.mu_a_per_mm / mu_a - 1.0).abs());
                            worst = worst.max((fit.mu_s_prime_per_mm / mu_s_prime - 1.0).abs());
                        }
                        Err(_) => failures += 1,
                    }
                }
            }
        }
    }
    steps.sort_unstable();
    let count = steps.len() + failures;
    println!(
        "{N:3} {failures} of {count}, {worst:.1e}, median {} at most {}",
        steps[steps.len() / 2],
        steps[steps.len() - 1]
    );
}

/// Whatever comes in, nothing panics, and what comes out as a fit is one.
fn random_readings(count: usize) {
    let odd = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -0.0, 0.0, 5e-324, 1e-310, 1.0, -1.0, 1e308];
    let mut state = 2u64;
    let mut next = || {
        state = state.wrapping_mul(0x5851_F42D_4C95_7F2D).wrapping_add(0x1405_7B7E_F767_814F);
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    let (mut fits, mut stuck, mut wrong) = (0, 0, 0);
    for _ in 0..count / 200 {
        let n = 1.0 + (next() * 2.0).floor() * 0.6 * next();
        let inverse =
            Inverse::<8>::new(&slab(n, 1.99 * next() - 0.995, if next() < 0.5 { 1.0 } else { 1.0 + 0.6 * next() }));
        let inverse = inverse.expect("a slab");
        for _ in 0..200 {
            let mut value = || match next() {
                x if x < 0.05 => odd[(next() * 10.0) as usize],
                x if x < 0.15 => next() * 1e-6,
                _ => next(),
            };
            let [m_r, m_t] = [value(), value()];
            match inverse.invert(&Reading { m_r, m_t, sigma: 0.0 }) {
                Ok(fit) => {
                    let sound = |x: f64| x.is_finite() && x >= 0.0;
                    fits += 1;
                    wrong +=
                        usize::from(!(sound(fit.mu_a_per_mm) && sound(fit.mu_s_prime_per_mm) && fit.residual < 1e-8));
                }
                Err(turbid_iad::Error::NotConverged { .. }) => stuck += 1,
                Err(_) => {}
            }
        }
    }
    println!("{count} random readings: {fits} fits, of which {wrong} are none; {stuck} not converged");
}

fn inputs_that_others_get_wrong() {
    println!("inputs that others get wrong, N = 16: ms of CPU, preparation included");
    let mut slowest = 0f64;
    for line in truth::ROBUST.lines().skip(1) {
        let cells: Vec<&str> = line.split(',').collect();
        let cell = |i: usize, default: f64| cells[i].parse().unwrap_or(default);
        let slab = Slab { thickness_mm: cell(7, 1.0), ..slab(cell(5, 1.0), cell(4, 0.0), cell(6, 1.0)) };
        let reading = Reading { m_r: cell(1, 0.0), m_t: cell(2, 0.0), sigma: 0.0 };
        let m_u = cell(3, f64::NAN);
        let time = 1e3
            * seconds(1, || {
                if m_u.is_nan() {
                    let _ = black_box(Inverse::<16>::new(&slab).and_then(|inverse| inverse.invert(&reading)));
                } else {
                    let _ = black_box(invert_with_g::<16>(&slab, &reading, m_u));
                }
            });
        slowest = slowest.max(time);
        println!("  {:40} {time:.3}", cells[0]);
    }
    println!("slowest {slowest:.3} ms");
}
