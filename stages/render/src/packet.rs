//! Paths walked side by side: flights inside one medium, nearly all there are, in lanes; whatever else befalls a path is left to
//! the [`Walker`], whose bits the lanes reproduce.

use std::ops::Range;

use fearless_simd::Simd;
use glam::DVec3;
use turbid_optics::at_level;
use turbid_optics::elementary::ln;
use turbid_optics::henyey_greenstein as hg;
use turbid_optics::philox::{philox4x32, unit, unit_fine};
use turbid_optics::solid::Solid;

use crate::batches::{Batches, alike};
use crate::next_event_lanes::{LANES, inverse_survival};
use crate::path::deep_weight;
use crate::random::{LIGHT_BRANCH, counter};
use crate::setting::Place;
use crate::single::{self, Frame};
use crate::walker::Walker;
use crate::world::Body;

/// With no more paths than this left, lanes are dearer than one path after the other.
const FEW: usize = 2;

type Lane = [f64; LANES];

/// What became of a lane's flight.
const PLAIN: u64 = 0;
/// It met a boundary or a roulette (or has to be connected one by one): it has not been made.
const DIVERGENT: u64 = 1;
/// Absorbed.
const GONE: u64 = 2;
/// Made, and its end is to be connected to the light.
const NEXT_EVENT: u64 = 3;

/// The paths in flight. All of them are in a medium, and scored ahead up to the next boundary.
#[derive(Default)]
struct Packet {
    r: [Lane; 3],
    w: [Lane; 3],
    absorption_depth: Lane,
    weight: Lane,
    mu_s: Lane,
    free_path: Lane,
    mu_a: Lane,
    g: Lane,
    /// Of the roulette of deep paths.
    window: Lane,
    number: [u64; LANES],
    sample: [u32; LANES],
    pixel: [u32; LANES],
    verdict: [u64; LANES],
    /// Direction before it, the number that decides on connections, and the distance from the nearest boundary.
    came: [Lane; 3],
    roulette: Lane,
    clear: Lane,
}

/// Walks the paths `samples` of the pixels `pixels` and leaves their responses in the walker, pixel by pixel: in f32 lanes where
/// they hold the scene, else in those of f64.
pub fn walk(walker: &mut Walker<'_>, pixels: Range<usize>, samples: Range<u32>) {
    walk_among(walker, Batches { of: &alike(pixels, &samples), count: samples.len() as u32 });
}

/// The same for batches of any pixels; responses are in their order.
pub fn walk_among(walker: &mut Walker<'_>, batches: Batches<'_>) {
    match Frame::of(walker) {
        Some(frame) => single::walk(walker, &frame, batches),
        None if walker.setting().shared.is_some() => walk_singly(walker, batches),
        None => walk_double_among(walker, batches),
    }
}

/// The same one path after the other.
fn walk_singly(walker: &mut Walker<'_>, batches: Batches<'_>) {
    walker.clear_responses(batches.paths());
    for path in 0..batches.paths() {
        let (pixel, sample) = batches.path(path);
        let place = walker.begin(pixel as usize, sample, path);
        walker.finish(place);
    }
    walker.gather();
}

/// The same in f64 lanes, bit for bit what [`Walker::path`] says.
pub fn walk_double(walker: &mut Walker<'_>, pixels: Range<usize>, samples: Range<u32>) {
    walk_double_among(walker, Batches { of: &alike(pixels, &samples), count: samples.len() as u32 });
}

