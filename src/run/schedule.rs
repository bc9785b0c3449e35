//! What begins next, and what follows from the end of an instance.

use std::collections::{HashMap, HashSet};
use std::hash::{BuildHasher, Hasher, RandomState};
use std::sync::Arc;
use std::time::{Duration, Instant};

use crate::brief::{Brief, Outputs};
use crate::digest::Digest;
use crate::plan::{Id, IdVec, InstanceId, Plan};
use crate::resolve::{AllOutputs, Keyed, Resolver, State, Survey};
use crate::spec::Diagnostic;
use crate::store::{Cost, InstanceRecord, KeyLock, StoreError};

use super::admission::Admission;
use super::dependents::{Dependents, producers};
use super::elsewhere::Elsewhere;
use super::execute::{Outcome, Task};
use super::options::Options;
use super::progress::Progress;
use super::state::{BuildState, States};
use super::summary::End;

/// A damaged input makes its producer run again; this often, then the disk is to blame.
const MAX_REPAIRS: usize = 3;
/// Less is not worth the way to other threads, CPU s: waking them and waiting for them takes a tenth of that.
const LIGHT_S: f64 = 1e-3;

/// The needed instances of a run, and what they wait for.
///
/// Always: an instance that is `Want` misses as many of its producers as are not `Done`; `outputs` are those of the `Done` ones.
pub struct Schedule<'a> {
    pub resolver: &'a Resolver<'a>,
    pub options: &'a Options,
    pub progress: &'a dyn Progress,
    plan: &'a Plan,
    states: States,
    outputs: AllOutputs,
    /// The needed instances that consume an instance.
    dependents: Dependents,
    repairs: HashMap<InstanceId, usize>,
    /// Keys that this run makes or has made, each with the instance that does.
    made_by: HashMap<Digest, InstanceId>,
    /// Those that wait for an instance of their key, which is running.
    twins: HashMap<InstanceId, Vec<InstanceId>>,
    /// Those that ran although the store held their outputs.
    forced: HashSet<InstanceId>,
    admission: Admission,
    /// Those that take less time than the way to other threads, by their stages' own figures.
    light: IdVec<InstanceId, bool>,
    /// Nothing begins any more.
    stopping: bool,
    began: Instant,
    /// Those at which other processes are at work.
    elsewhere: Elsewhere,
    /// Whether another process was met at the same work.
    met: bool,
    /// Where the next one is taken from: apart from where others are. The beginning while nobody was met.
    start: Option<InstanceId>,
}

impl<'a> Schedule<'a> {
    pub fn new(resolver: &'a Resolver<'a>, survey: Survey, options: &'a Options, progress: &'a dyn Progress) -> Self {
        let plan = resolver.plan;
        let needs = survey.plans.iter().filter_map(|(id, plan)| Some((id, plan.memory?)));
        let mut schedule = Self {
            resolver,
            options,
            progress,
            plan,
            states: States::new(plan.instances().len()),
            outputs: AllOutputs::filled(None, plan.instances().len()),
            dependents: Dependents::default(),
            repairs: HashMap::new(),
            made_by: HashMap::new(),
            twins: HashMap::new(),
            forced: HashSet::new(),
            admission: Admission::new(options.memory, needs),
            light: IdVec::filled(false, plan.instances().len()),
            stopping: false,
            began: Instant::now(),
            elsewhere: Elsewhere::default(),
            met: false,
            start: None,
        };
        for (id, detail) in survey.plans.iter() {
            schedule.light[id] = detail.seconds.is_some_and(|seconds| seconds < LIGHT_S);
        }
        for (id, state) in plan.instances().zip(survey.states) {
            if let Some(State::Hit(brief)) = state {
                schedule.states.set(id, BuildState::Done { brief, ran: false });
            }
        }
        if plan.needed_instances().any(|id| !schedule.states.is_done(id)) {
            schedule.connect();
        }
        schedule
    }

    /// Sources come before what they feed, so what is done is known.
    fn connect(&mut self) {
        self.dependents = Dependents::of(self.plan);
        for id in self.plan.needed_instances() {
            match self.states.get(id) {
                BuildState::Done { brief, .. } => self.outputs[id] = Some(brief.outputs.clone()),
                _ => self.want(id),
            }
        }
    }

    pub fn running(&self) -> usize {
        self.states.running()
    }

    /// Whether something waits for its turn.
    pub fn has_work(&self) -> bool {
        self.states.first_ready().is_some()
    }

    /// Whether something is to be looked at again when another process is done with it.
    pub fn waits_for_others(&self) -> bool {
        !self.elsewhere.is_empty() && !self.stopping
    }

    /// How long nothing begins unless something ends here.
    pub fn pause(&self) -> Duration {
        let may_begin = self.waits_for_others() && self.running() < self.options.jobs;
        if may_begin { self.elsewhere.pause(self.began.elapsed()) } else { Duration::MAX }
    }

    /// How each needed instance ended; to be asked when nothing is at work.
    pub fn into_ends(self) -> HashMap<InstanceId, End> {
        self.states.ends(self.plan.needed_instances())
    }

