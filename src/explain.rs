//! Why an instance runs: the fields in which its dependencies differ from the nearest earlier result.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use serde::Serialize;
use serde_json::Value;

use crate::digest::Digest;
use crate::key::{Dependencies, axes_text};
use crate::plan::{InstanceId, Plan};
use crate::store::{InstanceRecord, Recipe, Store};

/// A field that differs; `None` where one side does not have it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Difference {
    pub field: String,
    pub before: Option<String>,
    pub now: Option<String>,
}

/// An earlier result and what went into it.
pub type Earlier = (InstanceRecord, Recipe);

/// Earlier results, by kind of stage.
pub struct History {
    by_use: HashMap<String, Vec<Arc<Earlier>>>,
    /// The latest of each stage at each point of its axes.
    by_label: HashMap<Label, Arc<Earlier>>,
    /// By what they depend on but for the params that say when to stop; the latest of each.
    by_state: HashMap<Digest, Arc<Earlier>>,
}

/// Kind, pipeline, stage, axes.
type Label = (String, String, String, String);

/// Comparing with every record of a big sweep would be quadratic; the latest ones are near enough.
const COMPARED: usize = 256;

impl History {
    pub fn read(store: &Store) -> Self {
        Self::read_latest(store, usize::MAX)
    }

    /// So many at most, the latest.
    pub fn read_latest(store: &Store, most: usize) -> Self {
        let mut by_use: HashMap<String, Vec<Arc<Earlier>>> = HashMap::new();
        for earlier in store.records_of_latest(most) {
            by_use.entry(earlier.0.use_name.clone()).or_default().push(Arc::new(earlier));
        }
        for records in by_use.values_mut() {
            // Latest first; the key only makes the order complete.
            records.sort_by_key(|earlier| std::cmp::Reverse((earlier.0.provenance.started, earlier.0.key)));
        }
        let mut by_label = HashMap::new();
        for earlier in by_use.values().flatten() {
            let from = &earlier.0.provenance;
            let label = (earlier.0.use_name.clone(), from.pipeline.clone(), from.stage.clone(), axes_text(&from.axes));
            by_label.entry(label).or_insert_with(|| earlier.clone());
        }
        let mut by_state = HashMap::new();
        for earlier in by_use.values().flatten() {
            if let Some(state) = earlier.0.state_key {
                by_state.entry(state).or_insert_with(|| earlier.clone());
            }
        }
        Self { by_use, by_label, by_state }
    }

    /// Whether there is any earlier result of this kind of stage.
    pub fn knows(&self, use_name: &str) -> bool {
        self.by_use.contains_key(use_name)
    }

    /// The latest result of the same work, done for longer or shorter.
    pub fn same_work(&self, state_key: &Digest) -> Option<&InstanceRecord> {
        self.by_state.get(state_key).map(|earlier| &earlier.0)
    }

    /// The last result under this very label from the same params and files, whatever its inputs held.
    pub fn same_params(&self, plan: &Plan, id: InstanceId, use_name: &str, params: &Value) -> Option<&InstanceRecord> {
        let earlier = self.same_label(plan, id, use_name)?;
        (earlier.1.params == *params).then_some(&earlier.0)
    }

    /// The last result under the very label of the instance: what the user compares with.
    fn same_label(&self, plan: &Plan, id: InstanceId, use_name: &str) -> Option<&Arc<Earlier>> {
        let instance = &plan.instances[id];
        let stage = plan.spec.stages[instance.stage].name.clone();
        let axes = axes_text(&instance.axes);
        self.by_label.get(&(use_name.to_owned(), plan.spec.pipeline.clone(), stage, axes))
    }

    /// The earlier result with the fewest differences, where params that only say when to stop hardly count: the run goes on from it.
    /// Among equals that of the same label, then the latest.
    pub fn nearest(&self, plan: &Plan, id: InstanceId, now: &Dependencies) -> Option<(Arc<Earlier>, Vec<Difference>)> {
        let stopping = plan.row(plan.instances[id].stage).stopping;
        let only_stops = |difference: &&Difference| {
            difference.field.strip_prefix("with.").is_some_and(|field| stopping.contains(&field))
        };
        let same_label = self.same_label(plan, id, &now.use_name);
        // The run that it goes on from, also where hundreds came after it.
        let same_work = now.state_key(stopping).and_then(|state| self.by_state.get(&state));
        let latest = self.by_use.get(&now.use_name).into_iter().flatten().take(COMPARED);
        same_label
            .into_iter()
            .chain(same_work)
            .chain(latest)
            .map(|record| (record.clone(), differences(&dependencies_of(record), now)))
            .min_by_key(|(_, found)| (found.len() - found.iter().filter(only_stops).count(), found.len()))
    }

    /// Short reasons for `plan` and `run`.
    pub fn reasons(&self, plan: &Plan, id: InstanceId, now: &Dependencies) -> Vec<String> {
        let Some(earlier) = self.same_label(plan, id, &now.use_name) else {
            return vec!["no earlier result".to_owned()];
        };
        let differences = differences(&dependencies_of(earlier), now);
        if differences.is_empty() {
            return vec!["its stored result is damaged or gone".to_owned()];
        }
        let mut reasons: Vec<String> = differences.iter().take(4).map(Difference::short).collect();
        if differences.len() > 4 {
            reasons.push(format!("and {} more fields", differences.len() - 4));
        }
        reasons
    }
}

impl Difference {
    fn short(&self) -> String {
        let clip = |text: &Option<String>| match text {
            Some(text) if text.chars().count() > 40 => format!("{}…", text.chars().take(12).collect::<String>()),
            Some(text) => text.clone(),
            None => "nothing".to_owned(),
        };
        if self.field.starts_with("in.") {
            return format!("input {} changed", &self.field[3..]);
        }
        format!("{}: {} -> {}", self.field, clip(&self.before), clip(&self.now))
    }
}

/// The dependencies that a record was made from.
pub fn dependencies_of((record, recipe): &Earlier) -> Dependencies {
    Dependencies {
        use_name: record.use_name.clone(),
        version: record.version,
        params: recipe.params.clone(),
        inputs: recipe.inputs.clone(),
        files: recipe.files.clone(),
        seed: record.seed,
    }
}

/// The fields in which two sets of dependencies differ.
pub fn differences(before: &Dependencies, now: &Dependencies) -> Vec<Difference> {
    let before: BTreeMap<String, String> = before.lines().into_iter().collect();
    let now: BTreeMap<String, String> = now.lines().into_iter().collect();
    let mut fields: Vec<&String> = before.keys().chain(now.keys()).collect();
    fields.sort();
    fields.dedup();
    fields
        .into_iter()
        .filter(|field| before.get(*field) != now.get(*field))
        .map(|field| Difference {
            field: field.clone(),
            before: before.get(field).cloned(),
            now: now.get(field).cloned(),
        })
        .collect()
}
