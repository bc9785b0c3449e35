//! The image of one laterally uniform slab by the transport solver, as if light fell straight down and were looked at from straight above:
//! no paths and no noise, but an error that is bounded beforehand.

use std::f64::consts::{FRAC_1_PI, PI, TAU};
use std::sync::Arc;

use glam::DVec3;
use turbid_contract::Error;
use turbid_contract::payload::{Scene, Shape, Surface};
use turbid_geometry::phase_function;
use turbid_optics::elementary::sin_cos_turns;
use turbid_optics::{Medium, rte};

use crate::field::Field;
use crate::fit::Guides;
use crate::light::{Carrier, Emission, Light};
use crate::rig::Rig;
use crate::uniform::{missing_light, obstacle};
use crate::world::Chords;

/// What bounds the error of the responses to one carrier, relative to their modulus.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Bound {
    pub modulus: f64,
    /// rad.
    pub phase: f64,
}

impl Bound {
    /// Of a frame, relative to the modulus.
    pub fn whole(&self) -> f64 {
        libm::hypot(self.modulus, self.phase)
    }
}

/// The image of one channel.
#[derive(Clone)]
pub struct PlaneWave {
    guides: Arc<Guides>,
    /// W (or W/sr ..) of the projector over that of the guides.
    strength: f64,
    /// Radiance over irradiance, for the pattern 1 and for each carrier.
    ratios: Vec<f64>,
    /// What a pixel's width leaves of each carrier, `[pixel][carrier]`.
    sharpness: Arc<[f64]>,
    bounds: Vec<Bound>,
}

/// Why the solver would not give the image; `None` where it does, within its bound.
pub fn no_plane_wave(scene: &Scene) -> Option<String> {
    if let Some(reason) = obstacle(scene, None) {
        return Some(reason);
    }
    if scene.objects.len() != 1 {
        return Some("the solver knows one slab alone".to_owned());
    }
    if scene.camera.as_ref().is_some_and(|camera| camera.aperture.is_some()) {
        return Some("a lens with an aperture looks from many sides".to_owned());
    }
    let unsolvable = |m: &turbid_contract::payload::Medium| {
        rte::solvable(&phase_function(&m.phase), m.n).err().map(|e| e.to_string())
    };
    scene.media.values().find_map(unsolvable)
}

/// The rig as the bounds see it.
struct Geometry {
    /// Least height of the light above what is seen, mm.
    height: f64,
    /// Largest sine and tangent of the angles between the vertical and lines of light, and of sight.
    sines: [f64; 2],
    tangents: [f64; 2],
    /// Spatial frequency on the surface over that in the pattern's plane.
    zoom: f64,
}

impl Geometry {
    fn of(rig: &Rig) -> Option<Self> {
        let (world, light) = (&rig.worlds[0], &rig.lights[0].view);
        let mut chords = Chords::default();
        let mut geometry = Self { height: f64::INFINITY, sines: [0.0; 2], tangents: [0.0; 2], zoom: 1.0 };
        // Angles and distances are extreme at corners, or where a line is vertical.
        for (x, y) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
            let (origin, w) = rig.camera.view.ray(x, y);
            let segment = world.trace(origin, w, None, &mut chords).find(|segment| segment.material != 0)?;
            let seen = origin + segment.start * w;
            let lines: [DVec3; 2] = [(seen - light.position).normalize(), w];
            for (i, line) in lines.iter().enumerate() {
                let (sin, cos) = (line.truncate().length(), line.z.abs());
                geometry.sines[i] = geometry.sines[i].max(sin);
                geometry.tangents[i] = geometry.tangents[i].max(sin / cos);
            }
            let height = (light.position.z - seen.z).abs();
            geometry.height = geometry.height.min(height);
            geometry.zoom = light.height() / height;
        }
        Some(geometry)
    }
}

