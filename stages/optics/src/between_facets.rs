//! Light that a rough wall loses between its facets: closed quadratures over what [`Rough::sample`](crate::rough::Rough::sample) draws.
//!
//! The model of one scattering (`rough.rs`) drops light that would meet a second facet. How much that is depends on alpha and on both
//! indices only, so it can be said before anything is rendered.

use std::sync::OnceLock;

use glam::DVec3;

use crate::quadrature::gauss_legendre_on;
use crate::refraction::refract;
use crate::rough::Rough;

/// Nodes of the facets that a direction sees, along u and around, and of the cosine of the direction on either side of the edge of total reflection: what is lost to 1 % of it for
/// alpha >= 0.02 (`the_quadrature_has_converged`). The edges of the facets' total reflection and of the horizon leave no more digits.
const NODES: [usize; 3] = [24, 16, 24];

/// What becomes of light at a rough wall, as fractions of it that sum to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Shares {
    pub reflected: f64,
    pub transmitted: f64,
    /// Between facets.
    pub lost: f64,
}

/// Of light that comes out of `n_from` at the cosine `cos` in (0, 1] with the normal of a wall of roughness `alpha` in (0, 1].
///
/// Source: the integral over visible facets of F G_1(reflected) + (1 - F) G_1(refracted), Walter et al. (2007), by Gauss's rule in the
/// coordinates in which facets are drawn evenly (Dupuy and Benyoub 2023).
pub fn shares_at(alpha: f64, [n_from, n_to]: [f64; 2], cos: f64) -> Shares {
    shares_by(alpha, [n_from, n_to], cos, &rules(NODES))
}

/// Of even light from all directions on the side of `n_from`.
pub fn shares(alpha: f64, n: [f64; 2]) -> Shares {
    shares_over(alpha, n, NODES)
}

/// Fraction that is lost of even light which falls through a wall of roughness `alpha` into a deep medium that absorbs nothing, from `n_outside`
/// into `n_inside`, and of which all should come back.
///
/// In the medium light comes to the wall evenly, again and again until it is out or lost: with the shares of both sides
/// lost_out + transmitted_out x lost_in / (lost_in + transmitted_in).
pub fn lost_in_furnace(alpha: f64, n_outside: f64, n_inside: f64) -> f64 {
    if n_outside == n_inside {
        return 0.0;
    }
    let [outside, inside] = [shares(alpha, [n_outside, n_inside]), shares(alpha, [n_inside, n_outside])];
    outside.lost + outside.transmitted * inside.lost / (inside.lost + inside.transmitted)
}

/// The index of `others` (none equal to `n`: 1) outside a wall of roughness `alpha` around a medium of index `n` for which
/// [`lost_in_furnace`] is largest, and how much that is.
pub fn worst_neighbour(alpha: f64, n: f64, others: impl IntoIterator<Item = f64>) -> (f64, f64) {
    let lost = |outside: f64| (outside, lost_in_furnace(alpha, outside, n));
    others.into_iter().filter(|&other| other != n).map(lost).fold((1.0, 0.0), |a, b| if b.1 > a.1 { b } else { a })
}

type Rule = Vec<(f64, f64)>;

/// Along u, and around: the facets to the left and to the right of the plane of incidence are alike.
fn rules([along, around, _]: [usize; 3]) -> [Rule; 2] {
    // With u = 1 - s^4 nodes crowd where facets are steep, of which a part of some alpha^2 loses the light.
    let steep = |(s, weight): (f64, f64)| (1.0 - s * s * s * s, 4.0 * s * s * s * weight);
    [gauss_legendre_on(0.0, 1.0, along).into_iter().map(steep).collect(), gauss_legendre_on(0.0, 0.5, around)]
}

fn shares_over(alpha: f64, n: [f64; 2], nodes: [usize; 3]) -> Shares {
    static RULES: OnceLock<[Rule; 2]> = OnceLock::new();
    let fresh;
    let rules = if nodes == NODES {
        RULES.get_or_init(|| rules(NODES))
    } else {
        fresh = rules(nodes);
        &fresh
    };
    let mut sum = Shares::default();
    // Below the cosine of total reflection nothing passes a smooth wall: a kink, unless it lies between two panels.
    let ratio = n[1] / n[0];
    let edge = (1.0 - ratio * ratio).max(0.0).sqrt();
    for (low, high) in [(0.0, edge), (edge, 1.0)].into_iter().filter(|(low, high)| high > low) {
        // With t^2 the nodes crowd at grazing light, where most is lost, and above the edge, where transmission begins as a root.
        for (t, weight) in gauss_legendre_on(0.0, 1.0, nodes[2]) {
            let cos = low + (high - low) * t * t;
            // Even light: twice the cosine.
            let (part, weight) = (shares_by(alpha, n, cos, rules), 4.0 * cos * (high - low) * t * weight);
            sum.reflected += weight * part.reflected;
            sum.transmitted += weight * part.transmitted;
            sum.lost += weight * part.lost;
        }
    }
    sum
}

