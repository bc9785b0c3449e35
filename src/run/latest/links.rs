//! The list of the files of `outputs/latest`: what each stands for, and what it was when it was written.

use std::collections::BTreeMap;
use std::fs::{self, Metadata};
use std::path::{Component, Path};

use crate::digest::{Digest, PartHasher};
use crate::input_file;
use crate::stamp::Stamp;

/// The file, in the folder of its pipeline.
pub const LINKS: &str = ".links";
/// Its first line, and what its check begins with.
const FORMAT: &str = "turbid links 2";
/// Bytes; a list of so many files is not ours.
const LONGEST: u64 = 64 << 20;

/// One file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    /// What it stands for, a word: the digest of a blob, the look of a picture, the instances of a list.
    pub content: String,
    /// BLAKE3 of its bytes; of a link, of where it leads.
    pub bytes: Digest,
    pub stamp: Stamp,
}

impl Entry {
    /// Of a file that could not be made: no file is what this says, so the next run tries again.
    pub fn missing() -> Self {
        let stamp = Stamp { length: u64::MAX, modified_ns: 0, changed_ns: 0, inode: 0 };
        Self { content: "-".to_owned(), bytes: Digest::of(b""), stamp }
    }

    pub fn is_missing(&self) -> bool {
        self.stamp.length == u64::MAX
    }
}

/// By path below the folder.
pub type Links = BTreeMap<String, Entry>;

/// The list of a folder; empty where there is none, or a damaged one, or one of another pipeline.
pub fn read(folder: &Path, pipeline: &str) -> Links {
    read_small(&folder.join(LINKS), LONGEST).and_then(|text| parse(&text, pipeline)).unwrap_or_default()
}

/// A text file of at most so many bytes; nothing else is read, and no pipe is waited for.
pub fn read_small(path: &Path, longest: u64) -> Option<String> {
    String::from_utf8(input_file::read(path, longest).ok()?.to_vec()).ok()
}

pub fn text(links: &Links, pipeline: &str) -> String {
    let mut text = format!("{FORMAT}\n");
    for (path, Entry { content, bytes, stamp }) in links {
        let Stamp { length, modified_ns, changed_ns, inode } = stamp;
        text.push_str(&format!("{content} {bytes} {length} {modified_ns} {changed_ns} {inode} {path}\n"));
    }
    let check = check(&text, pipeline);
    text + &check
}

fn check(list: &str, pipeline: &str) -> String {
    let digest = PartHasher::new(FORMAT).part("pipeline", pipeline.as_bytes()).part("list", list.as_bytes()).finish();
    format!("{digest}\n")
}

fn parse(text: &str, pipeline: &str) -> Option<Links> {
    const CHECK: usize = 65;
    let (list, last) = text.split_at_checked(text.len().checked_sub(CHECK)?)?;
    if last != check(list, pipeline) {
        return None;
    }
    let mut lines = list.lines();
    (lines.next()? == FORMAT).then_some(())?;
    lines.map(entry).collect()
}

fn entry(line: &str) -> Option<(String, Entry)> {
    let mut parts = line.splitn(7, ' ');
    let mut next = || parts.next();
    let (content, bytes) = (next()?.to_owned(), next()?.parse().ok()?);
    let stamp = Stamp {
        length: next()?.parse().ok()?,
        modified_ns: next()?.parse().ok()?,
        changed_ns: next()?.parse().ok()?,
        inode: next()?.parse().ok()?,
    };
    let path = next()?;
    // Files of the list are removed when nothing stands for them any more: never one outside of the folder.
    let inside = !path.is_empty() && Path::new(path).components().all(|c| matches!(c, Component::Normal(_)));
    inside.then(|| (path.to_owned(), Entry { content, bytes, stamp }))
}

/// The entry with the stamp of now, if the file below `folder` is what the entry says: untouched, or of the same bytes.
///
/// A link must lead to a file of `length`.
pub fn current(entry: &Entry, at: &Path, length: Option<u64>) -> Option<Entry> {
    let meta = fs::symlink_metadata(at).ok()?;
    let stamp = Stamp::of(&meta);
    let same = stamp == entry.stamp
        || stamp.length == entry.stamp.length && digest_of(at, &meta).is_some_and(|bytes| bytes == entry.bytes);
    let leads = !meta.is_symlink() || fs::metadata(at).is_ok_and(|m| m.is_file() && Some(m.len()) == length);
    (same && leads).then(|| Entry { stamp, ..entry.clone() })
}

/// BLAKE3 of a file's bytes, or of where a link leads; `None` for anything else.
fn digest_of(at: &Path, meta: &Metadata) -> Option<Digest> {
    if meta.is_symlink() {
        return Some(Digest::of(fs::read_link(at).ok()?.as_os_str().as_encoded_bytes()));
    }
    meta.is_file().then(|| fs::read(at).ok().map(|bytes| Digest::of(&bytes)))?
}

#[cfg(test)]
mod tests {
    use super::*;

    fn links() -> Links {
        let stamp = Stamp { length: 5, modified_ns: -7, changed_ns: 1 << 62, inode: u64::MAX };
        let entry = |path: &str| Entry { content: path.replace(' ', "-"), bytes: Digest::of(path.as_bytes()), stamp };
        ["frames/frames.exr", "tissue/A=1,b=two words/scene.parquet"].map(|p| (p.to_owned(), entry(p))).into()
    }

    #[test]
    fn what_is_written_is_read_and_nothing_else() {
        let whole = text(&links(), "p");
        assert_eq!(parse(&whole, "p"), Some(links()));
        assert_eq!(parse(&whole, "q"), None, "the list of another pipeline");
        for n in 0..whole.len() {
            assert_eq!(parse(&whole[..n], "p"), None, "cut to {n}");
            let mut flipped = whole.clone().into_bytes();
            flipped[n] ^= 1;
            assert_eq!(parse(&String::from_utf8_lossy(&flipped), "p"), None, "flipped at {n}");
        }
    }

    /// A list of files elsewhere, with a check that holds, is no list: its files would be removed.
    #[test]
    fn files_outside_are_never_named() {
        for path in ["../a", "/etc/a", "a/../../b", "", "."] {
            let links: Links = links().into_values().take(1).map(|entry| (path.to_owned(), entry)).collect();
            assert_eq!(parse(&text(&links, "p"), "p"), None, "{path}");
        }
    }
}
