//! Next-event estimation one scattering ahead, in f64 lanes, in worlds of few transparent bodies without repeated media.
//!
//! Vertices wait in a [`Queue`] until all lanes are full, whichever path they belong to; those of one path are added in its order.

use fearless_simd::{Level, Simd};
use glam::DVec3;
use turbid_optics::at_level;
use turbid_optics::elementary::{exp, ln};
use turbid_optics::henyey_greenstein as hg;
use turbid_optics::philox::{philox4x32, unit};
use turbid_optics::solid::Solid;

use crate::light::{Carrier, Light};
use crate::random::counter;
use crate::setting::{Place, Setting};
use crate::strata::Bending;
use crate::world::{Body, Material, World};

/// A vertex is connected with probability min(1, (TAU_SURE / tau)^4) at optical distance tau from the light; estimating ahead, from the plane of
/// the interface through which it comes.
pub const TAU_SURE: f64 = 3.0;

/// Overlaps are resolved for so many bodies at most.
pub const MOST_BODIES: usize = 3;
/// A density that falls by less than this along a line is taken as even, before its `mass` loses digits.
pub const FLAT: f64 = 0.02;
/// Optical depth at which nothing is left; [`exp`] needs a bound.
const DARK: f64 = 700.0;

/// Two vectors of eight f64, or four of four: enough independent work to hide latencies.
pub const LANES: usize = 16;

type Axes = [[f64; LANES]; 3];

/// Vertices to connect, as struct of arrays, and what they see.
#[derive(Clone, Debug, Default)]
struct NextEvents {
    r: Axes,
    /// Direction in which the path came.
    w: Axes,
    /// Direction in which it goes on.
    own: Axes,
    weight: [f64; LANES],
    roulette: [f64; LANES],
    /// Optical distance of the nearest surface.
    least: [f64; LANES],
    mu_a: [f64; LANES],
    mu_s: [f64; LANES],
    g: [f64; LANES],
    /// Priority of the body around r: its index.
    body: [u64; LANES],
    number: [u64; LANES],
    sample: [u32; LANES],
    pixel: [u32; LANES],
    /// Result: radiance under the pattern 1 (W mm^-2 sr^-1), 0 where nothing is seen.
    radiance: [f64; LANES],
    /// Result: where the pattern's plane lies on the connection.
    on_plane: Axes,
}

/// Vertices that wait until all lanes are full.
#[derive(Clone, Debug, Default)]
pub struct Queue {
    next_events: NextEvents,
    /// Whose they are: indices of responses.
    paths: Vec<usize>,
}

impl Queue {
    pub fn is_full(&self) -> bool {
        self.paths.len() == LANES
    }

    /// Enters a collision; `place` has its point, its clearance, and still the direction in which the path came to it.
    pub fn push(&mut self, place: &Place, own: DVec3, roulette: f64, material: &Material, body: u64) {
        let (to, lane) = (&mut self.next_events, self.paths.len());
        set(&mut to.r, lane, place.r);
        set(&mut to.w, lane, place.w);
        set(&mut to.own, lane, own);
        (to.weight[lane], to.roulette[lane], to.body[lane]) = (place.weight, roulette, body);
        (to.mu_a[lane], to.mu_s[lane], to.g[lane]) = (material.mu_a, material.mu_s, material.phase.g_forward());
        to.least[lane] = material.mu_t() * place.clear;
        // Of the estimate ahead from the end of the flight, `random.rs`.
        (to.number[lane], to.sample[lane], to.pixel[lane]) = (place.flight() + 1, place.sample, place.pixel);
        self.paths.push(place.response);
    }

    /// Connects, and adds to `responses`, which are as [`crate::response::Layout`] says.
    pub fn flush(&mut self, level: Level, setting: &Setting<'_>, responses: &mut [f64]) {
        if !self.paths.is_empty() {
            at_level!(level, simd => simd.vectorize(#[inline(always)] || {
                self.next_events.estimate(setting.key, setting.channel, setting.world, setting.light);
                self.add(setting.carriers, setting.layout().width(), responses);
            }));
        }
        self.paths.clear();
    }

    #[inline(always)]
    fn add(&self, carriers: &[Carrier], stride: usize, responses: &mut [f64]) {
        let NextEvents { radiance, on_plane, .. } = &self.next_events;
        for (&path, radiance) in self.paths.iter().zip(radiance) {
            responses[path * stride] += radiance;
        }
        for (j, carrier) in carriers.iter().enumerate() {
            let (mut sin, mut cos) = ([0.0; LANES], [0.0; LANES]);
            for (i, (sin, cos)) in sin.iter_mut().zip(&mut cos).enumerate() {
                (*sin, *cos) = carrier.at(at(on_plane, i));
            }
            for (((&path, &radiance), sin), cos) in self.paths.iter().zip(radiance).zip(sin).zip(cos) {
                // Outside the field the place on its plane means nothing, not even a number.
                if radiance > 0.0 {
                    responses[path * stride + 1 + 2 * j] += radiance * cos;
                    responses[path * stride + 2 + 2 * j] += radiance * sin;
                }
            }
        }
    }
}

