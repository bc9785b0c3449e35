//! How long instances are going to take, in CPU seconds: by what the same work took before, by a pilot that is timed here and now, or by
//! a stage's own figures.
//!
//! Nothing of it enters a key or an output. Only `turbid plan` asks.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use cpu_time::ThreadTime;
use serde::Serialize;
use turbid_contract::{Host, Pilot};

use crate::plan::InstanceId;
use crate::resolve::{Job, Resolver, State, Survey};
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

/// The estimates of all instances that have to run or wait.
pub fn estimates(resolver: &Resolver<'_>, survey: &Survey) -> BTreeMap<InstanceId, Estimate> {
    let mut found = BTreeMap::new();
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
        for (n, &place) in piloted.iter().enumerate() {
            if n > 0 && spent > MOST_S {
                break;
            }
            let id = open[place];
            let Some((estimate, cpu_s)) = pilot(resolver, survey, id, n == 0) else { break };
            spent += cpu_s;
            took += estimate.seconds;
            figured += survey.plans[&id].seconds.unwrap_or(0.0);
            found.insert(id, estimate);
        }
        for id in open {
            let scaled = if figured > 0.0 { took / figured } else { 1.0 };
            let by = if figured > 0.0 { Basis::Alike } else { Basis::Figures };
            let figures = survey.plans[&id].seconds.map(|s| Estimate { seconds: s * scaled, by, work: None });
            let known = found.get(&id).copied().or(figures);
            if let Some(estimate) = earlier(resolver, survey, id, known.as_ref()).or(known) {
                found.insert(id, estimate);
            }
        }
    }
    found
}

/// The job of an instance that has a key.
fn job(resolver: &Resolver<'_>, survey: &Survey, id: InstanceId) -> Option<Job> {
    match survey.states[id] {
        Some(State::Run { .. }) => resolver.job(id, &survey.outputs).ok(),
        _ => None,
    }
}

/// By a pilot; and the CPU seconds that it took.
fn pilot(resolver: &Resolver<'_>, survey: &Survey, id: InstanceId, first: bool) -> Option<(Estimate, f64)> {
    let job = job(resolver, survey, id);
    let began = ThreadTime::now();
    let once = || {
        let host = PilotHost { seed: job.as_ref().map_or(0, |job| job.seed), tiles_ns: AtomicU64::new(0) };
        let pilot = resolver.pilot(id, job.as_ref(), survey, &host)?;
        Some((pilot, Duration::from_nanos(host.tiles_ns.into_inner()).as_secs_f64()))
    };
    let (pilot, mut tiles_s) = once()?;
    if first && tiles_s < COLD_S {
        tiles_s = tiles_s.min(once()?.1);
    }
    let Pilot { done, whole, unit, rest_s } = pilot;
    let seconds = tiles_s * whole / done + rest_s;
    Some((Estimate { seconds, by: Basis::Pilot, work: Some((whole, unit)) }, began.elapsed().as_secs_f64()))
}

/// By what the same work took before: as it was, or for more or fewer units of it.
fn earlier(resolver: &Resolver<'_>, survey: &Survey, id: InstanceId, now: Option<&Estimate>) -> Option<Estimate> {
    let stage = resolver.plan.instances[id].stage;
    let row = resolver.plan.row(stage);
    if !resolver.history().knows(row.name) {
        return None;
    }
    let job = job(resolver, survey, id);
    let work = now.and_then(|estimate| estimate.work);
    let same = job.as_ref().and_then(|job| resolver.history().same_work(job.state_key.as_ref()?));
    if let (Some(record), Some((whole, unit))) = (same, work)
        && record.version == row.version
        && let Some(done) = measure(record, unit)
    {
        return Some(Estimate { seconds: record.cost.cpu_s * whole / done, by: Basis::Earlier, work });
    }
    let prepared = resolver.prepare(id).ok()?.1;
    let record = resolver.history().same_params(resolver.plan, id, row.name, &prepared.canonical)?;
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
