//! The modes of one homogeneous slab in closed form, and the light that runs in them.
//!
//! Doubling computes the exponential of the transfer matrix by squaring, and pays for it with rounding at large depth
//! and with work that grows with it. Here the same exponential is taken in closed form: with s = I+ + I- and
//! d = I+ - I-, both scaled by the root of cosine times weight, s' = -U d and d' = -V s; U and V are symmetric and not
//! negative. U = C C^T and V = G G^T, and the singular values k and vectors q of G^T C give the modes s = C q, which
//! run as cosh kz and sinh kz from the middle of the slab. What is left is one positive definite system for the light
//! that is even about the middle and one for the odd light. Nothing is subtracted that could cancel: depth 1e-12 and
//! infinity, albedo 0 and 1 are ordinary cases.

#![allow(clippy::needless_range_loop, reason = "rows and columns of one matrix")]

use crate::angles::Directions;
use crate::cholesky::Cholesky;
use crate::coupling::Coupling;
use crate::matrix::{Matrix, dot, zeros};
use crate::rotations::orthogonalise;
use crate::slab::{Slide, Surface};

/// Optical depths of a slab: what absorbs, and what scatters outside the peak of the phase function.
#[derive(Clone, Copy, Debug)]
pub struct Depths {
    /// Shares of absorption and scattering; their sum is 1.
    pub absorb: f64,
    pub scatter: f64,
    /// Both together; may be infinite.
    pub total: f64,
    /// Optical thickness with the peak, which decides what is left unscattered.
    pub tau: f64,
}

impl Depths {
    /// Of mu_a, mu_s' (mm^-1) over `d` mm at anisotropy `g`, where the share `rest` of scattering is outside the peak.
    pub fn new(mu_a: f64, mu_s_prime: f64, g: f64, rest: f64, d: f64) -> Self {
        let mu_s = mu_s_prime / (1.0 - g);
        let scatter = mu_s * rest;
        let sum = mu_a + scatter;
        if sum == 0.0 {
            return Self { absorb: 1.0, scatter: 0.0, total: 0.0, tau: 0.0 };
        }
        Self { absorb: mu_a / sum, scatter: scatter / sum, total: sum * d, tau: (mu_a + mu_s) * d }
    }
}

/// What the two surfaces do to light in each direction.
pub struct Sides<const N: usize> {
    pub top: [Surface; N],
    pub bottom: [Surface; N],
    /// Both are the same: even and odd light do not mix.
    pub same: bool,
}

impl<const N: usize> Sides<N> {
    pub fn new(directions: &Directions<N>, top: Slide, bottom: Slide) -> Self {
        let of = |slide| directions.cosines.map(|x| Surface::new(directions.n, slide, x));
        Self { top: of(top), bottom: of(bottom), same: top == bottom }
    }

    /// None: the medium goes on.
    pub fn open() -> Self {
        let open = [Surface { inside: 0.0, outside: 0.0, through: 1.0 }; N];
        Self { top: open, bottom: open, same: true }
    }
}

/// Below this tanh x = x to the last bit.
const SMALL: f64 = 1e-9;

/// What leaves a slab on either side and what stays, of one incident light.
#[derive(Clone, Copy)]
pub struct Light {
    pub reflected: f64,
    pub transmitted: f64,
    pub absorbed: f64,
}

impl Light {
    /// Between `self` (share 0) and `other` (share 1).
    pub fn towards(&self, other: &Self, share: f64) -> Self {
        let between = |a: f64, b: f64| a + (b - a) * share;
        Self {
            reflected: between(self.reflected, other.reflected),
            transmitted: between(self.transmitted, other.transmitted),
            absorbed: between(self.absorbed, other.absorbed),
        }
    }

    /// What a slab without depth does to scaled radiance `incident` just inside the top.
    pub fn through_empty<const N: usize>(directions: &Directions<N>, sides: &Sides<N>, incident: &[f64; N]) -> Self {
        let mut light = Self { reflected: 0.0, transmitted: 0.0, absorbed: 0.0 };
        for i in (0..N).filter(|&i| sides.top[i].through > 0.0) {
            let (top, bottom) = (sides.top[i], sides.bottom[i]);
            let flux = directions.flux_root[i] * incident[i] / (1.0 - top.inside * bottom.inside);
            light.reflected += flux * bottom.inside * top.through;
            light.transmitted += flux * bottom.through;
        }
        light
    }
}

/// Amplitudes of the modes: even and odd about the middle, and their sum on the far side.
pub struct Amplitudes<const N: usize> {
    pub even: [f64; N],
    pub odd: [f64; N],
    pub far: [f64; N],
}

