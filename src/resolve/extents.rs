//! How large artifacts are, or are going to be, and how that flows through the graph: what memory is reckoned from.

use std::collections::BTreeMap;
use std::sync::Arc;

use turbid_contract::{Extent, StagePlan};

use super::{AllOutputs, Resolver};
use crate::plan::{InstanceId, Wire};

/// The sizes of an instance's outputs, as far as they are known.
pub(super) type Sizes = BTreeMap<String, Extent>;

impl Resolver<'_> {
    /// The sizes of the artifacts on the input ports; of many the largest, for one is held at a time.
    pub(super) fn extents_of_inputs(&self, id: InstanceId, outputs: &AllOutputs) -> Sizes {
        let largest = |wire: &Wire| {
            let of = |(source, port): &(InstanceId, &str)| self.extent(*source, port, outputs);
            Some((wire.port.to_owned(), wire.from.iter().filter_map(of).max_by_key(|extent| extent.bytes())?))
        };
        self.plan.wires(id).iter().filter_map(largest).collect()
    }

    /// Remembers what a stage says of its outputs before it runs: those that read them are looked at later.
    pub(super) fn note_extents(&self, id: InstanceId, plan: &StagePlan) {
        if !plan.makes.is_empty() && self.is_read(id) {
            let sizes: Sizes = plan.makes.iter().map(|(port, extent)| ((*port).to_owned(), *extent)).collect();
            let mut extents = self.extents.lock().expect("no holder panics");
            // Those of a sweep are mostly equal.
            let known = id.before().and_then(|before| extents.get(&before)).filter(|known| ***known == sizes).cloned();
            extents.insert(id, known.unwrap_or_else(|| Arc::new(sizes)));
        }
    }

    /// The size of an output: as its stage foresees it, or as it is in memory or in the store.
    fn extent(&self, id: InstanceId, port: &str, outputs: &AllOutputs) -> Option<Extent> {
        let kept = self.instant.lock().expect("no holder panics").get(&id).cloned();
        if let Some(artifact) = kept.as_ref().and_then(|ports| ports.get(port)) {
            return Some(artifact.artifact().extent());
        }
        let known = |port: &str| {
            let extents = self.extents.lock().expect("no holder panics");
            extents.get(&id).and_then(|sizes| sizes.get(port)).copied()
        };
        let foreseen = || self.form(id, port).and_then(|form| form.extent());
        known(port).or_else(foreseen).or_else(|| {
            let extent = self.store.extent(outputs[id].as_ref()?.get(port)?)?;
            let mut extents = self.extents.lock().expect("no holder panics");
            Arc::make_mut(extents.entry(id).or_default()).insert(port.to_owned(), extent);
            Some(extent)
        })
    }
}
