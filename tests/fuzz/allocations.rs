//! An allocator that counts: how much memory a call takes at most, and no more than a limit for the whole process.
#![allow(unsafe_code, reason = "an allocator cannot be written without it")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::io::Write;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

/// The most bytes that the process may hold; no input of a few kB is worth more.
pub const MOST: usize = 2 << 30;

static LIVE: AtomicUsize = AtomicUsize::new(0);
static PEAK: AtomicUsize = AtomicUsize::new(0);

/// The system's allocator, counted.
///
/// Invariant: every pointer that it gives is one of `System` for the same layout, and `LIVE` is the sum of the sizes of the layouts that
/// were given and not yet taken back. It never allocates itself.
pub struct Counting;

#[global_allocator]
static ALLOCATOR: Counting = Counting;

// SAFETY: all memory comes from `System` and goes back to it with the layout it was asked for; the counting around it touches atomics only.
// A null pointer stands for "no memory", as the trait has it.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller's promises about `layout` are passed on.
        counted(layout.size(), || unsafe { System.alloc(layout) })
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: as above.
        counted(layout.size(), || unsafe { System.alloc_zeroed(layout) })
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the pointer came from `System` with this layout.
        unsafe { System.dealloc(pointer, layout) };
        LIVE.fetch_sub(layout.size(), Relaxed);
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // The old block counts until the new one is there: a block that moves needs both.
        // SAFETY: as above; `size` is the caller's promise.
        let moved = counted(size, || unsafe { System.realloc(pointer, layout, size) });
        if !moved.is_null() {
            LIVE.fetch_sub(layout.size(), Relaxed);
        }
        moved
    }
}

fn counted(size: usize, take: impl FnOnce() -> *mut u8) -> *mut u8 {
    let live = LIVE.fetch_add(size, Relaxed).saturating_add(size);
    if live > MOST {
        LIVE.fetch_sub(size, Relaxed);
        // Neither the lock of stderr nor a number written to it allocates.
        let _ = writeln!(std::io::stderr(), "refused: {size} bytes more would be {live} in all, over {MOST}");
        return std::ptr::null_mut();
    }
    let pointer = take();
    if pointer.is_null() {
        LIVE.fetch_sub(size, Relaxed);
    } else {
        PEAK.fetch_max(live, Relaxed);
    }
    pointer
}

/// What `call` gives, and the bytes that the process held at most beyond those it held before.
pub fn peak_of<T>(call: impl FnOnce() -> T) -> (T, usize) {
    let before = LIVE.load(Relaxed);
    PEAK.store(before, Relaxed);
    let done = call();
    (done, PEAK.load(Relaxed).saturating_sub(before))
}

/// The counter sees what is taken, forgets what is given back, and refuses what is too much.
pub fn test() {
    let mib = 1 << 20;
    let (kept, peak) = peak_of(|| {
        drop(std::hint::black_box(vec![1u8; 8 * mib]));
        vec![1u8; mib]
    });
    // Whatever the runtime takes beside is far below 64 KiB.
    assert!((8 * mib..8 * mib + (64 << 10)).contains(&peak), "8 MiB and less than 64 KiB: {peak}");
    let (_, peak) = peak_of(|| drop(kept));
    assert!(peak < 64 << 10, "nothing is left of what was given back: {peak}");
    let mut grown = Vec::<u8>::with_capacity(mib);
    let ((), peak) = peak_of(|| grown.reserve_exact(4 * mib));
    assert!((3 * mib..=4 * mib + (64 << 10)).contains(&peak), "a block that grows: {peak}");
    assert!(Vec::<u8>::new().try_reserve_exact(MOST + 1).is_err(), "over the limit");
}
