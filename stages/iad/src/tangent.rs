//! Derivatives of the light that leaves a slab by its depths of absorption and of scattering: perturbation theory.
//!
//! A change of U and V changes the light f~ . (s, d) that leaves by
//!
//! ```text
//! int (d~ dU d - s~ dV s) dz,
//! ```
//!
//! s, d the light as it is and s~, d~ that of a source f~ where the detector stands. In the modes the integrals are divided
//! differences in closed form, so one more product of matrices yields what two further calculations of the slab would, and
//! to full precision.

#![allow(clippy::needless_range_loop, reason = "rows and columns of one matrix")]

use crate::angles::Directions;
use crate::coupling::Coupling;
use crate::differences::{Across, Point};
use crate::matrix::{Matrix, dot, zeros};
use crate::modes::{Amplitudes, Depths, Modes, project};

/// Shallower than this (as a sum of absorption and scattering) light is split into even and odd, deeper into near and far:
/// the first cancels where little comes through, the second where little happens on the way.
const SHALLOW: f64 = 1.0;

/// Bilinear forms of two lights: first and second part each with its own.
struct Form<const N: usize> {
    first: Matrix<N>,
    second: Matrix<N>,
}

/// How fast the light that leaves follows the depths of a slab.
pub struct Tangent<const N: usize> {
    shallow: bool,
    /// By the depth of absorption, or of scattering outside the peak, whichever was formed directly.
    direct: Form<N>,
    direct_is_absorption: bool,
    /// By both depths in proportion: diagonal.
    both: [[f64; N]; 2],
    depths: Depths,
}

/// The two parts of a light that a [`Form`] joins.
type Parts<const N: usize> = [[f64; N]; 2];

impl<const N: usize> Tangent<N> {
    pub fn new(modes: &Modes<N>, directions: &Directions<N>, coupling: &Coupling<N>, depths: &Depths) -> Self {
        let d = modes.d();
        // What is the smaller share is formed directly, the other is the rest: no difference of near-equal terms.
        let direct_is_absorption = depths.scatter >= 0.5;
        let (in_d, in_s) = if direct_is_absorption {
            let per_cosine = directions.inverse_roots.map(|x| x * x);
            (project(&d, &per_cosine), project(&modes.s, &per_cosine))
        } else {
            (between(&d, &coupling.odd_matrix(directions, 1.0)), between(&modes.s, &even_matrix(directions, coupling)))
        };
        let shallow = depths.total < SHALLOW;
        let depth = if shallow { modes.half } else { 2.0 * modes.half };
        let [slopes, reaches]: [[Point; N]; 2] =
            [Across::Slope, Across::Reach].map(|f| modes.k.map(|k| f.at(k, depth)));
        let mut direct = Form { first: zeros(), second: zeros() };
        let mut both = [[0.0; N]; 2];
        for i in 0..N {
            for j in 0..=i {
                // Differences f and (x_i f_j - x_j f_i) / (x_i - x_j) of what joins the first and the second parts.
                let (low, high) = if slopes[i].x < slopes[j].x { (i, j) } else { (j, i) };
                let (a, b) = (&slopes[low], &slopes[high]);
                let slope = Across::Slope.difference(a, b, depth);
                let turned = a.value - a.x * slope;
                let [first, second] = if shallow {
                    // Odd modes have k coth(kh), even ones x over that.
                    let product = a.value * b.value;
                    [[turned / product, a.x * b.x * slope / product], [slope, turned]]
                } else {
                    let (a, b) = (&reaches[low], &reaches[high]);
                    let reach = Across::Reach.difference(a, b, depth);
                    [[slope, turned], [reach, a.value - a.x * reach]]
                };
                let [first, second] =
                    [first, second].map(|[f, turned]| (in_d[i][j] * turned - in_s[i][j] * f, turned, f));
                for (form, entry) in [(&mut direct.first, first), (&mut direct.second, second)] {
                    form[i][j] = entry.0;
                    form[j][i] = entry.0;
                }
                if i == j {
                    both[0][i] = first.1 - modes.k[i] * modes.k[i] * first.2;
                    both[1][i] = second.1 - modes.k[i] * modes.k[i] * second.2;
                }
            }
        }
        Self { shallow, direct, direct_is_absorption, both, depths: *depths }
    }

