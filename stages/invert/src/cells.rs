//! The inverse table as pixels read it: p = (ln mu_a, ln mu_s') bilinear in the cells of a uniform grid of (u, v), in f32.
//!
//! Reflectances come in f32, and maps go out so: in f32 a look-up adds below 1e-5 to what resampling costs, half the memory holds the table, and a lane
//! has room for twice the pixels.

use crate::coordinates::Coordinates;
use crate::single::ln;

/// What a cell of the table can be used for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cell {
    /// No part of the forward surface lies near.
    Empty,
    Good,
    /// The forward surface covers it more than once.
    Folded,
}

/// Why the table holds nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Missing {
    Outside,
    Folded,
}

/// Where a pair of reflectances lies: the number of its cell, and the shares of its sides that lie below. `along[0]` is NaN for a pair
/// that the grid does not reach; its cell is the first then.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    pub cell: u32,
    pub along: [f32; 2],
}

/// What a table knows of a cell: half a line of the cache, and a single load.
#[derive(Clone, Copy, Debug)]
#[repr(align(32))]
pub struct Eight(pub [f32; 8]);

/// p at a place, with d p / d (u, v).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Patch {
    pub p: [f32; 2],
    /// `[k]`: of p_k by u and by v.
    pub slope: [[f32; 2]; 2],
}

impl Patch {
    /// The slope in the numbers that noise is reckoned in.
    pub fn slope(&self) -> [[f64; 2]; 2] {
        self.slope.map(|row| row.map(f64::from))
    }
}

/// The grid.
pub struct Cells {
    /// R_top as a sum, so that R_top - R_0 keeps all its digits where R_0 is nearly as large.
    r_top: [f32; 2],
    q_top: f32,
    /// First node and nodes per unit along u and v.
    first: [f32; 2],
    per_unit: [f32; 2],
    /// Nodes along each axis.
    size: usize,
    /// At i * size + j, the cell that begins at node (i, j): p of (i, j), (i + 1, j), (i, j + 1) and (i + 1, j + 1); no numbers unless it is good.
    corners: Vec<Eight>,
    kinds: Vec<Cell>,
    /// Lowest and highest p that the table holds.
    bounds: [[f32; 2]; 2],
}

impl Cells {
    /// `nodes`: p at (i, j), index i * size + j; `kinds` as there, of the cells that begin at a node; those of the last row and column are none.
    pub fn new(
        coordinates: &Coordinates,
        (first, per_unit): ([f64; 2], [f64; 2]),
        nodes: &[[f64; 2]],
        kinds: Vec<Cell>,
        bounds: [[f64; 2]; 2],
    ) -> Self {
        let size = nodes.len().isqrt();
        assert!(size * size == nodes.len() && size >= 2 && kinds.len() == nodes.len(), "a square of nodes");
        // Numbers of cells are made in the low bits of an f32.
        assert!(nodes.len() <= 1 << 22, "{size} x {size} nodes are more than a table has");
        let single = |pair: [f64; 2]| pair.map(|x| x as f32);
        let high = coordinates.r_top as f32;
        let corners = |(cell, kind): (usize, &Cell)| match kind {
            Cell::Good => {
                let [a, b, c, d] = [cell, cell + size, cell + 1, cell + size + 1].map(|node| single(nodes[node]));
                Eight([a[0], a[1], b[0], b[1], c[0], c[1], d[0], d[1]])
            }
            _ => Eight([f32::NAN; 8]),
        };
        Self {
            r_top: [high, (coordinates.r_top - f64::from(high)) as f32],
            q_top: coordinates.q_top as f32,
            first: single(first),
            per_unit: single(per_unit),
            size,
            corners: kinds.iter().enumerate().map(corners).collect(),
            kinds,
            bounds: bounds.map(single),
        }
    }

    pub fn size(&self) -> usize {
        self.size
    }

    /// Numbers of the good cells.
    pub fn good(&self) -> impl Iterator<Item = u32> {
        (0_u32..).zip(&self.kinds).filter(|(_, kind)| **kind == Cell::Good).map(|(cell, _)| cell)
    }

    /// Where a pair of reflectances lies, without a branch.
    #[inline(always)]
    pub fn place(&self, r: [f32; 2]) -> Place {
        /// Adding 1.5 * 2^23 rounds to the nearest integer, and leaves that integer in the low bits.
        const ROUND: f32 = 12_582_912.0;
        let (below_top, fringe_free) = ((self.r_top[0] - r[0]) + self.r_top[1], self.q_top * r[0] - r[1]);
        let x = (ln(r[0] / below_top) - self.first[0]) * self.per_unit[0];
        let y = (ln(r[1] / fringe_free) - self.first[1]) * self.per_unit[1];
        let last = (self.size - 1) as f32;
        let inside = (r[0] > 0.0) & (r[1] > 0.0) & (below_top > 0.0) & (fringe_free > 0.0);
        let held = inside & (x >= 0.0) & (x < last) & (y >= 0.0) & (y < last);
        // Where rounding lifts the last of a cell into the next that is the same point.
        let floor = |x: f32| {
            let i = ((x - 0.5) + ROUND) - ROUND;
            if i < last - 1.0 { i } else { last - 1.0 }
        };
        let (i, j) = (floor(x), floor(y));
        let cell = (i * self.size as f32 + j + ROUND).to_bits() & 0x003F_FFFF;
        Place { cell: if held { cell } else { 0 }, along: [if held { x - i } else { f32::NAN }, y - j] }
    }

    /// The middle of a cell.
    pub fn middle(cell: u32) -> Place {
        Place { cell, along: [0.5; 2] }
    }

    /// p at the corners of a cell.
    #[inline(always)]
    pub fn corners(&self, cell: u32) -> &Eight {
        &self.corners[cell as usize]
    }

