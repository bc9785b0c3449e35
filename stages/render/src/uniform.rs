//! Whether a scene looks the same wherever it is looked at, but for the angles and distances of camera and projector.

use glam::DVec3;
use turbid_contract::payload::{Medium, Object, Projection, Scene, Shape, Surface};
use turbid_geometry::phase_function;
use turbid_optics::diffusion::a_robin;

use crate::rig::Rig;
use crate::world::Chords;

/// The least pixels along a side that a surface is fitted to.
const LEAST_PIXELS: u32 = 4;
/// The most light, relative to the whole, that may be missing from beyond the lit field (and a tenth of the wanted error).
const MOST_MISSING: f64 = 1e-3;
/// The least cosine between the vertical and any line of sight or light, and between two of those of one pinhole: beyond, low
/// polynomials do not follow the angles.
const LEAST_COSINE: f64 = 0.5;
const LEAST_AGREEMENT: f64 = 0.7;

/// A slab, as far as this page cares.
struct Layer<'a> {
    top: f64,
    bottom: f64,
    medium: Option<&'a Medium>,
    opaque: bool,
}

impl Layer<'_> {
    fn scatters(&self) -> bool {
        self.opaque || self.medium.is_some_and(|m| m.mu_s.iter().any(|&s| s > 0.0))
    }
}

/// Why a smooth surface over the pixels would not be the image; `None` where it is.
///
/// That holds where all objects are slabs without bounds sideways and light finds no clear gap between them to run away in, camera and
/// projector are far enough for their angles to vary little, and the lit field reaches so far beyond what is seen that
/// its edge does not show.
pub fn obstacle(scene: &Scene, target_error: Option<f64>) -> Option<String> {
    let (Some(camera), Some(projector)) = (&scene.camera, &scene.projector) else {
        return Some("camera or projector is missing".to_owned());
    };
    if camera.pixels.iter().any(|&n| n < LEAST_PIXELS) {
        return Some(format!("fewer than {LEAST_PIXELS} pixels along a side"));
    }
    if !scene.lights.is_empty() {
        return Some("lights other than the projector shine".to_owned());
    }
    let plain = camera.projection != Projection::Fisheye && camera.distortion.is_none();
    if !plain || projector.distortion.is_some() {
        return Some("a lens distorts".to_owned());
    }
    let mut layers = Vec::new();
    for (name, object) in &scene.objects {
        let Some(layer) = layer(scene, object) else {
            return Some(format!("{name} is bounded sideways"));
        };
        let refracts = layer.medium.is_some_and(|m| m.n != 1.0);
        match &object.surface {
            Surface::Rough(_) if refracts => return Some(format!("the rough surface of {name} has a highlight")),
            Surface::Mirror => return Some(format!("{name} is a mirror")),
            Surface::Textured(_) => return Some(format!("a texture is wrapped around {name}")),
            Surface::Smooth | Surface::Rough(_) | Surface::Lambertian(_) => {}
        }
        layers.push(layer);
    }
    let Some((high, low)) = extent(&layers) else {
        return Some("nothing scatters".to_owned());
    };
    if let Some(reason) = gap(&layers, high, low) {
        return Some(reason);
    }
    let rig = match Rig::of(scene) {
        Ok(rig) => rig,
        Err(error) => return Some(error.to_string()),
    };
    let margin = match margin(&rig) {
        Ok(margin) => margin,
        Err(reason) => return Some(reason),
    };
    let missing = (0..scene.channels()).map(|c| missing(&layers, c, margin, high - low)).fold(0.0, f64::max);
    let most = target_error.map_or(MOST_MISSING, |t| MOST_MISSING.min(0.1 * t));
    (missing > most).then(|| {
        format!(
            "the lit field reaches {margin:.3} mm beyond what is seen, and up to {:.2} % of the light may come from farther",
            100.0 * missing
        )
    })
}

