//! Inputs of a running instance: loaded from the store when asked for, dropped by the stage when done.

use std::collections::HashMap;
use std::sync::{Arc, Mutex};

use turbid_contract::{Artifact, Axes, Error, InputSource};

use crate::panics::lock;
use crate::plan::{InstanceId, Plan, Wire};
use crate::resolve::Outputs;
use crate::store::Store;

pub struct StoredInputs<'a> {
    pub plan: &'a Plan,
    pub store: &'a Store,
    pub wires: &'a [Wire],
    pub outputs: HashMap<InstanceId, Arc<Outputs>>,
    /// The producer of a blob that turned out damaged.
    pub damaged: Mutex<Option<InstanceId>>,
}

impl StoredInputs<'_> {
    fn wire(&self, port: &str) -> Option<&Wire> {
        self.wires.iter().find(|w| w.port == port)
    }
}

impl InputSource for StoredInputs<'_> {
    fn one(&self, port: &str) -> Result<Option<Artifact>, Error> {
        match self.wire(port) {
            Some(_) => self.load(port, 0).map(Some),
            None => Ok(None),
        }
    }

    fn many(&self, port: &str) -> Vec<Axes> {
        let from = self.wire(port).map_or(&[][..], |w| &w.from);
        from.iter().map(|(id, _)| self.plan.values(*id).into_owned()).collect()
    }

    fn load(&self, port: &str, index: usize) -> Result<Artifact, Error> {
        let (producer, out) = self.wire(port).expect("a stage asks for its own ports").from[index];
        let blob = &self.outputs[&producer][out];
        self.store.get(blob).map_err(|error| {
            if error.is_lost_blob() {
                *lock(&self.damaged) = Some(producer);
            }
            Error::failed(format!("input `{port}`: {error}"))
        })
    }
}
