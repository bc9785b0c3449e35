//! Meshes among the bodies of the lanes: each is asked in coordinates about its center, for many lanes at once where many ask.

use fearless_simd::prelude::*;
use turbid_optics::solid::facets::{Crossing, Crossings, Rays};

use super::facets::bits;
use super::ground::{Chord, Ground};
use super::lane::{F, LANES, M, U, V};

/// The first chord of a line in a mesh, and what else there is.
struct FirstChord {
    enter: f32,
    leave: f32,
    /// The face at `leave` if it starts inside, else at `enter`.
    face: u32,
    /// It comes back.
    again: bool,
}

/// Planes of facets.
#[derive(Clone, Copy)]
pub struct FacetPlane<S: Simd> {
    /// Unit vector outwards, and its product with the points of the plane, in coordinates about `center`.
    pub normal: V<S>,
    offset: F<S>,
    center: [f32; 3],
}

impl<S: Simd> FacetPlane<S> {
    /// The point of the plane nearest to p.
    #[inline(always)]
    pub fn drop(&self, p: V<S>) -> V<S> {
        p.plus(self.offset - p.from(self.center).dot(self.normal), self.normal)
    }
}

/// In order along a line, the first chord ahead of its start.
#[inline(always)]
fn first_chord(crossings: &[Crossing]) -> Option<FirstChord> {
    let first = crossings.first()?;
    let (enter, last) = if first.leaves { (f32::NEG_INFINITY, 0) } else { (first.t, 1) };
    let leave = crossings.get(last).map_or(f32::INFINITY, |c| c.t);
    Some(FirstChord { enter, leave, face: first.face, again: crossings.len() > last + 1 })
}

#[inline(always)]
fn lane_of<S: Simd>(v: V<S>, lane: usize) -> [f32; 3] {
    [v.x.as_slice()[lane], v.y.as_slice()[lane], v.z.as_slice()[lane]]
}

impl Ground {
    /// Flights of some lanes: which of them leave their mesh or meet one of higher priority, and how far from those surfaces
    /// the others end at least.
    #[inline(always)]
    #[allow(clippy::too_many_arguments, reason = "a question in lanes")]
    pub fn pass_meshes<S: Simd>(
        &self,
        simd: S,
        asked: M<S>,
        body: U<S>,
        r: V<S>,
        w: V<S>,
        s: F<S>,
        end: V<S>,
    ) -> (M<S>, F<S>) {
        let (mut crosses, mut clear) = (0_u64, [f32::INFINITY; LANES]);
        for mesh in &self.meshes {
            let cells = mesh.cells();
            // In two passes, so that the memory is asked for all lanes at once.
            let mut near = 0_u64;
            for lane in bits(asked.to_bitmask()).filter(|&lane| mesh.body <= body.as_slice()[lane]) {
                let after = cells.clearance(mesh.local(lane_of(r, lane))) - s.as_slice()[lane];
                if after > 0.0 {
                    clear[lane] = clear[lane].min(after);
                } else {
                    near |= 1 << lane;
                }
            }
            let mut meets = 0;
            for lane in bits(near) {
                let (from, to) = (mesh.local(lane_of(r, lane)), mesh.local(lane_of(end, lane)));
                meets |= u64::from(!cells.is_free(from, to)) << lane;
                clear[lane] = clear[lane].min(cells.clearance(to));
            }
            if meets != 0 {
                let rays = Rays { p: mesh.local_lanes(r), w: [w.x, w.y, w.z] };
                let met = cells.first(simd, meets, &rays, body.simd_eq(mesh.body).to_bitmask(), &s);
                crosses |= bits(meets).filter(|&lane| met[lane].is_some()).fold(0, |lanes, lane| lanes | 1 << lane);
            }
        }
        (M::from_bitmask(simd, crosses), F::load_array(simd, clear))
    }

    /// How far from meshes points are at least; 0 in lanes that are not asked.
    #[inline(always)]
    pub fn from_meshes<S: Simd>(&self, simd: S, asked: M<S>, body: U<S>, p: V<S>) -> F<S> {
        let mut clear = [0.0; LANES];
        for lane in bits(asked.to_bitmask()) {
            let (own, p) = (body.as_slice()[lane], lane_of(p, lane));
            let meshes = self.meshes.iter().filter(|mesh| mesh.body <= own);
            clear[lane] = meshes.map(|mesh| mesh.cells().clearance(mesh.local(p))).fold(f32::INFINITY, f32::min);
        }
        F::load_array(simd, clear)
    }

    /// Where rays are first in the mesh that is body `j`, and the facet where those that start inside leave it, or others come in; the lanes that come back to it
    /// later are added to `again`.
    #[inline(always)]
    pub fn chord_in_mesh<S: Simd>(
        &self,
        simd: S,
        j: usize,
        asked: M<S>,
        r: V<S>,
        w: V<S>,
        again: &mut u64,
    ) -> (Chord<S>, FacetPlane<S>) {
        let (mut enter, mut leave) = ([f32::INFINITY; LANES], [f32::NEG_INFINITY; LANES]);
        let (mut normal, mut offset, mut found) = ([[0.0; LANES]; 3], [0.0; LANES], Crossings::default());
        let mut center = [0.0; 3];
        for mesh in self.meshes.iter().filter(|mesh| mesh.body == j as u32) {
            center = mesh.center;
            let rays = Rays { p: mesh.local_lanes(r), w: [w.x, w.y, w.z] };
            let until = F::splat(simd, f32::INFINITY);
            mesh.cells().crossings(simd, asked.to_bitmask(), &rays, &until, &mut found);
            for lane in bits(asked.to_bitmask()) {
                if let Some(chord) = first_chord(found.of(lane)) {
                    (enter[lane], leave[lane]) = (chord.enter, chord.leave);
                    *again |= u64::from(chord.again) << lane;
                    let n = mesh.normals[chord.face as usize];
                    offset[lane] = mesh.offsets[chord.face as usize];
                    normal.iter_mut().zip(n).for_each(|(axis, n)| axis[lane] = n);
                }
            }
        }
        let [x, y, z] = normal.map(|axis| F::load_array(simd, axis));
        let plane = FacetPlane { normal: V { x, y, z }, offset: F::load_array(simd, offset), center };
        (Chord { enter: F::load_array(simd, enter), leave: F::load_array(simd, leave) }, plane)
    }

