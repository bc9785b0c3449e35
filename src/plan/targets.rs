//! What the user asked for, and what follows from it: the needed stages and the wanted ports.

use std::collections::BTreeSet;
use std::fmt;

use crate::spec::{Spec, nearest};

use super::expand::Expanded;
use super::ports::Link;
use super::{IdVec, PREVIEW_INSTANCES, StageId, StageInfo};

/// `STAGE` or `STAGE.PORT` on the command line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Target {
    pub stage: String,
    pub port: Option<String>,
}

impl Target {
    pub fn parse(text: &str) -> Self {
        match text.split_once('.') {
            Some((stage, port)) => Self { stage: stage.to_owned(), port: Some(port.to_owned()) },
            None => Self { stage: text.to_owned(), port: None },
        }
    }
}

impl fmt::Display for Target {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.port {
            Some(port) => write!(f, "{}.{port}", self.stage),
            None => f.write_str(&self.stage),
        }
    }
}

type Selection = (Vec<StageId>, IdVec<StageId, BTreeSet<&'static str>>);

/// Needed stages in topological order, and for each stage of the file the ports that must be there.
///
/// A required port is always made. An optional one only if a needed stage consumes it or a target names it; a
/// preview also where the stage has few instances, because someone is going to look.
pub(super) fn select(
    spec: &Spec,
    infos: &IdVec<StageId, StageInfo>,
    links: &IdVec<StageId, Vec<Link>>,
    order: &[StageId],
    consumers: &IdVec<StageId, BTreeSet<StageId>>,
    expanded: &IdVec<StageId, Expanded>,
    targets: &[Target],
) -> Result<Selection, String> {
    let mut needed: BTreeSet<StageId> = BTreeSet::new();
    let mut wanted = IdVec::<StageId, _>::filled(BTreeSet::new(), infos.len());
    if targets.is_empty() {
        needed.extend(infos.ids().filter(|&stage| consumers[stage].is_empty()));
    }
    for target in targets {
        let Some(stage) = spec.stage(&target.stage) else {
            let names: Vec<&str> = spec.stages.iter().map(|s| s.name.as_str()).collect();
            let hint = nearest(&target.stage, names.iter().copied()).map(|n| format!("; did you mean `{n}`?"));
            let hint = hint.unwrap_or_else(|| format!("; the pipeline has {}", names.join(", ")));
            return Err(format!("there is no stage `{}` in pipeline `{}`{hint}", target.stage, spec.pipeline));
        };
        needed.insert(stage);
        if let Some(name) = &target.port {
            let Some(port) = infos[stage].outputs.iter().find(|p| p.name == name) else {
                let names: Vec<&str> = infos[stage].outputs.iter().map(|p| p.name).collect();
                return Err(format!(
                    "stage `{}` ({}) has no output `{name}`; it has {}",
                    target.stage,
                    infos[stage].name,
                    names.join(", ")
                ));
            };
            wanted[stage].insert(port.name);
        }
    }
    for &stage in order.iter().rev() {
        if needed.contains(&stage) {
            for (_, source) in links[stage].iter().flat_map(|l| &l.sources) {
                needed.insert(source.stage);
                wanted[source.stage].insert(source.port.name);
            }
        }
    }
    for &stage in &needed {
        let few = expanded[stage].points.len() <= PREVIEW_INSTANCES;
        let made = infos[stage].outputs.iter().filter(|p| !p.optional || (p.preview && few));
        wanted[stage].extend(made.map(|p| p.name));
    }
    Ok((order.iter().copied().filter(|s| needed.contains(s)).collect(), wanted))
}
