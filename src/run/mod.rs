//! Runs what is stale: a scheduler over build states, side by side within a thread budget.
//!
//! Want -> Ready -> Running -> Done | Failed | Skipped; every transition is in [`Schedule`].

mod admission;
mod caption;
mod execute;
mod host;
mod inputs;
mod interrupt;
pub mod latest;
pub mod log;
mod name;
pub mod progress;
mod worker;

use std::collections::{BTreeSet, HashMap};
use std::sync::{Arc, mpsc};
use std::thread::ScopedJoinHandle;
use std::time::{Duration, Instant};

use crate::digest::Digest;
use crate::plan::{InstanceId, Plan};
use crate::resolve::{Keyed, Outputs, Resolver, State, Survey, outputs_of};
use crate::spec::Diagnostic;
use crate::store::{Cost, InstanceRecord};

use admission::Admission;
pub use interrupt::Interrupt;
pub use progress::Progress;

use execute::{Outcome, Task};
use worker::Worker;

/// How to run.
#[derive(Clone, Debug)]
pub struct Options {
    /// Threads of the run, and at most this many instances at once.
    pub jobs: usize,
    /// Go on with what does not depend on a failed instance.
    pub keep_going: bool,
    /// Stages that run even where the store holds their outputs.
    pub force: Vec<usize>,
    /// Store what they make even where it differs from what is stored.
    pub replace: bool,
    /// `baseline`, `v3`, `v4`, or empty for the best level of vector instructions.
    pub simd: String,
    /// Bytes of memory that instances may take together; `None` where nobody knows.
    pub memory: Option<u64>,
}

/// How an instance ended.
#[derive(Clone, Debug)]
pub enum End {
    Hit(Arc<InstanceRecord>),
    Ran(Arc<InstanceRecord>),
    Failed(String),
    /// Something that it needs failed, or the run stopped before its turn.
    Skipped,
}

/// What a run did.
#[derive(Default)]
pub struct Summary {
    pub ends: HashMap<InstanceId, End>,
    pub seconds: f64,
    pub interrupted: bool,
}

impl Summary {
    /// What a further round of the same run did. What ran in an earlier one did run, although it was found later.
    pub fn add(&mut self, more: Self) {
        for (id, end) in more.ends {
            match (self.ends.get(&id), &end) {
                (Some(End::Ran(before)), End::Hit(found)) if before.key == found.key => {}
                _ => drop(self.ends.insert(id, end)),
            }
        }
        self.seconds += more.seconds;
        self.interrupted |= more.interrupted;
    }

    pub fn count(&self, which: impl Fn(&End) -> bool) -> usize {
        self.ends.values().filter(|end| which(end)).count()
    }

    pub fn hits(&self) -> usize {
        self.count(|end| matches!(end, End::Hit(_)))
    }

    pub fn ran(&self) -> usize {
        self.count(|end| matches!(end, End::Ran(_)))
    }

    pub fn failed(&self) -> usize {
        self.count(|end| matches!(end, End::Failed(_)))
    }

    pub fn record(&self, id: InstanceId) -> Option<&Arc<InstanceRecord>> {
        match self.ends.get(&id) {
            Some(End::Hit(record) | End::Ran(record)) => Some(record),
            _ => None,
        }
    }
}

/// A damaged input makes its producer run again; this often, then the disk is to blame.
const MAX_REPAIRS: usize = 3;

/// Runs what the survey found stale. The survey must be free of errors.
///
/// Error: the system starts no threads.
pub fn run(
    resolver: &Resolver<'_>,
    survey: Survey,
    options: &Options,
    progress: &dyn Progress,
    interrupt: &Interrupt,
) -> Result<Summary, String> {
    let began = Instant::now();
    let mut schedule = Schedule::new(resolver, survey, options);
    if !schedule.ready.is_empty() {
        schedule.work(progress, interrupt)?;
    }
    for id in resolver.plan.needed_instances() {
        schedule.ends.entry(id).or_insert(End::Skipped);
    }
    Ok(Summary { ends: schedule.ends, seconds: began.elapsed().as_secs_f64(), interrupted: interrupt.requested() })
}

