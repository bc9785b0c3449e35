//! Phase functions: how scattering by a medium spreads directions.
//!
//! Everything that scatters light asks this type and never g alone; g alone gives the reduced scattering coefficient mu_s (1 - g).

use std::fmt;

use glam::DVec3;

use crate::Error;
use crate::henyey_greenstein as hg;

/// A phase function of the scattering angle alone, for unpolarised light in an isotropic medium.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PhaseFunction {
    /// Henyey and Greenstein, Astrophys. J. 93, 70 (1941); `g` in (-1, 1) is its mean cosine.
    HenyeyGreenstein { g: f64 },
    /// p = forward HG(g_forward) + (1 - forward) HG(g_backward): a forward peak, and what is scattered widely or backward.
    ///
    /// -1 < g_backward < g_forward < 1 and 0 < forward < 1. Source: Irvine, Astrophys. J. 142, 1563 (1965).
    TwoTermHenyeyGreenstein { g_forward: f64, g_backward: f64, forward: f64 },
}

impl PhaseFunction {
    /// Isotropic scattering.
    pub const ISOTROPIC: Self = Self::henyey_greenstein(0.0);

    /// That of Henyey and Greenstein with the mean cosine `g` in (-1, 1).
    pub const fn henyey_greenstein(g: f64) -> Self {
        Self::HenyeyGreenstein { g }
    }

    /// As [`Self::density`] integrates it: the share and the g of each Henyey-Greenstein function that it is made of, the most forward first. Shares add up to 1.
    #[inline(always)]
    pub const fn terms(&self) -> [(f64, f64); 2] {
        match *self {
            Self::HenyeyGreenstein { g } => [(1.0, g), (0.0, 0.0)],
            Self::TwoTermHenyeyGreenstein { g_forward, g_backward, forward } => {
                [(forward, g_forward), (1.0 - forward, g_backward)]
            }
        }
    }

    /// Whether it is Henyey and Greenstein's function alone.
    pub const fn has_one_term(&self) -> bool {
        matches!(self, Self::HenyeyGreenstein { .. })
    }

    /// Mean cosine of the scattering angle, in (-1, 1): mu_s' = mu_s (1 - g).
    #[inline(always)]
    pub fn g(&self) -> f64 {
        match *self {
            Self::HenyeyGreenstein { g } => g,
            Self::TwoTermHenyeyGreenstein { g_forward, g_backward, forward } => {
                forward * g_forward + (1.0 - forward) * g_backward
            }
        }
    }

    /// The g of its narrowest lobe towards where light was going.
    #[inline(always)]
    pub const fn g_forward(&self) -> f64 {
        self.terms()[0].1
    }

    /// Moment of Legendre of degree `l`: the mean of P_l(cos theta), 1 for l = 0 and g for l = 1. The g^l of each term.
    pub fn moment(&self, l: usize) -> f64 {
        let power = |g: f64| libm::pow(g, l as f64);
        match *self {
            Self::HenyeyGreenstein { g } => power(g),
            Self::TwoTermHenyeyGreenstein { g_forward, g_backward, forward } => {
                forward * power(g_forward) + (1.0 - forward) * power(g_backward)
            }
        }
    }

    /// Probability of scattering by theta, per steradian; integrates to 1 over the sphere.
    #[inline(always)]
    pub fn density(&self, cos: f64) -> f64 {
        match *self {
            Self::HenyeyGreenstein { g } => hg::density(g, cos),
            Self::TwoTermHenyeyGreenstein { g_forward, g_backward, forward } => {
                forward * hg::density(g_forward, cos) + (1.0 - forward) * hg::density(g_backward, cos)
            }
        }
    }

    /// p(a) / (p(a) + p(b)) of two cosines: the balance heuristic between a direction drawn about one axis and one drawn about another.
    #[inline(always)]
    pub fn balance(&self, a: f64, b: f64) -> f64 {
        match *self {
            // What both densities share cancels.
            Self::HenyeyGreenstein { g } => {
                let ratio = hg::denominator(g, a) / hg::denominator(g, b);
                1.0 / (1.0 + ratio * ratio.sqrt())
            }
            Self::TwoTermHenyeyGreenstein { .. } => {
                let (a, b) = (self.density(a), self.density(b));
                a / (a + b)
            }
        }
    }

