//! The directions of the calculation.

use turbid_optics::fresnel::critical_cos;
use turbid_optics::quadrature::gauss_legendre_on;

use crate::incidence::Incidence;

/// N cosines in the slab, increasing, with weights for integrals over [0, 1], and the share of the incident light in each.
pub struct Directions<const N: usize> {
    /// Refractive index of the slab.
    pub n: f64,
    pub cosines: [f64; N],
    pub weights: [f64; N],
    /// 1 / sqrt(cosine).
    pub inverse_roots: [f64; N],
    /// Root of cosine times weight: flux = sum of `flux_root` times scaled radiance.
    pub flux_root: [f64; N],
    /// Shares of the incident flux in the air; their sum is 1.
    pub incident: [f64; N],
    /// 1 for the directions of the rule, 0 for one beside it.
    pub counted: [f64; N],
    /// Legendre moments of the phase function that the rule bears.
    pub terms: usize,
}

/// Weight of the direction of an oblique beam. It stands beside a full rule, so its weight is an error of that size; the
/// beam's radiance is 1 / weight, which costs digits the other way: derivatives keep 1e-15 N / sqrt(weight).
const BESIDE: f64 = 1e-9;

impl<const N: usize> Directions<N> {
    /// For a slab of index `n` under light as [`Incidence::checked`].
    ///
    /// Matched slab: Gauss-Radau, the last direction along the normal. Otherwise Gauss below the critical cosine, where all
    /// light is reflected, and above it Radau in the cosine in air: there Fresnel's reflectance has no square-root corner.
    /// A cone cuts the rule at its edge.
    pub fn new(n: f64, light: Incidence) -> Self {
        let inside = |angle: f64| refracted(n, (libm::cos(angle), 0.0)).0;
        let mut terms = if n == 1.0 { 2 * N } else { 5 * N / 4 };
        // (cosine, weight, share of the incident flux, counted)
        let mut rule: Vec<(f64, f64, f64, f64)> = match light {
            Incidence::Normal => {
                full_rule(n, N).into_iter().map(|(x, w)| (x, w, if x == 1.0 { 1.0 } else { 0.0 }, 1.0)).collect()
            }
            Incidence::Diffuse => {
                let share = |x, w| if x > critical_cos(n) { 2.0 * n * n * x * w } else { 0.0 };
                full_rule(n, N).into_iter().map(|(x, w)| (x, w, share(x, w), 1.0)).collect()
            }
            Incidence::Oblique(angle) => {
                terms = if n == 1.0 { 2 * (N - 1) } else { 5 * (N - 1) / 4 };
                let beam = (inside(angle), BESIDE, 1.0, 0.0);
                full_rule(n, N - 1).into_iter().map(|(x, w)| (x, w, 0.0, 1.0)).chain([beam]).collect()
            }
            Incidence::Cone(angle) => {
                terms = N;
                let edge = inside(angle);
                let rule = cut_rule(n, N, angle);
                let total = rule.iter().filter(|node| node.0 > edge).fold(0.0, |sum, (x, w)| sum + x * w);
                let share = |x, w| if x > edge { x * w / total } else { 0.0 };
                rule.into_iter().map(|(x, w)| (x, w, share(x, w), 1.0)).collect()
            }
        };
        rule.sort_by(|a, b| a.0.total_cmp(&b.0));
        let rule: [(f64, f64, f64, f64); N] = rule.try_into().expect("a rule of N directions");
        Self {
            n,
            cosines: rule.map(|r| r.0),
            weights: rule.map(|r| r.1),
            inverse_roots: rule.map(|r| 1.0 / r.0.sqrt()),
            flux_root: rule.map(|r| (r.0 * r.1).sqrt()),
            incident: rule.map(|r| r.2),
            counted: rule.map(|r| r.3),
            terms,
        }
    }

    /// Sum over the incident light.
    pub fn over_incident(&self, value: impl Fn(usize) -> f64) -> f64 {
        (0..N).filter(|&i| self.incident[i] > 0.0).map(|i| self.incident[i] * value(i)).fold(0.0, |sum, x| sum + x)
    }
}

/// A node in the cosine in air as one in the cosine in the slab: n^2 cos d cos = cos_air d cos_air.
fn refracted(n: f64, (x, w): (f64, f64)) -> (f64, f64) {
    let cos = (1.0 - (1.0 - x * x) / (n * n)).sqrt();
    if n == 1.0 { (x, w) } else { (cos, w * x / (n * n * cos)) }
}

fn trapped(n: f64, count: usize) -> usize {
    if n == 1.0 { 0 } else { 3 * count / 8 }
}

fn full_rule(n: f64, count: usize) -> Vec<(f64, f64)> {
    let trapped = trapped(n, count);
    let mut rule = Vec::new();
    if trapped > 0 {
        rule = gauss_legendre_on(0.0, critical_cos(n), trapped);
    }
    rule.extend(radau(count - trapped).into_iter().map(|node| refracted(n, node)));
    rule
}

