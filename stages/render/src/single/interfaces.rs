//! Connections by one refraction, through the curved and plane interfaces of convex bodies of one refractive index, in f32 lanes.
//!
//! `Walker::find_known` for worlds in which camera and projector are outside of all bodies: of each face the place where Snell's law takes light to a
//! point. It is a connection if its inner part is within the bodies and its outer part is not. `docs/theory/render.md` derives the irradiance.

use fearless_simd::prelude::*;
use glam::DVec3;

use super::bend::{advanced, tangent};
use super::face::{Form, Interfaces, Within, extent, faces_of};
use super::frame::Frame;
use super::ground::{Chord, Ground, Part, Shape, chord};
use super::lane::{F, M, U, V, choose, splat};
use super::limits::{MOST_FACES, MOST_TURNING, SLIVER};
use super::visibility::{Visibility, chords, own_length};
use crate::bsdf::Bsdf;
use crate::strata::Bending;
use crate::walker::Walker;

/// How light comes to points through one face.
#[derive(Clone)]
pub struct Refraction<S: Simd> {
    /// Whether it does.
    pub found: M<S>,
    /// Lanes that do not know.
    pub unsure: M<S>,
    /// Unit vector from the point against it.
    pub towards: V<S>,
    /// mm to the face, and where that is.
    pub length: F<S>,
    pub foot: V<S>,
    /// Unit vector out of the body there.
    pub normal: V<S>,
    /// Irradiance of a surface that faces it at the point, over n^2, over that of one at the foot that faces the light.
    pub gain: F<S>,
    /// Optical depth up to the face.
    pub tau: F<S>,
}

/// What an estimate is aimed at.
pub struct Heading<S: Simd> {
    /// Unit vector towards the light.
    pub towards: V<S>,
    /// Optical depth up to the interface, and its unit normal outwards.
    pub tau: F<S>,
    pub normal: V<S>,
}

/// Where Snell's law may hold.
pub(super) struct Place<S: Simd> {
    pub foot: V<S>,
    /// Unit vector out of the body.
    pub normal: V<S>,
    pub found: M<S>,
    pub unsure: M<S>,
}

/// Newton's method doubles the digits; from the straight line it needs four or five steps.
const MOST_STEPS: usize = 12;
/// After a step of so much of the distance (or radius) some 1e-7 of it is left.
const ENOUGH: f32 = 3e-4;
/// How often the beginning of that is bettered.
const BENT: usize = 2;
/// Of the second derivatives' determinant, some n^2 where the interface is near: below this light is near a focus, where it may come by several places.
const NEAR_FOCUS: f32 = 1e-3;
/// What bodies may leave out of the inner part of a connection, or take of its outer one: of its length, and of the coordinates.
const SLACK: f32 = 1e-5;

impl Interfaces {
    /// `None` where light does not bend, or not like this.
    pub fn of(walker: &Walker<'_>, parts: &[Part], ground: &Ground, origin: DVec3) -> Option<Self> {
        let s = walker.setting();
        if walker.bending != Bending::AtInterfaces || !walker.mirrors.is_empty() || !s.light.shines() {
            return None;
        }
        let material = |part: &Part| &s.world.materials[part.material];
        let clear = || parts.iter().filter(|part| !material(part).is_opaque());
        let n = clear().next().map(|part| material(part).n)?;
        let alike = clear().all(|part| material(part).n == n && material(part).bsdf == Bsdf::Smooth);
        let (eye, lamp) = (s.camera.view.position, s.light.view.position);
        let outside = !parts.iter().any(|part| part.solid.contains(eye) || part.solid.contains(lamp));
        let known = (0..parts.len()).all(|j| !ground.is_other(j) && !ground.is_turned(j));
        // Nothing carved: holes have interfaces that bulge the other way.
        let whole = parts.len() == s.world.bodies.len() && parts.len() <= MOST_TURNING;
        if n <= 1.0 || !alike || !outside || !known || !whole {
            return None;
        }
        let mut faces = Vec::new();
        for (body, part) in parts.iter().enumerate().filter(|(_, part)| !material(part).is_opaque()) {
            faces_of(&part.solid, ground.shape(body), body, origin, lamp, &mut faces);
        }
        let shortest = clear().map(|part| 1.0 / material(part).mu_t()).fold(f64::INFINITY, f64::min);
        let (m, ulp) = (n as f32, f64::from(f32::EPSILON));
        let reach = parts.iter().map(|part| extent(&part.solid, origin)).fold(0.0, f64::max);
        (faces.len() <= MOST_FACES).then(|| Self {
            faces,
            light: (lamp - origin).as_vec3().to_array(),
            m,
            excess: ((n - 1.0) * (n + 1.0)) as f32,
            // Also in f32, whose last digit may be more, and of planes of facets some.
            behind: (1e-6 * shortest).max(if ground.meshes.is_empty() { 4.0 } else { 16.0 } * ulp * reach),
        })
    }

