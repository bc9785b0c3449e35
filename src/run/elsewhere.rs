//! Instances at which another process is at work: when their turn comes again.

use std::collections::BTreeMap;
use std::time::Duration;

use crate::digest::Digest;
use crate::plan::InstanceId;

const SHORTEST: Duration = Duration::from_millis(2);
/// What waits for long is looked at seldom: a look costs a call for each, on a network file system one across the network.
const LONGEST: Duration = Duration::from_secs(1);
/// Of the time that somebody has waited already, so much may pass until the next look.
const PART: u32 = 16;

/// Instances whose keys other processes hold. Times are those since the run began, and given.
#[derive(Default)]
pub struct Elsewhere {
    keys: BTreeMap<InstanceId, Digest>,
    /// When the last of them changed, and when to look at them again.
    since: Duration,
    next: Duration,
}

impl Elsewhere {
    pub fn add(&mut self, id: InstanceId, key: Digest, now: Duration) {
        self.keys.insert(id, key);
        self.changed(now);
    }

    pub fn is_empty(&self) -> bool {
        self.keys.is_empty()
    }

    /// How long nothing needs to be looked at.
    pub fn pause(&self, now: Duration) -> Duration {
        self.next.saturating_sub(now)
    }

    /// Removes those whose keys `is_free` says are held no more, if it is time to look.
    pub fn freed(&mut self, now: Duration, is_free: impl Fn(&Digest) -> bool) -> Vec<InstanceId> {
        if self.keys.is_empty() || now < self.next {
            return Vec::new();
        }
        let freed: Vec<InstanceId> = self.keys.iter().filter(|(_, key)| is_free(key)).map(|(id, _)| *id).collect();
        self.keys.retain(|id, _| !freed.contains(id));
        if freed.is_empty() {
            self.next = now + ((now - self.since) / PART).clamp(SHORTEST, LONGEST);
        } else {
            self.changed(now);
        }
        freed
    }

    /// Something else became of it.
    pub fn remove(&mut self, id: InstanceId) {
        self.keys.remove(&id);
    }

    fn changed(&mut self, now: Duration) {
        (self.since, self.next) = (now, now + SHORTEST);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::Id;

    /// However long one waits, one waits a sixteenth longer than need be at the most, or the shortest time; and looks are few.
    #[test]
    fn looks_become_rare_and_none_comes_late() {
        let (mut elsewhere, id, key) = (Elsewhere::default(), InstanceId::new(3), Digest::of(b"key"));
        assert!(elsewhere.freed(Duration::from_secs(5), |_| true).is_empty());
        for free_at in [0.001, 0.1, 2.0, 100.0, 1000.0].map(Duration::from_secs_f64) {
            let began = Duration::from_secs(7);
            elsewhere.add(id, key, began);
            let (mut now, mut looks) = (began, 0);
            while elsewhere.freed(now, |k| *k == key && now >= began + free_at).is_empty() {
                assert!(!elsewhere.is_empty());
                now += elsewhere.pause(now).max(Duration::from_micros(1));
                looks += 1;
            }
            let late = now - began - free_at;
            assert!(late <= (free_at / 8).clamp(2 * SHORTEST, LONGEST), "{free_at:?}: {late:?} late");
            assert!(looks < 1200, "{free_at:?}: {looks} looks");
            assert!(elsewhere.is_empty());
        }
    }
}
