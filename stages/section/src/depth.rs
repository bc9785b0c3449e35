//! How far along the wall a pixel's surface lies below the mouth.

/// What the camera sees at a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seen {
    /// World z, mm.
    pub height: f64,
    /// Of the unit normal.
    pub normal_z: f64,
}

/// Layers of height over which the steepness of the wall is averaged.
const LAYERS: usize = 256;
/// Sine of the least steepness of a wall: what lies flatter is a rim, a floor or a shelf, on which depth says nothing of the length.
const LEAST_SINE: f64 = 0.1;

/// Arc length (mm) below `top` of each pixel that is wall, `None` elsewhere.
///
/// On a wall that falls at the angle with sine sqrt(1 - n_z^2) a step dz of height is dz / sine of length; the sine is averaged
/// around the wall at each height. Exact for cylinders and cones about z; for walls that bend sideways the mean around them.
pub fn arc_lengths(seen: &[Option<Seen>], top: f64) -> Vec<Option<f64>> {
    let sine = |s: &Seen| (1.0 - s.normal_z * s.normal_z).max(0.0).sqrt();
    let wall = |s: &&Seen| sine(s) >= LEAST_SINE;
    let bottom = seen.iter().flatten().filter(wall).map(|s| s.height).fold(top, f64::min);
    let layer_height = (top - bottom) / LAYERS as f64;
    let layer_of = |height: f64| {
        let at = (top - height) / layer_height;
        // All at one height are in the first layer.
        if at.is_finite() { (at.max(0.0) as usize).min(LAYERS - 1) } else { 0 }
    };
    let (mut sums, mut counts) = (vec![0.0; LAYERS], vec![0.0; LAYERS]);
    for s in seen.iter().flatten().filter(wall) {
        sums[layer_of(s.height)] += 1.0 / sine(s);
        counts[layer_of(s.height)] += 1.0;
    }
    // A layer that no pixel shows is as steep as that above it, the uppermost as the first below that one knows.
    let known = (0..LAYERS).find(|&k| counts[k] > 0.0);
    let mut stretch = known.map_or(1.0, |k| sums[k] / counts[k]);
    let (mut starts, mut stretches, mut length) = (Vec::new(), Vec::new(), 0.0);
    for k in 0..LAYERS {
        if counts[k] > 0.0 {
            stretch = sums[k] / counts[k];
        }
        starts.push(length);
        stretches.push(stretch);
        length += stretch * layer_height;
    }
    let along = |s: &Seen| {
        let k = layer_of(s.height);
        (starts[k] + stretches[k] * (top - s.height - k as f64 * layer_height)).max(0.0)
    };
    seen.iter().map(|s| s.as_ref().filter(wall).map(along)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// In an upright tube the depth, in a cone of half angle a the depth over cos(a), to rounding; rims and background have none.
    #[test]
    fn cylinders_and_cones_are_exact() {
        for half_angle in [0.0_f64, 0.3, 0.8] {
            let wall = |depth: f64| Some(Seen { height: 5.0 - depth, normal_z: half_angle.sin() });
            let depths = [0.0, 1e-3, 7.0, 80.0, 250.0];
            let mut seen: Vec<Option<Seen>> = depths.iter().map(|&d| wall(d)).collect();
            seen.push(Some(Seen { height: 5.0, normal_z: 1.0 }));
            seen.push(None);
            let found = arc_lengths(&seen, 5.0);
            for (depth, found) in depths.iter().zip(&found) {
                let expected = depth / half_angle.cos();
                assert!((found.unwrap() - expected).abs() < 1e-11 * 250.0, "{depth}: {found:?} {expected}");
            }
            assert_eq!(found[5..], [None, None]);
        }
        assert_eq!(arc_lengths(&[Some(Seen { height: 2.0, normal_z: 0.0 })], 2.0), [Some(0.0)]);
        assert_eq!(arc_lengths(&[None], 0.0), [None]);
    }
}
