//! How each pixel was lit and looked at, for those who read frames; and frames that show nothing.

use std::ops::Range;

use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{INCIDENCE_LAYER, Scene, THICKNESS_LAYER, VIEW_LAYER};
use turbid_contract::{Ctx, Error, ImageStack, LayerInfo, LayerKind, Problems};
use turbid_geometry::{Sights, lit_points};

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

/// The layers of kind condition: those that are there, and the thickness, which is there where it differs.
pub fn infos(scene: &Scene) -> (Vec<LayerInfo>, LayerInfo) {
    let info = |name: &str, unit: &str| LayerInfo::new(name, LayerKind::Condition, unit);
    let mut layers = vec![info(VIEW_LAYER, "deg")];
    layers.extend(scene.projector.is_some().then(|| info(INCIDENCE_LAYER, "deg")));
    (layers, info(THICKNESS_LAYER, "mm"))
}

/// Adds the layers of kind condition: angles to the normal at the middle of each pixel, and what lies below it where that differs.
///
/// Error: the run was cancelled.
pub fn layers(scene: &Scene, frames: &mut ImageStack, ctx: Ctx<'_>) -> Result<(), Error> {
    let Some(sights) = Sights::of(scene) else { return Ok(()) };
    let (rows, columns) = (frames.rows(), frames.columns());
    // View, thickness below and, where there is a projector, incidence.
    let projected = scene.projector.is_some();
    let mut planes: Vec<Array2<f32>> =
        (0..if projected { 3 } else { 2 }).map(|_| Array2::zeros((rows, columns))).collect();
    let fill = |pixels: Range<usize>, planes: &mut [&mut [f32]]| -> Option<[f64; 3]> {
        let mut thickness: Option<[f64; 3]> = None;
        for (place, pixel) in pixels.enumerate() {
            let (row, column) = (pixel / columns, pixel % columns);
            let (x, y) = ((column as f64 + 0.5) / columns as f64, (row as f64 + 0.5) / rows as f64);
            let Some(angles) = sights.at(x, y).filter(|angles| angles.turbid) else { continue };
            let mm = angles.thickness;
            planes[0][place] = angles.view_deg as f32;
            planes[1][place] = mm as f32;
            if projected {
                planes[2][place] = angles.incidence_deg.unwrap_or(0.0) as f32;
            }
            thickness = Some(thickness.map_or([mm; 3], |[first, least, most]| [first, least.min(mm), most.max(mm)]));
        }
        thickness
    };
    let thickness: Vec<[f64; 3]> = ctx.fill_planes(&mut planes, fill)?.into_iter().flatten().collect();
    let mut planes = planes.into_iter();
    let mut next = || planes.next().expect("there are as many as are named");
    let (view, below) = (next(), next());
    let (infos, thickness_info) = infos(scene);
    // Incidence comes behind the view.
    for (info, data) in infos.into_iter().zip([Some(view), planes.next()].into_iter().flatten()) {
        frames.push(info, data);
    }
    let first = thickness.first().map_or(0.0, |[first, ..]| *first);
    // Rounding of the place where a ray meets the surface.
    if thickness.iter().any(|[_, least, most]| (most - first).max(first - least) > 1e-6 * first) {
        frames.push(thickness_info, below);
    }
    Ok(())
}
