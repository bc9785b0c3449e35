//! What `turbid new` writes: each starter runs as it stands and ends in maps with a picture.

use crate::space::Space;

/// A new pipeline `mine`, checked and run with these settings; its pictures below STAGE.
fn pictures_of(starter: &str, stage: &str, settings: &[&str]) -> Vec<String> {
    let space = Space::new();
    space.turbid(&["new", "mine", "--from", starter]).ok();
    let check = space.turbid(&["check", "mine.yaml"]).ok();
    assert!(!check.contains("warning"), "{starter}: {check}");
    let run: Vec<&str> = ["run", "mine.yaml", stage].into_iter().chain(settings.iter().copied()).collect();
    space.turbid(&run).ok();
    let files = space.files(&format!("outputs/latest/mine/{stage}"));
    files.iter().map(|path| path.to_string_lossy().into_owned()).filter(|path| path.ends_with(".png")).collect()
}

#[test]
fn every_starter_ends_in_maps_with_a_picture() {
    let few = ["--set", "vars.samples=16"];
    let tube = ["--set", "vars.samples=16", "--set", "vars.reference_samples=32"];
    let two = ["--set", "vars.samples=16", "--set", "vars.n=2"];
    for (starter, stage, settings) in [
        ("planar", "maps", &few[..]),
        ("measured", "maps", &[]),
        ("wavelengths", "oxygen", &few),
        ("tube", "maps", &tube),
        ("dataset", "maps", &two),
    ] {
        let pictures = pictures_of(starter, stage, settings);
        assert!(!pictures.is_empty(), "{starter}: no picture of {stage}");
    }
}

/// Nothing that is there is written over, and a second starter beside the first changes none of its files.
#[test]
fn a_starter_replaces_nothing() {
    let space = Space::new();
    space.turbid(&["new", "mine", "--from", "measured"]).ok();
    assert!(space.turbid(&["new", "mine", "--from", "tube"]).fails(2).contains("mine.yaml exists"));
    space.turbid(&["new", "other", "--from", "measured"]).ok();
    std::fs::remove_file(space.path().join("mine.yaml")).expect("it was written");
    assert!(space.turbid(&["new", "mine", "--from", "measured"]).fails(2).contains("mine_frames exists"));
    assert!(space.turbid(&["new", "third", "--from", "planet"]).fails(2).contains("planar"));
}
