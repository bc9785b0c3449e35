//! Stores elsewhere: what is pushed is what is pulled, whatever happens on the way; what is damaged there is a miss, and pushed again.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Mutex;
use std::sync::atomic::{AtomicI64, AtomicU64, Ordering};

use super::*;
use crate::store::remote::objects::{Listed, Objects};

/// A service in memory, shared by all that hold it.
#[derive(Clone, Default)]
struct Service(Arc<Inner>);

#[derive(Default)]
struct Inner {
    objects: Mutex<BTreeMap<String, (Vec<u8>, u64)>>,
    writes: AtomicU64,
    requests: AtomicU64,
    /// After so many more requests all fail, as of a process that is killed; negative: none does.
    left: AtomicI64,
}

impl Service {
    fn new() -> Self {
        let service = Self::default();
        service.fail_after(-1);
        service
    }

    /// Another service with the same objects.
    fn copy(&self) -> Self {
        let copy = Self::new();
        *guard(&copy.0.objects) = guard(&self.0.objects).clone();
        copy
    }

    fn fail_after(&self, requests: i64) {
        self.0.left.store(requests, Ordering::SeqCst);
    }

    fn request(&self) -> Result<(), RemoteError> {
        self.0.requests.fetch_add(1, Ordering::SeqCst);
        match self.0.left.load(Ordering::SeqCst) {
            0 => Err(RemoteError::new("the service is gone")),
            n if n > 0 => {
                self.0.left.fetch_sub(1, Ordering::SeqCst);
                Ok(())
            }
            _ => Ok(()),
        }
    }

    fn requests(&self) -> u64 {
        self.0.requests.load(Ordering::SeqCst)
    }

    fn names(&self, folder: &str) -> Vec<String> {
        guard(&self.0.objects).keys().filter(|name| name.starts_with(folder)).cloned().collect()
    }

    fn content(&self, name: &str) -> Vec<u8> {
        guard(&self.0.objects)[name].0.clone()
    }

    /// What no user of a service does: puts other bytes under a name, or none.
    fn replace(&self, name: &str, bytes: Option<Vec<u8>>) {
        let mut objects = guard(&self.0.objects);
        match bytes {
            Some(bytes) => objects.get_mut(name).expect("it is there").0 = bytes,
            None => drop(objects.remove(name)),
        }
    }

    /// A store in `folder` with this service behind it.
    fn behind(&self, folder: &TempDir) -> Store {
        self.try_behind(folder).unwrap()
    }

    fn try_behind(&self, folder: &TempDir) -> Result<Store, StoreError> {
        let address = "s3://bucket/prefix".parse().unwrap();
        Store::open(folder.path())?.with_remote(Remote::new(address, Box::new(self.clone())))
    }
}

impl Objects for Service {
    fn put(&self, name: &str, bytes: &[u8]) -> Result<(), RemoteError> {
        self.request()?;
        let time = self.0.writes.fetch_add(1, Ordering::SeqCst);
        guard(&self.0.objects).insert(name.to_owned(), (bytes.to_vec(), time));
        Ok(())
    }

    fn get(&self, name: &str, range: Range<u64>) -> Result<Option<Vec<u8>>, RemoteError> {
        self.request()?;
        let objects = guard(&self.0.objects);
        let Some((bytes, _)) = objects.get(name) else { return Ok(None) };
        let at = |n: u64| (n as usize).min(bytes.len());
        Ok(Some(bytes[at(range.start)..at(range.end)].to_vec()))
    }

    fn list(&self, folder: &str) -> Result<Vec<Listed>, RemoteError> {
        self.request()?;
        let objects = guard(&self.0.objects);
        let listed = objects.iter().filter_map(|(name, (bytes, time))| {
            let name = name.strip_prefix(folder)?.strip_prefix('/')?.to_owned();
            Some(Listed { name, bytes: bytes.len() as u64, modified: format!("{time:020}") })
        });
        Ok(listed.collect())
    }

    fn traffic(&self) -> Traffic {
        Traffic { requests: self.requests(), ..Traffic::default() }
    }
}

