//! Paths at their start: the camera's ray to the first medium, and next-event estimation along it.

use fearless_simd::prelude::*;
use glam::DVec3;
use turbid_optics::philox::unit as unit_of;
use turbid_optics::solid::Solid;

use super::bend::Entrance;
use super::facets::bits;
use super::frame::{Frame, Leaving, Medium};
use super::lane::{F, LANES, M, U, V, ln, philox, unit};
use super::limits::FIRST;
use super::next_event::{NextEvents, estimate_while};
use super::rows::{Path, PathLanes, PathRow, Paths, Vertex};
use super::scalar_fallback::scalar_fallback;
use super::turns::Outside;
use crate::batches::Batches;
use crate::camera::Camera;
use crate::lengths::{Lengths, MOST_LENGTHS, NO_LENGTHS, count};
use crate::random::PLACES_IN_LANES;
use crate::setting::{Place, Setting};
use crate::walker::Walker;
use crate::world::{Material, RaySegment};

/// Paths still to be begun, and those ready for lanes.
pub struct Starts<'a> {
    batches: Batches<'a>,
    next: usize,
    pub ready: Paths,
}

impl<'a> Starts<'a> {
    pub fn new(batches: Batches<'a>, counted: bool) -> Self {
        Self { batches, next: 0, ready: Paths::new(counted) }
    }

    pub fn more(&self) -> bool {
        self.next < self.paths()
    }

    pub fn paths(&self) -> usize {
        self.batches.paths()
    }

    /// Begins up to sixteen paths.
    #[inline(always)]
    pub fn make<S: Simd>(
        &mut self,
        simd: S,
        walker: &mut Walker<'_>,
        frame: &Frame<'_>,
        next_events: &mut NextEvents,
        responses: &mut [f64],
    ) {
        let first = self.next;
        let count = (self.batches.paths() - first).min(LANES);
        let (mut pixel, mut sample) = ([0; LANES], [0; LANES]);
        for i in 0..count {
            (pixel[i], sample[i]) = self.batches.path(first + i);
        }
        self.next += count;
        let (p, s) = (U::load_array(simd, pixel), U::load_array(simd, sample));
        let [jx, jy, ja, _] = philox(simd, U::splat(simd, 0), U::splat(simd, frame.channel), s, p, &frame.keys);
        let absorption_depth = -ln(unit(ja));
        let bends = frame.starts && frame.bends();
        let random = if bends {
            let [.., d] = philox(simd, U::splat(simd, 2), U::splat(simd, frame.channel), s, p, &frame.keys);
            d.to_array()
        } else {
            [0; LANES]
        };
        let rays = Rays {
            ids: std::array::from_fn(|i| Ids { pixel: pixel[i], sample: sample[i], response: (first + i) as u32 }),
            draws: std::array::from_fn(|i| [jx[i], jy[i], random[i]].map(unit_of)),
            count,
        };
        let begun = if frame.leaving != Leaving::Unknown && frame.starts {
            self.enter_lone(simd, walker, frame, next_events, &rays, absorption_depth)
        } else {
            0
        };
        estimate_while(simd, next_events, LANES, frame, responses);
        for i in bits(((1 << count) - 1) & !begun) {
            let (ids, draws) = (rays.ids[i], rays.draws[i]);
            let made = frame.starts && self.enter(simd, walker, frame, next_events, ids, draws, absorption_depth[i]);
            if !made {
                let mut place = walker.begin(pixel[i] as usize, sample[i], first + i);
                let goes_on = scalar_fallback(walker, frame, &mut place);
                walker.finish_copies();
                if goes_on {
                    self.ready.push(&frame.row(&place));
                }
            }
            estimate_while(simd, next_events, LANES, frame, responses);
        }
    }

