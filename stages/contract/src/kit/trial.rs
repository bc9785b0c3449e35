//! A stage called as the engine calls it: params as JSON, then check, plan, run.

use std::collections::BTreeMap;
use std::sync::Arc;

use serde_json::Value;

use crate::artifact::{Artifact, ArtifactKind};
use crate::ctx::{Ctx, Host};
use crate::error::Error;
use crate::file::Files;
use crate::form::{Form, Forms};
use crate::kit::{Inputs, MemoryHost};
use crate::known::Known;
use crate::payload::{Payload, undeclared};
use crate::port::{Arity, Axes, InPort};
use crate::problem::{Problem, Problems};
use crate::stage::{Job, Stage, StagePlan, StageRow};

/// A stage with params, inputs and settings of a host; each run has a host of its own.
#[derive(Clone)]
pub struct Trial {
    pub row: StageRow,
    pub params: Value,
    pub inputs: Inputs,
    pub seed: u64,
    /// Optional ports that are to be computed.
    pub wanted: Vec<String>,
    pub files: Files,
    pub threads: usize,
    /// Names of the payloads on ports that take several.
    pub payloads: BTreeMap<String, &'static str>,
}

/// What a run made and said.
pub struct Made {
    pub ports: BTreeMap<&'static str, Artifact>,
    pub host: MemoryHost,
}

impl Made {
    /// The payload on an output port; panics where the run did not make it.
    pub fn get<P: Payload>(&self, port: &str) -> P {
        let artifact = self.ports.get(port).unwrap_or_else(|| panic!("the run made no `{port}`")).clone();
        P::from_artifact(artifact).unwrap_or_else(|error| panic!("`{port}`: {error}"))
    }
}

impl Trial {
    /// Stage `S` with these params, as they stand below `with:`.
    pub fn of<S: Stage>(params: Value) -> Self {
        Self::of_row(StageRow::of::<S>(), params)
    }

    /// The same of a row of a registry.
    pub fn of_row(row: StageRow, params: Value) -> Self {
        let (inputs, files) = (Inputs::none(), Files::default());
        Self { row, params, inputs, seed: 0, wanted: Vec::new(), files, threads: 1, payloads: BTreeMap::new() }
    }

    /// With other params.
    #[must_use]
    pub fn with(self, params: Value) -> Self {
        Self { params, ..self }
    }

    /// With `payload` on an input port; panics where the stage has no such port, or one for other payloads.
    #[must_use]
    pub fn input<P: Payload>(self, port: &str, payload: P) -> Self {
        self.input_at(port, Axes::new(), payload)
    }

    /// With one more `payload` on an input port that takes many.
    #[must_use]
    pub fn input_at<P: Payload>(mut self, port: &str, axes: Axes, payload: P) -> Self {
        let InPort { accepts, arity, .. } = self.port(port);
        let (stage, name) = (self.row.name, P::NAME);
        assert!(accepts.contains(&name), "`{port}` of `{stage}` takes {}, not {name}", accepts.join(" or "));
        let many = matches!(arity, Arity::Many | Arity::Some);
        assert!(many || self.inputs.first(port).is_none(), "`{port}` of `{stage}` takes one artifact");
        self.inputs = self.inputs.with_at(port, axes, payload);
        self.payloads.insert(port.to_owned(), name);
        self
    }

    /// With an optional output port that is to be computed; panics where the stage has no such port.
    #[must_use]
    pub fn wants(mut self, port: &str) -> Self {
        let known = (self.row.outputs)().iter().any(|p| p.name == port && p.optional);
        assert!(known, "`{}` has no optional output `{port}`", self.row.name);
        self.wanted.push(port.to_owned());
        self
    }

    /// With the content of the input file that the field `at` names.
    #[must_use]
    pub fn file(mut self, at: &str, bytes: impl Into<Arc<[u8]>>) -> Self {
        self.files.insert(at.to_owned(), bytes.into());
        self
    }

    #[must_use]
    pub fn seed(self, seed: u64) -> Self {
        Self { seed, ..self }
    }

    #[must_use]
    pub fn threads(self, threads: usize) -> Self {
        Self { threads, ..self }
    }

    fn port(&self, name: &str) -> InPort {
        let port = (self.row.inputs)().into_iter().find(|port| port.name == name);
        port.unwrap_or_else(|| panic!("`{}` has no input `{name}`", self.row.name))
    }

