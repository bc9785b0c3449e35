//! The inverse behind an instrument.

mod truth;

use truth::{rows, slab};
use turbid_iad::{
    Error, Experiment, From, Instrument, Inverse, Known, Lost, Measurement, Plan, Reading, Seen, Slab, Slide, Sphere,
    Spheres, solve_with_g,
};
use turbid_optics::PhaseFunction;

/// The spheres of the tables: port sizes as shares of a disc, which is what the table took; black detectors of 3 mm.
fn spheres(diameter: f64, port: f64, wall_reflectance: f64) -> [Sphere; 2] {
    let disc = |d: f64| 0.25 * (d / diameter) * (d / diameter);
    let first = Sphere {
        sample: disc(port),
        third: disc(port),
        detector: disc(3.0),
        ..Sphere::with_round_ports(diameter, port, port, 3.0, wall_reflectance)
    };
    [first, Sphere { third: 0.0, ..first }]
}

/// The instrument of the inverse table: spheres of 100 mm, ports of 10 mm square, detectors of 3 mm, found from the table itself.
fn two(wall_reflectance: f64, r_standard: f64) -> Instrument {
    let share = |area: f64| area / (std::f64::consts::PI * 100.0 * 100.0);
    let [first, second] = spheres(100.0, 10.0, wall_reflectance);
    let pair =
        [Sphere { sample: share(100.0), third: share(100.0), ..first }, Sphere { sample: share(100.0), ..second }];
    Instrument { spheres: Spheres::Two(pair), r_standard, ..Instrument::NONE }
}

fn experiment<const N: usize>(slab: &Slab, instrument: &Instrument) -> Experiment<N> {
    Experiment::new(slab, instrument).expect("a slab and spheres that can be")
}

fn off(solution: &turbid_iad::Solution, mu_a: f64, mu_s_prime: f64) -> [f64; 2] {
    [(solution.fit.mu_a_per_mm / mu_a - 1.0).abs(), (solution.fit.mu_s_prime_per_mm / mu_s_prime - 1.0).abs()]
}

/// All rows of the balance table; its slabs (UR1, UT1, URU, UTU, recovered from the table) leave 6e-9, its last digit 1e-8.
#[test]
fn readings_of_the_balance_table() {
    for row in rows(truth::BALANCE) {
        let [diameter, port, wall, albedo] = [0, 1, 2, 3].map(|i| row[i]);
        let [ur1, ut1, uru, utu] = match (1000.0 * albedo).round() {
            990.0 => [0.307471119, 0.532679374, 0.368332875, 0.468579289],
            900.0 => [0.101237164, 0.563684664, 0.166739468, 0.446797657],
            999.0 => [0.589631910, 0.332792129, 0.624105869, 0.303375374],
            _ => [0.041433275, 0.516229649, 0.093609298, 0.408856191],
        };
        let instrument =
            Instrument { spheres: Spheres::Two(spheres(diameter, port, wall)), r_standard: 0.9, ..Instrument::NONE };
        let seen = Seen { beam: [ur1, ut1], unscattered: [0.0; 2], uru: [uru; 2], utu };
        let read = instrument.readings(&seen, &Lost::default());
        assert!((read[0] - row[5]).abs() < 2e-8 && (read[1] - row[6]).abs() < 2e-8, "{row:?}: {read:?}");
    }
}

/// Two-sphere readings of another code (64 directions, own error up to 2e-5), forward for all walls; back for walls that leave
/// M_R its grip on mu_s' (r_w <= 0.98): off by what the readings differ, carried through the derivatives. That product comes as
/// the standard errors of readings that err together by just this much; 5 % and 1e-8: the second order, and the table's digits.
#[test]
fn readings_of_another_code() {
    for row in rows(truth::INVERSE_DIS) {
        let [mu_a, mu_s_prime, g, n, r_wall, r_standard, m_r, m_t] = [0, 1, 2, 3, 4, 5, 6, 7].map(|i| row[i]);
        let experiment = experiment::<32>(&slab(n, g, 1.0), &two(r_wall, r_standard));
        let read = experiment.readings(mu_a, mu_s_prime, &Lost::default()).expect("within range");
        let [r, t] = [m_r - read[0], m_t - read[1]];
        assert!(r.abs() < 2e-5 && t.abs() < 2e-5, "{row:?}: {read:?}");
        if r_wall < 1.0 {
            let both =
                Measurement { m_r_se: r.abs(), m_t_se: t.abs(), m_rt_cov: r * t, ..Measurement::exact(m_r, m_t) };
            let solution = experiment.solve(&both).expect("a medium stands behind it");
            let [a_se, s_se] = solution.se().expect("both readings tell something");
            let off = [solution.fit.mu_a_per_mm - mu_a, solution.fit.mu_s_prime_per_mm - mu_s_prime].map(f64::abs);
            assert!(off[0] <= 1.05 * a_se + 1e-8, "{row:?}: {off:?} {solution:?}");
            assert!(off[1] <= 1.05 * s_se + 1e-8 * mu_s_prime, "{row:?}: {off:?} {solution:?}");
        }
    }
}

