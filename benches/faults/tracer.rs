//! Runs a command and lets somebody decide at each of its calls that changes a file below a folder.

use std::collections::HashMap;
use std::io;
use std::path::Path;
use std::process::Command;
use std::sync::mpsc;
use std::time::Duration;

use nix::errno::Errno;
use nix::libc;
use nix::sys::ptrace::{self, Options};
use nix::sys::signal::{Signal, kill};
use nix::sys::wait::{WaitPidFlag, WaitStatus, waitpid};
use nix::unistd::Pid;

use super::calls::{self, Call, Op};
use super::stops;

/// More than any case needs on a busy machine.
pub const MOST_CPU_S: u64 = 60;
pub const MOST_WALL: Duration = Duration::from_secs(120);

/// What becomes of a call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Action {
    Go,
    /// The program is killed before the call, or right after it.
    Kill,
    KillAfter,
    /// The call is not made and returns this error.
    Fail(Errno),
    /// Half of the bytes are written or read only.
    Half,
    /// Half of a write, then the program is killed.
    Torn,
}

/// A call that was made, with the bytes of a write.
#[derive(Clone, Debug)]
pub struct Logged {
    /// So many calls below the folder had begun, this one included.
    pub number: u64,
    pub call: Call,
    pub data: Vec<u8>,
}

/// How a traced command ended.
#[derive(Debug, Default)]
pub struct Ended {
    /// Exit status; `None` where a signal ended it.
    pub code: Option<i32>,
    pub signal: Option<Signal>,
    /// It took more than [`MOST_CPU_S`] or [`MOST_WALL`].
    pub hung: bool,
    /// So many calls that change something below the folder, and so many that only look.
    pub calls: u64,
    pub reads: u64,
    /// All that was done to files in `folder` and to `said`, in order; empty unless asked for.
    pub log: Vec<Logged>,
}

/// What is followed, and who decides.
pub struct Follow<'a> {
    /// Calls that change something below it count.
    pub folder: &'a Path,
    /// Writes to this file are logged (they do not count): what the program has told by then.
    pub said: &'a Path,
    pub log: bool,
    /// From the number of the call (from 1, those that only look by themselves) and the call.
    pub decide: &'a mut dyn FnMut(u64, &Call) -> Action,
}

/// What a thread is in the middle of.
struct Pending {
    number: u64,
    call: Call,
    data: Vec<u8>,
    action: Action,
}

/// Runs `command` to its end. Error: it could not be started or traced.
pub fn follow(mut command: Command, what: Follow<'_>) -> io::Result<Ended> {
    stops::stopping(&mut command, MOST_CPU_S);
    // Waited for by its process group below, with all of its threads.
    let child = Pid::from_raw(command.spawn()?.id() as i32);
    let (over, watch) = mpsc::channel::<()>();
    let watcher = std::thread::spawn(move || {
        let late = watch.recv_timeout(MOST_WALL) == Err(mpsc::RecvTimeoutError::Timeout);
        if late {
            let _ = kill(child, Signal::SIGKILL);
        }
        late
    });
    let ended = Tracer { child, pending: HashMap::new(), ended: Ended::default(), what }.run();
    drop(over);
    let late = watcher.join().expect("it does not panic");
    let mut ended = ended?;
    ended.hung |= late || ended.signal == Some(Signal::SIGXCPU);
    Ok(ended)
}

struct Tracer<'a> {
    child: Pid,
    pending: HashMap<Pid, Pending>,
    ended: Ended,
    what: Follow<'a>,
}

