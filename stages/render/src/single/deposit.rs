//! What next-event estimation sees, in the responses of their paths, as [`Layout`](crate::response::Layout) says.

use fearless_simd::prelude::*;

use super::facets::bits;
use super::frame::Frame;
use super::lane::{F, M, choose, sin_cos_turns, splat};
use super::limits::MOST_CHANNELS;

/// Of lights: radiance in each channel, in units of theirs; lanes in which there is any; and where on the pattern's plane its light passes.
pub struct Seen<S: Simd> {
    pub radiance: [F<S>; MOST_CHANNELS],
    pub lit: M<S>,
    pub x: F<S>,
    pub y: F<S>,
}

/// Responses of the paths of lanes.
pub struct Deposit<'a> {
    pub frame: &'a Frame<'a>,
    pub channels: usize,
    /// Those that estimate: the first ones.
    pub paths: &'a [u32],
    pub responses: &'a mut [f64],
}

impl Deposit<'_> {
    /// Radiance in units of `irradiance` for one number of each path.
    #[inline(always)]
    fn add<S: Simd>(&mut self, place: usize, radiance: F<S>, irradiance: f64) {
        for (&path, &x) in self.paths.iter().zip(radiance.as_slice()) {
            self.responses[path as usize * self.frame.stride + place] += f64::from(x) * irradiance;
        }
    }

    /// Light that the pattern modulates.
    #[inline(always)]
    pub fn add_projected<S: Simd>(&mut self, simd: S, seen: &Seen<S>) {
        let (frame, width) = (self.frame, self.frame.stride / self.channels);
        let (zero, channels) = (splat(simd, 0.0), self.channels);
        // Outside the field the place on its plane means nothing, not even a number.
        let (x, y) = (choose(seen.lit, seen.x, zero), choose(seen.lit, seen.y, zero));
        for channel in 0..channels {
            self.add(channel * width, seen.radiance[channel], frame.projected[channel]);
        }
        for (j, &[along_x, along_y, start]) in frame.carriers.iter().enumerate() {
            let (sin, cos) = sin_cos_turns(x * along_x + y * along_y + start);
            for channel in 0..channels {
                self.add(channel * width + 1 + 2 * j, seen.radiance[channel] * cos, frame.projected[channel]);
                self.add(channel * width + 2 + 2 * j, seen.radiance[channel] * sin, frame.projected[channel]);
            }
        }
        if let Some(image_lookup) = &frame.image_lookup {
            let [(column, right), (row, below)] = image_lookup.place(simd, x, y);
            let [column, right, row, below] = [column, right, row, below].map(|x| x.to_array());
            let first = 1 + 2 * frame.carriers.len();
            for lane in bits(seen.lit.to_bitmask()) {
                let start = self.paths[lane] as usize * frame.stride + first;
                for channel in 0..channels {
                    let radiance = seen.radiance[channel].as_slice()[lane];
                    let sums = &mut self.responses[start + channel * width..][..image_lookup.projected_images.layers()];
                    let values = image_lookup.projected_images.blend(column[lane], row[lane], right[lane], below[lane]);
                    for (sum, value) in sums.iter_mut().zip(values) {
                        *sum += f64::from(radiance * value) * frame.projected[channel];
                    }
                }
            }
        }
    }

    /// Light of all lamps together.
    #[inline(always)]
    pub fn add_steady<S: Simd>(&mut self, radiance: &[F<S>; MOST_CHANNELS]) {
        let width = self.frame.stride / self.channels;
        for (channel, &radiance) in radiance[..self.channels].iter().enumerate() {
            self.add((channel + 1) * width - 1, radiance, self.frame.steady);
        }
    }
}
