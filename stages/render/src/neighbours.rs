//! The pixels around a pixel.

/// Pixels on each side whose noise is pooled.
const AROUND: usize = 2;

/// The pixels around one of an image of `pixels` in rows of `columns`, and itself.
pub fn around(pixel: usize, columns: usize, pixels: usize) -> impl Iterator<Item = usize> {
    within(AROUND, pixel, columns, pixels)
}

/// The same up to `reach` pixels away along each side.
pub fn within(reach: usize, pixel: usize, columns: usize, pixels: usize) -> impl Iterator<Item = usize> {
    let (row, column, rows) = (pixel / columns, pixel % columns, pixels / columns);
    let along = move |at: usize, n: usize| at.saturating_sub(reach)..(at + reach + 1).min(n);
    along(row, rows).flat_map(move |r| along(column, columns).map(move |c| r * columns + c))
}
