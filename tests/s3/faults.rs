//! Faults of networks, services and users: those that pass are tried again, all others are named; nothing is lost.

use std::time::Duration;

use crate::service::{Fault, Service};
use crate::space::{PIPELINE, Space, store};

/// A folder in which the pipeline has run, and its digests.
fn finished(service: &Service) -> (Space, String) {
    let space = Space::with(PIPELINE, service);
    space.turbid(&["run", "p.yaml"]).ok();
    let digests = space.digests();
    (space, digests)
}

/// Once or twice of every fault that passes, of every kind of request.
#[test]
fn faults_that_pass_are_tried_again() {
    let service = Service::start();
    let (here, digests) = finished(&service);
    let passing = [
        Fault::Reset,
        Fault::Truncated,
        Fault::Refused(500, "InternalError", None),
        Fault::Refused(502, "", None),
        Fault::Refused(503, "SlowDown", None),
        Fault::Refused(429, "", None),
        Fault::Refused(400, "RequestTimeout", None),
    ];
    for fault in &passing {
        for (method, path) in [("PUT", "/packs/"), ("PUT", "/blobs/"), ("PUT", "/manifests/"), ("GET", "list-type")] {
            service.plan(method, path, 1, fault.clone());
        }
    }
    here.with_store(&["cache", "push"]).ok();
    let there = Space::with(PIPELINE, &service);
    for fault in &passing {
        for path in ["/packs/", "/blobs/", "/manifests/", "list-type"] {
            service.plan("GET", path, 1, fault.clone());
        }
    }
    // Seven faults in a row are as many as are tried again.
    there.with_store(&["cache", "pull"]).ok();
    assert_eq!((there.digests(), there.planned()), (digests, (9, 0)));
}

/// A fifth of all requests fails, by chance.
#[test]
fn a_bad_network_loses_nothing() {
    let service = Service::start();
    let (here, digests) = finished(&service);
    service.fail_by_chance(200);
    here.with_store(&["cache", "push"]).ok();
    let there = Space::with(PIPELINE, &service);
    there.with_store(&["run", "p.yaml"]).ok();
    assert_eq!(there.digests(), digests);
    there.turbid(&["cache", "verify"]).ok();
}

/// A service that does not answer is waited for so long, and not for ever.
#[test]
fn silence_ends() {
    let service = Service::start();
    let (here, _) = finished(&service);
    service.plan("PUT", "/packs/", 1, Fault::Stalled(Duration::from_secs(600)));
    let mut command = here.command(&["cache", "push", "--store", &store()]);
    assert!(command.env("TURBID_STORE_TIMEOUT", "1").output().expect("it starts").status.success());
    let ended = command.env("TURBID_STORE_TIMEOUT", "soon").output().expect("it starts");
    assert!(String::from_utf8_lossy(&ended.stderr).contains("TURBID_STORE_TIMEOUT is `soon`"));
}

/// What does not pass is named with bucket, object, status, code and the way out, at once; a run keeps what it made and ends with 1.
#[test]
fn refusals_are_named() {
    let service = Service::start();
    let (here, digests) = finished(&service);
    for (status, code, region, want) in [
        (301, "PermanentRedirect", Some("eu-west-1"), "set AWS_REGION=eu-west-1"),
        (400, "AuthorizationHeaderMalformed", Some("eu-west-1"), "set AWS_REGION=eu-west-1"),
        (403, "AccessDenied", None, "s3:PutObject"),
        (403, "InvalidAccessKeyId", None, "AWS_ACCESS_KEY_ID"),
        (403, "RequestTimeTooSkewed", None, "the clock of this machine"),
        (403, "QuotaExceeded", None, "the bucket is full"),
        (507, "", None, "the bucket is full"),
        (400, "ExpiredToken", None, "get new keys"),
        (404, "NoSuchBucket", None, "no bucket `lab`"),
    ] {
        for (method, path) in [("GET", "list-type"), ("PUT", "/packs/"), ("PUT", "/manifests/")] {
            service.names().iter().for_each(|name| service.replace(name, None));
            service.take_seen();
            service.plan(method, path, 1, Fault::Refused(status, code, region));
            let said = here.with_store(&["cache", "push"]).fails(1);
            assert!(said.contains(&status.to_string()) && said.contains(code), "{said}");
            assert!(said.contains(want) && said.contains("s3://lab/some/where"), "{said}");
            assert!(method == "GET" || said.contains(path.trim_matches('/')), "the object is named: {said}");
            let asked = service.take_seen().iter().filter(|s| s.method == method && s.target.contains(path)).count();
            assert_eq!(asked, 1, "{code} is not tried again");
        }
    }
    let other = Space::with(PIPELINE, &service);
    service.plan("PUT", "", 100, Fault::Refused(403, "AccessDenied", None));
    let said = other.with_store(&["run", "p.yaml"]).fails(1);
    assert!(said.contains("`turbid cache push` sends them later"), "{said}");
    assert_eq!(other.digests(), digests);
    service.plan_nothing();
    other.with_store(&["cache", "push"]).ok();
    let third = Space::with(PIPELINE, &service);
    third.with_store(&["cache", "pull"]).ok();
    assert_eq!(third.digests(), digests);
}

