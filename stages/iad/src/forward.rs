//! Reflectance and transmittance of a scattering slab, from the modes of its discrete ordinates.
//!
//! Doubling computes the exponential of the transfer matrix by squaring, and pays for it with rounding at large depth
//! and with work that grows with it. Here the same exponential is taken in closed form: with s = I+ + I- and
//! d = I+ - I-, both scaled by the root of cosine times weight, s' = -U d and d' = -V s; U and V are symmetric and not
//! negative. U = C C^T and V = G G^T, and the singular values k and vectors q of G^T C give the modes s = C q, which
//! run as cosh kz and sinh kz from the middle of the slab. What is left is one positive definite system for the light
//! that is even about the middle and one for the odd light. Nothing is subtracted that could cancel: depth 1e-12 and
//! infinity, albedo 0 and 1 are ordinary cases.

#![allow(clippy::needless_range_loop, reason = "rows and columns of one matrix")]

use crate::Error;
use crate::angles::{Coupling, nodes};
use crate::matrix::{Matrix, cholesky, cholesky_of_sums, dot, forward_substitute, orthogonalise, solve, zeros};
use crate::slab::{Slab, Surface, unscattered};

/// Where the light that falls on the top of a slab goes, as fractions; specular reflection included.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Response {
    /// Total reflectance and transmittance for a beam along the normal.
    pub ur1: f64,
    pub ut1: f64,
    /// Total reflectance and transmittance for diffuse (Lambertian) light.
    pub uru: f64,
    pub utu: f64,
    /// The part of `ur1` and of `ut1` that was never scattered.
    pub ur1_unscattered: f64,
    pub ut1_unscattered: f64,
    /// Absorbed in the slab (not in slides), of the beam and of diffuse light; relative accuracy kept however small.
    pub absorbed: f64,
    pub absorbed_diffuse: f64,
}

/// Optical depths of a slab: what absorbs, and what scatters outside the peak of the phase function.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Depths {
    /// Shares of absorption and scattering; their sum is 1.
    absorb: f64,
    scatter: f64,
    /// Both together; may be infinite.
    total: f64,
    /// Optical thickness with the peak, which decides what is left unscattered.
    tau: f64,
}

/// The forward model with N quadrature points (4 to 64): all that depends on the slab but not on its coefficients.
pub struct Plan<const N: usize> {
    slab: Slab,
    coupling: Coupling<N>,
    weights: [f64; N],
    /// 1 / sqrt(cosine).
    inverse_roots: [f64; N],
    /// Root of cosine times weight: flux = sum of `flux_root` times scaled radiance.
    flux_root: [f64; N],
    top: [Surface; N],
    bottom: [Surface; N],
    /// Share of diffuse light that the top reflects before it enters.
    diffuse_outside: f64,
}

/// A slab of n > 1 thinner than this is interpolated.
const THIN: f64 = 1e-9;
/// Below this tanh x = x to the last bit.
const SMALL: f64 = 1e-9;

impl<const N: usize> Plan<N> {
    const CHECKED: () = assert!(N >= 4 && N <= 64, "4 to 64 quadrature points");

    /// Fails on a slab that cannot be: n < 1, |g| >= 1, a thickness that is not above 0.
    pub fn new(slab: &Slab) -> Result<Self, Error> {
        const { Self::CHECKED };
        slab.check()?;
        let rule = nodes::<N>(slab.n);
        let cosines = rule.map(|(x, _)| x);
        let weights = rule.map(|(_, w)| w);
        let top = cosines.map(|x| Surface::new(slab.n, slab.top, x));
        let bottom = cosines.map(|x| Surface::new(slab.n, slab.bottom, x));
        let diffuse_outside = (0..N)
            .filter(|&i| top[i].through > 0.0)
            .map(|i| 2.0 * slab.n * slab.n * cosines[i] * weights[i] * top[i].outside)
            .fold(0.0, |sum, x| sum + x);
        let plan = Self {
            slab: *slab,
            coupling: Coupling::new(&rule, slab.n, slab.g),
            weights,
            inverse_roots: cosines.map(|x| 1.0 / x.sqrt()),
            flux_root: rule.map(|(x, w)| (x * w).sqrt()),
            top,
            bottom,
            diffuse_outside,
        };
        // Both matrices are mixtures of a positive diagonal and these: positive at albedo 1 means positive everywhere.
        let resolved = cholesky(plan.odd_matrix(1.0)).is_some() && plan.even_factor(1e-200, 1.0).is_some();
        if !resolved {
            return Err(Error::Unresolved { points: N });
        }
        Ok(plan)
    }

