//! Keys are sent in one header, and stand nowhere else.

use std::fs;

use crate::service::{Fault, Service};
use crate::space::{KEY_ID, PIPELINE, SECRET, Space, TOKEN, store};

const ALL: [&str; 3] = [KEY_ID, SECRET, TOKEN];

#[track_caller]
fn is_clean(what: &str, text: &str) {
    for secret in ALL {
        assert!(!text.contains(secret), "{what}: {text}");
    }
}

/// Whatever goes wrong, no message, log, record or file has a key; nor has an URL.
#[test]
fn keys_are_never_shown() {
    let service = Service::start();
    let space = Space::with(PIPELINE, &service);
    space.with_store(&["run", "p.yaml"]).ok();
    let faults = [
        Fault::Echo(403),
        Fault::Echo(400),
        Fault::Echo(418),
        Fault::Refused(403, "SignatureDoesNotMatch", None),
        Fault::Refused(301, "PermanentRedirect", Some(SECRET)),
        Fault::Lost,
    ];
    for fault in faults {
        service.plan("GET", "list-type", 1, fault.clone());
        let ended = space.with_store(&["cache", "push", "--json"]);
        is_clean(&format!("{fault:?}"), &format!("{}{}", ended.out(), ended.err()));
        ended.fails(1);
    }
    // An answer that repeats what it was sent, shown: without the keys.
    service.plan("GET", "list-type", 1, Fault::Echo(418));
    let said = space.with_store(&["cache", "push"]).fails(1);
    assert!(said.contains("418"), "{said}");
    for (path, bytes) in space.texts("outputs") {
        is_clean(&path.display().to_string(), &String::from_utf8_lossy(&bytes));
    }
    for name in service.names() {
        is_clean(&name, &String::from_utf8_lossy(&service.content(&name)));
    }
    for seen in service.take_seen() {
        is_clean("an URL", &seen.target);
        assert!(seen.headers["authorization"].contains(KEY_ID), "the key is named where it belongs");
        assert!(seen.headers.values().all(|value| !value.contains(SECRET)), "the secret key signs, and is not sent");
        assert_eq!(seen.headers["x-amz-security-token"], TOKEN);
    }
    for arguments in [["run", "--help"], ["cache", "push"]] {
        let mut command = space.command(&[&arguments[..], &["--help"]].concat());
        let ended = command.env("TURBID_STORE", format!("s3://{KEY_ID}:{SECRET}@lab/x")).output().expect("it starts");
        is_clean("--help", &String::from_utf8_lossy(&ended.stdout));
    }
}

/// An address, an endpoint or a profile with a key in the wrong place.
#[test]
fn slips_with_keys_repeat_none() {
    let service = Service::start();
    let space = Space::with(PIPELINE, &service);
    let address = format!("s3://{KEY_ID}:{SECRET}@lab/x");
    let ended = space.turbid(&["cache", "push", "--store", &address]);
    is_clean("an address", &ended.err());
    ended.fails(2);
    for (name, value) in [
        ("AWS_ENDPOINT_URL_S3", format!("https://{KEY_ID}:{SECRET}@host")),
        ("AWS_SESSION_TOKEN", format!("{TOKEN} and more")),
        ("AWS_SECRET_ACCESS_KEY", format!("{SECRET}\n")),
    ] {
        let mut command = space.command(&["cache", "push", "--store", &store()]);
        let ended = command.env(name, value).output().expect("it starts");
        is_clean(name, &String::from_utf8_lossy(&ended.stderr));
        assert_eq!(ended.status.code(), Some(2), "{name}");
    }
}

/// Keys of a profile: found by name, and told when they are not there.
#[test]
fn profiles_serve() {
    let service = Service::start();
    let space = Space::with(PIPELINE, &service);
    space.turbid(&["run", "p.yaml", "tissue"]).ok();
    fs::create_dir(space.path(".aws")).expect("the folder is ours");
    let text = format!("[lab]\naws_access_key_id = {KEY_ID}\naws_secret_access_key = {SECRET}\n");
    fs::write(space.path(".aws/credentials"), text).expect("the folder is ours");
    let config = format!("[profile lab]\nregion = eu-west-3\nendpoint_url = {}\n", service.endpoint());
    fs::write(space.path(".aws/config"), config).expect("the folder is ours");
    let with = |profile: &str| {
        let mut command = space.command(&["cache", "push", "--store", &store()]);
        for name in ["AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY", "AWS_SESSION_TOKEN", "AWS_ENDPOINT_URL_S3"] {
            command.env_remove(name);
        }
        command.env("AWS_PROFILE", profile).output().expect("it starts")
    };
    assert!(with("lab").status.success());
    assert!(service.take_seen().iter().all(|seen| seen.headers["authorization"].contains("/eu-west-3/s3/")));
    let ended = with("other");
    let said = String::from_utf8_lossy(&ended.stderr);
    assert_eq!(ended.status.code(), Some(2), "{said}");
    assert!(said.contains("no profile `other`"), "{said}");
    is_clean("a profile", &said);
}
