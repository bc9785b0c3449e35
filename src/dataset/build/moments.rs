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

/// As a manifest has them: columns between bars, channels between semicolons, numbers that read back to the bit.
pub fn text(moments: &ShardMoments) -> String {
    let one = |m: &Moments| format!("{} {} {} {} {}", m.n, m.mean, m.m2, m.least, m.most);
    let column = |of: &Vec<Moments>| of.iter().map(one).collect::<Vec<_>>().join(";");
    moments.iter().map(column).collect::<Vec<_>>().join("|")
}

/// What [`text`] wrote; `None` where it is something else, or not of so many columns.
pub fn read(text: &str, columns: usize) -> Option<ShardMoments> {
    let one = |text: &str| {
        let mut words = text.split(' ');
        let n = words.next()?.parse().ok()?;
        let mut number = || words.next()?.parse::<f64>().ok();
        Some(Moments { n, mean: number()?, m2: number()?, least: number()?, most: number()? })
    };
    let column = |text: &str| match text {
        "" => Some(Vec::new()),
        text => text.split(';').map(one).collect(),
    };
    let read: ShardMoments = text.split('|').map(column).collect::<Option<_>>()?;
    (read.len() == columns).then_some(read)
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Moments read back as they were, those of nothing too; cut short they are none.
    #[test]
    fn moments_read_back() {
        let moments = vec![
            vec![],
            vec![Moments::of([0.1, 0.2, -1e-300]), Moments::of([])],
            vec![Moments::of([1.0 / 3.0])],
            vec![],
        ];
        let text = text(&moments);
        assert_eq!(read(&text, 4), Some(moments));
        assert_eq!(read(&text, 3), None);
        assert_eq!(read(&text[..text.len() - 3], 4), None);
        assert_eq!(read("", 4), None);
    }
}
