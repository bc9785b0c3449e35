//! How much memory an inversion takes, by the layers of its inputs.

use turbid_contract::{Extent, Extents};

/// A pixel's way of light, angles and factor where maps are corrected for the shape, bytes.
const OF_SHAPE: u64 = 96;

/// Bytes that the run holds at the most, and how large its outputs are going to be. `others`: bytes of all inputs but the reflectance; `corrects`:
/// whether heights are connected.
///
/// Of the reflectance no more than the layers of one wavelength are held at a time, beside those of conditions. Of each wavelength R_d at two f_x comes with standard errors, covariance and mask, and becomes mu_a and mu_s' with standard errors, mask and the side of
/// the table where it ended. Beside inputs and outputs there are flags of unknown errors and of conditions (16 bytes for each pixel), and where the shape is
/// corrected for the corrected reflectance.
pub fn memory(reflectance: Extent, others: u64, corrects: bool, wanted: &[String]) -> (u64, Extents) {
    const CONDITIONS: u64 = 2;
    let pixels = reflectance.pixels();
    let channels = (reflectance.layers().saturating_sub(CONDITIONS) / 6).max(1);
    let images = |layers: u64| Extent::Images { pixels, layers };
    let mut makes = Extents::from([("maps", images(6 * channels))]);
    let wants = |port: &str| wanted.iter().any(|wanted| wanted == port);
    if wants("covariance") {
        makes.insert("covariance", images(4 * channels));
    }
    if wants("exposure") {
        makes.insert("exposure", images(6));
    }
    let made: u64 = makes.values().map(|extent| extent.bytes()).sum();
    let held = images(reflectance.layers().min(6 + CONDITIONS)).bytes();
    let of_shape = if corrects { OF_SHAPE * pixels + held } else { 0 };
    (held + others + made + 16 * pixels + of_shape, makes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layers_are_those_of_the_maps() {
        let reflectance = Extent::Images { pixels: 1000, layers: 8 };
        let (bytes, makes) = memory(reflectance, 500, false, &[]);
        assert_eq!((makes["maps"].layers(), bytes), (6, 1000 * (4 * (8 + 6) + 16) + 500));
        let corrected = memory(reflectance, 500, true, &["exposure".to_owned()]);
        assert_eq!(corrected.0 - bytes, 1000 * (96 + 32 + 24));
    }
}
