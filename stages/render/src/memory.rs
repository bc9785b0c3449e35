//! How much memory a render takes, before anything is taken: bytes by pixels, responses and frames.

use turbid_contract::payload::{Scene, Shape};
use turbid_contract::{Extent, Forms};

use crate::fit::Lattice;
use crate::method::Taken;
use crate::params::{Allocate, Params};
use crate::response::Layout;
use crate::rig::Rig;
use crate::tail::{expected_kurtosis, is_peaked};
use crate::trace::{ROUND, ROUND_PART};

/// What is rendered.
pub struct Asked<'a> {
    pub params: &'a Params,
    pub scene: &'a Scene,
    pub rig: &'a Rig,
    pub taken: &'a Taken,
    /// Of the pattern, where one is connected and its size is known.
    pub pattern: Option<Extent>,
    pub patterned: bool,
    /// The outputs that are made.
    pub made: &'a Forms,
}

/// Bytes for a triangle of a mesh: 350 while its trees are made, then 200 for its corners, its normals and its boxes in both trees, and 90 for cones of
/// normals where it turns light; its part of the scene.
const OF_TRIANGLE: u64 = 400;
/// What each thread holds of its tile, and code and tables besides.
const CODE_AND_TILE: u64 = 8 << 20;

/// Bytes that the run holds at the most; `None` where the scene has no camera, or where the size of a pattern is not known yet.
///
/// The most of three moments:
/// - tracing: for each traced pixel the sums, q + q (q + 1) / 2 + 2 numbers of 8 bytes (q responses; means, products, two moments of the brightness), twice
///   where control variates are walked, twice where paths go to where the error is; the sums of a round beside them, of at most [`ROUND_PART`] batches where
///   every pixel has the same paths; 8 bytes for a pixel's place and paths;
/// - making images: the sums (or, where a surface is fitted, 8 + 16 c bytes of each pixel's place in c carriers), and 4 bytes for each layer;
/// - what a scene says of each pixel: layers alone.
pub fn memory(asked: &Asked<'_>) -> Option<u64> {
    let Asked { params, scene, rig, taken, .. } = asked;
    let camera = scene.camera.as_ref()?;
    let channels = scene.channels() as u64;
    let pixels = u64::from(camera.pixels[0]) * u64::from(camera.pixels[1]);
    let steady = rig.steady[0].shines();
    let layout = match (asked.patterned, asked.pattern) {
        (false, _) => Layout { carriers: params.carriers().len(), projected_images: 0, steady },
        (true, Some(pattern)) => Layout { carriers: 0, projected_images: pattern.layers() as usize, steady },
        (true, None) => return None,
    };
    let bytes = |port: &&str| asked.made.get(port).and_then(|form| form.extent()).map(Extent::bytes);
    let of_layers = |ports: &[&str]| -> u64 { ports.iter().filter_map(bytes).sum() };
    let (carriers, q) = (layout.carriers as u64, layout.width() as u64);
    let of_sums = 8 * (q + q * (q + 1) / 2 + 2);
    let with_control = matches!(taken, Taken::ControlVariates { .. });
    let fields = channels * if with_control { 2 } else { 1 };
    let lattice = Lattice::over(camera.pixels[0] as usize, camera.pixels[1] as usize);
    let lattice = (lattice.columns.len() * lattice.rows.len()) as u64;
    let (traced, guided) = match taken {
        Taken::Rte { .. } => (0, pixels * (8 + 24 * carriers)),
        Taken::Fit => (lattice, channels * pixels * (8 + 16 * carriers)),
        // Of each pixel which control variate it has, what is pooled around it, and what its own paths say.
        Taken::ControlVariates { .. } => (pixels, channels * pixels * (8 + 16 * carriers) + channels * pixels * 96),
        // Of each pixel where it looks at, twice what it and its neighbours see, and reduced responses with covariances twice.
        Taken::Surfaces { .. } => (pixels, pixels * (448 + 32 * carriers) + channels * pixels * 24 * (q + q * q)),
        Taken::Path { .. } => (pixels, 0),
    };
    let adaptive = params.allocate == Allocate::Adaptive
        && !matches!(taken, Taken::Fit | Taken::Surfaces { .. } | Taken::Rte { .. });
    let batches = (ROUND as u64 / fields).max(traced);
    let batches = if adaptive { 2 * batches } else { batches.min(ROUND_PART as u64) };
    let sums = traced * fields * of_sums;
    let round = if traced == 0 { 0 } else { batches * fields * of_sums };
    // The sums of the further paths, all together where the error is tested, and how many paths each pixel needs.
    let further = if adaptive { 2 * sums + 32 * traced } else { 0 };
    let tracing = sums + further + round.max(8 * traced) + 8 * traced;
    // Windows over which variances are pooled.
    let pooled = if is_peaked(expected_kurtosis(rig)) || rig.worlds[0].is_hollow() { 96 * traced } else { 0 };
    let imaging = sums + guided + pooled + 8 * traced + of_layers(&["frames", "covariance", "white"]).max(8 * pixels);
    let telling = of_layers(&["frames", "covariance", "white", "truth"]) + 4 * pixels;
    let triangles: u64 = scene.objects.values().map(|object| triangles(&object.shape)).sum();
    // The pattern as it came, and pixel by pixel.
    let held = triangles * OF_TRIANGLE * channels + asked.pattern.map_or(0, |pattern| 2 * pattern.bytes());
    Some(held + tracing.max(imaging).max(telling) + CODE_AND_TILE)
}

fn triangles(shape: &Shape) -> u64 {
    match shape {
        Shape::Mesh(mesh) => mesh.triangles.len() as u64,
        Shape::Turned { shape, .. } => triangles(shape),
        _ => 0,
    }
}
