//! The transport solver against truth tables, conservation and limits.

mod truth;

use truth::{Quantity, Truth};
use turbid_optics::{Medium, rte};

fn worst(truths: &[Truth]) {
    for truth in truths {
        let response = rte::respond(&truth.medium, truth.thickness, truth.f_x).unwrap();
        let value = match truth.quantity {
            Quantity::HemisphericalIncident => response.reflectance.hemispherical_incident,
            Quantity::Camera => response.reflectance.camera,
            Quantity::Transmittance => response.transmittance,
        };
        assert!((value - truth.value).abs() <= truth.bound(), "{value}, truth {truth:?}");
    }
}

#[test]
fn half_spaces_agree_with_discrete_ordinates() {
    worst(&truth::half_spaces());
}

#[test]
fn isotropic_half_spaces_agree_with_chandrasekhar() {
    worst(&truth::chandrasekhar());
}

/// All light comes back from a half-space that does not absorb, per light that entered; near it, R is smooth.
#[test]
fn conservative_half_space_returns_all() {
    for (g, n) in [(0.0, 1.0), (0.8, 1.4), (0.9, 1.33)] {
        let at = |mu_a: f64| rte::reflectance(&Medium { mu_a, mu_s_prime: 1.0, g, n }, None, 0.0).unwrap();
        assert_eq!(at(0.0).hemispherical_entered, 1.0);
        // The loss is proportional to sqrt(mu_a); across the switch to extrapolation too, to 1e-7.
        let loss = |mu_a: f64| 1.0 - at(mu_a).hemispherical_entered;
        let slope = loss(1e-8) / 1e-4;
        for mu_a in [1e-16f64, 1e-12, 0.999e-9, 1.001e-9] {
            let root = mu_a.sqrt();
            assert!((loss(mu_a) - slope * root).abs() < 1e-7 + 3e-4 * slope * root, "g {g}, n {n}, mu_a {mu_a}");
            assert!((at(mu_a).camera - at(0.0).camera).abs() < 4.0 * slope * root + 1e-7);
        }
    }
}