impl Tracer<'_> {
    fn run(mut self) -> io::Result<Ended> {
        let group = Pid::from_raw(-self.child.as_raw());
        let mut begun = false;
        loop {
            match waitpid(group, Some(WaitPidFlag::__WALL | WaitPidFlag::__WNOTHREAD)) {
                Err(Errno::EINTR) => {}
                Err(Errno::ECHILD) => return Ok(self.ended),
                Err(error) => return Err(error.into()),
                Ok(WaitStatus::Exited(thread, code)) => {
                    if thread == self.child {
                        self.ended.code = Some(code);
                    }
                }
                Ok(WaitStatus::Signaled(thread, signal, _)) => {
                    if thread == self.child {
                        self.ended.signal = Some(signal);
                    }
                }
                Ok(WaitStatus::Stopped(thread, Signal::SIGTRAP)) if !begun => {
                    begun = true;
                    let all = Options::PTRACE_O_TRACESECCOMP
                        | Options::PTRACE_O_TRACECLONE
                        | Options::PTRACE_O_TRACEFORK
                        | Options::PTRACE_O_TRACEVFORK
                        | Options::PTRACE_O_TRACEEXEC
                        | Options::PTRACE_O_EXITKILL
                        | Options::PTRACE_O_TRACESYSGOOD;
                    ptrace::setoptions(thread, all)?;
                    go_on(ptrace::cont(thread, None))?;
                }
                // A new thread stops once.
                Ok(WaitStatus::Stopped(thread, Signal::SIGSTOP)) => go_on(ptrace::cont(thread, None))?,
                Ok(WaitStatus::Stopped(thread, signal)) => go_on(ptrace::cont(thread, signal))?,
                Ok(WaitStatus::PtraceEvent(thread, _, libc::PTRACE_EVENT_SECCOMP)) => go_on(self.before(thread))?,
                Ok(WaitStatus::PtraceEvent(thread, ..)) => go_on(ptrace::cont(thread, None))?,
                Ok(WaitStatus::PtraceSyscall(thread)) => go_on(self.after(thread))?,
                Ok(_) => {}
            }
        }
    }

    fn before(&mut self, thread: Pid) -> nix::Result<()> {
        let mut registers = ptrace::getregs(thread)?;
        let Some(call) = Call::of(thread, &registers) else { return ptrace::cont(thread, None) };
        let told = call.path == self.what.said;
        if !told && !call.path.starts_with(self.what.folder) {
            return ptrace::cont(thread, None);
        }
        let mut action = Action::Go;
        if call.op == Op::Copy {
            action = Action::Fail(Errno::ENOSYS);
        } else if !told {
            let count = if call.op.only_reads() { &mut self.ended.reads } else { &mut self.ended.calls };
            *count += 1;
            action = (self.what.decide)(*count, &call);
        }
        if action == Action::Go && (!self.what.log || call.op.only_reads()) {
            return ptrace::cont(thread, None);
        }
        if action == Action::Kill {
            return kill(self.child, Signal::SIGKILL);
        }
        let mut data = Vec::new();
        match action {
            Action::Fail(_) => {
                // No such call: nothing is done.
                registers.orig_rax = u64::MAX;
                ptrace::setregs(thread, registers)?;
            }
            Action::Half | Action::Torn
                if matches!(call.op, Op::Write { bytes: 2.., .. } | Op::Read { bytes: 2.. }) =>
            {
                // The number of bytes, or of pieces.
                registers.rdx = (registers.rdx / 2).max(1);
                ptrace::setregs(thread, registers)?;
            }
            _ => {}
        }
        if self.what.log && matches!(call.op, Op::Write { .. }) {
            data = calls::data(thread, &registers);
        }
        self.pending.insert(thread, Pending { number: self.ended.calls, call, data, action });
        ptrace::syscall(thread, None)
    }

    fn after(&mut self, thread: Pid) -> nix::Result<()> {
        let Some(Pending { number, call, mut data, action }) = self.pending.remove(&thread) else {
            return ptrace::cont(thread, None);
        };
        let mut registers = ptrace::getregs(thread)?;
        match action {
            Action::Fail(error) => {
                registers.rax = -(error as i64) as u64;
                ptrace::setregs(thread, registers)?;
            }
            Action::KillAfter | Action::Torn => return kill(self.child, Signal::SIGKILL),
            _ => {
                let result = registers.rax as i64;
                if self.what.log && result >= 0 {
                    data.truncate(result as usize);
                    self.ended.log.push(Logged { number, call, data });
                }
            }
        }
        ptrace::cont(thread, None)
    }
}

/// A thread that was killed while it was looked at is no mistake of ours: its end is waited for.
fn go_on(done: nix::Result<()>) -> io::Result<()> {
    match done {
        Err(Errno::ESRCH) => Ok(()),
        other => other.map_err(Into::into),
    }
}

impl Logged {
    /// The same call in a copy of the folder.
    pub fn moved(&self, from: &Path, to: &Path) -> Self {
        let moved = |path: &Path| path.strip_prefix(from).map_or_else(|_| path.to_owned(), |inside| to.join(inside));
        let op = match &self.call.op {
            Op::Rename { from } => Op::Rename { from: moved(from) },
            Op::Link { from } => Op::Link { from: moved(from) },
            other => other.clone(),
        };
        Self { number: self.number, call: Call { op, path: moved(&self.call.path) }, data: self.data.clone() }
    }
}
