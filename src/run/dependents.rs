//! Which instances wait for which, in two lists for all of them.

use crate::plan::{Id, InstanceId, Plan};

/// The needed instances that read what an instance makes.
#[derive(Default)]
pub struct Dependents {
    /// Those of one instance after those of another.
    ids: Vec<InstanceId>,
    /// Where those of an instance begin; one more at the end.
    starts: Vec<usize>,
}

/// The instances that feed an instance, each once.
pub fn producers(plan: &Plan, id: InstanceId) -> Vec<InstanceId> {
    let mut producers: Vec<InstanceId> = plan.sources(id).map(|(source, _)| source).collect();
    producers.sort_unstable();
    producers.dedup();
    producers
}

impl Dependents {
    pub fn of(plan: &Plan) -> Self {
        let mut starts = vec![0; plan.instances().len() + 1];
        let pairs =
            || plan.needed_instances().flat_map(|id| producers(plan, id).into_iter().map(move |from| (from, id)));
        pairs().for_each(|(from, _)| starts[from.place() + 1] += 1);
        for place in 1..starts.len() {
            starts[place] += starts[place - 1];
        }
        let mut ids = vec![InstanceId::new(0); starts[starts.len() - 1]];
        let mut next = starts.clone();
        for (from, id) in pairs() {
            ids[next[from.place()]] = id;
            next[from.place()] += 1;
        }
        Self { ids, starts }
    }

    /// Those of one instance, in order.
    pub fn of_one(&self, id: InstanceId) -> impl Iterator<Item = InstanceId> + use<> {
        let at = |place: usize| self.starts.get(place).copied().unwrap_or(0);
        let own = self.ids[at(id.place())..at(id.place() + 1)].to_vec();
        own.into_iter()
    }
}