/// For each material the body that it fills, where this module's estimates are right for the world.
pub fn bodies_by_material(world: &World) -> Option<Vec<u64>> {
    if Bending::of(world) != Bending::Nowhere || !world.has_one_term() {
        return None;
    }
    let mut body_of = vec![0; world.materials.len()];
    for (i, body) in world.bodies.iter().enumerate() {
        let repeated = body.material != 0 && world.bodies[..i].iter().any(|other| other.material == body.material);
        let other = matches!(body.solid, Solid::Turned(_) | Solid::Carved(_) | Solid::Mesh(_));
        if i == MOST_BODIES || repeated || other || world.materials[body.material].is_opaque() {
            return None;
        }
        body_of[body.material] = i as u64;
    }
    Some(body_of)
}

/// Where rays enter and leave a body.
#[derive(Clone, Copy)]
struct Chord {
    enter: [f64; LANES],
    leave: [f64; LANES],
}

/// Where rays leave a medium, and by which body's surface.
struct Exit {
    distance: [f64; LANES],
    body: [u64; LANES],
}

impl NextEvents {
    /// Estimates. In every lane the optical depth below where light comes in is tested against the roulette, then one point ahead is scored.
    #[inline(always)]
    fn estimate(&mut self, key: [u32; 2], channel: u32, world: &World, light: &Light) {
        let (mut towards, mut distance) = ([[0.0; LANES]; 3], [0.0; LANES]);
        for (i, distance) in distance.iter_mut().enumerate() {
            let (to, far) = light.towards(at(&self.r, i));
            set(&mut towards, i, to);
            *distance = far;
        }
        let to_light = chords(&world.bodies, &self.r, &towards);
        let tau = optical_depth(world, &to_light, &distance);
        let exit = self.first_segment(world.bodies.len(), &to_light);

        // The line: along the path's own direction, or one from the lobe around the light.
        let (mut e, mut balance, mut u) = ([[0.0; LANES]; 3], [0.0; LANES], [0.0; LANES]);
        for i in 0..LANES {
            let block = philox4x32(counter(self.number[i], channel, self.sample[i], self.pixel[i]), key);
            let (g, to) = (self.g[i], at(&towards, i));
            let lobe = hg::sample(g, to, unit(block[1]), unit(block[2]));
            let own = at(&self.own, i);
            let along = DVec3::new(
                if block[0] >> 31 == 0 { own.x } else { lobe.x },
                if block[0] >> 31 == 0 { own.y } else { lobe.y },
                if block[0] >> 31 == 0 { own.z } else { lobe.z },
            );
            let ratio = hg::denominator(g, at(&self.w, i).dot(along)) / hg::denominator(g, along.dot(to));
            balance[i] = 2.0 / (1.0 + ratio * ratio.sqrt());
            u[i] = unit(block[3]);
            set(&mut e, i, along);
        }
        let length = self.first_segment(world.bodies.len(), &chords(&world.bodies, &self.r, &e)).distance;
        let (steepness, cos) = steepness(&world.bodies, &self.r, &towards, &exit, &e);

        let (mut s, mut inverse_density, mut r1) = ([0.0; LANES], [0.0; LANES], [[0.0; LANES]; 3]);
        let (mut irradiance, mut lit) = ([0.0; LANES], [false; LANES]);
        for i in 0..LANES {
            let mu_t = self.mu_a[i] + self.mu_s[i];
            (s[i], inverse_density[i]) = ahead(steepness[i], length[i], mu_t, u[i]);
            let p = at(&self.r, i) + s[i] * at(&e, i);
            let (arrival, inside) = light.arrives(p);
            set(&mut r1, i, p);
            set(&mut towards, i, arrival.towards);
            set(&mut self.on_plane, i, arrival.on_plane);
            (distance[i], irradiance[i], lit[i]) = (arrival.distance, arrival.irradiance, inside);
        }
        let tau1 = optical_depth(world, &chords(&world.bodies, &r1, &towards), &distance);
        for i in 0..LANES {
            let inverse_survival = inverse_survival(depth(tau[i], cos[i], self.least[i]));
            let p = hg::density(self.g[i], at(&e, i).dot(at(&towards, i)));
            let dark = ((self.mu_a[i] + self.mu_s[i]) * s[i] + tau1[i]).min(DARK);
            let weight = self.weight[i] * balance[i] * inverse_survival * inverse_density[i];
            let radiance = weight * self.mu_s[i] * p * irradiance[i] * exp(-dark);
            let seen = (self.roulette[i] * inverse_survival < 1.0) & lit[i] & (length[i] > 0.0);
            self.radiance[i] = if seen { radiance } else { 0.0 };
        }
    }

