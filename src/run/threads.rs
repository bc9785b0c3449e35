//! A thread for each instance that is at work: begins those that the schedule names, and brings their ends back to it.

use std::collections::HashMap;
use std::sync::mpsc::{self, Sender};
use std::thread::{Scope, ScopedJoinHandle};
use std::time::Duration;

use crate::plan::InstanceId;

use super::execute::{self, Outcome, Task};
use super::inputs::Kept;
use super::interrupt::Interrupt;
use super::schedule::Schedule;
use super::worker::Worker;

/// So often it is looked for threads that ended without a word, and for Ctrl-C where only other processes are at work.
const LONGEST: Duration = Duration::from_secs(1);
/// The same where nothing is at work here.
const IDLE: Duration = Duration::from_millis(100);

/// Runs until nothing is at work and nothing may begin.
///
/// Error: the system starts no threads.
pub fn work(schedule: &mut Schedule<'_>, interrupt: &Interrupt) -> Result<(), String> {
    let (resolver, options, progress) = (schedule.resolver, schedule.options, schedule.progress);
    let jobs = options.jobs;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(jobs).thread_name(|i| format!("turbid-{i}")).build();
    let pool = pool.map_err(|e| format!("{jobs} threads cannot be started: {e}; take fewer with -j"))?;
    let kept = Kept::default();
    let worker = Worker { resolver, pool: &pool, options, progress, interrupt, kept: &kept };
    let (send, receive) = mpsc::channel::<(InstanceId, Outcome)>();
    std::thread::scope(|scope| {
        let mut threads: HashMap<InstanceId, ScopedJoinHandle<'_, ()>> = HashMap::new();
        loop {
            while !interrupt.requested()
                && let Some(task) = schedule.next_task(&|| interrupt.requested())
            {
                let id = task.id;
                match begin(scope, worker, task, send.clone()) {
                    Ok(thread) => drop(threads.insert(id, thread)),
                    // There were threads enough for the others: it waits until one of them is free.
                    Err(_) if schedule.running() > 1 => {
                        schedule.put_back(id);
                        break;
                    }
                    Err(error) => {
                        let text = format!("no thread can be started for it: {error}; take fewer with -j");
                        schedule.finish(id, Outcome::Failed(text));
                    }
                }
            }
            if schedule.running() == 0 && (interrupt.requested() || !schedule.waits_for_others()) {
                break;
            }
            let ended: Vec<InstanceId> = threads.iter().filter(|(_, t)| t.is_finished()).map(|(id, _)| *id).collect();
            match receive.recv_timeout(schedule.pause().min(if schedule.running() == 0 { IDLE } else { LONGEST })) {
                Ok((id, outcome)) => {
                    threads.remove(&id);
                    schedule.finish(id, outcome);
                }
                // What had ended before the wait has sent what became of it, or never will.
                Err(_) => {
                    for id in ended {
                        threads.remove(&id);
                        let text = "internal error, please report it: its thread ended without a word".to_owned();
                        schedule.finish(id, Outcome::Failed(text));
                    }
                }
            }
        }
    });
    Ok(())
}

/// An instance on a thread of its own, which sends what became of it.
fn begin<'scope, 'env>(
    scope: &'scope Scope<'scope, 'env>,
    worker: Worker<'env>,
    task: Task,
    send: Sender<(InstanceId, Outcome)>,
) -> std::io::Result<ScopedJoinHandle<'scope, ()>> {
    std::thread::Builder::new().spawn_scoped(scope, move || {
        let id = task.id;
        let outcome = execute::execute(worker, task);
        // The receiver outlives every worker: it stands outside of the scope.
        let _ = send.send((id, outcome));
    })
}
