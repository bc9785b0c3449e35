//! A few requests at the same time: most of their time is waiting.

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

use crate::store::lock::guard;

/// So many requests are on their way at a time.
pub(super) const AT_ONCE: usize = 8;

/// What `work` makes of each item, in their order. Where the system starts no threads, one does it all.
pub(super) fn side_by_side<T: Sync, R: Send>(items: &[T], work: impl Fn(&T) -> R + Sync) -> Vec<R> {
    let next = AtomicUsize::new(0);
    let done: Mutex<Vec<Option<R>>> = Mutex::new(items.iter().map(|_| None).collect());
    let worker = || {
        while let Some((at, item)) = Some(next.fetch_add(1, Ordering::Relaxed)).and_then(|i| Some((i, items.get(i)?))) {
            let made = work(item);
            guard(&done)[at] = Some(made);
        }
    };
    thread::scope(|scope| {
        for _ in 1..items.len().min(AT_ONCE) {
            if thread::Builder::new().spawn_scoped(scope, worker).is_err() {
                break;
            }
        }
        worker();
    });
    let done = done.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
    done.into_iter()
        .map(|made| made.expect("each item was taken once, and a panic has gone on to the caller"))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_is_done_in_order() {
        let items: Vec<usize> = (0..100).collect();
        assert_eq!(side_by_side(&items, |i| 2 * i), (0..100).map(|i| 2 * i).collect::<Vec<_>>());
        assert_eq!(side_by_side(&[0; 0], |i: &i32| *i), [0; 0]);
    }
}
