//! Input files: which ones the params name, how large each may be, and what they hold.

use std::collections::BTreeMap;
use std::num::NonZeroU32;
use std::sync::Arc;

use schemars::JsonSchema;
use serde::Deserialize;

/// Bytes that an input file may have where the params do not say.
pub const MOST_BYTES: u64 = 1 << 30;

/// Size that an input file may have, in MB of 10^6 bytes; 1 GiB where left out.
///
/// A param of every stage that names files, as `#[serde(default, skip_serializing)] pub max_file_mb: MaxFile`: it says what may be
/// read, not what is made of it, so it is not in the key.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(transparent)]
pub struct MaxFile(pub Option<NonZeroU32>);

impl MaxFile {
    pub fn bytes(self) -> u64 {
        self.0.map_or(MOST_BYTES, |mb| u64::from(mb.get()) * 1_000_000)
    }
}

/// An input file that the params name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FileUse {
    /// Field path below `with`: `objects.polyp.mesh.file`.
    pub at: String,
    /// As written; relative to the YAML file that names it.
    pub path: String,
    /// Bytes that it may have.
    pub most: u64,
}

impl FileUse {
    pub fn new(at: impl Into<String>, path: impl Into<String>, max: MaxFile) -> Self {
        Self { at: at.into(), path: path.into(), most: max.bytes() }
    }
}

/// Reads a file when a stage asks for it; `None` where it cannot be read any more.
pub type ReadFile = Arc<dyn Fn() -> Option<Arc<[u8]>> + Send + Sync>;

/// Content of the input files, by the field that names them. What is read when it is asked for is not kept: a stage holds as
/// many files at a time as it keeps for itself.
#[derive(Clone, Default)]
pub struct Files(BTreeMap<String, Content>);

#[derive(Clone)]
enum Content {
    Here(Arc<[u8]>),
    Asked(ReadFile),
}

impl Files {
    /// Content of the file that the field `at` names.
    pub fn get(&self, at: &str) -> Option<Arc<[u8]>> {
        match self.0.get(at)? {
            Content::Here(bytes) => Some(bytes.clone()),
            Content::Asked(read) => read(),
        }
    }

    pub fn insert(&mut self, at: String, bytes: Arc<[u8]>) {
        self.0.insert(at, Content::Here(bytes));
    }

    /// The file is read each time that it is asked for.
    pub fn insert_read(&mut self, at: String, read: ReadFile) {
        self.0.insert(at, Content::Asked(read));
    }
}

impl Extend<(String, Arc<[u8]>)> for Files {
    fn extend<I: IntoIterator<Item = (String, Arc<[u8]>)>>(&mut self, files: I) {
        files.into_iter().for_each(|(at, bytes)| self.insert(at, bytes));
    }
}

impl FromIterator<(String, Arc<[u8]>)> for Files {
    fn from_iter<I: IntoIterator<Item = (String, Arc<[u8]>)>>(files: I) -> Self {
        let mut all = Self::default();
        all.extend(files);
        all
    }
}

impl<const N: usize> From<[(String, Arc<[u8]>); N]> for Files {
    fn from(files: [(String, Arc<[u8]>); N]) -> Self {
        files.into_iter().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_read_when_asked_for() {
        let mut files = Files::from([("a".to_owned(), Arc::from(*b"here"))]);
        let reads = Arc::new(std::sync::atomic::AtomicU32::new(0));
        let counted = reads.clone();
        let read: ReadFile = Arc::new(move || {
            counted.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
            Some(Arc::from(*b"later"))
        });
        files.insert_read("b".to_owned(), read);
        assert_eq!(reads.load(std::sync::atomic::Ordering::Relaxed), 0);
        assert_eq!((files.get("a").as_deref(), files.get("b").as_deref()), (Some(&b"here"[..]), Some(&b"later"[..])));
        assert_eq!((files.get("c"), reads.load(std::sync::atomic::Ordering::Relaxed)), (None, 1));
    }

    #[test]
    fn a_limit_of_0_is_refused_and_none_is_1_gib() {
        let read = |text: &str| serde_json::from_str::<MaxFile>(text).map(MaxFile::bytes);
        assert_eq!((read("null").unwrap(), read("3000").unwrap()), (1 << 30, 3_000_000_000));
        assert!(read("0").is_err() && read("-1").is_err() && read("1.5").is_err());
    }
}
