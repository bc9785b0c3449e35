//! Light walked forward from its sources, to where it ends: the power that leaves the scene, and that absorbed in each object.
//!
//! The flights and interfaces are those of the paths from the camera ([`Walker::step`]); nothing is estimated on the way.

use std::f64::consts::FRAC_1_PI;

use glam::DVec3;
use turbid_contract::{Ctx, Error};
use turbid_optics::elementary::{ln, sin_cos_turns};
use turbid_optics::henyey_greenstein::turn;
use turbid_optics::philox::{self, unit, unit_fine};

use crate::detector::{Detector, pass, sides};
use crate::lamp::{Lamp, Steady};
use crate::lengths::NO_LENGTHS;
use crate::level::named;
use crate::light::{Emission, Light};
use crate::projected_images::ProjectedImages;
use crate::random::{Purpose, Stream};
use crate::rig::Rig;
use crate::setting::{Nee, Place, Setting};
use crate::walker::{Ending, Walker};
use crate::world::World;

/// The pixel in whose stead photons draw their random numbers; no image has so many.
const PIXEL: u32 = u32::MAX;
/// Photons of a tile.
const TILE: usize = 4096;

/// Where photons ended, of `photons`.
#[derive(Clone, Debug, PartialEq)]
pub struct Tally {
    pub photons: u64,
    /// W that all of them stand for.
    pub power: f64,
    /// Out of the scene, upwards and downwards.
    pub left: [u64; 2],
    /// In each body or at its surface.
    pub absorbed: Vec<u64>,
    /// Of each detector.
    pub detected: Vec<Detected>,
}

/// What came through a detector.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Detected {
    /// Photons that ended there.
    pub taken: u64,
    /// Sums over the photons of how often each came through, and of the squares.
    pub passages: u64,
    pub squares: u64,
}

/// What became of `photons` photons of each channel's lights. Light from infinity has no power to share out and is left out.
pub fn tally(rig: &Rig, detectors: &[Detector], photons: u32, ctx: Ctx<'_>) -> Result<Vec<Tally>, Error> {
    let tiles = (photons as usize).div_ceil(TILE);
    let key = philox::key(ctx.seed());
    let (dark, still) = (Light::none(), Steady::NONE);
    let parts = ctx.map_tiles(rig.worlds.len() * tiles, |i| {
        let (channel, tile) = (i / tiles, i % tiles);
        let setting = Setting {
            world: &rig.worlds[channel],
            camera: &rig.camera,
            // No light.
            light: &dark,
            steady: &still,
            carriers: &[],
            projected_images: &ProjectedImages::NONE,
            key,
            channel: channel as u32,
            nee: Nee::Point,
            shared: None,
        };
        let sources = Sources::of(&rig.lights[channel], &rig.steady[channel]);
        let mut walker = Walker::new(setting, named(ctx.simd()));
        let mut tally = Tally::new(&rig.worlds[channel], detectors);
        let mut counts = vec![0; detectors.len()];
        walker.clear_responses(1);
        for photon in (tile * TILE) as u32..photons.min(((tile + 1) * TILE) as u32) {
            let stream = Stream::new(key, PIXEL, photon, channel as u32);
            let mut at = sources.start(&stream, photon);
            counts.fill(0);
            let taken = walk(&mut walker, &mut at, detectors, &mut counts);
            for (detected, &n) in tally.detected.iter_mut().zip(&counts) {
                detected.passages += u64::from(n);
                detected.squares += u64::from(n) * u64::from(n);
            }
            match (taken, walker.ending()) {
                (Some(detector), _) => tally.detected[detector].taken += 1,
                (None, Ending::Left) => tally.left[usize::from(at.w.z <= 0.0)] += 1,
                (None, Ending::Absorbed(body)) => tally.absorbed[body] += 1,
                // The tile is thrown away.
                (None, Ending::Endless) => break,
            }
        }
        (tally, walker.endless())
    })?;
    if parts.iter().any(|part| part.1) {
        return Err(Error::failed("a photon does not end: it is in a closed space that absorbs nothing"));
    }
    let channels = parts.chunks(tiles).enumerate().map(|(channel, parts)| {
        let mut sum = Tally::new(&rig.worlds[channel], detectors);
        (sum.photons, sum.power) =
            (u64::from(photons), Sources::of(&rig.lights[channel], &rig.steady[channel]).power());
        parts.iter().for_each(|(part, _)| sum.add(part));
        sum
    });
    Ok(channels.collect())
}

/// Walks a photon to its end, and counts the detectors that it comes through; the one that takes it, if one does.
fn walk(walker: &mut Walker<'_>, at: &mut Place, detectors: &[Detector], counts: &mut [u32]) -> Option<usize> {
    if detectors.is_empty() {
        while walker.step(at) {}
        return None;
    }
    let mut sides = sides(detectors, at.r);
    loop {
        // Every step is a straight stretch, and only its end turns.
        let (r, w) = (at.r, at.w);
        let goes_on = walker.step(at);
        let leaves = !goes_on && walker.ending() == Ending::Left;
        let length = if leaves { f64::INFINITY } else { (at.r - r).dot(w) };
        let taken = pass(detectors, (r, w, length), &mut sides, counts);
        if taken.is_some() || !goes_on {
            return taken;
        }
    }
}

