//! Coordinates of a pair of reflectances in which ln mu_a and ln mu_s' are smooth.
//!
//! u = ln(R_0 / (R_top - R_0)), v = logit(R_1 / (Q R_0)). R_top is the reflectance that R_0 tends to without absorption: there
//! ln mu_a runs as 2 ln(R_top - R_0), which is a straight line in this u, and a pole in ln R_0. Q is 1, which R_1 / R_0 stays below unless both are
//! relative to a reference.

use turbid_optics::elementary::ln;

use crate::forward::Forward;

/// Coordinates (u, v) of a pair of reflectances.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coordinates {
    /// Above every R_0 of the table.
    pub r_top: f64,
    /// Q, above every R_1 / R_0 of the table.
    pub q_top: f64,
}

impl Coordinates {
    /// R_top from the two least absorbing nodes along every mu_s': R_0 = R_top - c sqrt(mu_a) for mu_a -> 0. Q is 1 where all nodes are below it; else
    /// the table is relative (or noisy), knows no such bound, and any one far enough above its nodes will do.
    pub fn of(forward: &Forward) -> Self {
        let [ln_mu_a, ln_mu_s_prime] = forward.nodes();
        let root = [0, 1].map(|i| libm::exp(0.5 * ln_mu_a[i]));
        let ln_r = |i: usize, j: usize| forward.at([ln_mu_a[i], ln_mu_s_prime[j]]).ln_r;
        let r_0 = |i: usize, j: usize| libm::exp(ln_r(i, j)[0]);
        let mut highest = 0.0_f64;
        let mut ln_q = f64::NEG_INFINITY;
        let mut r_top = 0.0_f64;
        for j in 0..ln_mu_s_prime.len() {
            let slope = (r_0(0, j) - r_0(1, j)) / (root[1] - root[0]);
            r_top = r_top.max(r_0(0, j) + slope * root[0]);
            for i in 0..ln_mu_a.len() {
                highest = highest.max(r_0(i, j));
                let [ln_r_0, ln_r_1] = ln_r(i, j);
                ln_q = ln_q.max(ln_r_1 - ln_r_0);
            }
        }
        // A table that does not darken with mu_a has no such limit; any bound above it will do.
        let r_top = r_top.max(highest * (1.0 + 1e-6));
        Self { r_top, q_top: if ln_q < 0.0 { 1.0 } else { 2.0 * libm::exp(ln_q) } }
    }

    /// (u, v), or `None` where the pair has none: R_0 not in (0, R_top) or R_1 not in (0, Q R_0).
    pub fn at(&self, r: [f64; 2]) -> Option<[f64; 2]> {
        let (below_top, fringe_free) = (self.r_top - r[0], self.q_top * r[0] - r[1]);
        let inside = r[0] > 0.0 && r[1] > 0.0 && below_top > 0.0 && fringe_free > 0.0;
        inside.then(|| [ln(r[0] / below_top), ln(r[1] / fringe_free)])
    }

    /// The pair that has the coordinates (u, v).
    pub fn pair(&self, [u, v]: [f64; 2]) -> [f64; 2] {
        let share = |x: f64| 1.0 / (1.0 + libm::exp(-x));
        let r_0 = self.r_top * share(u);
        [r_0, self.q_top * r_0 * share(v)]
    }

    /// d (u, v) / d (ln R_0, ln R_1).
    #[inline(always)]
    pub fn gradient(&self, r: [f64; 2]) -> [[f64; 2]; 2] {
        let v = self.q_top * r[0] / (self.q_top * r[0] - r[1]);
        [[self.r_top / (self.r_top - r[0]), 0.0], [-v, v]]
    }
}