/// Build states of all needed instances.
struct Schedule<'a> {
    resolver: &'a Resolver<'a>,
    plan: &'a Plan,
    options: &'a Options,
    outputs: Vec<Option<Arc<Outputs>>>,
    /// Instances that consume an instance (needed ones only).
    dependents: HashMap<InstanceId, Vec<InstanceId>>,
    /// Want: how many of its producers are not done.
    missing: HashMap<InstanceId, usize>,
    ready: BTreeSet<InstanceId>,
    running: BTreeSet<InstanceId>,
    ends: HashMap<InstanceId, End>,
    forced: BTreeSet<InstanceId>,
    repairs: HashMap<InstanceId, usize>,
    /// Keys that this run makes or has made, each with the instance that does.
    made_by: HashMap<Digest, InstanceId>,
    /// Instances that wait for another with the same key, which is running.
    twins: HashMap<InstanceId, Vec<InstanceId>>,
    admission: Admission,
    stopping: bool,
}

impl<'a> Schedule<'a> {
    fn new(resolver: &'a Resolver<'a>, survey: Survey, options: &'a Options) -> Self {
        let plan = resolver.plan;
        let mut schedule = Self {
            resolver,
            plan,
            options,
            outputs: vec![None; plan.instances.len()],
            dependents: HashMap::new(),
            missing: HashMap::new(),
            ready: BTreeSet::new(),
            running: BTreeSet::new(),
            ends: HashMap::new(),
            forced: BTreeSet::new(),
            repairs: HashMap::new(),
            made_by: HashMap::new(),
            twins: HashMap::new(),
            admission: Admission::new(
                options.memory,
                survey.plans.iter().filter_map(|(&id, plan)| Some((id, plan.memory?))),
            ),
            stopping: false,
        };
        let mut stale = false;
        for (id, state) in survey.states.into_iter().enumerate() {
            match state {
                Some(State::Hit(record)) => {
                    schedule.outputs[id] = Some(Arc::new(outputs_of(&record)));
                    schedule.ends.insert(id, End::Hit(record));
                }
                Some(_) => stale = true,
                None => {}
            }
        }
        if stale {
            schedule.connect();
        }
        schedule
    }

    fn connect(&mut self) {
        for id in self.plan.needed_instances() {
            let sources: BTreeSet<InstanceId> =
                self.plan.instances[id].wires.iter().flat_map(|w| w.from.iter().map(|f| f.0)).collect();
            for &source in &sources {
                self.dependents.entry(source).or_default().push(id);
            }
            if self.ends.contains_key(&id) {
                continue;
            }
            let missing = sources.iter().filter(|s| !self.ends.contains_key(s)).count();
            self.missing.insert(id, missing);
            if missing == 0 {
                self.ready.insert(id);
            }
        }
    }

