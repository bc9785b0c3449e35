//! Full disks, crashes, damage of every file: never a wrong hit, and one run heals it all.

use super::*;

/// A disk that runs full after any number of bytes: a clear error, nothing published before is lost, and the same
/// store goes on once there is room.
#[test]
fn a_full_disk_is_an_error_and_no_loss() {
    let outputs = folder();
    let store = Store::open(outputs.path()).unwrap();
    publish(&store, 0, &small(0)).unwrap();
    for artifact in [small(1), large(1)] {
        let step = if artifact == small(1) { 37 } else { 7001 };
        for room in (0..).step_by(step) {
            disk::quota::set(Some(room));
            let result = publish(&store, 1, &artifact);
            disk::quota::set(None);
            assert!(store.record(&key(0)).is_some(), "room for {room} bytes");
            match result {
                Ok(_) => break,
                Err(error) => assert!(error.is_full() && error.to_string().contains("full"), "{error}"),
            }
            assert!(store.record(&key(1)).is_none(), "room for {room} bytes");
        }
        assert!(store.record(&key(1)).is_some());
        store.folder.packs.append(frame::Kind::ForgetRecord, &key(1), &[]).unwrap();
    }
    publish(&store, 2, &small(2)).unwrap();
    drop(store);
    let again = Store::open(outputs.path()).unwrap();
    assert!(again.record(&key(0)).is_some() && again.record(&key(1)).is_none() && again.record(&key(2)).is_some());
    assert!(again.verify(false).unwrap().is_clean());
}

/// A pack cut anywhere, with and without its index: misses, and the next run heals them.
#[test]
fn a_pack_cut_anywhere_is_healed() {
    let outputs = folder();
    let store = Store::open(outputs.path()).unwrap();
    let blobs = [0, 2].map(|i| publish(&store, i, &small(i)).unwrap());
    store.finish().unwrap();
    let digests = store.digests();
    drop(store);
    let pack = files(&outputs.path().join("store/packs")).remove(0);
    let whole = fs::read(&pack).unwrap();
    let index = outputs.path().join("store/index");
    let saved = files(&index).remove(0);
    let saved_bytes = fs::read(&saved).unwrap();
    let mut hits_before = 0;
    for cut in 0..=whole.len() {
        for with_index in [true, false] {
            fs::write(&pack, &whole[..cut]).unwrap();
            fs::remove_dir_all(&index).unwrap();
            fs::create_dir(&index).unwrap();
            if with_index {
                fs::write(&saved, &saved_bytes).unwrap();
            }
            let store = Store::open_read_only(outputs.path()).unwrap();
            let hits = [0, 2].iter().filter(|&&i| store.record(&key(i)).is_some()).count();
            assert!(hits >= hits_before, "a longer pack holds no less");
            hits_before = hits;
            for (i, blob) in [0, 2].into_iter().zip(&blobs) {
                if store.record(&key(i)).is_some() {
                    assert_eq!(store.get(blob).unwrap(), small(i), "cut at {cut}");
                }
            }
            // Healing every cut takes long in the dev profile, and each is as good as another.
            if cut % 13 == 0 {
                let store = Store::open(outputs.path()).unwrap();
                [0, 2]
                    .iter()
                    .filter(|&&i| store.record(&key(i)).is_none())
                    .for_each(|&i| assert!(publish(&store, i, &small(i)).is_ok()));
                drop(store);
                let store = Store::open(outputs.path()).unwrap();
                assert_eq!(store.digests(), digests, "cut at {cut}");
                let report = store.verify(false).unwrap();
                assert!(report.is_clean(), "cut at {cut}: {:?}", report.findings);
            }
        }
    }
    assert_eq!(hits_before, 2);
}

