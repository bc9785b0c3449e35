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

/// By how much noise raises the mean of ln mu_a and ln mu_s' found at `p`, to second order in the noise; `gain` is
/// d p / d ln R, `c_r` the covariance of R relative to R, `c_p` that of p.
///
/// R itself is unbiased, so ln R is low by c_r / 2; the curvature of ln R(p) bends what is left.
pub fn noise_bias(
    curvature: &[[[f64; 2]; 2]; 2],
    gain: &[[f64; 2]; 2],
    c_r: &[[f64; 2]; 2],
    c_p: &[[f64; 2]; 2],
) -> [f64; 2] {
    let low = [0, 1].map(|m| {
        let bend: f64 = curvature[m].iter().flatten().zip(c_p.iter().flatten()).map(|(f, c)| f * c).sum();
        -0.5 * (c_r[m][m] + bend)
    });
    gain.map(|row| row[0] * low[0] + row[1] * low[1])
}

/// Inverse of a 2 x 2 matrix; `None` where it has none.
pub fn inverse(m: &[[f64; 2]; 2]) -> Option<[[f64; 2]; 2]> {
    let determinant = m[0][0] * m[1][1] - m[0][1] * m[1][0];
    let inverse = [[m[1][1], -m[0][1]], [-m[1][0], m[0][0]]].map(|row| row.map(|x| x / determinant));
    inverse.iter().flatten().all(|x| x.is_finite()).then_some(inverse)
}

/// C_p = G C G^T.
pub fn sandwich(g: &[[f64; 2]; 2], c: &[[f64; 2]; 2]) -> [[f64; 2]; 2] {
    let gc = [0, 1].map(|i| [0, 1].map(|j| g[i][0] * c[0][j] + g[i][1] * c[1][j]));
    [0, 1].map(|i| [0, 1].map(|j| gc[i][0] * g[j][0] + gc[i][1] * g[j][1]))
}
