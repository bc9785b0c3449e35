//! What is known beforehand to be uncertain in an image: light that few paths see.

use turbid_contract::payload::{Lamp, Object, Scene, Shape, Surface};
use turbid_contract::{Problems, StagePlan};
use turbid_geometry::phase_function;
use turbid_optics::PhaseFunction;
use turbid_optics::elementary::ln;

use crate::params::Params;
use crate::tail::{is_peaked, kurtosis_of_facets, kurtosis_of_lobe, kurtosis_under, paths_to_hold};
use crate::weight_window::NARROWEST;

/// A lobe in which few paths find light.
struct Lobe {
    /// What has it, for messages.
    what: String,
    /// Relative variance of a path.
    variance: f64,
    kurtosis: f64,
}

/// Relative variance of a path under a narrow lobe of a medium is this over (1 - g)^2. Measured, as [`kurtosis_of_lobe`]: 1.7, 5.6, 22, 137 and
/// some 2600 at g = 0.8, 0.9, 0.95, 0.98 and 0.995.
const VARIANCE: f64 = 0.055;
/// The same with weight windows is this times -ln(1 - g). Measured: 1.7, 2.6, 6.9, 8.6 and 10 at g = 0.9, 0.95, 0.98, 0.99 and 0.995.
const VARIANCE_IN_WINDOWS: f64 = 2.0;
/// Through facets it is this part of the kurtosis. Measured, as [`kurtosis_of_facets`]: 0.25 to 0.31.
const OF_KURTOSIS: f64 = 0.27;
/// From the kurtosis of this |g| on `check` warns.
const NARROW: f64 = 0.95;

impl Lobe {
    fn of_medium(name: &str, phase: &PhaseFunction, windows: bool) -> Self {
        let of = |(_, g): (f64, f64)| {
            let width = 1.0 - g.abs();
            if windows && g > 0.0 { -VARIANCE_IN_WINDOWS * ln(width) } else { VARIANCE / (width * width) }
        };
        let lobes = phase.terms().into_iter().filter(|(share, _)| *share > 0.0);
        let variance = lobes.map(of).fold(0.0, f64::max);
        Self { what: format!("{phase} of {name}"), variance, kurtosis: kurtosis_under(phase, windows) }
    }

    fn of_facets(name: &str, alpha: f64, n: f64) -> Self {
        let kurtosis = kurtosis_of_facets(alpha, n);
        Self { what: format!("rough = {alpha} of {name} at n = {n}"), variance: OF_KURTOSIS * kurtosis, kurtosis }
    }

    /// The narrowest, of media that scatter and of rough walls, where light that few paths find makes the image.
    fn narrowest(scene: &Scene) -> Option<Self> {
        let shines = scene.projector.is_some() || scene.lights.values().any(|l| !matches!(l, Lamp::Ambient { .. }));
        let scatterers = scene.media.iter().filter(|(_, m)| m.mu_s.iter().any(|&mu_s| mu_s > 0.0));
        let windows = has_weight_windows(scene);
        let media = scatterers.map(|(name, m)| Self::of_medium(name, &phase_function(&m.phase), windows));
        let walls = scene.objects.iter().filter_map(|(name, object)| match (&object.surface, &object.medium) {
            (Surface::Rough(alpha), Some(medium)) => Some((name, *alpha, scene.media[medium].n)),
            _ => None,
        });
        let facets = walls.filter(|wall| wall.2 != 1.0).map(|(name, alpha, n)| Self::of_facets(name, alpha, n));
        let narrowest = media
            .chain(facets)
            .max_by(|a, b| (a.kurtosis, a.variance).partial_cmp(&(b.kurtosis, b.variance)).expect("both are finite"));
        narrowest.filter(|lobe| shines && is_peaked(lobe.kurtosis))
    }
}

/// Whether paths of the scene have weight windows, where that is seen without its geometry: light that comes in straight, or through slabs only, and nothing hollow.
fn has_weight_windows(scene: &Scene) -> bool {
    let n = |object: &Object| object.medium.as_ref().map_or(1.0, |medium| scene.media[medium].n);
    let clear = || scene.objects.values().filter(|object| object.surface == Surface::Smooth);
    let hollow = |shape: &Shape| matches!(shape, Shape::Tube { .. } | Shape::SphereShell { .. });
    let plain = scene.objects.values().all(|object| !matches!(object.surface, Surface::Mirror | Surface::Rough(_)));
    let straight = clear().all(|object| n(object) == 1.0);
    let slabs = clear().all(|object| matches!(object.shape, Shape::Slab { .. }));
    let holds = scene.media.values().all(|medium| {
        phase_function(&medium.phase).g_forward() <= NARROWEST || medium.mu_s.iter().all(|&mu_s| mu_s == 0.0)
    });
    plain && holds && (straight || slabs) && !clear().any(|object| hollow(&object.shape))
}

/// Says in the plan what the scene's lobes cost.
pub fn say_in(plan: &mut StagePlan, scene: &Scene) {
    if let Some(lobe) = Lobe::narrowest(scene) {
        let times = lobe.variance / Lobe::of_medium("", &PhaseFunction::henyey_greenstein(0.8), false).variance;
        let what = lobe.what;
        plan.needs
            .push(format!("errors pooled over pixels ({what} takes about {times:.0} times the paths of g = 0.8)"));
    }
}

/// Whether pixels may not know their standard error: where few paths find a narrow lobe.
pub fn errors_may_be_unknown(scene: &Scene) -> bool {
    Lobe::narrowest(scene).is_some()
}

/// Warns of what a narrow lobe costs where paths have no weight windows, and of an image with too few paths to know its errors.
pub fn check(params: &Params, scene: &Scene, problems: &mut Problems) {
    let Some(Lobe { what, variance, kurtosis }) = Lobe::narrowest(scene) else { return };
    let needed = paths_to_hold(kurtosis);
    let pixels: f64 = scene.camera.iter().flat_map(|camera| camera.pixels).map(f64::from).product();
    let few = params.samples.map(|samples| f64::from(samples) * pixels).filter(|&paths| paths < needed);
    if kurtosis < kurtosis_of_lobe(NARROW) && (few.is_none() || !has_weight_windows(scene)) {
        return;
    }
    let mut message = format!(
        "{what}: few paths find so narrow a lobe. The variance of a path is about {variance:.0} times its squared mean (2 at g = 0.8), \
         so 1 % of a pixel takes some {:.0e} paths; errors are known in an image of {needed:.0e} paths or more",
        variance / 1e-4
    );
    if let Some(paths) = few {
        message += &format!("; this one has {paths:.0}, and its standard errors will be unknown");
    }
    problems.warn(if params.samples.is_some() { "samples" } else { "" }, message);
}
