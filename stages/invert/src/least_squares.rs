//! mu_a and mu_s' that fit the reflectances at several spatial frequencies best.
//!
//! Minimises sum_j ((ln R_j - ln T_j(p)) / s_j)^2, s_j the relative standard errors (all 1 where noise is unknown), by the method of
//! Levenberg and Marquardt with the slopes of the table's own surface.

use turbid_contract::payload::MaskReason;

use crate::forward::inverse;
use crate::inverse::TOLERANCE;
use crate::lut::{Errors, MOST};
use crate::nearest::Nodes;
use crate::pass::{Solved, Spread};
use crate::surface::Surface;

/// Converged where ln mu moves by less.
const CLOSE: f64 = 1e-9;
const MOST_STEPS: usize = 60;

/// Surfaces at each f_x, and where to begin.
pub struct LeastSquares<'a> {
    pub surfaces: &'a [Surface],
    /// Nodes at the lowest and the highest f_x.
    pub nodes: &'a Nodes,
    /// Smallest and largest R of the table at the lowest f_x.
    pub r_0_range: [f64; 2],
    /// The table's own errors, where it has any.
    pub errors: Option<&'a Errors>,
}

/// Values and slopes of all surfaces at a point, weighted residuals.
struct State {
    slopes: [[f64; 2]; MOST],
    miss: [f64; MOST],
    cost: f64,
}

