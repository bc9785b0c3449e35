//! Panics are mistakes of ours: told on stderr when they happen, with their place, and named with it by whoever catches them.

use std::any::Any;
use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Message and place of the latest panics: what is thrown holds the message only, and may be caught in another thread.
static LATEST: Mutex<VecDeque<(String, String)>> = Mutex::new(VecDeque::new());
const KEPT: usize = 32;

/// From now on a panic is said in one line of stderr.
pub fn speak() {
    std::panic::set_hook(Box::new(|panic| {
        // A decoder gave up on a file: that is told as what is wrong with the file.
        if turbid_contract::guard::is_guarded() {
            return;
        }
        let message = message(panic.payload());
        let place = panic.location().map_or_else(|| "a place unknown".to_owned(), ToString::to_string);
        crate::terminal::tell(&format!("internal error at {place}: {message}"));
        let mut latest = lock(&LATEST);
        latest.push_back((message, place));
        if latest.len() > KEPT {
            latest.pop_front();
        }
    }));
}

/// A caught panic as an error for the user.
pub fn text(panic: &(dyn Any + Send)) -> String {
    let message = message(panic);
    let latest = lock(&LATEST);
    let place = latest.iter().rev().find(|(known, _)| *known == message).map(|(_, place)| format!(" ({place})"));
    format!("internal error, please report it: {message}{}", place.unwrap_or_default())
}

fn message(payload: &(dyn Any + Send)) -> String {
    let text = payload.downcast_ref::<String>().cloned();
    let text = text.or_else(|| payload.downcast_ref::<&str>().map(|s| (*s).to_owned()));
    text.unwrap_or_else(|| "an assertion failed".to_owned())
}

/// The guard of a mutex, also after a holder panicked: what these locks keep is whole after each statement, and one panic must not
/// become one in every thread.
pub fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
