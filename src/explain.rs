//! Why an instance runs: the fields in which its dependencies differ from the nearest earlier result.

use std::collections::{BTreeMap, HashMap};
use std::sync::{Arc, OnceLock};

use serde::Serialize;
use serde_json::Value;

use crate::digest::Digest;
use crate::key::Dependencies;
use crate::plan::{InstanceId, Plan};
use crate::store::{InstanceRecord, Label, Recipe, Store};

/// A field that differs; `None` where one side does not have it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Difference {
    pub field: String,
    pub before: Option<String>,
    pub now: Option<String>,
}

/// An earlier result and what went into it.
pub type Earlier = (InstanceRecord, Recipe);

/// Earlier results, looked up in a store: those of one instance take no longer in a store of many.
pub struct History<'a> {
    /// `None` where nothing is compared with.
    store: Option<&'a Store>,
    /// The latest of all, for whoever asks for the nearest one.
    latest: OnceLock<HashMap<String, Vec<Arc<Earlier>>>>,
    /// The reason of all that never ran: one for a million instances.
    no_earlier: Arc<[String]>,
}

/// Comparing with every record of a big sweep would be quadratic; the latest ones of a kind of stage are near enough ...
const COMPARED: usize = 256;
/// ... and so are those among the latest of all kinds.
const LATEST: usize = 16 * COMPARED;

impl<'a> History<'a> {
    pub fn of(store: &'a Store) -> Self {
        Self { store: Some(store), ..Self::none() }
    }

    /// Of nothing: everything is new.
    pub fn none() -> Self {
        Self { store: None, latest: OnceLock::new(), no_earlier: ["no earlier result".to_owned()].into() }
    }

    /// Whether there may be an earlier result of this kind of stage.
    pub fn knows(&self, use_name: &str) -> bool {
        self.store.is_some_and(|store| store.knows(use_name))
    }

    /// The latest result of the same work, done for longer or shorter.
    pub fn same_work(&self, state_key: &Digest) -> Option<Earlier> {
        self.store?.latest_of_work(state_key)
    }

    /// The last result under this very label from the same params and files, whatever its inputs held.
    pub fn same_params(&self, plan: &Plan, id: InstanceId, use_name: &str, params: &Value) -> Option<InstanceRecord> {
        let (record, recipe) = self.same_label(plan, id, use_name)?;
        (recipe.params == *params).then_some(record)
    }

    /// The last result under the very label of the instance: what the user compares with.
    fn same_label(&self, plan: &Plan, id: InstanceId, use_name: &str) -> Option<Earlier> {
        let store = self.store.filter(|store| store.has_records())?;
        let (stage, axes) = (plan.stage_name(id), plan.axes(id));
        store.latest_of(&Label { use_name, pipeline: &plan.spec.pipeline, stage, axes: &axes })
    }

    /// The latest results of a kind of stage.
    fn latest(&self, use_name: &str) -> &[Arc<Earlier>] {
        let latest = self.latest.get_or_init(|| {
            let mut by_use: HashMap<String, Vec<Arc<Earlier>>> = HashMap::new();
            for earlier in self.store.into_iter().flat_map(|store| store.latest_records(LATEST)) {
                let alike = by_use.entry(earlier.0.use_name.clone()).or_default();
                if alike.len() < COMPARED {
                    alike.push(Arc::new(earlier));
                }
            }
            by_use
        });
        latest.get(use_name).map_or(&[], Vec::as_slice)
    }

    /// The earlier result with the fewest differences, where params that only say when to stop hardly count: the run goes on from it.
    /// Among equals that of the same label, then the latest.
    pub fn nearest(&self, plan: &Plan, id: InstanceId, now: &Dependencies) -> Option<(Arc<Earlier>, Vec<Difference>)> {
        let stopping = plan.row(plan.stage_of(id)).stopping;
        let only_stops = |difference: &&Difference| {
            difference.field.strip_prefix("with.").is_some_and(|field| stopping.contains(&field))
        };
        let same_label = self.same_label(plan, id, &now.use_name);
        // The run that it goes on from, also where hundreds came after it.
        let same_work = now.state_key(stopping).and_then(|state| self.same_work(&state));
        let looked_up = same_label.into_iter().chain(same_work).map(Arc::new);
        looked_up
            .chain(self.latest(&now.use_name).iter().cloned())
            .map(|record| {
                let found = differences(&dependencies_of(&record), now);
                (record, found)
            })
            .min_by_key(|(_, found)| (found.len() - found.iter().filter(only_stops).count(), found.len()))
    }

    /// Short reasons for `plan` and `run`.
    pub fn reasons(&self, plan: &Plan, id: InstanceId, now: &Dependencies) -> Arc<[String]> {
        let Some(earlier) = self.same_label(plan, id, &now.use_name) else {
            return self.no_earlier.clone();
        };
        let differences = differences(&dependencies_of(&earlier), now);
        if differences.is_empty() {
            return ["its stored result is damaged or gone".to_owned()].into();
        }
        let mut reasons: Vec<String> = differences.iter().take(4).map(Difference::short).collect();
        if differences.len() > 4 {
            reasons.push(format!("and {} more fields", differences.len() - 4));
        }
        reasons.into()
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
