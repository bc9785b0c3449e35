//! How each pixel was lit and looked at, for those who read frames; and frames that show nothing.

use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{INCIDENCE_LAYER, Scene, THICKNESS_LAYER, VIEW_LAYER};
use turbid_contract::{Ctx, Error, ImageStack, LayerInfo, LayerKind, Problems};
use turbid_geometry::{Angles, Sights, lit_points};

/// Warns of a projector whose light does not fall where the camera looks.
pub fn warn_of_darkness(scene: &Scene, problems: &mut Problems) {
    if let Some((seen @ 1.., 0)) = lit_points(scene) {
        let message = format!(
            "the projector's light falls on none of {seen} places that the camera looks at (behind the surface, or outside the projector's field): \
             frames hold only what comes through the media, and may be 0"
        );
        problems.warn("", message);
    }
}

/// Warns of frames that are 0 in all pixels.
pub fn tell_dark_frames(frames: &ImageStack, ctx: Ctx<'_>) {
    let values = || frames.layers.iter().filter(|l| l.info.kind == LayerKind::Value);
    let dark = values().filter(|l| l.data.iter().all(|&v| v == 0.0)).count();
    if dark > 0 {
        let all = values().count();
        ctx.warn(format!("{dark} of {all} frames are 0 in every pixel: no light that is seen comes back; is the projector on the camera's side?"));
    }
}

/// Adds the layers of kind condition: angles to the normal at the middle of each pixel, and what lies below it where that differs.
///
/// Error: the run was cancelled.
pub fn layers(scene: &Scene, frames: &mut ImageStack, ctx: Ctx<'_>) -> Result<(), Error> {
    let Some(sights) = Sights::of(scene) else { return Ok(()) };
    let (rows, columns) = (frames.rows(), frames.columns());
    let row = |row: usize| -> Vec<Option<Angles>> {
        let y = (row as f64 + 0.5) / rows as f64;
        (0..columns).map(|c| sights.at((c as f64 + 0.5) / columns as f64, y).filter(|a| a.turbid)).collect()
    };
    let seen: Vec<Option<Angles>> = ctx.map_tiles(rows, row)?.into_iter().flatten().collect();
    let mut push = |name: &str, unit: &str, of: &dyn Fn(&Angles) -> Option<f64>| {
        let values: Vec<f32> = seen.iter().map(|s| s.as_ref().and_then(of).unwrap_or(0.0) as f32).collect();
        let data = Array2::from_shape_vec((rows, columns), values).expect("one value per pixel");
        frames.push(LayerInfo::new(name, LayerKind::Condition, unit), data);
    };
    push(VIEW_LAYER, "deg", &|a| Some(a.view_deg));
    if scene.projector.is_some() {
        push(INCIDENCE_LAYER, "deg", &|a| a.incidence_deg);
    }
    let mut below = seen.iter().flatten().map(|a| a.thickness);
    let first = below.next().unwrap_or(0.0);
    // Rounding of the place where a ray meets the surface.
    if below.any(|d| (d - first).abs() > 1e-6 * first) {
        push(THICKNESS_LAYER, "mm", &|a| Some(a.thickness));
    }
    Ok(())
}
