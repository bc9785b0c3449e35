//! Rays through the cells of a mesh: in strides as long as nothing is near, cell by cell where there are triangles.

use std::hint::black_box;

use fearless_simd::Simd;
use fearless_simd::prelude::*;

use super::block::{Block, Crossing, Line};
use super::cells::{Cells, Known};
use super::lanes::{Crossings, F, LANES, Rays, U, bits, dot, lane_of};

/// Of a cell: how far behind its wall a ray goes on. Less than what triangles reach into neighbouring cells.
const BEHIND: f32 = 5e-4;
/// Of a cell: as far as this from a wall a ray may be on either side of it, for rounding.
const BESIDE: f32 = 1e-5;
/// What a direction has of an axis at least: of less a ray keeps its place.
const LEAST: f32 = 1e-30;
/// Of coordinates: more than rounding makes of heights above planes.
const ROUNDING: f32 = 1e-6;

impl Cells {
    /// Of the rays that are `asked`, by bits, the first crossing at t in (0, until], out of the solid (`leaves`, by bits) or into it; a
    /// start that rounding put behind the surface counts as one on it.
    #[inline(never)]
    pub fn first<S: Simd>(
        &self,
        simd: S,
        asked: u64,
        rays: &Rays<S>,
        leaves: u64,
        until: &F<S>,
    ) -> [Option<Crossing>; LANES] {
        let mut best: [Option<Crossing>; LANES] = [None; LANES];
        simd.vectorize(
            #[inline(always)]
            || {
                self.march(
                    simd,
                    asked,
                    rays,
                    until,
                    #[inline(always)]
                    |lane, blocks, exit| {
                        let line = Line::new(lane_of(&rays.p, lane), lane_of(&rays.w, lane));
                        let (best, leaves) = (&mut best[lane], leaves >> lane & 1 == 1);
                        for block in blocks {
                            block.meet(
                                simd,
                                &line,
                                #[inline(always)]
                                |c| {
                                    if c.leaves == leaves && c.t > -self.slack && !matches!(best, Some(b) if b.t <= c.t)
                                    {
                                        *best = Some(c);
                                    }
                                },
                            );
                        }
                        // What is further may hide something in a nearer cell.
                        matches!(best, Some(b) if b.t <= exit)
                    },
                );
            },
        );
        for (best, &until) in best.iter_mut().zip(until.as_slice()) {
            *best = best.filter(|b| b.t <= until).map(|b| Crossing { t: b.t.max(0.0), ..b });
        }
        best
    }

