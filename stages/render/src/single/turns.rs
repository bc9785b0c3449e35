//! How interfaces of convex bodies turn flights, in f32 lanes, and the camera's rays.

use fearless_simd::prelude::*;
use glam::DVec3;
use turbid_optics::refraction::refract;

use super::bend::Meeting;
use super::face::Interfaces;
use super::frame::Frame;
use super::lane::{F, M, U, V, choose, splat};
use super::limits::{MOST_TURNING, SLIVER};
use super::mesh::FacetPlane;
use super::visibility::chords;
use crate::walker::Walker;
use crate::world::SurfacePoint;

/// A camera's ray, from outside of all bodies.
pub enum Outside {
    /// It comes in here, and goes on like this.
    In(DVec3, DVec3),
    /// It is gone, after it was reflected so many times.
    Out(usize),
}

impl Interfaces {
    /// A ray to the first interface where light bends, by a uniform random number. `None` where it meets something opaque, or is reflected and goes on.
    pub fn enter(&self, walker: &mut Walker<'_>, from: DVec3, along: DVec3, random: f64) -> Option<Outside> {
        let world = walker.setting().world;
        let mut before = None;
        for segment in world.trace(from, along, None, &mut walker.chords) {
            let material = &world.materials[segment.material];
            if material.is_opaque() {
                return None;
            }
            if let (true, Some(interface)) = (material.n != 1.0, before) {
                let place = from + segment.start * along;
                let normal = world.normal(interface, place);
                let met = refract(along, normal, 1.0, material.n);
                if let Some(refracted) = met.refracted.filter(|_| random >= met.reflectance) {
                    return Some(Outside::In(place - self.behind * normal, refracted));
                }
                let surface_point = SurfacePoint { interface, inside: false };
                let mut onward = world.trace(place, met.reflected, Some(surface_point), &mut walker.chords);
                return onward.all(|segment| segment.material == 0).then_some(Outside::Out(1));
            }
            before = segment.interface;
        }
        Some(Outside::Out(0))
    }

    /// Where the rays of some lanes come from within a body to the outside (of others `towards` is false), where they are reflected to, and whether those that
    /// the random number does not reflect meet no other body. Compiled once for all callers.
    #[inline(never)]
    pub fn meet<S: Simd>(
        &self,
        simd: S,
        frame: &Frame<'_>,
        asked: M<S>,
        random: F<S>,
        ray: (U<S>, V<S>, V<S>),
    ) -> (Meeting<S>, V<S>, M<S>) {
        simd.vectorize(
            #[inline(always)]
            || self.meet_by(simd, frame, asked, random, ray),
        )
    }

    #[inline(always)]
    fn meet_by<S: Simd>(
        &self,
        simd: S,
        frame: &Frame<'_>,
        asked: M<S>,
        random: F<S>,
        (body, r, w): (U<S>, V<S>, V<S>),
    ) -> (Meeting<S>, V<S>, M<S>) {
        let (zero, never) = (splat(simd, 0.0), splat(simd, f32::INFINITY));
        let mut along = chords(simd, frame, r, w);
        let (mut distance, mut again) = (never, 0);
        let mut facets: [Option<FacetPlane<S>>; MOST_TURNING] = [None; MOST_TURNING];
        for (j, chord) in along.iter_mut().enumerate().take(frame.parts.len()) {
            let own = body.simd_eq(j as u32);
            if frame.ground.is_mesh(j) {
                let mut returns = 0;
                let (first, plane) = frame.ground.chord_in_mesh(simd, j, asked, r, w, &mut returns);
                (*chord, facets[j]) = (first, Some(plane));
                again |= returns & !own.to_bitmask();
            }
            distance = choose(own, chord.leave, distance);
        }
        let mut alone = distance.abs().simd_lt(f32::MAX) & !M::from_bitmask(simd, again);
        let distance = distance.max(zero);
        let mut p = r.plus(distance, w);
        let slack = (distance + p.size()) * SLIVER;
        let mut normal = w;
        for (j, chord) in along.iter().enumerate().take(frame.parts.len()) {
            let (own, above) = (body.simd_eq(j as u32), body.simd_gt(j as u32));
            if let Some(Some(facet)) = facets.get(j) {
                // Rounding has put it outside.
                alone &= !(own & chord.enter.simd_gt(zero));
                // The distance has fewer digits than the plane.
                (p, normal) = (facet.drop(p).or(own, p), facet.normal.or(own, normal));
            } else {
                normal = frame.ground.normal(simd, j, p).or(own, normal);
            }
            // What comes before the end of the own body, or holds that.
            let from = choose(above, zero, distance - slack);
            let there =
                chord.enter.simd_lt(chord.leave) & chord.enter.simd_lt(distance + slack) & chord.leave.simd_gt(from);
            alone &= own | !there;
        }
        let through = w.dot(normal);
        let length = choose(through.simd_gt(zero), 1.0 / normal.dot(normal).sqrt(), -1.0 / normal.dot(normal).sqrt());
        let normal = normal.times(length);
        let cos = w.dot(normal);
        let cos2 = 1.0 - (1.0 - cos * cos).max(zero) * (self.m * self.m);
        let out = cos2.max(zero).sqrt();
        let s = (cos * self.m - out) / (cos * self.m + out);
        let t = (out * self.m - cos) / (out * self.m + cos);
        // Totally reflected, both are 1.
        let reflectance = choose(cos2.simd_gt(zero), (s * s + t * t) * 0.5, splat(simd, 1.0));
        let beyond = w.times(splat(simd, self.m)).plus(out - cos * self.m, normal);
        let towards = alone & cos.simd_gt(zero);
        let free = self.is_free_beyond(
            simd,
            frame,
            asked & towards & random.simd_ge(reflectance),
            body,
            (p, normal, slack),
            beyond,
        );
        let meeting =
            Meeting { distance, towards, place: p.plus(splat(simd, -(self.behind as f32)), normal), reflectance };
        (meeting, w.plus(-cos * 2.0, normal), free)
    }

    /// Whether rays of some lanes that leave a body at p, with the normal `normal` outwards, meet nothing more.
    #[inline(always)]
    fn is_free_beyond<S: Simd>(
        &self,
        simd: S,
        frame: &Frame<'_>,
        asked: M<S>,
        body: U<S>,
        (p, normal, slack): (V<S>, V<S>, F<S>),
        w: V<S>,
    ) -> M<S> {
        let outside = p.plus(splat(simd, self.behind as f32), normal);
        let mut free = asked;
        for (j, chord) in chords(simd, frame, p, w).iter().enumerate().take(frame.parts.len()) {
            free &= if frame.ground.is_mesh(j) {
                let (chord, _) = frame.ground.chord_in_mesh(simd, j, free, outside, w, &mut 0);
                chord.enter.simd_ge(chord.leave)
            } else {
                // Convex, its own is not come back to.
                body.simd_eq(j as u32) | chord.enter.simd_ge(chord.leave) | chord.leave.simd_le(-slack)
            };
        }
        free
    }
}