    /// The next instance to be at work, if one may begin now. Those before it that turn out to be made already, or cannot run, end on the way;
    /// those at which other processes are at work are left for later.
    pub fn next_task(&mut self, cancelled: &dyn Fn() -> bool) -> Option<Task> {
        while self.running() < self.options.jobs && !self.stopping && !cancelled() {
            self.look_elsewhere();
            let id = self.start.map_or_else(|| self.states.first_ready(), |start| self.states.ready_from(start))?;
            if !self.admission.admits(id, self.running() > 0) {
                return None;
            }
            if let Some((job, reasons)) = self.start(id)
                && let Some(lock) = self.hold(id, &job.key, cancelled)
            {
                self.made_by.insert(job.key, id);
                if self.is_forced(id) {
                    self.forced.insert(id);
                }
                self.resolver.describe(id, &job, &self.outputs);
                self.progress.started(&self.plan.label(id), &reasons);
                self.states.set(id, BuildState::Running);
                self.admission.begin(id);
                let forced = self.forced.contains(&id);
                let (alone, is_light) = (self.running() == 1, self.light[id]);
                return Some(Task { id, job, outputs: self.inputs_of(id), forced, alone, is_light, lock });
            }
        }
        None
    }

    /// There is no thread for it now.
    pub fn put_back(&mut self, id: InstanceId) {
        self.admission.end(id);
        self.states.set(id, BuildState::Ready);
    }

    /// The work of an instance whose turn it is. `None`: an instance of the same key or another run made it or is making it, or it cannot run;
    /// it is not `Ready` any more.
    fn start(&mut self, id: InstanceId) -> Option<(Keyed, Arc<[String]>)> {
        // Where others are at the same work, what they have made since need not begin.
        if self.met
            && let Err(error) = self.resolver.store.refresh()
        {
            self.fail(id, error.to_string());
            return None;
        }
        match self.resolver.state(id, &self.outputs, self.is_forced(id)) {
            Ok((State::Run { reasons }, job)) => {
                let job = job.expect("an instance that runs has a job");
                if let Some(first) = self.made_by.get(&job.key).filter(|first| self.states.is_running(**first)) {
                    self.twins.entry(*first).or_default().push(id);
                    self.states.set(id, BuildState::Twin);
                    return None;
                }
                Some((job, reasons))
            }
            Ok((State::Hit(brief), _)) => {
                // It was planned to run, and so it did: once for all instances of its key.
                match self.made_by.get(&brief.key) {
                    Some(&first) if first != id => self.share(id, &brief),
                    _ => {
                        if self.met {
                            self.progress.found(&self.plan.label(id));
                        }
                        self.done(id, brief, false);
                    }
                }
                None
            }
            // A producer was found damaged meanwhile and is made again, or its record lacks a port.
            Ok((State::Waits(_), _)) => {
                match self.lacking(id) {
                    Some(producer) => self.repair(id, producer),
                    None => self.want(id),
                }
                None
            }
            Err(diagnostics) => {
                let text: Vec<String> = diagnostics.iter().map(Diagnostic::to_string).collect();
                self.fail(id, text.join("\n"));
                None
            }
        }
    }

    /// The lock of an instance that is to begin. `None`: another process holds it, and this one goes on somewhere else.
    fn hold(&mut self, id: InstanceId, key: &Digest, cancelled: &dyn Fn() -> bool) -> Option<KeyLock> {
        match self.resolver.store.try_lock(key, cancelled) {
            Ok(Some(lock)) => return Some(lock),
            Ok(None) => {
                self.states.set(id, BuildState::Elsewhere);
                self.elsewhere.add(id, *key, self.began.elapsed());
                self.met = true;
                self.go_apart();
            }
            // The caller asks the same.
            Err(StoreError::Cancelled) => {}
            Err(error) => self.fail(id, error.to_string()),
        }
        None
    }

    /// Goes on anywhere among what is ready, so that many processes do not try one after the other what others have. What they
    /// make does not depend on it.
    fn go_apart(&mut self) {
        if let (Some(first), Some(last)) = (self.states.first_ready(), self.states.last_ready()) {
            let (first, last) = (first.place(), last.place());
            let random = RandomState::new().build_hasher().finish() as usize;
            self.start = Some(InstanceId::new(first + random % (last - first + 1)));
        }
    }

    /// What other processes have finished, or died at, is ready again: it is found in the store, or begins here.
    fn look_elsewhere(&mut self) {
        let store = self.resolver.store;
        let is_free = |key: &Digest| !matches!(store.try_lock(key, &|| true), Ok(None));
        for id in self.elsewhere.freed(self.began.elapsed(), is_free) {
            self.states.set(id, BuildState::Ready);
        }
    }

    /// Whether the user asked that it runs even where the store holds its outputs.
    fn is_forced(&self, id: InstanceId) -> bool {
        self.options.force.contains(&self.plan.stage_of(id))
    }

