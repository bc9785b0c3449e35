//! The bodies of a world in f32, about a place near what the camera sees; and how flights and looks pass through them.

use fearless_simd::prelude::*;
use glam::DVec3;
use turbid_optics::solid::Solid;

use super::lane::{F, M, U, V, choose, splat};
use crate::world::World;

/// A convex solid, mm from the local origin.
#[derive(Clone, Copy, Debug)]
enum Shape {
    Slab { bottom: f32, top: f32 },
    Box { low: [f32; 3], high: [f32; 3] },
    Ellipsoid { center: [f32; 3], inverse_radii: [f32; 3], least: f32 },
}

/// Bodies, highest priority first.
#[derive(Clone, Debug)]
pub struct Ground {
    shapes: Vec<Shape>,
}

/// What a flight within a body meets.
pub struct Passage<S: Simd> {
    /// It leaves its body, or meets one of higher priority.
    pub crosses: M<S>,
    /// Within this distance of its end there is nothing but its own body; where it does not cross.
    pub clear: F<S>,
}

/// Where rays enter and leave a body.
#[derive(Clone, Copy)]
pub struct Span<S: Simd> {
    pub enter: F<S>,
    pub leave: F<S>,
}

impl Ground {
    /// `None` where f32 cannot hold it, or there are other shapes than these: bodies with curved or upright faces further than `range` (mm) from `origin`.
    pub fn about(world: &World, origin: DVec3, range: f64) -> Option<Self> {
        let local = |p: DVec3| (p - origin).as_vec3().to_array();
        let shape = |solid: &Solid| {
            let (low, high) = solid.bounds();
            let near = (low - origin).abs().max((high - origin).abs()).max_element() <= range;
            match *solid {
                // Only its planes count, and what is far from the origin is far from paths.
                Solid::Slab { bottom, top } => {
                    Some(Shape::Slab { bottom: (bottom - origin.z) as f32, top: (top - origin.z) as f32 })
                }
                Solid::Box { low, high } => near.then(|| Shape::Box { low: local(low), high: local(high) }),
                Solid::Ellipsoid { center, radii } => near.then(|| Shape::Ellipsoid {
                    center: local(center),
                    inverse_radii: radii.recip().as_vec3().to_array(),
                    least: (radii.min_element() * (1.0 - 1e-6)) as f32,
                }),
                // The lanes of f64 take what is rarer.
                _ => None,
            }
        };
        let shapes = world.bodies.iter().map(|body| shape(&body.solid)).collect::<Option<Vec<_>>>()?;
        Some(Self { shapes })
    }

    pub fn bodies(&self) -> usize {
        self.shapes.len()
    }

    /// Flights from `r` over `s` along `w` to `end`, each inside its `body`.
    ///
    /// Bodies are convex: one that holds the start is left if and only if it does not hold the end, whatever rounding has done.
    #[inline(always)]
    pub fn pass<S: Simd>(&self, simd: S, body: U<S>, r: V<S>, w: V<S>, s: F<S>, end: V<S>) -> Passage<S> {
        let mut crosses = M::splat(simd, false);
        let mut clear = splat(simd, f32::INFINITY);
        for (j, shape) in self.shapes.iter().enumerate() {
            let j = j as u32;
            let (own, above) = (body.simd_eq(j), body.simd_gt(j));
            // How deep inside the end lies, at least; negative outside.
            let (depth, meets) = match *shape {
                Shape::Slab { bottom, top } => {
                    let over = r.z.simd_ge(top);
                    let (below_top, above_bottom) = (top - end.z, end.z - bottom);
                    let zero = splat(simd, 0.0);
                    let meets = choose(over, below_top, above_bottom).simd_gt(zero);
                    (below_top.min(above_bottom), meets)
                }
                Shape::Box { low, high } => {
                    let (a, b) = (end.from(low), end.from(high));
                    let x = a.x.min(-b.x);
                    (x.min(a.y.min(-b.y)).min(a.z.min(-b.z)), self.meets(simd, *shape, above, r, w, s))
                }
                Shape::Ellipsoid { center, inverse_radii, least } => {
                    let q = end.from(center).scaled(inverse_radii);
                    ((1.0 - q.dot(q).sqrt()) * least, self.meets(simd, *shape, above, r, w, s))
                }
            };
            crosses |= (own & depth.simd_le(0.0)) | (above & meets);
            clear = choose(own | above, clear.min(depth.abs()), clear);
        }
        Passage { crosses, clear }
    }

