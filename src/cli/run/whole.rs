//! Targets of `turbid run` that are more than stages: studies and data sets.

use std::path::{Path, PathBuf};

use crate::cli::{Done, Failure};
#[cfg(feature = "tables")]
use crate::cli::{dataset::Dataset, study::Study};
use crate::registry::Registry;
use crate::run::latest;
use crate::spec;
use crate::terminal::tell;

use super::Run;

/// A target that is more than stages.
#[cfg_attr(not(feature = "tables"), allow(dead_code, reason = "only a build with tables runs them"))]
pub(super) enum Whole {
    Study(String),
    /// Built in this folder of the outputs.
    Dataset {
        name: String,
        folder: PathBuf,
    },
}

impl Whole {
    fn name(&self) -> &str {
        match self {
            Self::Study(name) | Self::Dataset { name, .. } => name,
        }
    }
}

impl Run {
    /// Studies and data sets, then the stages that are targets beside them.
    pub(super) fn run_all(&self, whole: Vec<Whole>, stages: Vec<String>, registry: &Registry) -> Done {
        if stages.is_empty() && !self.force.is_empty() {
            let text = format!(
                "--force {}: studies and data sets are not forced; name the stage as a target too",
                self.force.join(", ")
            );
            return Err(Failure::Input(text));
        }
        if !self.part.only.is_empty() {
            let names: Vec<&str> = whole.iter().map(Whole::name).collect();
            let text = format!(
                "--only: {} is no stage; a study or a data set can be run in shards (`--shard K/N`), or name stages as targets",
                names.join(", ")
            );
            return Err(Failure::Input(text));
        }
        if self.elsewhere.is_given() {
            tell(
                "warning: studies and data sets work on the local store alone; `turbid cache push` sends what they made",
            );
        }
        for target in whole {
            self.run_whole(target, registry)?;
        }
        if stages.is_empty() {
            return Ok(());
        }
        Self { targets: stages, ..self.clone() }.run(registry)
    }

    /// The targets that are studies and data sets, and the others; `None` where none is.
    pub(super) fn whole_targets(&self) -> Option<(Vec<Whole>, Vec<String>)> {
        if self.targets.is_empty() {
            return None;
        }
        let (spec, _) = spec::read(&self.pipeline.file, &self.pipeline.set);
        let spec = spec?;
        let (mut whole, mut stages) = (Vec::new(), Vec::new());
        for target in self.targets.iter().cloned() {
            if spec.studies.iter().any(|study| study.name == target) {
                whole.push(Whole::Study(target));
            } else if spec.datasets.iter().any(|set| set.name == target) && spec.stage(&target).is_none() {
                let folder = Path::new("datasets").join(latest::file_name(&spec.pipeline));
                whole.push(Whole::Dataset { folder: folder.join(latest::file_name(&target)), name: target });
            } else {
                stages.push(target);
            }
        }
        (!whole.is_empty()).then_some((whole, stages))
    }

    #[cfg(feature = "tables")]
    fn run_whole(&self, target: Whole, registry: &Registry) -> Done {
        let Self { pipeline, jobs, memory, json, .. } = self.clone();
        let shard = self.part.shard;
        match target {
            Whole::Study(name) => Study { pipeline, name: Some(name), jobs, memory, json, shard }.run(registry),
            Whole::Dataset { name, folder } => {
                let to = self.pipeline.outputs.path().join(folder);
                Dataset::build(pipeline, name, to, (jobs, memory, json), shard).run(registry)
            }
        }
    }

    #[cfg(not(feature = "tables"))]
    fn run_whole(&self, target: Whole, _: &Registry) -> Done {
        Err(crate::cli::study::without(match target {
            Whole::Study(_) => "study",
            Whole::Dataset { .. } => "dataset",
        }))
    }
}