    /// As [`Self::enter`] of each of these rays, where there is one body alone: by bits those that are begun, or that see nothing.
    #[inline(always)]
    fn enter_lone<S: Simd>(
        &mut self,
        simd: S,
        walker: &mut Walker<'_>,
        frame: &Frame<'_>,
        next_events: &mut NextEvents,
        rays: &Rays,
        absorption_depth: F<S>,
    ) -> u64 {
        let s = *walker.setting();
        let only = &frame.parts[0];
        let medium = &s.world.materials[only.material];
        if medium.is_opaque() || medium.mu_s == 0.0 {
            return 0;
        }
        let (mut begun, mut enters) = (0_u64, 0_u64);
        let (mut r, mut w) = ([[0.0; LANES]; 3], [[0.0; LANES]; 3]);
        for (i, (ids, &draws)) in rays.ids.iter().zip(&rays.draws).enumerate().take(rays.count) {
            let Some(entrance) = enter_body(frame, &only.solid, s.camera, ids.pixel, draws) else { continue };
            begun |= 1 << i;
            if let Entrance::In(place, along) = entrance {
                enters |= 1 << i;
                let (place, along) = (frame.local(place), along.as_vec3().to_array());
                for k in 0..3 {
                    (r[k][i], w[k][i]) = (place[k], along[k]);
                }
            }
        }
        let [r, w] = [r, w].map(|v| v.map(|x| F::load_array(simd, x)));
        let [pixel, sample, response] = [|ids: &Ids| ids.pixel, |ids: &Ids| ids.sample, |ids: &Ids| ids.response]
            .map(|id| U::load_array(simd, std::array::from_fn(|i| id(&rays.ids[i]))));
        let path = PathLanes {
            r: V { x: r[0], y: r[1], z: r[2] },
            w: V { x: w[0], y: w[1], z: w[2] },
            absorption_depth,
            pixel,
            sample,
            response,
            ..PathLanes::splat(simd, &frame.path_at([0.0; 3], DVec3::Z, only.material, 0))
        };
        let enters = M::from_bitmask(simd, enters);
        let goes_on = enters & absorption_depth.simd_gt(0.0);
        self.ready.pack(goes_on, &path);
        if !frame.blind {
            let [zero, one] = [0.0, 1.0].map(|x| F::splat(simd, x));
            next_events.vertices.pack(enters, &camera_vertex(&path, U::splat(simd, FIRST), zero, one));
        }
        // Of the others the camera's ray is the only flight; up to an interface all have made one.
        let (ended, bent) = (begun & !goes_on.to_bitmask(), if frame.bends() { begun } else { 0 });
        walker.count_flights((ended.count_ones() + bent.count_ones()) as usize);
        begun
    }

    /// A path whose ray meets a medium before any surface: it starts where the ray enters, its single scattering left to next-event estimation in
    /// every segment. False where things are not so simple.
    #[inline(never)]
    #[allow(clippy::too_many_arguments, reason = "all there is at a start")]
    fn enter<S: Simd>(
        &mut self,
        simd: S,
        walker: &mut Walker<'_>,
        frame: &Frame<'_>,
        next_events: &mut NextEvents,
        ids: Ids,
        [across, down, random]: [f64; 3],
        absorption_depth: f32,
    ) -> bool {
        let s = *walker.setting();
        let (mut from, mut along) = s.camera.ray(ids.pixel as usize, across, down);
        let (mut inside, mut turns) = (true, usize::from(frame.bends()));
        if let Some(plane) = &frame.plane {
            match plane.enter(from, along, random) {
                Some(Entrance::In(place, refracted)) => (from, along) = (place, refracted),
                Some(Entrance::Out) if frame.dark => inside = false,
                _ => return false,
            }
        }
        if let Some(interfaces) = &frame.interfaces {
            match interfaces.enter(walker, from, along, random) {
                Some(Outside::In(place, refracted)) => (from, along) = (place, refracted),
                Some(Outside::Out(interfaces)) if frame.dark => (inside, turns) = (false, interfaces),
                _ => return false,
            }
        }
        let mut segments = std::mem::take(&mut walker.segments);
        segments.clear();
        if inside {
            find_segments(simd, walker, frame, (from, along), &mut segments);
        }
        let ready = self.ready.len();
        let made = self.enter_segments(&s, frame, next_events, ids, (from, along), absorption_depth, &segments);
        if made && self.ready.len() == ready {
            // The camera's ray is a flight, wherever it ended.
            walker.count_flights(1);
        }
        if made {
            // Up to the interface.
            walker.count_flights(turns);
        }
        walker.segments = segments;
        made
    }

    /// A path in the first of the segments that scatters, and next-event estimation in each. False where lanes cannot.
    #[allow(clippy::too_many_arguments, reason = "the second half of `enter`")]
    fn enter_segments(
        &mut self,
        s: &Setting<'_>,
        frame: &Frame<'_>,
        next_events: &mut NextEvents,
        ids: Ids,
        (from, along): (DVec3, DVec3),
        absorption_depth: f32,
        segments: &[RaySegment],
    ) -> bool {
        let material = |segment: &RaySegment| &s.world.materials[segment.material];
        let seen = segments.iter().position(|segment| material(segment).is_opaque()).unwrap_or(segments.len());
        if !lanes_can_start(frame, segments, seen, material) {
            return false;
        }
        let (mut tau, mut absorbed, mut scored) = (0.0, 0.0, 0);
        let mut lengths = NO_LENGTHS;
        for segment in &segments[..seen] {
            let (length, medium) = (segment.end - segment.start, material(segment));
            if medium.mu_s > 0.0 {
                let Some(body) = body_of(frame, segment, medium, (from, along)) else { continue };
                let left = absorption_depth - absorbed as f32;
                let r = frame.local(from + segment.start * along);
                let path = PathRow {
                    absorption_depth: left,
                    sample: ids.sample,
                    pixel: ids.pixel,
                    response: ids.response,
                    lengths: counted(&lengths),
                    ..frame.path_at(r, along, segment.material, body)
                };
                if scored == 0 && left > 0.0 {
                    self.ready.push(&path);
                }
                if !frame.blind {
                    let weight = libm::exp(-tau) as f32;
                    next_events.vertices.push(&camera_vertex(&path, FIRST | scored, 0.0, weight));
                }
                scored += 1;
            }
            absorbed += medium.mu_a * length;
            tau += medium.mu_t() * length;
            count(s.shared, &mut lengths, segment.material, length);
        }
        true
    }
}

