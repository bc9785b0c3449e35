//! What is kept in memory of a result: what its record says, but for its words. Of a million results no million records are held.

use std::ops::Index;
use std::sync::Arc;

use turbid_contract::OutPort;

use crate::digest::Digest;
use crate::store::{Blob, Cost, InstanceRecord};

/// Measures whose names begin so stand for a stage's error in the summary,
pub const ERROR: &str = "error: ";
/// and those that begin so for what has no error: how many of a thing nothing is known of.
pub const UNKNOWN: &str = "unknown: ";

/// A figure with its unit.
pub type Measure = (String, f64, String);

/// The blobs of an instance, sorted by port.
#[derive(Clone, Debug, PartialEq)]
pub struct Outputs(Arc<[(&'static str, Blob)]>);

impl Outputs {
    /// Those of a record that the stage has ports for; an older turbid may have had others.
    pub fn of(record: &InstanceRecord, ports: &[OutPort]) -> Self {
        let known = |name: &str| ports.iter().find(|port| port.name == name).map(|port| port.name);
        record.ports.iter().filter_map(|(name, port)| Some((known(name)?, port.blob))).collect()
    }

    pub fn get(&self, port: &str) -> Option<&Blob> {
        self.0.iter().find(|(name, _)| *name == port).map(|(_, blob)| blob)
    }

    pub fn has(&self, port: &str) -> bool {
        self.get(port).is_some()
    }

    pub fn iter(&self) -> impl ExactSizeIterator<Item = (&'static str, &Blob)> {
        self.0.iter().map(|(name, blob)| (*name, blob))
    }
}

impl FromIterator<(&'static str, Blob)> for Outputs {
    fn from_iter<I: IntoIterator<Item = (&'static str, Blob)>>(blobs: I) -> Self {
        let mut blobs: Vec<(&'static str, Blob)> = blobs.into_iter().collect();
        blobs.sort_by_key(|(name, _)| *name);
        Self(blobs.into())
    }
}

impl Index<&str> for Outputs {
    type Output = Blob;
    fn index(&self, port: &str) -> &Blob {
        self.get(port).unwrap_or_else(|| panic!("there is no output {port}"))
    }
}

/// A result.
#[derive(Clone, Debug, PartialEq)]
pub struct Brief {
    pub key: Digest,
    pub outputs: Outputs,
    pub cost: Cost,
    /// The measures of its error, and of what it knows nothing.
    errors: Option<Box<[Measure]>>,
}

impl Brief {
    /// `ports`: the outputs of the stage.
    pub fn of(record: &InstanceRecord, ports: &[OutPort]) -> Self {
        let tells = |name: &str| name.starts_with(ERROR) || name.starts_with(UNKNOWN);
        let errors: Box<[Measure]> = record.measures.iter().filter(|measure| tells(&measure.0)).cloned().collect();
        let errors = (!errors.is_empty()).then_some(errors);
        Self { key: record.key, outputs: Outputs::of(record, ports), cost: record.cost, errors }
    }

    /// The same result, which another instance made: at no cost.
    pub fn shared(&self) -> Self {
        Self { cost: Cost::default(), ..self.clone() }
    }

    pub fn errors(&self) -> &[Measure] {
        self.errors.as_deref().unwrap_or_default()
    }
}
