//! The shortest way of a run that has nothing to do: what the last such run said, as long as nothing that it looked at was touched since.
//!
//! No pipeline is parsed and no record read for it. Held against what was noted are: the request (program, stages, arguments, working directory),
//! the digests of all texts and input files, and length, times and number ([`Stamp`]) of the packs of the store, of the blobs that are files of their
//! own and of everything below `outputs/latest/PIPELINE`. Anything else sends the caller the long way, which looks at all of it.
//!
//! A file: JSON, and BLAKE3 of it (32 bytes).

use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use serde::{Deserialize, Serialize};
use turbid_contract::file::MOST_BYTES;

use crate::digest::{Digest, PartHasher};
use crate::input_file;
use crate::memo;
use crate::registry::Registry;
use crate::spec::TextRead;
use crate::stamp::{Stamp, unix_ns};

const FORMAT: &str = "turbid unchanged 1";
/// Bytes of a note.
const LONGEST: u64 = 1 << 28;
/// So long before a run the last change of a file must lie: a clock that counts coarsely could hide a second change behind the first ...
const SETTLED_NS: i128 = 100_000_000;
/// ... and where it may count in seconds, so long.
const SETTLED_COARSE_NS: i128 = 3_000_000_000;
/// After that the long way is gone once: it notes in the store that its records are in use.
const VALID: Duration = Duration::from_secs(86_400);

/// What the user asked for.
pub struct Request<'a> {
    pub registry: &'a Registry,
    pub pipeline: &'a Path,
    pub outputs: &'a Path,
    pub overrides: &'a [String],
    pub targets: &'a [String],
}

impl Request<'_> {
    /// `None` where the working directory is gone.
    fn identity(&self) -> Option<Digest> {
        let mut parts = PartHasher::new(FORMAT);
        parts.add("program", memo::program().as_bytes());
        for row in self.registry.rows() {
            parts.add(row.name, &row.version.to_le_bytes());
        }
        let folder = env::current_dir().ok()?;
        for path in [&folder, self.pipeline, self.outputs] {
            parts.add("path", path.as_os_str().as_encoded_bytes());
        }
        self.overrides.iter().for_each(|given| parts.add("set", given.as_bytes()));
        self.targets.iter().for_each(|target| parts.add("target", target.as_bytes()));
        Some(parts.finish())
    }

    fn folder(&self) -> PathBuf {
        self.outputs.join("store").join("unchanged")
    }
}

/// What a run that found everything up to date says.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Closing {
    /// Name of the pipeline.
    pub pipeline: String,
    pub hits: usize,
    /// One row per stage.
    pub table: String,
    /// What follows for people, ...
    pub texts: Vec<String>,
    /// ... and for programs.
    pub events: Vec<String>,
}

/// What a run that found everything up to date looked at.
pub struct Seen {
    pub texts: Vec<TextRead>,
    pub files: Vec<(PathBuf, Digest)>,
    /// Of these only stamps are compared.
    pub watched: Vec<PathBuf>,
}

#[derive(Serialize, Deserialize)]
struct Note {
    identity: Digest,
    /// Nanoseconds since 1970 at which the run began.
    began_ns: i128,
    texts: Vec<TextRead>,
    files: Vec<(PathBuf, Digest)>,
    watched: Vec<PathBuf>,
    /// Of all that is watched.
    stamps: Digest,
    closing: Closing,
}

/// What the last run of this request said, if it had nothing to do and this one has not either.
pub fn recall(request: &Request<'_>) -> Option<Closing> {
    // Elsewhere the system does not tell of every change.
    if !cfg!(unix) {
        return None;
    }
    let identity = request.identity()?;
    let bytes = input_file::read(&request.folder().join(identity.to_string()), LONGEST).ok()?;
    let (body, check) = bytes.split_at_checked(bytes.len().checked_sub(32)?)?;
    if Digest::of(body).0 != check {
        return None;
    }
    let note: Note = serde_json::from_slice(body).ok()?;
    let age = unix_ns(SystemTime::now()) - note.began_ns;
    let valid = note.identity == identity && (0..VALID.as_nanos() as i128).contains(&age);
    let same =
        |(path, digest): &(PathBuf, Digest)| input_file::digest(path, MOST_BYTES).is_ok_and(|(now, _)| now == *digest);
    let untouched = valid
        && note.texts.iter().all(TextRead::is_same)
        && note.files.iter().all(same)
        && stamps(&note.watched, i128::MAX).is_some_and(|now| now == note.stamps);
    untouched.then_some(note.closing)
}

