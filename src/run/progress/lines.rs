//! Lines on stderr, for files and pipes: what begins and ends, and now and then how far it is.

use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use crate::panics::lock;
use crate::terminal::tell;

use super::beat::Beat;
use super::board::{Board, Work};
use super::people::Shown;
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
}

impl Shown for Lines {
    fn change(&self, change: impl FnOnce(&mut Board, &mut Said, f64) -> Option<String>) {
        let line = {
            let mut state = lock(&self.state);
            let (board, said) = &mut *state;
            change(board, said, self.began.elapsed().as_secs_f64())
        };
        // Without the lock: who reads slowly must not keep the stages from their work.
        line.iter().for_each(|line| tell(line));
    }

    fn beat(&self) {
        lock(&self.beat).get_or_insert_with(|| {
            let (state, began) = (self.state.clone(), self.began);
            Beat::every(PAUSE, move || {
                let line = lock(&state).0.beat(began.elapsed().as_secs_f64());
                tell(&line);
            })
        });
    }

    fn close(&self) {
        drop(lock(&self.beat).take());
        let rest = lock(&self.state).1.rest();
        rest.iter().for_each(|line| tell(line));
    }
}
