//! Paths at their start: the camera's ray to the first medium, and the looks along it.

use std::ops::Range;

use fearless_simd::prelude::*;
use glam::DVec3;
use turbid_optics::philox::unit as unit_of;

use super::frame::Frame;
use super::lane::{LANES, U, ln, philox, unit};
use super::look::Looks;
use super::walk::{Paths, settles};
use crate::path::{Place, Walker};

/// Paths still to be begun, and those ready for lanes.
pub struct Starts {
    pixels: Range<usize>,
    samples: Range<u32>,
    next: usize,
    pub ready: Paths,
}

impl Starts {
    pub fn new(pixels: Range<usize>, samples: Range<u32>) -> Self {
        Self { pixels, samples, next: 0, ready: Paths::default() }
    }

    pub fn more(&self) -> bool {
        self.next < self.pixels.len() * self.samples.len()
    }

    /// Begins up to sixteen paths.
    #[inline(always)]
    pub fn make<S: Simd>(&mut self, simd: S, walker: &mut Walker<'_>, frame: &Frame, looks: &mut Looks) {
        let (first, per_pixel) = (self.next, self.samples.len());
        let count = (self.pixels.len() * per_pixel - first).min(LANES);
        let (mut pixel, mut sample) = ([0; LANES], [0; LANES]);
        for i in 0..count {
            let path = first + i;
            pixel[i] = (self.pixels.start + path / per_pixel) as u32;
            sample[i] = self.samples.start + (path % per_pixel) as u32;
        }
        self.next += count;
        let (key, high) = (walker.setting().key, walker.setting().channel << 16);
        let (p, s) = (U::load_array(simd, pixel), U::load_array(simd, sample));
        let [jx, jy, ja, _] = philox(simd, U::splat(simd, 0), high, s, p, key);
        let life = -ln(unit(ja));
        for i in 0..count {
            let jitter = (unit_of(jx[i]), unit_of(jy[i]));
            let ids = Ids { pixel: pixel[i], sample: sample[i], path: (first + i) as u32 };
            let made = frame.starts && self.enter(walker, frame, looks, ids, jitter, life[i]);
            if !made {
                let mut place = walker.begin(pixel[i] as usize, sample[i], first + i);
                if settles(walker, frame, &mut place) {
                    let (floats, words) = frame.row(walker, &place);
                    self.ready.push(floats, words);
                }
            }
        }
    }

    /// A path whose ray meets nothing but one medium: it starts where the ray enters. False where things are not so simple.
    #[inline(never)]
    fn enter(
        &mut self,
        walker: &Walker<'_>,
        frame: &Frame,
        looks: &mut Looks,
        ids: Ids,
        jitter: (f64, f64),
        life: f32,
    ) -> bool {
        let s = walker.setting();
        let (from, along) = s.camera.ray(ids.pixel as usize, jitter.0, jitter.1);
        let mut met = None;
        for (j, body) in s.world.bodies.iter().enumerate() {
            let (enter, leave) = body.solid.span(from, along);
            if enter < leave && leave > 0.0 && frame.filled[j] {
                if met.is_some() || enter <= 0.0 || !s.world.materials[body.material].mu_s.is_normal() {
                    return false;
                }
                met = Some((j, enter));
            } else if enter < leave && leave > 0.0 {
                // A void may hide a part of it.
                return false;
            }
        }
        let Some((body, enter)) = met else {
            // Nothing to see.
            return true;
        };
        let material = s.world.bodies[body].material;
        let m = &frame.media[material];
        let r = frame.local(from + enter * along);
        let w = along.as_vec3().to_array();
        let words = [1, ids.sample, ids.pixel, ids.path, body as u32];
        if !frame.blind {
            looks.push([r[0], r[1], r[2], w[0], w[1], w[2], w[0], w[1], w[2], 1.0, 0.0, m.mu_a, m.mu_s, m.g], words);
        }
        let floats = [r[0], r[1], r[2], w[0], w[1], w[2], life, 0.0, 1.0, m.free_path, m.mu_a, m.mu_s, m.g, m.window];
        self.ready.push(floats, [2, ids.sample, ids.pixel, ids.path, material as u32, body as u32]);
        true
    }
}

/// Which path it is.
#[derive(Clone, Copy)]
struct Ids {
    pixel: u32,
    sample: u32,
    path: u32,
}

impl Frame {
    /// The highest body around a point that lanes may carry.
    pub fn body_at(&self, walker: &Walker<'_>, place: &Place) -> Option<usize> {
        let world = walker.setting().world;
        let body = world.bodies.iter().position(|body| body.solid.contains(place.r))?;
        let near = (place.r - self.origin).length_squared() < f64::from(self.range_squared);
        (near && world.bodies[body].material == place.material).then_some(body)
    }

    /// The row of a path in its medium.
    pub fn row(&self, walker: &Walker<'_>, place: &Place) -> ([f32; 14], [u32; 6]) {
        let body = self.body_at(walker, place).expect("only settled paths are put into lanes");
        let m = &self.media[place.material];
        let ([x, y, z], [a, b, c]) = (self.local(place.r), place.w.as_vec3().to_array());
        let (life, weight) = (place.life as f32, place.weight as f32);
        let floats = [x, y, z, a, b, c, life, 0.0, weight, m.free_path, m.mu_a, m.mu_s, m.g, m.window];
        let (path, material) = (place.response as u32, place.material as u32);
        (floats, [place.number as u32, place.sample, place.pixel, path, material, body as u32])
    }

    /// The path of a row, for the scalar walker.
    pub fn place(&self, floats: [f32; 14], words: [u32; 6]) -> Place {
        let [x, y, z, a, b, c, life, lost, weight, ..] = floats;
        let [number, sample, pixel, path, material, _] = words;
        Place {
            r: self.world([x, y, z]),
            // Unit length to f64.
            w: DVec3::new(f64::from(a), f64::from(b), f64::from(c)).normalize(),
            material: material as usize,
            skin: None,
            clear: 0.0,
            life: f64::from(life) - f64::from(lost),
            weight: f64::from(weight),
            pixel,
            sample,
            number: u64::from(number),
            ahead: true,
            // The camera's ray was scored as far as it goes.
            wholly: number == 2,
            response: path as usize,
        }
    }
}
