//! Which instances are up to date: keys, states with reasons, and every mistake that can be seen before a run.

mod bring;
mod extents;
mod files;
mod forms;
mod inputs;
mod prepare;
mod released;
mod state;

use std::collections::{BTreeMap, HashMap};
use std::path::PathBuf;
use std::sync::{Arc, Mutex};

use rayon::prelude::*;
use serde_json::Value;
use turbid_contract::{Ctx, Error, Forms, Job, Known, MemoryHost, Problem, Problems, Shared, StagePlan};

use crate::brief::{Brief, Outputs};
use crate::digest::{Digest, DigestMap};
use crate::explain::History;
use crate::key::Dependencies;
use crate::memory::need;
use crate::panics::lock;
use crate::plan::{IdVec, InstanceId, Plan, StageId};
use crate::spec::{Diagnostic, Section, Severity};
use crate::store::{Blob, Store, encode};
use crate::threads;
use crate::warned::Warned;
use extents::Sizes;
use files::{InputFiles, Lent};
pub use forms::Described;
use forms::KnownForms;
use inputs::KnownInputs;
use released::Asked;
pub use state::{State, Survey};

/// The outputs of each instance, as far as they are known.
pub type AllOutputs = IdVec<InstanceId, Option<Outputs>>;

/// The params of an instance, read once.
pub struct Prepared {
    /// As `with` says, after substitution.
    pub params: Value,
    pub job: Box<dyn Job>,
    pub canonical: Value,
}

/// An instance that can run: all its inputs are there, so it has a key.
pub struct Keyed {
    pub params: Value,
    pub job: Box<dyn Job>,
    pub dependencies: Dependencies,
    pub key: Digest,
    pub state_key: Option<Digest>,
    /// 0 of an instance that does not draw.
    pub seed: u64,
    pub files: BTreeMap<String, InputFile>,
}

/// An input file as it was when its digest went into the key.
#[derive(Clone, Debug)]
pub struct InputFile {
    pub path: PathBuf,
    pub digest: Digest,
    /// Bytes that it may have.
    pub most: u64,
}

/// What an instant stage made, by port.
type Made = BTreeMap<String, Shared>;
/// What the stage itself says of an instance, or its mistakes.
type Checked = Result<Sound, Vec<Diagnostic>>;

/// An instance without mistakes.
struct Sound {
    plan: Arc<StagePlan>,
    forms: Forms,
    /// With their sizes.
    warnings: Vec<(Diagnostic, f64)>,
}

/// Finds states; remembers files and what instant stages made.
pub struct Resolver<'a> {
    pub plan: &'a Plan,
    pub store: &'a Store,
    history: History<'a>,
    files: Arc<InputFiles>,
    instant: Mutex<HashMap<InstanceId, Arc<Made>>>,
    /// What instant stages made in earlier runs, as it was fetched: a sweep has one scene for many instances.
    fetched: Mutex<HashMap<Digest, Shared>>,
    forms: Mutex<KnownForms>,
    extents: Mutex<HashMap<InstanceId, Arc<Sizes>>>,
    asked: Mutex<Asked>,
    /// The plan of an instance of each stage: most of a sweep share it.
    plans: Mutex<HashMap<StageId, Arc<StagePlan>>>,
}

/// A sweep repeats its mistakes; this many are enough to see what is wrong.
const MANY_PROBLEMS: usize = 100;
/// Instances that are looked at side by side ...
const BLOCK: usize = 2048;
/// ... and how many are not worth it.
const FEW: usize = 32;
/// Artifacts of instant stages that are kept in memory after they were fetched from the store.
const FETCHED: usize = 256;

/// What a look at one instance found, or the mistakes in it.
type Looked = Result<Look, Vec<Diagnostic>>;

struct Look {
    state: State,
    /// `None` for a hit, and for one that waits.
    key: Option<Digest>,
    /// `None` for a hit.
    checked: Option<Checked>,
    /// What an instant stage made, where it was run.
    made: Option<Result<Outputs, Diagnostic>>,
}

impl<'a> Resolver<'a> {
    pub fn new(plan: &'a Plan, store: &'a Store) -> Self {
        let (files, instant, forms) = <(Arc<_>, Mutex<_>, Mutex<_>)>::default();
        let (extents, fetched, asked, plans) = <(Mutex<_>, Mutex<_>, Mutex<_>, Mutex<_>)>::default();
        Self { plan, store, history: History::of(store), files, instant, fetched, forms, extents, asked, plans }
    }

    /// The same, which compares with no earlier result: nobody asks why an instance runs.
    pub fn without_history(self) -> Self {
        Self { history: History::none(), ..self }
    }