    /// Where the segment of the own medium that a ray starts in ends, and at which body's surface.
    #[inline(always)]
    fn first_segment(&self, bodies: usize, chords: &[Chord; MOST_BODIES]) -> Exit {
        let mut exit = Exit { distance: [f64::INFINITY; LANES], body: [0; LANES] };
        for (j, chord) in chords[..bodies].iter().enumerate() {
            let j = j as u64;
            for i in 0..LANES {
                let (enter, leave) = (chord.enter[i], chord.leave[i]);
                // Its own body ends it by its exit, one of higher priority by its entry: not one that is missed or behind.
                let carves = (j < self.body[i]) & (enter < leave) & (leave > 0.0);
                let own = j == self.body[i];
                let end = if own { leave } else { enter };
                let nearer = (carves | own) & (end < exit.distance[i]);
                exit.distance[i] = if nearer { end } else { exit.distance[i] };
                exit.body[i] = if nearer { j } else { exit.body[i] };
            }
        }
        exit
    }
}

#[inline(always)]
fn at(axes: &Axes, i: usize) -> DVec3 {
    DVec3::new(axes[0][i], axes[1][i], axes[2][i])
}

#[inline(always)]
fn set(axes: &mut Axes, i: usize, v: DVec3) {
    (axes[0][i], axes[1][i], axes[2][i]) = (v.x, v.y, v.z);
}

#[inline(always)]
fn chords(bodies: &[Body], r: &Axes, w: &Axes) -> [Chord; MOST_BODIES] {
    let mut chords = [Chord { enter: [0.0; LANES], leave: [0.0; LANES] }; MOST_BODIES];
    for (chord, body) in chords.iter_mut().zip(bodies) {
        // Said again in each arm, so that its loop is about one kind of solid and goes by vectors.
        match body.solid {
            Solid::Slab { bottom, top } => fill(chord, &Solid::Slab { bottom, top }, r, w),
            Solid::Box { low, high } => fill(chord, &Solid::Box { low, high }, r, w),
            Solid::Ellipsoid { center, radii } => fill(chord, &Solid::Ellipsoid { center, radii }, r, w),
            Solid::Cylinder { axis, radius, bottom, top } => {
                fill(chord, &Solid::Cylinder { axis, radius, bottom, top }, r, w)
            }
            // Kept away by `bodies_by_material`.
            ref solid => fill(chord, solid, r, w),
        }
    }
    chords
}

#[inline(always)]
fn fill(chord: &mut Chord, solid: &Solid, r: &Axes, w: &Axes) {
    for i in 0..LANES {
        (chord.enter[i], chord.leave[i]) = solid.chord(at(r, i), at(w, i));
    }
}

/// Along the first `distance` of rays: what of each body is not carved out by those of higher priority, by inclusion and exclusion.
#[inline(always)]
fn optical_depth(world: &World, chords: &[Chord; MOST_BODIES], distance: &[f64; LANES]) -> [f64; LANES] {
    let mut tau = [0.0; LANES];
    for (j, body) in world.bodies.iter().enumerate() {
        let mu_t = world.materials[body.material].mu_t();
        // Lengths common to body j and to every one of a set of higher bodies, the set by its bits.
        for set in 0..1_usize << j {
            let sign = if set.count_ones() % 2 == 0 { mu_t } else { -mu_t };
            let (mut enter, mut leave) = ([0.0; LANES], *distance);
            for (k, chord) in chords[..=j].iter().enumerate() {
                if k == j || set >> k & 1 == 1 {
                    for i in 0..LANES {
                        (enter[i], leave[i]) = (chord.enter[i].max(enter[i]), chord.leave[i].min(leave[i]));
                    }
                }
            }
            for i in 0..LANES {
                tau[i] += sign * (leave[i] - enter[i]).max(0.0);
            }
        }
    }
    tau
}

