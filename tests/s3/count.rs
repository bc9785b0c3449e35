//! Requests and bytes of many instances.
//!
//! `TURBID_INSTANCES=10000 cargo test -p turbid-s3-tests -- --nocapture count` says what so many cost.

use crate::service::{Seen, Service};
use crate::space::Space;

/// So many tables of 2 x 2 nodes.
fn tables(count: usize) -> String {
    format!(
        "pipeline: many
stages:
  t:
    use: build_lut
    foreach: {{n: {{linspace: [1.3, 1.4, {count}]}}}}
    with: {{model: diffusion, f_x: [0, 0.1], g: 0.8, n: \"${{n}}\", mu_a: [0.01, 0.1], mu_s_prime: [0.5, 1]}}
"
    )
}

/// By method: requests, bytes sent, bytes received.
fn sums(seen: &[Seen]) -> String {
    let of = |what: &str, is: &dyn Fn(&&Seen) -> bool| {
        let those: Vec<&Seen> = seen.iter().filter(is).collect();
        let (sent, received): (usize, usize) =
            (those.iter().map(|s| s.body).sum(), those.iter().map(|s| s.answered).sum());
        format!("{} {what} ({sent} bytes sent, {received} received)", those.len())
    };
    let lists = |s: &&Seen| s.target.contains("list-type");
    [of("PUT", &|s| s.method == "PUT"), of("GET", &|s| s.method == "GET" && !lists(s)), of("LIST", &lists)].join(", ")
}

/// Requests grow with bytes, not with instances: records and small blobs travel in packs.
#[test]
fn packs_are_counted_not_instances() {
    let count = std::env::var("TURBID_INSTANCES").map_or(300, |text| text.parse().expect("a number of instances"));
    let service = Service::start();
    service.list_by_the_thousand();
    let here = Space::with(&tables(count), &service);
    here.turbid(&["run", "p.yaml"]).ok();
    here.with_store(&["cache", "push"]).ok();
    let pushed = service.take_seen();
    let there = Space::with(&tables(count), &service);
    there.with_store(&["cache", "pull", "p.yaml"]).ok();
    let pulled = service.take_seen();
    assert_eq!((there.planned(), there.digests()), ((count, 0), here.digests()));
    let again = here.with_store(&["run", "p.yaml", "--json"]).json();
    assert_eq!(again["hits"].as_u64(), Some(count as u64));
    let nothing = service.take_seen();
    println!("{count} instances: {} objects", service.names().len());
    println!("push: {}\npull: {}\na run of hits: {}", sums(&pushed), sums(&pulled), sums(&nothing));
    let most = 8 + count / 1000;
    assert!(pushed.len() <= most && pulled.len() <= most && nothing.len() == 1, "more requests than packs");
}
