//! The [`Stage`] trait, and [`StageRow`]: a stage as the engine sees it, a row of plain functions.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use crate::artifact::Artifact;
use crate::canonical::canonical_value;
use crate::ctx::Ctx;
use crate::error::Error;
use crate::extent::Extent;
use crate::file::FileUse;
use crate::form::Forms;
use crate::known::Known;
use crate::pilot::Pilot;
use crate::port::{InPort, InPorts, InputSource, OutPort, OutPorts};
use crate::problem::Problems;
use crate::read::{ParamError, read_params};
use crate::shared::Shared;

/// What a stage is going to do, for `turbid plan`.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct StagePlan {
    /// Method taken, with the reason where it was chosen by `auto`.
    pub method: Option<String>,
    pub needs: Vec<String>,
    /// Capabilities that this instance does not need and does not pay for.
    pub left_out: Vec<String>,
    /// The kernel that does most of the work, where a stage has several ...
    #[serde(skip_serializing_if = "Option::is_none")]
    pub kernel: Option<String>,
    /// ... and what keeps a faster one from doing it: each with the value and the limit.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub refused: Vec<String>,
    /// CPU seconds by the stage's own figures; [`Stage::pilot`] knows better, where there is one.
    pub seconds: Option<f64>,
    /// Bytes of the outputs, where the stage knows them.
    pub bytes: Option<u64>,
    /// Bytes that the run holds at the most: its inputs as long as it holds them, its state, what it works with, and its outputs.
    /// `None` where that is not known yet; the engine then takes what it knows of inputs and outputs.
    pub memory: Option<u64>,
    /// Inputs that are never held whole: [`memory`](Self::memory) says what of them is.
    #[serde(skip)]
    pub in_parts: Vec<&'static str>,
    /// How large the outputs are going to be, as far as that is known: what the stages that read them reckon with.
    #[serde(skip)]
    pub makes: Extents,
}

/// A pure function of params, inputs and a seed.
///
/// A stage opens no file, reads no clock and prints nothing (all through [`Ctx`]); its outputs depend neither on
/// the thread count nor on the vector width nor on which optional ports are wanted.
pub trait Stage: 'static {
    /// What `use:` names.
    const NAME: &'static str;
    /// Raised when the same params and inputs would give other bytes.
    const VERSION: u32;
    /// One sentence for `turbid stages`.
    const ABOUT: &'static str;
    /// Cheap enough to run in memory during check and plan.
    const INSTANT: bool = false;
    /// Names of the params that only say when to stop: a longer run continues the checkpoint of a shorter one.
    const STOPPING: &'static [&'static str] = &[];

    /// Unknown fields refused, defaults filled; quantities as in [`crate::quantity`].
    type Params: DeserializeOwned + Serialize + JsonSchema + Send + Sync;
    type In: InPorts;
    type Out: OutPorts;

    /// Whether the seed matters; only then is it in the key.
    fn draws(_params: &Self::Params) -> bool {
        false
    }

    /// The input files that the params name.
    fn files(_params: &Self::Params) -> Vec<FileUse> {
        Vec::new()
    }

    /// Params as they enter the key; override it where a field holds a path (write its file name) or where several
    /// spellings mean the same.
    fn canonical(params: &Self::Params) -> Result<Value, String> {
        canonical_value(params)
    }

    /// Reports every mistake with its field path, before anything runs.
    fn check(params: &Self::Params, known: &Known, problems: &mut Problems);

    /// What the artifacts on the output ports will hold, as far as that is known before the run, from the params and from the forms of
    /// the inputs; asked only where `check` found nothing wrong. An output that differs from it is a mistake of the stage.
    fn describe(_params: &Self::Params, _known: &Known) -> Forms {
        Forms::new()
    }

    /// Method, capabilities needed and left out, estimated cost.
    fn plan(_params: &Self::Params, _known: &Known) -> StagePlan {
        StagePlan::default()
    }

    /// Does a small part of the run, the same part whenever it is asked, for `turbid plan` to time. What is to be timed goes through
    /// [`Ctx::map_tiles`]. `None` where [`plan`](Self::plan) knows the seconds well enough, or where nothing is known yet.
    fn pilot(_params: &Self::Params, _known: &Known, _ctx: Ctx<'_>) -> Option<Pilot> {
        None
    }

    fn run(params: &Self::Params, inputs: <Self::In as InPorts>::Loaded<'_>, ctx: Ctx<'_>) -> Result<Self::Out, Error>;
}

