//! How much of the modulation is masked.

use turbid_contract::{Ctx, ImageStack};

/// The masked share of the pixels of all wavelengths.
pub fn measure_masked(stack: &ImageStack, ctx: Ctx<'_>) {
    let masks = stack.layers.iter().filter(|layer| layer.info.is_pixel_mask());
    ctx.measure_masked(masks.flat_map(|mask| mask.data.iter().copied()));
}
