//! Ctrl-C: the first one asks the run to stop at the next tile, the second ends the process at once.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// A flag that stages see as `ctx.cancelled()`.
#[derive(Clone, Default)]
pub struct Interrupt {
    flag: Arc<AtomicBool>,
}

impl Interrupt {
    /// Listens to SIGINT and SIGTERM.
    pub fn listen() -> std::io::Result<Self> {
        let interrupt = Self::default();
        for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
            // In this order: the second signal finds the flag set and ends the process with 130.
            signal_hook::flag::register_conditional_shutdown(signal, 130, interrupt.flag.clone())?;
            signal_hook::flag::register(signal, interrupt.flag.clone())?;
        }
        Ok(interrupt)
    }

    pub fn requested(&self) -> bool {
        self.flag.load(Ordering::Relaxed)
    }

    pub fn request(&self) {
        self.flag.store(true, Ordering::Relaxed);
    }
}
