//! What is known beforehand to be wrong or uncertain in an image: light that rough interfaces lose, and light that few paths see.

use turbid_contract::payload::{Lamp, Object, Scene, Shape, Surface};
use turbid_contract::{Problems, StagePlan};
use turbid_optics::between_facets::worst_neighbour;

use crate::bsdf::Bsdf;
use crate::camera::Camera;
use crate::params::Params;
use crate::tail::{is_peaked, kurtosis_of_lobe, kurtosis_under, paths_to_hold};
use crate::world::{Chords, World};

/// Where more than this part of the light is lost between facets, standard errors say nothing of an image's error.
pub const MOST_LOST: f64 = 0.01;

/// For each material what its rough interfaces lose of light that goes in and would all come back; 0 where interfaces are not rough.
fn lost_by_material(world: &World) -> Vec<f64> {
    let indices = || world.materials.iter().filter(|m| !m.is_opaque()).map(|m| m.n);
    let lost = |bsdf: Bsdf, n: f64| match bsdf {
        Bsdf::Rough(alpha) => worst_neighbour(alpha, n, indices()).1,
        _ => 0.0,
    };
    world.materials.iter().map(|m| lost(m.bsdf, m.n)).collect()
}

/// Pixels that look at, or through, rough interfaces which lose more than [`MOST_LOST`]: what is missing there no paths tell. Empty where
/// there are none.
pub fn pixels_with_lost_light(world: &World, camera: &Camera) -> Vec<bool> {
    let lossy: Vec<bool> = lost_by_material(world).iter().map(|&lost| lost > MOST_LOST).collect();
    if !lossy.contains(&true) {
        return Vec::new();
    }
    let mut chords = Chords::default();
    let mut meets = |pixel: usize, (x, y): (f64, f64)| {
        let (origin, w) = camera.ray(pixel, x, y);
        let mut segments = world.trace(origin, w, None, &mut chords);
        let seen = segments.find(|segment| lossy[segment.material] || world.materials[segment.material].is_opaque());
        seen.is_some_and(|segment| lossy[segment.material])
    };
    const PLACES: [(f64, f64); 5] = [(0.5, 0.5), (0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)];
    (0..camera.pixels()).map(|pixel| PLACES.into_iter().any(|place| meets(pixel, place))).collect()
}

/// Says in the plan what the scene's interfaces lose, and what its lobes cost.
pub fn say_in(plan: &mut StagePlan, scene: &Scene) {
    for (name, object) in &scene.objects {
        let (Surface::Rough(alpha), Some(medium)) = (&object.surface, &object.medium) else { continue };
        let indices = scene.media.values().map(|medium| medium.n).chain([1.0]);
        let (_, lost) = worst_neighbour(*alpha, scene.media[medium].n, indices);
        if lost > 0.0 {
            let errors = if lost > MOST_LOST { "; standard errors of what sees it are unknown" } else { "" };
            plan.needs.push(format!(
                "the rough walls of {name} (alpha = {alpha} loses {:.2} % of the light that goes in and comes back{errors})",
                100.0 * lost
            ));
        }
    }
    if let Some((_, g)) = narrowest(scene) {
        let times = variance_of_lobe(g, has_weight_windows(scene)) / variance_of_lobe(0.8, false);
        plan.needs
            .push(format!("errors pooled over pixels (g = {g} takes about {times:.0} times the paths of g = 0.8)"));
    }
}

/// Whether pixels may not know their standard error: where few paths find a narrow lobe, and where rough interfaces lose light.
pub fn errors_may_be_unknown(scene: &Scene) -> bool {
    narrowest(scene).is_some() || scene.objects.values().any(|object| matches!(object.surface, Surface::Rough(_)))
}

/// Relative variance of a path under a narrow lobe is this over (1 - g)^2. Measured, as [`kurtosis_of_lobe`]: 1.7, 5.6, 22, 137 and
/// some 2600 at g = 0.8, 0.9, 0.95, 0.98 and 0.995.
const VARIANCE: f64 = 0.055;
/// The same with weight windows is this times -ln(1 - g). Measured: 1.7, 2.6, 6.9, 8.6 and 10 at g = 0.9, 0.95, 0.98, 0.99 and 0.995.
const VARIANCE_IN_WINDOWS: f64 = 2.0;
/// From this |g| on `check` warns.
const NARROW: f64 = 0.95;

/// The scattering medium with the narrowest lobe, where light that few paths find makes the image: its name and g.
fn narrowest(scene: &Scene) -> Option<(&str, f64)> {
    let shines = scene.projector.is_some() || scene.lights.values().any(|l| !matches!(l, Lamp::Ambient { .. }));
    let scatterers = scene.media.iter().filter(|(_, m)| m.mu_s.iter().any(|&mu_s| mu_s > 0.0));
    let narrowest = scatterers.max_by(|a, b| a.1.g.abs().total_cmp(&b.1.g.abs()))?;
    let peaked = shines && is_peaked(kurtosis_of_lobe(narrowest.1.g));
    peaked.then_some((narrowest.0.as_str(), narrowest.1.g))
}

/// Whether paths of the scene have weight windows, where that is seen without its geometry: light that comes in straight, or through slabs only, and nothing hollow.
fn has_weight_windows(scene: &Scene) -> bool {
    let n = |object: &Object| object.medium.as_ref().map_or(1.0, |medium| scene.media[medium].n);
    let clear = || scene.objects.values().filter(|object| object.surface == Surface::Smooth);
    let hollow = |shape: &Shape| matches!(shape, Shape::Tube { .. } | Shape::SphereShell { .. });
    let plain = scene.objects.values().all(|object| !matches!(object.surface, Surface::Mirror | Surface::Rough(_)));
    let straight = clear().all(|object| n(object) == 1.0);
    let slabs = clear().all(|object| matches!(object.shape, Shape::Slab { .. }));
    plain && (straight || slabs) && !clear().any(|object| hollow(&object.shape))
}

/// Relative variance of a path under a lobe.
fn variance_of_lobe(g: f64, windows: bool) -> f64 {
    let width = 1.0 - g.abs();
    if windows && g > 0.0 { -VARIANCE_IN_WINDOWS * width.ln() } else { VARIANCE / (width * width) }
}

/// Warns of what a narrow lobe costs, and of an image with too few paths to know its errors.
pub fn check(params: &Params, scene: &Scene, problems: &mut Problems) {
    let Some((name, g)) = narrowest(scene).filter(|narrowest| narrowest.1.abs() >= NARROW) else { return };
    let windows = has_weight_windows(scene);
    let pixels: f64 = scene.camera.iter().flat_map(|camera| camera.pixels).map(f64::from).product();
    let paths = params.samples.map(|samples| f64::from(samples) * pixels);
    let (variance, needed) = (variance_of_lobe(g, windows), paths_to_hold(kurtosis_under(g, windows)));
    let few = paths.is_some_and(|paths| paths < needed);
    if windows && g > 0.0 && !few {
        return;
    }
    let mut message = format!(
        "g = {g} of {name}: few paths find so narrow a lobe. The variance of a path is about {variance:.0} times its squared mean (2 at g = 0.8), \
         so 1 % of a pixel takes some {:.0e} paths; errors are known in an image of {needed:.0e} paths or more",
        variance / 1e-4
    );
    if let Some(paths) = paths.filter(|_| few) {
        message += &format!("; this one has {paths:.0}, and its standard errors will be unknown");
    }
    problems.warn(if params.samples.is_some() { "samples" } else { "" }, message);
}
