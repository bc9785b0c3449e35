//! What stands beside the shards: manifest, index, statistics, card, Croissant, costs.

use std::collections::BTreeMap;

use turbid_contract::{Artifact, canonical};
use turbid_draw::Type;

use super::{Building, Built, State, Stopped};
use crate::dataset::folder::Folder;
use crate::dataset::index::Point;
use crate::dataset::manifest::{ColumnOf, FORMAT, Manifest, ShardOf};
use crate::dataset::overview::Glance;
use crate::dataset::{card, croissant, statistics};
use crate::spec::Draw;
use crate::store::{encode as encode_artifact, encode_pieces};

impl Building<'_> {
    pub(super) fn manifest(&self, state: &State) -> Manifest {
        let (spec, dataset) = (&self.plan.spec, &self.dataset.spec);
        let mut rejects: BTreeMap<String, u64> = BTreeMap::new();
        let (_, draw) = self.plan.draw_of(self.dataset.draws).expect("the stage draws");
        rejects.extend(draw.skipped.iter().map(|(reason, n)| (format!("only: {reason}"), *n)));
        for (reason, n) in state.points.rejects() {
            *rejects.entry(reason).or_default() += n;
        }
        // A build that is killed now finds the shards again that it did not come to.
        let place = |shard: &ShardOf| (self.dataset.splits.iter().position(|s| s.name == shard.split), shard.number);
        let mut shards: Vec<ShardOf> = state.shards.iter().chain(state.before.values()).cloned().collect();
        shards.sort_by_key(place);
        Manifest {
            format: FORMAT,
            turbid_version: env!("CARGO_PKG_VERSION").to_owned(),
            pipeline: spec.pipeline.clone(),
            dataset: dataset.name.clone(),
            about: dataset.about.clone().or_else(|| spec.about.clone()),
            license: dataset.license.clone(),
            cite: dataset.cite.clone(),
            published: dataset.published.clone(),
            seed: spec.seed,
            resolved: spec.resolved(),
            columns: state.columns.clone().unwrap_or_else(|| state.columns_before.clone()),
            shard_format: self.format,
            shards,
            rejects,
            files: BTreeMap::new(),
        }
    }

    /// Index, statistics, card and manifest, in this order.
    pub(super) fn finish(&self, folder: &Folder, columns: &[ColumnOf], mut state: State) -> Result<Built, Stopped> {
        let failed = Stopped::Failed;
        // Those of points that are no longer asked for.
        state.before.clear();
        let (_, draw) = self.plan.draw_of(self.dataset.draws).expect("the stage draws");
        let table = |table| encode_artifact(&Artifact::Table(table)).map_err(|e| Stopped::Failed(e.to_string()));
        let mut manifest = self.manifest(&state);
        let names: Vec<String> = state.shards.iter().map(|shard| shard.file.clone()).collect();
        let write = |name: &str, bytes: &[u8], manifest: &mut Manifest| -> Result<(), Stopped> {
            let of = folder.write(name, bytes).map_err(failed)?;
            manifest.files.insert(name.to_owned(), of);
            Ok(())
        };
        let rows = self.statistics(columns, &state).map_err(Stopped::Failed)?;
        let of = self.dataset.splits.iter().map(|s| (s.name.clone(), s.indices.len().div_ceil(self.dataset.spec.rows)));
        let of: Vec<(String, usize)> = of.collect();
        let index = encode_pieces(state.points.tables(draw, self.group(draw), (&of, self.format)));
        write("index.parquet", &index.map_err(|e| Stopped::Failed(e.to_string()))?, &mut manifest)?;
        write("statistics.parquet", &table(statistics::table(&rows))?, &mut manifest)?;
        let splits: Vec<(String, u64)> = self
            .dataset
            .splits
            .iter()
            .map(|split| {
                (split.name.clone(), state.shards.iter().filter(|s| s.split == split.name).map(|s| s.rows).sum())
            })
            .collect();
        let names_of: Vec<String> = self.dataset.splits.iter().map(|split| split.name.clone()).collect();
        let glance = Glance::of(folder, &manifest, &state.points, draw, &names_of).map_err(Stopped::Failed)?;
        write("overview.png", &glance.picture(&manifest, &splits), &mut manifest)?;
        write("README.md", card::text(&manifest, &splits, &rows).as_bytes(), &mut manifest)?;
        let document = canonical::canonical_text(&croissant::document(&manifest));
        write("croissant.json", document.as_bytes(), &mut manifest)?;
        // Times are of this machine and this day: no digest covers them.
        let costs = encode_pieces(state.points.costs()).map_err(|e| Stopped::Failed(e.to_string()))?;
        folder.write("costs.parquet", &costs).map_err(Stopped::Failed)?;
        folder.keep(&manifest).map_err(Stopped::Failed)?;
        folder.remove_others(&names);
        if let Some(log) = &state.log {
            drop(log.end_of_parts(state.hits, state.ran));
        }
        self.store.finish().map_err(|e| Stopped::Failed(e.to_string()))?;
        Ok(Built {
            samples: splits.iter().map(|(_, n)| n).sum(),
            rejects: manifest.rejects,
            hits: state.hits,
            ran: state.ran,
            cpu_s: state.points.all().iter().map(|point| point.cpu_s).sum(),
            bytes: state.shards.iter().map(|shard| shard.bytes).sum(),
        })
    }

    fn statistics(&self, columns: &[ColumnOf], state: &State) -> Result<Vec<statistics::Row>, String> {
        let (_, draw) = self.plan.draw_of(self.dataset.draws).expect("the stage draws");
        let quantiles = self.quantiles(draw, state)?;
        let drawn: Vec<&str> = draw.names().collect();
        let mut rows = Vec::new();
        for split in self.dataset.splits.iter() {
            let Some(of) = state.moments.get(&split.name) else { continue };
            for (number, (column, of)) in columns.iter().zip(of).enumerate() {
                let drawn = number.checked_sub(3).and_then(|number| drawn.get(number));
                let known = drawn.and_then(|&name| quantiles.get(&(split.name.clone(), name.to_owned())));
                rows.extend(of.iter().enumerate().map(|(place, moments)| statistics::Row {
                    split: split.name.clone(),
                    column: column.name.clone(),
                    channel: column.channels.get(place).cloned().unwrap_or_default(),
                    unit: column.unit.clone(),
                    moments: *moments,
                    quantiles: known.copied().unwrap_or_default(),
                }));
            }
        }
        Ok(rows)
    }

    /// Of what is drawn as a number: quantiles of the samples that are kept. One column of one split is held at a time.
    fn quantiles(&self, draw: &Draw, state: &State) -> Result<Quantiles, String> {
        let mut quantiles = Quantiles::new();
        for (split, of) in self.dataset.splits.iter().enumerate() {
            let kept = |point: &&Point| usize::from(point.shard.0) == split && point.row.is_ok();
            for (place, (name, kind)) in draw.names().zip(draw.types()).enumerate() {
                if kind == Type::Text || !HAS_QUANTILES {
                    continue;
                }
                let value = |point: &Point| draw.point(point.index).ok()?.get(place)?.as_f64();
                let values = state.points.all().iter().filter(kept).map(value).collect();
                quantiles.insert((of.name.clone(), name.to_owned()), quantiles_of(name, values)?);
            }
        }
        Ok(quantiles)
    }
}

/// Quantiles of numbers by split and column; none without polars.
type Quantiles = BTreeMap<(String, String), [Option<f64>; statistics::QUANTILES.len()]>;

#[cfg(feature = "tables")]
const HAS_QUANTILES: bool = true;
#[cfg(not(feature = "tables"))]
const HAS_QUANTILES: bool = false;

#[cfg(feature = "tables")]
fn quantiles_of(name: &str, values: Vec<Option<f64>>) -> Result<[Option<f64>; statistics::QUANTILES.len()], String> {
    crate::dataset::tables::quantiles(name, values)
}

#[cfg(not(feature = "tables"))]
fn quantiles_of(_: &str, _: Vec<Option<f64>>) -> Result<[Option<f64>; statistics::QUANTILES.len()], String> {
    Ok(Default::default())
}
