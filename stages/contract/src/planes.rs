//! Pixels of image stacks: slices of layers, filling planes on all threads, the noise of a layer's mean.

use std::borrow::Cow;
use std::ops::Range;
use std::sync::Mutex;

use ndarray::Array2;

use crate::artifact::{ImageStack, Layer, LayerInfo, LayerKind};
use crate::ctx::Ctx;
use crate::error::Error;

/// Pixels of one tile: enough work to outweigh its start, few enough to stay in the cache of a core.
const TILE_PIXELS: usize = 1 << 15;

impl Ctx<'_> {
    /// Fills planes of one size tile by tile (blocks of whole rows) on all threads; the results of `work` in tile order.
    ///
    /// `work` gets the range of row-major pixel indices of its tile and that part of every plane.
    /// The tiles are fixed by the size of the image, never by the thread count.
    /// Error: [`Error::Interrupted`] when the run was cancelled; the planes are then filled in part.
    pub fn fill_planes<T: Send + Sync>(
        &self,
        planes: &mut [Array2<f32>],
        work: impl Fn(Range<usize>, &mut [&mut [f32]]) -> T + Sync,
    ) -> Result<Vec<T>, Error> {
        let (rows, columns) = planes.first().map_or((0, 0), Array2::dim);
        let length = TILE_PIXELS.div_ceil(columns.max(1)) * columns;
        let mut tiles: Vec<Vec<&mut [f32]>> = Vec::new();
        tiles.resize_with((rows * columns).div_ceil(length.max(1)), Vec::new);
        for plane in planes {
            assert_eq!(plane.dim(), (rows, columns), "all planes have one size");
            let pixels = plane.as_slice_mut().expect("planes to fill are row-major");
            for (tile, part) in tiles.iter_mut().zip(pixels.chunks_mut(length)) {
                tile.push(part);
            }
        }
        let tiles: Vec<Mutex<Vec<&mut [f32]>>> = tiles.into_iter().map(Mutex::new).collect();
        self.map_tiles(tiles.len(), |i| {
            let mut parts = tiles[i].lock().expect("each tile is taken once");
            let start = i * length;
            let end = start + parts[0].len();
            work(start..end, &mut parts)
        })
    }
}

impl Layer {
    /// The pixels, row by row from the top.
    pub fn pixels(&self) -> Cow<'_, [f32]> {
        match self.data.as_slice() {
            Some(pixels) => Cow::Borrowed(pixels),
            None => Cow::Owned(self.data.iter().copied().collect()),
        }
    }
}

impl ImageStack {
    /// The mask that holds for layers of `wavelength_nm`; none means that every pixel is good.
    pub fn mask(&self, wavelength_nm: Option<f64>) -> Option<&Layer> {
        self.layers.iter().find(|l| {
            l.info.is_pixel_mask() && (l.info.wavelength_nm.is_none() || l.info.wavelength_nm == wavelength_nm)
        })
    }

    /// The standard error layer of the value layer `info`.
    pub fn standard_error(&self, info: &LayerInfo) -> Option<&Layer> {
        self.layers.iter().find(|l| l.info.is_standard_error_of(info))
    }

    /// The layer that flags where the standard error of the value layer `info` is unknown; none means that it is known everywhere.
    pub fn se_unknown(&self, info: &LayerInfo) -> Option<&Layer> {
        self.layers.iter().find(|l| l.info.flags_errors_of(info))
    }
}

impl LayerInfo {
    /// Whether this layer holds the standard error of the value layer `value`.
    pub fn is_standard_error_of(&self, value: &LayerInfo) -> bool {
        let of = self.name.strip_suffix("_se");
        self.kind == LayerKind::StandardError && of == Some(value.name.as_str()) && same_light(self, value)
    }

    /// Whether this layer flags where the standard error of the value layer `value` is unknown.
    pub fn flags_errors_of(&self, value: &LayerInfo) -> bool {
        let of = self.name.strip_suffix("_se_unknown");
        self.kind == LayerKind::Mask && of == Some(value.name.as_str()) && same_light(self, value)
    }
}

/// Whether two layers are seen under the same light: equal f_x, phase, orientation, wavelength.
fn same_light(a: &LayerInfo, b: &LayerInfo) -> bool {
    a.f_x_per_mm == b.f_x_per_mm
        && a.phase_rad == b.phase_rad
        && a.orientation_deg == b.orientation_deg
        && a.wavelength_nm == b.wavelength_nm
}

/// Standard error of the mean of `n` pixels whose variances add up to `variances`, with one factor of [`Sharing`](crate::sharing::Sharing) for all; `None` without
/// pixels.
///
/// Errors that are the same in all n pixels have the sharing n: of a part of an image it cannot be more.
pub fn mean_se(variances: f64, n: u64, sharing: f64) -> Option<f64> {
    (n > 0).then(|| (variances * sharing.min(n as f64)).sqrt() / n as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kit::MemoryHost;

    /// Every pixel is visited once, with its own index, whatever the size; also where rows do not divide into tiles.
    #[test]
    fn tiles_cover_each_pixel_once() {
        let host = MemoryHost::default();
        for (rows, columns) in [(1, 1), (3, 100_000), (700, 97), (1, 40_000)] {
            let mut planes = vec![Array2::<f32>::zeros((rows, columns)); 2];
            let lengths = Ctx::new(&host)
                .fill_planes(&mut planes, |range, parts| {
                    for (k, i) in range.clone().enumerate() {
                        parts[0][k] += (i % 1000) as f32;
                        parts[1][k] += 1.0;
                    }
                    range.len()
                })
                .expect("nobody cancels");
            assert_eq!(lengths.iter().sum::<usize>(), rows * columns);
            assert!(planes[0].iter().enumerate().all(|(i, &v)| v == (i % 1000) as f32), "{rows} x {columns}");
            assert!(planes[1].iter().all(|&v| v == 1.0));
        }
    }

    /// Flags of unknown errors are not the mask of bad pixels, and belong to one quantity each.
    #[test]
    fn flags_of_unknown_errors_are_no_pixel_mask() {
        let mut stack = ImageStack::new(1, 2);
        let info = LayerInfo::value("m_ac", "1").with_f_x(0.1);
        stack.push(info.clone(), Array2::zeros((1, 2)));
        stack.push(info.se_unknown(), Array2::ones((1, 2)));
        assert!(stack.mask(None).is_none());
        assert_eq!(stack.se_unknown(&info).map(|l| l.info.name.as_str()), Some("m_ac_se_unknown"));
        assert!(stack.se_unknown(&LayerInfo::value("m_ac", "1").with_f_x(0.2)).is_none());
    }
}
