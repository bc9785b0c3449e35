//! Connections by one facet of a mesh that refracts, in f32 lanes.
//!
//! Of all facets lanes find one: a ray towards the light meets a facet, the light that this one bends comes along another ray, and where that meets the same facet
//! again it is a connection. The others, of which there are few, are looked for by `Walker::reach_beside`, as rarely as chains by several interfaces.

use fearless_simd::prelude::*;
use turbid_optics::solid::facets::{Crossings, Rays};

use super::bend::{advanced, tangent};
use super::face::Interfaces;
use super::facets::{Facets, WayOut, bits};
use super::frame::Frame;
use super::interfaces::{Heading, Place, Refraction};
use super::lane::{F, LANES, M, U, V, choose, splat};
use super::limits::SLIVER;

/// Rays that are made for one connection: more find hardly more.
const MOST_RAYS: usize = 4;

impl Interfaces {
    /// As `Interfaces::heading`, of points in a mesh: past the nearest facet in the cell of each, or past that which the straight line to the light meets.
    #[inline(always)]
    pub(super) fn past_facets<S: Simd>(
        &self,
        simd: S,
        frame: &Frame<'_>,
        mesh: &Facets,
        asked: M<S>,
        (r, least): (V<S>, F<S>),
    ) -> Heading<S> {
        let (mu_t, zero) = (frame.mu_t[mesh.body as usize], splat(simd, 0.0));
        let (straight, reach) = self.to_light(r);
        let (near, normal, height) = mesh.planes_near(simd, asked, r);
        let near = near & straight.dot(normal).simd_gt(zero);
        let towards = self.refracted(straight, normal);
        let distance = height.max(least / mu_t).max(zero) / towards.dot(normal);
        let heading = Heading { towards, tau: distance * mu_t, normal };
        let far = asked & !near;
        if far.all_false() {
            return heading;
        }
        let WayOut { met, distance, normal, .. } = mesh.way_out(simd, far, r, straight);
        let a = self.to_light(r.plus(distance, straight)).0;
        let normal = normal.or(met, straight);
        let bent = self.refracted(a, normal).or(met & a.dot(normal).simd_gt(zero), straight);
        heading.or(near, &Heading { towards: bent, tau: choose(met, distance, reach) * mu_t, normal })
    }

    /// How light comes to points in a mesh through one of its facets; lanes in whose way something else stands are not sure.
    #[inline(never)]
    pub(super) fn refraction_by_facets<S: Simd>(
        &self,
        simd: S,
        frame: &Frame<'_>,
        mesh: &Facets,
        asked: M<S>,
        p: V<S>,
    ) -> Refraction<S> {
        simd.vectorize(
            #[inline(always)]
            || {
                let (place, faces) = self.place_on_facets(simd, frame, mesh, asked, p);
                let (mut refraction, _) = self.by_place(simd, None, asked, p, place);
                refraction.tau = refraction.length * frame.mu_t[mesh.body as usize];
                self.keep_open(simd, frame, (U::splat(simd, mesh.body), &faces), p, &mut refraction);
                refraction
            },
        )
    }