/// A store in which `n` instances have run, every second one large.
fn filled(n: u64) -> TempDir {
    let folder = folder();
    let store = Store::open(folder.path()).unwrap();
    run(&store, n);
    store.finish().unwrap();
    folder
}

fn digests(folder: &TempDir) -> Vec<Digest> {
    Store::open_read_only(folder.path()).unwrap().digests()
}

fn push(service: &Service, folder: &TempDir) -> Pushed {
    service.behind(folder).push(None, true, &|_, _| ()).unwrap()
}

fn pull(service: &Service, folder: &TempDir) -> Pulled {
    let store = service.behind(folder);
    let pulled = store.pull(None, &|_, _| ()).unwrap();
    store.finish().unwrap();
    pulled
}

/// All that is in the store is a hit and right, and `verify` finds nothing.
fn check(folder: &TempDir, n: u64) -> u64 {
    let store = Store::open(folder.path()).unwrap();
    assert!(store.verify(false).unwrap().is_clean());
    let hits = (0..n).filter(|i| {
        store.record(&key(*i)).is_some_and(|record| store.get(&record.ports["out"].blob).unwrap() == artifact(*i))
    });
    hits.count() as u64
}

#[test]
fn what_is_pushed_is_what_is_pulled() {
    let (service, here) = (Service::new(), filled(20));
    let pushed = push(&service, &here);
    assert_eq!((pushed.records, pushed.small_blobs, pushed.large_blobs, pushed.left_out), (20, 10, 10, 0));
    assert_eq!((pushed.packs, pushed.manifests), (1, 1));
    let [packs, blobs, manifests] = ["packs", "blobs", "manifests"].map(|folder| service.names(folder).len());
    assert_eq!((packs, blobs, manifests), (1, 10, 1));
    for name in ["packs", "blobs", "manifests"].iter().flat_map(|folder| service.names(folder)) {
        let digest = Digest::of(&service.content(&name));
        assert!(name.ends_with(&digest.to_string()), "objects are named by their bytes: {name}");
    }

    let there = folder();
    let pulled = pull(&service, &there);
    assert_eq!(pulled, Pulled { records: 20, small_blobs: 10, large_blobs: 10, left_out: 0 });
    assert_eq!(digests(&there), digests(&here));
    assert_eq!(check(&there, 20), 20);

    // Once more: two lists of objects and one of manifests, and nothing is sent, from either side.
    for side in [&here, &there] {
        let before = service.requests();
        assert_eq!(push(&service, side), Pushed::default());
        assert_eq!(service.requests() - before, 3);
        let before = service.requests();
        assert_eq!(pull(&service, side), Pulled::default());
        assert_eq!(service.requests() - before, 1);
    }
}

/// What a look-up finds elsewhere is a hit, and its bytes come when they are read.
#[test]
fn what_is_missing_here_is_brought_in() {
    let (service, here) = (Service::new(), filled(6));
    push(&service, &here);
    let there = folder();
    let store = service.behind(&there);
    let record = store.record(&key(1)).expect("it is elsewhere");
    let blob = record.ports["out"].blob;
    assert_eq!(store.file_of(&blob), None, "large blobs come when they are read");
    assert_eq!(store.get(&blob).unwrap(), artifact(1));
    assert!(store.file_of(&blob).is_some());
    assert_eq!(run(&store, 6), 6, "nothing is computed again");
    assert!(store.record(&key(100)).is_none());
    store.finish().unwrap();
    drop(store);
    assert_eq!(check(&there, 6), 6);
    assert_eq!(digests(&there), digests(&here));

    let more = folder();
    let store = service.behind(&more);
    let before = service.requests();
    store.bring_records(&(0..6).map(key).collect::<Vec<_>>()).unwrap();
    assert_eq!(service.requests() - before, 1, "neighbours come together");
    service.fail_after(0);
    assert!((0..6).all(|i| store.record(&key(i)).is_some()));
    assert_eq!(store.get(&store.record(&key(0)).unwrap().ports["out"].blob).unwrap(), artifact(0));
    assert!(matches!(store.get(&blob), Err(StoreError::Remote(_))), "that it cannot be read is told");
}