    /// Finds the state of each needed instance and checks those that are not up to date.
    ///
    /// `force` names stages that run even where the store holds their outputs.
    pub fn survey(&self, force: &[StageId]) -> Survey {
        let mut survey = Survey::of(self.plan.instances().len());
        let mut first_of: DigestMap<InstanceId> = DigestMap::default();
        let mut warned = Warned::default();
        // At first all that has a record is up to date: its digests key those that read it.
        let asked = std::mem::take(&mut *lock(&self.asked));
        for &stage in &self.plan.needed {
            let ids: Vec<InstanceId> = self.plan.needed_of(stage).collect();
            let forced = force.contains(&stage);
            // Instances of one stage know nothing of each other. A block is as much as is looked at in vain after many mistakes.
            for block in ids.chunks(BLOCK) {
                let errors = survey.problems.iter().filter(|p| is_error(p)).count();
                if errors >= MANY_PROBLEMS {
                    break;
                }
                let look = |&id: &InstanceId| self.look(id, &survey.outputs, forced, errors == 0);
                let looked: Vec<Looked> = if block.len() < FEW || !threads::shared() {
                    block.iter().map(look).collect()
                } else {
                    block.par_iter().map(look).collect()
                };
                for (&id, looked) in block.iter().zip(looked) {
                    self.enter(id, looked, &mut survey, &mut first_of, &mut warned);
                }
            }
        }
        self.survey_released(asked, &mut survey, &mut first_of, &mut warned);
        warned.told(&mut survey.problems);
        survey
    }

    /// State, check and, for instant stages, outputs of one instance.
    fn look(&self, id: InstanceId, outputs: &AllOutputs, forced: bool, sound: bool) -> Looked {
        let (state, keyed) = self.state(id, outputs, forced)?;
        if matches!(state, State::Hit(_)) {
            return Ok(Look { state, key: None, checked: None, made: None });
        }
        let checked = match &keyed {
            Some(keyed) => self.check(id, &*keyed.job, &keyed.files, outputs),
            // It has no key yet, and may well have mistakes.
            None => {
                let job = self.prepare(id)?.job;
                let files = self.input_files(self.plan.stage_of(id), &job.files())?;
                self.check(id, &*job, &files, outputs)
            }
        };
        let stage = self.plan.stage_of(id);
        let consumed = self.plan.row(stage).instant && !self.plan.consumers(stage).is_empty();
        let made = match &keyed {
            Some(keyed) if consumed && sound && checked.is_ok() => {
                Some(self.run_instant(id, keyed, outputs).map_err(|error| self.error_diagnostic(id, &error)))
            }
            _ => None,
        };
        Ok(Look { state, key: keyed.map(|keyed| keyed.key), checked: Some(checked), made })
    }

    /// Adds what was seen of an instance, in the order of instances.
    fn enter(
        &self,
        id: InstanceId,
        looked: Looked,
        survey: &mut Survey,
        first_of: &mut DigestMap<InstanceId>,
        warned: &mut Warned,
    ) {
        let Look { mut state, key, checked, made } = match looked {
            Ok(look) => look,
            Err(mut mistakes) => return survey.problems.append(&mut mistakes),
        };
        if let State::Hit(brief) = &state {
            survey.outputs[id] = Some(brief.outputs.clone());
        }
        if let (State::Run { reasons }, Some(key)) = (&mut state, key) {
            let first = *first_of.entry(key).or_insert(id);
            if first != id {
                *reasons = [format!("the same as {}", self.plan.label(first))].into();
                survey.twins.insert(id, first);
            }
        }
        match checked {
            Some(Ok(sound)) => {
                self.note_extents(id, &sound.plan);
                survey.plans.insert(id, sound.plan);
                if self.is_read(id) {
                    self.note_forms(id, sound.forms);
                }
                for (warning, size) in sound.warnings {
                    warned.add(&mut survey.problems, warning, size);
                }
            }
            Some(Err(mut mistakes)) => {
                survey.problems.append(&mut mistakes);
                // What it makes is open: those that read it are not blamed for its mistakes.
                self.note_forms(id, Forms::new());
            }
            None => {}
        }
        match made {
            Some(Ok(outputs)) => survey.outputs[id] = Some(outputs),
            Some(Err(error)) => survey.problems.push(error),
            None => {}
        }
        let known = id.before().and_then(|before| survey.states[before].as_ref());
        survey.states[id] = Some(state.sharing(known));
    }

    /// The survey of a plan whose every instance is known to be up to date.
    pub fn up_to_date(&self, briefs: Vec<Arc<Brief>>) -> Survey {
        let mut survey = Survey::of(self.plan.instances().len());
        for (id, brief) in self.plan.needed_instances().zip(briefs) {
            survey.states[id] = Some(State::Hit(brief));
        }
        survey
    }

