//! What the good pixels of a layer span, and the range that colours stretch over.

use ndarray::Array2;

/// Numbers below and above these fractions of the good pixels may be clipped to the ends of the colour bar.
pub const CLIPPED: f64 = 0.005;

/// Facts about the good pixels of a layer.
#[derive(Clone, Debug, PartialEq)]
pub struct Statistics {
    pub min: f64,
    pub mean: f64,
    pub max: f64,
    /// Root of the mean square.
    pub rms: f64,
    /// The pixels that `CLIPPED` of the good ones lie below and above.
    bulk: [f64; 2],
}

impl Statistics {
    /// None where no pixel is good.
    pub fn of(data: &Array2<f32>, good: &Array2<bool>) -> Option<Self> {
        let values = data.iter().zip(good).filter(|(_, good)| **good).map(|(v, _)| f64::from(*v));
        let mut values: Vec<f64> = values.collect();
        let n = values.len();
        let min = values.iter().copied().reduce(f64::min)?;
        let max = values.iter().copied().reduce(f64::max)?;
        let mean = values.iter().sum::<f64>() / n as f64;
        let rms = (values.iter().map(|v| v * v).sum::<f64>() / n as f64).sqrt();
        // Two order statistics need no sorted image.
        let few = (n as f64 * CLIPPED) as usize;
        let bulk = [few, n - 1 - few].map(|rank| *values.select_nth_unstable_by(rank, f64::total_cmp).1);
        Some(Self { min, mean, max, rms, bulk })
    }
}

/// The range that a colour bar covers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    pub low: f64,
    pub high: f64,
    /// The lowest and the highest pixel.
    extremes: [f64; 2],
}

impl Range {
    /// From end to end.
    pub fn of([low, high]: [f64; 2]) -> Self {
        let (low, high) = if low < high { (low, high) } else { (low - 1.0, low + 1.0) };
        Self { low, high, extremes: [low, high] }
    }

    /// One range for layers that belong together: from the lowest 0.5 to the highest 99.5 percentile of a layer. What
    /// lies outside is clipped only where showing it would cost more than a fifth of the bar.
    pub fn robust(layers: &[&Statistics]) -> Option<Self> {
        let fold = |of: fn(&Statistics) -> f64, pick: fn(f64, f64) -> f64| layers.iter().map(|s| of(s)).reduce(pick);
        let (min, max) = (fold(|s| s.min, f64::min)?, fold(|s| s.max, f64::max)?);
        let (low, high) = (fold(|s| s.bulk[0], f64::min)?, fold(|s| s.bulk[1], f64::max)?);
        let wide = if high > low && (high - low) < 0.8 * (max - min) { (low, high) } else { (min, max) };
        // Layers of one number: the number in the middle of a tenth on either side.
        let (low, high) = if wide.0 < wide.1 {
            wide
        } else if wide.0 == 0.0 {
            (-1.0, 1.0)
        } else {
            (wide.0 - 0.1 * wide.0.abs(), wide.0 + 0.1 * wide.0.abs())
        };
        Some(Self { low, high, extremes: [min, max] })
    }

    /// A whole turn of an angle in rad, from -pi to pi.
    pub fn turn() -> Self {
        let pi = std::f64::consts::PI;
        Self { low: -pi, high: pi, extremes: [-pi, pi] }
    }

    /// Some pixels lie below.
    pub fn under(&self) -> bool {
        self.extremes[0] < self.low
    }

    /// Some pixels lie above.
    pub fn over(&self) -> bool {
        self.extremes[1] > self.high
    }

    /// The same range, widened to have zero in its middle.
    #[must_use]
    pub fn around_zero(self) -> Self {
        let end = self.high.max(-self.low);
        Self { low: -end, high: end, ..self }
    }

    /// Where a value lies: 0 at the low end, 1 at the high end.
    pub fn position(&self, value: f64) -> f64 {
        (value - self.low) / (self.high - self.low)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn range(values: &[f32]) -> Option<Range> {
        let data = Array2::from_shape_vec((1, values.len()), values.to_vec()).unwrap();
        let good = data.mapv(|v| v.is_finite());
        Statistics::of(&data, &good).and_then(|s| Range::robust(&[&s]))
    }

    #[test]
    fn outliers_do_not_wash_out_the_picture() {
        let mut values: Vec<f32> = (0..1000).map(|i| i as f32).collect();
        assert_eq!(range(&values), Some(Range { low: 0.0, high: 999.0, extremes: [0.0, 999.0] }));
        values[0] = -1e6;
        let r = range(&values).unwrap();
        assert!(r.low == 5.0 && r.high == 994.0 && r.under() && r.over(), "{r:?}");
    }

    /// Whatever the pixels, the range is finite, not empty, and holds the bulk of them.
    #[test]
    fn extreme_pixels_have_a_range() {
        for values in [
            vec![0.0; 9],
            vec![-2.5; 4],
            vec![1e-30, 2e-30],
            vec![f32::MAX, f32::MIN],
            vec![1e-45],
            vec![f32::NAN, 3.0, f32::INFINITY],
            vec![1.0, 1.0 + f32::EPSILON],
        ] {
            let r = range(&values).unwrap();
            assert!(r.low < r.high && r.low.is_finite() && r.high.is_finite(), "{values:?}: {r:?}");
            assert!(values.iter().filter(|v| v.is_finite()).all(|v| (0.0..=1.0).contains(&r.position(f64::from(*v)))));
            let zero = r.around_zero();
            assert!(zero.low == -zero.high && zero.position(0.0) == 0.5, "{values:?}: {zero:?}");
        }
        assert_eq!(range(&[f32::NAN]), None);
    }

    /// Most pixels equal, few different: the few must still be seen.
    #[test]
    fn a_small_inclusion_is_seen() {
        let mut values = vec![0.1f32; 10_000];
        values[5] = 0.2;
        let r = range(&values).unwrap();
        assert_eq!((r.low, r.high), (f64::from(0.1f32), f64::from(0.2f32)));
    }
}