    /// 1 - cos(theta) for a uniform u in (0, 1).
    #[inline(always)]
    pub fn sample_one_minus_cos(&self, u: f64) -> f64 {
        let (g, u) = self.choose(u);
        hg::sample_one_minus_cos(g, u)
    }

    /// A direction scattered from the unit vector `w`, for uniforms u in (0, 1) and `turns` in [0, 1) or [-1/2, 1/2).
    #[inline(always)]
    pub fn sample(&self, w: DVec3, u: f64, turns: f64) -> DVec3 {
        let (g, u) = self.choose(u);
        hg::sample(g, w, u, turns)
    }

    /// The term that a uniform u in (0, 1) chooses, by its g, and the uniform in (0, 1) that is left of u.
    ///
    /// Small u are the backward term's, so that u keeps its digits where either has its peak: at 1 forward, at 0 backward.
    #[inline(always)]
    fn choose(&self, u: f64) -> (f64, f64) {
        match *self {
            Self::HenyeyGreenstein { g } => (g, u),
            Self::TwoTermHenyeyGreenstein { g_forward, g_backward, forward } => {
                let backward = 1.0 - forward;
                if u < backward { (g_backward, u / backward) } else { (g_forward, 1.0 - (1.0 - u) / forward) }
            }
        }
    }

    /// Error: a parameter outside its range (a NaN is outside every range).
    pub fn check(&self) -> Result<(), Error> {
        const COSINE: &str = "lie in (-1, 1)";
        match *self {
            Self::HenyeyGreenstein { g } => Error::unless(g.abs() < 1.0, "g", g, "", COSINE),
            Self::TwoTermHenyeyGreenstein { g_forward, g_backward, forward } => {
                Error::unless(g_forward.abs() < 1.0, "g_forward", g_forward, "", COSINE)?;
                Error::unless(g_backward.abs() < 1.0, "g_backward", g_backward, "", COSINE)?;
                Error::unless(g_backward < g_forward, "g_backward", g_backward, "", "be less than g_forward")?;
                let share = "lie in (0, 1), the share of the forward term; one term alone is `g`";
                Error::unless(forward > 0.0 && forward < 1.0, "forward", forward, "", share)
            }
        }
    }
}

