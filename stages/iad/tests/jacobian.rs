//! Derivatives of the forward model.

mod truth;

use truth::slab;
use turbid_iad::{Incidence, Plan, Response, Slab, Slide};

fn fields(r: &Response) -> [f64; 8] {
    [r.ur1, r.ut1, r.uru, r.utu, r.ur1_unscattered, r.ut1_unscattered, r.absorbed, r.absorbed_diffuse]
}

/// Richardson's fourth-order central difference of every field by one coefficient, with its own error: the step's
/// truncation, seen from a step half as long, and the rounding of values up to 1.
fn difference(f: impl Fn(f64) -> [f64; 8], x: f64, step: f64) -> [(f64, f64); 8] {
    let fourth = |h: f64| -> [f64; 8] {
        let [a, b, c, d] = [-2.0, -1.0, 1.0, 2.0].map(|k| f(x + k * h));
        std::array::from_fn(|i| (a[i] - 8.0 * b[i] + 8.0 * c[i] - d[i]) / (12.0 * h))
    };
    let (coarse, fine) = (fourth(step), fourth(0.5 * step));
    let size = f(x);
    std::array::from_fn(|i| (fine[i], (fine[i] - coarse[i]).abs() + 1e-14 * size[i].abs().max(1e-6) / step))
}

fn holds<const N: usize>(plan: &Plan<N>, mu_a: f64, mu_s_prime: f64, case: &str) {
    let run = |a: f64, s: f64| fields(&plan.forward(a, s).expect(case));
    let (response, slopes) = plan.forward_jac(mu_a, mu_s_prime).expect(case);
    assert_eq!(response, plan.forward(mu_a, mu_s_prime).expect(case), "{case}");
    let by_a = difference(|a| run(a, mu_s_prime), mu_a, 2e-3 * mu_a);
    let by_s = difference(|s| run(mu_a, s), mu_s_prime, 2e-3 * mu_s_prime);
    let logs = |i: usize| (fields(&slopes[0])[i] * mu_a).abs().max((fields(&slopes[1])[i] * mu_s_prime).abs());
    for (j, (wanted, by, x)) in [(by_a, "mu_a", mu_a), (by_s, "mu_s'", mu_s_prime)].iter().enumerate() {
        let found = fields(&slopes[j]);
        for i in 0..8 {
            let (wanted, error) = wanted[i];
            // As stated: 1e-9 of the larger of the two logarithmic derivatives, and the rounding of sums of order 1 / cosine;
            // the direction of an oblique beam has the weight 1e-9, so that modes orthogonal to 1e-15 N leave 1e-15 N / sqrt(1e-9),
            // by reflectance and by transmittance.
            let oblique = matches!(plan.incidence(), Incidence::Oblique(_));
            let digits = if oblique { 2e-15 * N as f64 / 1e-9f64.sqrt() } else { 1e-12 };
            let bound = 2.0 * error + (1e-9 * logs(i) + digits) / x;
            assert!(
                (found[i] - wanted).abs() <= bound,
                "{case}, field {i} by {by}: {:e}, difference {wanted:e} +- {error:.0e}",
                found[i]
            );
        }
    }
}

/// Against central differences: every field, thin to opaque slabs, albedo from 1e-4 to 1 - 1e-7, peaks either way, slides of
/// every kind, every light.
#[test]
fn derivatives_are_those_of_the_response() {
    let absorbing =
        Slab { top: Slide { n: 1.5, tau: 0.1 }, bottom: Slide { n: 1.4, tau: 0.3 }, ..Slab::bare(1.4, 0.8, 1.0) };
    let slabs = [
        slab(1.0, 0.0, 1.0),
        slab(1.4, 0.9, 1.5),
        slab(1.33, -0.7, 1.0),
        absorbing,
        Slab { bottom: Slide::NONE, ..slab(1.4, 0.99, 1.5) },
    ];
    let lights = [Incidence::Normal, Incidence::Oblique(0.7), Incidence::Cone(0.3), Incidence::Diffuse];
    for slab in slabs {
        for light in lights {
            let plan = Plan::<8>::lit(&slab, light).expect("a slab");
            for mu_a in [1e-5, 1e-3, 0.1, 2.0, 20.0] {
                for mu_s_prime in [1e-4, 1e-2, 0.3, 1.0, 30.0] {
                    holds(&plan, mu_a, mu_s_prime, &format!("{slab:?} {light:?} mu_a {mu_a} mu_s' {mu_s_prime}"));
                }
            }
        }
    }
}
