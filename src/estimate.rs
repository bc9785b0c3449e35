//! How long instances are going to take, in CPU seconds: by what the same work took before, by a pilot that is timed here and now, or by
//! a stage's own figures.
//!
//! Nothing of it enters a key or an output. Only `turbid plan` asks.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use cpu_time::ThreadTime;
use serde::Serialize;
use serde_json::Value;
use turbid_contract::{Ctx, Host, Job, Known, Pilot};

use crate::digest::Digest;
use crate::plan::{IdMap, InstanceId};
use crate::resolve::{Prepared, Resolver, State, Survey};
use crate::store::InstanceRecord;

/// Where an estimate comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Basis {
    /// What the same work, or a part of it, took before.
    Earlier,
    /// A pilot of this instance.
    Pilot,
    /// The stage's own figures, times what pilots of other instances of the stage took over theirs.
    Alike,
    /// The stage's own figures.
    Figures,
    /// A pilot that was not waited for any longer: the whole takes longer than that.
    AtLeast,
    /// Another instance with the same key does the work.
    Same,
}

/// What an instance is going to take.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// CPU seconds.
    pub seconds: f64,
    pub by: Basis,
    /// How much work that is, and its unit: the measure by which the record will say how much it was.
    pub work: Option<(f64, &'static str)>,
}

/// Pilots of one stage: those of a sweep are spread over it.
const PILOTS: usize = 8;
/// CPU seconds after which only the first instance of a stage is piloted.
const MOST_S: f64 = 0.15;
/// A first pilot that took less is repeated: the program's pages have to be fetched, and caches to be filled.
const COLD_S: f64 = 0.03;
/// How long one is waited for.
const MOST_WAIT: Duration = Duration::from_secs(2);
/// As much as a main thread has.
const STACK: usize = 8 << 20;

/// By instance.
pub type Estimates = IdMap<InstanceId, Estimate>;

/// The estimates of all instances that have to run or wait.
pub fn estimates(resolver: &Resolver<'_>, survey: &Survey) -> Estimates {
    let mut found = Estimates::default();
    let mut spent = 0.0;
    for &stage in &resolver.plan.needed {
        let mut open = Vec::new();
        for id in resolver.plan.instances_of(stage).filter(|id| survey.plans.contains_key(id)) {
            if survey.twins.contains_key(&id) {
                found.insert(id, Estimate { seconds: 0.0, by: Basis::Same, work: None });
            } else {
                open.push(id);
            }
        }
        // Evenly spread, the ends among them.
        let last = open.len().saturating_sub(1);
        let count = PILOTS.min(open.len());
        let mut piloted: Vec<usize> = (0..count).map(|k| if count > 1 { k * last / (count - 1) } else { 0 }).collect();
        piloted.dedup();
        // What pilots took, and what the stage's own figures say of the same.
        let (mut took, mut figured) = (0.0, 0.0);
        // Params that were read for a pilot.
        let mut read = BTreeMap::new();
        for (n, &place) in piloted.iter().enumerate() {
            if n > 0 && spent > MOST_S {
                break;
            }
            let id = open[place];
            let Some(mut asked) = Asked::of(resolver, survey, id) else { break };
            let told = timed(&mut asked, resolver.known(id, &survey.outputs), n == 0);
            let asked = read.entry(id).or_insert(asked);
            let Some((estimate, cpu_s)) = told else { break };
            spent += cpu_s;
            let Some(estimate) = estimate else {
                found.insert(id, Estimate { seconds: MOST_WAIT.as_secs_f64(), by: Basis::AtLeast, work: None });
                break;
            };
            took += estimate.seconds;
            figured += survey.plans[&id].seconds.unwrap_or(0.0);
            let known = earlier(resolver, id, asked, Some(&estimate)).unwrap_or(estimate);
            found.insert(id, known);
        }
        let scaled = if figured > 0.0 { took / figured } else { 1.0 };
        let by = if figured > 0.0 { Basis::Alike } else { Basis::Figures };
        let recorded = resolver.history().knows(resolver.plan.row(stage).name);
        for id in open {
            if found.contains_key(&id) {
                continue;
            }
            let figures = survey.plans[&id].seconds.map(|s| Estimate { seconds: s * scaled, by, work: None });
            let asked = read.remove(&id).or_else(|| if recorded { Asked::of(resolver, survey, id) } else { None });
            let before = asked.and_then(|asked| earlier(resolver, id, &asked, figures.as_ref()));
            if let Some(estimate) = before.or(figures) {
                found.insert(id, estimate);
            }
        }
    }
    found
}

/// An instance with its params read, once for all that is asked of it.
struct Asked {
    /// Taken by a pilot.
    job: Option<Box<dyn Job>>,
    canonical: Value,
    /// Of an instance that has a key.
    state_key: Option<Digest>,
    seed: u64,
}

