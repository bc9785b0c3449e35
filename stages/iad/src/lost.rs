//! Light that leaves a wide sample beside the port of a sphere, by following photons.
//!
//! A slab between slides of finite thickness is lit by a round beam or by diffuse light that fills the port; what comes out
//! farther from the axis than the port reaches never enters the sphere. Photons run without absorption, and those that are
//! lost leave the length of their path in the slab: exp(-mu_a path) then tells the loss at every mu_a. Over mu_s' it is
//! interpolated between nodes at steps of a quarter octave, which all use the same random numbers.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use glam::DVec3;
use turbid_optics::elementary::{exp, ln, sin_cos_turns};
use turbid_optics::philox::{key, philox4x32, unit};
use turbid_optics::{PhaseFunction, fresnel};

use crate::{Lost, Slab};

/// A beam on a sample between the ports of two spheres; lengths in mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spot {
    /// Diameter of the beam, >= 0.
    pub beam_mm: f64,
    /// Angle of the beam from the normal, rad, in [0, pi/2).
    pub angle: f64,
    /// Diameters of the ports at the top (reflected light) and at the bottom (transmitted light), > 0.
    pub ports_mm: [f64; 2],
    /// Thickness of the slides at the top and at the bottom, >= 0.
    pub slides_mm: [f64; 2],
}

/// Losses of any number of media, each node computed once; what it holds does not depend on the order of questions.
pub struct Losses {
    seed: u64,
    nodes: Mutex<BTreeMap<[u64; 16], Slot>>,
}

/// A node, once it was followed.
type Slot = Arc<OnceLock<Arc<Node>>>;

/// Photons of each light that a node follows at most, and at least.
const PHOTONS: [u64; 2] = [40_000, 4_000];
/// Scatterings that a light of a node may cost, about.
const SCATTERINGS: f64 = 4e6;
/// Nodes per octave of mu_s' d.
const PER_OCTAVE: f64 = 4.0;
/// Nodes lie at mu_s' d = 2^(j / 4), j within this.
const RANGE: [f64; 2] = [-48.0, 40.0];

impl Losses {
    /// Losses of one run of random numbers.
    pub fn new(seed: u64) -> Self {
        Self { seed, nodes: Mutex::default() }
    }

    /// What a sample of these coefficients (mm^-1) loses, with standard errors.
    ///
    /// g counts to 0.05 and at most as 0.95, indices count to 0.01: mu_s' decides where light comes out.
    pub fn lost(&self, slab: &Slab, spot: &Spot, mu_a: f64, mu_s_prime: f64) -> (Lost, Lost) {
        let depth = mu_s_prime * slab.thickness_mm;
        let at = if depth > 0.0 { PER_OCTAVE * libm::log2(depth) } else { RANGE[0] };
        let low = at.floor().clamp(RANGE[0], RANGE[1]);
        // Thinner than all nodes loss is in proportion to scattering; deeper it is that of the last node.
        let thin = if at < RANGE[0] { depth / libm::exp2(RANGE[0] / PER_OCTAVE) } else { 1.0 };
        let share = (at - low).clamp(0.0, 1.0);
        let [near, far] = [low, low + 1.0].map(|j| {
            let node = self.node(slab, spot, j);
            [0, 1, 2, 3].map(|k| node.loss(k, mu_a))
        });
        let mix = |k: usize, i: usize| {
            let [a, b] = [near[k], far[k]].map(|(mean, se)| if i == 0 { mean } else { se });
            thin * (a + share * (b - a))
        };
        let of = |i: usize| Lost { beam: [mix(0, i), mix(1, i)], diffuse: [mix(2, i), mix(3, i)] };
        (of(0), of(1))
    }

    fn node(&self, slab: &Slab, spot: &Spot, j: f64) -> Arc<Node> {
        let steps = |x: f64, per: f64| (x * per).round() / per;
        let surface = |i: usize| if i == 0 { slab.top } else { slab.bottom };
        let slide = |i: usize| {
            let n = steps(surface(i).n, 100.0);
            // Light does not travel sideways in what is not there.
            if n == 1.0 || spot.slides_mm[i] == 0.0 { (n, 0.0) } else { (n, spot.slides_mm[i]) }
        };
        let phase = match slab.phase {
            PhaseFunction::HenyeyGreenstein { g } => {
                PhaseFunction::henyey_greenstein(steps(g, 20.0).clamp(-0.95, 0.95))
            }
            phase @ PhaseFunction::TwoTermHenyeyGreenstein { .. } => phase,
        };
        let room = Room {
            n: steps(slab.n, 100.0),
            phase,
            thickness: slab.thickness_mm,
            slides: [slide(0), slide(1)],
            tau: [slab.top.tau, slab.bottom.tau],
            mu_s_prime: libm::exp2(j / PER_OCTAVE) / slab.thickness_mm,
            spot: *spot,
        };
        let name = room.name();
        let node = {
            let mut nodes = self.nodes.lock().unwrap_or_else(PoisonError::into_inner);
            Arc::clone(nodes.entry(name).or_default())
        };
        // Outside the lock: other threads follow other photons meanwhile.
        Arc::clone(node.get_or_init(|| Arc::new(Node::follow(&room, self.seed))))
    }
}

