//! Results whose bytes were released: up to date, until somebody needs the bytes.

use std::collections::{BTreeSet, HashMap};

use turbid_contract::Shared;

use super::{AllOutputs, Resolver, State, Survey};
use crate::brief::Outputs;
use crate::digest::DigestMap;
use crate::panics::lock;
use crate::plan::InstanceId;
use crate::warned::Warned;

/// The ports of which somebody needs the bytes.
pub(super) type Asked = HashMap<InstanceId, BTreeSet<String>>;

impl Resolver<'_> {
    /// From now on an instance is up to date only if the bytes of this output are there.
    pub fn ask(&self, id: InstanceId, port: &str) {
        lock(&self.asked).entry(id).or_default().insert(port.to_owned());
    }

    /// The ports that were asked for and whose bytes were released.
    pub fn released(&self, id: InstanceId, outputs: &Outputs) -> Vec<String> {
        if !self.store.has_released() {
            return Vec::new();
        }
        let asked = lock(&self.asked);
        let ports = asked.get(&id).into_iter().flatten();
        ports.filter(|port| outputs.get(port).is_some_and(|blob| self.store.is_released(blob))).cloned().collect()
    }

    /// What runs needs the bytes of its inputs: where they were released, those that made them run again, and so on.
    pub(super) fn survey_released(
        &self,
        asked: Asked,
        survey: &mut Survey,
        first_of: &mut DigestMap<InstanceId>,
        warned: &mut Warned,
    ) {
        *lock(&self.asked) = asked;
        if !self.store.has_released() {
            return;
        }
        let ids: Vec<InstanceId> = self.plan.needed_instances().collect();
        // Those that read an output come behind those that make it.
        for &id in ids.iter().rev() {
            if let Some(State::Hit(brief)) = &survey.states[id] {
                if self.released(id, &brief.outputs).is_empty() {
                    continue;
                }
                let looked = self.look(id, &survey.outputs, false, true);
                self.enter(id, looked, survey, first_of, warned);
            }
            if survey.states[id].is_some() {
                for (source, port) in self.plan.sources(id) {
                    let hit = matches!(&survey.states[source], Some(State::Hit(brief))
                        if brief.outputs.get(port).is_some_and(|blob| self.store.is_released(blob)));
                    if hit {
                        self.ask(source, port);
                    }
                }
            }
        }
    }

    /// An output of an instant stage whose bytes were released: in memory, as where it never ran.
    pub(super) fn made_again(&self, id: InstanceId, port: &str, outputs: &AllOutputs) -> Option<Shared> {
        let blob = outputs[id].as_ref()?.get(port)?;
        if !self.plan.row(self.plan.stage_of(id)).instant || !self.store.is_released(blob) {
            return None;
        }
        let keyed = self.keyed(id, outputs).ok()?;
        self.run_instant(id, &keyed, outputs).ok()?;
        lock(&self.instant).get(&id)?.get(port).cloned()
    }
}
