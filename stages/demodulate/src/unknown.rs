//! Standard errors that are not known: what is made of frames that do not know theirs does not know its own.

use turbid_contract::ndarray::Array2;
use turbid_contract::{ImageStack, Layer, LayerInfo, LayerKind};

/// Where any of the layers `infos` has a standard error that is not known; `None` where all of them know theirs everywhere.
pub fn of_layers<'i>(stack: &ImageStack, infos: impl IntoIterator<Item = &'i LayerInfo>) -> Option<Vec<bool>> {
    let mut found: Option<Vec<bool>> = None;
    for layer in infos.into_iter().filter_map(|info| stack.se_unknown(info)) {
        let all = found.get_or_insert_with(|| vec![false; stack.rows() * stack.columns()]);
        all.iter_mut().zip(layer.pixels().iter()).for_each(|(flag, &unknown)| *flag |= unknown != 0.0);
    }
    found.filter(|flags| flags.contains(&true))
}

/// The largest share of a window's pixels that may be without a known error while the window's own counts as known.
const LARGEST_SHARE: f64 = 0.1;

/// For results that are made of windows of so many pixels to each side along rows and columns: where more than a tenth of a window is flagged, or its
/// middle.
pub fn of_windows(flags: &[bool], columns: usize, [along_rows, along_columns]: [usize; 2]) -> Vec<bool> {
    let rows = flags.len() / columns;
    // Sums over all pixels above and to the left.
    let mut sums = vec![0_u32; (rows + 1) * (columns + 1)];
    for r in 0..rows {
        let mut line = 0;
        for c in 0..columns {
            line += u32::from(flags[r * columns + c]);
            sums[(r + 1) * (columns + 1) + c + 1] = sums[r * (columns + 1) + c + 1] + line;
        }
    }
    let at = |r: usize, c: usize| sums[r * (columns + 1) + c];
    let window = |i: usize| {
        let (r, c) = (i / columns, i % columns);
        let (top, bottom) = (r.saturating_sub(along_columns), (r + along_columns + 1).min(rows));
        let (left, right) = (c.saturating_sub(along_rows), (c + along_rows + 1).min(columns));
        let flagged = at(bottom, right) + at(top, left) - at(top, right) - at(bottom, left);
        f64::from(flagged) > LARGEST_SHARE * ((bottom - top) * (right - left)) as f64
    };
    (0..flags.len()).map(|i| flags[i] || window(i)).collect()
}

/// The flags of the value layer `info` as a layer, at good pixels; `None` where none of them is flagged.
pub fn layer(info: &LayerInfo, flags: &[bool], mask: &Array2<f32>) -> Option<(LayerInfo, Array2<f32>)> {
    let mut data = Array2::zeros(mask.dim());
    let pixels = data.iter_mut().zip(mask.iter().zip(flags));
    let mut any = false;
    for (flag, _) in pixels.filter(|(_, (mask, flagged))| **mask == 0.0 && **flagged) {
        (*flag, any) = (1.0, true);
    }
    any.then(|| (info.se_unknown(), data))
}

/// Passes flags on to every value layer of `stack` that has a standard error; `flags` says which of its wavelength and f_x.
pub fn pass_on(stack: &mut ImageStack, flags: impl Fn(&LayerInfo) -> Option<Vec<bool>>) {
    let good = Array2::zeros((stack.rows(), stack.columns()));
    let mut found = Vec::new();
    for k in 0..stack.layers.len() {
        let info = &stack.layers[k].info;
        if info.kind != LayerKind::Value || stack.standard_error(info).is_none() {
            continue;
        }
        let Some(flags) = flags(info) else { continue };
        found.extend(layer(info, &flags, stack.mask(info.wavelength_nm).map_or(&good, |mask| &mask.data)));
        // Of what is known in part no error of the mean is known.
        stack.layers[k].info.mean_se = None;
    }
    stack.layers.extend(found.into_iter().map(|(info, data)| Layer { info, data }));
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A flag spreads to windows of which it is more than a tenth, at borders as well as inside; its own pixel is always flagged.
    #[test]
    fn windows_count_their_flags() {
        let (rows, columns) = (7, 9);
        let mut flags = vec![false; rows * columns];
        flags[3 * columns + 4] = true;
        // Nine pixels: a ninth is more than a tenth.
        let near = of_windows(&flags, columns, [1, 1]);
        let want = |i: usize| (i / columns).abs_diff(3) <= 1 && (i % columns).abs_diff(4) <= 1;
        assert!((0..flags.len()).all(|i| near[i] == want(i)), "{near:?}");
        // Fifteen: it is less.
        assert_eq!(of_windows(&flags, columns, [2, 1]), flags);
        assert_eq!(of_windows(&flags, columns, [0, 0]), flags);
        let line = of_windows(&flags, columns, [3, 0]);
        assert_eq!(line.iter().filter(|f| **f).count(), 7);
    }
}
