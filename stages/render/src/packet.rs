//! Paths of many pixels: in lanes of f32 where these hold the scene, else one after the other.

use std::ops::Range;

use crate::batches::{Batches, alike};
use crate::single::{self, Frame};
use crate::walker::Walker;

/// Walks the paths `samples` of the pixels `pixels` and leaves their responses in the walker, pixel by pixel.
pub fn walk(walker: &mut Walker<'_>, pixels: Range<usize>, samples: Range<u32>) {
    walk_among(walker, Batches { of: &alike(pixels, &samples), count: samples.len() as u32 });
}

/// The same for batches of any pixels of the walker's part of the image; responses are in their order.
pub fn walk_among(walker: &mut Walker<'_>, batches: Batches<'_>) {
    match Frame::of(walker) {
        Some(frame) => single::walk(walker, &frame, batches),
        None => walk_singly(walker, batches),
    }
}

/// The same one path after the other.
pub fn walk_singly(walker: &mut Walker<'_>, batches: Batches<'_>) {
    walker.clear_responses(batches.paths());
    for path in 0..batches.paths() {
        let (pixel, sample) = batches.path(path);
        let place = walker.begin(pixel as usize, sample, path);
        walker.finish(place);
    }
    walker.gather();
}
