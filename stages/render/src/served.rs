//! How much of an image is served by fits on surfaces, and how much by control variates.

use std::sync::Arc;

use turbid_contract::payload::Scene;

use crate::control_variate::control_variates;
use crate::fringes::Fringes;
use crate::projected::Projected;
use crate::projected_images::ProjectedImages;
use crate::regions::{Region, regions};
use crate::response::Layout;
use crate::rig::Rig;

/// Pixels along a side that regions are looked for in, at most. Regions end some pixels before an edge, so in a larger image they serve a little more than is counted here.
const ALONG: u32 = 128;

/// Parts of the pixels of an image.
pub struct Served {
    /// That lie in regions which may be fitted.
    pub by_fits: f64,
    /// In the largest of these.
    pub largest_region: f64,
}

impl Served {
    /// Of a scene under fringes whose phases do not part regions.
    pub fn of(scene: &Scene) -> Self {
        let scene = outlined(scene);
        let Ok(rig) = Rig::of(&scene) else { return Self { by_fits: 0.0, largest_region: 0.0 } };
        let layout = Layout { carriers: 0, projected_images: 0, steady: false };
        let (projected_images, frames) = (ProjectedImages::NONE, Vec::new());
        let dark = Projected { carriers: Vec::new(), projected_images, layout, frames, quantities: Vec::new() };
        let regions = regions(&scene, &rig, &dark, &Arc::new(Fringes::carriers(0)));
        let pixels = rig.camera.pixels() as f64;
        let lengths = || regions.iter().map(|region: &Region| region.len() as f64 / pixels);
        Self { by_fits: lengths().sum(), largest_region: lengths().fold(0.0, f64::max) }
    }
}

/// The part of the pixels that have a control variate.
pub fn by_controls(scene: &Scene, target_error: Option<f64>) -> f64 {
    let scene = outlined(scene);
    let Ok(rig) = Rig::of(&scene) else { return 0.0 };
    let controls = control_variates(&scene, &rig, target_error).ok().flatten();
    controls.map_or(0.0, |c| c.of_pixel.iter().flatten().count() as f64 / rig.camera.pixels() as f64)
}

/// The scene in at most [`ALONG`] pixels along a side.
fn outlined(scene: &Scene) -> Scene {
    let mut outlined = scene.clone();
    if let Some(camera) = &mut outlined.camera {
        camera.pixels = camera.pixels.map(|count| count.min(ALONG));
    }
    outlined
}