/// The modes of one slab and the factors of the systems for even and odd light.
pub struct Modes<const N: usize> {
    /// Row j: mode j of s.
    pub s: Matrix<N>,
    /// Row j: mode j in the coordinates in which U = 1.
    q: Matrix<N>,
    /// The factor of U.
    c: Cholesky<N>,
    /// Decay constants, per unit depth.
    pub k: [f64; N],
    pub half: f64,
    /// Slope d / s of each even and odd mode at the surface, k tanh(kh) and k coth(kh).
    pub even: [f64; N],
    pub odd: [f64; N],
    /// k / sinh(2kh): what a mode carries from one surface to the other.
    pub across: [f64; N],
    /// Factor of the odd system, of the even system (with the odd one eliminated), and of that of the far side.
    odd_factor: Cholesky<N>,
    even_factor: Cholesky<N>,
    far_factor: Cholesky<N>,
    /// Coupling of even and odd light where top and bottom differ, with the odd factor taken off.
    mixing: Option<Matrix<N>>,
    /// For fluxes: mode j of d against the top's transmitted flux, and the share of each mode that is absorbed.
    slope_of_flux: [f64; N],
    pub absorbed: [f64; N],
}

/// (1 - r) / (1 + r) at each node.
fn resistance<const N: usize>(surface: &[Surface; N]) -> [f64; N] {
    surface.map(|s| (1.0 - s.inside) / (1.0 + s.inside))
}

impl<const N: usize> Modes<N> {
    pub fn new(directions: &Directions<N>, coupling: &Coupling<N>, sides: &Sides<N>, depths: &Depths) -> Option<Self> {
        // Conservation is a limit, reached to the last bit long before this; and a slab without depth likewise.
        let absorb = depths.absorb.max(1e-200);
        let scatter = depths.scatter;
        let half = 0.5 * depths.total.max(1e-280);
        let c = Cholesky::new(coupling.odd_matrix(directions, scatter))?;
        let g = coupling.even_factor(directions, absorb, scatter)?;

        // Rows: columns of C^T G, G scaled from weights to roots of cosine times weight (and V's 1/cosine).
        let mut q: Matrix<N> = zeros();
        for j in 0..N {
            let mut column = [0.0; N];
            for i in j..N {
                column[i] = g[j][i] / directions.flux_root[i];
            }
            for i in 0..N {
                q[j][i] = dot(&c.columns[i], &column);
            }
        }
        // A direction of hardly any weight, a beam's beside the rule or those of a narrow cone, makes entries of very unlike size.
        let k = orthogonalise(&mut q, directions.weights.iter().any(|w| *w < 1e-5));
        // s = C q.
        let mut s: Matrix<N> = zeros();
        for (mode, q) in s.iter_mut().zip(&q) {
            for (factor, &q) in c.columns.iter().zip(q) {
                for (x, &entry) in mode.iter_mut().zip(factor) {
                    *x += q * entry;
                }
            }
        }

        let (mut even, mut odd, mut across, mut absorbed) = ([0.0; N], [0.0; N], [0.0; N], [0.0; N]);
        let bulk: [f64; N] = std::array::from_fn(|i| directions.weights[i] / directions.flux_root[i]);
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

        let (top, bottom) = (resistance(&sides.top), resistance(&sides.bottom));
        let far = project(&s, &bottom);
        let mean = if sides.same { far } else { project(&s, &std::array::from_fn(|i| 0.5 * (top[i] + bottom[i]))) };
        let odd_factor = Cholesky::new(with_diagonal(mean, &odd))?;
        let mut rest = with_diagonal(mean, &even);
        let mixing = (!sides.same).then(|| {
            let difference = project(&s, &std::array::from_fn(|i| 0.5 * (top[i] - bottom[i])));
            // Symmetric, so rows serve as columns.
            let reduced = difference.map(|row| odd_factor.forward(&row));
            for i in 0..N {
                for j in 0..N {
                    rest[i][j] -= dot(&reduced[i], &reduced[j]);
                }
            }
            difference
        });
        let even_factor = Cholesky::new(rest)?;
        let along: [f64; N] = std::array::from_fn(|j| 0.5 * (even[j] + odd[j]));
        let far_factor = Cholesky::new(with_diagonal(far, &along))?;

        let out: [f64; N] = std::array::from_fn(|i| directions.flux_root[i] * sides.top[i].through);
        let slope = c.solve(&out);
        let slope_of_flux = std::array::from_fn(|j| dot(&s[j], &slope));
        Some(Self {
            s,
            q,
            c,
            k,
            half,
            even,
            odd,
            across,
            odd_factor,
            even_factor,
            far_factor,
            mixing,
            slope_of_flux,
            absorbed,
        })
    }

