//! Where a mesh may refract light from a source towards the points of each cell of a grid: what cells near a point have in common is looked for once.

use std::sync::OnceLock;

use glam::DVec3;

use super::crossing::{Ends, Far};

/// Cells along the longest side of each grid.
const CELLS: f64 = 32.0;
/// Grids, each twice as large as the one before.
const GRIDS: usize = 4;
/// Sources, by the indices on both sides of their light, for which there are grids.
const MOST: usize = 4;
/// Boxes of the tree that are kept of a cell at the most: in those a search for a point of the cell begins.
pub(super) const MOST_BOXES: usize = 16;

/// Answers that are found when first asked for. They are no part of what they belong to: copies start without, and all are equal.
#[derive(Debug, Default)]
pub(super) struct Refracting([OnceLock<Light>; MOST]);

/// Of one source.
#[derive(Debug)]
struct Light {
    far: Far,
    n_far: f64,
    n_near: f64,
    grids: [OnceLock<Grid>; GRIDS],
}

#[derive(Debug)]
struct Grid {
    half: DVec3,
    cell: f64,
    counts: [usize; 3],
    cells: Box<[OnceLock<Box<[u32]>>]>,
}

impl Refracting {
    /// Bytes for so many sources at the most.
    pub(super) fn bytes(sources: usize) -> u64 {
        let cells = GRIDS * (CELLS * CELLS * CELLS) as usize;
        (sources.min(MOST) * cells * (size_of::<OnceLock<Box<[u32]>>>() + 4 * MOST_BOXES)) as u64
    }

    /// What `find` says of the cell around the near end, of its middle and the radius (mm) of the ball around it. Everything is relative to the middle of a
    /// box of half size `half`; `None` far outside of that, and for the fifth source.
    #[inline]
    pub(super) fn cell(&self, ends: &Ends, half: DVec3, find: impl FnOnce(DVec3, f64) -> Vec<u32>) -> Option<&[u32]> {
        let reach = (ends.near.abs() / half).max_element();
        let level = (0..GRIDS).find(|&level| reach <= (1_u32 << level).into())?;
        let lights = self.0.iter().map(|light| light.get_or_init(|| Light::of(ends)));
        let light = lights.into_iter().find(|light| light.is_of(ends))?;
        let grid = light.grids[level].get_or_init(|| Grid::of(f64::from(1_u32 << level) * half));
        let (index, middle) = grid.around(ends.near);
        // Half the diagonal, and rounding.
        let radius = 0.5 * grid.cell * 3.0_f64.sqrt() * (1.0 + 1e-9);
        Some(grid.cells[index].get_or_init(|| find(middle, radius).into_boxed_slice()))
    }
}

impl Light {
    fn of(ends: &Ends) -> Self {
        let &Ends { far, n_far, n_near, .. } = ends;
        Self { far, n_far, n_near, grids: Default::default() }
    }

    fn is_of(&self, ends: &Ends) -> bool {
        self.far == ends.far && self.n_far == ends.n_far && self.n_near == ends.n_near
    }
}

impl Grid {
    /// Of that half size.
    fn of(half: DVec3) -> Self {
        let cell = 2.0 * half.max_element() / CELLS;
        let counts = (2.0 * half / cell).to_array().map(|n| (n.ceil() as usize).max(1));
        Self { half, cell, counts, cells: (0..counts.iter().product()).map(|_| OnceLock::new()).collect() }
    }

    /// The number and the middle of the cell around a point.
    fn around(&self, p: DVec3) -> (usize, DVec3) {
        let scaled = (p + self.half) / self.cell;
        let place = [0, 1, 2].map(|axis| (scaled[axis] as usize).min(self.counts[axis] - 1));
        let middle = DVec3::from(place.map(|i| i as f64 + 0.5)) * self.cell - self.half;
        (place[0] + self.counts[0] * (place[1] + self.counts[1] * place[2]), middle)
    }
}

impl Clone for Refracting {
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl PartialEq for Refracting {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}
