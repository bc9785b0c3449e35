//! What is shown while the pattern is still to be made: one of as many pixels.

use turbid_contract::LayerInfo;
use turbid_contract::payload::Scene;

use crate::params::Params;
use crate::projected::Projected;
use crate::projected_images::ProjectedImages;
use crate::response::Layout;

/// Frames of a pattern that nobody has made yet.
const LAYERS: usize = 6;
/// Its pixels along a side are these at most: beyond, they are out of the cache as well.
const ALONG: u32 = 512;

/// What is shown; instead of a pattern that is still to be made one of as many pixels.
pub fn projected(params: &Params, scene: &Scene, patterned: bool, steady: bool) -> Projected {
    if !patterned {
        return Projected::sinusoids(params, steady);
    }
    let [columns, rows] = scene.projector.as_ref().and_then(|p| p.pixels).unwrap_or([ALONG; 2]);
    // A side beyond what lanes hold shows in the kernel: it stays.
    grey(LAYERS, [rows.min(ALONG * ALONG / columns.max(1)).max(1), columns], steady)
}

/// The same for what depends on the pattern's size only.
pub fn outline(params: &Params, scene: &Scene, patterned: bool, steady: bool) -> Projected {
    if !patterned {
        return Projected::sinusoids(params, steady);
    }
    let [columns, rows] = scene.projector.as_ref().and_then(|p| p.pixels).unwrap_or([ALONG; 2]);
    grey(1, [1, columns.max(rows)], steady)
}

/// A pattern of grey layers with so many rows and columns.
fn grey(layers: usize, [rows, columns]: [u32; 2], steady: bool) -> Projected {
    let layout = Layout { carriers: 0, projected_images: layers, steady };
    let projected_images = ProjectedImages::new(layers, rows as usize, columns as usize, |_, _, _| 0.5);
    let frame = |i| (LayerInfo::value("radiance", ""), vec![(layout.projected_image(i), 1.0)]);
    Projected {
        carriers: Vec::new(),
        projected_images,
        layout,
        frames: (0..layers).map(frame).collect(),
        quantities: Vec::new(),
    }
}
