//! The list of a stage of many instances: what each is, and how to get at what it holds.

use std::sync::Arc;

use serde_json::Value;
use turbid_contract::{Axes, Cells, Table};

use crate::brief::Brief;
use crate::digest::PartHasher;
use crate::key::value_text;
use crate::plan::{InstanceId, Plan};
use crate::store::{Blob, Store, encode_pieces};

use super::Command;

/// Rows that are held in memory at a time.
const PIECE: usize = 1 << 16;

type Row<'a> = (InstanceId, &'a Arc<Brief>);

/// The instances of one stage, at least one.
pub struct List<'a> {
    pub plan: &'a Plan,
    pub store: &'a Store,
    pub made: &'a [Row<'a>],
    pub command: &'a Command,
}

impl List<'_> {
    /// Tells lists apart without making them.
    pub fn fingerprint(&self) -> String {
        let mut parts = PartHasher::new("turbid instances 2");
        parts.add("command", self.command.all("", "", &[]).as_bytes());
        for (_, brief) in self.made {
            parts.add("key", &brief.key.0);
            for (port, blob) in brief.outputs.iter() {
                parts.add(port, &blob.digest.0);
            }
        }
        parts.finish().to_string()
    }

    /// A table of one row per instance: its axes, key and seconds; of each port the digest, the path of its file in the store (empty where it has
    /// none of its own) and the command that writes it as a file.
    pub fn encode(&self) -> Result<Vec<u8>, String> {
        // A column is one of numbers where all its values are.
        let values = |row: &Row<'_>| self.plan.values(row.0);
        let mut numbers: Vec<(String, bool)> = values(&self.made[0]).into_keys().map(|name| (name, true)).collect();
        for values in self.made.iter().map(values) {
            for (name, all) in &mut numbers {
                *all &= values[name.as_str()].as_f64().is_some();
            }
        }
        encode_pieces(self.made.chunks(PIECE).map(|rows| self.piece(rows, &numbers))).map_err(|e| e.to_string())
    }

    fn piece(&self, rows: &[Row<'_>], numbers: &[(String, bool)]) -> Table {
        let Self { plan, store, made, command } = self;
        let mut table = Table::default();
        let known: Vec<Axes> = rows.iter().map(|(id, _)| plan.values(*id)).collect();
        for (name, all) in numbers {
            let values = known.iter().map(|values| &values[name]);
            let cells = match all {
                true => Cells::F64(values.filter_map(Value::as_f64).collect()),
                false => Cells::Text(values.map(value_text).collect()),
            };
            table.push(name.clone(), "", cells);
        }
        table.push("key", "", Cells::Text(rows.iter().map(|(_, brief)| brief.key.to_string()).collect()));
        table.push("seconds", "s", Cells::F64(rows.iter().map(|(_, brief)| brief.cost.wall_s).collect()));
        let stage = plan.stage_name(made[0].0);
        for (port, _) in made[0].1.outputs.iter() {
            let texts = |text: &dyn Fn(InstanceId, &Blob) -> String| {
                let cell = |(id, brief): &Row<'_>| brief.outputs.get(port).map_or_else(String::new, |b| text(*id, b));
                Cells::Text(rows.iter().map(cell).collect())
            };
            let path = |blob: &Blob| store.file_of(blob).map(|path| path.display().to_string()).unwrap_or_default();
            table.push(format!("{port}.digest"), "", texts(&|_, blob| blob.digest.to_string()));
            table.push(format!("{port}.path"), "", texts(&|_, blob| path(blob)));
            let export = |id| command.one(stage, &plan.axes_text(id), port);
            table.push(format!("{port}.export"), "", texts(&|id, _| export(id)));
        }
        table
    }
}
