//! The list of a stage of many instances: what each is, and how to get at what it holds.

use std::sync::Arc;

use turbid_contract::{Artifact, Cells, Table};

use crate::digest::PartHasher;
use crate::key::value_text;
use crate::plan::{InstanceId, Plan};
use crate::store::{Blob, InstanceRecord, Store, encode};

use super::Command;

/// The instances of one stage, at least one.
pub struct List<'a> {
    pub plan: &'a Plan,
    pub store: &'a Store,
    pub records: &'a [(InstanceId, &'a Arc<InstanceRecord>)],
    pub command: &'a Command,
}

impl List<'_> {
    /// Tells lists apart without making them.
    pub fn fingerprint(&self) -> String {
        let mut parts = PartHasher::new("turbid instances 2");
        parts.add("command", self.command.all("", "", &[]).as_bytes());
        for (_, record) in self.records {
            parts.add("key", &record.key.0);
            for (port, described) in &record.ports {
                parts.add(port, &described.blob.digest.0);
            }
        }
        parts.finish().to_string()
    }

    /// A table of one row per instance: its axes, key and seconds; of each port the digest, the path of its file in the store (empty where it has
    /// none of its own) and the command that writes it as a file.
    pub fn encode(&self) -> Result<Vec<u8>, String> {
        let Self { plan, store, records, command } = self;
        let mut table = Table::default();
        let instance = &plan.instances[records[0].0];
        let known: Vec<_> = records.iter().map(|(id, _)| plan.values(*id)).collect();
        for name in known[0].keys() {
            let values = || known.iter().map(|values| &values[name]);
            let cells = match values().map(|v| v.as_f64()).collect::<Option<Vec<f64>>>() {
                Some(numbers) => Cells::F64(numbers),
                None => Cells::Text(values().map(value_text).collect()),
            };
            table.push(name.clone(), "", cells);
        }
        table.push("key", "", Cells::Text(records.iter().map(|(_, r)| r.key.to_string()).collect()));
        table.push("seconds", "s", Cells::F64(records.iter().map(|(_, r)| r.cost.wall_s).collect()));
        for port in records[0].1.ports.keys() {
            let stage = &plan.spec.stages[instance.stage].name;
            let texts = |text: &dyn Fn(InstanceId, &Blob) -> String| {
                let cell = |(id, record): &(InstanceId, &Arc<InstanceRecord>)| {
                    record.ports.get(port).map_or_else(String::new, |described| text(*id, &described.blob))
                };
                Cells::Text(records.iter().map(cell).collect())
            };
            let path = |blob: &Blob| store.file_of(blob).map(|path| path.display().to_string()).unwrap_or_default();
            table.push(format!("{port}.digest"), "", texts(&|_, blob| blob.digest.to_string()));
            table.push(format!("{port}.path"), "", texts(&|_, blob| path(blob)));
            let axes = |id: InstanceId| &plan.instances[id].axes;
            table.push(format!("{port}.export"), "", texts(&|id, _| command.one(stage, axes(id), port)));
        }
        encode(&Artifact::Table(table)).map_err(|e| e.to_string())
    }
}
