//! The most memory that this process has held.

use std::fs;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use crate::panics::lock;

/// Whoever needs no newer figure takes one that is this old: of thousands of instances in a second none changes much.
const OLD: Duration = Duration::from_millis(100);

static LAST: Mutex<Option<(Instant, u64)>> = Mutex::new(None);

/// Starts a new high-water mark (Linux; elsewhere the mark is that of the process).
pub fn reset() {
    let _ = fs::write("/proc/self/clear_refs", "5");
}

/// The high-water mark in bytes, or what it was a moment ago; 0 where the system does not tell.
pub fn of_process(or_a_moment_ago: bool) -> u64 {
    let mut last = lock(&LAST);
    if let Some((_, bytes)) = last.filter(|(read, _)| or_a_moment_ago && read.elapsed() < OLD) {
        return bytes;
    }
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"));
    let bytes = line.and_then(|l| l.trim().trim_end_matches("kB").trim().parse::<u64>().ok()).map_or(0, |kb| kb * 1024);
    *last = Some((Instant::now(), bytes));
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is held now is in the mark, and what was read is not read again at once.
    #[test]
    #[cfg(target_os = "linux")]
    fn the_mark_holds_what_is_held() {
        let before = of_process(false);
        let held = vec![1_u8; 64 << 20];
        assert!(of_process(false) >= held.len() as u64, "{before}");
        assert!(of_process(true) >= held.len() as u64);
    }
}