    /// How the light that bends at a face comes to points in the bodies. Compiled once for all callers.
    #[inline(never)]
    pub fn refraction<S: Simd>(&self, simd: S, frame: &Frame<'_>, index: usize, asked: M<S>, p: V<S>) -> Refraction<S> {
        simd.vectorize(
            #[inline(always)]
            || self.refracted_by(simd, frame, index, asked, p),
        )
    }

    #[inline(always)]
    fn refracted_by<S: Simd>(&self, simd: S, frame: &Frame<'_>, index: usize, asked: M<S>, p: V<S>) -> Refraction<S> {
        let face = &self.faces[index];
        let place = match face.form {
            Form::Flat { axis, at, up, height, within } => {
                self.through_plane(simd, asked, p, (axis, at, up), height, within)
            }
            Form::Round { shape, least, low, high } => self.through_round(simd, asked, p, shape, least, [low, high]),
        };
        let round = if let Form::Round { shape, .. } = face.form { Some(shape) } else { None };
        let (mut refraction, a) = self.by_place(simd, round, asked, p, place);
        let Refraction { foot, towards, length, .. } = refraction;
        let size = p.size().max(foot.size()).max(length);
        let slack = (length + size) * SLACK;
        // Convex, the body of the face ends there, and is not come back to.
        let inner = passed(simd, frame, (p, towards, length), (face.body, length));
        refraction.found &= (length - inner.length).abs().simd_le(slack) & !inner.blocked;
        refraction.tau = inner.tau;
        if refraction.found.any_true() {
            let outer =
                passed(simd, frame, (foot, a, self.to_light(foot).1), (face.body, splat(simd, f32::NEG_INFINITY)));
            refraction.found &= outer.length.simd_le(slack) & !outer.blocked;
        }
        refraction
    }

    /// What light brings by a place, whatever stands in the way: `tau` is 0. Beside it the unit vector from there towards the light.
    #[inline(always)]
    pub(super) fn by_place<S: Simd>(
        &self,
        simd: S,
        round: Option<Shape>,
        asked: M<S>,
        p: V<S>,
        place: Place<S>,
    ) -> (Refraction<S>, V<S>) {
        let Place { foot, normal, .. } = place;
        // From the foot outwards by the light's own direction: near the interface that of the inner part has few digits.
        let (light, d2) = (self.to_light(foot), foot.minus(p).dot(foot.minus(p)).sqrt());
        let (a, _) = light;
        let cos_out = a.dot(normal);
        let towards = self.refracted(a, normal);
        let cos_in = towards.dot(normal);
        let (s, q) = (cos_out + cos_in * self.m, cos_out * self.m + cos_in);
        let transmitted = cos_out * cos_in * (2.0 * self.m) * (1.0 / (s * s) + 1.0 / (q * q));
        let [uu, uv, vv] = self.second(simd, round, foot, normal, light, (towards, d2));
        let spread = uu * vv - uv * uv;
        let passes = cos_out.simd_gt(0.0);
        let convex = uu.simd_gt(0.0) & spread.simd_gt(NEAR_FOCUS);
        let refraction = Refraction {
            found: asked & place.found & !place.unsure & passes & convex,
            unsure: asked & (place.unsure | (place.found & passes & !convex)),
            towards,
            length: d2,
            foot,
            normal,
            gain: transmitted * cos_in * cos_out / spread,
            tau: splat(simd, 0.0),
        };
        (refraction, a)
    }

