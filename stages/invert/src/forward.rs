//! The forward surface: ln R at two spatial frequencies over p = (ln mu_a, ln mu_s').

use turbid_optics::LogGrid;

use crate::surface::Surface;

/// The surfaces at two f_x, on the same nodes: the lower f_x first.
pub struct Forward {
    surfaces: [Surface; 2],
}

/// ln R at both f_x, and its Jacobian: `jacobian[k]` = d ln R_k / d (ln mu_a, ln mu_s').
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    pub ln_r: [f64; 2],
    pub jacobian: [[f64; 2]; 2],
}

impl Forward {
    /// The two grids must have the same nodes.
    pub fn new(grids: [LogGrid; 2]) -> Self {
        assert!(grids[0].u() == grids[1].u() && grids[0].v() == grids[1].v(), "both f_x have the same nodes");
        Self { surfaces: grids.map(Surface::new) }
    }

    /// Nodes along ln mu_a and ln mu_s'.
    pub fn nodes(&self) -> [&[f64]; 2] {
        self.surfaces[0].nodes()
    }

    /// Smallest and largest node of ln mu_a and of ln mu_s'.
    pub fn bounds(&self) -> [[f64; 2]; 2] {
        self.surfaces[0].bounds()
    }

    /// Both surfaces at `p`, see [`Surface::at`].
    pub fn at(&self, p: [f64; 2]) -> Point {
        let [(low, low_slope), (high, high_slope)] = [0, 1].map(|k| self.surfaces[k].at(p));
        Point { ln_r: [low, high], jacobian: [low_slope, high_slope] }
    }

    /// d^2 ln R_k / d p^2 of both at `p`, or at the nearest point of the table.
    pub fn curvature(&self, p: [f64; 2]) -> [[[f64; 2]; 2]; 2] {
        [0, 1].map(|k| self.surfaces[k].curvature(p))
    }
}

/// Half the curvature of p(ln R), as it meets the covariance of p: `[k]` holds the parts of aa, 2 as and ss for ln mu_a and ln mu_s'.
pub type Bend = [[f64; 3]; 2];

/// -1/2 sum_m G_km F_m, with G = d p / d ln R and F_m = d^2 ln R_m / d p^2.
pub fn bend(curvature: &[[[f64; 2]; 2]; 2], gain: &[[f64; 2]; 2]) -> Bend {
    let of = |i: usize, j: usize| curvature.map(|f| f[i][j]);
    gain.map(|row| [of(0, 0), of(0, 1), of(1, 1)].map(|f| -0.5 * (row[0] * f[0] + row[1] * f[1])))
}

/// By how much noise raises the mean of ln mu_a and ln mu_s', to second order in the noise; `gain` is d p / d ln R, `c_r` the covariance
/// of R relative to R, `c_p` that of p.
///
/// R itself is unbiased, so ln R is low by c_r / 2; the curvature of ln R(p) bends what is left.
#[inline(always)]
pub fn noise_bias(bend: &Bend, gain: &[[f64; 2]; 2], c_r: &[[f64; 2]; 2], c_p: &[[f64; 2]; 2]) -> [f64; 2] {
    let low = [-0.5 * c_r[0][0], -0.5 * c_r[1][1]];
    let one = |gain: &[f64; 2], bend: &[f64; 3]| {
        let bent = bend[0] * c_p[0][0] + 2.0 * bend[1] * c_p[0][1] + bend[2] * c_p[1][1];
        gain[0] * low[0] + gain[1] * low[1] + bent
    };
    [one(&gain[0], &bend[0]), one(&gain[1], &bend[1])]
}

/// Inverse of a 2 x 2 matrix; `None` where it has none.
pub fn inverse(m: &[[f64; 2]; 2]) -> Option<[[f64; 2]; 2]> {
    let determinant = m[0][0] * m[1][1] - m[0][1] * m[1][0];
    let inverse = [[m[1][1], -m[0][1]], [-m[1][0], m[0][0]]].map(|row| row.map(|x| x / determinant));
    inverse.iter().flatten().all(|x| x.is_finite()).then_some(inverse)
}

/// C_p = G C G^T.
#[inline(always)]
pub fn sandwich(g: &[[f64; 2]; 2], c: &[[f64; 2]; 2]) -> [[f64; 2]; 2] {
    let gc = |i: usize, j: usize| g[i][0] * c[0][j] + g[i][1] * c[1][j];
    let gcg = |i: usize, j: usize| gc(i, 0) * g[j][0] + gc(i, 1) * g[j][1];
    [[gcg(0, 0), gcg(0, 1)], [gcg(1, 0), gcg(1, 1)]]
}