/// What the model says comes back to 1e-6 through one and two spheres with r_w .95 to .98, mu_a down to 0.001 mm^-1.
#[test]
fn round_trips_through_spheres() {
    let mut worst = 0f64;
    for wall in [0.95, 0.98] {
        for kind in [Spheres::One, Spheres::Two] {
            for (n, slides) in [(1.0, [1.0, 1.0]), (1.4, [1.0, 1.0]), (1.4, [1.5, 1.0])] {
                let mut pair = spheres(100.0, 20.0, wall);
                pair[0].sees_sample = false;
                pair[1].flat = true;
                let instrument = Instrument {
                    spheres: kind(pair),
                    r_standard: 0.98,
                    unscattered: [0.0, 1.0],
                    straight: true,
                    ..Instrument::NONE
                };
                let [top, bottom] = slides.map(Slide::clear);
                let slab = Slab { top, bottom, ..Slab::bare(n, 0.8, 1.0) };
                let experiment = experiment::<8>(&slab, &instrument);
                let lost = Lost { beam: [0.01, 0.005], diffuse: [0.02, 0.01] };
                for mu_a in [0.001, 0.01, 0.1, 1.0] {
                    for mu_s_prime in [0.5, 1.0, 5.0] {
                        let [m_r, m_t] = experiment.readings(mu_a, mu_s_prime, &lost).expect("within range");
                        let case = format!("{wall} {n} {slides:?} {mu_a} {mu_s_prime}");
                        let measured = Measurement { lost, ..Measurement::exact(m_r, m_t) };
                        let solution = experiment.solve(&measured).expect(&case);
                        let [a, s] = off(&solution, mu_a, mu_s_prime);
                        worst = worst.max(a).max(s);
                        assert!(a < 1e-6 && s < 1e-6, "{case}: {solution:?}");
                    }
                }
            }
        }
    }
    println!("worst relative error {worst:.1e}");
}

/// Slides that absorb, each differently: what they take is not the slab's.
#[test]
fn round_trips_between_absorbing_slides() {
    let slab =
        Slab { top: Slide { n: 1.5, tau: 0.1 }, bottom: Slide { n: 1.45, tau: 0.03 }, ..Slab::bare(1.4, 0.8, 1.0) };
    assert!(matches!(Inverse::<8>::new(&slab).err(), Some(Error::AbsorbingSlide { .. })));
    let experiment = experiment::<8>(&slab, &Instrument::NONE);
    for mu_a in [0.001, 0.1, 1.0] {
        for mu_s_prime in [0.1, 1.0, 5.0] {
            let [m_r, m_t] = experiment.readings(mu_a, mu_s_prime, &Lost::default()).expect("within range");
            let solution = experiment.solve(&Measurement::exact(m_r, m_t)).expect("a medium stands behind it");
            let [a, s] = off(&solution, mu_a, mu_s_prime);
            assert!(a < 1e-8 && s < 1e-8, "{mu_a} {mu_s_prime}: {solution:?}");
        }
    }
}

