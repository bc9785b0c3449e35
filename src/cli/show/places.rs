//! Where the outputs of an instance lie, for programs that read them themselves.

use std::collections::BTreeMap;

use serde::Serialize;
use turbid_contract::{ArtifactKind, Axes};

use crate::cli::Failure;
use crate::plan::{InstanceId, Plan};
use crate::run::latest::Files;
use crate::store::{InstanceRecord, Store};

/// One instance.
#[derive(Serialize)]
pub struct Places {
    stage: String,
    /// With what a draw gave it.
    axes: Axes,
    key: String,
    /// The output that is meant where none is named.
    first: &'static str,
    ports: BTreeMap<String, Place>,
}

/// One output: its bytes are those of `file` from `offset` on, unless it is released.
#[derive(Serialize)]
struct Place {
    kind: ArtifactKind,
    payload: String,
    digest: String,
    file: Option<String>,
    offset: u64,
    bytes: u64,
    picture: Option<String>,
}

impl Places {
    /// All its ports, or the one of this name. Errors: a store elsewhere cannot be read; an output is not stored.
    pub fn of(
        plan: &Plan,
        store: &Store,
        files: &Files<'_>,
        id: InstanceId,
        record: &InstanceRecord,
        port: Option<&str>,
    ) -> Result<Self, Failure> {
        let mut ports = BTreeMap::new();
        for (name, described) in record.ports.iter().filter(|(name, _)| port.is_none_or(|port| port == *name)) {
            let blob = &described.blob;
            store.bring(blob).map_err(|e| Failure::Failed(e.to_string()))?;
            let (file, offset, bytes) = store.place_of(blob).map_or((None, 0, blob.bytes), |(file, offset, bytes)| {
                (Some(std::path::absolute(&file).unwrap_or(file)), offset, bytes)
            });
            let text = |path: std::path::PathBuf| path.to_string_lossy().into_owned();
            let picture = files.picture(id, &record.key, name, blob).1;
            let picture = picture.map(|path| text(std::path::absolute(&path).unwrap_or(path)));
            let (payload, digest) = (described.payload.clone(), blob.digest.to_string());
            let place = Place { kind: blob.kind, payload, digest, file: file.map(text), offset, bytes, picture };
            ports.insert(name.clone(), place);
        }
        if let Some(port) = port.filter(|_| ports.is_empty()) {
            let (label, stage) = (plan.label(id), &record.provenance.stage);
            return Err(Failure::NotRun(format!(
                "{label} has no output `{port}` stored; ask for it with `turbid run FILE {stage}.{port}`"
            )));
        }
        let stage = plan.stage_of(id);
        let first = plan.outputs(stage).first().map_or("", |port| port.name);
        let stage = plan.spec.stages[stage].name.clone();
        Ok(Self { stage, first, axes: plan.values(id), key: record.key.to_string(), ports })
    }
}
