//! Running one instance under the lock of its key: look again, run, publish.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex};
use std::time::{SystemTime, UNIX_EPOCH};

use serde_json::Value;
use turbid_contract::payload::undeclared;
use turbid_contract::{Artifact, Ctx, Error, Form, StageRow};

use crate::brief::Outputs;
use crate::key::Dependencies;
use crate::panics::{self, lock};
use crate::plan::InstanceId;
use crate::resolve::{Keyed, Resolver};
use crate::store::{Cost, InstanceRecord, KeyLock, PortRecord, Provenance, Recipe};

use super::host::InstanceHost;
use super::inputs::StoredInputs;
use super::partial::Partial;
use super::peak;
use super::worker::Worker;

/// What became of a running instance.
pub enum Outcome {
    Ran(Arc<InstanceRecord>),
    /// Another run made it since this one looked.
    Found(Arc<InstanceRecord>),
    /// An input of this producer is damaged.
    Damaged(InstanceId),
    Failed(String),
    Interrupted,
}

/// One instance that is to run.
pub struct Task {
    pub id: InstanceId,
    pub job: Keyed,
    /// The outputs of its producers.
    pub outputs: HashMap<InstanceId, Outputs>,
    pub forced: bool,
    /// Whether nothing else ran when it began.
    pub alone: bool,
    /// Whether its stage says that it takes less than the way to other threads.
    pub is_light: bool,
    /// Held until the record is published: a second run looks after other work meanwhile, and then finds it.
    pub lock: KeyLock,
}

/// Runs an instance to its end; called on a thread of its own. A panic anywhere in it is a failure of this instance.
pub fn execute(worker: Worker<'_>, task: Task) -> Outcome {
    let done = catch_unwind(AssertUnwindSafe(|| attempt(worker, task)));
    done.unwrap_or_else(|panic| Outcome::Failed(panics::text(panic.as_ref())))
}

fn attempt(worker: Worker<'_>, task: Task) -> Outcome {
    let Worker { resolver, progress, .. } = worker;
    let Task { id, job, outputs, forced, alone, is_light, lock: _held } = task;
    let job = &job;
    let (plan, store) = (resolver.plan, resolver.store);
    let stage = plan.stage_of(id);
    let label = plan.label(id);
    let wanted = plan.wanted(stage);
    if let Err(error) = store.refresh() {
        return Outcome::Failed(error.to_string());
    }
    let earlier = store.record(&job.key);
    if let Some(record) = &earlier
        && !forced
        && wanted.iter().all(|port| record.ports.contains_key(*port))
        && resolver.released(id, &Outputs::of(record, plan.outputs(stage))).is_empty()
    {
        return Outcome::Found(record.clone());
    }
    let lent = match resolver.lend(job) {
        Ok(lent) => lent,
        Err(message) => return Outcome::Failed(message),
    };
    let partial = worker.options.live.as_deref().and_then(|outputs| Partial::of(plan, id, job.key, outputs));
    let host = InstanceHost::new(worker, job, &label, wanted, lent.files.clone(), partial, forced).light(is_light);
    let inputs = StoredInputs {
        plan,
        store,
        wires: plan.wires(id),
        outputs,
        kept: worker.kept,
        damaged: Mutex::new(None),
        opened: Mutex::default(),
    };
    let started = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_secs());
    if alone && !is_light {
        peak::reset();
    }
    let row = plan.row(stage);
    // What the clock stopped once is added to where it stopped then: no clock would stop there again.
    let reached = earlier.as_ref().filter(|_| !forced).and_then(|record| reached_params(job, record, row));
    let reached = match reached.map(|params| (row.prepare)(&params)).transpose() {
        Ok(reached) => reached,
        Err(error) => return Outcome::Failed(format!("internal error, please report it: {}", error)),
    };
    let typed = reached.as_ref().unwrap_or(&job.job);
    let made = match typed.run(&inputs, Ctx::new(&host)) {
        Ok(made) => made,
        Err(Error::Interrupted) => return Outcome::Interrupted,
        Err(error) => {
            if let Some(message) = lent.failed() {
                return Outcome::Failed(message);
            }
            let damaged = *lock(&inputs.damaged);
            return damaged.map_or_else(|| Outcome::Failed(error.to_string()), Outcome::Damaged);
        }
    };
    let cost =
        Cost { wall_s: host.wall().as_secs_f64(), cpu_s: host.cpu_s(), peak_bytes: peak::of_process(is_light), alone };
    let mut ports = match publish_blobs(resolver, id, made, wanted) {
        Ok(ports) => ports,
        Err(message) => return Outcome::Failed(message),
    };
    let mut agrees = None;
    if let Some(earlier) = &earlier {
        // The clock stops elsewhere each time: only equal amounts of work can be compared. What was added was made as much as before.
        let comparable = reached.is_some() || earlier.reached == host.reached();
        let differing = ports
            .iter()
            .find(|(name, port)| earlier.ports.get(*name).is_some_and(|e| e.blob.digest != port.blob.digest));
        if let Some((name, _)) = differing {
            let mut text = format!(
                "output `{name}` came out different from the stored one for the same key; {} must raise its VERSION (now {})",
                row.name, row.version
            );
            if comparable && !(forced && worker.options.replace) {
                host.forget_checkpoints();
                if forced {
                    text.push_str(", or a memory or disk erred; the stored one stays, --replace takes the new one");
                }
                return Outcome::Failed(text);
            }
            if comparable {
                agrees = Some(false);
                progress.warn(&label, &text);
            }
        } else {
            agrees = ports.keys().any(|name| earlier.ports.contains_key(name)).then_some(true);
            for (name, port) in &earlier.ports {
                ports.entry(name.clone()).or_insert_with(|| port.clone());
            }
        }
    }
    host.settle_checkpoints(agrees);
    let reached = reached.and(earlier.and_then(|record| record.reached.clone())).or_else(|| host.reached());
    let record = InstanceRecord {
        reached,
        key: job.key,
        use_name: job.dependencies.use_name.clone(),
        version: job.dependencies.version,
        seed: job.dependencies.seed,
        state_key: job.state_key,
        ports,
        cost,
        measures: host.measures(),
        warnings: host.warnings(),
        kernel: host.kernel_taken().map(|(name, _)| name),
        refused: host.kernel_taken().map(|(_, refused)| refused).unwrap_or_default(),
        provenance: Provenance {
            pipeline: plan.spec.pipeline.clone(),
            stage: plan.stage_name(id).to_owned(),
            axes: plan.axes(id),
            turbid_version: env!("CARGO_PKG_VERSION").to_owned(),
            started,
        },
    };
    if host.stopped_by_time()
        && let Some((reached, recipe)) = reached_record(job, &record, row)
        && let Err(error) = store.publish(&reached, &recipe)
    {
        return Outcome::Failed(error.to_string());
    }
    match store.publish(&record, &recipe(&job.dependencies)) {
        Ok(()) => Outcome::Ran(Arc::new(record)),
        Err(error) => Outcome::Failed(error.to_string()),
    }
}

