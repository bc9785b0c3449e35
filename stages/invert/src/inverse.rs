//! The inverse table: p = (ln mu_a, ln mu_s') on a uniform grid of (u, v), coordinates of a pair of reflectances in which
//! p is smooth; bilinear in between (see [`Cells`]).

use crate::cells::{Cell, Cells, Eight, Missing, Patch, Place};
use crate::coordinates::Coordinates;
use crate::forward::{Bend, Forward, bend, inverse};
use crate::seeds::{Grid, Mesh};

/// Largest error of ln mu_a or ln mu_s' that the resampling may add.
pub const TOLERANCE: f64 = 1e-3;
/// Nodes along u and v: doubled from the first to the last until the tolerance holds.
const SIZES: [usize; 3] = [256, 512, 1024];
/// Cells at whose centre the resampling is checked, about.
const CHECKED_CELLS: usize = 4000;

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

/// The table.
pub struct InverseTable {
    coordinates: Coordinates,
    grid: Grid,
    cells: Cells,
    /// In the middle of each cell; empty where nobody asks what noise adds to the mean.
    bends: Vec<Eight>,
    bounds: [[f64; 2]; 2],
    /// Largest and median error of p found in the middle of cells.
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
        self.cells.size()
    }

    pub fn with_size(forward: &Forward, size: usize) -> Self {
        let coordinates = Coordinates::of(forward);
        let mesh = Mesh::of(forward, &coordinates);
        let grid = Grid::around(mesh.extent(), size);
        let seeds = grid.seeds(&mesh);
        let solved: Vec<Option<[f64; 2]>> = (seeds.iter().enumerate())
            .map(|(node, seed)| seed.p.and_then(|p| solve(forward, &coordinates, grid.place(node), p)))
            .collect();
        let kind = |node: usize| {
            let corners = [node, node + 1, node + size, node + size + 1];
            if node / size + 1 == size || node % size + 1 == size || corners.iter().any(|&n| solved[n].is_none()) {
                Cell::Empty
            } else if corners.iter().any(|&n| seeds[n].folded) {
                Cell::Folded
            } else {
                Cell::Good
            }
        };
        let kinds = (0..size * size).map(kind).collect();
        let nodes: Vec<[f64; 2]> = solved.iter().map(|p| p.unwrap_or([0.0; 2])).collect();
        let bounds = forward.bounds();
        let held = bounds.map(|[low, high]| [low - TOLERANCE, high + TOLERANCE]);
        let cells = Cells::new(&coordinates, (grid.first, grid.per_unit), &nodes, kinds, held);
        let mut table =
            Self { coordinates, grid, cells, bends: Vec::new(), bounds, worst_error: 0.0, median_error: 0.0 };
        table.check(forward);
        table
    }

    /// The cells, for many pixels at a time.
    pub fn cells(&self) -> &Cells {
        &self.cells
    }

    /// Adds to each cell how p bends there, which says what noise adds to the mean. Constant in a cell: from one to the next it differs by
    /// a hundredth of a correction that is itself of second order.
    pub fn with_bends(mut self, forward: &Forward) -> Self {
        let mut bends = vec![Eight([0.0; 8]); self.size() * self.size()];
        for cell in self.cells.good() {
            let Place { along, .. } = Cells::middle(cell);
            let patch = self.cells.between(self.cells.corners(cell), along);
            let gain = self.gain(self.coordinates.pair(self.grid.middle(cell)), &patch.slope());
            let [a, s] = bend(&forward.curvature(patch.p.map(f64::from)), &gain);
            bends[cell as usize] = Eight([a[0], a[1], a[2], s[0], s[1], s[2], 0.0, 0.0].map(|x| x as f32));
        }
        self.bends = bends;
        self
    }

    /// d p / d (ln R_0, ln R_1) at the pair `r` from d p / d (u, v).
    #[inline(always)]
    pub fn gain(&self, r: [f64; 2], slope: &[[f64; 2]; 2]) -> [[f64; 2]; 2] {
        let [[u, _], [v_0, v_1]] = self.coordinates.gradient(r);
        let [[a_u, a_v], [s_u, s_v]] = *slope;
        [[a_u * u + a_v * v_0, a_v * v_1], [s_u * u + s_v * v_0, s_v * v_1]]
    }

    /// How p bends in a cell: the six numbers of a [`Bend`], of a table that was made [`with_bends`](Self::with_bends).
    #[inline(always)]
    pub fn bend(&self, cell: u32) -> &Eight {
        &self.bends[cell as usize]
    }

    /// The properties that have the reflectances `r` at the two f_x, to the digits of an f32.
    pub fn find(&self, r: [f64; 2]) -> Found {
        let place = self.cells.place(r.map(|r| r as f32));
        match self.cells.patch(place) {
            Err(Missing::Outside) => Found::Outside,
            Err(Missing::Folded) => Found::Folded,
            Ok(patch) => {
                let Eight(bend) = self.bends.get(place.cell as usize).unwrap_or(&Eight([0.0; 8]));
                let bend = [0, 3].map(|k| [bend[k], bend[k + 1], bend[k + 2]].map(f64::from));
                Found::Properties { p: patch.p.map(f64::from), gain: self.gain(r, &patch.slope()), bend }
            }
        }
    }

    /// The exact inverse of the surface that the table was made of, from what the table says; `None` if Newton's method does not get there.
    pub fn exact(&self, forward: &Forward, r: [f64; 2], start: [f64; 2]) -> Option<[f64; 2]> {
        solve(forward, &self.coordinates, self.coordinates.at(r)?, start)
    }

    /// Compares the table in the middle of cells, where bilinear interpolation is worst, with the exact inverse.
    fn check(&mut self, forward: &Forward) {
        let good: Vec<u32> = self.cells.good().collect();
        let mut errors = Vec::new();
        for &cell in good.iter().step_by((good.len() / CHECKED_CELLS).max(1)) {
            let Ok(Patch { p, .. }) = self.cells.patch(Cells::middle(cell)) else { continue };
            let p = p.map(f64::from);
            let Some(exact) = solve(forward, &self.coordinates, self.grid.middle(cell), p) else { continue };
            if (0..2).all(|k| exact[k] >= self.bounds[k][0] && exact[k] <= self.bounds[k][1]) {
                errors.push((p[0] - exact[0]).abs().max((p[1] - exact[1]).abs()));
            }
        }
        errors.sort_by(f64::total_cmp);
        self.worst_error = errors.last().copied().unwrap_or(0.0);
        self.median_error = errors.get(errors.len() / 2).copied().unwrap_or(0.0);
    }
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