    /// U at this share of scattering, times the depth.
    fn odd_matrix(&self, scatter: f64) -> Matrix<N> {
        let coupling = &self.coupling;
        let backward = if self.slab.g < 0.0 { scatter * 2.0 * coupling.peak / coupling.rest } else { 0.0 };
        std::array::from_fn(|i| {
            std::array::from_fn(|j| {
                let diagonal = if i == j { 1.0 + backward } else { 0.0 };
                (diagonal - scatter * coupling.odd[i][j]) * self.inverse_roots[i] * self.inverse_roots[j]
            })
        })
    }

    /// The transposed factor of V before its scaling by [`Self::flux_root`].
    fn even_factor(&self, absorb: f64, scatter: f64) -> Option<Matrix<N>> {
        cholesky_of_sums(self.coupling.even.map(|row| row.map(|x| scatter * x)), self.weights.map(|w| absorb * w))
    }

    pub fn slab(&self) -> &Slab {
        &self.slab
    }

    /// The response at the coefficients mu_a and mu_s' = mu_s (1 - g), mm^-1, both >= 0.
    pub fn forward(&self, mu_a: f64, mu_s_prime: f64) -> Result<Response, Error> {
        for (name, value) in [("mu_a", mu_a), ("mu_s'", mu_s_prime)] {
            if !value.is_finite() {
                return Err(Error::NotFinite { name });
            }
            if value < 0.0 {
                return Err(Error::Range { name, value, must: "be >= 0" });
            }
        }
        self.respond(self.depths(mu_a, mu_s_prime)).ok_or(Error::Unresolved { points: N })
    }

    /// The response at albedo mu_s / (mu_a + mu_s) in [0, 1] and optical thickness `tau` in [0, infinity], whatever the
    /// slab's thickness in mm.
    pub fn forward_optical(&self, albedo: f64, tau: f64) -> Result<Response, Error> {
        if !(0.0..=1.0).contains(&albedo) {
            return Err(Error::Range { name: "albedo", value: albedo, must: "lie in [0, 1]" });
        }
        if tau < 0.0 || tau.is_nan() {
            return Err(Error::Range { name: "tau", value: tau, must: "be >= 0" });
        }
        let scatter = albedo * self.coupling.rest;
        let sum = (1.0 - albedo) + scatter;
        let total = if tau == 0.0 { 0.0 } else { tau * sum };
        self.respond(Depths { absorb: (1.0 - albedo) / sum, scatter: scatter / sum, total, tau })
            .ok_or(Error::Unresolved { points: N })
    }

    pub(crate) fn depths(&self, mu_a: f64, mu_s_prime: f64) -> Depths {
        let mu_s = mu_s_prime / (1.0 - self.slab.g);
        let scatter = mu_s * self.coupling.rest;
        let sum = mu_a + scatter;
        if sum == 0.0 {
            return Depths { absorb: 1.0, scatter: 0.0, total: 0.0, tau: 0.0 };
        }
        let d = self.slab.thickness_mm;
        Depths { absorb: mu_a / sum, scatter: scatter / sum, total: sum * d, tau: (mu_a + mu_s) * d }
    }

    /// A half-space with mu_a / mu_s' = `ratio`.
    pub(crate) fn half_space(&self, ratio: f64) -> Depths {
        Depths { total: f64::INFINITY, tau: f64::INFINITY, ..self.depths(ratio, 1.0) }
    }

    /// `None` where the quadrature fails, as for all that follows from it.
    pub(crate) fn respond(&self, depths: Depths) -> Option<Response> {
        let (ur1_unscattered, ut1_unscattered) = unscattered(&self.slab, 1.0, depths.tau);
        let [beam, diffuse] = self.light(&depths, [self.beam(), self.diffuse()])?;
        Some(Response {
            ur1: self.top[N - 1].outside + beam.reflected,
            ut1: beam.transmitted,
            uru: self.diffuse_outside + diffuse.reflected,
            utu: diffuse.transmitted,
            ur1_unscattered,
            ut1_unscattered,
            absorbed: beam.absorbed,
            absorbed_diffuse: diffuse.absorbed,
        })
    }

    /// [UR1, UT1, absorbed].
    pub(crate) fn respond_to_beam(&self, depths: Depths) -> Option<[f64; 3]> {
        let [light] = self.light(&depths, [self.beam()])?;
        Some([self.top[N - 1].outside + light.reflected, light.transmitted, light.absorbed])
    }

    fn light<const K: usize>(&self, depths: &Depths, incident: [[f64; N]; K]) -> Option<[Light; K]> {
        if self.slab.n == 1.0 || depths.total >= THIN {
            let modes = Modes::new(self, depths)?;
            return Some(incident.map(|x| modes.light(self, &x)));
        }
        // Light beyond the critical angle has no way out of an empty slab, so the systems become singular: a straight
        // line between the empty slab and a thin one, exact to the square of its depth.
        let modes = Modes::new(self, &Depths { total: THIN, ..*depths })?;
        let share = depths.total / THIN;
        Some(incident.map(|x| self.empty(&x).towards(&modes.light(self, &x), share)))
    }

