//! The variance of a path over a region, as weights of a fit to it need it.

use crate::blocks::Blocks;
use crate::chart::Place;
use crate::orthonormal::Orthonormal;
use crate::reduced::Reduced;
use crate::regions::Region;

/// Tiles over which variances are pooled first, at most ...
const TILES: usize = 64;
/// ... and the fewest to which a polynomial of order 2 is fitted; with fewer the variance counts as even.
const LEAST_TILES: usize = 24;

/// 1 / expected variance of the response to 1 in each pixel; `None` where nothing is noisy.
///
/// The variance of a path is a smooth function, too: its logarithm a polynomial of order 2, by the means over some sixty tiles. A pixel's own paths hardly have
/// a say: bright ones, which make its variance large, would have less weight than dim ones.
pub fn weights(region: &Region, reduced: &Reduced, paths: &[u32]) -> Option<Vec<f64>> {
    let blocks = Blocks::of(region, &vec![true; region.len()], TILES);
    let of_path = |i: usize| f64::from(paths[i]) * reduced.variance(i, 0);
    let tiles: Vec<(Place, f64)> = blocks
        .tiles
        .iter()
        .filter_map(|tile| {
            let count = tile.len() as f64;
            let variance = tile.iter().map(|&i| of_path(i)).sum::<f64>() / count;
            // In the middle of the tile there may be none of its pixels, so one of them stands for it.
            (variance > 0.0).then(|| (region.place(tile[tile.len() / 2], None), libm::log(variance)))
        })
        .collect();
    let order = if tiles.len() >= LEAST_TILES { 2 } else { 0 };
    let functions = region.chart.own_functions();
    let m = functions.terms(order);
    let (mut b, mut gram) = (Vec::new(), vec![0.0; m * m]);
    for (place, _) in &tiles {
        functions.basis(*place, order, &mut b);
        (0..m * m).for_each(|kl| gram[kl] += b[kl / m] * b[kl % m]);
    }
    let phi = Orthonormal::of(&gram, m);
    let (mut coefficients, mut values) = (vec![0.0; m], Vec::new());
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for (place, log) in &tiles {
        functions.basis(*place, order, &mut b);
        phi.at(&b, &mut values);
        coefficients.iter_mut().zip(&values).for_each(|(c, v)| *c += v * log);
        (low, high) = (low.min(*log), high.max(*log));
    }
    (!tiles.is_empty()).then(|| {
        let of = |i: usize| {
            functions.basis(region.place(i, None), order, &mut b);
            phi.at(&b, &mut values);
            let log: f64 = coefficients.iter().zip(&values).map(|(c, v)| c * v).sum();
            f64::from(paths[i]) * libm::exp(-log.clamp(low, high))
        };
        (0..region.len()).map(of).collect()
    })
}
