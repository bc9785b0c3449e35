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
        let values = || data.iter().zip(good).filter(|(_, good)| **good).map(|(v, _)| *v);
        let (mut min, mut max, mut sum, mut squares) = (f32::INFINITY, f32::NEG_INFINITY, 0.0, 0.0);
        let mut ranks = Ranks::default();
        values().for_each(|value| {
            (min, max) = (if value < min { value } else { min }, if value > max { value } else { max });
            let wide = f64::from(value);
            (sum, squares) = (sum + wide, squares + wide * wide);
            ranks.count(value);
        });
        let n = ranks.all;
        if n == 0 {
            return None;
        }
        let few = (n as f64 * CLIPPED) as usize;
        let bulk = ranks.values([few, n - 1 - few], values).map(f64::from);
        let (mean, rms) = (sum / n as f64, (squares / n as f64).sqrt());
        Some(Self { min: f64::from(min), mean, max: f64::from(max), rms, bulk })
    }
}

/// How many numbers begin with each pair of bytes: an order statistic needs neither a sorted image nor a copy of it.
struct Ranks {
    counts: Vec<u32>,
    all: usize,
}

impl Default for Ranks {
    fn default() -> Self {
        Self { counts: vec![0; 1 << 16], all: 0 }
    }
}

impl Ranks {
    /// Bits that are in the order of the numbers, as `total_cmp` has it.
    fn key(value: f32) -> u32 {
        let bits = value.to_bits();
        if bits >> 31 == 0 { bits | 1 << 31 } else { !bits }
    }

    fn number(key: u32) -> f32 {
        f32::from_bits(if key >> 31 == 1 { key & !(1 << 31) } else { !key })
    }

    fn count(&mut self, value: f32) {
        self.counts[(Self::key(value) >> 16) as usize] += 1;
        self.all += 1;
    }

    /// The class in which the number of a rank is, and its rank there.
    fn class(counts: &[u32], mut rank: usize) -> (usize, usize) {
        let class = counts.iter().position(|&count| {
            let is_in = rank < count as usize;
            rank -= if is_in { 0 } else { count as usize };
            is_in
        });
        (class.expect("a rank is below the count of all"), rank)
    }

    /// The numbers of two ranks among the values that were counted.
    fn values<I: Iterator<Item = f32>>(&self, ranks: [usize; 2], values: impl Fn() -> I) -> [f32; 2] {
        let classes = ranks.map(|rank| Self::class(&self.counts, rank));
        let mut ends = [vec![0; 1 << 16], vec![0; 1 << 16]];
        values().map(Self::key).for_each(|key| {
            for (ends, (class, _)) in ends.iter_mut().zip(classes) {
                if (key >> 16) as usize == class {
                    ends[(key & 0xffff) as usize] += 1;
                }
            }
        });
        [0, 1].map(|k| {
            let (class, rank) = classes[k];
            Self::number((class as u32) << 16 | Self::class(&ends[k], rank).0 as u32)
        })
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

    /// The ranks of numbers are those of the sorted ones, whatever their signs and sizes.
    #[test]
    fn ranks_need_no_sorting() {
        let values: Vec<f32> = (0..1500u32)
            .map(|i| f32::from_bits(i.wrapping_mul(2_654_435_761)))
            .chain([0.0, -0.0, f32::MIN_POSITIVE / 8.0, 1.0, 1.0, -1.0])
            .filter(|v| v.is_finite())
            .collect();
        let mut ranks = Ranks::default();
        values.iter().for_each(|&v| ranks.count(v));
        let mut sorted = values.clone();
        sorted.sort_by(f32::total_cmp);
        for rank in 0..sorted.len() {
            let two = [rank, sorted.len() - 1 - rank];
            let found = ranks.values(two, || values.iter().copied());
            assert_eq!(found.map(f32::to_bits), two.map(|rank| sorted[rank].to_bits()));
        }
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