pub fn walk_double_among(walker: &mut Walker<'_>, batches: Batches<'_>) {
    if walker.peaked_index.is_some() || !walker.setting().world.has_one_term() {
        // Those lanes do not split paths, and scatter by one g.
        return walk_singly(walker, batches);
    }
    let paths = batches.paths();
    walker.clear_responses(paths);
    let (setting, mut packet) = (*walker.setting(), Packet::default());
    let body_of = walker.body_of().map(<[u64]>::to_vec);
    let (level, queues) = (walker.level(), body_of.is_some());
    let mut places: Vec<Place> = Vec::with_capacity(LANES);
    let mut next = 0;
    loop {
        while places.len() < LANES && next < paths {
            let (pixel, sample) = batches.path(next);
            let mut place = walker.begin(pixel as usize, sample, next);
            next += 1;
            if scalar_fallback(walker, &mut place) {
                packet.put(places.len(), &place, walker);
                places.push(place);
            }
        }
        if walker.endless() {
            return;
        }
        if places.len() <= FEW {
            break;
        }
        at_level!(level, simd => simd.vectorize(#[inline(always)] || packet.fly(setting.key, setting.channel, &setting.world.bodies, queues)));
        // Divergent flights are counted where they are made.
        let divergent = packet.verdict[..places.len()].iter().filter(|&&v| v == DIVERGENT).count();
        walker.count_flights(places.len() - divergent);
        // Backwards: the lane that fills a gap has been seen to.
        for lane in (0..places.len()).rev() {
            let mut alive = packet.verdict[lane] != GONE;
            if packet.verdict[lane] == DIVERGENT {
                packet.get(lane, &mut places[lane]);
                alive = scalar_fallback(walker, &mut places[lane]);
                packet.put(lane, &places[lane], walker);
            }
            if let (NEXT_EVENT, Some(body_of)) = (packet.verdict[lane], &body_of) {
                let place = &mut places[lane];
                packet.get(lane, place);
                place.clear = packet.clear[lane];
                let own = std::mem::replace(&mut place.w, point(&packet.came, lane));
                let material = &setting.world.materials[place.material];
                walker.queue_next_event(place, own, packet.roulette[lane], material, body_of[place.material]);
                walker.next_event_to_lamps(place, own, packet.roulette[lane]);
            }
            if !alive {
                places.swap_remove(lane);
                packet.copy(places.len(), lane);
            }
        }
    }
    for (lane, place) in places.iter_mut().enumerate() {
        packet.get(lane, place);
        while walker.step(place) {}
    }
    walker.gather();
}

/// One divergent flight, and those after it until the path is in a medium again, scored ahead; false where it has ended.
fn scalar_fallback(walker: &mut Walker<'_>, place: &mut Place) -> bool {
    loop {
        if !walker.step(place) {
            return false;
        }
        if place.ahead && place.surface_point.is_none() {
            return true;
        }
    }
}

impl Packet {
    fn put(&mut self, lane: usize, place: &Place, walker: &Walker<'_>) {
        for (axis, (r, w)) in place.r.to_array().into_iter().zip(place.w.to_array()).enumerate() {
            self.r[axis][lane] = r;
            self.w[axis][lane] = w;
        }
        let material = &walker.setting().world.materials[place.material];
        self.absorption_depth[lane] = place.absorption_depth;
        self.weight[lane] = place.weight;
        self.mu_s[lane] = material.mu_s;
        self.free_path[lane] = walker.free_path(place.material);
        self.mu_a[lane] = material.mu_a;
        self.g[lane] = material.phase.g_forward();
        self.window[lane] = walker.window(place.material);
        self.number[lane] = place.number;
        self.sample[lane] = place.sample;
        self.pixel[lane] = place.pixel;
    }

    /// What flights in lanes change.
    fn get(&self, lane: usize, place: &mut Place) {
        place.r = self.at(lane);
        place.w = self.along(lane);
        place.absorption_depth = self.absorption_depth[lane];
        place.number = self.number[lane];
        place.clear = 0.0;
    }

    fn copy(&mut self, from: usize, to: usize) {
        for axis in 0..3 {
            self.r[axis][to] = self.r[axis][from];
            self.w[axis][to] = self.w[axis][from];
        }
        let lanes = [
            &mut self.absorption_depth,
            &mut self.weight,
            &mut self.mu_s,
            &mut self.free_path,
            &mut self.mu_a,
            &mut self.g,
            &mut self.window,
        ];
        for lane in lanes {
            lane[to] = lane[from];
        }
        self.number[to] = self.number[from];
        self.sample[to] = self.sample[from];
        self.pixel[to] = self.pixel[from];
    }

    #[inline(always)]
    fn at(&self, i: usize) -> DVec3 {
        point(&self.r, i)
    }

    #[inline(always)]
    fn along(&self, i: usize) -> DVec3 {
        point(&self.w, i)
    }

    /// One flight of every lane, made where it does not diverge.
    #[inline(always)]
    fn fly(&mut self, key: [u32; 2], channel: u32, bodies: &[Body], queues: bool) {
        let random = self.draw(key, channel);
        let (mut step, mut absorption_depth, mut end) = ([0.0; LANES], [0.0; LANES], [[0.0; LANES]; 3]);
        for i in 0..LANES {
            step[i] = -ln(unit_fine(random[0][i], random[3][i])) * self.free_path[i];
            absorption_depth[i] = self.absorption_depth[i] - self.mu_a[i] * step[i];
            let r = self.at(i) + step[i] * self.along(i);
            (end[0][i], end[1][i], end[2][i]) = (r.x, r.y, r.z);
        }
        let reach = nearest(bodies, |solid, i| solid.reach(self.at(i), self.along(i)));
        let clear = nearest(bodies, |solid, i| solid.clearance(DVec3::new(end[0][i], end[1][i], end[2][i])));
        for i in 0..LANES {
            self.roulette[i] = unit(random[3][i]);
            self.clear[i] = clear[i];
            let next_events = self.roulette[i] * inverse_survival((self.mu_a[i] + self.mu_s[i]) * clear[i]) < 1.0;
            let plays = self.weight[i] < 0.5 * deep_weight(self.window[i], clear[i]);
            let late = self.number[i] >= u64::from(LIGHT_BRANCH) - 2;
            let (crosses, dies) = (step[i] >= reach[i], absorption_depth[i] < 0.0);
            let divergent = crosses | (!dies & (plays | late | (next_events & !queues)));
            let made = if dies {
                GONE
            } else if next_events {
                NEXT_EVENT
            } else {
                PLAIN
            };
            self.verdict[i] = if divergent { DIVERGENT } else { made };
            let w = hg::sample(self.g[i], self.along(i), unit(random[1][i]), unit(random[2][i]));
            for (axis, w) in [w.x, w.y, w.z].into_iter().enumerate() {
                self.r[axis][i] = if divergent { self.r[axis][i] } else { end[axis][i] };
                self.came[axis][i] = self.w[axis][i];
                self.w[axis][i] = if divergent { self.w[axis][i] } else { w };
            }
            self.absorption_depth[i] = if divergent { self.absorption_depth[i] } else { absorption_depth[i] };
            self.number[i] += if divergent { 0 } else { 2 };
        }
    }

    /// The block of random numbers of each lane's flight.
    #[inline(always)]
    fn draw(&self, key: [u32; 2], channel: u32) -> [[u32; LANES]; 4] {
        let mut random = [[0; LANES]; 4];
        let [first, second, third, fourth] = &mut random;
        for i in 0..LANES {
            let block = philox4x32(counter(self.number[i], channel, self.sample[i], self.pixel[i]), key);
            (first[i], second[i], third[i], fourth[i]) = (block[0], block[1], block[2], block[3]);
        }
        random
    }
}

#[inline(always)]
fn point(axes: &[Lane; 3], i: usize) -> DVec3 {
    DVec3::new(axes[0][i], axes[1][i], axes[2][i])
}

/// The least over the bodies of what `distance` says of a solid and a lane.
#[inline(always)]
fn nearest(bodies: &[Body], distance: impl Fn(&Solid, usize) -> f64) -> Lane {
    let mut least = [f64::INFINITY; LANES];
    for body in bodies {
        // Said again in each arm, so that its loop is about one kind of solid and goes by vectors.
        match body.solid {
            Solid::Slab { bottom, top } => lower(&mut least, |i| distance(&Solid::Slab { bottom, top }, i)),
            Solid::Box { low, high } => lower(&mut least, |i| distance(&Solid::Box { low, high }, i)),
            Solid::Ellipsoid { center, radii } => {
                lower(&mut least, |i| distance(&Solid::Ellipsoid { center, radii }, i))
            }
            Solid::Cylinder { axis, radius, bottom, top } => {
                lower(&mut least, |i| distance(&Solid::Cylinder { axis, radius, bottom, top }, i))
            }
            // Lane by lane.
            ref solid => lower(&mut least, |i| distance(solid, i)),
        }
    }
    least
}

#[inline(always)]
fn lower(least: &mut Lane, distance: impl Fn(usize) -> f64) {
    for (i, least) in least.iter_mut().enumerate() {
        *least = least.min(distance(i));
    }
}