    /// Towards the light as the interface of each lane's own body bends it, `least` the optical depth of that at least; see `Walker::heading_past_interfaces`.
    #[inline(never)]
    pub fn heading<S: Simd>(&self, simd: S, frame: &Frame<'_>, body: U<S>, r: V<S>, least: F<S>) -> Heading<S> {
        simd.vectorize(
            #[inline(always)]
            || {
                let (mut towards, _) = self.to_light(r);
                let (mut distance, mut normal, mut mu_t) = (splat(simd, 0.0), towards, splat(simd, 0.0));
                for _ in 0..2 {
                    let before = towards;
                    for j in (0..frame.parts.len()).filter(|&j| frame.parts[j].open && !frame.ground.is_mesh(j)) {
                        let own = body.simd_eq(j as u32);
                        if own.all_false() {
                            continue;
                        }
                        let leave = frame.ground.chord(simd, j, r, before).leave.max(splat(simd, 0.0));
                        let foot = r.plus(leave, before);
                        let n = frame.ground.normal(simd, j, foot);
                        let n = n.times((1.0 / n.dot(n).sqrt()).copysign(n.dot(before)));
                        let a = self.to_light(foot).0;
                        distance = choose(own, leave, distance);
                        normal = n.or(own, normal);
                        towards = self.refracted(a, n).or(own & a.dot(n).simd_gt(0.0), towards);
                        mu_t = choose(own, splat(simd, frame.mu_t[j]), mu_t);
                    }
                }
                let mut heading = Heading { towards, tau: distance * mu_t, normal };
                for mesh in &frame.ground.meshes {
                    let own = body.simd_eq(mesh.body);
                    if frame.parts[mesh.body as usize].open && own.any_true() {
                        heading = self.past_facets(simd, frame, mesh, own, (r, least)).or(own, &heading);
                    }
                }
                heading
            },
        )
    }

    /// Unit vectors inside towards the light that comes from a; n is the normal outwards.
    #[inline(always)]
    pub(super) fn refracted<S: Simd>(&self, a: V<S>, n: V<S>) -> V<S> {
        let inverse = 1.0 / self.m;
        let cos_out = a.dot(n);
        let cos_in = (1.0 - (1.0 - cos_out * cos_out) * (inverse * inverse)).sqrt();
        a.times(splat(a.x.token(), inverse)).plus(cos_in - cos_out * inverse, n)
    }

    /// Unit vectors towards the light, and how far off it is.
    #[inline(always)]
    pub(super) fn to_light<S: Simd>(&self, p: V<S>) -> (V<S>, F<S>) {
        let d = p.from(self.light).times(splat(p.x.token(), -1.0));
        let distance = d.dot(d).sqrt();
        (d.times(1.0 / distance), distance)
    }

    /// As `bend::Plane::refraction`, for any axis.
    #[inline(always)]
    fn through_plane<S: Simd>(
        &self,
        simd: S,
        asked: M<S>,
        p: V<S>,
        (axis, at, up): (usize, f32, f32),
        height: f32,
        within: Within,
    ) -> Place<S> {
        let zero = splat(simd, 0.0);
        let [k, i, j] = [axis, (axis + 1) % 3, (axis + 2) % 3];
        let p = [p.x, p.y, p.z];
        let depth = (at - p[k]) * up;
        let beyond = depth.simd_ge(0.0);
        let depth = depth.max(zero);
        let (x, y) = (self.light[i] - p[i], self.light[j] - p[j]);
        let advance = (x * x + y * y).sqrt();
        let height = splat(simd, height);
        let t = tangent(simd, advance, (depth, height), self.m, self.excess);
        let (q, ..) = advanced(t, (depth, height), (self.m * self.m, self.excess));
        let aside = depth * t / q * choose(advance.simd_gt(zero), 1.0 / advance, zero);
        let mut foot = [zero; 3];
        (foot[k], foot[i], foot[j]) = (splat(simd, at), p[i] + x * aside, p[j] + y * aside);
        let mut normal = [zero; 3];
        normal[k] = splat(simd, up);
        let inside = match within {
            Within::Everywhere => M::splat(simd, true),
            Within::Box { low, high } => {
                foot[i].simd_ge(low[i]) & foot[i].simd_le(high[i]) & foot[j].simd_ge(low[j]) & foot[j].simd_le(high[j])
            }
            // Of an upright cylinder.
            Within::Disc { axis: [x, y], radius } => {
                let (dx, dy) = (foot[0] - x, foot[1] - y);
                (dx * dx + dy * dy).simd_le(radius * radius)
            }
        };
        let v = |[x, y, z]: [F<S>; 3]| V { x, y, z };
        Place { foot: v(foot), normal: v(normal), found: asked & beyond & inside, unsure: M::splat(simd, false) }
    }

