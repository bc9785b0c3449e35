//! Earlier results that an instance is compared with: looked up, so that a large store costs no more than a small one.

use crate::digest::Digest;
use crate::store::Store;
use crate::store::labels::{self, Label};
use crate::store::place::Named;
use crate::store::record::{InstanceRecord, Recipe};

impl Store {
    /// The latest result under this label; `None` also where it is damaged, or was replaced under another label.
    pub fn latest_of(&self, label: &Label<'_>) -> Option<(InstanceRecord, Recipe)> {
        let digest = label.digest();
        self.latest(Named::Label, &digest).filter(|(record, _)| Label::of(record).digest() == digest)
    }

    /// The latest result of the same work, done for longer or shorter.
    pub fn latest_of_work(&self, state_key: &Digest) -> Option<(InstanceRecord, Recipe)> {
        self.latest(Named::Work, state_key).filter(|(record, _)| record.state_key == Some(*state_key))
    }

    /// Whether there may be any result.
    pub fn has_records(&self) -> bool {
        self.folder.packs.has_entries()
    }

    /// Whether there may be a result of this kind of stage.
    pub fn knows(&self, use_name: &str) -> bool {
        self.folder.packs.latest(Named::Kind, &labels::kind(use_name)).is_some()
    }

    fn latest(&self, named: Named, digest: &Digest) -> Option<(InstanceRecord, Recipe)> {
        self.record_and_recipe(&self.folder.packs.latest(named, digest)?)
    }

    /// So many of the undamaged records at most with what went in, the newest first, whether or not their blobs are still there.
    /// Looks through the whole index.
    pub fn latest_records(&self, most: usize) -> impl Iterator<Item = (InstanceRecord, Recipe)> {
        self.folder.packs.newest(most).into_iter().filter_map(|key| self.record_and_recipe(&key))
    }
}