/// The covariance is that of the solutions of moved readings: to first order, so 1 % at steps of 1e-5.
#[test]
fn covariance_is_the_spread_of_moved_readings() {
    for instrument in [Instrument::NONE, two(0.98, 0.99)] {
        let experiment = experiment::<16>(&Slab::bare(1.4, 0.8, 1.0), &instrument);
        let [m_r, m_t] = experiment.readings(0.05, 1.0, &Lost::default()).expect("within range");
        let solve = |r: f64, t: f64| {
            let fit = experiment.solve(&Measurement::exact(m_r + r, m_t + t)).expect("a medium").fit;
            [fit.mu_a_per_mm, fit.mu_s_prime_per_mm]
        };
        let (r_se, t_se, correlation) = (1e-5, 2e-5, -0.6);
        let slope = |a: [f64; 2], b: [f64; 2]| [(a[0] - b[0]) / 2.0, (a[1] - b[1]) / 2.0];
        let by_r = slope(solve(r_se, 0.0), solve(-r_se, 0.0));
        let by_t = slope(solve(0.0, t_se), solve(0.0, -t_se));
        let product = |i: usize, j: usize| {
            by_r[i] * by_r[j] + by_t[i] * by_t[j] + correlation * (by_r[i] * by_t[j] + by_t[i] * by_r[j])
        };
        let noise = Measurement {
            m_r_se: r_se,
            m_t_se: t_se,
            m_rt_cov: correlation * r_se * t_se,
            ..Measurement::exact(m_r, m_t)
        };
        let found = experiment.solve(&noise).expect("a medium").covariance.expect("both are seen");
        for (found, wanted) in found.iter().zip([product(0, 0), product(1, 1), product(0, 1)]) {
            assert!((found / wanted - 1.0).abs() < 0.01, "{instrument:?}: {found} {wanted}");
        }
    }
}

/// One coefficient known: the other from either reading; a reading out of reach is named.
#[test]
fn one_coefficient_known() {
    let experiment = experiment::<16>(&Slab::bare(1.4, 0.8, 1.0), &two(0.95, 0.99));
    let [m_r, m_t] = experiment.readings(0.02, 1.5, &Lost::default()).expect("within range");
    let measured = Measurement { m_r_se: 1e-4, m_t_se: 1e-4, ..Measurement::exact(m_r, m_t) };
    for from in [From::MR, From::MT] {
        let (mu_s_prime, se) = experiment.solve_one(&measured, Known::MuA(0.02), from).expect("in reach");
        assert!((mu_s_prime - 1.5).abs() < 1e-9 && se > 0.0, "{from:?}: {mu_s_prime} {se}");
        let (mu_a, se) = experiment.solve_one(&measured, Known::MuSPrime(1.5), from).expect("in reach");
        assert!((mu_a - 0.02).abs() < 1e-10 && se > 0.0, "{from:?}: {mu_a} {se}");
    }
    let bright = Measurement::exact(0.3, 1.2);
    assert!(matches!(experiment.solve_one(&bright, Known::MuSPrime(1.5), From::MT), Err(Error::OutOfReach { .. })));
}

/// Many at once are the same bits as one by one, on any number of threads.
#[test]
fn a_batch_is_its_parts() {
    let slab = Slab::bare(1.4, 0.8, 1.0);
    let (direct, through) = (Inverse::<8>::new(&slab).expect("a slab"), experiment::<8>(&slab, &two(0.98, 0.99)));
    let readings: Vec<Reading> = (0..200)
        .map(|i| Reading { m_r: 0.1 + 0.004 * f64::from(i % 150), m_t: 0.05 + 0.003 * f64::from(i / 2), sigma: 0.0 })
        .collect();
    let measured: Vec<Measurement> = readings.iter().map(|r| Measurement::exact(r.m_r, r.m_t)).collect();
    let one = readings.iter().map(|r| direct.invert(r)).collect::<Vec<_>>();
    let one_through = measured.iter().map(|m| through.solve(m)).collect::<Vec<_>>();
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        assert!(pool.install(|| direct.invert_batch(&readings)) == one);
        assert!(pool.install(|| through.solve_batch(&measured)) == one_through);
    }
    assert!(one.iter().filter(|r| r.is_ok()).count() > 50 && one_through.iter().filter(|r| r.is_ok()).count() > 50);
}

