//! The inverse table: p = (ln mu_a, ln mu_s') on a uniform grid of (u, v), coordinates of a pair of reflectances in which
//! p is smooth; bilinear in between.

use fearless_simd::{Level, Simd, dispatch};

use crate::coordinates::Coordinates;
use crate::forward::{Bend, Forward, bend, inverse};

/// Largest error of ln mu_a or ln mu_s' that the resampling may add.
pub const TOLERANCE: f64 = 1e-3;
/// Nodes along u and v: doubled from the first to the last until the tolerance holds.
const SIZES: [usize; 3] = [256, 512, 1024];
/// Triangles of the forward surface, per axis, that give the nodes their starting points.
const FINE_CELLS: usize = 160;
/// Cells at whose centre the resampling is checked, about.
const CHECKED_CELLS: usize = 4000;

/// What a cell of the table can be used for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Cell {
    /// No part of the forward surface lies near.
    Empty,
    Good,
    /// The forward surface covers it more than once.
    Folded,
}

/// What the table says about a pair of reflectances.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Found {
    /// p, its gain d p / d (ln R_0, ln R_1), and the bend of the cell.
    Properties {
        p: [f64; 2],
        gain: [[f64; 2]; 2],
        bend: Bend,
    },
    Outside,
    Folded,
}

/// Why the table holds nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Missing {
    Outside,
    Folded,
}

/// p in a cell: bilinear, with d p / d (u, v).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Patch {
    pub p: [f64; 2],
    pub slope: [[f64; 2]; 2],
    cell: usize,
}

/// The table.
pub struct InverseTable {
    coordinates: Coordinates,
    /// First node and nodes per unit along u and v.
    first: [f64; 2],
    per_unit: [f64; 2],
    size: usize,
    /// p at node (i, j), index i * size + j.
    nodes: Vec<[f64; 2]>,
    cells: Vec<Cell>,
    /// At the centre of each cell; empty where nobody asks what noise adds to the mean.
    bends: Vec<[f32; 6]>,
    bounds: [[f64; 2]; 2],
    /// Largest and median error of p found at the centres of cells.
    pub worst_error: f64,
    pub median_error: f64,
}

impl InverseTable {
    /// Resamples the forward surface, finely enough for [`TOLERANCE`] where [`SIZES`] allow it.
    pub fn new(forward: &Forward) -> Self {
        let mut table = Self::with_size(forward, SIZES[0]);
        for size in &SIZES[1..] {
            if table.worst_error > TOLERANCE {
                table = Self::with_size(forward, *size);
            }
        }
        table
    }

    /// As [`InverseTable::new`] begins: good enough to begin with.
    pub fn coarse(forward: &Forward) -> Self {
        Self::with_size(forward, SIZES[0])
    }

    /// Nodes along each axis.
    pub fn size(&self) -> usize {
        self.size
    }

    pub fn with_size(forward: &Forward, size: usize) -> Self {
        let coordinates = Coordinates::of(forward);
        let surface = Surface::of(forward, &coordinates);
        let [first, last] = surface.extent();
        // One cell of margin, so that the border of the surface lies inside cells.
        let step = [0, 1].map(|k| (last[k] - first[k]).max(1e-9) / (size - 3) as f64);
        let mut table = Self {
            coordinates,
            first: [0, 1].map(|k| first[k] - step[k]),
            per_unit: step.map(|s| 1.0 / s),
            size,
            nodes: vec![[0.0; 2]; size * size],
            cells: vec![Cell::Empty; (size - 1) * (size - 1)],
            bends: Vec::new(),
            bounds: forward.bounds(),
            worst_error: 0.0,
            median_error: 0.0,
        };
        let seeds = table.seeds(&surface);
        let mut solved = vec![false; size * size];
        for (i, seed) in seeds.iter().enumerate() {
            if let Some(p) = seed.p.and_then(|p| solve(forward, &coordinates, table.place(i), p)) {
                table.nodes[i] = p;
                solved[i] = true;
            }
        }
        for (cell, kind) in table.cells.iter_mut().enumerate() {
            let node = cell / (size - 1) * size + cell % (size - 1);
            let corners = [node, node + 1, node + size, node + size + 1];
            *kind = if corners.iter().any(|&n| !solved[n]) {
                Cell::Empty
            } else if corners.iter().any(|&n| seeds[n].folded) {
                Cell::Folded
            } else {
                Cell::Good
            };
        }
        table.check(forward);
        table
    }

    /// (u, v) of a node.
    fn place(&self, node: usize) -> [f64; 2] {
        let at = [node / self.size, node % self.size];
        [0, 1].map(|k| self.first[k] + at[k] as f64 / self.per_unit[k])
    }

