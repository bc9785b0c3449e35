//! Which split and which shard a point belongs to: a function of the seed, the point and its group alone.

use serde_json::Value;
use turbid_draw::{Condition, stream};

use crate::spec::{DatasetSpec, Draw};

/// The points of one split, cut into shards.
#[derive(Clone, Debug, PartialEq)]
pub struct Split {
    pub name: String,
    /// Raw indices, ascending.
    pub indices: Vec<u64>,
}

impl Split {
    /// Blocks of consecutive points: more points fill the last one and append others.
    pub fn shards(&self, rows: usize) -> impl Iterator<Item = &[u64]> {
        self.indices.chunks(rows)
    }
}

/// The splits in the order of the file, those of conditions last, each with its points; empty ones too.
///
/// A group (or, without one, a point) goes to the split in whose share of [0, 1) the hash of (seed, name of the data set,
/// group) lies, so that another n moves nothing, and no group stands in two splits. A point that meets the conditions of a
/// `far` split stands there instead.
pub fn assign(spec: &DatasetSpec, draw: &Draw, seed: u64) -> Vec<Split> {
    let names = spec.splits.iter().map(|(name, _)| name).chain(spec.far.iter().map(|(name, _)| name));
    let mut splits: Vec<Split> = names.map(|name| Split { name: name.clone(), indices: Vec::new() }).collect();
    let group = spec.by.as_ref().and_then(|by| draw.names().position(|name| name == by));
    let seed = stream(seed, &spec.name);
    for &index in &draw.indices {
        let needs_values = group.is_some() || !spec.far.is_empty();
        let values = if needs_values { draw.point(index).unwrap_or_default() } else { Vec::new() };
        let far = spec.far.iter().position(|(_, conditions)| all(conditions, draw, &values));
        let place = match far {
            Some(far) => spec.splits.len() + far,
            None => {
                let of = group.and_then(|at| values.get(at)).and_then(Value::as_u64).unwrap_or(index);
                share_of(&spec.splits, unit(seed, of))
            }
        };
        splits[place].indices.push(index);
    }
    splits
}

/// Uniform in [0, 1), a function of the seed and the number.
fn unit(seed: u64, number: u64) -> f64 {
    let mixed = stream(seed, &number.to_string());
    (mixed >> 11) as f64 / (1_u64 << 53) as f64
}

fn share_of(splits: &[(String, f64)], u: f64) -> usize {
    let mut end = 0.0;
    let found = splits.iter().position(|(_, share)| {
        end += share;
        u < end
    });
    // Shares sum to 1 but for rounding.
    found.unwrap_or(splits.len() - 1)
}

fn all(conditions: &[Condition], draw: &Draw, values: &[Value]) -> bool {
    let value = |name: &str| draw.names().position(|known| known == name).and_then(|place| values.get(place));
    conditions.iter().all(|condition| condition.holds(&value))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::path::Path;

    use super::*;
    use crate::spec::{Spec, read_bytes};

    /// A pipeline with `n` points, and all else by the number of the configuration.
    fn configuration(number: u64, n: u64) -> Spec {
        let choice = |what: &str, of: u64| stream(number, what) % of;
        let groups = 1 + choice("groups", 60);
        let parts: Vec<u64> = (0..2 + choice("splits", 4)).map(|k| 1 + choice(&format!("share {k}"), 9)).collect();
        let sum: u64 = parts.iter().sum();
        let shares: Vec<String> =
            parts.iter().enumerate().map(|(k, part)| format!("s{k}: {}", *part as f64 / sum as f64)).collect();
        let method = ["sobol", "random", "sobol"][choice("method", 3) as usize];
        let only = ["", "\n        only: [[a, above, 0.2]]"][choice("only", 2) as usize];
        let far = ["", "\n    far: {away: [[a, above, 0.8]]}"][choice("far", 2) as usize];
        let text = format!(
            "pipeline: p\nseed: {number}\nstages:\n  s:\n    use: scene\n    foreach:\n      draw:\n        n: {n}\n        \
             method: {method}\n        a: {{uniform: [0, 1]}}\n        patient: {{group: {groups}}}{only}\n\
             datasets:\n  d:\n    sample: {{x: s}}\n    splits: {{{}, by: patient}}{far}\n",
            shares.join(", ")
        );
        let (spec, report) = read_bytes(Path::new("p.yaml"), text.as_bytes(), &[]);
        spec.unwrap_or_else(|| panic!("{}\n{text}", report.render(false)))
    }

    /// In 100 configurations every point is in one split, no group is in two, and more points move none.
    #[test]
    fn no_group_is_in_two_splits() {
        let mut far = 0;
        for number in 0..100 {
            let n = 20 + stream(number, "n") % 200;
            let (few, many) = (configuration(number, n), configuration(number, 2 * n));
            let of = |spec: &Spec| {
                let stage = spec.stages.iter().next().expect("there is one stage");
                let draw = stage.foreach.draw.clone().expect("it draws");
                (assign(&spec.datasets[0], &draw, spec.seed), draw)
            };
            let ((splits, draw), (more, _)) = (of(&few), of(&many));
            let mut all: Vec<u64> = splits.iter().flat_map(|split| split.indices.iter().copied()).collect();
            all.sort_unstable();
            assert_eq!(all, draw.indices, "configuration {number}");
            let place = draw.names().position(|name| name == "patient").expect("it is drawn");
            let mut split_of: BTreeMap<String, &str> = BTreeMap::new();
            for split in splits.iter().filter(|split| split.name != "away") {
                for &index in &split.indices {
                    let group = draw.point(index).expect("the point is there")[place].to_string();
                    let other = split_of.insert(group, &split.name);
                    assert!(other.is_none_or(|other| other == split.name), "configuration {number}: a group in two");
                }
            }
            for (few, more) in splits.iter().zip(&more) {
                assert!(more.indices.starts_with(&few.indices), "configuration {number}: points move with n");
                far += if few.name == "away" { few.indices.len() } else { 0 };
            }
        }
        assert!(far > 100, "there are points far away: {far}");
    }

    /// Without groups the shares are those of the file; 4 standard deviations of a binomial.
    #[test]
    fn shares_are_those_of_the_file() {
        let mut spec = configuration(3, 4000);
        let of = &mut spec.datasets[0];
        (of.by, of.far) = (None, Vec::new());
        let stage = spec.stages.iter().next().expect("there is one stage");
        let draw = stage.foreach.draw.clone().expect("it draws");
        let splits = assign(&spec.datasets[0], &draw, spec.seed);
        for (split, (_, share)) in splits.iter().zip(&spec.datasets[0].splits) {
            let n = draw.indices.len() as f64;
            let wanted = share * n;
            let found = split.indices.len() as f64;
            assert!(
                (found - wanted).abs() < 4.0 * (wanted * (1.0 - share)).sqrt(),
                "{}: {found} of {wanted}",
                split.name
            );
        }
    }
}
