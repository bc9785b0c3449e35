//! Params with the scene that the check made of them: the run that follows does not assemble it again.

use std::sync::{Arc, OnceLock};

use serde::{Deserialize, Serialize};
use turbid_contract::payload::Scene;
use turbid_contract::schemars::JsonSchema;

use crate::params::Params;

/// The params, and what they became with the rig and the files that the check knew.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(transparent)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct Kept {
    pub params: Params,
    #[serde(skip)]
    made: OnceLock<(Option<Arc<Scene>>, Scene)>,
}

impl Kept {
    /// Remembers what the params became beside `rig`. Files are those of the instance: they do not change between its check and its run.
    pub fn keep(&self, rig: Option<Arc<Scene>>, scene: Scene) {
        // What a first check made stands: a second one with the same params and files can differ by its rig only, and is then made anew.
        let _ = self.made.set((rig, scene));
    }

    /// What was remembered of the same rig.
    pub fn made_with(&self, rig: Option<&Scene>) -> Option<Scene> {
        let (with, scene) = self.made.get()?;
        (with.as_deref() == rig).then(|| scene.clone())
    }
}