impl Asked {
    /// `None` where the params are wrong.
    fn of(resolver: &Resolver<'_>, survey: &Survey, id: InstanceId) -> Option<Self> {
        if matches!(survey.states[id], Some(State::Run { .. })) {
            let keyed = resolver.keyed(id, &survey.outputs).ok()?;
            let (canonical, state_key) = (keyed.dependencies.params, keyed.state_key);
            return Some(Self { job: Some(keyed.job), canonical, state_key, seed: keyed.seed });
        }
        let Prepared { job, canonical, .. } = resolver.prepare(id).ok()?;
        Some(Self { job: Some(job), canonical, state_key: None, seed: 0 })
    }
}

/// By a pilot, if it ended in time, and the CPU seconds that it took; `None` where the stage has none.
///
/// On a thread of its own: a scene in which light does not end must not keep the plan from being told. That thread ends with the program.
fn timed(asked: &mut Asked, known: Known, first: bool) -> Option<(Option<Estimate>, f64)> {
    let (job, seed, (send, receive)) = (asked.job.take()?, asked.seed, channel());
    let walk = move || {
        let once = || {
            let host = PilotHost { seed, tiles_ns: AtomicU64::new(0) };
            let told = job.pilot(&known, Ctx::new(&host))?;
            Some((told, Duration::from_nanos(host.tiles_ns.into_inner()).as_secs_f64()))
        };
        let mut told = once().map(|(pilot, tiles_s)| (pilot, tiles_s, tiles_s));
        if let Some((pilot, tiles_s, spent)) = &mut told
            && first
            && *tiles_s < COLD_S
            && let Some((again, again_s)) = once()
        {
            (*pilot, *tiles_s, *spent) = (again, tiles_s.min(again_s), *spent + again_s);
        }
        // Nobody may wait any more.
        let _ = send.send(told);
    };
    std::thread::Builder::new().stack_size(STACK).spawn(walk).ok()?;
    match receive.recv_timeout(MOST_WAIT) {
        Ok(told) => told.map(|(Pilot { done, whole, unit, rest_s }, tiles_s, spent)| {
            let seconds = tiles_s * whole / done + rest_s;
            (Some(Estimate { seconds, by: Basis::Pilot, work: Some((whole, unit)) }), spent)
        }),
        Err(RecvTimeoutError::Timeout) => Some((None, MOST_WAIT.as_secs_f64())),
        // What is wrong with it, the run will say.
        Err(RecvTimeoutError::Disconnected) => None,
    }
}

/// By what the same work took before: as it was, or for more or fewer units of it.
fn earlier(resolver: &Resolver<'_>, id: InstanceId, asked: &Asked, now: Option<&Estimate>) -> Option<Estimate> {
    let row = resolver.plan.row(resolver.plan.stage_of(id));
    if !resolver.history().knows(row.name) {
        return None;
    }
    let work = now.and_then(|estimate| estimate.work);
    let same = asked.state_key.as_ref().and_then(|key| resolver.history().same_work(key));
    if let (Some((record, _)), Some((whole, unit))) = (same, work)
        && record.version == row.version
        && let Some(done) = measure(&record, unit)
    {
        return Some(Estimate { seconds: record.cost.cpu_s * whole / done, by: Basis::Earlier, work });
    }
    let record = resolver.history().same_params(resolver.plan, id, row.name, &asked.canonical)?;
    let took = record.version == row.version && record.cost.cpu_s > 0.0;
    took.then_some(Estimate { seconds: record.cost.cpu_s, by: Basis::Earlier, work })
}

/// The value of a measure, where it is above 0 and the work was not done by others.
fn measure(record: &InstanceRecord, name: &str) -> Option<f64> {
    let value = record.measures.iter().find(|(known, _, _)| known == name)?.1;
    (value > 0.0 && record.cost.cpu_s > 0.0).then_some(value)
}

/// Gives a pilot its seed and times its tiles; nothing else comes of it.
struct PilotHost {
    seed: u64,
    tiles_ns: AtomicU64,
}

impl Host for PilotHost {
    fn seed(&self) -> u64 {
        self.seed
    }
    fn cancelled(&self) -> bool {
        false
    }
    fn time_is_up(&self, _: f64) -> bool {
        false
    }
    fn progress(&self, _: f64, _: Option<f64>, _: &str) {}
    fn measure(&self, _: &str, _: f64, _: &str) {}
    fn warn(&self, _: &str) {}
    fn wants(&self, _: &str) -> bool {
        false
    }
    fn file(&self, _: &str) -> Option<Arc<[u8]>> {
        None
    }
    fn checkpoint(&self, _: &[u8], _: u64) {}
    fn resume(&self, _: u64) -> Option<Vec<u8>> {
        None
    }
    fn tiles(&self, n: usize, work: &(dyn Fn(usize) + Sync)) {
        let began = ThreadTime::now();
        (0..n).for_each(work);
        self.tiles_ns.fetch_add(began.elapsed().as_nanos() as u64, Ordering::Relaxed);
    }
    fn threads(&self) -> usize {
        1
    }
}