    fn work(&mut self, progress: &dyn Progress, interrupt: &Interrupt) -> Result<(), String> {
        let jobs = self.options.jobs;
        let pool = rayon::ThreadPoolBuilder::new().num_threads(jobs).thread_name(|i| format!("turbid-{i}")).build();
        let pool = pool.map_err(|e| format!("{jobs} threads cannot be started: {e}; take fewer with -j"))?;
        let (send, receive) = mpsc::channel::<(InstanceId, Outcome)>();
        std::thread::scope(|scope| {
            let mut threads: HashMap<InstanceId, ScopedJoinHandle<'_, ()>> = HashMap::new();
            loop {
                while self.running.len() < self.options.jobs && !self.stopping && !interrupt.requested() {
                    let Some(&id) = self.ready.first() else { break };
                    if !self.admission.admits(id, !self.running.is_empty()) {
                        break;
                    }
                    self.ready.remove(&id);
                    let Some((job, reasons)) = self.start(id, progress) else { continue };
                    progress.started(&self.plan.label(id), &reasons);
                    self.running.insert(id);
                    self.admission.begin(id);
                    let task = Task {
                        id,
                        job,
                        outputs: self.inputs_of(id),
                        forced: self.forced.contains(&id),
                        alone: self.running.len() == 1,
                    };
                    let worker =
                        Worker { resolver: self.resolver, pool: &pool, options: self.options, progress, interrupt };
                    let send = send.clone();
                    let work = move || {
                        let outcome = execute::execute(worker, task);
                        // The receiver outlives every worker: it stands outside the scope.
                        let _ = send.send((id, outcome));
                    };
                    match std::thread::Builder::new().spawn_scoped(scope, work) {
                        Ok(thread) => drop(threads.insert(id, thread)),
                        // There were threads enough for the others: it waits until one of them is free.
                        Err(_) if self.running.len() > 1 => {
                            self.running.remove(&id);
                            self.admission.end(id);
                            self.ready.insert(id);
                            break;
                        }
                        Err(error) => {
                            let text = format!("no thread can be started for it: {error}; take fewer with -j");
                            self.finish(id, Outcome::Failed(text), progress);
                        }
                    }
                }
                if self.running.is_empty() {
                    break;
                }
                let ended: Vec<InstanceId> =
                    threads.iter().filter(|(_, t)| t.is_finished()).map(|(id, _)| *id).collect();
                match receive.recv_timeout(Duration::from_secs(1)) {
                    Ok((id, outcome)) => {
                        threads.remove(&id);
                        self.finish(id, outcome, progress);
                    }
                    // What had ended before the wait has sent what became of it, or never will.
                    Err(_) => {
                        for id in ended {
                            threads.remove(&id);
                            let text = "internal error, please report it: its thread ended without a word".to_owned();
                            self.finish(id, Outcome::Failed(text), progress);
                        }
                    }
                }
            }
        });
        Ok(())
    }

    /// Ready -> Running, or straight to Done where an instance of the same key or another run made it meanwhile.
    fn start(&mut self, id: InstanceId, progress: &dyn Progress) -> Option<(Keyed, Vec<String>)> {
        match self.resolver.state(id, &self.outputs, &self.options.force) {
            Ok((State::Run { reasons }, job)) => {
                let job = job.expect("an instance that runs has a job");
                if let Some(first) = self.made_by.get(&job.key).filter(|first| self.running.contains(first)) {
                    self.twins.entry(*first).or_default().push(id);
                    return None;
                }
                self.made_by.insert(job.key, id);
                if self.options.force.contains(&self.plan.instances[id].stage) {
                    self.forced.insert(id);
                }
                Some((job, reasons))
            }
            Ok((State::Hit(record), _)) => {
                // It was planned to run, and so it did: once for all instances of its key.
                let end = match self.made_by.get(&record.key) {
                    Some(&first) if first != id => {
                        let shared = Arc::new(self.shared(id, &record));
                        progress.ran(&self.plan.label(id), &shared);
                        End::Ran(shared)
                    }
                    _ => End::Hit(record),
                };
                self.done(id, end);
                None
            }
            // A producer was found damaged meanwhile and is made again, or its record lacks a port.
            Ok((State::Waits(_), _)) => {
                match self.lacking(id) {
                    Some(producer) => self.repair(id, producer, progress),
                    None => self.want(id),
                }
                None
            }
            Err(diagnostics) => {
                let text: Vec<String> = diagnostics.iter().map(Diagnostic::to_string).collect();
                self.fail(id, text.join("\n"), progress);
                None
            }
        }
    }