    /// All crossings ahead of the rays that are `asked`, at t < until.
    #[inline(never)]
    pub fn crossings<S: Simd>(&self, simd: S, asked: u64, rays: &Rays<S>, until: &F<S>, found: &mut Crossings) {
        let mut all: Vec<(usize, Crossing)> = Vec::with_capacity(LANES);
        simd.vectorize(
            #[inline(always)]
            || {
                self.march(
                    simd,
                    asked,
                    rays,
                    until,
                    #[inline(always)]
                    |lane, blocks, _| {
                        let line = Line::new(lane_of(&rays.p, lane), lane_of(&rays.w, lane));
                        let ahead = -self.slack..until.as_slice()[lane];
                        for block in blocks {
                            block.meet(
                                simd,
                                &line,
                                #[inline(always)]
                                |c| {
                                    // A triangle lies in several cells.
                                    let met = |(l, f): &(usize, Crossing)| *l == lane && f.face == c.face;
                                    if c.t > ahead.start && c.t < ahead.end && !all.iter().any(met) {
                                        all.push((lane, Crossing { t: c.t.max(0.0), ..c }));
                                    }
                                },
                            );
                        }
                        false
                    },
                );
            },
        );
        all.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.t.total_cmp(&b.1.t)));
        found.fill(&all);
    }

    /// Calls `cell` with the triangles of the cells along rays, and where each leaves its cell, until that says true of a lane.
    ///
    /// Where nothing is near a ray goes on by the clearance, beside the surface to where it meets the slab that holds that.
    #[inline(always)]
    fn march<'a, S: Simd>(
        &'a self,
        simd: S,
        asked: u64,
        rays: &Rays<S>,
        until: &F<S>,
        mut cell: impl FnMut(usize, &'a [Block], f32) -> bool,
    ) {
        let (zero, never) = (F::splat(simd, 0.0), F::splat(simd, f32::INFINITY));
        let Rays { p, w } = rays;
        let (mut inverse, mut floor, mut ahead) = (*w, *w, *w);
        let (mut t, mut until) = (zero, *until);
        for axis in 0..3 {
            let size = w[axis].abs().max(LEAST);
            let forward = w[axis].simd_ge(zero);
            inverse[axis] = (1.0 / size).copysign(w[axis]);
            // Beside a wall, and along it.
            floor[axis] = inverse[axis].abs() * (BESIDE * self.cell);
            ahead[axis] = forward.select(F::splat(simd, 1.0), zero);
            let (low, high) = (self.low[axis], self.low[axis] + self.cell * self.counts[axis] as f32);
            let (a, b) = ((low - p[axis]) * inverse[axis], (high - p[axis]) * inverse[axis]);
            t = t.max(a.min(b));
            until = until.min(a.max(b));
        }
        // Rounding of heights.
        let room = (p[0].abs() + p[1].abs() + p[2].abs()) * ROUNDING + self.slack;
        let behind = BEHIND * self.cell;
        let mut active = asked & t.simd_le(until).to_bitmask();
        while active != 0 {
            let mut scaled = *p;
            for axis in 0..3 {
                scaled[axis] = (p[axis] + t * w[axis] - self.low[axis]) * self.inverse;
            }
            let Known { corner, near, clear, normal, low, high, first, count } = self.known(simd, active, &scaled);
            // Where rays leave the cell, and it and its neighbours.
            let (mut exit, mut exit_all) = (never, never);
            for axis in 0..3 {
                let next = corner[axis] + ahead[axis];
                let wall = next * self.cell + self.low[axis];
                let beyond = (next + (ahead[axis] * 2.0 - 1.0)) * self.cell + self.low[axis];
                exit = exit.min(((wall - p[axis]) * inverse[axis]).max(floor[axis]));
                exit_all = exit_all.min((beyond - p[axis]) * inverse[axis]);
            }
            // Where they come to the slab that holds the surface.
            let (start, rate) = (dot(&normal, p), dot(&normal, w));
            let height = start + t * rate;
            let (low, high) = (low - room, high + room);
            let (below, above) = (height.simd_lt(low), height.simd_gt(high));
            let (rises, falls) = (rate.simd_gt(zero), rate.simd_lt(zero));
            let meets = (rises.select(low, high) - start) / rate;
            let comes = (below & rises) | (above & falls);
            let slab = (below | above).select(comes.select(meets, never), t);
            let past = slab.simd_gt(exit.max(t + behind));
            let stride = near.select(past.select(slab.min(exit_all), exit), exit.max(t + clear));
            let filled = U::load_array(simd, count).simd_gt(0);
            let tests = (near & filled & !past & slab.simd_le(until)).to_bitmask() & active;
            // Memory is asked for all of them at once.
            let touched: f32 = bits(tests)
                .map(
                    #[inline(always)]
                    |lane| self.blocks(first[lane], 1)[0].touch(),
                )
                .sum();
            black_box(touched);
            let mut done = 0;
            for lane in bits(tests) {
                let blocks = self.blocks(first[lane], count[lane]);
                done |= u64::from(cell(lane, blocks, exit.as_slice()[lane])) << lane;
            }
            // What lies in the slab may lie at its very beginning. Else rounding must not keep it where it is.
            let stops = near & past & slab.simd_le(exit_all);
            t = stops.select(slab, stride.max(t) + behind);
            active &= t.simd_le(until).to_bitmask() & !done;
        }
    }
}