    /// Where Snell's law holds on facets of a mesh, and on which.
    #[inline(always)]
    fn place_on_facets<S: Simd>(
        &self,
        simd: S,
        frame: &Frame<'_>,
        mesh: &Facets,
        asked: M<S>,
        p: V<S>,
    ) -> (Place<S>, [u32; LANES]) {
        let zero = splat(simd, 0.0);
        let Heading { mut towards, mut normal, .. } = self.past_facets(simd, frame, mesh, asked, (p, zero));
        let (mut open, mut found, mut foot) = (asked, M::splat(simd, false), p);
        let mut before = [u32::MAX; LANES];
        for _ in 0..MOST_RAYS {
            let out = mesh.way_out(simd, open, p, towards);
            open &= out.met;
            let mut again = 0;
            for lane in bits(open.to_bitmask()) {
                again |= u64::from(out.face[lane] == before[lane]) << lane;
                before[lane] = out.face[lane];
            }
            let again = M::from_bitmask(simd, again);
            (found, open) = (found | again, open & !again);
            if open.all_false() {
                break;
            }
            // Through the plane of the facet.
            let (n, [x, y, z]) = (out.normal, mesh.local(self.light));
            let (q, light) = (mesh.local_lanes(p), [x, y, z].map(|x| splat(simd, x)));
            let q = V { x: q[0], y: q[1], z: q[2] };
            let light = V { x: light[0], y: light[1], z: light[2] };
            let (depth, height) = (out.offset - q.dot(n), light.dot(n) - out.offset);
            open &= depth.simd_ge(zero) & height.simd_gt(zero);
            let across = light.minus(q).plus(-(depth + height), n);
            let advance = across.dot(across).sqrt();
            let t = tangent(simd, advance, (depth, height), self.m, self.excess);
            let (slant, ..) = advanced(t, (depth, height), (self.m * self.m, self.excess));
            let aside = depth * t / slant * choose(advance.simd_gt(zero), 1.0 / advance, zero);
            foot = p.plus(depth, n).plus(aside, across).or(open, foot);
            normal = n.or(open, normal);
            towards = self.refracted(self.to_light(foot).0, n).or(open, towards);
        }
        (Place { foot, normal, found, unsure: M::splat(simd, false) }, before)
    }

    /// Leaves of what is found that in whose way nothing else stands, from points in `body` to the face, perhaps a facet, and from there to the light: elsewhere lanes
    /// are not sure.
    #[inline(always)]
    pub(super) fn keep_open<S: Simd>(
        &self,
        simd: S,
        frame: &Frame<'_>,
        (body, facets): (U<S>, &[u32; LANES]),
        p: V<S>,
        refraction: &mut Refraction<S>,
    ) {
        let zero = splat(simd, 0.0);
        let &mut Refraction { foot, normal, towards, length, found, .. } = refraction;
        let (a, distance) = self.to_light(foot);
        let slack = foot.size() * SLIVER;
        let outside = foot.plus(splat(simd, self.behind as f32), normal);
        let mut open = found;
        for j in 0..frame.parts.len() {
            let above = body.simd_gt(j as u32);
            if frame.ground.is_mesh(j) {
                continue;
            }
            let (inner, outer) = (frame.ground.chord(simd, j, p, towards), frame.ground.chord(simd, j, foot, a));
            let within =
                above & inner.enter.simd_lt(inner.leave) & inner.leave.simd_gt(zero) & inner.enter.simd_lt(length);
            let beyond = outer.enter.simd_lt(outer.leave) & outer.leave.simd_gt(slack) & outer.enter.simd_lt(distance);
            open &= !within & !beyond;
        }
        let mut crossings = Crossings::default();
        for mesh in &frame.ground.meshes {
            let above = open & body.simd_gt(mesh.body);
            let rays = Rays { p: mesh.local_lanes(p), w: [towards.x, towards.y, towards.z] };
            let met = mesh.cells().first(simd, above.to_bitmask(), &rays, 0, &length);
            let mut blocked =
                bits(above.to_bitmask()).filter(|&lane| met[lane].is_some()).fold(0, |all, lane| all | 1 << lane);
            let asked = open.to_bitmask() & !blocked;
            mesh.between(simd, asked, (outside, a, &distance), &mut crossings);
            // Rounding may have put it behind its own facet.
            let own = |lane: usize, face: u32| face == facets[lane] && mesh.body == body.as_slice()[lane];
            let meets = |lane: usize| crossings.of(lane).iter().any(|crossing| !own(lane, crossing.face));
            blocked |= bits(asked).filter(|&lane| meets(lane)).fold(0, |all, lane| all | 1 << lane);
            open &= !M::from_bitmask(simd, blocked);
        }
        refraction.unsure |= found & !open;
        refraction.found = open;
    }
}
