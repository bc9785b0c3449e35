//! Where Newton's method starts: the forward surface as a mesh of triangles in (u, v), and the uniform grid over it.

use crate::coordinates::Coordinates;
use crate::forward::Forward;

/// Triangles of the forward surface, per axis, that give the nodes their starting points.
const FINE_CELLS: usize = 160;

/// The uniform grid of (u, v).
pub struct Grid {
    /// First node and nodes per unit along u and v.
    pub first: [f64; 2],
    pub per_unit: [f64; 2],
    /// Nodes along each axis; node (i, j) has the number i * size + j.
    size: usize,
}

impl Grid {
    /// Around the lowest and highest u and v, with one cell of margin, so that the border of the surface lies inside cells.
    pub fn around([first, last]: [[f64; 2]; 2], size: usize) -> Self {
        let step = [0, 1].map(|k| (last[k] - first[k]).max(1e-9) / (size - 3) as f64);
        Self { first: [0, 1].map(|k| first[k] - step[k]), per_unit: step.map(|s| 1.0 / s), size }
    }

    /// (u, v) of a node.
    pub fn place(&self, node: usize) -> [f64; 2] {
        let at = [node / self.size, node % self.size];
        [0, 1].map(|k| self.first[k] + at[k] as f64 / self.per_unit[k])
    }

    /// (u, v) of the middle of the cell that begins at a node.
    pub fn middle(&self, cell: u32) -> [f64; 2] {
        let at = [cell as usize / self.size, cell as usize % self.size];
        [0, 1].map(|k| self.first[k] + (at[k] as f64 + 0.5) / self.per_unit[k])
    }

    /// Starting points: each triangle of the mesh gives one to the nodes in it, and to those around it, which cells
    /// on the border need.
    pub fn seeds(&self, mesh: &Mesh) -> Vec<Seed> {
        let mut seeds = vec![Seed { p: None, distance: f64::INFINITY, folded: false }; self.size * self.size];
        for triangle in mesh.triangles() {
            let at = triangle.map(|vertex| {
                let place = mesh.places[vertex];
                [0, 1].map(|k| (place[k] - self.first[k]) * self.per_unit[k])
            });
            let range = |k: usize| {
                let (low, high) = at.iter().fold((f64::INFINITY, 0.0_f64), |(l, h), a| (l.min(a[k]), h.max(a[k])));
                (low - 1.0).max(0.0) as usize..=((high + 1.0) as usize).min(self.size - 1)
            };
            for i in range(0) {
                for j in range(1) {
                    let (weights, distance) = nearest_in_triangle(&at, [i as f64, j as f64]);
                    let p = [0, 1].map(|k| (0..3).map(|v| weights[v] * mesh.points[triangle[v]][k]).sum());
                    seeds[i * self.size + j].offer(p, distance, mesh.step);
                }
            }
        }
        seeds
    }
}

/// The forward surface in (u, v), as a mesh of triangles.
pub struct Mesh {
    points: Vec<[f64; 2]>,
    places: Vec<[f64; 2]>,
    /// Points per row.
    columns: usize,
    /// Widest step between neighbouring points.
    step: f64,
}

impl Mesh {
    pub fn of(forward: &Forward, coordinates: &Coordinates) -> Self {
        let fine = forward.nodes().map(subdivide);
        let points: Vec<[f64; 2]> = fine[0].iter().flat_map(|&a| fine[1].iter().map(move |&s| [a, s])).collect();
        let place = |p: &[f64; 2]| {
            // Between the nodes the spline may swing beyond R_top or Q R_0, where there is no place: left out below.
            let r = forward.at(*p).ln_r.map(libm::exp);
            coordinates.at(r).unwrap_or([f64::NAN; 2])
        };
        let places = points.iter().map(place).collect();
        let step = fine.iter().flat_map(|f| f.windows(2).map(|w| w[1] - w[0])).fold(0.0, f64::max);
        Self { points, places, columns: fine[1].len(), step }
    }

    /// Lowest and highest u and v.
    pub fn extent(&self) -> [[f64; 2]; 2] {
        let mut extent = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
        for place in &self.places {
            for k in 0..2 {
                extent[0][k] = extent[0][k].min(place[k]);
                extent[1][k] = extent[1][k].max(place[k]);
            }
        }
        extent
    }

    fn triangles(&self) -> impl Iterator<Item = [usize; 3]> {
        let rows = self.points.len() / self.columns;
        let corners = (0..rows - 1).flat_map(move |i| (0..self.columns - 1).map(move |j| i * self.columns + j));
        let down = self.columns;
        let both = corners.flat_map(move |n| [[n, n + 1, n + down], [n + 1, n + down, n + down + 1]]);
        both.filter(|t| t.iter().all(|&v| self.places[v][0].is_finite()))
    }
}

/// Nodes with points in between, so that there are some [`FINE_CELLS`] cells.
fn subdivide(nodes: &[f64]) -> Vec<f64> {
    let parts = FINE_CELLS.div_ceil(nodes.len() - 1);
    let mut fine: Vec<f64> = nodes
        .windows(2)
        .flat_map(|w| (0..parts).map(move |k| w[0] + (w[1] - w[0]) * k as f64 / parts as f64))
        .collect();
    fine.push(nodes[nodes.len() - 1]);
    fine
}

/// Where Newton's method starts for a node.
#[derive(Clone)]
pub struct Seed {
    pub p: Option<[f64; 2]>,
    /// From the node to the triangle that `p` comes from, in steps of the table; 0 inside.
    distance: f64,
    /// Whether triangles far apart cover the node.
    pub folded: bool,
}

impl Seed {
    fn offer(&mut self, p: [f64; 2], distance: f64, step: f64) {
        if let (Some(known), true) = (self.p, distance == 0.0 && self.distance == 0.0) {
            // Neighbours that share an edge agree to one step of the mesh.
            self.folded |= (0..2).any(|k| (known[k] - p[k]).abs() > 3.0 * step);
        } else if distance < self.distance {
            (self.p, self.distance) = (Some(p), distance);
        }
    }
}

/// Weights of the corners for the point of a triangle that is nearest to `x`, and its distance (0 inside).
fn nearest_in_triangle(corners: &[[f64; 2]; 3], x: [f64; 2]) -> ([f64; 3], f64) {
    let [a, b, c] = corners;
    let cross =
        |p: &[f64; 2], q: &[f64; 2], r: &[f64; 2]| (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
    let area = cross(a, b, c);
    let weights = [cross(b, c, &x) / area, cross(c, a, &x) / area, cross(a, b, &x) / area];
    if weights.iter().all(|&w| w >= 0.0) {
        return (weights, 0.0);
    }
    let mut best = ([1.0, 0.0, 0.0], f64::INFINITY);
    for [i, j] in [[0, 1], [1, 2], [2, 0]] {
        let (p, q) = (corners[i], corners[j]);
        let d = [q[0] - p[0], q[1] - p[1]];
        let length = d[0] * d[0] + d[1] * d[1];
        let along = (x[0] - p[0]) * d[0] + (x[1] - p[1]) * d[1];
        let t = if length > 0.0 { (along / length).clamp(0.0, 1.0) } else { 0.0 };
        let off = [p[0] + t * d[0] - x[0], p[1] + t * d[1] - x[1]];
        let distance = (off[0] * off[0] + off[1] * off[1]).sqrt();
        if distance < best.1 {
            let mut weights = [0.0; 3];
            (weights[i], weights[j]) = (1.0 - t, t);
            best = (weights, distance);
        }
    }
    best
}