/// Notes what a run that began at `began` and found everything up to date saw and said. Best effort: without it the next run is only slower.
///
/// Nothing is noted where something was touched while it ran or shortly before: what it saw of that may be of another moment.
pub fn keep(request: &Request<'_>, began: SystemTime, seen: Seen, closing: Closing) {
    let began_ns = unix_ns(began);
    let Some((identity, stamps)) = request.identity().zip(stamps(&seen.watched, began_ns)) else { return };
    let Seen { texts, files, watched } = seen;
    let note = Note { identity, began_ns, texts, files, watched, stamps, closing };
    // A path that is no text goes the long way.
    if let Ok(mut body) = serde_json::to_vec(&note) {
        body.extend(Digest::of(&body).0);
        if body.len() as u64 <= LONGEST {
            let _ = memo::write(&request.folder(), &identity.to_string(), &body);
        }
    }
}

/// Digest of the stamps of these; `None` where one had not settled at a time, or cannot be looked at.
fn stamps(watched: &[PathBuf], at_ns: i128) -> Option<Digest> {
    let mut bytes = Vec::with_capacity(48 * watched.len());
    for path in watched {
        let Stamp { length, modified_ns, changed_ns, inode } = Stamp::of(&fs::symlink_metadata(path).ok()?);
        if !settled(modified_ns.max(changed_ns), at_ns) {
            return None;
        }
        bytes.extend(length.to_le_bytes());
        bytes.extend(modified_ns.to_le_bytes());
        bytes.extend(changed_ns.to_le_bytes());
        bytes.extend(inode.to_le_bytes());
    }
    Some(Digest::of(&bytes))
}

/// Whether a change at one time shows in the stamp apart from any after another time.
fn settled(changed_ns: i128, at_ns: i128) -> bool {
    let coarse = changed_ns.rem_euclid(1_000_000_000) == 0;
    changed_ns.saturating_add(if coarse { SETTLED_COARSE_NS } else { SETTLED_NS }) < at_ns
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file of the moment is not trusted; one whose time has no fraction of a second only after seconds.
    #[test]
    fn only_what_has_settled_is_trusted() {
        let second = 1_000_000_000;
        let now = 1_700_000_000 * second;
        assert!(!settled(now, now) && !settled(now + 7, now) && !settled(now - SETTLED_NS + 1, now));
        assert!(settled(now - SETTLED_NS - 1, now));
        assert!(!settled(now - second, now) && settled(now - 4 * second, now));
    }

    /// What is watched counts by its stamp, input files and texts by what they hold; what changed while the run went on is not noted.
    #[cfg(unix)]
    #[test]
    fn a_note_holds_while_nothing_changes() {
        let folder = tempfile::tempdir().unwrap();
        let [watched, file, text] = ["pack", "frames.png", "p.yaml"].map(|name| folder.path().join(name));
        [&watched, &file, &text].into_iter().for_each(|path| fs::write(path, "as it was").unwrap());
        let request = Request {
            registry: &Registry::builtin(),
            pipeline: &text,
            outputs: folder.path(),
            overrides: &[],
            targets: &[],
        };
        let closing = Closing { pipeline: "p".into(), hits: 1, table: "t".into(), texts: vec![], events: vec![] };
        let kept = |began| {
            let files = vec![(file.clone(), Digest::of(b"as it was"))];
            let texts = vec![TextRead::of(&text, "as it was", 1 << 10)];
            keep(&request, began, Seen { texts, files, watched: vec![watched.clone()] }, closing.clone());
            recall(&request)
        };
        assert_eq!(kept(SystemTime::now()), None, "the pack is as young as the run");
        std::thread::sleep(Duration::from_millis(130));
        assert_eq!(kept(SystemTime::now()), Some(closing.clone()));
        for path in [&file, &text] {
            fs::write(path, "another").unwrap();
            assert_eq!(recall(&request), None, "{}", path.display());
            fs::write(path, "as it was").unwrap();
            assert_eq!(recall(&request), Some(closing.clone()), "{}", path.display());
        }
        fs::write(&watched, "as it was").unwrap();
        assert_eq!(recall(&request), None, "the same bytes, and yet somebody wrote them");
        fs::remove_file(&watched).unwrap();
        assert_eq!(recall(&request), None);
        assert_eq!(recall(&Request { targets: &["t".to_owned()], ..request }), None);
    }
}