/// Bits flipped in any file: never a wrong hit, never an error, and one run heals what it meets.
#[test]
fn flipped_bits_are_healed() {
    let n = 4;
    let (outputs, digests) = filled(n);
    Store::open(outputs.path()).unwrap().checkpoint(&key(0), 1, b"state").unwrap();
    let all = files(&outputs.path().join("store"));
    assert!(all.len() > 6, "{all:?}");
    let mut random = blake3::Hasher::new().finalize_xof();
    let mut next = || {
        let mut bytes = [0; 8];
        random.fill(&mut bytes);
        u64::from_le_bytes(bytes)
    };
    for path in all {
        let name = path.strip_prefix(outputs.path()).unwrap();
        let length = fs::metadata(&path).unwrap().len();
        for _ in 0..if length == 0 { 0 } else { 8 } {
            let bit = next() % (8 * length);
            let damaged = folder();
            copy(outputs.path(), damaged.path());
            let mut bytes = fs::read(&path).unwrap();
            bytes[bit as usize / 8] ^= 1 << (bit % 8);
            overwrite(&damaged.path().join(name), &bytes);
            let case = format!("{} bit {bit}", name.display());
            if next().is_multiple_of(2) {
                // What `verify` has found is a miss for the next run.
                let report = Store::open(damaged.path()).unwrap().verify(false).unwrap();
                assert!(!report.is_clean() || name.ends_with("format"), "{case} is noticed");
            } else {
                // A hit reads the head of its record only: what is wrong behind it is noticed by `verify`.
                run(&Store::open(damaged.path()).unwrap(), n);
                Store::open(damaged.path()).unwrap().verify(false).unwrap();
            }
            Store::open_read_only(damaged.path()).unwrap().resume(&key(0), 1).inspect(|(_, s)| assert_eq!(s, b"state"));
            if case.contains("checkpoints") {
                Store::open(damaged.path()).unwrap().checkpoint(&key(0), 1, b"state").unwrap();
            }
            assert_heals(damaged.path(), n, &digests, &case);
        }
    }
}

/// Cuts, zeroed and foreign ranges, flips, doubled and exchanged pieces, one to three in any files at once: look-ups give the
/// right bytes or none, a repair tells the truth, and a run heals it all.
///
/// `TURBID_MUTATIONS` asks for more of them than a short test has time for.
#[test]
fn mutated_stores_are_healed() {
    let n = 4;
    let rounds: u64 = std::env::var("TURBID_MUTATIONS").ok().and_then(|text| text.parse().ok()).unwrap_or(40);
    let (outputs, digests) = filled(n);
    Store::open(outputs.path()).unwrap().checkpoint(&key(0), 1, b"state").unwrap();
    let all: Vec<_> =
        files(&outputs.path().join("store")).into_iter().filter(|path| fs::metadata(path).unwrap().len() > 0).collect();
    for round in 0..rounds {
        let mut random = blake3::Hasher::new().update(&round.to_le_bytes()).finalize_xof();
        let mut below = |n: usize| {
            let mut bytes = [0; 8];
            random.fill(&mut bytes);
            (u64::from_le_bytes(bytes) % n as u64) as usize
        };
        let damaged = folder();
        copy(outputs.path(), damaged.path());
        let mut case = format!("round {round}:");
        for _ in 0..1 + below(3) {
            let name = all[below(all.len())].strip_prefix(outputs.path()).unwrap();
            let mut bytes = fs::read(damaged.path().join(name)).unwrap();
            let (at, what) = (below(bytes.len().max(1)), below(7));
            let end = (at + 1 + below(300)).min(bytes.len());
            match what {
                0 => bytes.truncate(at),
                1 => bytes[at..end].fill(0),
                2 => bytes[at..end].fill(below(256) as u8),
                3 => drop(bytes.drain(at..end)),
                4 => {
                    let piece = bytes[at..end].to_vec();
                    drop(bytes.splice(at..at, piece));
                }
                5 => bytes = fs::read(&all[below(all.len())]).unwrap(),
                _ if bytes.is_empty() => {}
                _ => bytes[at] ^= 1 << below(8),
            }
            case.push_str(&format!(" {} {what} at {at}", name.display()));
            overwrite(&damaged.path().join(name), &bytes);
        }
        let store = match Store::open(damaged.path()) {
            Ok(store) => store,
            Err(error) => {
                assert!(matches!(error, StoreError::NewerFormat { .. }) && case.contains("format"), "{case}: {error}");
                continue;
            }
        };
        for i in 0..n {
            let found = store.record(&key(i)).map(|record| store.get(&record.ports["out"].blob));
            match found {
                Some(Ok(there)) => assert_eq!(there, artifact(i), "{case}: a wrong hit"),
                Some(Err(error)) => assert!(error.is_lost_blob(), "{case}: {error}"),
                None => {}
            }
        }
        store.resume(&key(0), 1).inspect(|(_, state)| assert_eq!(state, b"state", "{case}"));
        drop(store);
        let report =
            Store::open(damaged.path()).unwrap().verify(true).unwrap_or_else(|error| panic!("{case}: {error}"));
        assert!(report.is_clean() || report.repaired, "{case}");
        let second = Store::open_read_only(damaged.path()).unwrap().verify(false).unwrap();
        assert!(second.is_clean(), "{case}: {:?}", second.findings);
        assert_heals(damaged.path(), n, &digests, &case);
    }
}

