//! The bodies of a world in f32, about a place near what the camera sees; and how flights and shadow rays pass through them.

use arrayvec::ArrayVec;
use fearless_simd::prelude::*;
use glam::{DMat3, DVec3};
use turbid_optics::solid::Solid;

use super::facets::Facets;
use super::lane::{F, M, U, V, apart, choose, splat};
use super::limits::{MOST_BODIES, SLIVER};

/// A convex solid, mm from the local origin.
#[derive(Clone, Copy, Debug)]
pub enum Shape {
    Slab {
        bottom: f32,
        top: f32,
    },
    Box {
        low: [f32; 3],
        high: [f32; 3],
    },
    Ellipsoid {
        center: [f32; 3],
        inverse_radii: [f32; 3],
        least: f32,
    },
    Cylinder {
        axis: [f32; 2],
        radius: f32,
        bottom: f32,
        top: f32,
    },
    /// One of [`Ground::meshes`].
    Mesh,
    /// Known by its distance only.
    Other,
}

/// Bodies, highest priority first.
#[derive(Clone, Debug)]
pub struct Ground {
    shapes: Vec<Shape>,
    /// Of each body that stands askew: rows of the rotation from the local axes into its own, about the local origin.
    turns: Vec<Option<[[f32; 3]; 3]>>,
    /// Where all other bodies are known.
    pub meshes: Vec<Facets>,
}

/// A convex body as the lanes see it.
#[derive(Clone, Debug)]
pub struct Part {
    pub solid: Solid,
    pub material: usize,
    /// Whether there is anything in it.
    pub filled: bool,
    /// Whether flights go on in it: it scatters.
    pub open: bool,
}

/// Boundaries that a flight may cross in lanes.
const MOST_INTERFACES: usize = 4;

/// More than rounding moves places by, of their coordinates.
const NEARLY: f32 = 4e-6;

/// What a flight within a body meets.
#[derive(Clone, Copy)]
pub struct Passage<S: Simd> {
    /// It leaves its body, or meets one of higher priority.
    pub crosses: M<S>,
    /// Within this distance of its end there is nothing but its own body; where it does not cross.
    pub clear: F<S>,
}

/// Where flights that leave their body, or meet one of higher priority, come to.
pub struct Onward<S: Simd> {
    /// mm to the end of their own body, and to where the next one that is filled begins.
    pub leaves: F<S>,
    pub enters: F<S>,
    /// That body, where `open` says that flights go on in it.
    pub body: U<S>,
    pub open: M<S>,
    /// Nothing more comes.
    pub escapes: M<S>,
}

/// Where rays enter and leave a body.
#[derive(Clone, Copy)]
pub struct Chord<S: Simd> {
    pub enter: F<S>,
    pub leave: F<S>,
}

/// One of each body.
pub type Chords<S> = ArrayVec<Chord<S>, MOST_BODIES>;

impl Ground {
    /// Bodies with curved or upright faces further than `range` (mm) from `origin` are others too: f32 does not hold them. Meshes are
    /// to be [prepared](Facets::prepare) before lines meet them.
    pub fn about(parts: &[Part], origin: DVec3, range: f64) -> Self {
        let (mut shapes, turns): (Vec<Shape>, Vec<Option<DMat3>>) =
            parts.iter().map(|part| of_solid(&part.solid, origin, range)).unzip();
        let rows = |into: DMat3| into.transpose().to_cols_array_2d().map(|row| row.map(|x| x as f32));
        let turns = turns.into_iter().map(|turn| turn.map(rows)).collect();
        // All or none: distances from others and from meshes would have to be asked for together.
        let others = (0..parts.len()).filter(|&j| matches!(shapes[j], Shape::Other));
        let meshes: Option<Vec<Facets>> = others.map(|j| facets(&parts[j].solid, j, origin, range)).collect();
        for mesh in meshes.iter().flatten() {
            shapes[mesh.body as usize] = Shape::Mesh;
        }
        Self { shapes, turns, meshes: meshes.unwrap_or_default() }
    }

    pub fn is_mesh(&self, j: usize) -> bool {
        matches!(self.shapes[j], Shape::Mesh)
    }

    /// Whether body `j` is known by its distance only.
    pub fn is_other(&self, j: usize) -> bool {
        matches!(self.shapes[j], Shape::Other)
    }

    /// Whether body `j` is known in axes of its own.
    pub fn is_turned(&self, j: usize) -> bool {
        self.turns[j].is_some()
    }

    /// In the axes of the body.
    pub fn shape(&self, j: usize) -> Shape {
        self.shapes[j]
    }

    /// A place or direction in the axes of body `j`.
    #[inline(always)]
    fn own<S: Simd>(&self, j: usize, v: V<S>) -> V<S> {
        match self.turns[j] {
            None => v,
            Some([x, y, z]) => V { x: v.along(x), y: v.along(y), z: v.along(z) },
        }
    }

