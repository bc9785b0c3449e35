//! ln R at one spatial frequency over p = (ln mu_a, ln mu_s').

use turbid_optics::LogGrid;

/// The bicubic surface through the nodes of a table.
pub struct Surface(LogGrid);

impl Surface {
    pub fn new(grid: LogGrid) -> Self {
        Self(grid)
    }

    /// Nodes along ln mu_a and ln mu_s'.
    pub fn nodes(&self) -> [&[f64]; 2] {
        [self.0.u(), self.0.v()]
    }

    /// Smallest and largest node of ln mu_a and of ln mu_s'.
    pub fn bounds(&self) -> [[f64; 2]; 2] {
        self.nodes().map(|nodes| [nodes[0], nodes[nodes.len() - 1]])
    }

    /// ln R and its slopes at `p`; beyond the nodes it goes on straight in log-log, as a help for what lies just inside.
    pub fn at(&self, p: [f64; 2]) -> (f64, [f64; 2]) {
        let inside = self.inside(p);
        let jet = self.0.log_jet(inside[0], inside[1]).expect("the point was brought inside");
        (jet.w + jet.w_u * (p[0] - inside[0]) + jet.w_v * (p[1] - inside[1]), [jet.w_u, jet.w_v])
    }

    /// d^2 ln R / d p^2 at `p`, or at the nearest point of the table.
    pub fn curvature(&self, p: [f64; 2]) -> [[f64; 2]; 2] {
        let [u, v] = self.inside(p);
        let [uu, uv, vv] = self.0.log_curvature(u, v).expect("the point was brought inside");
        [[uu, uv], [uv, vv]]
    }

    fn inside(&self, p: [f64; 2]) -> [f64; 2] {
        let bounds = self.bounds();
        [0, 1].map(|k| p[k].clamp(bounds[k][0], bounds[k][1]))
    }
}
