//! A crew of threads for the instances that are at work: hands them those that the schedule names, and brings their ends back to it.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Mutex;
use std::sync::mpsc::{self, Receiver, Sender};
use std::thread::Scope;
use std::time::Duration;

use crate::panics::lock;
use crate::plan::InstanceId;

use super::execute::{self, Outcome, Task};
use super::inputs::Kept;
use super::interrupt::Interrupt;
use super::schedule::Schedule;
use super::worker::Worker;

/// So often it is looked for Ctrl-C where instances are at work ...
const LONGEST: Duration = Duration::from_secs(1);
/// ... and where only other processes are.
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
    let (hand_out, tasks) = mpsc::channel::<Task>();
    let tasks = Mutex::new(tasks);
    std::thread::scope(|scope| {
        let mut crew = Crew { scope, worker, tasks: &tasks, hand_out, send, idle: 0 };
        loop {
            while !interrupt.requested()
                && let Some(task) = schedule.next_task(&|| interrupt.requested())
            {
                let id = task.id;
                match crew.begin(task) {
                    Ok(()) => {}
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
            let longest = if schedule.running() == 0 { IDLE } else { LONGEST };
            if let Ok((id, outcome)) = receive.recv_timeout(schedule.pause().min(longest)) {
                crew.idle += 1;
                schedule.finish(id, outcome);
            }
        }
    });
    Ok(())
}

/// Threads that take one instance after the other; as many as were at work at once.
struct Crew<'scope, 'env> {
    scope: &'scope Scope<'scope, 'env>,
    worker: Worker<'env>,
    tasks: &'env Mutex<Receiver<Task>>,
    hand_out: Sender<Task>,
    send: Sender<(InstanceId, Outcome)>,
    /// How many have nothing to do.
    idle: usize,
}

impl Crew<'_, '_> {
    /// Hands out an instance. Error: nobody is idle, and the system starts no further thread.
    fn begin(&mut self, task: Task) -> std::io::Result<()> {
        match self.idle.checked_sub(1) {
            Some(idle) => self.idle = idle,
            None => {
                let (worker, tasks, send) = (self.worker, self.tasks, self.send.clone());
                std::thread::Builder::new().spawn_scoped(self.scope, move || serve(worker, tasks, &send))?;
            }
        }
        self.hand_out.send(task).expect("the receiver outlives the crew");
        Ok(())
    }
}

/// Works off instances until there are no more to come.
fn serve(worker: Worker<'_>, tasks: &Mutex<Receiver<Task>>, send: &Sender<(InstanceId, Outcome)>) {
    loop {
        let next = lock(tasks).recv();
        let Ok(task) = next else { return };
        let id = task.id;
        let done = catch_unwind(AssertUnwindSafe(|| execute::execute(worker, task)));
        let outcome = done.unwrap_or_else(|_| {
            Outcome::Failed("internal error, please report it: its thread ended without a word".to_owned())
        });
        // The receiver outlives every worker: it stands outside of the scope.
        let _ = send.send((id, outcome));
    }
}