    pub fn bodies(&self) -> usize {
        self.shapes.len()
    }

    /// Flights from `r` over `s` along `w` to `end`, each inside its `body`; meshes apart.
    ///
    /// Bodies are convex: one that holds the start is left if and only if it does not hold the end, whatever rounding has done.
    #[inline(always)]
    pub fn pass<S: Simd>(&self, simd: S, body: U<S>, r: V<S>, w: V<S>, s: F<S>, end: V<S>) -> Passage<S> {
        apart::<S, _>(
            #[inline(always)]
            || {
                let mut crosses = M::splat(simd, false);
                let mut clear = splat(simd, f32::INFINITY);
                for (j, shape) in self.shapes.iter().enumerate() {
                    if matches!(shape, Shape::Mesh | Shape::Other) {
                        continue;
                    }
                    let (r, w, end) = (self.own(j, r), self.own(j, w), self.own(j, end));
                    let j = j as u32;
                    let (own, above) = (body.simd_eq(j), body.simd_gt(j));
                    // How deep inside the end lies, at least; negative outside. What is farther from the end of a flight than its start is not met by it.
                    let (flight, comes) =
                        ((r, w, s), |depth: F<S>| above & (depth + s * 1.001).simd_ge(end.size() * -NEARLY));
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
                            let depth = a.x.min(-b.x).min(a.y.min(-b.y)).min(a.z.min(-b.z));
                            (depth, self.meets(simd, *shape, comes(depth), flight))
                        }
                        Shape::Ellipsoid { center, inverse_radii, least } => {
                            let q = end.from(center).scaled(inverse_radii);
                            let depth = (1.0 - q.dot(q).sqrt()) * least;
                            (depth, self.meets(simd, *shape, comes(depth), flight))
                        }
                        Shape::Cylinder { axis, radius, bottom, top } => {
                            let (x, y) = (end.x - axis[0], end.y - axis[1]);
                            let side = radius - (x * x + y * y).sqrt();
                            let depth = side.min((top - end.z).min(end.z - bottom));
                            (depth, self.meets(simd, *shape, comes(depth), flight))
                        }
                        Shape::Mesh | Shape::Other => unreachable!("passed over"),
                    };
                    crosses |= (own & depth.simd_le(0.0)) | (above & meets);
                    clear = choose(own | above, clear.min(depth.abs()), clear);
                }
                Passage { crosses, clear }
            },
        )
    }

    /// Whether a flight that starts outside comes to a body, in whose axes it is given; a start that rounding put inside counts.
    #[inline(always)]
    fn meets<S: Simd>(&self, simd: S, shape: Shape, asked: M<S>, (r, w, s): (V<S>, V<S>, F<S>)) -> M<S> {
        if asked.all_false() {
            return asked;
        }
        let Chord { enter, leave } = chord(simd, shape, r, w);
        enter.simd_lt(leave) & leave.simd_gt(0.0) & enter.simd_le(s)
    }

    /// Whether rays from within `body` get so far before they leave it or meet one of higher priority. Without meshes.
    #[inline(always)]
    pub fn is_free<S: Simd>(&self, simd: S, parts: &[Part], body: U<S>, r: V<S>, w: V<S>, distance: F<S>) -> M<S> {
        let mut free = M::splat(simd, true);
        if let ([Shape::Slab { .. }], [None]) = (&self.shapes[..], &self.turns[..]) {
            return free;
        }
        let size = r.x.abs().max(r.y.abs().max(r.z.abs()));
        let until = distance - (distance + size) * SLIVER;
        for j in 0..parts.len() {
            let Chord { enter, leave } = self.chord(simd, j, r, w);
            let (own, above) = (body.simd_eq(j as u32), body.simd_gt(j as u32));
            let meets = above & enter.simd_lt(leave) & leave.simd_gt(splat(simd, 0.0)) & enter.simd_lt(until);
            free &= !(meets | (own & leave.simd_lt(until)));
        }
        free
    }

    /// Follows the rays of some lanes from within `body` straight through boundaries and voids to the next filled body.
    #[inline(always)]
    pub fn onward<S: Simd>(&self, simd: S, parts: &[Part], asked: M<S>, body: U<S>, r: V<S>, w: V<S>) -> Onward<S> {
        apart::<S, _>(
            #[inline(always)]
            || {
                let (never, zero, no) = (splat(simd, f32::INFINITY), splat(simd, 0.0), M::splat(simd, false));
                let mut onward = Onward { leaves: never, enters: never, body, open: no, escapes: no };
                // A single convex one is not come back to.
                if parts.len() == 1 && self.meshes.is_empty() {
                    onward.escapes = M::splat(simd, true);
                    return onward;
                }
                if parts.len() > MOST_BODIES {
                    return onward;
                }
                let mut chords = [Chord { enter: zero, leave: zero }; MOST_BODIES];
                let mut again = 0;
                for (j, chord) in chords.iter_mut().enumerate().take(parts.len()) {
                    *chord = if self.is_mesh(j) {
                        self.chord_in_mesh(simd, j, asked, r, w, &mut again).0
                    } else {
                        self.chord(simd, j, r, w)
                    };
                    // One that is missed lies nowhere.
                    let hit = chord.enter.simd_lt(chord.leave);
                    *chord = Chord { enter: choose(hit, chord.enter, never), leave: choose(hit, chord.leave, -never) };
                    let (own, above) = (body.simd_eq(j as u32), body.simd_gt(j as u32));
                    let end = choose(own, chord.leave, choose(above & chord.leave.simd_gt(zero), chord.enter, never));
                    onward.leaves = onward.leaves.min(end);
                }
                onward.leaves = onward.leaves.max(zero);
                let mut t = onward.leaves;
                let mut found = no;
                let size = r.x.abs().max(r.y.abs().max(r.z.abs()));
                for _ in 0..MOST_INTERFACES {
                    let just_behind = t + (t + size) * SLIVER;
                    let (mut holder, mut filled, mut open, mut next) = (body, no, no, never);
                    for (j, (chord, part)) in chords.iter().zip(parts).enumerate().rev() {
                        let (begun, over) = (chord.enter.simd_le(just_behind), chord.leave.simd_le(just_behind));
                        let holds = begun & !over;
                        holder = holds.select(U::splat(simd, j as u32), holder);
                        filled = if part.filled { filled | holds } else { filled & !holds };
                        open = if part.open { open | holds } else { open & !holds };
                        next = next.min(choose(over, never, choose(begun, chord.leave, chord.enter)));
                    }
                    onward.body = found.select(onward.body, holder);
                    onward.open |= !found & open;
                    found |= filled;
                    t = choose(found, t, next);
                }
                onward.enters = t;
                let once = !M::from_bitmask(simd, again);
                onward.open &= once & t.simd_lt(f32::MAX);
                onward.escapes = once & t.simd_ge(f32::MAX);
                onward
            },
        )
    }

    /// Where rays enter and leave body `j`.
    #[inline(always)]
    pub fn chord<S: Simd>(&self, simd: S, j: usize, r: V<S>, w: V<S>) -> Chord<S> {
        chord(simd, self.shapes[j], self.own(j, r), self.own(j, w))
    }

    /// The normal of body `j` at points of its surface; neither its length nor its sign matters.
    #[inline(always)]
    pub fn normal<S: Simd>(&self, simd: S, j: usize, p: V<S>) -> V<S> {
        apart::<S, _>(
            #[inline(always)]
            || {
                let (zero, one) = (splat(simd, 0.0), splat(simd, 1.0));
                let p = self.own(j, p);
                let normal = match self.shapes[j] {
                    Shape::Slab { .. } => V { x: zero, y: zero, z: one },
                    Shape::Box { low, high } => {
                        let (a, b) = (p.from(low), p.from(high));
                        let off =
                            V { x: a.x.abs().min(b.x.abs()), y: a.y.abs().min(b.y.abs()), z: a.z.abs().min(b.z.abs()) };
                        let x = off.x.simd_le(off.y) & off.x.simd_le(off.z);
                        let y = off.y.simd_le(off.z);
                        V { x: choose(x, one, zero), y: choose(!x & y, one, zero), z: choose(!x & !y, one, zero) }
                    }
                    Shape::Cylinder { axis, radius, bottom, top } => {
                        let (x, y) = (p.x - axis[0], p.y - axis[1]);
                        let side = (radius - (x * x + y * y).sqrt()).abs();
                        let round = side.simd_le((top - p.z).abs().min((p.z - bottom).abs()));
                        V { x: choose(round, x, zero), y: choose(round, y, zero), z: choose(round, zero, one) }
                    }
                    Shape::Mesh | Shape::Other => unreachable!("they have faces of their own, or are not looked past"),
                    Shape::Ellipsoid { center, inverse_radii: i, .. } => {
                        p.from(center).scaled([i[0] * i[0], i[1] * i[1], i[2] * i[2]])
                    }
                };
                match self.turns[j] {
                    None => normal,
                    Some([x, y, z]) => {
                        let column = |i: usize| normal.along([x[i], y[i], z[i]]);
                        V { x: column(0), y: column(1), z: column(2) }
                    }
                }
            },
        )
    }
}