impl Tally {
    fn new(world: &World, detectors: &[Detector]) -> Self {
        let (absorbed, detected) = (vec![0; world.bodies.len()], vec![Detected::default(); detectors.len()]);
        Self { photons: 0, power: 0.0, left: [0; 2], absorbed, detected }
    }

    /// Adds where photons of another tile ended.
    fn add(&mut self, other: &Self) {
        self.left.iter_mut().zip(other.left).for_each(|(sum, n)| *sum += n);
        self.absorbed.iter_mut().zip(&other.absorbed).for_each(|(sum, n)| *sum += n);
        for (sum, part) in self.detected.iter_mut().zip(&other.detected) {
            sum.taken += part.taken;
            sum.passages += part.passages;
            sum.squares += part.squares;
        }
    }
}

/// All that shines with a power, with the running sums of powers.
struct Sources<'a> {
    light: &'a Light,
    lamps: &'a [Lamp],
    /// Of the projector, then of the lamps.
    sums: Vec<f64>,
}

impl<'a> Sources<'a> {
    fn of(light: &'a Light, steady: &'a Steady) -> Self {
        let mut sum = light.power();
        let mut sums = vec![sum];
        for lamp in &steady.lamps {
            sum += lamp.power();
            sums.push(sum);
        }
        Self { light, lamps: &steady.lamps, sums }
    }

    fn power(&self) -> f64 {
        self.sums[self.lamps.len()]
    }

    /// A photon at its start, each with the same share of the power.
    fn start(&self, stream: &Stream, photon: u32) -> Place {
        let [choice, low, ja, jb] = stream.block(Purpose::Start(0));
        let chosen = unit_fine(choice, low) * self.power();
        let source = self.sums.iter().position(|&sum| chosen < sum).unwrap_or(self.lamps.len());
        let mut draws = (1..).map(|trial| {
            let [u, v, w, _] = stream.block(Purpose::Start(trial));
            [unit(u), unit(v), unit(w)]
        });
        let (r, w) = match source.checked_sub(1) {
            None => emit(self.light, &mut draws),
            Some(i) => shine(&self.lamps[i], draws.next().expect("they never end")),
        };
        Place {
            r,
            w,
            material: 0,
            surface_point: None,
            clear: 0.0,
            absorption_depth: -ln(unit_fine(ja, jb)),
            weight: 1.0,
            pixel: PIXEL,
            sample: photon,
            number: 2,
            ahead: false,
            wholly: false,
            scattered: false,
            specular: false,
            mis_weight: 1.0,
            light_branch: false,
            response: 0,
            lengths: NO_LENGTHS,
        }
    }
}

/// A ray of the projector at pattern value 1: an even place of the pattern, kept with the probability of its flux.
fn emit(light: &Light, draws: &mut impl Iterator<Item = [f64; 3]>) -> (DVec3, DVec3) {
    let view = &light.view;
    // The place of the field nearest to the pinhole has the highest irradiance I h / R^3.
    let foot = view.position - view.look_at;
    let aside = |along: DVec3, side: f64| foot.dot(along).clamp(-0.5 * side, 0.5 * side);
    let nearest =
        view.look_at + aside(view.right, view.field.x) * view.right + aside(view.top, view.field.y) * view.top;
    let least = (nearest - view.position).length();
    loop {
        let [x, y, keep] = draws.next().expect("they never end");
        let ratio = least / (view.plane_point(x, y) - view.position).length();
        if matches!(light.emission, Emission::Irradiance(_)) || keep < ratio * ratio * ratio {
            return view.ray(x, y);
        }
    }
}

/// A ray of a lamp.
fn shine(lamp: &Lamp, [u, v, _]: [f64; 3]) -> (DVec3, DVec3) {
    let (sin, cos) = sin_cos_turns(v);
    match *lamp {
        Lamp::Point { position, .. } => {
            let z = 1.0 - 2.0 * u;
            (position, turn(DVec3::Z, z, (1.0 - z * z).sqrt(), sin, cos))
        }
        Lamp::Spot { position, axis, half: (sin_half, cos_half), .. } => {
            // 1 - cos(half), without cancellation for narrow cones.
            let depth = if cos_half > 0.0 { sin_half * sin_half / (1.0 + cos_half) } else { 1.0 - cos_half };
            let fall = u * depth;
            (position, turn(axis, 1.0 - fall, (fall * (2.0 - fall)).sqrt(), sin, cos))
        }
        Lamp::Beam { center, along, radius, .. } => {
            let (x, y) = along.any_orthonormal_pair();
            (center + radius * u.sqrt() * (cos * x + sin * y), along)
        }
    }
}

impl Light {
    /// W inside the field at pattern value 1.
    fn power(&self) -> f64 {
        match self.emission {
            Emission::Intensity(0.0) => 0.0,
            Emission::Intensity(i) => i * self.view.solid_angle(),
            Emission::Irradiance(e) => e * self.view.field.x * self.view.field.y,
        }
    }
}

impl Lamp {
    /// W.
    fn power(&self) -> f64 {
        match *self {
            Self::Point { intensity, .. } => intensity * 4.0 / FRAC_1_PI,
            Self::Spot { half: (sin, cos), intensity, .. } => {
                let depth = if cos > 0.0 { sin * sin / (1.0 + cos) } else { 1.0 - cos };
                2.0 * depth * intensity / FRAC_1_PI
            }
            Self::Beam { radius, irradiance, .. } => radius * radius * irradiance / FRAC_1_PI,
        }
    }
}
