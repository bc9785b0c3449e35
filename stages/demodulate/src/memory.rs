//! How much memory a demodulation takes, by the layers of its inputs.

use turbid_contract::{Extent, Extents};

/// Bytes that the run holds at the most, and how large its outputs are going to be. `f_x`: how many spatial frequencies the frames have, where that is
/// known; two are taken otherwise. `wanted` names the output ports.
///
/// Frames come with their standard errors and two layers of conditions; a wavelength has one frame at f_x = 0 and three for each other f_x. Each fringe
/// becomes M_DC and M_AC with standard errors, and there is a layer for each pair of quantities, and the mask. Beside inputs and outputs there are
/// flags of unknown errors (2 bytes for each fringe of a pixel) and a plane of the mask.
pub fn memory(frames: Extent, covariance: Option<Extent>, f_x: Option<u64>, wanted: &[String]) -> (u64, Extents) {
    const CONDITIONS: u64 = 2;
    let pixels = frames.pixels();
    let fringes = f_x.unwrap_or(2).max(1);
    let shown = frames.layers().saturating_sub(CONDITIONS).max(2) / 2;
    let channels = (shown / (3 * fringes - 2)).max(1);
    let quantities = 2 * fringes - 1;
    let of_channel = 4 * fringes + quantities * (quantities - 1) / 2 + 1;
    let images = |layers: u64| Extent::Images { pixels, layers };
    let mut makes = Extents::from([("modulation", images(channels * of_channel + CONDITIONS))]);
    if wanted.iter().any(|port| port == "phase") {
        makes.insert("phase", images(channels * (2 * fringes + 1)));
    }
    let made: u64 = makes.values().map(|extent| extent.bytes()).sum();
    let beside = pixels * (4 + 2 * fringes);
    (frames.bytes() + covariance.map_or(0, Extent::bytes) + made + beside, makes)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Four frames of one wavelength: 10 layers become 14; of three wavelengths 3 times as many, but for the conditions.
    #[test]
    fn layers_are_those_of_the_outputs() {
        let pixels = 1000;
        let of = |layers| memory(Extent::Images { pixels, layers }, None, Some(2), &[]);
        let (bytes, makes) = of(10);
        assert_eq!(makes["modulation"].layers(), 14);
        assert_eq!(bytes, 1000 * (4 * (10 + 14) + 8));
        assert_eq!(of(26).1["modulation"].layers(), 38);
    }
}
