//! `overview.png`: some samples and the spread of every number.

use std::collections::BTreeMap;

use ndarray::Array2;
use serde_json::Value;
use turbid_draw::stream;

use super::feature::Values;
use super::folder::Folder;
use super::index::{Point, Points};
use super::manifest::{ColumnOf, Manifest, ShardOf};
use super::shard::Sample;
use crate::preview::Caption;
use crate::preview::overview::{Channel, Marginal, Overview, Shown, Spread, overview};
use crate::spec::Draw;

/// Samples that are shown.
const SAMPLES: usize = 6;
/// Channels of tensors that are shown, and of one feature.
const CHANNELS: usize = 10;
const PER_FEATURE: usize = 3;

/// What the picture shows of the samples that are kept, as index and shards have them.
pub struct Glance {
    /// Of the least hashes, by raw index, each with its split.
    shown: Vec<(String, Sample)>,
    /// Values of a column in a split; NaN where not known.
    numbers: BTreeMap<(usize, String), Vec<f32>>,
    names: BTreeMap<(usize, String), BTreeMap<String, u64>>,
}

impl Glance {
    /// Looks at what was drawn, and into the shards for what was computed. `splits` are the names of the points' splits; `columns` of the manifest are
    /// `id`, `draw`, `group`, the draws, the features. Error: a shard that cannot be read, in words.
    pub fn of(
        folder: &Folder,
        manifest: &Manifest,
        points: &Points,
        draw: &Draw,
        splits: &[String],
    ) -> Result<Self, String> {
        let kept = || points.all().iter().filter(|point| point.row.is_ok());
        let split = |point: &Point| splits[usize::from(point.shard.0)].clone();
        let mut glance = Self { shown: Vec::new(), numbers: BTreeMap::new(), names: BTreeMap::new() };
        for point in kept() {
            let values = draw.point(point.index)?;
            (3..).zip(&values).for_each(|(place, value)| glance.note(place, split(point), value));
        }
        let first = 3 + draw.names().count();
        let features = manifest.columns.get(first..).unwrap_or_default();
        for shard in &manifest.shards {
            let scalar = |(_, column): &(usize, &ColumnOf)| column.shape.is_none();
            for (place, column) in (first..).zip(features).filter(scalar) {
                let found = folder.numbers(shard, manifest.shard_format, column)?;
                glance
                    .numbers
                    .entry((place, shard.split.clone()))
                    .or_default()
                    .extend(found.into_iter().map(|number| number as f32));
            }
        }
        let seed = stream(manifest.seed, "overview");
        let mut ranked: Vec<(u64, &Point)> =
            kept().map(|point| (stream(seed, &point.index.to_string()), point)).collect();
        ranked.sort_by_key(|(rank, _)| *rank);
        ranked.truncate(SAMPLES);
        ranked.sort_by_key(|(_, point)| point.index);
        for (_, point) in ranked {
            let is_its = |shard: &&ShardOf| shard.split == split(point) && shard.number == point.shard.1 as usize;
            let shard = manifest.shards.iter().find(is_its);
            let shard = shard.ok_or_else(|| format!("sample {} has no shard", Sample::id(point.index)))?;
            let row = point.row.unwrap_or_default() as usize;
            let values = folder.values(shard, manifest.shard_format, features, row)?;
            let sample = Sample { index: point.index, group: None, draws: draw.point(point.index)?, values };
            glance.shown.push((shard.split.clone(), sample));
        }
        Ok(glance)
    }

    fn note(&mut self, column: usize, split: String, value: &Value) {
        let key = (column, split);
        match value {
            Value::String(text) => *self.names.entry(key).or_default().entry(text.clone()).or_default() += 1,
            other => self.numbers.entry(key).or_default().push(other.as_f64().map_or(f32::NAN, |number| number as f32)),
        }
    }

