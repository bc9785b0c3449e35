//! How interfaces of convex bodies turn flights, in f32 lanes, and the camera's rays.

use fearless_simd::prelude::*;
use glam::DVec3;
use turbid_optics::refraction::refract;

use super::bend::Meeting;
use super::face::Interfaces;
use super::frame::Frame;
use super::lane::{M, U, V, choose, splat};
use super::limits::SLIVER;
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

    /// Where rays come from within a body to the outside (of others `towards` is false), where they are reflected to, and whether those that go on meet
    /// no other body. Compiled once for all callers.
    #[inline(never)]
    pub fn meet<S: Simd>(&self, simd: S, frame: &Frame<'_>, body: U<S>, r: V<S>, w: V<S>) -> (Meeting<S>, V<S>, M<S>) {
        simd.vectorize(
            #[inline(always)]
            || self.meet_by(simd, frame, body, r, w),
        )
    }

    #[inline(always)]
    fn meet_by<S: Simd>(&self, simd: S, frame: &Frame<'_>, body: U<S>, r: V<S>, w: V<S>) -> (Meeting<S>, V<S>, M<S>) {
        let (zero, never) = (splat(simd, 0.0), splat(simd, f32::INFINITY));
        let along = chords(simd, frame, r, w);
        let mut distance = never;
        for (j, chord) in along.iter().enumerate().take(frame.parts.len()) {
            distance = choose(body.simd_eq(j as u32), chord.leave, distance);
        }
        let mut alone = distance.simd_lt(f32::MAX);
        let distance = distance.max(zero);
        let p = r.plus(distance, w);
        let slack = (distance + p.size()) * SLIVER;
        let mut normal = w;
        for (j, chord) in along.iter().enumerate().take(frame.parts.len()) {
            let (own, above) = (body.simd_eq(j as u32), body.simd_gt(j as u32));
            normal = frame.ground.normal(simd, j, p).or(own, normal);
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
        let outside = chords(simd, frame, p, beyond);
        let mut free = M::splat(simd, true);
        for (j, chord) in outside.iter().enumerate().take(frame.parts.len()) {
            free &= body.simd_eq(j as u32) | chord.enter.simd_ge(chord.leave) | chord.leave.simd_le(-slack);
        }
        let meeting = Meeting {
            distance,
            towards: alone & cos.simd_gt(zero),
            place: p.plus(splat(simd, -(self.behind as f32)), normal),
            reflectance,
        };
        (meeting, w.plus(-cos * 2.0, normal), free)
    }
}
