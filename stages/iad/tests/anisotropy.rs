//! Three readings, three unknowns.

mod truth;

use truth::slab;
use turbid_iad::{Error, Plan, Reading, Slab, invert_with_g};

/// What the model says comes back: mu_a, mu_s' and 1 - g to 1e-8.
#[test]
fn round_trips_with_g() {
    for g in [-0.5, 0.0, 0.5, 0.8, 0.95] {
        for (n, n_slide) in [(1.0, 1.0), (1.4, 1.0), (1.4, 1.5)] {
            let plan = Plan::<8>::new(&slab(n, g, n_slide)).expect("a slab");
            for mu_a in [1e-3, 0.1, 1.0] {
                for mu_s_prime in [0.05, 0.5, 5.0] {
                    let r = plan.forward(mu_a, mu_s_prime).expect("within range");
                    let reading = Reading { m_r: r.ur1, m_t: r.ut1, sigma: 0.0 };
                    let case = format!("g {g} n {n} slide {n_slide} mu_a {mu_a} mu_s' {mu_s_prime}");
                    let found = invert_with_g::<8>(&slab(n, 0.7, n_slide), &reading, r.ut1_unscattered).expect(&case);
                    let off = (found.fit.mu_a_per_mm / mu_a - 1.0)
                        .abs()
                        .max((found.fit.mu_s_prime_per_mm / mu_s_prime - 1.0).abs())
                        .max(((1.0 - found.g) / (1.0 - g) - 1.0).abs());
                    assert!(off < 1e-8, "{case}: {found:?}");
                }
            }
        }
    }
}

#[test]
fn impossible_unscattered_light_is_named() {
    let invert =
        |m_u| invert_with_g::<16>(&Slab::bare(1.0, 0.0, 1.0), &Reading { m_r: 0.3, m_t: 0.3, sigma: 0.0 }, m_u);
    assert!(matches!(invert(0.4), Err(Error::UnscatteredExceedsTotal { .. })), "{:?}", invert(0.4));
    assert!(matches!(invert(0.3), Err(Error::Inconsistent { .. })), "{:?}", invert(0.3));
    assert!(matches!(invert(f64::NAN), Err(Error::NotFinite { name: "M_U" })));
    assert!(matches!(invert(0.0), Err(Error::Range { .. })));
    assert!(invert(1e-12).is_ok_and(|found| found.g > 0.9), "{:?}", invert(1e-12));
}

/// Readings of the doubling code with 64 directions, read back with 32: no failure. The bounds are ceilings for
/// regressions: what both codes differ by at n = 1.4 was measured (mu_a 6.7e-5, mu_s' and 1 - g 3.0e-4) and rounded up.
#[test]
fn readings_of_another_code_with_g() {
    let mut worst = [0f64; 3];
    for row in truth::rows(truth::INVERSE_WITH_G) {
        let [mu_a, mu_s_prime, g, n, m_r, m_t, m_u] = [0, 1, 2, 3, 4, 5, 6].map(|i| row[i]);
        let found = invert_with_g::<32>(&Slab::bare(n, 0.5, 1.0), &Reading { m_r, m_t, sigma: 0.0 }, m_u);
        let found = found.unwrap_or_else(|error| panic!("{row:?}: {error}"));
        let ratios =
            [found.fit.mu_a_per_mm / mu_a, found.fit.mu_s_prime_per_mm / mu_s_prime, (1.0 - found.g) / (1.0 - g)];
        for (worst, ratio) in worst.iter_mut().zip(ratios) {
            *worst = worst.max((ratio - 1.0).abs());
        }
    }
    assert!(worst[0] < 1e-4 && worst[1] < 4e-4 && worst[2] < 4e-4, "{worst:?}");
}
