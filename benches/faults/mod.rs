//! Breaks the program's calls one by one, and asks whether the next run heals all: see `benches/faults.rs`.

pub mod calls;
pub mod case;
pub mod disk;
mod folder;
pub mod kinds;
mod program;
pub mod random;
pub mod reference;
pub mod scenarios;
pub mod stops;
pub mod tracer;

use std::collections::BTreeSet;

use case::Case;
use kinds::Kind;
use random::Random;
use reference::Reference;

/// Cases of a kind spread over what a scenario does, the last call included. Calls that go on with what the one before began (a text written in
/// pieces) are one place, or most cases would lie in the logs of runs.
pub fn spread(reference: &Reference, kind: Kind, cases: u64, seed: u64) -> Vec<Case> {
    let places = if kind.reads() { (1..=reference.reads).map(|k| (k, k)).collect() } else { places(reference) };
    let calls = if kind.reads() { reference.reads } else { reference.calls };
    let n = places.len() as u64;
    let mut random = Random::new(seed ^ (kind as u64) << 32);
    let cases = if kind == Kind::PowerCut { cases } else { cases.min(calls) };
    let mut chosen = BTreeSet::new();
    let mut all = Vec::new();
    for k in 0..if n == 0 { 0 } else { cases } {
        let place = (k * n / cases + random.below((n / cases).max(1))).min(n - 1);
        let (first, last) = places[place as usize];
        // After a power cut there are many states for one call; most cuts come some time after the end.
        let end = k + 1 == cases || (kind == Kind::PowerCut && k % 3 == 2);
        let at = if end { calls } else { first + random.below(last - first + 1) };
        if chosen.insert(at) || kind == Kind::PowerCut {
            all.push(Case { kind, at, seed: random.next() % 1_000_000 });
        }
    }
    all
}

/// First and last number of calls of one sort to one file.
fn places(reference: &Reference) -> Vec<(u64, u64)> {
    let mut places: Vec<(u64, u64)> = Vec::new();
    let mut before = None;
    for logged in reference.log.iter().filter(|logged| !logged.call.path.ends_with("broken.out")) {
        let this = Some((std::mem::discriminant(&logged.call.op), &logged.call.path));
        match places.last_mut() {
            Some(place) if this == before => place.1 = place.1.max(logged.number),
            _ => places.push((logged.number, logged.number)),
        }
        before = this;
    }
    places
}
