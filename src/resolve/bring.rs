//! What a store elsewhere has of a plan, brought in with few requests before anything is looked at one by one.

use rayon::prelude::*;

use super::{AllOutputs, BLOCK, FEW, Keyed, Resolver};
use crate::brief::Outputs;
use crate::digest::Digest;
use crate::plan::InstanceId;
use crate::store::{Pulled, StoreError};
use crate::threads;

impl Resolver<'_> {
    /// Brings in the records of all instances that are up to date here or elsewhere, stage by stage: the digests of one stage make the keys of the next. Their keys, and what was brought.
    ///
    /// Mistakes of the pipeline are left to the survey. Error: the store elsewhere cannot be read, or the local one not be written.
    pub fn bring(&self) -> Result<(Vec<Digest>, Pulled), StoreError> {
        let mut outputs = AllOutputs::filled(None, self.plan.instances().len());
        let (mut found, mut pulled) = (Vec::new(), Pulled::default());
        for &stage in &self.plan.needed {
            let ids: Vec<InstanceId> = self.plan.instances_of(stage).collect();
            for block in ids.chunks(BLOCK) {
                let key = |&id: &InstanceId| self.key_if_known(id, &outputs);
                let keyed: Vec<Option<Keyed>> = if block.len() < FEW || !threads::shared() {
                    block.iter().map(key).collect()
                } else {
                    block.par_iter().map(key).collect()
                };
                let keys: Vec<Digest> = keyed.iter().flatten().map(|keyed| keyed.key).collect();
                pulled += self.store.bring_records(&keys)?;
                let here = block.iter().zip(keyed).filter_map(|(&id, keyed)| Some((id, keyed?)));
                let here: Vec<(InstanceId, Option<Digest>, Outputs)> =
                    here.filter_map(|(id, keyed)| self.outputs_now(id, &keyed, &outputs)).collect();
                for (id, key, made) in here {
                    found.extend(key);
                    outputs[id] = Some(made);
                }
            }
        }
        Ok((found, pulled))
    }

    /// The key of an instance whose inputs are known.
    fn key_if_known(&self, id: InstanceId, outputs: &AllOutputs) -> Option<Keyed> {
        let mut sources = self.plan.sources(id);
        let known = sources.all(|(source, port)| outputs[source].as_ref().is_some_and(|made| made.has(port)));
        known.then(|| self.keyed(id, outputs).ok()).flatten()
    }

    /// What an instance made, and its key where a record says so; instant stages are run in memory otherwise.
    fn outputs_now(
        &self,
        id: InstanceId,
        keyed: &Keyed,
        outputs: &AllOutputs,
    ) -> Option<(InstanceId, Option<Digest>, Outputs)> {
        let stage = self.plan.stage_of(id);
        if let Some(record) = self.store.record(&keyed.key) {
            return Some((id, Some(keyed.key), Outputs::of(&record, self.plan.outputs(stage))));
        }
        let consumed = self.plan.row(stage).instant && !self.plan.consumers(stage).is_empty();
        let made = consumed.then(|| self.run_instant(id, keyed, outputs).ok()).flatten()?;
        Some((id, None, made))
    }
}