    /// Starting points: each triangle of the surface gives one to the nodes in it, and to those around it, which cells
    /// on the border need.
    fn seeds(&self, surface: &Surface) -> Vec<Seed> {
        let mut seeds = vec![Seed { p: None, distance: f64::INFINITY, folded: false }; self.size * self.size];
        for triangle in surface.triangles() {
            let at = triangle.map(|vertex| {
                let place = surface.places[vertex];
                [0, 1].map(|k| (place[k] - self.first[k]) * self.per_unit[k])
            });
            let range = |k: usize| {
                let (low, high) = at.iter().fold((f64::INFINITY, 0.0_f64), |(l, h), a| (l.min(a[k]), h.max(a[k])));
                (low - 1.0).max(0.0) as usize..=((high + 1.0) as usize).min(self.size - 1)
            };
            for i in range(0) {
                for j in range(1) {
                    let (weights, distance) = nearest_in_triangle(&at, [i as f64, j as f64]);
                    let p = [0, 1].map(|k| (0..3).map(|v| weights[v] * surface.points[triangle[v]][k]).sum());
                    seeds[i * self.size + j].offer(p, distance, surface.step);
                }
            }
        }
        seeds
    }

    /// Adds to each cell how p bends there, which says what noise adds to the mean. Constant in a cell: from one to the next it differs by
    /// a hundredth of a correction that is itself of second order.
    pub fn with_bends(mut self, forward: &Forward) -> Self {
        let bends = (0..self.cells.len()).map(|cell| {
            if self.cells[cell] != Cell::Good {
                return [0.0; 6];
            }
            let place = self.centre(cell);
            let patch = self.patch(place).expect("its own centre lies in a good cell");
            let gain = self.gain(self.coordinates.pair(place), &patch);
            let [a, s] = bend(&forward.curvature(patch.p), &gain);
            [a[0], a[1], a[2], s[0], s[1], s[2]].map(|x| x as f32)
        });
        self.bends = bends.collect();
        self
    }

    /// (u, v) of the middle of a cell.
    fn centre(&self, cell: usize) -> [f64; 2] {
        let at = [cell / (self.size - 1), cell % (self.size - 1)];
        [0, 1].map(|k| self.first[k] + (at[k] as f64 + 0.5) / self.per_unit[k])
    }

    /// (u, v) of pairs of reflectances, in lanes; u is NaN where a pair has none.
    pub fn places<const N: usize>(&self, level: Level, r: &[[f64; N]; 2], places: &mut [[f64; N]; 2]) {
        let [u, v] = places;
        dispatch!(level, simd => simd.vectorize(#[inline(always)] || {
            for i in 0..N {
                [u[i], v[i]] = self.coordinates.place([r[0][i], r[1][i]]);
            }
        }));
    }

    /// What the table holds at (u, v), or why it holds nothing.
    #[inline(always)]
    pub fn patch(&self, place: [f64; 2]) -> Result<Patch, Missing> {
        let x = [0, 1].map(|k| (place[k] - self.first[k]) * self.per_unit[k]);
        let last = (self.size - 1) as f64;
        if !(x[0] >= 0.0 && x[1] >= 0.0 && x[0] < last && x[1] < last) {
            return Err(Missing::Outside);
        }
        let (i, j) = (x[0] as usize, x[1] as usize);
        let cell = i * (self.size - 1) + j;
        match self.cells[cell] {
            Cell::Good => {}
            Cell::Empty => return Err(Missing::Outside),
            Cell::Folded => return Err(Missing::Folded),
        }
        let (s, t) = (x[0] - i as f64, x[1] - j as f64);
        let node = i * self.size + j;
        let ([n00, n01], [n10, n11]) = (self.two(node), self.two(node + self.size));
        let along = |k: usize| {
            let (left, right) = (n01[k] - n00[k], n11[k] - n10[k]);
            let (low, high) = (n00[k] + t * left, n10[k] + t * right);
            let slope = [(high - low) * self.per_unit[0], (left + s * (right - left)) * self.per_unit[1]];
            (low + s * (high - low), slope)
        };
        let ((p_0, slope_0), (p_1, slope_1)) = (along(0), along(1));
        Ok(Patch { p: [p_0, p_1], slope: [slope_0, slope_1], cell })
    }

    /// A node and the next.
    #[inline(always)]
    fn two(&self, node: usize) -> [[f64; 2]; 2] {
        let [a, b] = self.nodes[node..node + 2] else { unreachable!("a slice of two") };
        [a, b]
    }

    /// Whether p lies within the nodes of the look-up table.
    #[inline(always)]
    pub fn holds(&self, p: [f64; 2]) -> bool {
        let inside = |k: usize| (p[k] >= self.bounds[k][0] - TOLERANCE) & (p[k] <= self.bounds[k][1] + TOLERANCE);
        inside(0) & inside(1)
    }

    /// d p / d (ln R_0, ln R_1) in a patch, at the pair `r`.
    #[inline(always)]
    pub fn gain(&self, r: [f64; 2], patch: &Patch) -> [[f64; 2]; 2] {
        self.gain_of(r, &patch.slope)
    }

    /// d p / d (ln R_0, ln R_1) from d p / d (u, v).
    #[inline(always)]
    pub fn gain_of(&self, r: [f64; 2], slope: &[[f64; 2]; 2]) -> [[f64; 2]; 2] {
        let [[u, _], [v_0, v_1]] = self.coordinates.gradient(r);
        let [[a_u, a_v], [s_u, s_v]] = *slope;
        [[a_u * u + a_v * v_0, a_v * v_1], [s_u * u + s_v * v_0, s_v * v_1]]
    }

    /// How p bends in a patch.
    #[inline]
    pub fn bend(&self, patch: &Patch) -> Bend {
        self.bends.get(patch.cell).map_or([[0.0; 3]; 2], |b| [0, 3].map(|k| [0, 1, 2].map(|i| f64::from(b[k + i]))))
    }

    /// The properties that have the reflectances `r` at the two f_x.
    pub fn find(&self, r: [f64; 2]) -> Found {
        let Some(place) = self.coordinates.at(r) else { return Found::Outside };
        match self.patch(place) {
            Err(Missing::Outside) => Found::Outside,
            Err(Missing::Folded) => Found::Folded,
            Ok(patch) if !self.holds(patch.p) => Found::Outside,
            Ok(patch) => Found::Properties { p: patch.p, gain: self.gain(r, &patch), bend: self.bend(&patch) },
        }
    }

    /// The exact inverse of the surface that the table was made of, from what the table says; `None` if Newton's method does not get there.
    pub fn exact(&self, forward: &Forward, r: [f64; 2], start: [f64; 2]) -> Option<[f64; 2]> {
        solve(forward, &self.coordinates, self.coordinates.at(r)?, start)
    }

    /// Compares the table at the centres of cells, where bilinear interpolation is worst, with the exact inverse.
    fn check(&mut self, forward: &Forward) {
        let good: Vec<usize> = (0..self.cells.len()).filter(|&c| self.cells[c] == Cell::Good).collect();
        let mut errors = Vec::new();
        for &cell in good.iter().step_by((good.len() / CHECKED_CELLS).max(1)) {
            let place = self.centre(cell);
            let Ok(Patch { p, .. }) = self.patch(place) else { continue };
            let Some(exact) = solve(forward, &self.coordinates, place, p) else { continue };
            if (0..2).all(|k| exact[k] >= self.bounds[k][0] && exact[k] <= self.bounds[k][1]) {
                errors.push((p[0] - exact[0]).abs().max((p[1] - exact[1]).abs()));
            }
        }
        errors.sort_by(f64::total_cmp);
        self.worst_error = errors.last().copied().unwrap_or(0.0);
        self.median_error = errors.get(errors.len() / 2).copied().unwrap_or(0.0);
    }
}