/// Gauss on either side of the cone's edge; each side has its share of the angles, but at least a quarter.
fn cut_rule(n: f64, count: usize, angle: f64) -> Vec<(f64, f64)> {
    let trapped = trapped(n, count);
    let open = count - trapped;
    let share = angle / std::f64::consts::FRAC_PI_2;
    let least = open.div_ceil(4);
    let lit = ((open as f64 * share).round() as usize).clamp(least, open - least);
    let edge = libm::cos(angle);
    let mut rule = Vec::new();
    if trapped > 0 {
        rule = gauss_legendre_on(0.0, critical_cos(n), trapped);
    }
    rule.extend(gauss_legendre_on(0.0, edge, open - lit).into_iter().map(|node| refracted(n, node)));
    rule.extend(gauss_legendre_on(edge, 1.0, lit).into_iter().map(|node| refracted(n, node)));
    rule
}

/// The n-point Gauss-Radau rule on [0, 1] with a node at 1, increasing; exact to degree 2n - 2.
fn radau(n: usize) -> Vec<(f64, f64)> {
    if n == 1 {
        return vec![(1.0, 1.0)];
    }
    // Nodes on [-1, 1] with one at -1 are the zeros of (P_{n-1} + P_n) / (1 + x); mirrored here.
    let value = |x: f64| {
        let (mut before, mut p) = (1.0, x);
        let (mut slope_before, mut slope) = (0.0, 1.0);
        for l in 2..=n {
            let l = l as f64;
            let next = ((2.0 * l - 1.0) * x * p - (l - 1.0) * before) / l;
            let next_slope = slope_before + (2.0 * l - 1.0) * p;
            (before, p) = (p, next);
            (slope_before, slope) = (slope, next_slope);
        }
        (before, (before + p) / (1.0 + x), (slope_before + slope) / (1.0 + x) - (before + p) / ((1.0 + x) * (1.0 + x)))
    };
    let count = n as f64;
    let mut rule = vec![(1.0, 1.0 / (count * count))];
    let mut found: Vec<f64> = Vec::new();
    for i in 0..n - 1 {
        let mut x = libm::cos(std::f64::consts::PI * 2.0 * (i as f64 + 0.5 + 0.25) / (2.0 * count - 1.0 + 0.5));
        for _ in 0..100 {
            let (_, f, slope) = value(x);
            // Newton with the zeros already found divided out: it cannot return to one of them.
            let pushed: f64 = found.iter().map(|z| 1.0 / (x - z)).sum();
            let step = f / (slope - f * pushed);
            x -= step;
            if step.abs() <= 1e-16 {
                break;
            }
        }
        found.push(x);
        let p = value(x).0;
        rule.push((0.5 * (1.0 - x), 0.5 * (1.0 - x) / (count * count * p * p)));
    }
    rule.sort_by(|a, b| a.0.total_cmp(&b.0));
    rule
}

#[cfg(test)]
mod tests {
    use super::*;

    /// int x^d over [0, 1] = 1 / (d + 1) up to degree 2n - 2; 1e-14: n roundings.
    #[test]
    fn radau_is_exact_for_polynomials() {
        for n in [1, 2, 3, 8, 33, 64] {
            let rule = radau(n);
            assert!(rule.is_sorted_by(|a, b| a.0 < b.0) && rule[n - 1].0 == 1.0);
            for d in [0, 1, n - 1, 2 * n - 2] {
                let sum = rule.iter().fold(0.0, |sum, &(x, w)| sum + w * libm::pow(x, d as f64));
                assert!(
                    (sum * (d as f64 + 1.0) - 1.0).abs() < 3e-14 * n as f64 || d > 2 * n - 2,
                    "n = {n}, d = {d}: {sum}"
                );
            }
        }
    }

    /// Over all directions cos integrates to 1 / 2 and a diffuse flux from air to 1 (exactly: the rule is one in the
    /// cosine in air); so do the shares of any light.
    #[test]
    fn nodes_hold_the_diffuse_flux() {
        for n in [1.0f64, 1.0001, 1.4, 3.0] {
            for light in [Incidence::Normal, Incidence::Diffuse, Incidence::Cone(0.1), Incidence::Cone(1.2)] {
                let rule = Directions::<16>::new(n, light);
                let total = (0..16).fold(0.0, |sum, i| sum + rule.cosines[i] * rule.weights[i]);
                let free = (0..16)
                    .filter(|&i| rule.cosines[i] > critical_cos(n))
                    .fold(0.0, |sum, i| sum + 2.0 * n * n * rule.cosines[i] * rule.weights[i]);
                assert!((total - 0.5).abs() < 1e-14 && (free - 1.0).abs() < 1e-14, "n = {n}: {total} {free}");
                let shares = rule.over_incident(|_| 1.0);
                assert!((shares - 1.0).abs() < 1e-14 && rule.cosines.is_sorted(), "n = {n}, {light:?}: {shares}");
            }
        }
    }
}