    /// The work of an instance was done by another one of the same key: at no cost.
    fn share(&mut self, id: InstanceId, brief: &Brief) {
        if let Some(record) = self.resolver.store.record(&brief.key) {
            self.progress.ran(&self.plan.label(id), &self.shared(id, &record));
        }
        self.done(id, Arc::new(brief.shared()), true);
    }

    fn shared(&self, id: InstanceId, record: &InstanceRecord) -> InstanceRecord {
        let mut own = record.clone();
        own.provenance.stage = self.plan.stage_name(id).to_owned();
        own.provenance.axes = self.plan.axes(id);
        own.cost = Cost::default();
        own
    }

    /// The outputs of the producers of `id`, and no others.
    fn inputs_of(&self, id: InstanceId) -> HashMap<InstanceId, Outputs> {
        let outputs = |s: InstanceId| self.outputs[s].clone().expect("it has a key, so its inputs are there");
        producers(self.plan, id).into_iter().map(|source| (source, outputs(source))).collect()
    }

    /// A producer of `id` whose outputs are known and lack the port that it needs.
    fn lacking(&self, id: InstanceId) -> Option<InstanceId> {
        let lacks = |(source, port): &(InstanceId, &str)| {
            self.outputs[*source].as_ref().is_some_and(|outputs| !outputs.has(port))
        };
        self.plan.sources(id).find(lacks).map(|(source, _)| source)
    }

    /// An instance that was at work ended.
    pub fn finish(&mut self, id: InstanceId, outcome: Outcome) {
        self.admission.end(id);
        self.resolver.forget(id);
        match outcome {
            Outcome::Ran(record) => {
                self.progress.ran(&self.plan.label(id), &record);
                self.done(id, self.brief(id, &record), true);
            }
            Outcome::Found(record) => {
                self.met = true;
                self.progress.found(&self.plan.label(id));
                self.done(id, self.brief(id, &record), false);
            }
            Outcome::Damaged(producer) => self.repair(id, producer),
            Outcome::Failed(message) => self.fail(id, message),
            Outcome::Interrupted => self.states.set(id, BuildState::Skipped),
        }
        for twin in self.twins.remove(&id).unwrap_or_default() {
            self.want(twin);
        }
    }

    fn brief(&self, id: InstanceId, record: &InstanceRecord) -> Arc<Brief> {
        Arc::new(Brief::of(record, self.plan.outputs(self.plan.stage_of(id))))
    }

    fn done(&mut self, id: InstanceId, brief: Arc<Brief>, ran: bool) {
        self.outputs[id] = Some(brief.outputs.clone());
        self.states.set(id, BuildState::Done { brief, ran });
        for dependent in self.dependents.of_one(id) {
            match *self.states.get(dependent) {
                BuildState::Want { missing: 1 } => self.states.set(dependent, BuildState::Ready),
                BuildState::Want { missing } => self.states.set(dependent, BuildState::Want { missing: missing - 1 }),
                _ => {}
            }
        }
    }

    fn fail(&mut self, id: InstanceId, message: String) {
        self.progress.failed(&self.plan.label(id), &message);
        self.states.set(id, BuildState::Failed(message));
        self.stopping |= !self.options.keep_going;
    }

    /// A blob of `producer` is damaged: it runs again, and `id` waits for it.
    fn repair(&mut self, id: InstanceId, producer: InstanceId) {
        let times = self.repairs.entry(producer).or_default();
        *times += 1;
        let (times, label) = (*times, self.plan.label(producer));
        if times > MAX_REPAIRS {
            let text = format!("the stored outputs of {label} were damaged {times} times over; check the disk");
            return self.fail(id, text);
        }
        // Its bytes may have been released meanwhile: its record alone will not do.
        let ports = self.outputs[producer].iter().flat_map(|outputs| outputs.iter());
        ports.for_each(|(port, _)| self.resolver.ask(producer, port));
        if self.states.is_done(producer) {
            self.progress.warn(&label, "a stored output is damaged or gone; it is made again");
            self.undo(producer);
        }
        self.want(id);
    }

    /// What was done is not there any more: it is to be made again, and who waits for others too now waits for it as well.
    fn undo(&mut self, id: InstanceId) {
        self.outputs[id] = None;
        self.want(id);
        for dependent in self.dependents.of_one(id) {
            match *self.states.get(dependent) {
                BuildState::Want { missing } => self.states.set(dependent, BuildState::Want { missing: missing + 1 }),
                BuildState::Ready => self.states.set(dependent, BuildState::Want { missing: 1 }),
                BuildState::Elsewhere => {
                    self.elsewhere.remove(dependent);
                    self.states.set(dependent, BuildState::Want { missing: 1 });
                }
                _ => {}
            }
        }
    }

    /// To `Want` or `Ready`, by what its producers have.
    fn want(&mut self, id: InstanceId) {
        let missing = producers(self.plan, id).iter().filter(|source| !self.states.is_done(**source)).count();
        self.states.set(id, if missing == 0 { BuildState::Ready } else { BuildState::Want { missing } });
    }
}