/// Where a camera's ray comes into a convex body, maybe through the plane that is its surface; `None` where it starts in it, or comes from its other side.
fn enter_body(
    frame: &Frame<'_>,
    solid: &Solid,
    camera: &Camera,
    pixel: u32,
    [across, down, random]: [f64; 3],
) -> Option<Entrance> {
    let (mut from, mut along) = camera.ray(pixel as usize, across, down);
    if let Some(plane) = &frame.plane {
        match plane.enter(from, along, random)? {
            Entrance::In(place, refracted) => (from, along) = (place, refracted),
            Entrance::Out => return Some(Entrance::Out),
        }
    }
    let (start, end) = solid.chord(from, along);
    if !(start < end && end > 0.0) {
        return Some(Entrance::Out);
    }
    if frame.plane.is_none() && start <= 0.0 {
        return None;
    }
    Some(Entrance::In(from + start.max(0.0) * along, along))
}

/// Whether a camera's ray through these segments, of which `seen` are before anything opaque, is begun in lanes.
fn lanes_can_start<'a>(
    frame: &Frame<'_>,
    segments: &[RaySegment],
    seen: usize,
    material: impl Fn(&RaySegment) -> &'a Material,
) -> bool {
    let scattering = segments[..seen].iter().filter(|segment| material(segment).mu_s > 0.0).count();
    let from_outside = frame.bends() || segments.first().is_none_or(|segment| segment.start > 0.0);
    // It ends at a surface, or sees light from infinity.
    let sees_more = scattering == 0 && (seen < segments.len() || !frame.dark);
    // What comes first is clear, and there is more behind it.
    let behind_clear = scattering == 0 && frame.interfaces.is_some() && !segments.is_empty();
    from_outside && scattering <= MOST_SEGMENTS && !sees_more && !behind_clear
}

/// The body in which a segment lies.
fn body_of(frame: &Frame<'_>, segment: &RaySegment, medium: &Material, (from, along): (DVec3, DVec3)) -> Option<usize> {
    let mut filled = frame.parts.iter().enumerate().filter(|(_, part)| part.material == segment.material);
    if let (Some((only, _)), None) = (filled.next(), filled.next()) {
        return Some(only);
    }
    // A point of it says which body it is.
    let length = segment.end - segment.start;
    let inside = from + (segment.start + 0.5 * length.min(1.0 / medium.mu_t())) * along;
    frame.parts.iter().position(|part| part.solid.contains(inside))
}

/// Next-event estimation along a camera's ray in a medium in which a path would begin like this, that many segments after the `FIRST`.
#[inline(always)]
fn camera_vertex<A: Copy, B: Copy, C: Copy>(path: &Path<A, B, C>, number: C, zero: B, weight: B) -> Vertex<A, B, C> {
    Vertex {
        r: path.r,
        came: path.w,
        own: path.w,
        weight,
        roulette: zero,
        mu_a: path.mu_a,
        mu_s: path.mu_s,
        g: path.g,
        least: zero,
        number,
        sample: path.sample,
        pixel: path.pixel,
        response: path.response,
        body: path.body,
        lengths: path.lengths,
    }
}

