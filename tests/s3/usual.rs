//! What a store in S3 is for.

use crate::service::Service;
use crate::space::{PIPELINE, Space, store};

/// Run here, push, pull into a fresh folder: the same digests, and nothing is left to run.
#[test]
fn a_run_is_pulled_elsewhere() {
    let service = Service::start();
    let here = Space::with(PIPELINE, &service);
    here.turbid(&["run", "p.yaml"]).ok();
    let said = here.with_store(&["cache", "push"]).ok();
    assert!(said.contains("pushed 9 results: 1 pack and 6 large blobs"), "{said}");
    let folders = |part: &str| service.names().iter().filter(|name| name.starts_with(part)).count();
    let found = ["packs", "blobs", "manifests"].map(|folder| folders(&format!("some/where/{folder}/")));
    assert_eq!((found, service.names().len()), ([1, 6, 1], 8));

    let there = Space::with(PIPELINE, &service);
    assert_eq!(there.planned(), (0, 9));
    let said = there.with_store(&["cache", "pull"]).ok();
    assert!(said.contains("pulled 9 results,"), "{said}");
    assert_eq!((there.planned(), there.digests()), ((9, 0), here.digests()));
    there.turbid(&["cache", "verify"]).ok();
    // Nothing is sent or fetched twice.
    service.take_seen();
    let said = there.with_store(&["cache", "sync", "--json"]).json();
    assert_eq!((said["pulled"]["records"].as_u64(), said["pushed"]["records"].as_u64()), (Some(0), Some(0)));
    assert!(service.take_seen().iter().all(|seen| seen.target.contains("list-type=2")));
}

/// A run with the store behind it: what others made is brought in, what it made is sent.
#[test]
fn runs_share_a_store() {
    let service = Service::start();
    let first = Space::with(PIPELINE, &service);
    let ran = first.with_store(&["run", "p.yaml", "frames", "--json"]).json();
    assert_eq!((ran["ran"].as_u64(), ran["hits"].as_u64()), (Some(6), Some(0)));
    let second = Space::with(PIPELINE, &service);
    let plan = second.with_store(&["plan", "p.yaml", "--json"]).json();
    let hits = plan["instances"].as_array().expect("a list").iter().filter(|i| i["state"] == "hit").count();
    assert_eq!(hits, 6);
    let ran = second.with_store(&["run", "p.yaml", "--json"]).json();
    assert_eq!((ran["ran"].as_u64(), ran["hits"].as_u64()), (Some(3), Some(6)));
    // The first has it all now, without a run; the environment names the store as well.
    let mut command = first.command(&["run", "p.yaml", "--json"]);
    let ran = command.env("TURBID_STORE", store()).output().expect("the program starts");
    assert!(String::from_utf8_lossy(&ran.stdout).contains("\"hits\":9"), "{}", String::from_utf8_lossy(&ran.stdout));
    assert_eq!(first.digests(), second.digests());
    // A third one looks at a number, and takes what it needs for that.
    let third = Space::with(PIPELINE, &service);
    let said = third.with_store(&["show", "p.yaml", "maps[mu_a=0.05]"]).ok();
    assert!(said.contains("m_ac"), "{said}");
    third.with_store(&["export", "p.yaml", "frames[mu_a=0.1].frames", "--to", "f.npz"]).ok();
    assert!(third.path("f.npz").is_file());
    let all = second.digests().lines().count();
    assert!(third.digests().lines().count() < all, "large outputs come when they are read");
}

/// With a file, and a target of it, only what that names is sent and fetched.
#[test]
fn a_pipeline_says_what_is_sent() {
    let service = Service::start();
    let here = Space::with(PIPELINE, &service);
    here.turbid(&["run", "p.yaml"]).ok();
    let said = here.with_store(&["cache", "push", "p.yaml", "tissue"]).ok();
    assert!(said.contains("3 of 3 instances") && said.contains("pushed 3 results"), "{said}");
    let said = here.with_store(&["cache", "push", "p.yaml", "--set", "stages.tissue.foreach.mu_a=[0.02]"]).ok();
    assert!(said.contains("3 of 3 instances") && said.contains("pushed 2 results"), "{said}");
    let there = Space::with(PIPELINE, &service);
    let said = there.with_store(&["cache", "pull", "p.yaml", "frames"]).ok();
    assert!(said.contains("4 of 6 instances") && said.contains("pulled 4 results"), "{said}");
    assert!(said.contains("1 large blob"), "{said}");
    assert_eq!(there.planned(), (4, 5), "three scenes, one render; its demodulation was not asked for");
    let said = there.with_store(&["cache", "pull", "absent.yaml"]).fails(2);
    assert!(said.contains("absent.yaml"), "{said}");
}

/// What is wrong with what the user said is told before anything is asked of the network.
#[test]
fn slips_are_told() {
    let service = Service::start();
    let space = Space::with(PIPELINE, &service);
    for (arguments, want) in [
        (&["cache", "push"][..], "which store?"),
        (&["cache", "pull", "--store", "lab/some"], "s3://BUCKET/PREFIX"),
        (&["run", "p.yaml", "--store", "s3://x"], "3 to 63 letters"),
        (&["plan", "p.yaml", "--store", "http://host/lab"], "s3://BUCKET/PREFIX"),
    ] {
        let said = space.turbid(arguments).fails(2);
        assert!(said.contains(want), "{said}");
    }
    let mut command = space.command(&["cache", "push", "--store", &store()]);
    let ended =
        command.env_remove("AWS_ACCESS_KEY_ID").env_remove("AWS_SECRET_ACCESS_KEY").output().expect("it starts");
    assert_eq!(ended.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&ended.stderr).contains("AWS_PROFILE"));
    assert!(service.take_seen().is_empty());
}