/// A solid as lanes know it, with the rotation into its own axes where they are not the world's. Places are relative to `origin`, before that rotation.
fn of_solid(solid: &Solid, origin: DVec3, range: f64) -> (Shape, Option<DMat3>) {
    let local = |p: DVec3| (p - origin).as_vec3().to_array();
    let (low, high) = solid.bounds();
    let far = (low - origin).abs().max((high - origin).abs());
    let shape = match *solid {
        // Only its planes count, and what is far from the origin is far from paths.
        Solid::Slab { bottom, top } => Shape::Slab { bottom: (bottom - origin.z) as f32, top: (top - origin.z) as f32 },
        Solid::Box { low, high } if far.max_element() <= range => Shape::Box { low: local(low), high: local(high) },
        Solid::Ellipsoid { center, radii } if far.max_element() <= range => Shape::Ellipsoid {
            center: local(center),
            inverse_radii: radii.recip().as_vec3().to_array(),
            least: (radii.min_element() * (1.0 - 1e-6)) as f32,
        },
        Solid::Cylinder { axis, radius, bottom, top } if far.x.max(far.y) <= range => Shape::Cylinder {
            axis: (axis - origin.truncate()).as_vec2().to_array(),
            radius: radius as f32,
            bottom: (bottom - origin.z) as f32,
            top: (top - origin.z) as f32,
        },
        Solid::Turned(ref turned) => {
            let frame = &turned.frame;
            let (shape, turn) = of_solid(&turned.solid, frame.point_into(origin), range);
            let into =
                DMat3::from_cols_array_2d(&[DVec3::X, DVec3::Y, DVec3::Z].map(|w| frame.direction_into(w).to_array()));
            return (shape, Some(turn.map_or(into, |inner| inner * into)));
        }
        _ => Shape::Other,
    };
    (shape, None)
}

