//! Image pixels to screen pixels: small images enlarged, large ones reduced, by whole numbers.

use ndarray::Array2;

/// How many image pixels become one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reduce {
    /// Mean of the good pixels: for quantities.
    Mean,
    /// The most frequent value: for categories.
    MostFrequent,
    /// The first good pixel: for angles, whose mean across the wrap has no meaning.
    First,
}

/// An image as it is shown: cells of `zoom` x `zoom` screen pixels, each from `step` x `step` image pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Pixels {
    pub rows: usize,
    pub columns: usize,
    pub zoom: usize,
    pub step: usize,
    /// Row by row; None where at least half of the image pixels are masked.
    pub cells: Vec<Option<f64>>,
}

/// Fits an image to about `side` screen pixels along its longer side: between 4/5 and 5/4 of it where whole
/// numbers allow. `good` has the image's shape.
pub fn fit(data: &Array2<f32>, good: &Array2<bool>, side: usize, reduce: Reduce) -> Pixels {
    let (rows, columns) = data.dim();
    let longer = rows.max(columns);
    let (zoom, step) = if longer * 5 <= side * 6 {
        (((side + longer / 2) / longer).max(1), 1)
    } else {
        (1, (longer * 4).div_ceil(side * 5))
    };
    let (out_rows, out_columns) = (rows.div_ceil(step), columns.div_ceil(step));
    let cells = match reduce {
        Reduce::Mean => means(data, good, step),
        _ => blocks(data, good, step, reduce),
    };
    Pixels { rows: out_rows, columns: out_columns, zoom, step, cells }
}

/// The mean of the good pixels of each block: column by column, row by row through the image, then over the columns of a block.
fn means(data: &Array2<f32>, good: &Array2<bool>, step: usize) -> Vec<Option<f64>> {
    let (rows, columns) = data.dim();
    let mut cells = Vec::with_capacity(rows.div_ceil(step) * columns.div_ceil(step));
    let (mut sums, mut counts) = (vec![0.0; columns], vec![0_u32; columns]);
    for top in (0..rows).step_by(step) {
        let block = top..(top + step).min(rows);
        sums.fill(0.0);
        counts.fill(0);
        for row in block.clone() {
            let pixels = data.row(row).into_iter().zip(good.row(row));
            for ((sum, count), (&value, &good)) in sums.iter_mut().zip(&mut counts).zip(pixels) {
                *sum += f64::from(if good { value } else { 0.0 });
                *count += u32::from(good);
            }
        }
        for (sums, counts) in sums.chunks(step).zip(counts.chunks(step)) {
            let (sum, count) = (sums.iter().sum::<f64>(), counts.iter().sum::<u32>() as usize);
            cells.push((2 * count > sums.len() * block.len()).then(|| sum / count as f64));
        }
    }
    cells
}

/// What `reduce` makes of each block.
fn blocks(data: &Array2<f32>, good: &Array2<bool>, step: usize, reduce: Reduce) -> Vec<Option<f64>> {
    let (rows, columns) = data.dim();
    let mut cells = Vec::with_capacity(rows.div_ceil(step) * columns.div_ceil(step));
    let mut block = Vec::with_capacity(step * step);
    for row in (0..rows).step_by(step) {
        for column in (0..columns).step_by(step) {
            block.clear();
            let mut total = 0;
            for r in row..(row + step).min(rows) {
                for c in column..(column + step).min(columns) {
                    total += 1;
                    if good[[r, c]] {
                        block.push(f64::from(data[[r, c]]));
                    }
                }
            }
            cells.push((2 * block.len() > total).then(|| summary(&mut block, reduce)));
        }
    }
    cells
}

/// One value for a block that is not empty.
fn summary(block: &mut [f64], reduce: Reduce) -> f64 {
    match reduce {
        Reduce::First => block[0],
        Reduce::Mean => block.iter().sum::<f64>() / block.len() as f64,
        Reduce::MostFrequent => {
            block.sort_by(f64::total_cmp);
            let longest = block.chunk_by(|a, b| a == b).max_by_key(|run| run.len());
            longest.expect("a block is not empty")[0]
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(rows: usize, columns: usize) -> Array2<bool> {
        Array2::from_elem((rows, columns), true)
    }

    #[test]
    fn images_of_every_size_fit() {
        for n in [1, 2, 3, 5, 17, 33, 64, 100, 128, 200, 256, 300, 345, 346, 500, 512, 1000, 2048, 5000] {
            let p = fit(&Array2::zeros((1, n)), &all(1, n), 288, Reduce::Mean);
            let shown = p.columns * p.zoom;
            assert!((192..=360).contains(&shown), "{n} pixels are shown on {shown}");
            assert!(p.zoom == 1 || p.step == 1, "{n}");
            assert_eq!(p.rows, 1);
        }
    }

    /// Blocks that divide the image evenly keep its mean; masked pixels take no part.
    #[test]
    fn means_are_of_good_pixels() {
        let data = Array2::from_shape_fn((600, 600), |(r, c)| if c == 0 { 1e30 } else { (r % 2) as f32 });
        let mut good = all(600, 600);
        good.column_mut(0).fill(false);
        let p = fit(&data, &good, 240, Reduce::Mean);
        assert_eq!((p.step, p.rows, p.columns), (2, 300, 300));
        // The first column of cells is half masked, and half is too much.
        assert!(p.cells.iter().enumerate().all(|(i, c)| if i % 300 == 0 { c.is_none() } else { *c == Some(0.5) }));
    }

    #[test]
    fn categories_and_angles_are_never_mixed() {
        let data = Array2::from_shape_fn((900, 900), |(r, c)| if (r % 3, c % 3) == (0, 0) { 7.0 } else { 2.0 });
        let p = fit(&data, &all(900, 900), 240, Reduce::MostFrequent);
        assert!(p.step == 3 && p.cells.iter().all(|c| *c == Some(2.0)));
        let p = fit(&data, &all(900, 900), 240, Reduce::First);
        assert!(p.cells.iter().all(|c| *c == Some(7.0)));
    }
}