    fn parts(&self, light: &Amplitudes<N>, from_below: bool) -> Parts<N> {
        let Amplitudes { even, odd, far } = light;
        if self.shallow {
            return [*even, *odd];
        }
        let near: [f64; N] = std::array::from_fn(|j| if from_below { even[j] - odd[j] } else { even[j] + odd[j] });
        if from_below { [*far, near] } else { [near, *far] }
    }

    /// d(light that `detectors` would send out) by the depths of absorption and of scattering outside the peak, times the
    /// sum of both depths; `light` comes from the top, a detector's own light from the top or (true) from below.
    pub fn slopes<const K: usize>(
        &self,
        light: &Amplitudes<N>,
        detectors: [(&Amplitudes<N>, bool); K],
    ) -> [[f64; 2]; K] {
        let light = self.parts(light, false);
        let direct = self.apply(&light);
        let both: Parts<N> = self.apply_diagonal(&light);
        let factor = if self.shallow { 2.0 } else { 1.0 };
        detectors.map(|(detector, from_below)| {
            let detector = self.parts(detector, from_below);
            let sum = |parts: &Parts<N>| factor * (dot(&detector[0], &parts[0]) + dot(&detector[1], &parts[1]));
            let (direct, both) = (sum(&direct), sum(&both));
            let Depths { absorb, scatter, .. } = self.depths;
            if self.direct_is_absorption {
                [direct, (both - absorb * direct) / scatter]
            } else {
                [(both - scatter * direct) / absorb, direct]
            }
        })
    }

    fn apply(&self, light: &Parts<N>) -> Parts<N> {
        let Form { first, second } = &self.direct;
        let by = |form: &Matrix<N>, part: &[f64; N]| -> [f64; N] { std::array::from_fn(|i| dot(&form[i], part)) };
        self.join([by(first, &light[0]), by(first, &light[1])], [by(second, &light[0]), by(second, &light[1])])
    }

    fn apply_diagonal(&self, light: &Parts<N>) -> Parts<N> {
        let by = |form: &[f64; N], part: &[f64; N]| -> [f64; N] { std::array::from_fn(|i| form[i] * part[i]) };
        let [first, second] = &self.both;
        self.join([by(first, &light[0]), by(first, &light[1])], [by(second, &light[0]), by(second, &light[1])])
    }

    /// Even with even and odd with odd; or near with near and far with far, less near with far.
    fn join(&self, first: Parts<N>, second: Parts<N>) -> Parts<N> {
        if self.shallow {
            return [first[0], second[1]];
        }
        let less = |a: &[f64; N], b: &[f64; N]| -> [f64; N] { std::array::from_fn(|i| a[i] - b[i]) };
        [less(&first[0], &second[1]), less(&first[1], &second[0])]
    }
}

/// V per unit depth at albedo 1.
fn even_matrix<const N: usize>(directions: &Directions<N>, coupling: &Coupling<N>) -> Matrix<N> {
    let roots = &directions.flux_root;
    let mut v: Matrix<N> = zeros();
    for i in 0..N {
        let mut out = 0.0;
        for j in (0..N).filter(|&j| j != i) {
            v[i][j] = -coupling.even[i][j] / (roots[i] * roots[j]);
            out += coupling.even[i][j];
        }
        v[i][i] = out / (roots[i] * roots[i]);
    }
    v
}

/// m a m^T for symmetric `a`.
fn between<const N: usize>(m: &Matrix<N>, a: &Matrix<N>) -> Matrix<N> {
    let mut product = zeros();
    for i in 0..N {
        let row: [f64; N] = std::array::from_fn(|l| dot(&a[l], &m[i]));
        for j in 0..=i {
            let value = dot(&row, &m[j]);
            product[i][j] = value;
            product[j][i] = value;
        }
    }
    product
}