#[test]
fn deleted_and_emptied_files_are_healed() {
    let n = 4;
    let (outputs, digests) = filled(n);
    for path in files(&outputs.path().join("store")) {
        for emptied in [false, true] {
            let damaged = folder();
            copy(outputs.path(), damaged.path());
            let name = path.strip_prefix(outputs.path()).unwrap();
            let victim = damaged.path().join(name);
            if emptied {
                overwrite(&victim, b"")
            } else {
                fs::remove_file(&victim).unwrap()
            }
            assert_heals(damaged.path(), n, &digests, &format!("{} gone (emptied: {emptied})", name.display()));
        }
    }
}

#[test]
fn repair_leaves_a_clean_store() {
    let (outputs, _) = filled(4);
    let store = outputs.path().join("store");
    for path in files(&store.join("blobs")).iter().take(1).chain(&files(&store.join("packs"))) {
        let mut bytes = fs::read(path).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 4;
        overwrite(path, &bytes);
    }
    let report = Store::open(outputs.path()).unwrap().verify(true).unwrap();
    assert!(report.repaired && report.findings.len() >= 2, "{report:?}");
    let store = Store::open(outputs.path()).unwrap();
    let report = store.verify(false).unwrap();
    assert!(report.is_clean(), "{:?}", report.findings);
    assert!(store.stat().unwrap().quarantined >= 1);
}

/// `kill -9` at any moment: this test starts itself as a child that only writes, and kills it.
#[test]
fn kills_lose_nothing_that_was_published() {
    const FOLDER: &str = "TURBID_TEST_WRITER";
    const N: u64 = 200;
    if let Some(outputs) = std::env::var_os(FOLDER) {
        run(&Store::open(Path::new(&outputs)).unwrap(), N);
        return;
    }
    let outputs = folder();
    let mut seen = 0;
    for round in 0..12 {
        let mut child = crate::child::start(
            std::process::Command::new(std::env::current_exe().unwrap())
                .args(["--exact", "store::tests::damage::kills_lose_nothing_that_was_published"])
                .env(FOLDER, outputs.path())
                .stdout(std::process::Stdio::null()),
        )
        .unwrap();
        std::thread::sleep(Duration::from_millis(15 + 7 * round));
        child.kill().unwrap();
        child.wait().unwrap();
        let store = Store::open(outputs.path()).unwrap();
        let there = (0..N).filter(|&i| store.record(&key(i)).is_some()).count();
        assert!(there >= seen, "what one run has published, the next one finds");
        seen = there;
        let report = store.verify(false).unwrap();
        assert!(report.is_clean(), "{:?}", report.findings);
    }
    assert!(seen > 0, "the child had time to publish something");
    let store = Store::open(outputs.path()).unwrap();
    run(&store, N);
    assert_eq!(run(&store, N), N);
}
