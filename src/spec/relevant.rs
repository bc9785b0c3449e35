//! Which overrides can have changed what a stage makes.

use std::collections::BTreeSet;

use super::node::Node;
use super::{Id, Spec, StageId, vars};

impl Spec {
    /// Places in `overrides` of those that the stage itself depends on: its own parts, vars that it uses, directly or through other vars, and
    /// the seed. What its sources depend on is not among them.
    pub fn overrides_of(&self, stage: StageId) -> BTreeSet<usize> {
        if self.overrides.is_empty() {
            return BTreeSet::new();
        }
        let section = |name: &str| self.root.get(name).map(Node::entries).unwrap_or_default();
        // Stages are in the order of their entries.
        let mut open = section("stages").get(stage.place()).map(|e| vars::names_in(&e.value)).unwrap_or_default();
        let mut used = BTreeSet::new();
        while let Some(name) = open.pop() {
            if let Some(entry) = section("vars").iter().find(|e| e.key == name) {
                open.extend(vars::names_in(&entry.value).into_iter().filter(|other| !used.contains(other)));
            }
            used.insert(name);
        }
        let touches = |text: &str| {
            let path = text.split_once('=').map_or(text, |(path, _)| path).trim();
            let mut steps = path.split('.');
            match (steps.next(), steps.next()) {
                (Some("seed"), _) => true,
                (Some("stages"), Some(name)) => name == self.stages[stage].name,
                (Some("vars"), Some(name)) => used.contains(name),
                _ => false,
            }
        };
        (0..self.overrides.len()).filter(|&i| touches(&self.overrides[i])).collect()
    }
}
