//! The [`Stage`] trait, and [`StageRow`]: a stage as the engine sees it, a row of plain functions.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use crate::artifact::{Artifact, Attributes};
use crate::canonical::canonical_value;
use crate::ctx::Ctx;
use crate::error::Error;
use crate::extent::Extent;
use crate::file::FileUse;
use crate::pilot::Pilot;
use crate::port::{InPort, InPorts, InputSource, Known, OutPort, OutPorts};
use crate::problem::Problems;
use crate::read::{ParamError, ParamMistake, read_params};

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
    type Params: DeserializeOwned + Serialize + JsonSchema;
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

    /// Whether `check` reads the facts of its inputs; only then are they worked out.
    const READS_FACTS: bool = false;

    /// Attributes that the artifacts on the output ports will have, as far as they are known before the run: from the params, and
    /// from what is known of the inputs. An output says the same once it is there.
    fn facts(_params: &Self::Params, _known: &Known) -> Facts {
        Facts::new()
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

/// What is known of outputs before a run, by port.
pub type Facts = BTreeMap<&'static str, Attributes>;

/// What the engine needs to know of an instance's params.
#[derive(Clone, Debug)]
pub struct Prepared {
    /// Canonical params, defaults filled: what is hashed, stored and explained.
    pub canonical: Value,
    pub draws: bool,
    pub files: Vec<FileUse>,
}

/// What a run made: the artifact of each port.
pub type Made = Vec<(&'static str, Artifact)>;

/// A stage as the engine sees it. `params` is always the JSON value of `with` after substitution.
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
    pub prepare: fn(params: &Value) -> Result<Prepared, ParamError>,
    pub check: fn(params: &Value, known: &Known, problems: &mut Problems),
    pub reads_facts: bool,
    pub facts: fn(params: &Value, known: &Known) -> Facts,
    pub plan: fn(params: &Value, known: &Known) -> StagePlan,
    pub pilot: fn(params: &Value, known: &Known, ctx: Ctx<'_>) -> Option<Pilot>,
    pub run: fn(params: &Value, inputs: &dyn InputSource, ctx: Ctx<'_>) -> Result<Made, Error>,
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
            prepare: |params| {
                let params = read_params::<S::Params>(params)?;
                let canonical = S::canonical(&params)
                    .map_err(|message| ParamError { path: Vec::new(), mistake: ParamMistake::Other(message) })?;
                Ok(Prepared { canonical, draws: S::draws(&params), files: S::files(&params) })
            },
            check: |params, known, problems| match read_params::<S::Params>(params) {
                Ok(params) => S::check(&params, known, problems),
                Err(error) => problems.push(error.path.join("."), error.mistake.to_string()),
            },
            reads_facts: S::READS_FACTS,
            facts: |params, known| match read_params::<S::Params>(params) {
                Ok(params) => S::facts(&params, known),
                Err(_) => Facts::new(),
            },
            plan: |params, known| match read_params::<S::Params>(params) {
                Ok(params) => S::plan(&params, known),
                Err(_) => StagePlan::default(),
            },
            pilot: |params, known, ctx| S::pilot(&read_params::<S::Params>(params).ok()?, known, ctx),
            run: |params, inputs, ctx| {
                let params = read_params::<S::Params>(params)
                    .map_err(|e| Error::invalid(e.path.join("."), e.mistake.to_string()))?;
                let inputs = <S::In as InPorts>::load(inputs)?;
                Ok(S::run(&params, inputs, ctx)?.into_artifacts())
            },
        }
    }
}