/// The bounds for the pattern 1 and each carrier, the worst of the channels.
pub fn bounds(scene: &Scene, carriers: &[Carrier]) -> Option<Vec<Bound>> {
    let rig = Rig::of(scene).ok()?;
    let geometry = Geometry::of(&rig)?;
    let of = |f_x: f64| {
        let channels = (0..scene.channels()).map(|channel| bound(scene, channel, &geometry, f_x));
        channels.fold(Bound::default(), |worst, b| Bound {
            modulus: worst.modulus.max(b.modulus),
            phase: worst.phase.max(b.phase),
        })
    };
    Some(std::iter::once(0.0).chain(carriers.iter().map(Carrier::f_x)).map(of).collect())
}

/// With Z the depth down to which the light goes that comes back: irradiance falls with depth by 2 Z / height; radiance and
/// irradiance vary with the squares of sines (by a quarter of them at most for a half-space that scatters isotropically); and the fringe
/// is seen where it entered a depth Z ahead and left a depth Z behind, its phase aside by 2 pi f Z tan(angle).
fn bound(scene: &Scene, channel: usize, geometry: &Geometry, f_x: f64) -> Bound {
    let Some((medium, thickness)) = slab(scene, channel) else {
        // A Lambertian plane is what it is, from all sides.
        return Bound::default();
    };
    let reduced = medium.mu_a + medium.mu_s_prime;
    let q = TAU * f_x * geometry.zoom;
    let decay = (3.0 * medium.mu_a * reduced + q * q).sqrt();
    let depth = (1.0 / reduced + 1.0 / decay).min(thickness);
    let tilt = q * depth * (geometry.tangents[0] + geometry.tangents[1]);
    let [light, visibility] = geometry.sines;
    let missing = missing_light(scene, channel);
    Bound {
        modulus: 2.0 * depth / geometry.height + light * light + visibility * visibility + 0.5 * tilt * tilt + missing,
        phase: tilt,
    }
}

/// The medium of the only slab, and its thickness; `None` where it is opaque.
fn slab(scene: &Scene, channel: usize) -> Option<(Medium, f64)> {
    let object = scene.objects.values().next()?;
    let (Shape::Slab { top, bottom }, Some(medium)) = (&object.shape, &object.medium) else { return None };
    let m = scene.media.get(medium)?;
    let (mu_a, mu_s) = (m.mu_a[channel], m.mu_s[channel]);
    let phase = phase_function(&m.phase);
    Some((Medium { mu_a, mu_s_prime: mu_s * (1.0 - phase.g()), phase, n: m.n }, top - bottom))
}

/// Radiance over irradiance at a spatial frequency on the surface.
fn ratio(scene: &Scene, channel: usize, f_x: f64) -> Result<f64, Error> {
    let camera = match (slab(scene, channel), scene.objects.values().next().map(|o| o.surface.clone())) {
        (None, Some(Surface::Lambertian(rho))) => rho,
        (Some((medium, thickness)), _) => {
            let found = rte::reflectance(&medium, Some(thickness), f_x);
            found.map_err(|e| Error::failed(format!("the transport solver cannot solve this medium: {e}")))?.camera
        }
        _ => return Err(Error::failed("the solver knows one slab alone")),
    };
    Ok(camera * FRAC_1_PI)
}

impl PlaneWave {
    /// The images of all channels.
    ///
    /// Error: the solver does not converge, or a pixel sees nothing.
    pub fn all(scene: &Scene, rig: &Rig, carriers: &[Carrier]) -> Result<Vec<Self>, Error> {
        let nothing = || Error::failed("a pixel sees nothing, so there is no image of a plane");
        let pixels = rig.camera.pixels();
        let guides = Arc::new(Guides::of(rig, carriers).ok_or_else(nothing)?);
        let geometry = Geometry::of(rig).ok_or_else(nothing)?;
        let sharpness: Arc<[f64]> =
            (0..pixels).flat_map(|pixel| carriers.iter().map(move |c| sharpness(rig, pixel, c))).collect();
        let frequencies: Vec<f64> = std::iter::once(0.0).chain(carriers.iter().map(Carrier::f_x)).collect();
        let channel = |channel: usize| {
            let ratios = frequencies.iter().map(|f| ratio(scene, channel, f * geometry.zoom));
            Ok(Self {
                guides: guides.clone(),
                strength: strength(&rig.lights[channel]),
                ratios: ratios.collect::<Result<_, Error>>()?,
                sharpness: sharpness.clone(),
                bounds: frequencies.iter().map(|&f| bound(scene, channel, &geometry, f)).collect(),
            })
        };
        (0..scene.channels()).map(channel).collect()
    }

