//! Linear interpolation over triangles of the look-up table's nodes, in log-log.

use crate::forward::{Forward, inverse};

/// The cells of the nodes, each cut into two triangles along its falling diagonal.
pub struct Triangles<'a> {
    nodes: [&'a [f64]; 2],
    /// ln R at both f_x, ln mu_s' running fastest.
    ln_r: Vec<[f64; 2]>,
}

/// Cells around the one that the bicubic surface names; straight edges and curved ones differ by less.
const AROUND: usize = 2;

impl<'a> Triangles<'a> {
    pub fn new(forward: &'a Forward) -> Self {
        let nodes = forward.nodes();
        let points = nodes[0].iter().flat_map(|&a| nodes[1].iter().map(move |&s| [a, s]));
        Self { nodes, ln_r: points.map(|p| forward.at(p).ln_r).collect() }
    }

    /// p and d p / d ln R in the triangle that holds the pair `r`, sought around `start`; `None` where none does.
    pub fn find(&self, r: [f64; 2], start: [f64; 2]) -> Option<([f64; 2], [[f64; 2]; 2])> {
        let x = r.map(libm::log);
        let cell = [0, 1].map(|k| {
            let nodes = self.nodes[k];
            nodes.partition_point(|&node| node <= start[k]).clamp(1, nodes.len() - 1) - 1
        });
        let range = |k: usize| cell[k].saturating_sub(AROUND)..(cell[k] + AROUND + 1).min(self.nodes[k].len() - 1);
        // Of triangles that share an edge the first; the named cell is the likeliest.
        let near = |c: &[usize; 2]| c[0].abs_diff(cell[0]) + c[1].abs_diff(cell[1]);
        let mut cells: Vec<[usize; 2]> = range(0).flat_map(|i| range(1).map(move |j| [i, j])).collect();
        cells.sort_by_key(near);
        let halves = cells
            .iter()
            .flat_map(|&[i, j]| [[[i, j], [i + 1, j], [i, j + 1]], [[i + 1, j + 1], [i + 1, j], [i, j + 1]]]);
        halves.into_iter().find_map(|corners| self.within(corners, x))
    }

    /// The same in one triangle.
    fn within(&self, corners: [[usize; 2]; 3], x: [f64; 2]) -> Option<([f64; 2], [[f64; 2]; 2])> {
        let p = corners.map(|[i, j]| [self.nodes[0][i], self.nodes[1][j]]);
        let at = corners.map(|[i, j]| self.ln_r[i * self.nodes[1].len() + j]);
        let edge = |v: &[[f64; 2]; 3], c: usize| [v[c][0] - v[0][0], v[c][1] - v[0][1]];
        let (a, b) = (edge(&at, 1), edge(&at, 2));
        let to_weights = inverse(&[[a[0], b[0]], [a[1], b[1]]])?;
        let d = [x[0] - at[0][0], x[1] - at[0][1]];
        let [s, t] = to_weights.map(|row| row[0] * d[0] + row[1] * d[1]);
        // Room for rounding: a point on an edge belongs to somebody.
        if s < -1e-12 || t < -1e-12 || s + t > 1.0 + 1e-12 {
            return None;
        }
        let (e, f) = (edge(&p, 1), edge(&p, 2));
        let along = |k: usize| [0, 1].map(|m| e[k] * to_weights[0][m] + f[k] * to_weights[1][m]);
        Some(([0, 1].map(|k| p[0][k] + s * e[k] + t * f[k]), [along(0), along(1)]))
    }
}
