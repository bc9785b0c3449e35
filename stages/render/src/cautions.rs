//! What is known beforehand to be uncertain in an image: light that few paths see.

use turbid_contract::payload::{Lamp, Scene};
use turbid_contract::{Problems, StagePlan};

use crate::params::Params;
use crate::tail::{is_peaked, kurtosis_of_lobe, paths_to_hold};

/// Says in the plan what the scene's lobes cost.
pub fn say_in(plan: &mut StagePlan, scene: &Scene) {
    if let Some((_, g)) = narrowest(scene) {
        let times = (0.2 / (1.0 - g.abs())).powi(2);
        plan.needs
            .push(format!("errors pooled over pixels (g = {g} takes about {times:.0} times the paths of g = 0.8)"));
    }
}

/// Whether pixels may not know their standard error: where few paths find a narrow lobe.
pub fn errors_may_be_unknown(scene: &Scene) -> bool {
    narrowest(scene).is_some()
}

/// Relative variance of a path under a narrow lobe is this over (1 - g)^2. Measured, as [`kurtosis_of_lobe`]: 1.7, 5.6, 22, 137 and
/// some 2600 at g = 0.8, 0.9, 0.95, 0.98 and 0.995.
const VARIANCE: f64 = 0.055;
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

/// Warns of what a narrow lobe costs, and of an image with too few paths to know its errors.
pub fn check(params: &Params, scene: &Scene, problems: &mut Problems) {
    let Some((name, g)) = narrowest(scene).filter(|narrowest| narrowest.1.abs() >= NARROW) else { return };
    let variance = VARIANCE / (1.0 - g.abs()).powi(2);
    let needed = paths_to_hold(kurtosis_of_lobe(g));
    let mut message = format!(
        "g = {g} of {name}: few paths find so narrow a lobe. The variance of a path is about {variance:.0} times its squared mean (2 at g = 0.8), \
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
