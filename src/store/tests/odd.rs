//! Things that are no files of the store in the places of its files, repairs that fail, and what killed processes leave.

use super::*;

/// Puts something that is no file at `path`.
fn put_odd(kind: &str, path: &Path) {
    if path.is_dir() && !path.is_symlink() {
        fs::remove_dir_all(path).unwrap()
    } else {
        fs::remove_file(path).unwrap()
    }
    match kind {
        "folder" => fs::create_dir(path).unwrap(),
        #[cfg(unix)]
        "link to nothing" => std::os::unix::fs::symlink("/nonexistent/x", path).unwrap(),
        #[cfg(unix)]
        "socket" => {
            // The address of a socket is short; its name in a folder is not.
            let short = folder();
            drop(std::os::unix::net::UnixListener::bind(short.path().join("s")).unwrap());
            fs::rename(short.path().join("s"), path).unwrap();
        }
        #[cfg(unix)]
        "pipe" => {
            let made = crate::child::start(std::process::Command::new("mkfifo").arg(path)).unwrap().wait().unwrap();
            assert!(made.success());
        }
        "file" => fs::write(path, "no folder").unwrap(),
        _ => unreachable!("{kind}"),
    }
}

/// Folders, dangling links, sockets and pipes in the place of every file and folder: a run and a repair work, nothing waits,
/// and then nothing is wrong any more.
#[test]
fn odd_files_are_set_aside() {
    let n = 2;
    let (outputs, digests) = filled(n);
    Store::open(outputs.path()).unwrap().checkpoint(&key(0), 1, b"state").unwrap();
    let store = outputs.path().join("store");
    let mut places = files(&store);
    fs::create_dir(store.join("quarantine")).unwrap();
    places
        .extend(["packs", "index", "blobs", "checkpoints", "locks", "tmp", "quarantine"].map(|name| store.join(name)));
    places.extend(files(&store.join("checkpoints")).iter().map(|path| path.parent().unwrap().to_owned()));
    let kinds: &[&str] =
        if cfg!(unix) { &["folder", "link to nothing", "socket", "pipe", "file"] } else { &["folder"] };
    for (nth, place) in places.iter().enumerate() {
        for kind in kinds {
            if *kind == if place.is_dir() { "folder" } else { "file" } {
                continue;
            }
            let inside = place.strip_prefix(outputs.path()).unwrap();
            // Locks are many and alike.
            if inside.starts_with("store/locks") && !inside.ends_with("gc") && (nth % 8 > 0 || *kind != "folder") {
                continue;
            }
            for repair_first in [true, false] {
                let case = format!("{kind} for {}, repair first: {repair_first}", inside.display());
                let damaged = folder();
                copy(outputs.path(), damaged.path());
                put_odd(kind, &damaged.path().join(inside));
                if repair_first {
                    let report = Store::open(damaged.path()).unwrap().verify(true);
                    let report = report.unwrap_or_else(|error| panic!("{case}: {error}"));
                    assert!(report.is_clean() || report.repaired, "{case}");
                    let second = Store::open_read_only(damaged.path()).unwrap().verify(false).unwrap();
                    assert!(second.is_clean(), "{case}: {:?}", second.findings);
                }
                run(&Store::open(damaged.path()).unwrap(), n);
                Store::open(damaged.path()).unwrap().checkpoint(&key(0), 1, b"state").unwrap();
                Store::open(damaged.path()).unwrap().verify(true).unwrap_or_else(|error| panic!("{case}: {error}"));
                assert_heals(damaged.path(), n, &digests, &case);
            }
        }
    }
}

/// A repair on a disk that is full after any number of bytes says that it failed, or has repaired.
#[test]
fn a_repair_that_fails_does_not_say_that_it_is_done() {
    let (outputs, _) = filled(4);
    let pack = files(&outputs.path().join("store/packs")).remove(0);
    let mut bytes = fs::read(&pack).unwrap();
    bytes[10] ^= 1;
    overwrite(&pack, &bytes);
    fs::remove_dir_all(outputs.path().join("store/index")).unwrap();
    let (mut failed, mut repaired) = (0, 0);
    for room in (0..8000).step_by(211) {
        let copied = folder();
        copy(outputs.path(), copied.path());
        let store = Store::open(copied.path()).unwrap();
        disk::quota::set(Some(room));
        let result = store.verify(true);
        disk::quota::set(None);
        drop(store);
        let clean = Store::open_read_only(copied.path()).unwrap().verify(false).unwrap().is_clean();
        match result {
            Ok(report) => {
                assert!(report.repaired && clean, "room for {room} bytes");
                repaired += 1;
            }
            Err(error) => {
                assert!(error.to_string().contains("full"), "room for {room} bytes: {error}");
                failed += 1;
            }
        }
    }
    assert!(failed > 3 && repaired > 3, "{failed} failed, {repaired} repaired");
}

/// What killed processes were writing is counted, and gone when the next run opens the store; what living ones write stays.
#[test]
fn temporary_files_of_the_dead_go_with_the_next_run() {
    let (outputs, _) = filled(2);
    let tmp = outputs.path().join("store/tmp");
    let path = |name: &str| tmp.join(format!("{}{name}", disk::WRITING));
    fs::write(path("dead"), [0; 1000]).unwrap();
    let living = fs::File::create(path("living")).unwrap();
    leftover::hold(&living);
    let stat = Store::open_read_only(outputs.path()).unwrap().stat().unwrap();
    assert_eq!((stat.temporary, stat.temporary_bytes), (2, 1000));
    let store = Store::open(outputs.path()).unwrap();
    assert_eq!(files(&tmp), [path("living")]);
    assert_eq!(store.stat().unwrap().bytes + 1000, stat.bytes);
    drop(living);
    drop(Store::open(outputs.path()).unwrap());
    assert!(files(&tmp).is_empty());
}

/// A temporary file that somebody removes while it is written is written again.
#[test]
fn a_temporary_file_may_vanish() {
    use std::sync::atomic::{AtomicBool, Ordering};
    let outputs = folder();
    let store = Store::open(outputs.path()).unwrap();
    let done = AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            // No more often than a file is written anew.
            let mut left = 15;
            while left > 0 && !done.load(Ordering::Relaxed) {
                for file in files(&outputs.path().join("store/tmp")) {
                    left -= i32::from(fs::remove_file(file).is_ok());
                }
                std::thread::yield_now();
            }
        });
        let written = (0..10).map(|i| publish(&store, 2 * i + 1, &large(2 * i + 1))).collect::<Result<Vec<_>, _>>();
        done.store(true, Ordering::Relaxed);
        for (i, blob) in written.unwrap().iter().enumerate() {
            assert_eq!(store.get(blob).unwrap(), large(2 * i as u64 + 1));
        }
    });
}
