//! Pushes, pulls and runs that are killed.
//!
//! `TURBID_KILLS=200 cargo test -p turbid-s3-tests -- --nocapture kills` kills transfers as often, and runs as often.

use std::time::{Duration, Instant};

use crate::service::Service;
use crate::space::{PIPELINE, Space};

/// Of three kills each.
fn rounds() -> usize {
    std::env::var("TURBID_KILLS").map_or(2, |text| text.parse::<usize>().expect("a number of kills").div_ceil(3))
}

/// Kills a command after a part of `length`; the share goes round so that every moment comes. Whether it was still at work.
fn kill(space: &Space, arguments: &[&str], length: Duration, round: usize) -> usize {
    let mut child = space.start(arguments);
    std::thread::sleep(length.mul_f64((0.618 * round as f64).fract()));
    // It may have ended already; then there is nothing to kill.
    let _ = child.kill();
    usize::from(!child.wait().expect("it was started").success())
}

/// Killed at any moment, the next push and the next pull go on: the same digests, and `verify` finds nothing.
#[test]
fn killed_transfers_go_on() {
    let service = Service::start();
    let here = Space::with(PIPELINE, &service);
    here.turbid(&["run", "p.yaml"]).ok();
    let digests = here.digests();
    let began = Instant::now();
    here.with_store(&["cache", "push"]).ok();
    let length = began.elapsed();
    let mut killed = 0;
    for round in 0..rounds() {
        // Everything anew, into the same bucket.
        service.names().iter().for_each(|name| service.replace(name, None));
        killed += kill(&here, &["cache", "push"], length, round);
        let there = Space::with(PIPELINE, &service);
        killed += kill(&there, &["cache", "pull"], length, 7 * round + 3);
        there.turbid(&["cache", "verify"]).ok();
        here.with_store(&["cache", "push"]).ok();
        killed += kill(&there, &["cache", "pull"], length, 11 * round + 5);
        there.turbid(&["cache", "verify"]).ok();
        there.with_store(&["cache", "pull"]).ok();
        assert_eq!((there.digests(), there.planned()), (digests.clone(), (9, 0)), "round {round}");
        there.turbid(&["cache", "verify"]).ok();
    }
    println!("{killed} of {} pushes and pulls were killed at work", 3 * rounds());
}

/// Runs with a store behind them, killed at any moment.
#[test]
fn killed_runs_go_on() {
    let service = Service::start();
    let reference = Space::with(PIPELINE, &service);
    let began = Instant::now();
    reference.turbid(&["run", "p.yaml"]).ok();
    let (length, digests) = (2 * began.elapsed(), reference.digests());
    let mut killed = 0;
    for round in 0..rounds() {
        service.names().iter().for_each(|name| service.replace(name, None));
        let here = Space::with(PIPELINE, &service);
        for again in 0..3 {
            killed += kill(&here, &["run", "p.yaml"], length, 3 * round + again);
        }
        here.with_store(&["run", "p.yaml"]).ok();
        let there = Space::with(PIPELINE, &service);
        there.with_store(&["cache", "pull"]).ok();
        assert_eq!((there.digests(), there.planned()), (digests.clone(), (9, 0)), "round {round}");
        there.turbid(&["cache", "verify"]).ok();
    }
    println!("{killed} of {} runs were killed at work", 3 * rounds());
}
