//! How much memory a calibration takes, by the layers of its arms.

use turbid_contract::{Extent, Extents};

/// Bytes that the run holds at the most, and how large its output is going to be. `f_x`: how many spatial frequencies the sample has, where that is known;
/// two are taken otherwise.
///
/// Beside the output there are the layers of one wavelength of each arm, and f64 planes, those of one wavelength: for each of the arms that are `smoothed` its weights, for
/// each f_x the smoothed value and its variance, for each pair of f_x its covariance; and one for what a mean owes to each pixel.
pub fn memory(sample: Extent, reference: Extent, f_x: Option<u64>, smoothed: u64) -> (u64, Extents) {
    const CONDITIONS: u64 = 2;
    let pixels = sample.pixels();
    let count = f_x.unwrap_or(2).max(1);
    let quantities = 2 * count - 1;
    let of_modulation = 4 * count + quantities * (quantities - 1) / 2 + 1;
    let channels = (sample.layers().saturating_sub(CONDITIONS) / of_modulation).max(1);
    let pairs = count * (count - 1) / 2;
    let made = Extent::Images { pixels, layers: channels * (2 * count + pairs + 1) + CONDITIONS };
    let planes = smoothed * (1 + 2 * count + pairs) + smoothed.min(1);
    let held = 2 * of_modulation + CONDITIONS;
    let arms = 4 * pixels * held.min(sample.layers() + reference.layers());
    (arms + made.bytes() + 8 * planes * pixels, Extents::from([("reflectance", made)]))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two arms of 14 layers, two f_x: 12 layers each and the conditions, 6 layers and the conditions made, 13 planes where both are smoothed.
    #[test]
    fn planes_are_counted() {
        let arm = Extent::Images { pixels: 1000, layers: 14 };
        let (bytes, makes) = memory(arm, arm, Some(2), 2);
        assert_eq!(makes["reflectance"].layers(), 8);
        assert_eq!(bytes, 1000 * (4 * (26 + 8) + 8 * 13));
        let [none, one] = [0, 1].map(|smoothed| memory(arm, arm, Some(2), smoothed).0);
        assert_eq!([none, one], [1000 * 4 * (26 + 8), 1000 * (4 * (26 + 8) + 8 * 7)]);
    }
}