fn publish_blobs(
    resolver: &Resolver<'_>,
    id: InstanceId,
    made: Vec<(&'static str, Artifact)>,
    wanted: &BTreeSet<&'static str>,
) -> Result<BTreeMap<String, PortRecord>, String> {
    let stage = resolver.plan.stage_of(id);
    let mut ports = BTreeMap::new();
    for (name, artifact) in made {
        let described = resolver.plan.outputs(stage).iter().find(|p| p.name == name);
        let described = described.expect("out_ports! names the ports that it lists");
        assert_eq!(artifact.kind(), described.kind, "port {name} of {}", resolver.plan.row(stage).name);
        // Those that read it were checked against this form.
        if let Some(form) = resolver.form(id, name).filter(|form| **form != Form::default())
            && let Some(text) = form.broken_by(&Form::of(&artifact))
        {
            let stage = resolver.plan.row(stage).name;
            return Err(format!("internal error, please report it: output `{name}` of {stage} has {text}"));
        }
        if let Some(other) = undeclared(described.holds, &artifact) {
            let (stage, payload) = (resolver.plan.row(stage).name, described.payload);
            let text = format!("output `{name}` of {stage} has a {other}, which {payload} does not declare");
            return Err(format!("internal error, please report it: {text}"));
        }
        let blob = resolver.store.put(&artifact).map_err(|e| format!("output `{name}`: {e}"))?;
        ports.insert(name.to_owned(), PortRecord { payload: described.payload.to_owned(), blob });
    }
    match wanted.iter().find(|name| !ports.contains_key(**name)) {
        Some(name) => Err(format!("{} did not make its output `{name}`", resolver.plan.row(stage).name)),
        None => Ok(ports),
    }
}

/// A run that the clock stopped is the same as one that asked for what it reached; it is stored as that too.
///
/// Under the key that was asked for it stays as well, so that the same file is up to date the second time.
fn reached_record(job: &Keyed, record: &InstanceRecord, row: &StageRow) -> Option<(InstanceRecord, Recipe)> {
    let params = (row.prepare)(&reached_params(job, record, row)?).ok()?.canonical().ok()?;
    let dependencies = Dependencies { params, ..job.dependencies.clone() };
    Some((InstanceRecord { key: dependencies.key(), ..record.clone() }, recipe(&dependencies)))
}

/// The params that ask for just what a record holds, where the clock had a say in it.
fn reached_params(job: &Keyed, record: &InstanceRecord, row: &StageRow) -> Option<Value> {
    let reached = record.reached.as_ref()?;
    let mut params = job.params.as_object()?.clone();
    params.retain(|name, _| !row.stopping.contains(&name.as_str()));
    for (name, value) in reached {
        assert!(
            row.stopping.contains(&name.as_str()),
            "`{}` says where it stopped by `{name}`, no stopping param",
            row.name
        );
        params.insert(name.clone(), value.clone());
    }
    Some(Value::Object(params))
}

fn recipe(dependencies: &Dependencies) -> Recipe {
    let Dependencies { params, inputs, files, .. } = dependencies.clone();
    Recipe { params, inputs, files }
}
