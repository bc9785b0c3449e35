//! Work that has no order, on the threads of the run.

use std::sync::OnceLock;

use turbid_contract::Ctx;

/// `work(0) .. work(n - 1)`, in this order, whatever the number of threads. It is short: a cancelled run finishes it.
pub fn each<T: Send + Sync>(ctx: Ctx<'_>, n: usize, work: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let slots: Vec<OnceLock<T>> = (0..n).map(|_| OnceLock::new()).collect();
    ctx.tiles(n, &|i| {
        let _ = slots[i].set(work(i));
    });
    slots.into_iter().map(|slot| slot.into_inner().expect("each has been done")).collect()
}
