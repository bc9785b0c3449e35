//! Processes that tests start beside tests that lock files.
//!
//! Between its fork and its exec a child holds every lock that its parent held at the fork, also those that the parent has
//! let go since. So no lock is asked for while a child starts.

use std::io;
use std::process::{Child, Command};
use std::sync::{PoisonError, RwLock, RwLockReadGuard};

static STARTING: RwLock<()> = RwLock::new(());

/// Starts a process; returns when the child has closed what it inherited.
pub(crate) fn start(command: &mut Command) -> io::Result<Child> {
    let _alone = STARTING.write().unwrap_or_else(PoisonError::into_inner);
    command.spawn()
}

/// No child starts until the guard is dropped.
pub(crate) fn none_starts() -> RwLockReadGuard<'static, ()> {
    STARTING.read().unwrap_or_else(PoisonError::into_inner)
}