    /// A host with the settings of this trial.
    pub fn host(&self) -> MemoryHost {
        let (seed, threads) = (self.seed, self.threads);
        MemoryHost { seed, threads, wanted: self.wanted.clone(), files: self.files.clone(), ..MemoryHost::default() }
    }

    /// What `check`, `describe` and `plan` know of what is connected: of records their content, as of those that instant stages make; of images and
    /// tables their form and size.
    pub fn known(&self) -> Known {
        let mut known = Known { files: self.files.clone(), ..Known::default() };
        let made = (self.row.outputs)().into_iter().filter(|port| !port.optional).map(|port| port.name.to_owned());
        known.wanted = made.chain(self.wanted.iter().cloned()).collect();
        for port in (self.row.inputs)() {
            let all = self.inputs.all(port.name);
            let Some((_, artifact)) = all.first() else { continue };
            let name = port.name.to_owned();
            known.connected.push(name.clone());
            known.extents.insert(name.clone(), artifact.extent());
            known.producers.insert(name.clone(), format!("made.{name}"));
            known.forms.insert(name.clone(), all.iter().map(|(_, artifact)| Arc::new(Form::of(artifact))).collect());
            if matches!(port.arity, Arity::One | Arity::Optional) {
                let payload = self.payloads.get(port.name).copied().unwrap_or(port.payload);
                known.payloads.insert(name.clone(), payload.to_owned());
                if artifact.kind() == ArtifactKind::Record {
                    known.insert(name, artifact.clone());
                }
            } else {
                known.axes.insert(name, all.iter().map(|(axes, _)| axes.clone()).collect());
            }
        }
        known
    }

    /// The stage with its params read; panics where they cannot be.
    pub fn job(&self) -> Box<dyn Job> {
        (self.row.prepare)(&self.params).unwrap_or_else(|error| panic!("{}: {error:?}", self.row.name))
    }

    /// Mistakes and warnings of `check`. Params that cannot be read are the one mistake.
    pub fn check(&self) -> (Vec<Problem>, Vec<Problem>) {
        let mut problems = Problems::default();
        self.row.check(&self.params, &self.known(), &mut problems);
        problems.into_parts()
    }

    /// Asserts that `check` finds one mistake, at the field `path` (`in.PORT` for an input), whose message or hint contains `text`.
    pub fn refuses(&self, path: &str, text: &str) {
        let (mistakes, _) = self.check();
        let [mistake] = &mistakes[..] else { panic!("one mistake is expected in {}: {mistakes:#?}", self.params) };
        let told = mistake.to_string();
        assert!(told.starts_with(&format!("{path}: ")) && told.contains(text), "`{path}`, `{text}` expected: {told}");
    }

    /// Asserts that `check` finds neither mistakes nor anything to warn of.
    pub fn passes(&self) {
        let (mistakes, warnings) = self.check();
        assert!(mistakes.is_empty() && warnings.is_empty(), "in {}: {mistakes:#?} {warnings:#?}", self.params);
    }

    /// What the outputs are said to hold before a run.
    pub fn describe(&self) -> Forms {
        self.job().describe(&self.known())
    }

    pub fn plan(&self) -> StagePlan {
        self.job().plan(&self.known())
    }

    /// Check, describe, plan, run, as the engine does.
    ///
    /// Errors: the first mistake of `check`; what the run says; an output that is not as it was described, or that its payload does not declare.
    pub fn run(&self) -> Result<Made, Error> {
        if let Some(mistake) = self.check().0.into_iter().next() {
            return Err(Error::Invalid(mistake));
        }
        let (forms, host) = (self.describe(), self.host());
        self.plan();
        let ports = self.run_alone(&host)?;
        for (port, form) in &forms {
            if let Some(broken) = ports.get(port).and_then(|artifact| form.broken_by(&Form::of(artifact))) {
                return Err(Error::failed(format!("output `{port}` has {broken}")));
            }
        }
        for port in (self.row.outputs)() {
            if let Some(other) = ports.get(port.name).and_then(|artifact| undeclared(port.holds, artifact)) {
                return Err(Error::failed(format!(
                    "output `{}` has a {other}, which {} does not declare",
                    port.name, port.payload
                )));
            }
        }
        Ok(Made { ports, host })
    }

    /// Runs without a check, on a host of the caller's: for mistakes that show at run time only, checkpoints, and clocks.
    ///
    /// Errors: what the run says.
    pub fn run_alone(&self, host: &dyn Host) -> Result<BTreeMap<&'static str, Artifact>, Error> {
        Ok(self.row.run(&self.params, &self.inputs, Ctx::new(host))?.into_iter().collect())
    }
}
