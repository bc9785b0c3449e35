//! Ways to break a call.

use nix::errno::Errno;

use super::calls::{Call, Op};
use super::tracer::Action;

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// Killed before the call.
    Kill,
    /// Killed right after it.
    KillAfter,
    /// Half of a write, then killed.
    Torn,
    /// From the call on there is no room: half of a write, then errors.
    Full,
    /// Once there is no room.
    FullOnce,
    /// The call fails with an error of the device.
    ErrorOnce,
    /// It and all later ones do.
    Error,
    /// From the call on writes write half, and calls are interrupted by a signal: not to be noticed.
    Short,
    /// The power fails after the call.
    PowerCut,
}

pub const KINDS: [Kind; 9] = [
    Kind::Kill,
    Kind::KillAfter,
    Kind::Torn,
    Kind::Full,
    Kind::FullOnce,
    Kind::ErrorOnce,
    Kind::Error,
    Kind::Short,
    Kind::PowerCut,
];

impl Kind {
    pub fn name(self) -> &'static str {
        match self {
            Kind::Kill => "kill",
            Kind::KillAfter => "kill-after",
            Kind::Torn => "torn",
            Kind::Full => "full",
            Kind::FullOnce => "full-once",
            Kind::ErrorOnce => "error-once",
            Kind::Error => "error",
            Kind::Short => "short",
            Kind::PowerCut => "power-cut",
        }
    }

    pub fn named(name: &str) -> Option<Self> {
        KINDS.into_iter().find(|kind| kind.name() == name)
    }

    pub fn kills(self) -> bool {
        matches!(self, Kind::Kill | Kind::KillAfter | Kind::Torn)
    }

    /// What becomes of call `number` where call `at` is the first to break.
    pub fn action(self, at: u64, number: u64, call: &Call) -> Action {
        let no_room = if call.op.takes_room() { Action::Fail(Errno::ENOSPC) } else { Action::Go };
        let writes = matches!(call.op, Op::Write { bytes: 2.., .. });
        match (self, number.cmp(&at)) {
            (Kind::PowerCut, _) | (_, std::cmp::Ordering::Less) => Action::Go,
            (Kind::Full, std::cmp::Ordering::Greater) => no_room,
            (Kind::Error, _) => Action::Fail(Errno::EIO),
            (Kind::Short, _) if writes && number % 2 == 0 => Action::Half,
            // Those that Linux documents to be interrupted by a signal.
            (Kind::Short, _)
                if matches!(call.op, Op::Write { .. } | Op::Create | Op::Truncate { .. }) && number % 3 == 0 =>
            {
                Action::Fail(Errno::EINTR)
            }
            (Kind::Short, _) | (_, std::cmp::Ordering::Greater) => Action::Go,
            (Kind::Kill, _) => Action::Kill,
            (Kind::KillAfter, _) => Action::KillAfter,
            (Kind::Torn, _) => Action::Torn,
            (Kind::Full, _) if writes => Action::Half,
            (Kind::Full | Kind::FullOnce, _) => no_room,
            (Kind::ErrorOnce, _) => Action::Fail(Errno::EIO),
        }
    }
}