    /// What a slab without depth does to the light.
    fn empty(&self, incident: &[f64; N]) -> Light {
        let mut light = Light { reflected: 0.0, transmitted: 0.0, absorbed: 0.0 };
        for i in (0..N).filter(|&i| self.top[i].through > 0.0) {
            let (top, bottom) = (self.top[i], self.bottom[i]);
            let flux = self.flux_root[i] * incident[i] / (1.0 - top.inside * bottom.inside);
            light.reflected += flux * bottom.inside * top.through;
            light.transmitted += flux * bottom.through;
        }
        light
    }

    /// Scaled radiance just inside the top, for unit flux along the normal.
    fn beam(&self) -> [f64; N] {
        let mut incident = [0.0; N];
        incident[N - 1] = self.top[N - 1].through / self.flux_root[N - 1];
        incident
    }

    /// The same for unit Lambertian flux.
    fn diffuse(&self) -> [f64; N] {
        let n2 = self.slab.n * self.slab.n;
        std::array::from_fn(|i| 2.0 * n2 * self.flux_root[i] * self.top[i].through)
    }
}

/// What leaves the slab on either side and what stays, of one incident light.
struct Light {
    reflected: f64,
    transmitted: f64,
    absorbed: f64,
}

impl Light {
    /// Between `self` (share 0) and `other` (share 1).
    fn towards(&self, other: &Self, share: f64) -> Self {
        let between = |a: f64, b: f64| a + (b - a) * share;
        Self {
            reflected: between(self.reflected, other.reflected),
            transmitted: between(self.transmitted, other.transmitted),
            absorbed: between(self.absorbed, other.absorbed),
        }
    }
}

/// The modes of one slab and the factors of the systems for even and odd light.
struct Modes<const N: usize> {
    /// Row j: mode j of s.
    s: Matrix<N>,
    /// Slope d / s of each even mode at the surface.
    even: [f64; N],
    /// k / sinh(2kh): what a mode carries from one surface to the other.
    across: [f64; N],
    /// Factor of the odd system, of the even system (with the odd one eliminated), and of that of the far side.
    odd_factor: Matrix<N>,
    even_factor: Matrix<N>,
    far_factor: Matrix<N>,
    /// Coupling of even and odd light where top and bottom differ, with the odd factor taken off.
    mixing: Option<Matrix<N>>,
    /// For fluxes: mode j of d against the top's transmitted flux, and the share of each mode that is absorbed.
    slope_of_flux: [f64; N],
    absorbed: [f64; N],
}

/// (1 - r) / (1 + r) at each node.
fn resistance<const N: usize>(surface: &[Surface; N]) -> [f64; N] {
    surface.map(|s| (1.0 - s.inside) / (1.0 + s.inside))
}