    /// The PNG file; `splits` with their numbers of samples.
    pub fn picture(&self, manifest: &Manifest, splits: &[(String, u64)]) -> Vec<u8> {
        let splits: Vec<(String, u64)> = splits.iter().filter(|(_, n)| *n > 0).cloned().collect();
        let samples: u64 = splits.iter().map(|(_, n)| n).sum();
        let channels = channels(&manifest.columns);
        let all: usize = manifest.columns.iter().filter_map(|column| column.shape).map(|[channels, ..]| channels).sum();
        let shown = channels.len();
        let mut remarks =
            vec![format!("{} of {samples} samples, chosen by hash; {}", self.shown.len(), pixels(manifest))];
        if shown < all {
            remarks.push(format!("{} further channels are not shown", all - shown));
        }
        let of = Overview {
            channels: channels.iter().map(|&(place, number)| channel(&manifest.columns[place], number)).collect(),
            samples: self.samples(&manifest.columns, &channels),
            marginals: self.marginals(&manifest.columns, &splits),
            splits,
            remarks,
        };
        let facts = [
            ("Title", format!("{} {}", manifest.pipeline, manifest.dataset)),
            ("Software", format!("turbid {}", manifest.turbid_version)),
            ("Pipeline", manifest.pipeline.clone()),
        ];
        let caption = Caption {
            title: format!("{} · {samples} samples", manifest.dataset),
            subtitle: manifest.about.clone().unwrap_or_default(),
            facts: facts.into(),
        };
        overview(&of, &caption)
    }

    fn samples(&self, columns: &[ColumnOf], channels: &[(usize, usize)]) -> Vec<Shown> {
        let image = |sample: &Sample, (place, number): (usize, usize)| {
            let [_, rows, width] = columns[place].shape.expect("channels are those of tensors");
            let values = match &sample.values[place - 3 - sample.draws.len()] {
                Values::Tensor(values) => &values[number * rows * width..(number + 1) * rows * width],
                Values::Number(_) => &[],
            };
            Array2::from_shape_vec((rows, width), values.to_vec()).unwrap_or_default()
        };
        let row = |(split, sample): &(String, Sample)| Shown {
            id: Sample::id(sample.index),
            split: split.clone(),
            images: channels.iter().map(|&channel| image(sample, channel)).collect(),
        };
        self.shown.iter().map(row).collect()
    }

    fn marginals(&self, columns: &[ColumnOf], splits: &[(String, u64)]) -> Vec<Marginal> {
        let marginal = |(place, column): (usize, &ColumnOf)| {
            let key = |split: &String| (place, split.clone());
            let numbers = splits.iter().filter_map(|(split, _)| self.numbers.get(&key(split)));
            let names = splits.iter().filter_map(|(split, _)| self.names.get(&key(split)));
            let of = match (numbers.clone().count(), names.clone().count()) {
                (0, 0) => return None,
                (0, _) => Spread::Names(names.cloned().collect()),
                _ => Spread::Numbers(numbers.cloned().collect()),
            };
            Some(Marginal { name: column.name.clone(), unit: column.unit.clone(), of })
        };
        columns.iter().enumerate().filter_map(marginal).collect()
    }
}

/// Place of the column, and number of the channel in it.
fn channels(columns: &[ColumnOf]) -> Vec<(usize, usize)> {
    let tensors = columns.iter().enumerate().filter_map(|(place, column)| Some((place, column.shape?[0])));
    let all = tensors.flat_map(|(place, channels)| (0..channels.min(PER_FEATURE)).map(move |number| (place, number)));
    all.take(CHANNELS).collect()
}

fn channel(column: &ColumnOf, number: usize) -> Channel {
    let parts = column.channels.get(number).map_or("", String::as_str).split(", ");
    let about = parts.filter(|part| *part != "orientation 0 deg").map(str::to_owned).collect();
    Channel { name: column.name.clone(), about, unit: column.unit.clone() }
}

/// `64 x 64 pixels of 1 x 1 mm`, each size once.
fn pixels(manifest: &Manifest) -> String {
    let size = |column: &ColumnOf| {
        let [_, rows, columns] = column.shape?;
        let short = |mm: f64| (mm * 1e4).round() / 1e4;
        let pitch = column.pixel_mm.map(|[x, y]| format!(" of {} × {} mm", short(x), short(y))).unwrap_or_default();
        Some(format!("{columns} × {rows} pixels{pitch}"))
    };
    let mut sizes: Vec<String> = manifest.columns.iter().filter_map(size).collect();
    sizes.sort();
    sizes.dedup();
    sizes.join(", ")
}