/// However many requests a push or a pull got through: the next one goes on, and nothing is wrong on the way.
#[test]
fn what_is_cut_off_anywhere_goes_on() {
    let here = filled(8);
    let whole = Service::new();
    push(&whole, &here);
    for requests in 0.. {
        let service = Service::new();
        service.fail_after(requests);
        let done = service.try_behind(&here).and_then(|store| store.push(None, true, &|_, _| ())).is_ok();
        service.fail_after(-1);
        let there = folder();
        pull(&service, &there);
        assert_eq!(check(&there, 8), if done { 8 } else { 0 }, "all of a round or nothing, after {requests}");
        push(&service, &here);
        pull(&service, &there);
        assert_eq!(digests(&there), digests(&here), "pushed again after {requests} requests");
        if done {
            break;
        }
    }
    let there = folder();
    for requests in 0.. {
        whole.fail_after(requests);
        let done = whole.try_behind(&there).and_then(|store| store.pull(None, &|_, _| ())).is_ok();
        check(&there, 8);
        if done {
            break;
        }
    }
    whole.fail_after(-1);
    pull(&whole, &there);
    assert_eq!((digests(&there), check(&there, 8)), (digests(&here), 8));
}

/// An object that is cut short, replaced by another or gone is named, and what it held is a miss; who has it pushes it again.
#[test]
fn damage_elsewhere_is_a_miss_and_mended() {
    let here = filled(6);
    let whole = Service::new();
    push(&whole, &here);
    let names = whole.names("");
    for name in &names {
        let bytes = whole.content(name);
        let other = names.iter().find(|other| *other != name && other[..3] == name[..3]).unwrap_or(&names[0]);
        let mut flipped = bytes.clone();
        flipped[bytes.len() / 2] ^= 1;
        for wrong in [
            Some(bytes[..bytes.len() / 2].to_vec()),
            Some(bytes[..bytes.len() - 1].to_vec()),
            Some(Vec::new()),
            Some(whole.content(other)),
            Some(flipped),
            None,
        ] {
            let service = whole.copy();
            service.replace(name, wrong.clone());
            let there = folder();
            let store = service.behind(&there);
            store.pull(None, &|_, _| ()).unwrap();
            let told = store.remote().unwrap().take_warnings().join("\n");
            // A manifest that is gone is as if it had never been written.
            if wrong.is_some() || !name.starts_with("manifests") {
                assert!(told.contains(name) && told.contains("s3://bucket/prefix"), "{name}: {told}");
            }
            store.finish().unwrap();
            drop(store);
            let hits = check(&there, 6);
            assert!(hits < 6, "{name}: {hits}");
            // The store that has it all mends it: at once where a look shows it, and otherwise after it was found on reading.
            let store = service.behind(&here);
            store.push(None, true, &|_, _| ()).unwrap();
            drop(store);
            let same_length = wrong.as_ref().is_some_and(|wrong| wrong.len() == bytes.len());
            if !same_length {
                pull(&service, &there);
                assert_eq!(check(&there, 6), 6, "{name} was pushed again");
                assert_eq!(digests(&there), digests(&here));
            }
        }
    }
}

/// A run with damage behind it computes what it cannot get, and pushes it again.
#[test]
fn a_run_mends_what_it_found_damaged() {
    let here = filled(6);
    let service = Service::new();
    push(&service, &here);
    let pack = service.names("packs").remove(0);
    let mut bytes = service.content(&pack);
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    service.replace(&pack, Some(bytes));
    let there = folder();
    let store = service.behind(&there);
    assert!(run(&store, 6) < 6);
    store.finish().unwrap();
    store.push(None, false, &|_, _| ()).unwrap();
    drop(store);
    let third = folder();
    pull(&service, &third);
    assert_eq!((check(&third, 6), digests(&third)), (6, digests(&here)));
}