    /// The input files that were read, with what they held.
    pub fn files_read(&self) -> Vec<(PathBuf, Digest)> {
        self.files.read()
    }

    /// The state of one instance, given the outputs of those before it, and its job if it has to run.
    pub fn state(
        &self,
        id: InstanceId,
        outputs: &AllOutputs,
        forced: bool,
    ) -> Result<(State, Option<Keyed>), Vec<Diagnostic>> {
        let mut waits: Vec<StageId> = Vec::new();
        for (source, port) in self.plan.sources(id) {
            if outputs[source].as_ref().is_some_and(|outputs| outputs.has(port)) {
                continue;
            }
            let stage = self.plan.stage_of(source);
            if !waits.contains(&stage) {
                waits.push(stage);
            }
        }
        if !waits.is_empty() {
            return Ok((State::Waits(waits.into()), None));
        }
        let keyed = self.keyed(id, outputs)?;
        let record = self.store.record(&keyed.key);
        if forced {
            return Ok((State::run("forced".to_owned()), Some(keyed)));
        }
        let Some(record) = record else {
            let reasons = self.history.reasons(self.plan, id, &keyed.dependencies);
            return Ok((State::Run { reasons }, Some(keyed)));
        };
        let stage = self.plan.stage_of(id);
        let brief = Brief::of(&record, self.plan.outputs(stage));
        let missing: Vec<&str> =
            self.plan.wanted(stage).iter().copied().filter(|port| !brief.outputs.has(port)).collect();
        if missing.is_empty() {
            let released = self.released(id, &brief.outputs);
            if released.is_empty() {
                return Ok((State::Hit(Arc::new(brief)), None));
            }
            let reason = format!("needed again, and its bytes were released: {}", released.join(", "));
            return Ok((State::run(reason), Some(keyed)));
        }
        Ok((State::run(format!("newly wanted: {}", missing.join(", "))), Some(keyed)))
    }

    /// The input files of an instance that runs, as they were hashed; an error where they are not so any more.
    pub fn lend(&self, keyed: &Keyed) -> Result<Lent, String> {
        self.files.lend(&keyed.files, true)
    }