/// How large outputs are going to be, by port.
pub type Extents = BTreeMap<&'static str, Extent>;

/// What a run made: the artifact of each port.
pub type Made = Vec<(&'static str, Artifact)>;

/// A stage with its params read: what stands behind check, describe, plan and run. Params are read once, by [`StageRow::prepare`].
pub trait Job: Send + Sync {
    /// Canonical params, defaults filled: what is hashed, stored and explained.
    fn canonical(&self) -> Result<Value, String>;
    fn draws(&self) -> bool;
    fn files(&self) -> Vec<FileUse>;
    fn check(&self, known: &Known, problems: &mut Problems);
    fn describe(&self, known: &Known) -> Forms;
    fn plan(&self, known: &Known) -> StagePlan;
    fn pilot(&self, known: &Known, ctx: Ctx<'_>) -> Option<Pilot>;
    fn run(&self, inputs: &dyn InputSource, ctx: Ctx<'_>) -> Result<Made, Error>;
    /// The same, where what was made stays in memory: the payloads themselves are kept beside the artifacts.
    fn run_in_memory(&self, inputs: &dyn InputSource, ctx: Ctx<'_>) -> Result<Vec<(&'static str, Shared)>, Error>;
}

/// The params of stage `S`, as they were read.
struct Typed<S: Stage>(S::Params);

impl<S: Stage> Job for Typed<S> {
    fn canonical(&self) -> Result<Value, String> {
        S::canonical(&self.0)
    }
    fn draws(&self) -> bool {
        S::draws(&self.0)
    }
    fn files(&self) -> Vec<FileUse> {
        S::files(&self.0)
    }
    fn check(&self, known: &Known, problems: &mut Problems) {
        S::check(&self.0, known, problems);
    }
    fn describe(&self, known: &Known) -> Forms {
        S::describe(&self.0, known)
    }
    fn plan(&self, known: &Known) -> StagePlan {
        S::plan(&self.0, known)
    }
    fn pilot(&self, known: &Known, ctx: Ctx<'_>) -> Option<Pilot> {
        S::pilot(&self.0, known, ctx)
    }
    fn run(&self, inputs: &dyn InputSource, ctx: Ctx<'_>) -> Result<Made, Error> {
        Ok(S::run(&self.0, <S::In as InPorts>::load(inputs)?, ctx)?.into_artifacts())
    }
    fn run_in_memory(&self, inputs: &dyn InputSource, ctx: Ctx<'_>) -> Result<Vec<(&'static str, Shared)>, Error> {
        Ok(S::run(&self.0, <S::In as InPorts>::load(inputs)?, ctx)?.into_shared())
    }
}

/// A stage as the engine sees it.
#[derive(Clone)]
pub struct StageRow {
    pub name: &'static str,
    pub version: u32,
    pub about: &'static str,
    pub instant: bool,
    pub stopping: &'static [&'static str],
    pub inputs: fn() -> Vec<InPort>,
    pub outputs: fn() -> Vec<OutPort>,
    pub schema: fn() -> Value,
    /// Reads the JSON value of `with` after substitution.
    pub prepare: fn(params: &Value) -> Result<Box<dyn Job>, ParamError>,
}

impl StageRow {
    /// The row of stage `S`.
    pub fn of<S: Stage>() -> Self {
        Self {
            name: S::NAME,
            version: S::VERSION,
            about: S::ABOUT,
            instant: S::INSTANT,
            stopping: S::STOPPING,
            inputs: <S::In as InPorts>::ports,
            outputs: <S::Out as OutPorts>::ports,
            schema: || schemars::schema_for!(S::Params).to_value(),
            prepare: |params| Ok(Box::new(Typed::<S>(read_params(params)?))),
        }
    }

    /// Reads and checks params at once; what cannot be read is a mistake like others.
    pub fn check(&self, params: &Value, known: &Known, problems: &mut Problems) {
        match (self.prepare)(params) {
            Ok(job) => job.check(known, problems),
            Err(error) => problems.found.push(error.into()),
        }
    }

    /// Reads params and runs, for who has no engine.
    pub fn run(&self, params: &Value, inputs: &dyn InputSource, ctx: Ctx<'_>) -> Result<Made, Error> {
        (self.prepare)(params).map_err(|error| Error::Invalid(error.into()))?.run(inputs, ctx)
    }
}