    /// The place of least optical length, by Newton's method from about where the straight line to the light leaves the body that holds the point: where
    /// light has met no focus there is one. Near foci, and where steps do not settle, lanes are not sure.
    #[inline(always)]
    fn through_round<S: Simd>(
        &self,
        simd: S,
        asked: M<S>,
        p: V<S>,
        shape: Shape,
        least: f32,
        [low, high]: [f32; 2],
    ) -> Place<S> {
        let (towards, distance) = self.to_light(p);
        let Chord { enter, leave } = chord(simd, shape, p, towards);
        let slack = p.size() * SLIVER;
        let met = asked & enter.simd_le(slack) & leave.simd_gt(-slack) & leave.simd_lt(distance);
        let mut foot = shape.onto(p.plus(leave.max(splat(simd, 0.0)), towards));
        for _ in 0..BENT {
            // From there on as the interface bends it: right where the interface is nearly flat as seen from the point.
            let bent = self.refracted(self.to_light(foot).0, shape.unit_normal(foot));
            let Chord { leave, .. } = chord(simd, shape, p, bent);
            foot = shape.onto(p.plus(leave.max(splat(simd, 0.0)), bent));
        }
        let (mut open, mut unsure) = (met, M::splat(simd, false));
        for _ in 0..MOST_STEPS {
            if open.all_false() {
                break;
            }
            let normal = shape.unit_normal(foot);
            let (a, d1) = self.to_light(foot);
            let b = foot.minus(p);
            let d2 = b.dot(b).sqrt().max(splat(simd, 1e-12));
            let b = b.times(1.0 / d2);
            let [uu, uv, vv] = self.second(simd, Some(shape), foot, normal, (a, d1), (b, d2));
            let sum = a.plus(splat(simd, -self.m), b).times(d2);
            let (u, v) = tangents(simd, normal);
            let (along_u, along_v) = (sum.dot(u), sum.dot(v));
            let det = uu * vv - uv * uv;
            let convex = uu.simd_gt(0.0) & det.simd_gt(0.0);
            unsure |= open & !convex;
            open &= convex;
            let (x, y) = ((vv * along_u - uv * along_v) / det, (uu * along_v - uv * along_u) / det);
            let next = shape.onto(foot.plus(x, u).plus(y, v));
            // Each lane stops by itself: its neighbours must not show.
            foot = next.or(open, foot);
            let enough = d2.min(splat(simd, least)) * ENOUGH + slack;
            open &= (x * x + y * y).simd_gt(enough * enough);
        }
        unsure |= open;
        let inside = foot.z.simd_ge(low) & foot.z.simd_le(high);
        Place { foot, normal: shape.unit_normal(foot), found: met & inside, unsure }
    }

    /// Second derivatives of the optical length along a face, times the distance d2 of the point: by the unit vector a to the light, d1 away, and
    /// b along the inner part of the connection.
    #[inline(always)]
    fn second<S: Simd>(
        &self,
        simd: S,
        round: Option<Shape>,
        foot: V<S>,
        normal: V<S>,
        (a, d1): (V<S>, F<S>),
        (b, d2): (V<S>, F<S>),
    ) -> [F<S>; 3] {
        let (u, v) = tangents(simd, normal);
        let ratio = d2 / d1;
        let (au, av, bu, bv) = (a.dot(u), a.dot(v), b.dot(u), b.dot(v));
        let mut second = [
            ratio * (1.0 - au * au) + (1.0 - bu * bu) * self.m,
            -(ratio * au * av) - bu * bv * self.m,
            ratio * (1.0 - av * av) + (1.0 - bv * bv) * self.m,
        ];
        if let Some(shape) = round {
            let strength = d2 * (a.dot(normal) - b.dot(normal) * self.m);
            let bends = shape.bends(foot, u, v);
            for (second, bend) in second.iter_mut().zip(bends) {
                *second += strength * bend;
            }
        }
        second
    }
}