/// Path lengths of lost light.
struct Node {
    photons: f64,
    /// (path in the slab, weight) of photons lost in the beam's reflection and transmission, and in those of diffuse light.
    lost: [Vec<(f64, f64)>; 4],
}

impl Node {
    /// Fraction lost, with its standard error.
    fn loss(&self, light: usize, mu_a: f64) -> (f64, f64) {
        let (mut sum, mut squares) = (0.0, 0.0);
        for (path, weight) in &self.lost[light] {
            let w = weight * exp(-(mu_a * path).min(700.0));
            sum += w;
            squares += w * w;
        }
        let mean = sum / self.photons;
        // Nothing seen to be lost is not nothing lost: one photon more or less is.
        let variance = (squares / self.photons - mean * mean).max(1.0 / self.photons);
        (mean, (variance / self.photons).sqrt())
    }
}

/// The sample as photons meet it.
struct Room {
    n: f64,
    phase: PhaseFunction,
    thickness: f64,
    /// Index and thickness of each slide; thickness 0 for one that is thin.
    slides: [(f64, f64); 2],
    tau: [f64; 2],
    mu_s_prime: f64,
    spot: Spot,
}

/// A plane layer between two heights.
struct Layer {
    n: f64,
    thickness: f64,
    /// Absorption per mm along the way.
    absorption: f64,
    scatters: bool,
}

impl Room {
    fn name(&self) -> [u64; 16] {
        let Self { n, phase, thickness, slides, tau, mu_s_prime, spot } = self;
        let [(forward, g_forward), (_, g_backward)] = phase.terms();
        [
            *n,
            forward,
            g_forward,
            g_backward,
            *thickness,
            slides[0].0,
            slides[0].1,
            slides[1].0,
            slides[1].1,
            tau[0],
            tau[1],
            *mu_s_prime,
            spot.beam_mm,
            spot.angle,
            spot.ports_mm[0],
            spot.ports_mm[1],
        ]
        .map(|x| (x + 0.0).to_bits())
    }

    /// From the top downwards; a slide that is thin has no depth but its index still reflects.
    fn layers(&self) -> Vec<Layer> {
        let slide = |i: usize| {
            let ((n, thickness), tau) = (self.slides[i], self.tau[i]);
            let absorption = if thickness > 0.0 { tau / thickness } else { 0.0 };
            (n != 1.0).then_some(Layer { n, thickness, absorption, scatters: false })
        };
        let slab = Layer { n: self.n, thickness: self.thickness, absorption: 0.0, scatters: true };
        slide(0).into_iter().chain([slab]).chain(slide(1)).collect()
    }
}

/// How a photon left.
enum Exit {
    /// (0 top or 1 bottom, distance from the axis, path in the slab, weight).
    Through(usize, f64, f64, f64),
    /// Its way was cut short: absorbed in a slide, or without end.
    Nowhere,
}

impl Node {
    fn follow(room: &Room, seed: u64) -> Self {
        let layers = room.layers();
        let mu_s = room.mu_s_prime / (1.0 - room.phase.g());
        // Without absorption diffuse light runs 2 n^2 times the thickness on average, whatever scatters it.
        let each = 2.0 * room.n * room.n * mu_s * room.thickness + 1.0;
        let photons = ((SCATTERINGS / each) as u64).clamp(PHOTONS[1], PHOTONS[0]);
        let mut lost: [Vec<(f64, f64)>; 4] = Default::default();
        for diffuse in [false, true] {
            for photon in 0..photons {
                let mut random = Stream::new(seed, photon, u32::from(diffuse));
                let (r, u) = room.enter(diffuse, &mut random);
                if let Exit::Through(side, distance, path, weight) = walk(&layers, mu_s, &room.phase, r, u, &mut random)
                    && distance > 0.5 * room.spot.ports_mm[side]
                {
                    lost[2 * usize::from(diffuse) + side].push((path, weight));
                }
            }
        }
        Self { photons: photons as f64, lost }
    }
}

