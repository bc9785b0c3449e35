//! What an instance left in the store, as it is shown: to programs as JSON, to people as [`super::text`].

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Serialize, Serializer};
use serde_json::Value;
use turbid_contract::{Artifact, Attributes, Axes, Record};

use crate::plan::{InstanceId, Plan};
use crate::run::latest::copy_of;
use crate::store::{Blob, InstanceRecord, PortRecord, Store};

use super::super::Failure;
use crate::statistics::{Column, Layer, columns, layers};

/// One instance.
#[derive(Serialize)]
pub struct Shown {
    pub stage: String,
    #[serde(rename = "use")]
    pub use_name: String,
    pub axes: Axes,
    pub key: String,
    pub seconds: f64,
    pub cpu_seconds: f64,
    pub peak_bytes: u64,
    pub alone: bool,
    pub measures: BTreeMap<String, Measure>,
    pub warnings: Vec<String>,
    pub kernel: Option<String>,
    pub refused: Vec<String>,
    pub ports: BTreeMap<String, Port>,
}

#[derive(Serialize)]
pub struct Measure {
    pub value: f64,
    pub unit: String,
}

/// One output.
#[derive(Serialize)]
pub struct Port {
    pub payload: String,
    pub digest: String,
    pub bytes: u64,
    /// A file with these bytes, if there is one.
    pub path: Option<String>,
    #[serde(flatten)]
    pub content: Content,
}

#[derive(Serialize)]
#[serde(untagged)]
pub enum Content {
    Images {
        rows: usize,
        columns: usize,
        layers: Vec<Layer>,
        attributes: Attributes,
    },
    Table {
        rows: usize,
        columns: Vec<Column>,
        attributes: Attributes,
    },
    Record {
        rows: usize,
        fields: BTreeMap<String, Value>,
        columns: Vec<Field>,
    },
    /// The bytes were given back on purpose.
    Released {
        released: bool,
    },
}

/// A field of a record, as a column of one row.
#[derive(Serialize)]
pub struct Field {
    pub name: String,
    unit: &'static str,
    #[serde(flatten)]
    number: Number,
}

/// A number as the range of a column of one row.
struct Number(Option<f64>);

impl Serialize for Number {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        ["min", "mean", "max"].map(|name| (name, self.0)).into_iter().collect::<BTreeMap<_, _>>().serialize(to)
    }
}

/// An instance and where its outputs are.
pub struct Described<'a> {
    pub plan: &'a Plan,
    pub store: &'a Store,
    pub outputs: &'a Path,
    pub id: InstanceId,
    pub record: &'a InstanceRecord,
}

impl Described<'_> {
    /// All its ports, or the one of this name.
    ///
    /// Errors: an output that cannot be read, or that is not stored.
    pub fn shown(&self, port: Option<&str>) -> Result<Shown, Failure> {
        let Self { plan, id, record, .. } = *self;
        let asked = record.ports.iter().filter(|(name, _)| port.is_none_or(|p| p == *name));
        let ports = asked.map(|(name, described)| Ok((name.clone(), self.port(name, described)?)));
        let ports = ports.collect::<Result<BTreeMap<_, _>, Failure>>()?;
        if let Some(port) = port.filter(|_| ports.is_empty()) {
            return Err(Failure::Failed(format!(
                "{} has no output `{port}` stored; ask for it with `run FILE {}.{port}`",
                plan.label(id),
                record.provenance.stage
            )));
        }
        let measure =
            |(name, value, unit): &(String, f64, String)| (name.clone(), Measure { value: *value, unit: unit.clone() });
        Ok(Shown {
            stage: plan.stage_name(id).to_owned(),
            use_name: record.use_name.clone(),
            axes: plan.values(id),
            key: record.key.to_string(),
            seconds: record.cost.wall_s,
            cpu_seconds: record.cost.cpu_s,
            peak_bytes: record.cost.peak_bytes,
            alone: record.cost.alone,
            measures: record.measures.iter().map(measure).collect(),
            warnings: record.warnings.clone(),
            kernel: record.kernel.clone(),
            refused: record.refused.clone(),
            ports,
        })
    }

    fn port(&self, name: &str, described: &PortRecord) -> Result<Port, Failure> {
        let blob = &described.blob;
        let label = self.plan.label(self.id);
        let failed = |e| Failure::Failed(format!("{label}.{name}: {e}; a run makes it again"));
        let content = match self.store.is_released(blob) {
            true => Content::Released { released: true },
            false => Content::of(self.store.get(blob).map_err(failed)?),
        };
        Ok(Port {
            payload: described.payload.clone(),
            digest: blob.digest.to_string(),
            bytes: blob.bytes,
            path: self.path(name, blob),
            content,
        })
    }

    /// A blob in a pack has no file of its own, but people have a copy by name.
    fn path(&self, port: &str, blob: &Blob) -> Option<String> {
        let copy = || copy_of(self.plan, self.id, port, blob, self.outputs);
        self.store.file_of(blob).or_else(copy).map(|path| path.display().to_string())
    }
}

impl Content {
    pub fn of(artifact: Artifact) -> Self {
        match artifact {
            Artifact::Images(stack) => Self::Images {
                rows: stack.rows(),
                columns: stack.columns(),
                layers: layers(&stack),
                attributes: stack.attributes,
            },
            Artifact::Table(table) => {
                Self::Table { rows: table.rows(), columns: columns(&table), attributes: table.attributes }
            }
            Artifact::Record(Record { fields }) => {
                let field = |(name, value): (&String, &Value)| Field {
                    name: name.clone(),
                    unit: "",
                    number: Number(value.as_f64()),
                };
                let columns = fields.iter().map(field).collect();
                Self::Record { rows: 1, fields: fields.into_iter().collect(), columns }
            }
        }
    }
}