    /// The light of scaled radiance `incident` just inside the top.
    pub fn amplitudes(&self, sides: &Sides<N>, incident: &[f64; N]) -> Amplitudes<N> {
        let drive = self.drive(&sides.top, incident);
        let (even, odd) = self.even_and_odd(&drive, &drive);
        // The far side from the near one, not as even - odd: that would cancel in a deep slab.
        let carried: [f64; N] = std::array::from_fn(|j| self.across[j] * (even[j] + odd[j]));
        let far = self.far_factor.solve(&carried);
        Amplitudes { even, odd, far }
    }

    /// The light of scaled radiance `incident` just inside the bottom; `far` is the top.
    pub fn amplitudes_from_below(&self, sides: &Sides<N>, incident: &[f64; N]) -> Option<Amplitudes<N>> {
        let drive = self.drive(&sides.bottom, incident);
        let (even, odd) = self.even_and_odd(&drive, &drive.map(|x| -x));
        let carried: [f64; N] = std::array::from_fn(|j| self.across[j] * (even[j] - odd[j]));
        let far = if sides.same {
            self.far_factor.solve(&carried)
        } else {
            let along: [f64; N] = std::array::from_fn(|j| 0.5 * (self.even[j] + self.odd[j]));
            Cholesky::new(with_diagonal(project(&self.s, &resistance(&sides.top)), &along))?.solve(&carried)
        };
        Some(Amplitudes { even, odd, far })
    }

    fn drive(&self, side: &[Surface; N], incident: &[f64; N]) -> [f64; N] {
        let drive: [f64; N] = std::array::from_fn(|i| incident[i] / (1.0 + side[i].inside));
        std::array::from_fn(|j| dot(&self.s[j], &drive))
    }

    fn even_and_odd(&self, to_even: &[f64; N], to_odd: &[f64; N]) -> ([f64; N], [f64; N]) {
        let Some(mixing) = &self.mixing else {
            return (self.even_factor.solve(to_even), self.odd_factor.solve(to_odd));
        };
        let alone = self.odd_factor.solve(to_odd);
        let even = self.even_factor.solve(&std::array::from_fn(|i| to_even[i] - dot(&mixing[i], &alone)));
        let odd = self.odd_factor.solve(&std::array::from_fn(|i| to_odd[i] - dot(&mixing[i], &even)));
        (even, odd)
    }

    /// What becomes of light from the top.
    pub fn light(&self, directions: &Directions<N>, sides: &Sides<N>, amplitudes: &Amplitudes<N>) -> Light {
        let bottom = resistance(&sides.bottom);
        let Amplitudes { even, odd, far } = amplitudes;
        let [s_even, s_odd, s_far] = [even, odd, far].map(|amplitudes| self.radiance(amplitudes));
        let (mut reflected, mut transmitted) = (0.0, 0.0);
        for i in 0..N {
            let root = directions.flux_root[i];
            // (s - d) / 2 with the boundary's condition put in: no difference of near-equal terms in a thin slab.
            let up = 0.5 * ((1.0 - bottom[i]) * s_even[i] + (1.0 + bottom[i]) * s_odd[i]);
            reflected += root * sides.top[i].through * up;
            transmitted += root * sides.bottom[i].through * 0.5 * (1.0 + bottom[i]) * s_far[i];
        }
        let mut absorbed = 0.0;
        for j in 0..N {
            reflected -= self.slope_of_flux[j] * self.even[j] * even[j];
            absorbed += self.absorbed[j] * even[j];
        }
        Light { reflected, transmitted, absorbed }
    }

    /// s at a surface.
    pub fn radiance(&self, amplitudes: &[f64; N]) -> [f64; N] {
        let mut s = [0.0; N];
        for (mode, &a) in self.s.iter().zip(amplitudes) {
            for (x, &entry) in s.iter_mut().zip(mode) {
                *x += a * entry;
            }
        }
        s
    }

    /// Row j: mode j of d, for a slope of 1.
    pub fn d(&self) -> Matrix<N> {
        // s = C q = U d, so C^T d = q.
        let mut d = self.q;
        d.iter_mut().for_each(|row| self.c.back(row));
        d
    }
}

/// s^T diag(r) s in the modes' own numbering.
pub fn project<const N: usize>(s: &Matrix<N>, r: &[f64; N]) -> Matrix<N> {
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
