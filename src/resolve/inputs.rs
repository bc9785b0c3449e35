//! Inputs of an instant stage during check and plan.

use turbid_contract::{Artifact, Axes, Error, InputSource};

use super::{AllOutputs, Resolver};
use crate::plan::Wire;

/// Those that the store, or an instant stage before it, has by now.
pub(super) struct KnownInputs<'a> {
    pub resolver: &'a Resolver<'a>,
    pub wires: Vec<Wire>,
    pub outputs: &'a AllOutputs,
}

impl InputSource for KnownInputs<'_> {
    fn one(&self, port: &str) -> Result<Option<Artifact>, Error> {
        match self.wires.iter().find(|w| w.port == port) {
            Some(_) => self.load(port, 0).map(Some),
            None => Ok(None),
        }
    }

    fn many(&self, port: &str) -> Vec<Axes> {
        let from = self.wires.iter().find(|w| w.port == port).map_or(&[][..], |w| &w.from);
        from.iter().map(|(id, _)| self.resolver.plan.values(*id)).collect()
    }

    fn load(&self, port: &str, index: usize) -> Result<Artifact, Error> {
        let wire = self.wires.iter().find(|w| w.port == port).expect("the stage asks for its own ports");
        let (id, out) = wire.from[index];
        let artifact = self.resolver.artifact(id, out, self.outputs);
        artifact.map(|a| a.artifact().clone()).ok_or_else(|| Error::failed(format!("input `{port}` cannot be read")))
    }
}