/// Many pushes leave few manifests to read, and all that any of them listed.
#[test]
fn manifests_stay_few() {
    let (service, here) = (Service::new(), folder());
    for i in 0..40 {
        let store = service.behind(&here);
        publish(&store, i, &small(i)).unwrap();
        store.finish().unwrap();
        assert_eq!(store.push(Some(&[key(i)]), false, &|_, _| ()).unwrap().records, 1);
    }
    assert_eq!(service.names("manifests").len(), 40);
    let there = folder();
    let before = service.requests();
    let store = service.behind(&there);
    assert!(service.requests() - before < 20, "{} requests", service.requests() - before);
    assert_eq!(store.pull(None, &|_, _| ()).unwrap().records, 40);
    drop(store);
    assert_eq!(digests(&there), digests(&here));
    assert!(fs::read_dir(there.path().join("store/remote")).unwrap().flatten().all(|f| files(&f.path()).len() < 10));
}

/// A record that holds more ports takes the place of one that holds fewer, here and there.
#[test]
fn more_ports_are_pushed_and_pulled() {
    let (service, here, there) = (Service::new(), folder(), folder());
    let store = service.behind(&here);
    let first = publish(&store, 0, &small(0)).unwrap();
    store.push(None, false, &|_, _| ()).unwrap();
    pull(&service, &there);
    let more = store.put(&small(1)).unwrap();
    store.publish(&record(0, &[("out", first), ("more", more)]), &recipe(0)).unwrap();
    assert_eq!(store.push(None, false, &|_, _| ()).unwrap().records, 1);
    drop(store);
    assert_eq!(pull(&service, &there).records, 1);
    let ports = |folder: &TempDir| Store::open(folder.path()).unwrap().record(&key(0)).unwrap().ports.len();
    assert_eq!(ports(&there), 2);
    // Whoever has fewer pushes nothing.
    let third = folder();
    let store = Store::open(third.path()).unwrap();
    publish(&store, 0, &small(0)).unwrap();
    drop(store);
    assert_eq!(push(&service, &third), Pushed::default());
    pull(&service, &third);
    assert_eq!(ports(&third), 2);
}

/// Two stores that made the same push it once; what was released stays at home.
#[test]
fn what_is_there_or_released_is_not_pushed() {
    let (service, here, other) = (Service::new(), filled(4), filled(4));
    push(&service, &here);
    assert_eq!(push(&service, &other), Pushed::default());
    let (service, here) = (Service::new(), filled(4));
    let store = service.behind(&here);
    let blob = store.record(&key(2)).unwrap().ports["out"].blob;
    store.release(&[blob]).unwrap();
    let pushed = store.push(None, true, &|_, _| ()).unwrap();
    assert_eq!((pushed.records, pushed.left_out), (3, 1));
}

/// A blob of more than one piece, and one that is damaged here: it is not pushed, and neither is its record.
#[test]
fn pieces_and_damage_at_home() {
    let (service, here) = (Service::new(), folder());
    let store = service.behind(&here);
    let mut stack = ImageStack::new(3000, 3000);
    let data = Array2::from_shape_fn((3000, 3000), |(row, column)| (row * 3000 + column) as f32);
    stack.push(LayerInfo::value("radiance", "1"), data);
    let huge = Artifact::Images(stack);
    let blob = publish(&store, 1, &huge).unwrap();
    assert!(blob.bytes > 32 << 20);
    let bad = publish(&store, 3, &large(3)).unwrap();
    let path = store.file_of(&bad).unwrap();
    let mut bytes = fs::read(&path).unwrap();
    bytes[1000] ^= 1;
    overwrite(&path, &bytes);
    let pushed = store.push(None, true, &|_, _| ()).unwrap();
    assert_eq!((pushed.records, pushed.large_blobs, pushed.left_out), (1, 1, 1));
    assert_eq!(service.names("blobs").len(), 2);
    drop(store);
    let there = folder();
    assert_eq!(pull(&service, &there), Pulled { records: 1, large_blobs: 1, ..Pulled::default() });
    assert!(Store::open(there.path()).unwrap().get(&blob).unwrap() == huge);
    // The second piece gone: the blob is a miss.
    let second = service.names("blobs").into_iter().min_by_key(|name| service.content(name).len()).unwrap();
    service.replace(&second, None);
    let there = folder();
    assert_eq!(pull(&service, &there).left_out, 1);
    assert!(Store::open(there.path()).unwrap().record(&key(1)).is_none());
}
