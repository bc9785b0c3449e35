//! The folder for people holds what the store holds, whatever became of its files, and wherever it lies.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use crate::space::{SMALL, Space, counts};

/// With frames that are files of their own in the store, so that there are links, copies and pictures.
fn large() -> String {
    SMALL.replace("pixels: [12, 12]", "pixels: [64, 64]")
}

const TARGETS: [&str; 2] = ["frames", "modulation"];

/// All below a folder that is not one, also through folders that are links.
fn entries(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if path.is_dir() { found.extend(entries(&path)) } else { found.push(path) }
    }
    found.sort();
    found
}

/// Digest of what people find under each name of `latest`; `None` where a link leads nowhere.
fn shown(space: &Space) -> BTreeMap<PathBuf, Option<String>> {
    let latest = space.outputs().join("latest/small");
    let of_people = |path: &PathBuf| !path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'));
    let all = entries(&latest).into_iter().filter(of_people);
    let digest = |path: &PathBuf| Some(blake3::hash(&fs::read(path).ok()?).to_hex().to_string());
    all.map(|path| (path.strip_prefix(&latest).expect("below it").to_owned(), digest(&path))).collect()
}

/// When each file was written.
fn written(space: &Space) -> Vec<(PathBuf, SystemTime)> {
    let time = |path: &PathBuf| fs::symlink_metadata(path).expect("it is there").modified().expect("a time");
    let latest = entries(&space.outputs().join("latest"));
    latest
        .into_iter()
        .map(|path| {
            let at = time(&path);
            (path, at)
        })
        .collect()
}

fn unlock(path: &Path) {
    let mut permissions = fs::metadata(path).expect("it is there").permissions();
    #[allow(clippy::permissions_set_readonly_false)]
    permissions.set_readonly(false);
    fs::set_permissions(path, permissions).expect("it is ours");
}

/// Names are there and bytes are not, as after a power cut, or people changed something: the next run mends it, and then touches nothing.
#[cfg(unix)]
#[test]
fn whatever_happens_to_its_files_a_run_mends_them() {
    let whole = Space::with(&large());
    counts(&whole, &TARGETS);
    let right = shown(&whole);
    let links = right.keys().filter(|path| whole.outputs().join("latest/small").join(path).is_symlink()).count();
    assert!(links >= 1 && right.len() > links + 4, "links, copies and pictures: {right:?}");
    let zeroed = |path: &Path| {
        let mut bytes = fs::read(path).expect("it is there");
        let half = bytes.len() / 2;
        bytes[half..].fill(0);
        fs::write(path, bytes).expect("it is ours");
    };
    let replaced = |path: &Path, with: &dyn Fn(&Path)| {
        fs::remove_file(path).expect("it is ours");
        with(path);
    };
    type Way<'a> = (&'a str, &'a dyn Fn(&Path));
    let ways: [Way; 6] = [
        ("half of it zeros", &zeroed),
        ("empty", &|path| fs::write(path, "").expect("it is ours")),
        ("gone", &|path| fs::remove_file(path).expect("it is ours")),
        ("another file", &|path| replaced(path, &|path| fs::write(path, "mine").expect("it is ours"))),
        ("a link to nothing", &|path| {
            replaced(path, &|path| std::os::unix::fs::symlink("nowhere", path).expect("it is ours"))
        }),
        ("of the same length and time", &|path| {
            let time = fs::metadata(path).expect("it is there").modified().expect("a time");
            zeroed(path);
            fs::File::options().write(true).open(path).and_then(|f| f.set_modified(time)).expect("it is ours");
        }),
    ];
    for (what, way) in ways {
        let space = Space::copy_of(&whole);
        for path in entries(&space.outputs().join("latest/small")) {
            if path.is_symlink() {
                // What it leads to is the store's.
                fs::remove_file(&path).expect("it is ours");
                fs::write(&path, "mine").expect("it is ours");
            } else {
                unlock(&path);
                way(&path);
            }
        }
        assert_eq!(counts(&space, &TARGETS), (3, 0));
        assert_eq!(shown(&space), right, "{what}");
        let before = written(&space);
        assert_eq!(counts(&space, &TARGETS), (3, 0));
        assert_eq!(written(&space), before, "{what}: nothing is written twice");
    }
}

/// The list of its files of another pipeline, cut short, a folder or a pipe: what is listed is compared, not believed.
#[cfg(unix)]
#[test]
fn a_wrong_list_of_files_hides_nothing() {
    let whole = Space::with(&large());
    counts(&whole, &TARGETS);
    let right = shown(&whole);
    let list = fs::read(whole.outputs().join("latest/small/.links")).expect("it is there");
    let cut = list[..list.len() / 2].to_vec();
    for (what, list) in [("cut", Some(cut)), ("empty", Some(Vec::new())), ("a pipe", None)] {
        let space = Space::copy_of(&whole);
        let links = space.outputs().join("latest/small/.links");
        fs::remove_file(&links).expect("it is ours");
        match list {
            Some(list) => fs::write(&links, list).expect("it is ours"),
            None => {
                assert!(std::process::Command::new("mkfifo").arg(&links).status().expect("mkfifo is there").success())
            }
        }
        let frames = space.outputs().join("latest/small/frames/frames.png");
        fs::write(&frames, "mine").expect("it is ours");
        assert_eq!(counts(&space, &TARGETS), (3, 0));
        assert_eq!(shown(&space), right, "{what}");
    }
}

/// Outputs, store or `latest` may be links to folders elsewhere: what is below still leads to the results.
#[cfg(unix)]
#[test]
fn links_lead_to_results_through_folders_that_are_links() {
    let plain = Space::with(&large());
    counts(&plain, &TARGETS);
    let right = shown(&plain);
    for linked in ["outputs", "outputs/latest", "outputs/store", "outputs/latest/small", "outputs/latest/small/frames"]
    {
        let space = Space::with(&large());
        let (link, far) = (space.path().join(linked), space.path().join("far/away/from/here"));
        fs::create_dir_all(&far).expect("it is ours");
        fs::create_dir_all(link.parent().expect("it lies in the space")).expect("it is ours");
        std::os::unix::fs::symlink(&far, &link).expect("it is ours");
        counts(&space, &TARGETS);
        assert_eq!(shown(&space), right, "{linked}");
        let before = written(&space);
        assert_eq!(counts(&space, &TARGETS), (3, 0));
        assert_eq!(written(&space), before, "{linked}");
    }
}