/// An endpoint that is none: what answers there speaks something else, or nothing answers.
#[test]
fn a_wrong_endpoint_is_named() {
    let service = Service::start();
    let (here, _) = finished(&service);
    service.plan("GET", "list-type", 1, Fault::Lost);
    let said = here.with_store(&["cache", "push"]).fails(1);
    assert!(said.contains("no list of objects") && said.contains("AWS_ENDPOINT_URL_S3"), "{said}");
    let closed = {
        let listener = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
        listener.local_addr().expect("it is bound").to_string()
    };
    for (endpoint, want) in [
        (format!("http://{closed}"), closed.as_str()),
        (format!("https://{}", service.endpoint().trim_start_matches("http://")), "127.0.0.1"),
        ("http://name.invalid:9000".to_owned(), "name.invalid"),
    ] {
        let mut command = here.command(&["cache", "push", "--store", &store()]);
        let ended = command.env("AWS_ENDPOINT_URL_S3", &endpoint).output().expect("it starts");
        let said = String::from_utf8_lossy(&ended.stderr);
        assert_eq!(ended.status.code(), Some(1), "{said}");
        assert!(
            said.contains(want) && said.contains("no answer") && said.contains("check the endpoint"),
            "{endpoint}: {said}"
        );
    }
    let mut command = here.command(&["cache", "push", "--store", &store()]);
    let ended = command.env("AWS_ENDPOINT_URL_S3", "ftp://host").output().expect("it starts");
    assert_eq!(ended.status.code(), Some(2));
}

/// Objects that are cut short, replaced or gone are told and made again; the run that did so puts others in their place.
#[test]
fn damage_is_told_and_mended() {
    let service = Service::start();
    let (here, digests) = finished(&service);
    here.with_store(&["cache", "push"]).ok();
    let (whole, names) = (service.objects(), service.names());
    for folder in ["/packs/", "/blobs/", "/manifests/"] {
        let name = names.iter().find(|name| name.contains(folder)).expect("one of each was pushed");
        let other = names.iter().find(|other| *other != name).expect("there are several");
        let bytes = service.content(name);
        for wrong in [Some(bytes[..bytes.len() / 2].to_vec()), Some(service.content(other)), None] {
            service.restore(&whole);
            let gone = wrong.is_none();
            service.replace(name, wrong);
            let there = Space::with(PIPELINE, &service);
            let ended = there.with_store(&["run", "p.yaml"]);
            let (object, said) = (name.rsplit('/').next().unwrap_or_default(), ended.err());
            ended.ok();
            // A manifest that is gone is as if it had never been written.
            assert!(said.contains(object) || gone && folder == "/manifests/", "{name}: {said}");
            assert_eq!(there.digests(), digests, "{name}");
            // The run has sent what it made again; who has it all needs not do it.
            let fresh = Space::with(PIPELINE, &service);
            fresh.with_store(&["cache", "pull"]).ok();
            assert_eq!((fresh.planned(), fresh.digests()), ((9, 0), digests.clone()), "{name}");
            here.with_store(&["cache", "push"]).ok();
        }
    }
}

/// What the service took and did not keep is missing, and sent again.
#[test]
fn a_torn_upload_is_a_miss() {
    let service = Service::start();
    let (here, digests) = finished(&service);
    service.plan("PUT", "/packs/", 1, Fault::Lost);
    here.with_store(&["cache", "push"]).ok();
    let there = Space::with(PIPELINE, &service);
    let ended = there.with_store(&["cache", "pull"]);
    assert!(ended.err().contains("is gone"), "{}", ended.err());
    assert!(there.planned().0 < 9);
    let said = here.with_store(&["cache", "push"]);
    assert!(said.err().contains("is gone"), "{}", said.err());
    there.with_store(&["cache", "pull"]).ok();
    assert_eq!(there.digests(), digests);
}