impl Room {
    /// Where a photon meets the sample, and its direction in the air.
    fn enter(&self, diffuse: bool, random: &mut Stream) -> (DVec3, DVec3) {
        let wide = 0.5 * if diffuse { self.spot.ports_mm[0] } else { self.spot.beam_mm };
        let radius = wide * random.uniform().sqrt();
        let (sin, cos) = sin_cos_turns(random.uniform());
        let r = DVec3::new(radius * cos, radius * sin, 0.0);
        if diffuse {
            let down = random.uniform();
            let (sin, cos) = sin_cos_turns(random.uniform());
            let aside = (1.0 - down).sqrt();
            return (r, DVec3::new(aside * cos, aside * sin, down.sqrt()));
        }
        let (sin, cos) = (libm::sin(self.spot.angle), libm::cos(self.spot.angle));
        (r, DVec3::new(sin, 0.0, cos))
    }
}

/// Of a photon in the air above the first layer.
fn walk(layers: &[Layer], mu_s: f64, phase: &PhaseFunction, mut r: DVec3, mut u: DVec3, random: &mut Stream) -> Exit {
    /// Ways without end are those of light that a mirror holds; a photon scatters far more rarely.
    const EVENTS: u32 = 10_000_000;
    // The layer that the photon is in; -1 and the number of layers are the air.
    let (mut at, mut path, mut weight) = (-1_isize, 0.0, 1.0);
    let index = |i: isize| usize::try_from(i).ok().and_then(|i| layers.get(i)).map_or(1.0, |layer| layer.n);
    for _ in 0..EVENTS {
        // On a surface: over it or back.
        let next = if u.z > 0.0 { at + 1 } else { at - 1 };
        let (here, there) = (index(at), index(next));
        if here != there {
            let cos = u.z.abs();
            let refracted = fresnel::refracted_cos(here / there, cos);
            let reflected = refracted.map_or(1.0, |_| fresnel::reflectance(here / there, cos));
            match refracted {
                Some(cos) if random.uniform() >= reflected => {
                    u = DVec3::new(u.x * here / there, u.y * here / there, cos.copysign(u.z));
                    at = next;
                }
                _ => u.z = -u.z,
            }
        } else {
            at = next;
        }
        let Some(layer) = usize::try_from(at).ok().and_then(|i| layers.get(i)) else {
            let side = usize::from(at > 0);
            return Exit::Through(side, libm::hypot(r.x, r.y), path, weight);
        };
        // Depth below the layer's top.
        let mut z = if u.z > 0.0 { 0.0 } else { layer.thickness };
        // Through the layer to one of its surfaces.
        loop {
            if u.z == 0.0 && !(layer.scatters && mu_s > 0.0) {
                return Exit::Nowhere;
            }
            let to_surface = if u.z > 0.0 {
                (layer.thickness - z) / u.z
            } else if u.z < 0.0 {
                z / -u.z
            } else {
                f64::INFINITY
            };
            let free = if layer.scatters && mu_s > 0.0 { -ln(random.uniform()) / mu_s } else { f64::INFINITY };
            let step = free.min(to_surface);
            r += step * u;
            z += step * u.z;
            if layer.scatters {
                path += step;
            }
            weight *= exp(-(layer.absorption * step).min(700.0));
            if weight < 1e-12 {
                return Exit::Nowhere;
            }
            if free >= to_surface {
                break;
            }
            let (a, b) = (random.uniform(), random.uniform());
            u = phase.sample(u, a, b);
        }
    }
    Exit::Nowhere
}

/// Uniform numbers of one photon, drawn in order; those of the beam and of diffuse light are independent.
struct Stream {
    key: [u32; 2],
    counter: [u32; 4],
    block: [u32; 4],
    used: usize,
}

impl Stream {
    fn new(seed: u64, photon: u64, light: u32) -> Self {
        Self { key: key(seed), counter: [0, photon as u32, (photon >> 32) as u32, light], block: [0; 4], used: 4 }
    }

    #[inline(always)]
    fn uniform(&mut self) -> f64 {
        if self.used == 4 {
            self.block = philox4x32(self.counter, self.key);
            self.counter[0] = self.counter[0].wrapping_add(1);
            self.used = 0;
        }
        let bits = self.block[self.used];
        self.used += 1;
        unit(bits)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Plan, Slide};