impl<const N: usize> Modes<N> {
    fn new(plan: &Plan<N>, depths: &Depths) -> Option<Self> {
        // Conservation is a limit, reached to the last bit long before this; and a slab without depth likewise.
        let absorb = depths.absorb.max(1e-200);
        let scatter = depths.scatter;
        let half = 0.5 * depths.total.max(1e-280);
        let c = cholesky(plan.odd_matrix(scatter))?;
        let g = plan.even_factor(absorb, scatter)?;

        // Rows: columns of C^T G, G scaled from weights to roots of cosine times weight (and V's 1/cosine).
        let mut modes: Matrix<N> = zeros();
        for j in 0..N {
            let mut column = [0.0; N];
            for i in j..N {
                column[i] = g[j][i] / plan.flux_root[i];
            }
            for i in 0..N {
                modes[j][i] = dot(&c[i], &column);
            }
        }
        let k = orthogonalise(&mut modes);
        // s = C q.
        let mut s: Matrix<N> = zeros();
        for (mode, q) in s.iter_mut().zip(&modes) {
            for (factor, &q) in c.iter().zip(q) {
                for (x, &entry) in mode.iter_mut().zip(factor) {
                    *x += q * entry;
                }
            }
        }

        let (mut even, mut odd, mut across, mut absorbed) = ([0.0; N], [0.0; N], [0.0; N], [0.0; N]);
        let bulk: [f64; N] = std::array::from_fn(|i| plan.weights[i] / plan.flux_root[i]);
        for j in 0..N {
            let x = k[j] * half;
            let share;
            if x < SMALL {
                (share, odd[j], across[j]) = (half, 1.0 / half, 0.5 / half);
            } else {
                let tanh = libm::tanh(x);
                (share, odd[j]) = (tanh / k[j], k[j] / tanh);
                across[j] = if x > 350.0 { 0.0 } else { k[j] / libm::sinh(2.0 * x) };
            }
            even[j] = k[j] * k[j] * share;
            absorbed[j] = if depths.absorb > 0.0 { 2.0 * depths.absorb * dot(&bulk, &s[j]) * share } else { 0.0 };
        }

        let (top, bottom) = (resistance(&plan.top), resistance(&plan.bottom));
        let far = project(&s, &bottom);
        let same = plan.slab.top == plan.slab.bottom;
        let mean = if same { far } else { project(&s, &std::array::from_fn(|i| 0.5 * (top[i] + bottom[i]))) };
        let odd_factor = cholesky(with_diagonal(mean, &odd))?;
        let mut rest = with_diagonal(mean, &even);
        let mixing = (!same).then(|| {
            let difference = project(&s, &std::array::from_fn(|i| 0.5 * (top[i] - bottom[i])));
            // Symmetric, so rows serve as columns.
            let reduced = difference.map(|row| forward_substitute(&odd_factor, &row));
            for i in 0..N {
                for j in 0..N {
                    rest[i][j] -= dot(&reduced[i], &reduced[j]);
                }
            }
            difference
        });
        let even_factor = cholesky(rest)?;
        let along: [f64; N] = std::array::from_fn(|j| 0.5 * (even[j] + odd[j]));
        let far_factor = cholesky(with_diagonal(far, &along))?;

        let out: [f64; N] = std::array::from_fn(|i| plan.flux_root[i] * plan.top[i].through);
        let slope = solve(&c, &out);
        let slope_of_flux = std::array::from_fn(|j| dot(&s[j], &slope));
        Some(Self { s, even, across, odd_factor, even_factor, far_factor, mixing, slope_of_flux, absorbed })
    }

    fn light(&self, plan: &Plan<N>, incident: &[f64; N]) -> Light {
        let bottom = resistance(&plan.bottom);
        let drive: [f64; N] = std::array::from_fn(|i| incident[i] / (1.0 + plan.top[i].inside));
        let drive: [f64; N] = std::array::from_fn(|j| dot(&self.s[j], &drive));
        // Even and odd amplitudes.
        let (even, odd) = match &self.mixing {
            None => (solve(&self.even_factor, &drive), solve(&self.odd_factor, &drive)),
            Some(mixing) => {
                let alone = solve(&self.odd_factor, &drive);
                let even = solve(&self.even_factor, &std::array::from_fn(|i| drive[i] - dot(&mixing[i], &alone)));
                let odd = solve(&self.odd_factor, &std::array::from_fn(|i| drive[i] - dot(&mixing[i], &even)));
                (even, odd)
            }
        };
        // The far side from the near one, not as even - odd: that would cancel in a deep slab.
        let carried: [f64; N] = std::array::from_fn(|j| self.across[j] * (even[j] + odd[j]));
        let far = solve(&self.far_factor, &carried);
        let [s_even, s_odd, s_far] = [even, odd, far].map(|amplitudes| {
            let mut s = [0.0; N];
            for (mode, a) in self.s.iter().zip(amplitudes) {
                for (x, &entry) in s.iter_mut().zip(mode) {
                    *x += a * entry;
                }
            }
            s
        });
        let (mut reflected, mut transmitted) = (0.0, 0.0);
        for i in 0..N {
            let root = plan.flux_root[i];
            // (s - d) / 2 with the boundary's condition put in: no difference of near-equal terms in a thin slab.
            let up = 0.5 * ((1.0 - bottom[i]) * s_even[i] + (1.0 + bottom[i]) * s_odd[i]);
            reflected += root * plan.top[i].through * up;
            transmitted += root * plan.bottom[i].through * 0.5 * (1.0 + bottom[i]) * s_far[i];
        }
        let mut absorbed = 0.0;
        for j in 0..N {
            reflected -= self.slope_of_flux[j] * self.even[j] * even[j];
            absorbed += self.absorbed[j] * even[j];
        }
        Light { reflected, transmitted, absorbed }
    }
}

/// s^T diag(r) s in the modes' own numbering.
fn project<const N: usize>(s: &Matrix<N>, r: &[f64; N]) -> Matrix<N> {
    let mut product = zeros();
    for i in 0..N {
        let scaled: [f64; N] = std::array::from_fn(|l| r[l] * s[i][l]);
        for j in 0..=i {
            let value = dot(&scaled, &s[j]);
            product[i][j] = value;
            product[j][i] = value;
        }
    }
    product
}

fn with_diagonal<const N: usize>(mut a: Matrix<N>, diagonal: &[f64; N]) -> Matrix<N> {
    for i in 0..N {
        a[i][i] += diagonal[i];
    }
    a
}