fn shares_by(alpha: f64, [n_from, n_to]: [f64; 2], cos: f64, [along, around]: &[Rule; 2]) -> Shares {
    let rough = Rough { alpha, normal: DVec3::Z, n_from, n_to };
    let w = DVec3::new((1.0 - cos * cos).max(0.0).sqrt(), 0.0, -cos);
    let passes = |cos: f64| if cos > 0.0 { rough.unshadowed(cos) } else { 0.0 };
    let (mut reflected, mut transmitted) = (0.0, 0.0);
    for &(u, of_u) in along {
        for &(turns, of_turns) in around {
            let weight = 2.0 * of_u * of_turns;
            let met = refract(w, rough.facet(-w, u, turns), n_from, n_to);
            reflected += weight * met.reflectance * passes(met.reflected.z);
            if let Some(refracted) = met.refracted {
                transmitted += weight * (1.0 - met.reflectance) * passes(-refracted.z);
            }
        }
    }
    Shares { reflected, transmitted, lost: 1.0 - reflected - transmitted }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::philox::{philox4x32, unit, unit_fine};

    const WALLS: [(f64, f64, f64); 6] =
        [(0.02, 1.0, 1.4), (0.1, 1.4, 1.0), (0.3, 1.0, 1.4), (0.5, 1.5, 1.33), (1.0, 1.0, 2.5), (1.0, 1.4, 1.0)];

    /// Twice the nodes everywhere: 1 % of the loss.
    #[test]
    fn the_quadrature_has_converged() {
        for (alpha, from, to) in WALLS {
            let (coarse, fine) = (shares(alpha, [from, to]), shares_over(alpha, [from, to], NODES.map(|n| 2 * n)));
            assert!((coarse.lost - fine.lost).abs() < 1e-2 * fine.lost, "{alpha} {from} {to}: {coarse:?} {fine:?}");
        }
    }

    /// Helmholtz: of even light n^2 times what is let through is the same from both sides, to 5e-3 of it, the error of both quadratures.
    #[test]
    fn both_sides_let_the_same_through() {
        for (alpha, from, to) in WALLS {
            let [there, back] = [shares(alpha, [from, to]), shares(alpha, [to, from])].map(|s| s.transmitted);
            let ratio = there * from * from / (back * to * to);
            assert!((ratio - 1.0).abs() < 5e-3, "{alpha} {from} {to}: {there} {back}");
        }
    }

    /// Rays drawn one by one are lost as often: 5 sigma of 200,000, of which one more may be lost where hardly any are, and 2 % for the quadrature at one cosine.
    #[test]
    fn rays_are_lost_as_often() {
        let rays = 200_000;
        for (alpha, n_from, n_to) in WALLS {
            for cos in [0.1, 0.5, 1.0] {
                let rough = Rough { alpha, normal: DVec3::Z, n_from, n_to };
                let w = DVec3::new(f64::sqrt(1.0 - cos * cos), 0.0, -cos);
                let lost = (0..rays).filter(|&i| {
                    let [a, b, c, d] = philox4x32([i, 4, 2, 3], [5, 6]);
                    let [fate, ..] = philox4x32([i, 5, 2, 3], [5, 6]);
                    rough.sample(w, [unit_fine(a, d), unit(b), unit(c), unit(fate)]).is_none()
                });
                let (drawn, said) = (lost.count() as f64 / f64::from(rays), shares_at(alpha, [n_from, n_to], cos).lost);
                let sigma = ((said * (1.0 - said) + 1.0 / f64::from(rays)) / f64::from(rays)).sqrt();
                assert!(
                    (drawn - said).abs() < 5.0 * sigma + 0.02 * said,
                    "{alpha} {n_from} {n_to} at {cos}: {drawn} {said}"
                );
            }
        }
    }

    /// A wall that is nearly smooth loses next to nothing, one without a step of index nothing; more roughness loses more.
    #[test]
    fn losses_grow_with_roughness() {
        assert_eq!(lost_in_furnace(0.7, 1.4, 1.4), 0.0);
        let lost = [0.01, 0.03, 0.1, 0.3, 0.5, 1.0].map(|alpha| lost_in_furnace(alpha, 1.0, 1.4));
        assert!(lost[0] < 0.005 && lost.is_sorted() && lost[5] < 1.0, "{lost:?}");
    }
}