/// As in a pipeline file.
impl fmt::Display for PhaseFunction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::HenyeyGreenstein { g } => write!(f, "g = {g}"),
            Self::TwoTermHenyeyGreenstein { g_forward, g_backward, forward } => {
                write!(f, "two_term: {{g_forward: {g_forward}, g_backward: {g_backward}, forward: {forward}}}")
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use crate::philox::{philox4x32, unit, unit_fine};
    use crate::quadrature::{gauss_legendre, gauss_legendre_on};

    const fn two_term(g_forward: f64, g_backward: f64, forward: f64) -> PhaseFunction {
        PhaseFunction::TwoTermHenyeyGreenstein { g_forward, g_backward, forward }
    }

    const ALL: [PhaseFunction; 7] = [
        PhaseFunction::ISOTROPIC,
        PhaseFunction::henyey_greenstein(0.8),
        PhaseFunction::henyey_greenstein(-0.6),
        two_term(0.9, -0.3, 0.95),
        two_term(0.9, 0.2, 0.4),
        two_term(0.5, -0.9, 0.1),
        two_term(-0.2, -0.8, 0.7),
    ];

    /// It integrates to 1 and has the mean cosine g and the moments of Legendre that it says.
    ///
    /// Gauss's rule of 400 nodes is exact to degree 799: what it aliases of moments beyond, 0.9^(799 - 12), is below 1e-30; rounding of 400 terms stays below 1e-12.
    #[test]
    fn moments_are_those_of_the_density() {
        let rule = gauss_legendre(400);
        for phase in ALL {
            let mut moments = [0.0; 13];
            for &(cos, weight) in &rule {
                let p = 2.0 * PI * weight * phase.density(cos);
                let (mut before, mut legendre) = (0.0, 1.0);
                for (l, moment) in moments.iter_mut().enumerate() {
                    *moment += p * legendre;
                    let k = l as f64;
                    (before, legendre) = (legendre, ((2.0 * k + 1.0) * cos * legendre - k * before) / (k + 1.0));
                }
            }
            for (l, moment) in moments.into_iter().enumerate() {
                assert!((moment - phase.moment(l)).abs() < 1e-12, "{phase}, l = {l}: {moment}, {}", phase.moment(l));
            }
            assert!((phase.moment(0) - 1.0).abs() < 1e-15 && (phase.moment(1) - phase.g()).abs() < 1e-15, "{phase}");
        }
    }

    /// Samples fall into 40 intervals of the cosine as often as the density says, by 5 sigma of the binomial; 600 or more into each.
    #[test]
    fn samples_follow_the_density() {
        const N: u32 = 400_000;
        const CELLS: usize = 40;
        for phase in ALL {
            let mut found = vec![0_u32; CELLS];
            for i in 0..N {
                let [a, b, ..] = philox4x32([i, 7, 0, 0], [3, 4]);
                let cos = 1.0 - phase.sample_one_minus_cos(unit_fine(a, b));
                found[((cos + 1.0) / 2.0 * CELLS as f64).clamp(0.0, CELLS as f64 - 1.0) as usize] += 1;
            }
            for (cell, found) in found.into_iter().enumerate() {
                let edge = |k: usize| -1.0 + 2.0 * k as f64 / CELLS as f64;
                let rule = gauss_legendre_on(edge(cell), edge(cell + 1), 64);
                let p = rule.into_iter().map(|(cos, weight)| 2.0 * PI * weight * phase.density(cos)).sum::<f64>();
                let sigma = (p * (1.0 - p) * f64::from(N)).sqrt();
                let off = (f64::from(found) - p * f64::from(N)) / sigma;
                assert!(off.abs() < 5.0, "{phase}, from cos {}: {found}, {off} sigma off", edge(cell));
            }
        }
    }

    /// The direction turns by the angle that is drawn, and its weight against another is that of the densities.
    #[test]
    fn directions_and_weights_are_those_of_the_angle() {
        let w = DVec3::new(0.6, -0.64, -0.48);
        for phase in ALL {
            for i in 0..1000 {
                let [a, b, c, d] = philox4x32([i, 8, 0, 0], [3, 4]);
                let e = phase.sample(w, unit_fine(a, b), unit(c));
                let cos = 1.0 - phase.sample_one_minus_cos(unit_fine(a, b));
                assert!((e.dot(w) - cos).abs() < 1e-14, "{phase}: {} {cos}", e.dot(w));
                let other = 2.0 * unit(d) - 1.0;
                let (p, q) = (phase.density(cos), phase.density(other));
                assert!((phase.balance(cos, other) - p / (p + q)).abs() < 1e-12, "{phase}: {cos}, {other}");
            }
        }
    }

    #[test]
    fn what_is_none_is_refused() {
        assert!(ALL.iter().all(|phase| phase.check().is_ok()));
        let nan = f64::NAN;
        for (phase, name) in [
            (PhaseFunction::henyey_greenstein(1.0), "g = 1 "),
            (two_term(1.0, 0.0, 0.5), "g_forward = 1 "),
            (two_term(0.5, -1.0, 0.5), "g_backward = -1 "),
            (two_term(0.5, 0.5, 0.5), "g_backward = 0.5 must be less"),
            (two_term(0.5, 0.0, 0.0), "forward = 0 "),
            (two_term(0.5, 0.0, 1.0), "forward = 1 "),
            (two_term(0.5, 0.0, nan), "forward = NaN "),
            (two_term(nan, 0.0, 0.5), "g_forward = NaN "),
        ] {
            let error = phase.check().expect_err(name).to_string();
            assert!(error.starts_with(name), "{error}");
        }
    }
}
