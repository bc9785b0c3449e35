//! Names under which the latest record is asked for: by whoever says why an instance runs, or how long it will take.

use serde::Deserialize;
use serde_json::Value;
use turbid_contract::Axes;

use crate::digest::{Digest, PartHasher};
use crate::store::place::Named;
use crate::store::record::{self, InstanceRecord};

/// What tells the instances of all pipelines apart for people.
#[derive(Clone, Copy, Debug)]
pub struct Label<'a> {
    /// Name of the stage's kind.
    pub use_name: &'a str,
    pub pipeline: &'a str,
    /// Name of the stage in the pipeline.
    pub stage: &'a str,
    pub axes: &'a Axes,
}

impl Label<'_> {
    pub(super) fn digest(&self) -> Digest {
        let mut parts = PartHasher::new("turbid label 1");
        parts.add("use", self.use_name.as_bytes());
        parts.add("pipeline", self.pipeline.as_bytes());
        parts.add("stage", self.stage.as_bytes());
        self.axes.iter().for_each(|(name, value)| parts.add(name, text(value).as_bytes()));
        parts.finish()
    }

    /// Of the instance that a record was made for.
    pub(super) fn of(record: &InstanceRecord) -> Label<'_> {
        let from = &record.provenance;
        Label { use_name: &record.use_name, pipeline: &from.pipeline, stage: &from.stage, axes: &from.axes }
    }
}

/// Numbers by value: 1 and 1.0 are one point.
fn text(value: &Value) -> String {
    match (value.as_i64(), value.as_f64(), value.as_str()) {
        (None, Some(number), _) if number.fract() == 0.0 && number.abs() < 1e15 => format!("{number:.0}"),
        (_, _, Some(text)) => text.to_owned(),
        _ => value.to_string(),
    }
}

/// The digest by which the latest record of a kind of stage is found.
pub(super) fn kind(use_name: &str) -> Digest {
    PartHasher::new("turbid kind of stage 1").part("use", use_name.as_bytes()).finish()
}

/// All names of a record but its key.
pub(super) fn of_payload(payload: &[u8]) -> Vec<(Named, Digest)> {
    #[derive(Deserialize)]
    struct Head {
        use_name: String,
        state_key: Option<Digest>,
        provenance: Origin,
    }
    #[derive(Deserialize)]
    struct Origin {
        pipeline: String,
        stage: String,
        axes: Axes,
    }
    let head = record::head_end(payload).and_then(|end| payload.get(record::LEAD..end));
    let Some(head) = head.and_then(|head| serde_json::from_slice::<Head>(head).ok()) else { return Vec::new() };
    let Origin { pipeline, stage, axes } = &head.provenance;
    let label = Label { use_name: &head.use_name, pipeline, stage, axes };
    let named = [(Named::Label, label.digest()), (Named::Kind, kind(&head.use_name))];
    named.into_iter().chain(head.state_key.map(|key| (Named::Work, key))).collect()
}
