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
        let (data, good) = (data.as_standard_layout(), good.as_standard_layout());
        let (values, good) = (data.as_slice()?, good.as_slice()?);
        let ranks = Ranks::of(values, good);
        let n = ranks.all;
        if n == 0 {
            return None;
        }
        let few = (n as f64 * CLIPPED) as usize;
        let bulk = ranks.values([few, n - 1 - few], values, good).map(f64::from);
        let Sums { min, max, sum, squares } = Sums::of(values, good);
        let (mean, rms) = (sum / n as f64, (squares / n as f64).sqrt());
        Some(Self { min: f64::from(min), mean, max: f64::from(max), rms, bulk })
    }
}

/// Of good pixels.
struct Sums {
    min: f32,
    max: f32,
    sum: f64,
    squares: f64,
}

impl Sums {
    fn of(values: &[f32], good: &[bool]) -> Self {
        /// Sums that run side by side: none waits for another.
        const LANES: usize = 8;
        let (mut min, mut max) = ([f32::INFINITY; LANES], [f32::NEG_INFINITY; LANES]);
        let (mut sum, mut squares) = ([0.0; LANES], [0.0; LANES]);
        for (values, good) in values.chunks(LANES).zip(good.chunks(LANES)) {
            for (l, (&value, &good)) in values.iter().zip(good).enumerate() {
                min[l] = if good & (value < min[l]) { value } else { min[l] };
                max[l] = if good & (value > max[l]) { value } else { max[l] };
                let wide = f64::from(if good { value } else { 0.0 });
                (sum[l], squares[l]) = (sum[l] + wide, squares[l] + wide * wide);
            }
        }
        Self {
            min: min.into_iter().fold(f32::INFINITY, f32::min),
            max: max.into_iter().fold(f32::NEG_INFINITY, f32::max),
            sum: sum.iter().sum(),
            squares: squares.iter().sum(),
        }
    }
}

/// How many numbers begin with each pair of bytes: an order statistic needs neither a sorted image nor a copy of it.
struct Ranks {
    counts: Vec<u32>,
    all: usize,
}

impl Ranks {
    fn of(values: &[f32], good: &[bool]) -> Self {
        // Neighbours are often alike: a count that was just written is not read at once.
        let mut counts = [vec![0_u32; 1 << 16], vec![0; 1 << 16]];
        for (values, good) in values.chunks(2).zip(good.chunks(2)) {
            for (counts, (&value, &good)) in counts.iter_mut().zip(values.iter().zip(good)) {
                counts[(Self::key(value) >> 16) as usize] += u32::from(good);
            }
        }
        let [mut counts, others] = counts;
        counts.iter_mut().zip(others).for_each(|(count, other)| *count += other);
        Self { all: counts.iter().map(|&count| count as usize).sum(), counts }
    }

    /// Bits that are in the order of the numbers, as `total_cmp` has it.
    fn key(value: f32) -> u32 {
        let bits = value.to_bits();
        if bits >> 31 == 0 { bits | 1 << 31 } else { !bits }
    }

    fn number(key: u32) -> f32 {
        f32::from_bits(if key >> 31 == 1 { key & !(1 << 31) } else { !key })
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

    /// The numbers of two ranks among the good values that were counted.
    fn values(&self, ranks: [usize; 2], values: &[f32], good: &[bool]) -> [f32; 2] {
        let classes = ranks.map(|rank| Self::class(&self.counts, rank));
        let [low, high] = classes.map(|(class, _)| class as u32);
        let mut ends = [vec![0; 1 << 16], vec![0; 1 << 16]];
        for (&value, &good) in values.iter().zip(good) {
            let key = Self::key(value);
            let class = key >> 16;
            if class == low || class == high {
                ends[0][(key & 0xffff) as usize] += u32::from(good & (class == low));
                ends[1][(key & 0xffff) as usize] += u32::from(good & (class == high));
            }
        }
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
        let good = vec![true; values.len()];
        let ranks = Ranks::of(&values, &good);
        let mut sorted = values.clone();
        sorted.sort_by(f32::total_cmp);
        for rank in 0..sorted.len() {
            let two = [rank, sorted.len() - 1 - rank];
            let found = ranks.values(two, &values, &good);
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
