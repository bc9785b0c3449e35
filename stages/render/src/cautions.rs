//! What is known beforehand to be uncertain in an image: light that few paths see.

use turbid_contract::payload::{Lamp, Scene, Surface};
use turbid_contract::{Problems, StagePlan};

use crate::params::Params;
use crate::tail::{is_peaked, kurtosis_of_facets, kurtosis_of_lobe, paths_to_hold};

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
/// Through facets it is this part of the kurtosis. Measured, as [`kurtosis_of_facets`]: 0.25 to 0.31.
const OF_KURTOSIS: f64 = 0.27;
/// From the kurtosis of this |g| on `check` warns.
const NARROW: f64 = 0.95;

impl Lobe {
    fn of_medium(name: &str, g: f64) -> Self {
        let variance = VARIANCE / (1.0 - g.abs()).powi(2);
        Self { what: format!("g = {g} of {name}"), variance, kurtosis: kurtosis_of_lobe(g) }
    }

    fn of_facets(name: &str, alpha: f64, n: f64) -> Self {
        let kurtosis = kurtosis_of_facets(alpha, n);
        Self { what: format!("rough = {alpha} of {name} at n = {n}"), variance: OF_KURTOSIS * kurtosis, kurtosis }
    }

    /// The narrowest, of media that scatter and of rough walls, where light that few paths find makes the image.
    fn narrowest(scene: &Scene) -> Option<Self> {
        let shines = scene.projector.is_some() || scene.lights.values().any(|l| !matches!(l, Lamp::Ambient { .. }));
        let scatterers = scene.media.iter().filter(|(_, m)| m.mu_s.iter().any(|&mu_s| mu_s > 0.0));
        let media = scatterers.map(|(name, m)| Self::of_medium(name, m.g));
        let walls = scene.objects.iter().filter_map(|(name, object)| match (&object.surface, &object.medium) {
            (Surface::Rough(alpha), Some(medium)) => Some((name, *alpha, scene.media[medium].n)),
            _ => None,
        });
        let facets = walls.filter(|wall| wall.2 != 1.0).map(|(name, alpha, n)| Self::of_facets(name, alpha, n));
        let narrowest = media.chain(facets).max_by(|a, b| a.kurtosis.total_cmp(&b.kurtosis));
        narrowest.filter(|lobe| shines && is_peaked(lobe.kurtosis))
    }
}

/// Says in the plan what the scene's lobes cost.
pub fn say_in(plan: &mut StagePlan, scene: &Scene) {
    if let Some(lobe) = Lobe::narrowest(scene) {
        let times = lobe.variance / Lobe::of_medium("", 0.8).variance;
        let what = lobe.what;
        plan.needs
            .push(format!("errors pooled over pixels ({what} takes about {times:.0} times the paths of g = 0.8)"));
    }
}

/// Whether pixels may not know their standard error: where few paths find a narrow lobe.
pub fn errors_may_be_unknown(scene: &Scene) -> bool {
    Lobe::narrowest(scene).is_some()
}

/// Warns of what a narrow lobe costs, and of an image with too few paths to know its errors.
pub fn check(params: &Params, scene: &Scene, problems: &mut Problems) {
    let wide = kurtosis_of_lobe(NARROW);
    let Some(lobe) = Lobe::narrowest(scene).filter(|lobe| lobe.kurtosis >= wide) else { return };
    let Lobe { what, variance, kurtosis } = lobe;
    let needed = paths_to_hold(kurtosis);
    let mut message = format!(
        "{what}: few paths find so narrow a lobe. The variance of a path is about {variance:.0} times its squared mean (2 at g = 0.8), \
         so 1 % of a pixel takes some {:.0e} paths; errors are known in an image of {needed:.0e} paths or more",
        variance / 1e-4
    );
    if let (Some(samples), Some(camera)) = (params.samples, &scene.camera) {
        let paths = f64::from(samples) * camera.pixels.iter().map(|&n| f64::from(n)).product::<f64>();
        if paths < needed {
            message += &format!("; this one has {paths:.0}, and its standard errors will be unknown");
        }
    }
    problems.warn(if params.samples.is_some() { "samples" } else { "" }, message);
}