    /// Whether a flight that starts outside comes to a body; a start that rounding put inside counts.
    #[inline(always)]
    fn meets<S: Simd>(&self, simd: S, shape: Shape, asked: M<S>, r: V<S>, w: V<S>, s: F<S>) -> M<S> {
        if asked.all_false() {
            return asked;
        }
        let Span { enter, leave } = span(simd, shape, r, w);
        enter.simd_lt(leave) & leave.simd_gt(0.0) & enter.simd_le(s)
    }

    /// Where rays enter and leave body `j`.
    #[inline(always)]
    pub fn span<S: Simd>(&self, simd: S, j: usize, r: V<S>, w: V<S>) -> Span<S> {
        span(simd, self.shapes[j], r, w)
    }

    /// The normal of body `j` at points of its surface; neither its length nor its sign matters.
    #[inline(always)]
    pub fn normal<S: Simd>(&self, simd: S, j: usize, p: V<S>) -> V<S> {
        let (zero, one) = (splat(simd, 0.0), splat(simd, 1.0));
        match self.shapes[j] {
            Shape::Slab { .. } => V { x: zero, y: zero, z: one },
            Shape::Box { low, high } => {
                let (a, b) = (p.from(low), p.from(high));
                let off = V { x: a.x.abs().min(b.x.abs()), y: a.y.abs().min(b.y.abs()), z: a.z.abs().min(b.z.abs()) };
                let x = off.x.simd_le(off.y) & off.x.simd_le(off.z);
                let y = off.y.simd_le(off.z);
                V { x: choose(x, one, zero), y: choose(!x & y, one, zero), z: choose(!x & !y, one, zero) }
            }
            Shape::Ellipsoid { center, inverse_radii: i, .. } => {
                p.from(center).scaled([i[0] * i[0], i[1] * i[1], i[2] * i[2]])
            }
        }
    }
}

/// Entry >= exit where the line misses.
#[inline(always)]
fn span<S: Simd>(simd: S, shape: Shape, r: V<S>, w: V<S>) -> Span<S> {
    match shape {
        Shape::Slab { bottom, top } => between(r.z, w.z, bottom, top),
        Shape::Box { low, high } => {
            let x = between(r.x, w.x, low[0], high[0]);
            let y = between(r.y, w.y, low[1], high[1]);
            let z = between(r.z, w.z, low[2], high[2]);
            Span { enter: x.enter.max(y.enter).max(z.enter), leave: x.leave.min(y.leave).min(z.leave) }
        }
        Shape::Ellipsoid { center, inverse_radii, .. } => {
            // A unit sphere, from the point of closest approach, as in `Solid::span`.
            let (o, d) = (r.from(center).scaled(inverse_radii), w.scaled(inverse_radii));
            let inverse = 1.0 / d.dot(d);
            let nearest = -(o.dot(d) * inverse);
            let p = o.plus(nearest, d);
            let half = ((1.0 - p.dot(p)).max(splat(simd, 0.0)) * inverse).sqrt();
            Span { enter: nearest - half, leave: nearest + half }
        }
    }
}

/// Where o + t d lies between two planes.
#[inline(always)]
fn between<S: Simd>(o: F<S>, d: F<S>, low: f32, high: f32) -> Span<S> {
    let inverse = 1.0 / d;
    let (a, b) = ((low - o) * inverse, (high - o) * inverse);
    Span { enter: a.min(b), leave: a.max(b) }
}