/// (e . n) / (L . n), n the normal of the interface through which the light comes; and L . n.
#[inline(always)]
fn steepness(bodies: &[Body], r: &Axes, towards: &Axes, exit: &Exit, e: &Axes) -> ([f64; LANES], [f64; LANES]) {
    let (mut ratio, mut cos) = ([0.0; LANES], [1.0; LANES]);
    for (j, body) in bodies.iter().enumerate() {
        for (i, (ratio, cos)) in ratio.iter_mut().zip(&mut cos).enumerate() {
            let p = at(r, i) + exit.distance[i] * at(towards, i);
            // Neither its length nor its sign matters.
            let n = match body.solid {
                Solid::Slab { .. } => DVec3::Z,
                Solid::Box { low, high } => {
                    let off = (p - low).abs().min((p - high).abs());
                    let (x, y) = ((off.x <= off.y) & (off.x <= off.z), off.y <= off.z);
                    DVec3::new(one_if(x), one_if(!x & y), one_if(!x & !y))
                }
                Solid::Ellipsoid { center, radii } => (p - center) / (radii * radii),
                Solid::Cylinder { axis, radius, bottom, top } => {
                    let out = p.truncate() - axis;
                    let side = (out.length() - radius).abs() <= (p.z - bottom).abs().min((p.z - top).abs());
                    DVec3::new(if side { out.x } else { 0.0 }, if side { out.y } else { 0.0 }, one_if(!side))
                }
                // Kept away by `bodies_by_material`.
                ref solid => solid.normal(0, p),
            };
            let (along, through) = (at(e, i).dot(n), at(towards, i).dot(n));
            *ratio = if exit.body[i] == j as u64 { along / through } else { *ratio };
            *cos = if exit.body[i] == j as u64 { through / n.length() } else { *cos };
        }
    }
    (ratio, cos)
}

#[inline(always)]
fn one_if(yes: bool) -> f64 {
    if yes { 1.0 } else { 0.0 }
}

/// s in (0, length) from a density proportional to exp(-rate s), and one over that density.
///
/// Below a plane the optical depth to the light falls by mu_t `steepness` per mm: then the rate mu_t (1 - steepness) makes every s
/// score the same. Elsewhere it is a guess, kept where the weight cannot explode: [-1, 2] mu_t. Any rate is unbiased.
#[inline(always)]
pub fn ahead(steepness: f64, length: f64, mu_t: f64, u: f64) -> (f64, f64) {
    let rate = if steepness.is_nan() { 1.0 } else { 1.0 - steepness }.clamp(-1.0, 2.0) * mu_t;
    // On an infinite length only positive rates have a density.
    let rate = if (length == f64::INFINITY) & (rate <= 1e-4 * mu_t) { mu_t } else { rate };
    let steep = (rate * length).abs();
    let mass = 1.0 - exp(-steep.min(DARK));
    let left = 1.0 - u * mass;
    let fallen = (-ln(left) / rate.abs()).min(length);
    // A growing density is a falling one seen from the other end.
    let s = if rate > 0.0 { fallen } else { length - fallen };
    let flat = steep < FLAT;
    (if flat { u * length } else { s }, if flat { length } else { mass / (rate.abs() * left) })
}

/// Optical depth below the plane through which the light comes, which is `tau` away at the cosine `cos`; at least what is known.
///
/// An estimate ahead is from further on along the path, which may come up to the interface the short way: where light grazes the exit, it is far
/// away from places near which it is bright. A roulette by `tau` itself would leave those to one estimate in very many (measured in a tube
/// lit along its axis: kurtosis above 2000, intervals of two standard errors that hold the truth in 86 % of cases after 256 paths).
#[inline(always)]
pub fn depth(tau: f64, cos: f64, least: f64) -> f64 {
    let depth = tau * cos.abs();
    if depth > least { depth } else { least }
}

/// One over the probability of connecting at optical distance `tau`; that falls slower than the light does.
#[inline(always)]
pub fn inverse_survival(tau: f64) -> f64 {
    let x = (tau * (1.0 / TAU_SURE)).max(1.0);
    x * x * x * x
}
