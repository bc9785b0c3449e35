//! What artifacts are going to hold, and how that flows through the graph before anything runs.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use turbid_contract::{Form, Forms};

use super::{Outputs, Resolver};
use crate::panics::lock;
use crate::plan::InstanceId;

/// The forms of an instance's outputs, by port.
pub type Described = BTreeMap<&'static str, Arc<Form>>;

/// The forms that were worked out. Those of a sweep are mostly the same: they are kept once.
#[derive(Default)]
pub(super) struct KnownForms {
    of: HashMap<InstanceId, Arc<Described>>,
    latest: HashMap<usize, Arc<Described>>,
}

impl KnownForms {
    fn insert(&mut self, id: InstanceId, stage: usize, forms: Forms) -> Arc<Described> {
        let before = self.latest.get(&stage);
        let same = before.filter(|before| {
            before.len() == forms.len()
                && forms.iter().all(|(port, form)| before.get(port).is_some_and(|b| **b == *form))
        });
        let kept = match same {
            Some(same) => same.clone(),
            None => {
                let fresh =
                    Arc::new(forms.into_iter().map(|(port, form)| (port, Arc::new(form))).collect::<Described>());
                self.latest.insert(stage, fresh.clone());
                fresh
            }
        };
        self.of.insert(id, kept.clone());
        kept
    }
}

impl Resolver<'_> {
    /// The forms of the artifacts on the input ports, in the order in which a run gets them.
    pub(super) fn forms_of_inputs(
        &self,
        id: InstanceId,
        outputs: &[Option<Arc<Outputs>>],
    ) -> BTreeMap<String, Vec<Arc<Form>>> {
        let open = Arc::new(Form::default());
        let of = |&(source, port): &(InstanceId, &'static str)| {
            self.forms(source, outputs).get(port).cloned().unwrap_or_else(|| open.clone())
        };
        let wires = &self.plan.instances[id].wires;
        wires.iter().map(|wire| (wire.port.to_owned(), wire.from.iter().map(of).collect())).collect()
    }

    /// Remembers what a stage says of its outputs; nothing of one with mistakes in it.
    pub(super) fn note_forms(&self, id: InstanceId, forms: Forms) -> Arc<Described> {
        lock(&self.forms).insert(id, self.plan.instances[id].stage, forms)
    }

    /// What is known of an output before its instance runs; `None` where nothing was asked.
    pub fn form(&self, id: InstanceId, port: &str) -> Option<Arc<Form>> {
        lock(&self.forms).of.get(&id)?.get(port).cloned()
    }

    /// The forms of an instance's outputs, whether or not the store holds them.
    fn forms(&self, id: InstanceId, outputs: &[Option<Arc<Outputs>>]) -> Arc<Described> {
        let known = |id: InstanceId| lock(&self.forms).of.get(&id).cloned();
        if let Some(forms) = known(id) {
            return forms;
        }
        // An explicit stack: a chain of a million stages must not end the process.
        let mut path = vec![id];
        while let Some(&last) = path.last() {
            let sources = self.plan.instances[last].wires.iter().flat_map(|w| w.from.iter().map(|from| from.0));
            let open: Vec<InstanceId> = sources.filter(|&source| known(source).is_none()).collect();
            if open.is_empty() {
                path.pop();
                if known(last).is_none() {
                    self.note_forms(last, self.own_forms(last, outputs));
                }
            } else {
                path.extend(open);
            }
        }
        known(id).expect("it was worked out")
    }

    /// The same, those of its inputs being known.
    fn own_forms(&self, id: InstanceId, outputs: &[Option<Arc<Outputs>>]) -> Forms {
        // Mistakes in params are told where the stage is checked.
        let Ok(prepared) = self.prepare(id) else { return Forms::new() };
        let mut known = self.known(id, outputs);
        let stage = self.plan.instances[id].stage;
        if let Ok(files) = self.input_files(stage, &prepared.job.files())
            && let Ok(lent) = self.files.lend(&files, false)
        {
            known.files = lent.files.clone();
            return prepared.job.describe(&known);
        }
        Forms::new()
    }
}