/// The forward surface in (u, v), as a mesh of triangles.
struct Surface {
    points: Vec<[f64; 2]>,
    places: Vec<[f64; 2]>,
    /// Points per row.
    columns: usize,
    /// Widest step between neighbouring points.
    step: f64,
}

impl Surface {
    fn of(forward: &Forward, coordinates: &Coordinates) -> Self {
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
    fn extent(&self) -> [[f64; 2]; 2] {
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
struct Seed {
    p: Option<[f64; 2]>,
    /// From the node to the triangle that `p` comes from, in steps of the table; 0 inside.
    distance: f64,
    /// Whether triangles far apart cover the node.
    folded: bool,
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

/// p with (u, v) = `place` by Newton's method from `start`; `None` if it does not get there.
fn solve(forward: &Forward, coordinates: &Coordinates, place: [f64; 2], start: [f64; 2]) -> Option<[f64; 2]> {
    /// In ln mu: far below the tolerance, far above rounding.
    const CLOSE: f64 = 1e-10;
    let residual = |p: [f64; 2]| {
        let point = forward.at(p);
        let r = point.ln_r.map(libm::exp);
        let at = coordinates.at(r)?;
        let miss = [place[0] - at[0], place[1] - at[1]];
        let [[u, _], [v_0, v_1]] = coordinates.gradient(r);
        let [j_0, j_1] = point.jacobian;
        let jacobian = [[u * j_0[0], u * j_0[1]], [v_0 * j_0[0] + v_1 * j_1[0], v_0 * j_0[1] + v_1 * j_1[1]]];
        Some((miss, jacobian, miss[0] * miss[0] + miss[1] * miss[1]))
    };
    let mut p = start;
    let (mut miss, mut jacobian, mut size) = residual(p)?;
    for _ in 0..40 {
        let gain = inverse(&jacobian)?;
        let mut step = gain.map(|row| row[0] * miss[0] + row[1] * miss[1]);
        let longest = step[0].abs().max(step[1].abs());
        if longest < CLOSE {
            return Some(p);
        }
        // At most a factor e at a time: further the tangent says nothing.
        step = step.map(|s| s / longest.max(1.0));
        let mut next = None;
        for _ in 0..20 {
            let candidate = [p[0] + step[0], p[1] + step[1]];
            match residual(candidate) {
                Some(found) if found.2 < size => {
                    next = Some((candidate, found));
                    break;
                }
                _ => step = step.map(|s| s / 2.0),
            }
        }
        // No way down any more: done, if this is rounding.
        let Some((candidate, found)) = next else { return (longest < 1e-6).then_some(p) };
        p = candidate;
        (miss, jacobian, size) = found;
    }
    None
}
