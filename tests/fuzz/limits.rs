//! What a call may take: CPU time and memory by the size of the input and of what it decodes to; and what it must not do.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Mutex;
use std::time::Duration;

use cpu_time::ProcessTime;

use crate::allocations::peak_of;
use crate::readers::{Reader, Seen};

/// CPU seconds of any call: far more than reading takes, so that only what grows without bound gets there.
const SECONDS: f64 = 2.0;
/// ... and per MiB of input and of what it decodes to. The slowest reader (deflate and meshes without optimisation) takes a fifth of it.
const SECONDS_PER_MIB: f64 = 10.0;
/// Memory beside 4 times input and decoded: tables of decoders, trees of JSON and YAML of inputs of some 100 kB.
const BYTES: usize = 32 << 20;
/// A run of what was read: the laws behind the reader. The parent ends what takes longer.
const RUN_SECONDS: f64 = 30.0;

/// Where the last panic was.
static PLACE: Mutex<String> = Mutex::new(String::new());

/// Notes panics instead of printing them: a reader may catch those of a library.
pub fn note_panics() {
    std::panic::set_hook(Box::new(|panic| {
        if let Ok(mut place) = PLACE.lock() {
            *place = panic.to_string().replace('\n', " ");
        }
    }));
}

/// Reads an input. Error: what it must not do.
pub fn judge(reader: &Reader, input: &[u8]) -> Result<Seen, String> {
    // Asked before: what it takes is not the reader's.
    let claimed = (reader.claims)(input);
    let start = ProcessTime::now();
    let (read, peak) = peak_of(|| caught(|| (reader.read)(input)));
    let taken = seconds(start.elapsed());
    let seen = read?;
    let size = input.len() + seen.decoded.max(claimed);
    let most = 4 * size + BYTES;
    if peak > most {
        return Err(format!("takes {peak} bytes of memory, over {most} = 4 x (input + decoded) + 32 MiB"));
    }
    let most = SECONDS + SECONDS_PER_MIB * size as f64 / f64::from(1 << 20);
    if taken > most {
        return Err(format!("takes {taken:.1} CPU seconds, over {most:.1}"));
    }
    if seen.taken {
        let start = ProcessTime::now();
        caught(|| (reader.law)(input))?;
        let taken = seconds(start.elapsed());
        if taken > RUN_SECONDS {
            return Err(format!("a run of it takes {taken:.1} CPU seconds, over {RUN_SECONDS}"));
        }
    }
    Ok(seen)
}

fn caught<T>(call: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
    catch_unwind(AssertUnwindSafe(call))
        .unwrap_or_else(|_| Err(PLACE.lock().map_or_else(|_| "panicked".to_owned(), |place| place.clone())))
}

fn seconds(duration: Duration) -> f64 {
    duration.as_secs_f64()
}