    /// (re, im) of the carrier's place in the list, the pattern 1 before them.
    fn response(&self, pixel: usize, carrier: usize) -> (f64, f64) {
        let guide = self.guides.at(pixel);
        let modulus = self.strength * guide.gain * self.ratios[carrier];
        match carrier.checked_sub(1) {
            None => (modulus, 0.0),
            Some(c) => {
                let ((sin, cos), sharp) = (guide.phases[c], self.sharpness[pixel * guide.phases.len() + c]);
                (modulus * sharp * cos, modulus * sharp * sin)
            }
        }
    }

    /// How far a sum of weight x response may be off: by the moduli and by the phases, of each carrier.
    fn off(&self, pixel: usize, terms: &[(usize, f64)]) -> Vec<(f64, f64)> {
        let mut off = vec![(0.0, 0.0); self.ratios.len()];
        for &(i, weight) in terms {
            let carrier = i.div_ceil(2);
            let (re, im) = self.response(pixel, carrier);
            let (own, across) = if i == 0 || i % 2 == 1 { (re, -im) } else { (im, re) };
            off[carrier].0 += weight * own * self.bounds[carrier].modulus;
            off[carrier].1 += weight * across * self.bounds[carrier].phase;
        }
        off
    }
}

impl Field for PlaneWave {
    fn pixels(&self) -> usize {
        self.guides.len()
    }

    fn mean(&self, pixel: usize, i: usize) -> f64 {
        let (re, im) = self.response(pixel, i.div_ceil(2));
        if i == 0 || i % 2 == 1 { re } else { im }
    }

    fn covariance(&self, pixel: usize, a: &[(usize, f64)], b: &[(usize, f64)]) -> f64 {
        let pairs = self.off(pixel, a).into_iter().zip(self.off(pixel, b));
        pairs.map(|(a, b)| a.0 * b.0 + a.1 * b.1).sum()
    }

    fn variance_of_mean(&self, terms: &[(usize, f64)], _: f64) -> f64 {
        // All pixels are off alike.
        let pixels = self.pixels();
        let sum: f64 = (0..pixels).map(|p| self.variance(p, terms).sqrt()).sum();
        (sum / pixels as f64).powi(2)
    }
}

/// What the mean over a pixel leaves of a carrier's modulus: its phase is a plane there.
fn sharpness(rig: &Rig, pixel: usize, carrier: &Carrier) -> f64 {
    let (fx, fy) = carrier.along();
    let turns = |x: f64, y: f64| {
        let (origin, w) = rig.camera.ray(pixel, x, y);
        let segment =
            rig.worlds[0].trace(origin, w, None, &mut Chords::default()).find(|segment| segment.material != 0);
        let place = segment.map(|segment| rig.lights[0].arrives(origin + segment.start * w).0.on_plane);
        place.map_or(0.0, |p| fx * p.x + fy * p.y)
    };
    let across = [turns(1.0, 0.5) - turns(0.0, 0.5), turns(0.5, 1.0) - turns(0.5, 0.0)];
    across.into_iter().map(sinc).product()
}

/// W/sr or W mm^-2, as its profile says.
fn strength(light: &Light) -> f64 {
    match light.emission {
        Emission::Intensity(x) | Emission::Irradiance(x) => x,
    }
}

/// sin(pi x) / (pi x).
fn sinc(x: f64) -> f64 {
    if x.abs() < 1e-4 { 1.0 - (PI * x) * (PI * x) / 6.0 } else { sin_cos_turns(0.5 * x).0 / (PI * x) }
}
