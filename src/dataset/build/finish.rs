//! What stands beside the shards: manifest, index, statistics, card, Croissant, costs.

use std::collections::BTreeMap;

use turbid_contract::{Artifact, Table, canonical};

use super::{Building, Built, State, Stopped};
use crate::dataset::folder::Folder;
use crate::dataset::manifest::{ColumnOf, FORMAT, Manifest};
use crate::dataset::{card, croissant, index, statistics};
use crate::store::encode as encode_artifact;

impl Building<'_> {
    pub(super) fn manifest(&self, state: &State) -> Manifest {
        let (spec, dataset) = (&self.plan.spec, &self.dataset.spec);
        let mut rejects: BTreeMap<String, u64> = BTreeMap::new();
        let (_, draw) = self.plan.draw_of(self.dataset.draws).expect("the stage draws");
        rejects.extend(draw.skipped.iter().map(|(reason, n)| (format!("only: {reason}"), *n)));
        for entry in state.entries.values().filter(|entry| !entry.reject.is_empty()) {
            *rejects.entry(entry.reject.clone()).or_default() += 1;
        }
        Manifest {
            format: FORMAT,
            turbid_version: env!("CARGO_PKG_VERSION").to_owned(),
            pipeline: spec.pipeline.clone(),
            dataset: dataset.name.clone(),
            about: dataset.about.clone().or_else(|| spec.about.clone()),
            license: dataset.license.clone(),
            cite: dataset.cite.clone(),
            seed: spec.seed,
            resolved: spec.resolved(),
            columns: state.columns.clone().unwrap_or_default(),
            shards: state.shards.clone(),
            rejects,
            files: BTreeMap::new(),
        }
    }

    /// Index, statistics, card and manifest, in this order.
    pub(super) fn finish(&self, folder: &Folder, columns: &[ColumnOf], state: State) -> Result<Built, Stopped> {
        let failed = Stopped::Failed;
        let (_, draw) = self.plan.draw_of(self.dataset.draws).expect("the stage draws");
        let table = |table| encode_artifact(&Artifact::Table(table)).map_err(|e| Stopped::Failed(e.to_string()));
        let mut manifest = self.manifest(&state);
        let names: Vec<String> = state.shards.iter().map(|shard| shard.file.clone()).collect();
        let write = |name: &str, bytes: &[u8], manifest: &mut Manifest| -> Result<(), Stopped> {
            let of = folder.write(name, bytes).map_err(failed)?;
            manifest.files.insert(name.to_owned(), of);
            Ok(())
        };
        let index = index::table(draw, &state.entries);
        let rows = self.statistics(columns, &state, &index).map_err(Stopped::Failed)?;
        write("index.parquet", &table(index)?, &mut manifest)?;
        write("statistics.parquet", &table(statistics::table(&rows))?, &mut manifest)?;
        let splits: Vec<(String, u64)> = self
            .dataset
            .splits
            .iter()
            .map(|split| {
                (split.name.clone(), state.shards.iter().filter(|s| s.split == split.name).map(|s| s.rows).sum())
            })
            .collect();
        write("README.md", card::text(&manifest, &splits, &rows).as_bytes(), &mut manifest)?;
        let document = canonical::canonical_text(&croissant::document(&manifest));
        write("croissant.json", document.as_bytes(), &mut manifest)?;
        // Times are of this machine and this day: no digest covers them.
        folder.write("costs.parquet", &table(index::costs(&state.entries))?).map_err(Stopped::Failed)?;
        folder.keep(&manifest).map_err(Stopped::Failed)?;
        folder.remove_others(&names);
        Ok(Built {
            samples: splits.iter().map(|(_, n)| n).sum(),
            rejects: manifest.rejects,
            hits: state.hits,
            ran: state.ran,
            cpu_s: state.entries.values().map(|entry| entry.cpu_s).sum(),
            bytes: state.shards.iter().map(|shard| shard.bytes).sum(),
        })
    }

    fn statistics(&self, columns: &[ColumnOf], state: &State, index: &Table) -> Result<Vec<statistics::Row>, String> {
        let quantiles = quantiles(index)?;
        let (_, draw) = self.plan.draw_of(self.dataset.draws).expect("the stage draws");
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
}

/// Quantiles of numbers by split and column; none without polars.
type Quantiles = BTreeMap<(String, String), [Option<f64>; statistics::QUANTILES.len()]>;

#[cfg(feature = "tables")]
fn quantiles(index: &Table) -> Result<Quantiles, String> {
    let known = crate::dataset::tables::of_kept(index)?;
    Ok(known.into_iter().map(|of| ((of.split, of.column), of.quantiles)).collect())
}

#[cfg(not(feature = "tables"))]
fn quantiles(_: &Table) -> Result<Quantiles, String> {
    Ok(Quantiles::new())
}