impl LeastSquares<'_> {
    /// `r`: one reflectance per f_x; `c_r(i, j)`: covariance of R_i and R_j relative to both, where it is known.
    pub fn solve(&self, r: &[f64], c_r: Option<&dyn Fn(usize, usize) -> f64>) -> Result<Solved, MaskReason> {
        if r.iter().any(|r| !r.is_finite()) {
            return Err(MaskReason::NotFinite);
        }
        if r.iter().any(|&r| r <= 0.0) {
            return Err(MaskReason::BelowTable);
        }
        let mut x = [0.0; MOST];
        let mut weight = [0.0; MOST];
        for (j, &r) in r.iter().enumerate() {
            x[j] = libm::log(r);
            weight[j] = c_r.map_or(1.0, |c_r| 1.0 / c_r(j, j));
        }
        if !weight[..r.len()].iter().all(|w| w.is_finite() && *w > 0.0) {
            return Err(MaskReason::NotFinite);
        }
        let start = self.nodes.nearest([r[0], r[r.len() - 1]]).p;
        let (p, state) = self.descend(&x, &weight, start).ok_or(MaskReason::Ambiguous)?;
        let bounds = self.surfaces[0].bounds();
        if (0..2).any(|k| p[k] < bounds[k][0] - TOLERANCE || p[k] > bounds[k][1] + TOLERANCE) {
            return Err(self.reason(r[0]));
        }
        let noise = match c_r {
            None => None,
            Some(c_r) => Some(self.spread(p, &state, &weight, c_r).ok_or(MaskReason::Ambiguous)?),
        };
        Ok(Solved { p, noise, outside: None })
    }

    fn reason(&self, r_0: f64) -> MaskReason {
        let [darkest, brightest] = self.r_0_range;
        if r_0 < darkest {
            MaskReason::BelowTable
        } else if r_0 > brightest {
            MaskReason::AboveTable
        } else {
            MaskReason::ModulationOutsideTable
        }
    }

    fn state(&self, x: &[f64; MOST], weight: &[f64; MOST], p: [f64; 2]) -> State {
        let mut state = State { slopes: [[0.0; 2]; MOST], miss: [0.0; MOST], cost: 0.0 };
        for (j, surface) in self.surfaces.iter().enumerate() {
            let (value, slope) = surface.at(p);
            (state.slopes[j], state.miss[j]) = (slope, x[j] - value);
            state.cost += weight[j] * state.miss[j] * state.miss[j];
        }
        state
    }

    fn descend(&self, x: &[f64; MOST], weight: &[f64; MOST], start: [f64; 2]) -> Option<([f64; 2], State)> {
        let (mut p, mut damping) = (start, 1e-3);
        let mut state = self.state(x, weight, p);
        for _ in 0..MOST_STEPS {
            let (mut normal, mut pull) = ([[0.0; 2]; 2], [0.0; 2]);
            for (j, slope) in state.slopes[..self.surfaces.len()].iter().enumerate() {
                for a in 0..2 {
                    pull[a] += weight[j] * slope[a] * state.miss[j];
                    (0..2).for_each(|b| normal[a][b] += weight[j] * slope[a] * slope[b]);
                }
            }
            // Until a step goes down, or there is none left to take.
            loop {
                let mut damped = normal;
                (0..2).for_each(|a| damped[a][a] *= 1.0 + damping);
                let solution = inverse(&damped)?;
                let mut step = solution.map(|row| row[0] * pull[0] + row[1] * pull[1]);
                let longest = step[0].abs().max(step[1].abs());
                if longest < CLOSE {
                    return Some((p, state));
                }
                // At most a factor e at a time: further the tangent says nothing.
                step = step.map(|s| s / longest.max(1.0));
                let candidate = [p[0] + step[0], p[1] + step[1]];
                let next = self.state(x, weight, candidate);
                if next.cost <= state.cost {
                    (p, state, damping) = (candidate, next, (0.1 * damping).max(1e-12));
                    break;
                }
                damping *= 10.0;
                if damping > 1e12 {
                    return Some((p, state));
                }
            }
        }
        None
    }

    /// Covariance and bias of p: it follows ln R by G = (J^T W J)^-1 J^T W.
    fn spread(
        &self,
        p: [f64; 2],
        state: &State,
        weight: &[f64; MOST],
        c_r: &dyn Fn(usize, usize) -> f64,
    ) -> Option<Spread> {
        let count = self.surfaces.len();
        let mut normal = [[0.0; 2]; 2];
        for (j, slope) in state.slopes[..count].iter().enumerate() {
            (0..4).for_each(|ab| normal[ab / 2][ab % 2] += weight[j] * slope[ab / 2] * slope[ab % 2]);
        }
        let solution = inverse(&normal)?;
        let mut gain = [[0.0; 2]; MOST];
        for (j, gain) in gain[..count].iter_mut().enumerate() {
            let s = state.slopes[j];
            *gain = solution.map(|row| weight[j] * (row[0] * s[0] + row[1] * s[1]));
        }
        let mut covariance = [[0.0; 2]; 2];
        for (i, j) in (0..count).flat_map(|i| (0..count).map(move |j| (i, j))) {
            let c = c_r(i, j);
            (0..4).for_each(|ab| covariance[ab / 2][ab % 2] += gain[i][ab / 2] * c * gain[j][ab % 2]);
        }
        let mut bias = [0.0; 2];
        for ((j, surface), gain) in self.surfaces.iter().enumerate().zip(&gain) {
            // R is unbiased, so ln R is low by half its variance; the curvature of the surface bends what is left.
            let curvature = surface.curvature(p);
            let bend: f64 = curvature.iter().flatten().zip(covariance.iter().flatten()).map(|(f, c)| f * c).sum();
            let low = -0.5 * (c_r(j, j) + bend);
            (0..2).for_each(|k| bias[k] += gain[k] * low);
        }
        let mut table = [[0.0; 2]; 2];
        if let Some(errors) = self.errors {
            let variances = errors.at(p);
            for (gain, variance) in gain[..count].iter().zip(variances) {
                (0..4).for_each(|ab| table[ab / 2][ab % 2] += gain[ab / 2] * variance * gain[ab % 2]);
            }
        }
        let common = [0, 1].map(|k| gain[..count].iter().map(|gain| gain[k]).sum());
        Some(Spread { covariance, table, common, bias: Some(bias) })
    }
}
