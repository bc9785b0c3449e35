//! Licences of what the program is built from: `deny.toml` allows them, and `THIRD-PARTY.md` holds their texts.
//!
//! `TURBID_RENEW=1 cargo test --test all licences` writes `THIRD-PARTY.md` anew after a dependency has changed.

#[path = "licences/expression.rs"]
mod expression;
#[path = "licences/notice.rs"]
mod notice;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

/// A crate of the program.
pub struct Package {
    pub name: String,
    pub version: String,
    /// As its manifest has it.
    pub licence: String,
    pub authors: Vec<String>,
    /// `None` for our own.
    pub source: Option<String>,
    pub folder: PathBuf,
}

/// What the program is built for where it is released.
const TARGET: &str = "x86_64-unknown-linux-gnu";

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// What cargo says of the packages, without asking the network.
fn metadata() -> Value {
    let cargo = option_env!("CARGO").unwrap_or("cargo");
    let arguments = ["metadata", "--offline", "--locked", "--format-version", "1", "--filter-platform", TARGET];
    let done = Command::new(cargo).args(arguments).current_dir(root()).output().expect("cargo starts");
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    serde_json::from_slice(&done.stdout).expect("cargo writes JSON")
}

fn text(value: &Value) -> String {
    value.as_str().unwrap_or_default().to_owned()
}

fn list(value: &Value) -> &[Value] {
    value.as_array().map_or(&[], Vec::as_slice)
}

/// The packages that the program is made of: normal dependencies of dependencies; with `all`, those of builds and tests too.
fn packages(metadata: &Value, all: bool) -> Vec<Package> {
    let nodes: BTreeMap<&str, &Value> =
        list(&metadata["resolve"]["nodes"]).iter().map(|n| (n["id"].as_str().unwrap_or_default(), n)).collect();
    let mut open = vec![metadata["resolve"]["root"].as_str().expect("the workspace has a root package")];
    let mut found = BTreeSet::new();
    while let Some(id) = open.pop() {
        if found.insert(id) {
            let used = |d: &&Value| all || list(&d["dep_kinds"]).iter().any(|kind| kind["kind"].is_null());
            open.extend(list(&nodes[id]["deps"]).iter().filter(used).filter_map(|d| d["pkg"].as_str()));
        }
    }
    let of = |p: &Value| Package {
        name: text(&p["name"]),
        version: text(&p["version"]),
        licence: text(&p["license"]),
        authors: list(&p["authors"]).iter().map(text).collect(),
        source: p["source"].as_str().map(str::to_owned),
        folder: Path::new(&text(&p["manifest_path"])).parent().expect("a manifest lies in a folder").to_owned(),
    };
    let wanted = |p: &&Value| found.contains(p["id"].as_str().unwrap_or_default());
    let mut packages: Vec<Package> = list(&metadata["packages"]).iter().filter(wanted).map(of).collect();
    packages.sort_by(|a, b| (&a.name, &a.version).cmp(&(&b.name, &b.version)));
    packages
}

/// The texts of an array of `deny.toml`, or of the `field` of its tables.
fn of_deny_toml(section: &str, array: &str) -> Vec<String> {
    let toml = std::fs::read_to_string(root().join("deny.toml")).expect("the file is ours");
    let section = toml.split(&format!("[{section}]\n")).nth(1).expect("the section is there");
    let inside = section.split(&format!("\n{array} = [")).nth(1).expect("the array is there");
    let inside = &inside[..inside.find("\n]").expect("the array ends on a line of its own")];
    let lines = inside.lines().map(|line| line.split('#').next().unwrap_or_default());
    let words = lines.filter_map(|line| line.split('"').nth(1));
    // As `expression` reads it.
    words.map(|word| word.replace(" WITH ", "+")).collect()
}

#[test]
fn every_licence_is_allowed_and_every_crate_is_of_the_registry() {
    let allowed = of_deny_toml("licenses", "allow");
    let metadata = metadata();
    let mut registries = BTreeSet::new();
    for package in packages(&metadata, true) {
        let Package { name, version, licence, source, .. } = &package;
        let terms = expression::chosen(licence, &allowed);
        assert!(terms.is_some(), "{name} {version} is under `{licence}`, and deny.toml allows {allowed:?}");
        let of_registry = source.as_deref().is_none_or(|source| source.starts_with("registry+"));
        assert!(of_registry, "{name} {version} is from {source:?}");
        registries.extend(source.clone());
    }
    assert_eq!(registries.len(), 1, "crates are of one registry: {registries:?}");
    // None is allowed that does not occur.
    let used: BTreeSet<String> =
        packages(&metadata, true).iter().filter_map(|p| expression::chosen(&p.licence, &allowed)).flatten().collect();
    assert_eq!(used, allowed.into_iter().collect());
}

/// A crate in two versions is built twice: only those that `deny.toml` names, each with a reason.
#[test]
fn crates_that_are_there_twice_are_known() {
    let mut versions: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for package in packages(&metadata(), true) {
        versions.entry(package.name).or_default().insert(package.version);
    }
    let twice = versions.iter().filter(|(_, v)| v.len() > 1).flat_map(|(name, v)| v.iter().map(move |v| (name, v)));
    let mut skipped = of_deny_toml("bans", "skip").into_iter().map(|s| s.replace('@', " ")).collect::<Vec<_>>();
    for (name, version) in twice {
        let older = versions[name].iter().next_back() != Some(version);
        if older {
            let at = skipped.iter().position(|s| *s == format!("{name} {version}"));
            assert!(at.is_some(), "{name} is there in {:?}; say in deny.toml why, or have one", versions[name]);
            skipped.remove(at.expect("just asserted"));
        }
    }
    assert_eq!(skipped, [""; 0], "deny.toml names what is not there twice");
}

#[test]
fn third_party_md_is_that_of_the_dependencies() {
    let allowed = of_deny_toml("licenses", "allow");
    let mut packages = packages(&metadata(), false);
    packages.retain(|p| p.source.is_some());
    let right = notice::write(&packages, &allowed);
    let path = root().join("THIRD-PARTY.md");
    if std::env::var_os("TURBID_RENEW").is_some() {
        std::fs::write(&path, &right).expect("the file is ours");
    }
    let found = std::fs::read_to_string(&path).unwrap_or_default();
    let first = found.lines().zip(right.lines()).position(|(a, b)| a != b);
    assert!(
        found == right,
        "THIRD-PARTY.md is not that of the dependencies, from line {:?} on: `TURBID_RENEW=1 cargo test --test all licences` writes it anew",
        first.map(|line| line + 1)
    );
}
