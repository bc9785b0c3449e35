//! What is known of artifacts before anything runs, and how it flows through the graph.

use std::collections::BTreeMap;
use std::sync::Arc;

use turbid_contract::{Attributes, Facts, Known};

use super::{Outputs, Resolver};
use crate::plan::{InstanceId, Wire};

impl Resolver<'_> {
    /// What is known of the artifacts on the input ports; of many artifacts what is known of the first.
    pub(super) fn facts_of_inputs(
        &self,
        id: InstanceId,
        outputs: &[Option<Arc<Outputs>>],
    ) -> BTreeMap<String, Attributes> {
        let first = |wire: &Wire| {
            let (source, port) = wire.from.first()?;
            Some((wire.port.to_owned(), self.facts(*source, outputs).get(port).cloned()?))
        };
        self.plan.instances[id].wires.iter().filter_map(first).collect()
    }

    /// What is known of the outputs of an instance before it runs, whether or not the store holds them.
    fn facts(&self, id: InstanceId, outputs: &[Option<Arc<Outputs>>]) -> Arc<Facts> {
        let known = |id: InstanceId| crate::panics::lock(&self.facts).get(&id).cloned();
        // An explicit stack: a chain of a million stages must not end the process.
        let mut path = vec![id];
        while let Some(&last) = path.last() {
            let mut sources = self.plan.instances[last].wires.iter().filter_map(|w| Some(w.from.first()?.0));
            match sources.find(|&source| known(source).is_none()) {
                Some(source) => path.push(source),
                None => {
                    path.pop();
                    if known(last).is_none() {
                        let facts = Arc::new(self.own_facts(last, outputs));
                        crate::panics::lock(&self.facts).insert(last, facts);
                    }
                }
            }
        }
        known(id).expect("it was worked out")
    }

    /// The same, those of its inputs being known.
    fn own_facts(&self, id: InstanceId, outputs: &[Option<Arc<Outputs>>]) -> Facts {
        let instance = &self.plan.instances[id];
        // Mistakes in params are told where the stage is checked.
        let Ok((params, _)) = self.prepare(id) else { return Facts::new() };
        let mut known =
            Known { connected: instance.wires.iter().map(|w| w.port.to_owned()).collect(), ..Known::default() };
        for wire in &instance.wires {
            if let [(source, port)] = wire.from.as_slice()
                && self.plan.row(self.plan.instances[*source].stage).instant
                && let Some(artifact) = self.artifact(*source, port, outputs)
            {
                known.artifacts.insert(wire.port.to_owned(), artifact);
            }
        }
        known.facts = self.facts_of_inputs(id, outputs);
        (self.plan.row(instance.stage).facts)(&params, &known)
    }
}
