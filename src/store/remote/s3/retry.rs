//! Faults that pass: what is tried again, how often, and after how long.

use std::hash::{BuildHasher, RandomState};
use std::time::Duration;

/// So often a request is made at the most; 6 s of waiting on average, 13 s at the most.
pub(super) const TRIES: u32 = 8;
/// Of a service that nobody hears: its name or its port may be wrong.
pub(super) const TRIES_UNHEARD: u32 = 3;

const FIRST: Duration = Duration::from_millis(100);
const LONGEST: Duration = Duration::from_secs(10);

/// Whether an answer says that the same request may be granted later.
pub(super) fn may_pass(status: u16, code: &str) -> bool {
    let codes = [
        "SlowDown",
        "RequestTimeout",
        "InternalError",
        "ServiceUnavailable",
        "ThrottlingException",
        "RequestLimitExceeded",
    ];
    matches!(status, 429 | 500 | 502 | 503 | 504) || codes.contains(&code)
}

/// Before the try after so many: twice as long each time, and by chance half of it or more, so that many who were refused together do not come back together.
pub(super) fn wait(tries: u32) -> Duration {
    between(tries, RandomState::new().hash_one(tries) as f64 / u64::MAX as f64)
}

fn between(tries: u32, chance: f64) -> Duration {
    let longest = FIRST.saturating_mul(1 << (tries - 1).min(20)).min(LONGEST);
    longest.mul_f64(0.5 + 0.5 * chance)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waits_grow_and_end() {
        let all = |chance| (1..TRIES).map(move |tries| between(tries, chance));
        assert_eq!(all(1.0).sum::<Duration>(), Duration::from_millis(12_700));
        assert_eq!(all(0.0).sum::<Duration>(), Duration::from_millis(6_350));
        assert_eq!(between(1000, 1.0), LONGEST);
        assert!((1..9).all(|tries| wait(tries) >= between(tries, 0.0) && wait(tries) <= between(tries, 1.0)));
        assert!(may_pass(503, "SlowDown") && may_pass(400, "RequestTimeout") && may_pass(429, ""));
        assert!(!may_pass(403, "AccessDenied") && !may_pass(404, "NoSuchKey") && !may_pass(301, "PermanentRedirect"));
    }
}
