//! Whether scene and pattern fit, found before a run by the rules that the run goes by.

use turbid_contract::payload::Scene;
use turbid_contract::{Error, Form, Known, LayerInfo, Problems};

use crate::params::Params;
use crate::projected::fits;
use crate::rig::Rig;

/// Reports what does not fit, as far as the inputs are known.
pub fn check(params: &Params, scene: &Scene, known: &Known, problems: &mut Problems) {
    if known.is_connected("pattern") {
        check_pattern(params, scene, known, problems);
    }
    if known.is_wanted("power")
        && let Ok(rig) = Rig::of(scene)
        && let Err(error) = has_power(&rig)
    {
        problems.unfit(known, "scene", error);
    }
}

fn check_pattern(params: &Params, scene: &Scene, known: &Known, problems: &mut Problems) {
    let Some(projector) = &scene.projector else { return problems.unfit(known, "pattern", no_projector()) };
    let Some(layers) = known.form("pattern").and_then(Form::values) else { return };
    let pixels = known.form("pattern").and_then(|pattern| pattern.pixels);
    if let Err(error) = fits(&layers, pixels, params, projector) {
        return problems.unfit(known, "pattern", error);
    }
    // Where params name f_x of their own, these are told.
    if params.f_x.is_empty()
        && let Err(error) = resolved(params, &layers, scene)
    {
        problems.unfit(known, "pattern", error);
    }
}

/// Error: fringes of a pattern that the pixels of camera or projector do not resolve.
fn resolved(params: &Params, layers: &[&LayerInfo], scene: &Scene) -> Result<(), Error> {
    let mut found = Problems::default();
    params.showing(layers.iter().copied()).check_pitches(scene, &mut found);
    match found.into_parts().0.into_iter().next() {
        Some(problem) => Err(Error::Failed { what: problem.message, way_out: problem.hint }),
        None => Ok(()),
    }
}

/// A pattern that nobody shows.
pub fn no_projector() -> Error {
    Error::failed_with_hint(
        "there is a pattern, but the scene has no projector to show it",
        "add `projector` to the scene, or leave the input `pattern` out",
    )
}

/// Error: a channel without a light that has a power.
pub fn has_power(rig: &Rig) -> Result<(), Error> {
    if rig.steady.iter().zip(&rig.lights).any(|(steady, light)| steady.lamps.is_empty() && !light.shines()) {
        return Err(Error::failed_with_hint(
            "the port `power` shares out the power of the lights, but ambient light has none",
            "add a projector or a light with a power",
        ));
    }
    Ok(())
}