/// Too much light within the standard errors lies on the limit, beyond them it is named; behind spheres too.
#[test]
fn limits_behind_spheres() {
    let experiment = experiment::<16>(&Slab::bare(1.0, 0.8, 1.0), &two(0.98, 0.99));
    let [m_r, m_t] = experiment.readings(0.0, 1.0, &Lost::default()).expect("within range");
    let measured = |se: f64| Measurement { m_r_se: se, m_t_se: se, ..Measurement::exact(m_r + 1e-3, m_t + 1e-3) };
    let fit = experiment.solve(&measured(2e-3)).expect("within the standard error").fit;
    assert!(fit.flags.conservative && fit.mu_a_per_mm == 0.0 && (fit.mu_s_prime_per_mm - 1.0).abs() < 0.02, "{fit:?}");
    let error = experiment.solve(&measured(1e-5)).expect_err("too much light");
    assert!(matches!(error, Error::TooMuchLight { .. }), "{error:?}");
    let [m_r, m_t] = experiment.readings(0.5, 0.0, &Lost::default()).expect("within range");
    let fit = experiment
        .solve(&Measurement { m_r_se: 1e-3, m_t_se: 1e-3, ..Measurement::exact(m_r, m_t) })
        .expect("clear")
        .fit;
    assert!(fit.flags.no_scatter && (fit.mu_a_per_mm - 0.5).abs() < 2e-3, "{fit:?}");
    for bad in [f64::NAN, f64::INFINITY, -1.0] {
        assert!(
            experiment.solve(&Measurement::exact(bad, 0.3)).is_err()
                && experiment.solve(&Measurement::exact(0.3, bad)).is_err()
        );
    }
    let error = experiment.solve(&Measurement::exact(0.3, 0.0)).expect_err("opaque");
    assert!(matches!(error, Error::Underdetermined { ratio } if ratio > 0.0), "{error:?}");
}

/// g from M_U behind spheres.
#[test]
fn g_behind_spheres() {
    let (slab, instrument) = (Slab::bare(1.4, 0.9, 1.0), two(0.97, 0.99));
    let plan = Plan::<8>::new(&slab).expect("a slab");
    let m_u = plan.forward(0.05, 0.8).expect("within range").ut1_unscattered;
    let [m_r, m_t] = experiment::<8>(&slab, &instrument).readings(0.05, 0.8, &Lost::default()).expect("within range");
    let start = Slab { phase: PhaseFunction::henyey_greenstein(0.5), ..slab };
    let found = solve_with_g::<8>(&start, &instrument, &Measurement::exact(m_r, m_t), m_u).expect("a medium");
    assert!((found.g - 0.9).abs() < 1e-8 && (found.fit.mu_a_per_mm / 0.05 - 1.0).abs() < 1e-7, "{found:?}");
}

/// Perfectly white walls: M_R hardly depends on mu_s' and folds back, so two media may give the same readings. The medium
/// that was there is always one of the two, both give the readings, and the flag says so.
#[test]
fn two_media_behind_white_walls() {
    let (mut ambiguous, mut rows) = (0, 0);
    for (wall, n) in [(1.0, 1.0), (1.0, 1.4), (0.98, 1.0)] {
        let experiment = experiment::<8>(&Slab::bare(n, 0.8, 1.0), &two(wall, 0.99));
        for mu_a in [0.003, 0.01, 0.03, 0.1, 0.3, 1.0] {
            for mu_s_prime in [0.1, 0.3, 1.0, 3.0, 10.0] {
                let [m_r, m_t] = experiment.readings(mu_a, mu_s_prime, &Lost::default()).expect("within range");
                let case = format!("r_w {wall} n {n} {mu_a} {mu_s_prime}");
                let solution = experiment.solve(&Measurement::exact(m_r, m_t)).expect(&case);
                let fit = [solution.fit.mu_a_per_mm, solution.fit.mu_s_prime_per_mm];
                let media = [Some(fit), solution.other];
                let is_there = |[a, s]: [f64; 2]| (a / mu_a - 1.0).abs() < 1e-5 && (s / mu_s_prime - 1.0).abs() < 1e-5;
                println!("{case}: {media:?}");
                assert!(media.iter().flatten().any(|&m| is_there(m)), "{case}: {solution:?}");
                for [a, s] in media.into_iter().flatten() {
                    let read = experiment.readings(a, s, &Lost::default()).expect("within range");
                    assert!(
                        (read[0] / m_r - 1.0).abs() < 1e-8 && (read[1] / m_t - 1.0).abs() < 1e-8,
                        "{case}: {a} {s}"
                    );
                }
                assert_eq!(solution.fit.flags.ambiguous, solution.other.is_some());
                rows += usize::from(wall == 1.0);
                ambiguous += usize::from(wall == 1.0 && solution.other.is_some());
            }
        }
    }
    println!("{ambiguous} of {rows} ambiguous");
    assert!(ambiguous > 0, "of {rows}");
}