    /// The record of an instance whose work another one of the same key did: at no cost.
    fn shared(&self, id: InstanceId, record: &InstanceRecord) -> InstanceRecord {
        let mut own = record.clone();
        let instance = &self.plan.instances[id];
        own.provenance.stage = self.plan.spec.stages[instance.stage].name.clone();
        own.provenance.axes = instance.axes.clone();
        own.cost = Cost::default();
        own
    }

    /// The outputs of the producers of `id`, and no others.
    fn inputs_of(&self, id: InstanceId) -> HashMap<InstanceId, Arc<Outputs>> {
        let sources = self.plan.instances[id].wires.iter().flat_map(|w| w.from.iter().map(|f| f.0));
        sources.map(|s| (s, self.outputs[s].clone().expect("it has a key, so its inputs are there"))).collect()
    }

    /// A producer of `id` whose outputs are known and lack the port that it needs.
    fn lacking(&self, id: InstanceId) -> Option<InstanceId> {
        let mut sources = self.plan.instances[id].wires.iter().flat_map(|w| &w.from);
        let lacks = |(source, port): &&(InstanceId, &str)| {
            self.outputs[*source].as_ref().is_some_and(|outputs| !outputs.contains_key(*port))
        };
        sources.find(lacks).map(|(source, _)| *source)
    }

    fn finish(&mut self, id: InstanceId, outcome: Outcome, progress: &dyn Progress) {
        self.running.remove(&id);
        self.admission.end(id);
        self.ready.extend(self.twins.remove(&id).unwrap_or_default());
        match outcome {
            Outcome::Ran(record) => {
                progress.ran(&self.plan.label(id), &record);
                self.done(id, End::Ran(record));
            }
            Outcome::Found(record) => {
                progress.found(&self.plan.label(id));
                self.done(id, End::Hit(record));
            }
            Outcome::Damaged(producer) => self.repair(id, producer, progress),
            Outcome::Failed(message) => self.fail(id, message, progress),
            Outcome::Interrupted => {}
        }
    }

    fn done(&mut self, id: InstanceId, end: End) {
        if let End::Hit(record) | End::Ran(record) = &end {
            self.outputs[id] = Some(Arc::new(outputs_of(record)));
        }
        self.ends.insert(id, end);
        for dependent in self.dependents.get(&id).cloned().unwrap_or_default() {
            if let Some(missing) = self.missing.get_mut(&dependent) {
                *missing -= 1;
                if *missing == 0 {
                    self.missing.remove(&dependent);
                    self.ready.insert(dependent);
                }
            }
        }
        self.missing.remove(&id);
    }

    fn fail(&mut self, id: InstanceId, message: String, progress: &dyn Progress) {
        progress.failed(&self.plan.label(id), &message);
        self.ends.insert(id, End::Failed(message));
        self.stopping |= !self.options.keep_going;
    }

    /// A blob of `producer` is damaged: it runs again, and `id` waits for it.
    fn repair(&mut self, id: InstanceId, producer: InstanceId, progress: &dyn Progress) {
        let times = self.repairs.entry(producer).or_default();
        *times += 1;
        let (times, label) = (*times, self.plan.label(producer));
        if times > MAX_REPAIRS {
            self.fail(
                id,
                format!("the stored outputs of {label} were damaged {times} times over; check the disk"),
                progress,
            );
            return;
        }
        if self.outputs[producer].take().is_some() {
            progress.warn(&label, "a stored output is damaged or gone; it is made again");
            self.ends.remove(&producer);
            self.want(producer);
        }
        self.want(id);
    }

    /// Anything -> Want or Ready, by what its producers have.
    fn want(&mut self, id: InstanceId) {
        let sources: BTreeSet<InstanceId> =
            self.plan.instances[id].wires.iter().flat_map(|w| w.from.iter().map(|f| f.0)).collect();
        let missing = sources.iter().filter(|s| self.outputs[**s].is_none()).count();
        if missing == 0 {
            self.ready.insert(id);
        } else {
            self.missing.insert(id, missing);
        }
    }
}

#[cfg(test)]
mod tests;
