//! Which pixels do not know their standard error: a reflectance that does not leaves its properties without one.

use turbid_contract::ndarray::Array2;
use turbid_contract::{ImageStack, Layer};

/// Where any of the layers has a standard error that is not known; `None` where all of them know theirs everywhere.
pub fn of_layers(stack: &ImageStack, layers: &[&Layer]) -> Option<Vec<bool>> {
    let mut found = None;
    for flags in layers.iter().filter_map(|layer| stack.se_unknown(&layer.info)) {
        let flagged = flags.pixels().iter().enumerate().filter(|(_, f)| **f != 0.0).map(|(i, _)| i).collect::<Vec<_>>();
        flag(&mut found, flagged.into_iter(), stack.rows() * stack.columns());
    }
    found
}

/// Flags more pixels of an image of `count`.
pub fn flag(flags: &mut Option<Vec<bool>>, pixels: impl Iterator<Item = usize>, count: usize) {
    for pixel in pixels {
        flags.get_or_insert_with(|| vec![false; count])[pixel] = true;
    }
}

/// 1 at flagged pixels that `mask` calls good; `None` where there are none.
pub fn plane(flags: Option<Vec<bool>>, mask: &Array2<f32>) -> Option<Array2<f32>> {
    let flags = flags?;
    let mut data = Array2::zeros(mask.dim());
    let good = data.iter_mut().zip(mask.iter().zip(&flags)).filter(|(_, (mask, flag))| **mask == 0.0 && **flag);
    let count = good.map(|(flag, _)| *flag = 1.0).count();
    (count > 0).then_some(data)
}
