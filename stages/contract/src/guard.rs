//! Decoders that others wrote: what makes one panic is a file that cannot be read.

use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};

thread_local! {
    static GUARDED: Cell<bool> = const { Cell::new(false) };
}

/// What `decode` makes of a file. A panic inside is an error that holds its message; sizes must be bounded before, because memory that is
/// not there ends the process without a panic.
pub fn guarded<T>(decode: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
    let before = GUARDED.replace(true);
    // What `decode` leaves behind half-made is dropped with it.
    let done = catch_unwind(AssertUnwindSafe(decode));
    GUARDED.set(before);
    done.unwrap_or_else(|panic| {
        let text = panic.downcast_ref::<String>().map(String::as_str).or_else(|| panic.downcast_ref::<&str>().copied());
        Err(format!("its decoder gave up: {}", text.unwrap_or("an assertion failed")))
    })
}

/// Whether a panic of this thread is caught by [`guarded`]: then it is no mistake of the program, and a panic hook says nothing.
pub fn is_guarded() -> bool {
    GUARDED.get()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_an_error_and_the_guard_ends() {
        assert_eq!(guarded(|| Ok(is_guarded())), Ok(true));
        let index = std::hint::black_box(7);
        let said = guarded(|| Ok([1, 2, 3].get(index).copied().expect("no such byte"))).unwrap_err();
        assert_eq!((said.as_str(), is_guarded()), ("its decoder gave up: no such byte", false));
    }
}
