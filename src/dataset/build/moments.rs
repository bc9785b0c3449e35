//! Moments of what a shard holds.

use crate::dataset::feature::Values;
use crate::dataset::manifest::ColumnOf;
use crate::dataset::shard::Sample;
use crate::dataset::statistics::Moments;

/// Columns with the moments of a shard: one for a number, one per channel of a tensor.
pub type ShardMoments = Vec<Vec<Moments>>;

/// Moments of each column: of numbers, and of each channel of tensors; none of texts.
pub fn moments(columns: &[ColumnOf], samples: &[Sample]) -> ShardMoments {
    let draws = samples.first().map_or(0, |sample| sample.draws.len());
    let of = |(place, column): (usize, &ColumnOf)| match (place, column.shape) {
        (0..3, _) => Vec::new(),
        _ if place < 3 + draws => match column.dtype.as_str() {
            "string" => Vec::new(),
            _ => vec![Moments::of(samples.iter().filter_map(|sample| sample.draws[place - 3].as_f64()))],
        },
        (_, None) => {
            let number = |sample: &Sample| match &sample.values[place - 3 - draws] {
                Values::Number(number) => *number,
                Values::Tensor(_) => None,
            };
            vec![Moments::of(samples.iter().filter_map(number))]
        }
        (_, Some([channels, rows, width])) => (0..channels)
            .map(|channel| {
                let pixels = rows * width;
                let of = samples.iter().flat_map(|sample| match &sample.values[place - 3 - draws] {
                    Values::Tensor(values) => values[channel * pixels..(channel + 1) * pixels].iter(),
                    Values::Number(_) => [].iter(),
                });
                Moments::of(of.map(|&value| f64::from(value)))
            })
            .collect(),
    };
    if samples.is_empty() {
        return columns.iter().map(|_| Vec::new()).collect();
    }
    columns.iter().enumerate().map(of).collect()
}

/// Those of both, column by column.
pub fn join(before: ShardMoments, more: &ShardMoments) -> ShardMoments {
    let joined = before.into_iter().zip(more).map(|(before, more)| {
        if more.is_empty() || before.is_empty() {
            return if before.is_empty() { more.clone() } else { before };
        }
        before.into_iter().zip(more).map(|(a, b)| a.and(*b)).collect()
    });
    joined.collect()
}
