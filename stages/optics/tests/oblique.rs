//! Oblique light and view of the transport solver: laws that hold at every angle.

use turbid_optics::quadrature::gauss_legendre_on;
use turbid_optics::{Medium, PhaseFunction, rte};

const ANGLES: [f64; 5] = [0.0, 20.0, 45.0, 60.0, 80.0];

fn cos(angle_deg: f64) -> f64 {
    if angle_deg == 0.0 { 1.0 } else { libm::cos(angle_deg.to_radians()) }
}

fn media() -> Vec<(Medium, Option<f64>)> {
    let medium = |mu_a, g, n| Medium { mu_a, mu_s_prime: 1.0, phase: PhaseFunction::henyey_greenstein(g), n };
    vec![
        (medium(0.02, 0.0, 1.0), None),
        (medium(0.1, 0.8, 1.0), None),
        (medium(0.02, 0.9, 1.4), None),
        (medium(0.1, 0.8, 1.4), Some(2.0)),
    ]
}

/// Light and camera may change places (Helmholtz): the solver's absolute error, 1e-5, on both sides.
#[test]
fn light_and_view_may_be_exchanged() {
    for (medium, thickness) in media() {
        for f_x in [0.0, 0.1] {
            for a in ANGLES {
                for b in ANGLES.into_iter().filter(|&b| b > a) {
                    let of = |lines| rte::oblique(&medium, thickness, f_x, lines).expect("solvable").camera;
                    let (there, back) = (of([cos(a), cos(b)]), of([cos(b), cos(a)]));
                    assert!(
                        (there - back).abs() < 2e-5,
                        "{medium:?} {thickness:?} f_x {f_x}, {a} and {b} deg: {there} {back}"
                    );
                }
            }
        }
    }
}

/// What all cameras over the hemisphere see adds up to the power that leaves, 2 int R mu dmu, but for what the exact last collision has over the
/// truncated one (g > 0) and the rule over the hemisphere: 2e-4.
#[test]
fn views_add_up_to_the_power_that_leaves() {
    for (medium, thickness) in media().into_iter().filter(|(_, thickness)| thickness.is_none()) {
        for light in ANGLES.into_iter().map(cos) {
            let sum: f64 = gauss_legendre_on(0.0, 1.0, 24)
                .into_iter()
                .map(|(view, weight)| {
                    2.0 * weight * view * rte::oblique(&medium, thickness, 0.0, [light, view]).expect("solvable").camera
                })
                .sum();
            let whole = rte::oblique(&medium, thickness, 0.0, [light, 0.999]).expect("solvable").hemispherical_incident;
            assert!((sum - whole).abs() < 2e-4, "{medium:?} cos {light}: {sum} {whole}");
        }
    }
}

/// Isotropic scattering, n = 1: Chandrasekhar's a / 4 H(mu) H(mu_0) / (mu + mu_0), H by iterating its equation on 64 nodes (1e-7).
#[test]
fn isotropic_half_spaces_are_chandrasekhars() {
    for mu_a in [0.5, 0.05] {
        let medium = Medium { mu_a, mu_s_prime: 1.0, phase: PhaseFunction::henyey_greenstein(0.0), n: 1.0 };
        let albedo = medium.albedo();
        let nodes = gauss_legendre_on(0.0, 1.0, 64);
        let mut h = vec![1.0; nodes.len()];
        let at = |mu: f64, h: &[f64]| {
            // 1 / H = sqrt(1 - a) + a / 2 int t H(t) / (mu + t) dt
            let sum: f64 = nodes.iter().zip(h).map(|((t, w), h)| w * t * h / (mu + t)).sum();
            1.0 / ((1.0 - albedo).sqrt() + 0.5 * albedo * sum)
        };
        for _ in 0..200 {
            h = nodes.iter().map(|(mu, _)| at(*mu, &h)).collect();
        }
        for light in ANGLES.into_iter().map(cos) {
            for view in ANGLES.into_iter().map(cos) {
                let exact = 0.25 * albedo * at(light, &h) * at(view, &h) / (light + view);
                let found = rte::oblique(&medium, None, 0.0, [light, view]).expect("solvable").camera;
                assert!((found - exact).abs() < 1e-5, "a = {albedo}, {light} {view}: {found} {exact}");
            }
        }
    }
}
