//! How many paths each pixel gets where they go to where the error is.
//!
//! Every pixel has a quarter of the mean number of paths, the even part. The rest is handed out at every doubling so that all
//! pixels come to the same relative error, by what the even paths of the pixels *around* say. A pixel's own paths have no say in
//! how many more there are: stopping where they happen to agree, mostly for want of the rare bright one, would bias it low.

use crate::field::{Field, Watched};
use crate::neighbours::around;

/// Batches that every pixel gets before anything is known of it.
const FIRST: u32 = 8;
/// The even part is one of so many parts of all batches.
const PARTS: u32 = 4;
/// No pixel counts as more needy than the median one by more than this factor: pixels without a fringe would swallow all.
const MOST_NEED: f64 = 16.0;

/// The last doubling at or before `batches` per pixel on average; `None` while all are even.
pub fn doubling(batches: u32) -> Option<u32> {
    let whole = batches / FIRST;
    (whole > 0).then(|| FIRST << whole.ilog2())
}

/// Of `batches` per pixel on average those that every pixel has.
pub fn even(batches: u32) -> u32 {
    let at = |doubling: u32| FIRST.max(doubling / PARTS);
    doubling(batches).map_or(batches, |from| at(from) + share(at(2 * from) - at(from), from, batches))
}

/// Of what is `planned` from one doubling to the next the part that is due at `batches`.
pub fn share(planned: u32, from: u32, batches: u32) -> u32 {
    (u64::from(planned) * u64::from(batches - from) / u64::from(from)) as u32
}

/// Batches beside the even ones that each pixel gets between `from` per pixel on average, a doubling, and twice as many; it has had
/// `before`.
///
/// In all they are as many as there is room for, and each pixel's batches come as near to `needs` x a common factor as its even and
/// earlier ones let them.
pub fn plan(needs: &[f64], before: &[u32], from: u32) -> Vec<u32> {
    let floor: Vec<f64> = before.iter().map(|&b| f64::from(even(2 * from)) + f64::from(b)).collect();
    let budget = 2.0 * f64::from(from) * needs.len() as f64;
    let needs = capped(needs);
    let total = |factor: f64| floor.iter().zip(&needs).map(|(f, need)| f.max(factor * need)).sum::<f64>();
    // Between nothing and more than there is: the needs are at least 1 on average.
    let (mut low, mut high) = (0.0, 2.0 * f64::from(from));
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if total(middle) > budget { high = middle } else { low = middle }
    }
    // Rounded so that the sum is, too: each gets what the running total has grown by.
    let (mut sum, mut given) = (0.0, 0.0);
    let wants = floor.iter().zip(&needs).map(|(f, need)| f.max(low * need) - f);
    wants
        .map(|want| {
            sum += want;
            let whole = sum.round() - given;
            given += whole;
            whole as u32
        })
        .collect()
}

/// With a mean of 1, and the largest not beyond [`MOST_NEED`] times the median; all alike where there are none.
fn capped(needs: &[f64]) -> Vec<f64> {
    let mut some: Vec<f64> = needs.iter().copied().filter(|&n| n > 0.0).collect();
    if some.is_empty() {
        return vec![1.0; needs.len()];
    }
    let middle = some.len() / 2;
    let most = MOST_NEED * *some.select_nth_unstable_by(middle, f64::total_cmp).1;
    let mean = needs.iter().map(|n| n.min(most)).sum::<f64>() / needs.len() as f64;
    needs.iter().map(|n| n.min(most) / mean).collect()
}

/// Variance of a path over the square of M_AC (M_DC where there is no fringe) around each pixel, itself left out, from a field of
/// `paths` in each pixel: what is needed grows with it. The worst of the channels.
pub fn needs(channels: &[Box<dyn Field + '_>], watched: &Watched, columns: usize, paths: &[u32]) -> Vec<f64> {
    let mut worst = vec![0.0_f64; paths.len()];
    for field in channels {
        let signals: Vec<Signal> = (0..paths.len()).map(|p| Signal::of(field.as_ref(), watched, p)).collect();
        for (pixel, worst) in worst.iter_mut().enumerate() {
            let (mut of_paths, mut square, mut noise) = (0.0, 0.0, 0.0);
            for other in around(pixel, columns, paths.len()).filter(|&other| other != pixel) {
                let signal = &signals[other];
                of_paths += signal.variance * f64::from(paths[other]);
                square += signal.square;
                noise += signal.variance;
            }
            // Smaller squares than this drown in the noise.
            let square = square.max(0.5 * noise);
            if square > 0.0 {
                *worst = worst.max(of_paths / square);
            }
        }
    }
    worst
}

/// What is watched in a pixel.
struct Signal {
    /// Of the mean, over the phases.
    variance: f64,
    /// Square of the amplitude, without what noise adds to it.
    square: f64,
}

impl Signal {
    fn of(field: &dyn Field, watched: &Watched, pixel: usize) -> Self {
        let fringe = watched.fringe.as_ref();
        let parts = fringe.map_or(std::slice::from_ref(&watched.dc), |parts| parts.as_slice());
        let mean = |terms: &[(usize, f64)]| terms.iter().map(|&(i, w)| w * field.mean(pixel, i)).sum::<f64>();
        let noise: f64 = parts.iter().map(|terms| field.variance(pixel, terms)).sum();
        let square: f64 = parts.iter().map(|terms| mean(terms) * mean(terms)).sum();
        Self { variance: noise / parts.len() as f64, square: square - noise }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Shares grow step by step to the whole, the even part to a quarter.
    #[test]
    fn shares_grow_to_the_whole() {
        assert_eq!([0, 7, 8, 15, 16, 100].map(doubling), [None, None, Some(8), Some(8), Some(16), Some(64)]);
        assert_eq!([3, 8, 15, 16, 32, 64, 128, 1024].map(even), [3, 8, 8, 8, 8, 16, 32, 256]);
        for batches in 1..2000 {
            assert!(even(batches) >= even(batches - 1) && even(batches) <= batches);
        }
        let shares: Vec<u32> = (64..=128).map(|batches| share(37, 64, batches)).collect();
        assert!(shares[0] == 0 && shares.is_sorted() && shares[64] == 37);
    }

    /// All there is room for is handed out, doubling after doubling; where the needs stay the same the batches are in their
    /// proportion, but for the even part, the cap and rounding.
    #[test]
    fn batches_follow_the_needs() {
        let needs = [1.0, 1.0, 2.0, 3.0, 7.0, 0.0, 1.0, 400.0];
        let mut before = vec![0; needs.len()];
        for from in [8, 16, 32, 64, 128] {
            let planned = plan(&needs, &before, from);
            before.iter_mut().zip(planned).for_each(|(b, p)| *b += p);
            let all = before.iter().map(|b| b + even(2 * from)).sum::<u32>();
            assert_eq!(all, 2 * from * needs.len() as u32);
        }
        let all: Vec<f64> = before.iter().map(|b| f64::from(b + even(256))).collect();
        // The median of those above 0 is 2: 400 counts as 32, of 47 in all; the even part takes what falls short of it.
        assert_eq!(all[0], 64.0);
        assert!((all[7] / all[4] - 32.0 / 7.0).abs() < 0.05, "{all:?}");
        assert_eq!(plan(&[0.0; 4], &[0; 4], 8), [8; 4]);
    }
}
