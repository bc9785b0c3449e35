//! What makes the pixels of one camera unlike each other, the same in every frame: the lens, their response, their dark level.

use turbid_optics::philox;

use crate::noise::Draws;
use crate::params::Params;

/// One number per pixel, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct Pixels {
    /// Share of the light that is read, 1 without vignetting and spread.
    pub response: Vec<f64>,
    /// Departure from the black level, share of the range.
    pub dark: Vec<f64>,
}

/// Streams of numbers: those of frames are keyed by the seed, these by the camera.
const CAMERA: u64 = 0x63_616d_6572_6121;

impl Pixels {
    /// Those of the camera that `params` names, in an image of `rows` x `columns`.
    pub fn new(params: &Params, rows: usize, columns: usize) -> Self {
        let key = philox::key(CAMERA ^ u64::from(params.camera));
        let middle = [0.5 * (columns as f64 - 1.0), 0.5 * (rows as f64 - 1.0)];
        let corner = (middle[0] * middle[0] + middle[1] * middle[1]).max(f64::MIN_POSITIVE);
        let mut pixels = Self { response: Vec::new(), dark: Vec::new() };
        for pixel in 0..rows * columns {
            let [x, y] = [(pixel % columns) as f64 - middle[0], (pixel / columns) as f64 - middle[1]];
            let mut draws = Draws::new(key, 0, pixel);
            let lens = 1.0 - params.vignetting * (x * x + y * y) / corner;
            // A pixel reads light or none of it; the spread is at most 0.2, so that 0 is five of it away.
            pixels.response.push((lens * (1.0 + params.response_spread * draws.normal())).max(0.0));
            pixels.dark.push(params.dark_spread * draws.normal());
        }
        pixels
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Corners lose what they are said to lose, the middle nothing; spreads are those asked for (sampled ones are known to
    /// 1 / sqrt(2 n)); another camera is another one.
    #[test]
    fn pixels_differ_as_they_are_said_to() {
        let lens = Params { vignetting: 0.3, ..Params::default() };
        let pixels = Pixels::new(&lens, 11, 21);
        assert!((pixels.response[0] - 0.7).abs() < 1e-15 && (pixels.response[5 * 21 + 10] - 1.0).abs() < 1e-15);
        assert_eq!(Pixels::new(&lens, 1, 1).response, [1.0]);
        let spread = Params { response_spread: 0.02, dark_spread: 0.003, ..Params::default() };
        let (n, pixels) = (90_000.0_f64, Pixels::new(&spread, 300, 300));
        let sd = |of: &[f64], mean: f64| (of.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt();
        for (found, want) in [(sd(&pixels.response, 1.0), 0.02), (sd(&pixels.dark, 0.0), 0.003)] {
            assert!((found / want - 1.0).abs() < 5.0 / (2.0 * n).sqrt(), "{found} for {want}");
        }
        assert_ne!(Pixels::new(&Params { camera: 1, ..spread.clone() }, 300, 300), pixels);
        assert_eq!(Pixels::new(&spread, 300, 300), pixels);
    }
}