    /// The results of earlier runs.
    pub fn history(&self) -> &History<'a> {
        &self.history
    }

    /// What is known of an instance's inputs by now, but for its files and for the sizes of its inputs.
    pub fn known(&self, id: InstanceId, outputs: &AllOutputs) -> Known {
        let wires = self.plan.wires(id);
        let mut known = Known {
            connected: wires.iter().map(|w| w.port.to_owned()).collect(),
            wanted: self.plan.wanted(self.plan.stage_of(id)).iter().map(|port| (*port).to_owned()).collect(),
            forms: self.forms_of_inputs(id, outputs),
            ..Known::default()
        };
        for wire in &wires {
            let Some((first, port)) = wire.from.first() else { continue };
            let producer = self.plan.stage_of(*first);
            let label = format!("{}.{port}", self.plan.spec.stages[producer].name);
            known.producers.insert(wire.port.to_owned(), label);
            if wire.many {
                let axes = wire.from.iter().map(|(id, _)| self.plan.values(*id));
                known.axes.insert(wire.port.to_owned(), axes.collect());
            }
            if wire.from.len() > 1 {
                continue;
            }
            if let Some(from) = self.plan.outputs(producer).iter().find(|p| p.name == *port) {
                known.payloads.insert(wire.port.to_owned(), from.payload.to_owned());
            }
            if self.plan.row(producer).instant
                && let Some(artifact) = self.artifact(*first, port, outputs)
            {
                known.artifacts.insert(wire.port.to_owned(), artifact);
            }
        }
        known
    }

    /// What the stage says of an instance whose inputs are there: method, kernel, what it leaves out. `None` where it finds a mistake.
    pub fn stage_plan(&self, id: InstanceId, outputs: &AllOutputs) -> Option<StagePlan> {
        let keyed = self.keyed(id, outputs).ok()?;
        self.check(id, &*keyed.job, &keyed.files, outputs).ok().map(|sound| StagePlan::clone(&sound.plan))
    }

    /// The stage's own check and plan, with all inputs that are known by now, and the forms of its outputs.
    fn check(
        &self,
        id: InstanceId,
        job: &dyn Job,
        files: &BTreeMap<String, InputFile>,
        outputs: &AllOutputs,
    ) -> Checked {
        let mut known = self.known(id, outputs);
        let whole = |message: String| {
            vec![self.plan.spec.diagnostic(self.plan.stage_of(id), Section::Stage, &[] as &[&str], message, None)]
        };
        let lent = self.files.lend(files, false).map_err(whole)?;
        known.files = lent.files.clone();
        let mut problems = Problems::default();
        job.check(&known, &mut problems);
        if let Some(message) = lent.failed() {
            return Err(whole(message));
        }
        let ranked = problems.take_ranked();
        let (mistakes, warnings) = problems.into_parts();
        let place = |p: Problem| self.problem_diagnostic(id, p);
        if !mistakes.is_empty() {
            return Err(mistakes.into_iter().map(place).collect());
        }
        let warnings = warnings.into_iter().map(|p| (p, 0.0)).chain(ranked);
        let warnings = warnings.map(|(p, size)| (place(p).warning(), size)).collect();
        let forms = if self.is_read(id) { job.describe(&known) } else { Forms::new() };
        known.extents = self.extents_of_inputs(id, outputs);
        let mut plan = job.plan(&known);
        plan.memory = need(&plan, &known.extents);
        Ok(Sound { plan: self.shared(self.plan.stage_of(id), plan), forms, warnings })
    }

    /// The plan, or an equal one of another instance of the stage.
    fn shared(&self, stage: StageId, plan: StagePlan) -> Arc<StagePlan> {
        let mut plans = lock(&self.plans);
        if let Some(known) = plans.get(&stage).filter(|known| ***known == plan) {
            return known.clone();
        }
        let plan = Arc::new(plan);
        plans.insert(stage, plan.clone());
        plan
    }

    fn problem_diagnostic(&self, id: InstanceId, problem: Problem) -> Diagnostic {
        self.plan.spec.problem(self.plan.stage_of(id), problem)
    }

    fn error_diagnostic(&self, id: InstanceId, error: &Error) -> Diagnostic {
        match error {
            Error::Invalid(problem) => self.problem_diagnostic(id, problem.clone()),
            other => self.plan.spec.diagnostic(
                self.plan.stage_of(id),
                Section::Stage,
                &[] as &[&str],
                other.to_string(),
                None,
            ),
        }
    }

    /// What an instance made, from memory or from the store.
    fn artifact(&self, id: InstanceId, port: &str, outputs: &AllOutputs) -> Option<Shared> {
        let kept = lock(&self.instant).get(&id).cloned();
        if let Some(artifact) = kept.and_then(|ports| ports.get(port).cloned()) {
            return Some(artifact);
        }
        let blob = outputs[id].as_ref()?.get(port)?;
        if let Some(artifact) = lock(&self.fetched).get(&blob.digest) {
            return Some(artifact.clone());
        }
        let artifact = match self.store.get(blob) {
            Ok(artifact) => Shared::new(artifact),
            Err(_) => return self.made_again(id, port, outputs),
        };
        let mut fetched = lock(&self.fetched);
        if fetched.len() >= FETCHED {
            fetched.clear();
        }
        fetched.insert(blob.digest, artifact.clone());
        Some(artifact)
    }

    /// Runs an instant stage in memory, so that what follows has a key and can be checked.
    fn run_instant(&self, id: InstanceId, keyed: &Keyed, outputs: &AllOutputs) -> Result<Outputs, Error> {
        let stage = self.plan.stage_of(id);
        let lent = self.files.lend(&keyed.files, false).map_err(Error::failed)?;
        let wanted = self.plan.wanted(stage);
        let previews = self.plan.outputs(stage).iter().filter(|p| p.preview).map(|p| p.name).collect::<Vec<_>>();
        let host = MemoryHost {
            seed: keyed.seed,
            files: lent.files.clone(),
            // Nobody depends on pictures: they are left to the run.
            wanted: wanted.iter().filter(|p| !previews.contains(p)).map(|p| (*p).to_owned()).collect(),
            ..MemoryHost::default()
        };
        let inputs = KnownInputs { resolver: self, wires: self.plan.wires(id), outputs };
        let made = keyed.job.run_in_memory(&inputs, Ctx::new(&host));
        let made = made.map_err(|error| lent.failed().map_or(error, Error::failed))?;
        let mut blobs = Vec::new();
        let mut artifacts = BTreeMap::new();
        for (port, artifact) in made {
            let bytes = encode(artifact.artifact()).map_err(|e| Error::failed(e.to_string()))?;
            let kind = artifact.artifact().kind();
            let blob = Blob { digest: Digest::of(&bytes), kind, bytes: bytes.len() as u64 };
            blobs.push((port, blob));
            artifacts.insert(port.to_owned(), artifact);
        }
        lock(&self.instant).insert(id, Arc::new(artifacts));
        Ok(blobs.into_iter().collect())
    }
}

fn is_error(diagnostic: &Diagnostic) -> bool {
    diagnostic.severity == Severity::Error
}