impl<S: Simd> Heading<S> {
    /// This where `mask` says so, else the other.
    #[inline(always)]
    pub(super) fn or(&self, mask: M<S>, other: &Self) -> Self {
        Self {
            towards: self.towards.or(mask, other.towards),
            tau: choose(mask, self.tau, other.tau),
            normal: self.normal.or(mask, other.normal),
        }
    }
}

impl<S: Simd> Refraction<S> {
    /// Nothing found.
    #[inline(always)]
    pub fn none(simd: S) -> Self {
        let (no, zero) = (M::splat(simd, false), splat(simd, 0.0));
        let nowhere = V { x: zero, y: zero, z: zero };
        Self {
            found: no,
            unsure: no,
            towards: nowhere,
            length: zero,
            foot: nowhere,
            normal: nowhere,
            gain: zero,
            tau: zero,
        }
    }

    #[inline(always)]
    pub fn visibility(&self, blocked: M<S>) -> Visibility<S> {
        let &Self { towards, tau, length, foot, gain, .. } = self;
        Visibility { towards, tau, length, again: 0, blocked, foot, gain }
    }

    /// This where `mask` says so, else the other; found where either is, unsure too.
    #[inline(always)]
    pub fn or(self, mask: M<S>, other: &Self) -> Self {
        Self {
            found: self.found | other.found,
            unsure: self.unsure | other.unsure,
            towards: self.towards.or(mask, other.towards),
            length: choose(mask, self.length, other.length),
            foot: self.foot.or(mask, other.foot),
            normal: self.normal.or(mask, other.normal),
            gain: choose(mask, self.gain, other.gain),
            tau: choose(mask, self.tau, other.tau),
        }
    }
}

/// Two unit vectors across a unit vector (Duff et al. 2017).
#[inline(always)]
fn tangents<S: Simd>(simd: S, n: V<S>) -> (V<S>, V<S>) {
    let sign = choose(n.z.simd_ge(splat(simd, 0.0)), splat(simd, 1.0), splat(simd, -1.0));
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    let u = V { x: sign * n.x * n.x * a + 1.0, y: sign * b, z: -(sign * n.x) };
    (u, V { x: b, y: n.y * n.y * a + sign, z: -n.y })
}

/// What rays pass on a stretch.
struct Passed<S: Simd> {
    tau: F<S>,
    /// mm in what light can enter.
    length: F<S>,
    /// Whether something opaque stands there.
    blocked: M<S>,
}

/// The first `distance` of rays, where those leave one of the bodies at a place that is known. Compiled once for all callers.
#[inline(never)]
fn passed<S: Simd>(
    simd: S,
    frame: &Frame<'_>,
    (r, w, distance): (V<S>, V<S>, F<S>),
    (body, leave): (usize, F<S>),
) -> Passed<S> {
    simd.vectorize(
        #[inline(always)]
        || {
            let zero = splat(simd, 0.0);
            let mut cut = chords(simd, frame, r, w);
            cut[body].leave = leave;
            let (mut tau, mut length, mut blocked) = (zero, zero, M::splat(simd, false));
            for (j, &mu_t) in frame.mu_t.iter().enumerate() {
                if frame.opaque[j] {
                    let Chord { enter, leave } = cut[j];
                    blocked |= enter.simd_lt(leave) & leave.simd_gt(zero) & enter.simd_lt(distance);
                    continue;
                }
                let own = own_length(simd, &cut, j, distance);
                (tau, length) = (tau + own * mu_t, length + own);
            }
            Passed { tau, length, blocked }
        },
    )
}