    /// A port without breadth loses all that leaves the slab: at any absorption the beam's losses are UR1 and UT1 of the
    /// deterministic model, specular and unscattered light included, within 4 standard errors (12 comparisons).
    #[test]
    fn without_a_port_all_is_lost() {
        for (n, slide, g) in [(1.0, 1.0, 0.8), (1.4, 1.0, 0.0), (1.33, 1.5, 0.5)] {
            let side = Slide::clear(slide);
            let slab = Slab { top: side, bottom: side, ..Slab::bare(n, g, 1.0) };
            let spot = Spot { beam_mm: 2.0, angle: 0.0, ports_mm: [1e-9, 1e-9], slides_mm: [1.0, 1.0] };
            let losses = Losses::new(1);
            for (mu_a, mu_s_prime) in [(0.0, 1.0), (0.3, 2.0)] {
                let (lost, se) = losses.lost(&slab, &spot, mu_a, mu_s_prime);
                let r = Plan::<32>::new(&slab).unwrap().forward(mu_a, mu_s_prime).unwrap();
                for (k, (x, se, truth)) in
                    [(lost.beam[0], se.beam[0], r.ur1), (lost.beam[1], se.beam[1], r.ut1)].into_iter().enumerate()
                {
                    assert!((x - truth).abs() < 4.0 * se, "n = {n}, g = {g}, {k}: {x} +- {se}, {truth}");
                }
            }
        }
    }

    /// Diffuse light that fills a port far wider than the sample is deep comes back within it: the loss is the rim's, in
    /// proportion to 1 / width. The sum of what is lost at ever wider ports falls like that.
    #[test]
    fn wide_ports_lose_their_rim() {
        let slab = Slab::bare(1.4, 0.8, 1.0);
        let losses = Losses::new(2);
        let at = |port: f64| {
            let spot = Spot { beam_mm: 1.0, angle: 0.0, ports_mm: [port; 2], slides_mm: [0.0; 2] };
            losses.lost(&slab, &spot, 0.05, 1.0)
        };
        let (narrow, wide) = (at(20.0), at(80.0));
        for i in 0..2 {
            let (x, y) = (narrow.0.diffuse[i], 4.0 * wide.0.diffuse[i]);
            let se = libm::hypot(narrow.1.diffuse[i], 4.0 * wide.1.diffuse[i]);
            // Four standard errors, and the next order of 1 / width: a tenth at a rim of 2 mm on 20 mm.
            assert!((x - y).abs() < 4.0 * se + 0.1 * x, "{i}: {x} {y} +- {se}");
            assert!(wide.0.beam[i] <= narrow.0.beam[i] && narrow.0.beam[i] < 0.02, "{narrow:?} {wide:?}");
        }
    }

    /// Interpolated between its nodes, a loss is that of a node of its own to its standard error and the curvature over a
    /// quarter octave, 1.5 % of it ((ln 2 / 4)^2 / 8 = 0.4 % times a second derivative of up to 4).
    #[test]
    fn losses_join_smoothly() {
        let slab = Slab { top: Slide::clear(1.5), bottom: Slide::clear(1.5), ..Slab::bare(1.34, 0.8, 1.0) };
        let spot = Spot { beam_mm: 5.0, angle: 0.0, ports_mm: [12.7; 2], slides_mm: [1.0; 2] };
        let losses = Losses::new(3);
        let middle = libm::exp2(0.125);
        let (between, se) = losses.lost(&slab, &spot, 0.03, middle);
        // The same medium in a slab of other thickness has nodes elsewhere: scale all lengths.
        let scale = libm::exp2(0.125);
        let scaled = Slab { thickness_mm: scale, ..slab };
        let wide = Spot { beam_mm: 5.0 * scale, ports_mm: [12.7 * scale; 2], slides_mm: [scale; 2], ..spot };
        let (own, own_se) = losses.lost(&scaled, &wide, 0.03 / scale, middle / scale);
        for (a, b, se) in [
            (between.beam[0], own.beam[0], libm::hypot(se.beam[0], own_se.beam[0])),
            (between.diffuse[1], own.diffuse[1], libm::hypot(se.diffuse[1], own_se.diffuse[1])),
        ] {
            assert!((a - b).abs() < 4.0 * se + 0.015 * b, "{a} {b} +- {se}");
        }
    }
}
