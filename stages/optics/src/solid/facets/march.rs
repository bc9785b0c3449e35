//! Rays through the cells of a mesh: in strides as long as nothing is near, cell by cell where there are triangles.

use fearless_simd::Simd;
use glam::Vec3;

use super::block::{Block, Crossing, Line};
use super::cells::{Cell, Cells};

/// Of a cell: how far behind its wall a ray goes on. Less than what triangles reach into neighbouring cells.
const BEHIND: f32 = 5e-4;

impl Cells {
    /// The first crossing of the ray p + t w, t in (0, until], out of the solid or into it; a start that rounding put behind the
    /// surface counts as one on it.
    #[inline(always)]
    pub fn first<S: Simd>(&self, simd: S, p: [f32; 3], w: [f32; 3], leaves: bool, until: f32) -> Option<Crossing> {
        let line = Line::new(p, w);
        let mut best: Option<Crossing> = None;
        self.march(
            Vec3::from(p),
            Vec3::from(w),
            until,
            #[inline(always)]
            |blocks, exit| {
                for block in blocks {
                    block.meet(
                        simd,
                        &line,
                        #[inline(always)]
                        |c| {
                            if c.leaves == leaves && c.t > -self.slack && best.is_none_or(|b| c.t < b.t) {
                                best = Some(c);
                            }
                        },
                    );
                }
                // What is further may hide something in a nearer cell.
                best.is_some_and(|b| b.t <= exit)
            },
        );
        best.filter(|b| b.t <= until).map(|b| Crossing { t: b.t.max(0.0), ..b })
    }

    /// All crossings ahead of p, in order.
    #[inline(always)]
    pub fn crossings<S: Simd>(&self, simd: S, p: [f32; 3], w: [f32; 3], found: &mut Vec<Crossing>) {
        let line = Line::new(p, w);
        found.clear();
        self.march(
            Vec3::from(p),
            Vec3::from(w),
            f32::INFINITY,
            #[inline(always)]
            |blocks, _| {
                for block in blocks {
                    block.meet(
                        simd,
                        &line,
                        #[inline(always)]
                        |c| {
                            if c.t > -self.slack && found.iter().all(|f| f.face != c.face) {
                                found.push(Crossing { t: c.t.max(0.0), ..c });
                            }
                        },
                    );
                }
                false
            },
        );
        found.sort_by(|a, b| a.t.total_cmp(&b.t));
    }

    /// Calls `cell` with the triangles of the cells along a ray, and where it leaves each, until that says true.
    #[inline(always)]
    fn march<'a>(&'a self, p: Vec3, w: Vec3, until: f32, mut cell: impl FnMut(&'a [Block], f32) -> bool) {
        let inverse = 1.0 / w.abs();
        // In what of t is ahead in the grid. Along an axis of which w has nothing, the limits are infinite or not a number.
        let [nx, ny, nz] = self.counts;
        let high = self.low + self.cell * Vec3::new(nx as f32, ny as f32, nz as f32);
        let ahead = w.cmpge(Vec3::ZERO);
        let enters = Vec3::select(ahead, self.low - p, p - high) * inverse;
        let leaves = Vec3::select(ahead, high - p, p - self.low) * inverse;
        let least = |v: Vec3| v.x.min(v.y).min(v.z);
        let mut t = enters.x.max(enters.y).max(enters.z).max(0.0);
        let until = until.min(least(leaves));
        let behind = BEHIND * self.cell;
        while t <= until {
            let place = self.place(self.scaled(p + t * w));
            let corner = Vec3::new(place[0] as f32, place[1] as f32, place[2] as f32);
            let near = self.low + self.cell * corner;
            let far = self.low + self.cell * (corner + 1.0);
            let exit = least(Vec3::select(ahead, far - p, p - near).max(Vec3::ZERO) * inverse);
            let stride = match self.at(place) {
                Cell::Empty(clear) => exit.max(t + clear),
                Cell::Blocks(blocks) => {
                    if cell(blocks, exit) {
                        return;
                    }
                    exit
                }
            };
            // Rounding must not keep it where it is.
            t = stride.max(t) + behind;
        }
    }
}
