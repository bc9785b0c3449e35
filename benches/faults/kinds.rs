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
    /// A call that reads a file, or asks what is there, fails with an error of the device.
    ReadOnce,
    /// It and all later ones that read do.
    Read,
    /// From the call on half is written or read, and calls are interrupted by a signal: not to be noticed.
    Short,
    /// The power fails after the call.
    PowerCut,
}

pub const KINDS: [Kind; 11] = [
    Kind::Kill,
    Kind::KillAfter,
    Kind::Torn,
    Kind::Full,
    Kind::FullOnce,
    Kind::ErrorOnce,
    Kind::Error,
    Kind::ReadOnce,
    Kind::Read,
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
            Kind::ReadOnce => "read-once",
            Kind::Read => "read",
            Kind::Short => "short",
            Kind::PowerCut => "power-cut",
        }
    }

    pub fn named(name: &str) -> Option<Self> {
        KINDS.into_iter().find(|kind| kind.name() == name)
    }

    /// Whether it breaks calls that only read.
    pub fn reads(self) -> bool {
        matches!(self, Kind::Read | Kind::ReadOnce)
    }

    pub fn kills(self) -> bool {
        matches!(self, Kind::Kill | Kind::KillAfter | Kind::Torn)
    }

    /// What becomes of call `number` where call `at` is the first to break.
    pub fn action(self, at: u64, number: u64, call: &Call) -> Action {
        let no_room = if call.op.takes_room() { Action::Fail(Errno::ENOSPC) } else { Action::Go };
        let (first, writes) = (number == at, matches!(call.op, Op::Write { bytes: 2.., .. }));
        if number < at || (call.op.only_reads() != self.reads() && self != Kind::Short) {
            return Action::Go;
        }
        match self {
            Kind::Kill if first => Action::Kill,
            Kind::KillAfter if first => Action::KillAfter,
            Kind::Torn if first => Action::Torn,
            Kind::Full if first && writes => Action::Half,
            Kind::Full => no_room,
            Kind::FullOnce if first => no_room,
            Kind::ErrorOnce | Kind::ReadOnce if first => Action::Fail(Errno::EIO),
            Kind::Error | Kind::Read => Action::Fail(Errno::EIO),
            // Those that Linux documents to be interrupted by a signal.
            Kind::Short
                if number.is_multiple_of(3)
                    && matches!(call.op, Op::Write { .. } | Op::Read { .. } | Op::Create | Op::Truncate { .. }) =>
            {
                Action::Fail(Errno::EINTR)
            }
            Kind::Short if number.is_multiple_of(2) => Action::Half,
            _ => Action::Go,
        }
    }
}