    /// Adds to the chords of rays where they leave their own mesh, or come to one of higher priority; what is farther than `until` may be
    /// missing, and counts as there.
    #[inline(always)]
    #[allow(clippy::too_many_arguments, reason = "a question in lanes")]
    pub fn add_ahead<S: Simd>(
        &self,
        simd: S,
        asked: M<S>,
        body: U<S>,
        r: V<S>,
        w: V<S>,
        until: F<S>,
        chords: &mut [Chord<S>],
    ) {
        for mesh in &self.meshes {
            let (own, above) = (body.simd_eq(mesh.body), body.simd_gt(mesh.body));
            let (mut enter, mut leave) = ([f32::INFINITY; LANES], [f32::NEG_INFINITY; LANES]);
            let asked = asked & (own | above);
            let own = own.to_bitmask();
            let rays = Rays { p: mesh.local_lanes(r), w: [w.x, w.y, w.z] };
            let met = mesh.cells().first(simd, asked.to_bitmask(), &rays, own, &until);
            for lane in bits(asked.to_bitmask()) {
                let (until, met) = (until.as_slice()[lane], met[lane].map(|c| c.t));
                (enter[lane], leave[lane]) = if own >> lane & 1 == 1 {
                    // Without an end, where there must be one, rounding has put the start outside.
                    let end = met.unwrap_or(if until < f32::INFINITY { until } else { 0.0 });
                    (f32::NEG_INFINITY, end)
                } else {
                    (met.unwrap_or(f32::INFINITY), met.map_or(f32::NEG_INFINITY, |_| f32::INFINITY))
                };
            }
            chords[mesh.body as usize] = Chord { enter: F::load_array(simd, enter), leave: F::load_array(simd, leave) };
        }
    }

    /// Adds to the chords of lines to the light their first chords in meshes, and to `normals` those of the first face of each; says
    /// which lanes come back to one later.
    #[inline(always)]
    #[allow(clippy::too_many_arguments, reason = "a question in lanes")]
    pub fn add_towards_light<S: Simd>(
        &self,
        simd: S,
        asked: M<S>,
        r: V<S>,
        towards: V<S>,
        distance: F<S>,
        chords: &mut [Chord<S>],
        normals: &mut [V<S>],
    ) -> u64 {
        let (mut again, mut found) = (0, Crossings::default());
        for mesh in &self.meshes {
            let (mut enter, mut leave) = ([f32::INFINITY; LANES], [f32::NEG_INFINITY; LANES]);
            let mut normal = [[f32::NAN; LANES]; 3];
            mesh.between(simd, asked.to_bitmask(), (r, towards, &distance), &mut found);
            for lane in bits(asked.to_bitmask()) {
                if let Some(chord) = first_chord(found.of(lane)) {
                    (enter[lane], leave[lane]) = (chord.enter, chord.leave);
                    again |= u64::from(chord.again) << lane;
                    let n = mesh.normals[chord.face as usize];
                    normal.iter_mut().zip(n).for_each(|(axis, n)| axis[lane] = n);
                }
            }
            let j = mesh.body as usize;
            chords[j] = Chord { enter: F::load_array(simd, enter), leave: F::load_array(simd, leave) };
            let [x, y, z] = normal.map(|axis| F::load_array(simd, axis));
            normals[j] = V { x, y, z };
        }
        again
    }

    /// The line to the light in one lane, whatever meshes it comes back to: the body and the length of each segment.
    #[inline(never)]
    pub fn segments_to_light<S: Simd>(
        &self,
        simd: S,
        lane: usize,
        (r, towards, distance): (V<S>, V<S>, F<S>),
        chords: &[Chord<S>],
    ) -> Vec<(usize, f32)> {
        let far = distance.as_slice()[lane];
        let mut all = Vec::new();
        for (j, chord) in chords.iter().enumerate() {
            let Some(mesh) = self.meshes.iter().find(|mesh| mesh.body == j as u32) else {
                all.push((j, chord.enter.as_slice()[lane], chord.leave.as_slice()[lane]));
                continue;
            };
            let mut found = Crossings::default();
            mesh.between(simd, 1 << lane, (r, towards, &distance), &mut found);
            let mut inside = found.of(lane).first().filter(|c| c.leaves).map(|_| f32::NEG_INFINITY);
            for &c in found.of(lane) {
                if let (true, Some(enter)) = (c.leaves, inside) {
                    all.push((j, enter, c.t));
                }
                inside = (!c.leaves).then_some(c.t);
            }
            all.extend(inside.map(|enter| (j, enter, f32::INFINITY)));
        }
        let mut ends: Vec<f32> = all.iter().flat_map(|s| [s.1, s.2]).map(|t| t.clamp(0.0, far)).collect();
        ends.extend([0.0, far]);
        ends.sort_by(f32::total_cmp);
        let segment = |pair: &[f32]| {
            let middle = 0.5 * (pair[0] + pair[1]);
            let holder = all.iter().filter(|s| s.1 < middle && middle < s.2).map(|s| s.0).min();
            holder.map(|j| (j, pair[1] - pair[0]))
        };
        ends.windows(2).filter_map(segment).collect()
    }
}