/// The segments of a camera's ray from where it comes in; where interfaces bend it, as far as n stays what it is.
#[inline(always)]
fn find_segments<S: Simd>(
    simd: S,
    walker: &mut Walker<'_>,
    frame: &Frame<'_>,
    (from, along): (DVec3, DVec3),
    segments: &mut Vec<RaySegment>,
) {
    let s = *walker.setting();
    match &frame.parts[..] {
        _ if frame.interfaces.is_some() => {
            let n = |segment: &RaySegment| s.world.materials[segment.material].n;
            let mut rest = s.world.trace(from, along, None, &mut walker.chords);
            let first = rest.next();
            let index = first.as_ref().map(n);
            segments.extend(first.into_iter().chain(rest.take_while(|segment| Some(n(segment)) == index)));
        }
        [only] if only.solid.is_convex() => {
            let (start, end) = only.solid.chord(from, along);
            if start < end && end > 0.0 {
                let start = if frame.plane.is_some() { start.max(0.0) } else { start };
                segments.push(RaySegment { start, end, material: only.material, interface: None });
            }
        }
        _ if !frame.ground.meshes.is_empty()
            && from == s.camera.view.position
            // Nothing carved is told apart.
            && frame.parts.len() == s.world.bodies.len() =>
        {
            let cut = simd.vectorize(
                #[inline(always)]
                || {
                    s.world.trace_by(
                        &mut walker.chords,
                        #[inline(always)]
                        |i, solid, chords| {
                            let mesh = frame.ground.meshes.iter().find(|mesh| mesh.body == i as u32);
                            // No `is_some_and`: what is not inlined loses the vector instructions.
                            if let Some(mesh) = mesh
                                && mesh.cut_from_camera(simd, from, along, chords)
                            {
                                return;
                            }
                            solid.cut(from, along, None, chords);
                        },
                    )
                },
            );
            segments.extend(cut.filter(|p| p.material != 0));
        }
        _ => segments.extend(s.world.trace(from, along, None, &mut walker.chords).filter(|p| p.material != 0)),
    }
}

/// Those that lanes carry.
fn counted(lengths: &Lengths) -> [f32; MOST_LENGTHS] {
    std::array::from_fn(|k| lengths[k] as f32)
}

/// Next-event estimation along one camera's ray in lanes.
const MOST_SEGMENTS: usize = 8;
const _: () = assert!(MOST_SEGMENTS <= PLACES_IN_LANES);

/// The camera's rays of so many paths: which they are, and random numbers of their places in the pixels and of whether the surface reflects them.
struct Rays {
    ids: [Ids; LANES],
    draws: [[f64; 3]; LANES],
    count: usize,
}

/// Which path it is.
#[derive(Clone, Copy)]
struct Ids {
    pixel: u32,
    sample: u32,
    response: u32,
}

impl Frame<'_> {
    /// The highest body around a point that lanes may carry.
    pub fn body_at(&self, place: &Place) -> Option<usize> {
        let body = self.parts.iter().position(|part| part.solid.contains(place.r))?;
        let near = (place.r - self.origin).length_squared() < f64::from(self.range_squared);
        (near && self.parts[body].material == place.material).then_some(body)
    }

    /// The row of a path in its medium.
    pub fn row(&self, place: &Place) -> PathRow {
        let body = self.body_at(place).expect("only settled paths are put into lanes");
        PathRow {
            absorption_depth: place.absorption_depth as f32,
            weight: place.weight as f32,
            mis_weight: place.mis_weight as f32,
            number: place.number as u32,
            sample: place.sample,
            pixel: place.pixel,
            response: place.response as u32,
            lengths: counted(&place.lengths),
            ..self.path_at(self.local(place.r), place.w, place.material, body)
        }
    }

    /// A path that begins there.
    fn path_at(&self, r: [f32; 3], w: DVec3, material: usize, body: usize) -> PathRow {
        let &Medium { free_path, mu_a, mu_s, g, window } = &self.media[material];
        PathRow {
            r,
            w: w.as_vec3().to_array(),
            absorption_depth: 0.0,
            absorption_lost: 0.0,
            weight: 1.0,
            free_path,
            mu_a,
            mu_s,
            g,
            window,
            known_clear: self.known,
            mis_weight: 1.0,
            number: self.first,
            sample: 0,
            pixel: 0,
            response: 0,
            material: material as u32,
            body: body as u32,
            lengths: [0.0; MOST_LENGTHS],
        }
    }

    /// The path of a row, for the scalar walker.
    pub fn place(&self, path: PathRow) -> Place {
        Place {
            r: self.world(path.r),
            // Unit length to f64.
            w: DVec3::from(path.w.map(f64::from)).normalize(),
            material: path.material as usize,
            surface_point: None,
            clear: 0.0,
            absorption_depth: f64::from(path.absorption_depth) - f64::from(path.absorption_lost),
            weight: f64::from(path.weight),
            pixel: path.pixel,
            sample: path.sample,
            number: u64::from(path.number),
            ahead: true,
            // The camera's ray was scored as far as it goes.
            wholly: path.number == self.first,
            scattered: path.number != self.first,
            specular: path.number == self.first && self.bends(),
            mis_weight: f64::from(path.mis_weight),
            light_branch: false,
            response: path.response as usize,
            lengths: std::array::from_fn(|k| path.lengths.get(k).copied().map_or(0.0, f64::from)),
        }
    }
}