/// A mesh for lanes, where it is one and f32 holds it.
fn facets(solid: &Solid, body: usize, origin: DVec3, range: f64) -> Option<Facets> {
    let Solid::Mesh(mesh) = solid else { return None };
    let (low, high) = solid.bounds();
    let far = (low - origin).abs().max((high - origin).abs()).max_element();
    if far <= range { Facets::of(mesh, body, origin) } else { None }
}

/// Entry >= exit where the line misses.
#[inline(always)]
pub fn chord<S: Simd>(simd: S, shape: Shape, r: V<S>, w: V<S>) -> Chord<S> {
    apart::<S, _>(
        #[inline(always)]
        || {
            match shape {
                Shape::Slab { bottom, top } => between(r.z, w.z, bottom, top),
                Shape::Box { low, high } => {
                    let x = between(r.x, w.x, low[0], high[0]);
                    let y = between(r.y, w.y, low[1], high[1]);
                    let z = between(r.z, w.z, low[2], high[2]);
                    Chord { enter: x.enter.max(y.enter).max(z.enter), leave: x.leave.min(y.leave).min(z.leave) }
                }
                Shape::Ellipsoid { center, inverse_radii, .. } => {
                    // A unit sphere, from the point of closest approach, as in `Solid::chord`.
                    let (o, d) = (r.from(center).scaled(inverse_radii), w.scaled(inverse_radii));
                    let inverse = 1.0 / d.dot(d);
                    let nearest = -(o.dot(d) * inverse);
                    let p = o.plus(nearest, d);
                    let half = ((1.0 - p.dot(p)).max(splat(simd, 0.0)) * inverse).sqrt();
                    Chord { enter: nearest - half, leave: nearest + half }
                }
                Shape::Cylinder { axis, radius, bottom, top } => {
                    let inverse_radius = 1.0 / radius;
                    let (ox, oy) = ((r.x - axis[0]) * inverse_radius, (r.y - axis[1]) * inverse_radius);
                    let (dx, dy) = (w.x * inverse_radius, w.y * inverse_radius);
                    // Along the axis the side is infinitely far, or nowhere.
                    let d2 = (dx * dx + dy * dy).max(splat(simd, 1e-30));
                    let inverse = 1.0 / d2;
                    let nearest = -((ox * dx + oy * dy) * inverse);
                    let (px, py) = (ox + nearest * dx, oy + nearest * dy);
                    let half = ((1.0 - (px * px + py * py)).max(splat(simd, 0.0)) * inverse).sqrt();
                    let caps = between(r.z, w.z, bottom, top);
                    Chord { enter: (nearest - half).max(caps.enter), leave: (nearest + half).min(caps.leave) }
                }
                Shape::Mesh | Shape::Other => unreachable!("they are cut in `mesh.rs`, or not at all"),
            }
        },
    )
}

/// Where o + t d lies between two planes.
#[inline(always)]
fn between<S: Simd>(o: F<S>, d: F<S>, low: f32, high: f32) -> Chord<S> {
    let inverse = 1.0 / d;
    let (a, b) = ((low - o) * inverse, (high - o) * inverse);
    Chord { enter: a.min(b), leave: a.max(b) }
}
