//! A plan whose instances are dealt out to shards, as `turbid run --shard` deals them out.

use std::collections::{HashMap, HashSet};
use std::mem::ManuallyDrop;

use crate::dataset::DatasetPlan;
use crate::ids::InstanceId;
use crate::plan::Plan;
use crate::plan::shard::{Home, Shard, Split};
use crate::spec::DRAW_AXIS;

/// A plan, and what its instances are dealt out by.
pub struct Dealt {
    pub plan: ManuallyDrop<Plan>,
    by: By,
}

enum By {
    /// Chains of instances.
    Chains,
    /// Samples of a data set: the place of each raw index among all of them.
    Samples(HashMap<u64, usize>),
}

impl Dealt {
    pub fn by_chains(plan: ManuallyDrop<Plan>) -> Self {
        Self { plan, by: By::Chains }
    }

    /// `plan` is that of all samples.
    pub fn by_samples(plan: Plan, dataset: &DatasetPlan) -> Self {
        let indices = dataset.splits.iter().flat_map(|split| split.indices.iter().copied());
        Self { plan: ManuallyDrop::new(plan), by: By::Samples(indices.zip(0..).collect()) }
    }

    /// Where each needed instance belongs.
    pub fn homes(&self, of: u32) -> Vec<(InstanceId, Home)> {
        let By::Samples(places) = &self.by else { return Split::of(&self.plan, of).homes().collect() };
        let shards = by_place(places.len(), of);
        let home = |id: InstanceId| {
            let index = self.plan.axis(id, DRAW_AXIS).and_then(serde_json::Value::as_u64);
            let place = index.and_then(|index| places.get(&index));
            place.map_or(Home::Shared, |place| Home::Shard(shards[*place]))
        };
        self.plan.needed_instances().map(|id| (id, home(id))).collect()
    }

    /// Notes which shards run any of these instances.
    pub fn mark(&self, stale: &HashSet<InstanceId>, shards: &mut [bool]) {
        for (id, home) in self.homes(shards.len() as u32) {
            if let Home::Shard(shard) = home {
                shards[shard as usize] |= stale.contains(&id);
            }
        }
    }
}

/// The shard (from 0) of each of so many things in a row.
pub fn by_place(count: usize, of: u32) -> Vec<u32> {
    (1..=of).flat_map(|number| (Shard { number, of }).block(count).map(move |_| number - 1)).collect()
}
