//! Lines on stderr, for files and pipes: what begins and ends, and now and then how far it is.

use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use crate::panics::lock;
use crate::store::InstanceRecord;
use crate::terminal::tell;

use super::Progress;
use super::beat::Beat;
use super::board::{Board, Work};
use super::said::Said;

/// Between two lines that say how far it is.
pub const PAUSE: Duration = Duration::from_secs(30);

/// One line per event; of a stage of many instances its beginning and its end.
pub struct Lines {
    began: Instant,
    state: Arc<Mutex<(Board, Said)>>,
    beat: Mutex<Option<Beat>>,
}

impl Default for Lines {
    fn default() -> Self {
        Self::of(&Work::default())
    }
}

impl Lines {
    pub fn of(work: &Work) -> Self {
        let state = Arc::new(Mutex::new((Board::of(work), Said::of(work))));
        Self { began: Instant::now(), state, beat: Mutex::default() }
    }

    fn change(&self, change: impl FnOnce(&mut Board, &mut Said, f64) -> Option<String>) {
        let mut state = lock(&self.state);
        let (board, said) = &mut *state;
        // Told under the lock: lines stand in the order of what they tell.
        if let Some(line) = change(board, said, self.began.elapsed().as_secs_f64()) {
            tell(&line);
        }
    }
}

impl Progress for Lines {
    fn started(&self, label: &str, reasons: &[String]) {
        self.change(|board, said, now| {
            board.started(label, now);
            said.started(label, reasons, now)
        });
        lock(&self.beat).get_or_insert_with(|| {
            let (state, began) = (self.state.clone(), self.began);
            Beat::every(PAUSE, move || tell(&lock(&state).0.beat(began.elapsed().as_secs_f64())))
        });
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
        drop(lock(&self.beat).take());
        let rest = lock(&self.state).1.rest();
        rest.iter().for_each(|line| tell(line));
    }
}
