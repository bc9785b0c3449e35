//! A store elsewhere: immutable objects named by their digests, beside the local store that every run works on.
//!
//! `docs/store.md` describes the objects. Packs hold records and small blobs, large blobs are objects of their own, and manifests say what is where. Who
//! reads compares everything with its digest; what is wrong or gone is told once and counts as missing.

mod address;
mod aside;
mod fetch;
mod folder;
mod known;
mod manifest;
pub(super) mod objects;
mod pull;
mod push;
#[cfg(feature = "s3")]
mod s3;
mod span;
mod through;

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError, RwLock, RwLockReadGuard};

use crate::digest::Digest;
use crate::store::lock::guard;
use crate::store::record::{Blob, InstanceRecord};
use folder::FolderObjects;
use known::{Cache, Known};
use manifest::{Listing, Manifest, Piece, Spot, outputs_check};
use objects::Objects;

pub use address::Address;
pub use objects::{RemoteError, Traffic};
pub use pull::Pulled;
pub use push::Pushed;
pub(super) use through::Through;

/// Where packs are.
const PACKS: &str = "packs";
/// Where the objects of large blobs are.
const BLOBS: &str = "blobs";

/// Whether a blob is in some store elsewhere, as far as the manifests say that are kept beside the local store at `root`.
pub(super) fn kept_elsewhere(root: &Path) -> impl Fn(&Blob) -> bool {
    let known = Cache::of_all(root);
    move |blob| known.lists(blob)
}

/// A store elsewhere; shared by all threads of a run.
pub struct Remote {
    address: Address,
    objects: Box<dyn Objects>,
    known: RwLock<Known>,
    /// Packs and objects of blobs that are not what their names say.
    damaged: Mutex<BTreeSet<Digest>>,
    /// Manifests that are known here and were cut short elsewhere.
    torn: Mutex<Vec<Digest>>,
    /// Whether something that was taken for there has turned out not to be.
    shrunk: AtomicBool,
    /// What is to be told of damage, in words.
    told: Mutex<Vec<String>>,
}

impl Remote {
    /// The store at an address. No request is made.
    ///
    /// Error: this program cannot reach it, or nobody says with which keys.
    pub fn at(address: Address) -> Result<Self, RemoteError> {
        let objects: Box<dyn Objects> = match &address {
            Address::Folder(path) => Box::new(FolderObjects::new(path)),
            #[cfg(feature = "s3")]
            Address::S3 { bucket, prefix } => Box::new(s3::S3::of_environment(bucket, prefix)?),
            #[cfg(not(feature = "s3"))]
            Address::S3 { .. } => {
                return Err(RemoteError::new(format!(
                    "{address} needs S3, and this turbid was built without it; build it with `cargo install --path . --locked --features s3`"
                )));
            }
        };
        Ok(Self::new(address, objects))
    }

    pub(super) fn new(address: Address, objects: Box<dyn Objects>) -> Self {
        let (known, damaged, torn, told) = <(RwLock<_>, Mutex<_>, Mutex<_>, Mutex<_>)>::default();
        Self { address, objects, known, damaged, torn, shrunk: AtomicBool::new(false), told }
    }

    pub fn address(&self) -> &Address {
        &self.address
    }

    pub fn traffic(&self) -> Traffic {
        self.objects.traffic()
    }

    /// What was found damaged since this was last asked.
    pub fn take_warnings(&self) -> Vec<String> {
        std::mem::take(&mut *guard(&self.told))
    }

    /// Whether something that was called there may be gone by now. Asking forgets it.
    pub(super) fn take_shrunk(&self) -> bool {
        self.shrunk.swap(false, Ordering::Relaxed)
    }

    /// Learns what the store holds by now; `root` is that of the local store, which keeps the manifests.
    fn look(&self, root: &Path) -> Result<(), RemoteError> {
        let found = known::look(&*self.objects, &self.cache(root))?;
        guard(&self.told).extend(found.damaged.into_iter().map(|text| format!("{}: {text}", self.address)));
        *guard(&self.torn) = found.torn;
        *self.known.write().unwrap_or_else(PoisonError::into_inner) = found.known;
        Ok(())
    }

    fn cache<'a>(&self, root: &'a Path) -> Cache<'a> {
        let name = Digest::of(self.address.to_string().as_bytes()).short();
        Cache { root, folder: root.join("remote").join(name) }
    }

    fn known(&self) -> RwLockReadGuard<'_, Known> {
        self.known.read().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes in a manifest that was just written.
    fn add(&self, manifest: Manifest) {
        self.known.write().unwrap_or_else(PoisonError::into_inner).add(manifest);
    }

    fn is_sound(&self, object: &Digest) -> bool {
        !guard(&self.damaged).contains(object)
    }

    /// Notes that an object is not what its name says; told once.
    fn note_damage(&self, folder: &str, object: &Digest, what: &str) {
        if guard(&self.damaged).insert(*object) {
            self.shrunk.store(true, Ordering::Relaxed);
            let text = format!("{}: {folder}/{object} {what}; it counts as missing", self.address);
            guard(&self.told).push(text);
        }
    }

    /// The records of a key, the best first.
    fn listings(&self, key: &Digest) -> Vec<Listing> {
        let mut found = self.known().records(key);
        found.retain(|listing| self.is_sound(&listing.spot.pack));
        found
    }

    /// Where a small blob is.
    fn spot(&self, digest: &Digest) -> Option<Spot> {
        self.known().blobs(digest).find(|spot| self.is_sound(&spot.pack))
    }

    /// The objects of a large blob.
    fn pieces(&self, digest: &Digest) -> Option<Vec<Piece>> {
        self.known().loose(digest).find(|pieces| pieces.iter().all(|piece| self.is_sound(&piece.digest)))
    }

    /// Whether the blob is there, as far as one can tell.
    fn holds(&self, blob: &Blob) -> bool {
        let whole = |pieces: Vec<Piece>| pieces.iter().map(|piece| piece.bytes).sum::<u64>() == blob.bytes;
        self.spot(&blob.digest).is_some() || self.pieces(&blob.digest).is_some_and(whole)
    }

    /// Whether a manifest lists this very record: the same key, ports and digests.
    fn lists(&self, record: &InstanceRecord) -> bool {
        let check = outputs_check(record);
        self.known().records(&record.key).iter().any(|listing| listing.check == check)
    }
}
