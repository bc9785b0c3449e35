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
