//! How events reach the board and the lasting lines, wherever people see them.

use crate::store::InstanceRecord;

use super::Progress;
use super::board::Board;
use super::said::Said;

/// A place where people see a run.
pub trait Shown: Sync {
    /// Brings board and lines up to date, and shows the line that comes of it, if any. The number is seconds since the run began.
    fn change(&self, change: impl FnOnce(&mut Board, &mut Said, f64) -> Option<String>);
    /// Something is at work: from now on it is shown again now and then.
    fn beat(&self);
    /// Nothing is at work any more.
    fn close(&self);
}

impl<T: Shown> Progress for T {
    fn started(&self, label: &str, reasons: &[String]) {
        self.change(|board, said, now| {
            board.started(label, now);
            said.started(label, reasons, now)
        });
        self.beat();
    }
    fn advanced(&self, label: &str, done: f64, total: Option<f64>, unit: &str) {
        self.change(|board, _, now| {
            board.advanced(label, now, done, total, unit);
            None
        });
    }
    fn ran(&self, label: &str, record: &InstanceRecord) {
        self.change(|board, said, now| {
            board.ended(label, Some(record.cost.cpu_s));
            said.ran(label, record.cost.wall_s, now)
        });
    }
    fn found(&self, label: &str) {
        self.change(|board, said, now| {
            board.ended(label, None);
            said.found(label, now)
        });
    }
    fn failed(&self, label: &str, message: &str) {
        self.change(|board, said, _| {
            board.ended(label, None);
            said.failed(label, message)
        });
    }
    fn warn(&self, label: &str, message: &str) {
        self.change(|_, said, _| said.warned(label, message));
    }
    fn ended(&self) {
        self.close();
    }
}