    /// p between corners; no number where these are none.
    #[inline(always)]
    pub fn between(&self, Eight(corners): &Eight, [s, t]: [f32; 2]) -> Patch {
        let [a_0, s_0, a_1, s_1, a_2, s_2, a_3, s_3] = *corners;
        // Along v on both sides of the cell, then along u.
        let [(a_p, a_slope), (s_p, s_slope)] =
            [[a_0, a_1, a_2, a_3], [s_0, s_1, s_2, s_3]].map(|[low, high, low_v, high_v]| {
                let across = [low_v - low, high_v - high];
                let side = [low + t * across[0], high + t * across[1]];
                let along = side[1] - side[0];
                let slope = [along * self.per_unit[0], (across[0] + s * (across[1] - across[0])) * self.per_unit[1]];
                (side[0] + s * along, slope)
            });
        Patch { p: [a_p, s_p], slope: [a_slope, s_slope] }
    }

    /// p at a place, or why the table holds none.
    pub fn patch(&self, place: Place) -> Result<Patch, Missing> {
        let patch = self.between(self.corners(place.cell), place.along);
        match self.kinds[place.cell as usize] {
            Cell::Folded if !place.along[0].is_nan() => Err(Missing::Folded),
            _ if self.holds(patch.p) => Ok(patch),
            _ => Err(Missing::Outside),
        }
    }

    /// Whether p is one, and within the nodes of the look-up table.
    #[inline(always)]
    pub fn holds(&self, p: [f32; 2]) -> bool {
        let [[a_low, a_high], [s_low, s_high]] = self.bounds;
        (p[0] >= a_low) & (p[0] <= a_high) & (p[1] >= s_low) & (p[1] <= s_high)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// p linear in (u, v) is bilinear too, so that all that is wrong is f32: ln within half an ulp of 8 (2.4e-7 to 5e-7) in both coordinates, times slopes of 2
    /// and 3, and p itself to half an ulp of 16. R_0 comes within 1e-4 of R_top, as with the faintest absorption.
    #[test]
    fn single_precision_is_enough() {
        let coordinates = Coordinates { r_top: 1.123_456_789, q_top: 1.0 };
        let p = |[u, v]: [f64; 2]| [2.0 * u - 3.0 * v + 1.0, -v + 0.5 * u - 2.0];
        let (size, first, per_unit) = (256, [-6.0, -7.0], [16.0, 19.0]);
        let nodes: Vec<[f64; 2]> = (0..size * size)
            .map(|n| p([first[0] + (n / size) as f64 / per_unit[0], first[1] + (n % size) as f64 / per_unit[1]]))
            .collect();
        let good = |n: usize| n / size + 1 < size && n % size + 1 < size;
        let kinds = (0..size * size).map(|n| if good(n) { Cell::Good } else { Cell::Empty }).collect();
        let cells = Cells::new(&coordinates, (first, per_unit), &nodes, kinds, [[-50.0, 50.0]; 2]);
        let (mut worst, mut held) = ([0.0_f64; 2], 0);
        for k in 0..20_000 {
            let t = [0.754_877_666, 0.569_840_291].map(|step| (0.5 + step * f64::from(k)).fract());
            let r = coordinates.pair([-5.9 + 15.2 * t[0], -6.9 + 12.7 * t[1]]).map(|r| r as f32);
            let Some(exact) = coordinates.at(r.map(f64::from)).map(p) else { continue };
            let patch = cells.patch(cells.place(r)).expect("inside the grid");
            (0..2).for_each(|i| worst[i] = worst[i].max((f64::from(patch.p[i]) - exact[i]).abs()));
            held += 1;
        }
        assert!(held > 19_900, "{held}");
        assert!(worst[0] < 6e-6 && worst[1] < 3e-6, "{worst:?}");
    }

    /// No pair without a place has one: beyond the bounds, not above 0, no numbers.
    #[test]
    fn what_has_no_place_is_outside() {
        let coordinates = Coordinates { r_top: 1.0, q_top: 1.0 };
        let kinds = vec![Cell::Good, Cell::Good, Cell::Empty, Cell::Good, Cell::Folded, Cell::Empty, Cell::Empty];
        let kinds = kinds.into_iter().chain([Cell::Empty; 2]).collect();
        let cells = Cells::new(&coordinates, ([-1.0; 2], [1.0; 2]), &[[0.0; 2]; 9], kinds, [[-1.0, 1.0]; 2]);
        let patch = |u: f64, v: f64| cells.patch(cells.place(coordinates.pair([u, v]).map(|r| r as f32)));
        for at in [[-0.5, -0.5], [-0.5, 0.5], [0.5, -0.5]] {
            assert!(patch(at[0], at[1]).is_ok(), "{at:?}");
        }
        assert_eq!(patch(0.5, 0.5), Err(Missing::Folded));
        for at in [[1.5, 0.5], [-1.5, 0.5], [0.5, 1.1], [0.5, -1.1], [80.0, 0.0], [-80.0, 0.0]] {
            assert_eq!(patch(at[0], at[1]), Err(Missing::Outside), "{at:?}");
        }
        let (nan, far, tiny) = (f32::NAN, f32::INFINITY, f32::from_bits(1));
        for r in [
            [nan, 0.2],
            [0.5, nan],
            [far, 0.2],
            [0.5, far],
            [0.0, 0.0],
            [-0.5, 0.2],
            [0.5, -0.2],
            [0.5, 0.5],
            [1.0, 0.5],
            [tiny, tiny],
        ] {
            assert_eq!(cells.patch(cells.place(r)), Err(Missing::Outside), "{r:?}");
        }
    }
}