/// A bound on the part of the light that comes from beyond the lit field, of a scene without [`obstacle`].
pub fn missing_light(scene: &Scene, channel: usize) -> f64 {
    let layers: Vec<Layer<'_>> = scene.objects.values().filter_map(|object| layer(scene, object)).collect();
    let margin = Rig::of(scene).ok().and_then(|rig| margin(&rig).ok());
    match (extent(&layers), margin) {
        (Some((high, low)), Some(margin)) => missing(&layers, channel, margin, high - low),
        _ => 0.0,
    }
}

/// A slab without bounds sideways; `None` for what is bounded.
fn layer<'a>(scene: &'a Scene, object: &Object) -> Option<Layer<'a>> {
    let Shape::Slab { top, bottom } = object.shape else { return None };
    let medium = object.medium.as_ref().and_then(|m| scene.media.get(m));
    Some(Layer { top, bottom, medium, opaque: matches!(object.surface, Surface::Lambertian(_)) })
}

/// Top and bottom of all that scatters.
fn extent(layers: &[Layer<'_>]) -> Option<(f64, f64)> {
    let scattering = || layers.iter().filter(|l| l.scatters());
    let high = scattering().map(|l| l.top).fold(f64::NEG_INFINITY, f64::max);
    let low = scattering().map(|l| l.bottom).fold(f64::INFINITY, f64::min);
    (high > low).then_some((high, low))
}

/// Between scatterers there must be nothing that light crosses freely: it could go far sideways there. A clear layer outside them sends
/// nothing back, unless its surface reflects.
fn gap(layers: &[Layer<'_>], high: f64, low: f64) -> Option<String> {
    let reflects = layers.iter().any(|l| l.medium.is_some_and(|m| m.n != 1.0));
    let clear = layers.iter().filter(|l| !l.scatters());
    if clear.into_iter().any(|l| reflects || (l.top > low && l.bottom < high)) {
        return Some("light can run sideways in a clear layer".to_owned());
    }
    let mut scattering: Vec<&Layer<'_>> = layers.iter().filter(|l| l.scatters()).collect();
    scattering.sort_by(|a, b| b.top.total_cmp(&a.top));
    let mut reached = high;
    for layer in scattering {
        if layer.top < reached {
            return Some("light can run sideways in the gap between two slabs".to_owned());
        }
        reached = reached.min(layer.bottom);
    }
    None
}

/// How far, in mm on what is seen, the lit field reaches beyond it.
fn margin(rig: &Rig) -> Result<f64, String> {
    let world = &rig.worlds[0];
    let (camera, light) = (rig.camera.view, rig.lights[0].view);
    let mut chords = Chords::default();
    let mut lines: [Vec<DVec3>; 2] = Default::default();
    let mut margin = f64::INFINITY;
    for (x, y) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
        let (origin, w) = camera.ray(x, y);
        let scatters = |m: usize| world.materials[m].mu_s > 0.0 || world.materials[m].bsdf.is_opaque();
        let mut segments = world.trace(origin, w, None, &mut chords);
        let Some(segment) = segments.find(|p| scatters(p.material)) else {
            return Err("not every pixel looks at something".to_owned());
        };
        let seen = origin + segment.start * w;
        let Some(on_plane) = light.project(seen) else {
            return Err("the projector does not face what is seen".to_owned());
        };
        let d = on_plane - light.look_at;
        let beyond = (0.5 * light.field.x - d.dot(light.right).abs()).min(0.5 * light.field.y - d.dot(light.top).abs());
        margin = margin.min(beyond * (seen.z - light.position.z).abs() / light.height());
        lines[0].push(w);
        lines[1].push((seen - light.position).normalize());
    }
    for (lines, whose) in lines.iter().zip(["sight", "light"]) {
        let oblique = lines.iter().any(|w| w.z.abs() < LEAST_COSINE);
        let spread = lines.iter().any(|v| lines.iter().any(|w| v.dot(*w) < LEAST_AGREEMENT));
        if oblique || spread {
            return Err(format!("lines of {whose} are more than 60 degrees oblique or spread over more than 45"));
        }
    }
    if margin <= 0.0 { Err("the lit field ends within what is seen".to_owned()) } else { Ok(margin) }
}

/// A bound on the part of the light seen at a point that entered farther than `margin` from it.
///
/// Light diffuses sideways like exp(-kappa r) with kappa^2 >= min mu_a / D + (min D / max D) (pi / T)^2 (Rayleigh's quotient of
/// the slowest mode), T the thickness `thickness` between the extrapolated boundaries, twice that above an opaque floor. The
/// point spread function of a half-space leaves at most exp(-kappa r) / (mu_s' r), taken four times; not more than ballistic
/// light either.
fn missing(layers: &[Layer<'_>], channel: usize, margin: f64, thickness: f64) -> f64 {
    let media = layers.iter().filter_map(|l| l.medium).filter(|m| m.mu_s[channel] > 0.0);
    let (mut rate, mut attenuation) = (f64::INFINITY, f64::INFINITY);
    let (mut least_d, mut most_d) = (f64::INFINITY, 0.0_f64);
    let (mut least_reduced, mut boundary) = (f64::INFINITY, 1.0_f64);
    for m in media {
        let (mu_a, reduced) = (m.mu_a[channel], m.mu_s[channel] * (1.0 - phase_function(&m.phase).g()));
        let d = 1.0 / (3.0 * (mu_a + reduced));
        (rate, attenuation) = (rate.min(mu_a / d), attenuation.min(mu_a + reduced));
        (least_d, most_d) = (least_d.min(d), most_d.max(d));
        (least_reduced, boundary) = (least_reduced.min(reduced), boundary.max(a_robin(m.n)));
    }
    if most_d == 0.0 {
        // Opaque alone.
        return 0.0;
    }
    let depth = thickness + 4.0 * boundary * most_d;
    let depth = if layers.iter().any(|l| l.opaque) { 2.0 * depth } else { depth };
    let leaves = std::f64::consts::PI / depth;
    let kappa = (rate + least_d / most_d * leaves * leaves).sqrt().min(attenuation);
    libm::exp(-kappa * margin) * (4.0 / (least_reduced * margin)).min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layer(medium: &Medium, thickness: f64) -> Layer<'_> {
        Layer { top: 0.0, bottom: -thickness, medium: Some(medium), opaque: false }
    }

    /// Against the diffusion dipole of a half-space: the part of R that leaves beyond rho is
    /// (z0 exp(-k r1) / r1 + (z0 + 2 zb) exp(-k r2) / r2) / 2 over its value for rho = 0. The bound holds, by less than a factor 20.
    #[test]
    fn the_bound_holds_for_the_dipole() {
        for (mu_a, mu_s, margin) in [(0.001, 20.0, 32.0), (0.025, 4.236, 20.0), (0.1, 5.0, 15.0), (0.05, 5.0, 8.0)] {
            let m = Medium {
                mu_a: vec![mu_a],
                mu_s: vec![mu_s],
                phase: turbid_contract::payload::PhaseFunction::HenyeyGreenstein(0.8),
                n: 1.0,
            };
            let (reduced, k) = (0.2 * mu_s, (3.0 * mu_a * (mu_a + 0.2 * mu_s)).sqrt());
            let (z0, zb) = (1.0 / (mu_a + reduced), 2.0 / 3.0 / (mu_a + reduced));
            let beyond = |rho: f64| {
                let pole = |z: f64| z * (-k * z.hypot(rho)).exp() / z.hypot(rho);
                0.5 * (pole(z0) + pole(z0 + 2.0 * zb))
            };
            let exact = beyond(margin) / beyond(0.0);
            let bound = missing(&[layer(&m, 2000.0)], 0, margin, 2000.0);
            assert!(bound > exact && bound < 20.0 * exact, "({mu_a}, {mu_s}): bound {bound:e}, dipole {exact:e}");
        }
    }
}
