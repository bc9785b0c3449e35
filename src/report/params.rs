//! The params of a stage as they go into its key, and where each comes from.

use std::collections::BTreeMap;

use serde_json::Value;
use turbid_contract::canonical::canonical_text;

use crate::plan::{PREVIEW_INSTANCES, StageId};
use crate::resolve::Resolver;

use super::page::{Cell, Grid};

/// So many params of a stage; what has more is a table in a file.
const MOST: usize = 120;
/// Characters of a value.
const LONGEST: usize = 160;

/// Param, value, where it comes from: a row each. Empty where the stage takes none.
pub fn params(resolver: &Resolver<'_>, stage: StageId) -> Grid {
    let plan = resolver.plan;
    let name = &plan.spec.stages[stage].name;
    let all = plan.instances_of(stage);
    // Of many instances some tell which params differ.
    let looked = all.take(PREVIEW_INSTANCES).filter_map(|id| resolver.prepare(id).ok());
    let mut given: BTreeMap<String, String> = BTreeMap::new();
    let mut values: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for prepared in looked {
        flatten("", &prepared.params, &mut |path, value| drop(given.insert(path, value)));
        flatten("", &prepared.canonical, &mut |path, value| {
            let known = values.entry(path).or_default();
            if !known.contains(&value) {
                known.push(value);
            }
        });
    }
    let set = |path: &str| {
        let own = format!("stages.{name}.with.{path}");
        plan.spec.overrides.iter().any(|given| {
            let key = given.split('=').next().unwrap_or_default();
            key == own || own.starts_with(&format!("{key}."))
        })
    };
    let rows = values.iter().take(MOST).map(|(path, values)| {
        let value = match &values[..] {
            [one] => one.clone(),
            several => format!("{} … {} ({} values)", several[0], several[several.len() - 1], several.len()),
        };
        let from = match (set(path), given.keys().any(|key| key == path || key.starts_with(&format!("{path}.")))) {
            (true, _) => "--set",
            (_, true) => "file",
            (_, false) => "default",
        };
        vec![Cell::text(path), Cell::text(shortened(&value)), Cell::text(from)]
    });
    Grid {
        caption: String::new(),
        head: ["param", "value", "from"].map(str::to_owned).to_vec(),
        rows: rows.collect(),
        more: (values.len() > MOST).then(|| format!("and {} more params", values.len() - MOST)),
    }
}

/// Each field under its path; lists of numbers and words stay whole.
fn flatten(path: &str, value: &Value, put: &mut dyn FnMut(String, String)) {
    let below = |name: &str| if path.is_empty() { name.to_owned() } else { format!("{path}.{name}") };
    match value {
        Value::Object(map) if !map.is_empty() => {
            map.iter().for_each(|(name, child)| flatten(&below(name), child, put));
        }
        Value::Array(items) if items.iter().any(|i| i.is_object() || i.is_array()) => {
            items.iter().enumerate().for_each(|(i, child)| flatten(&below(&i.to_string()), child, put));
        }
        // Nothing was given, and nothing stands for it.
        Value::Null => {}
        _ if path.is_empty() => {}
        Value::String(text) => put(path.to_owned(), text.clone()),
        other => put(path.to_owned(), canonical_text(other)),
    }
}

pub fn shortened(text: &str) -> String {
    if text.chars().count() <= LONGEST {
        return text.to_owned();
    }
    text.chars().take(LONGEST - 1).chain(['…']).collect()
}
