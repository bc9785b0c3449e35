//! The texts that a specification is made of: pipeline files, and `--set` overrides as one-line texts.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use serde::{Deserialize, Serialize};

use crate::digest::Digest;
use crate::input_file::{self, Refused};

/// Larger files are not pipelines; refusing them keeps a wrong argument from costing minutes.
pub const MAX_PIPELINE: u64 = 8 << 20;

/// A place in one of the source files.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Span {
    /// Index into [`super::Spec::sources`].
    pub file: u32,
    /// From 1; 0 means the file as a whole.
    pub line: u32,
    /// From 1, in characters.
    pub column: u32,
    /// Length in characters; what is longer than its line is cut at the end of it.
    pub len: u32,
}

/// A text that values come from.
#[derive(Clone, Debug)]
pub struct SourceFile {
    /// As the user named it, or as an `include:` made it; `--set` for an override.
    pub name: String,
    /// What relative paths in it are relative to.
    pub base: PathBuf,
    /// UTF-8, without byte order mark.
    pub text: String,
    /// Byte at which each line starts; made when the first mistake is shown.
    starts: OnceLock<Vec<usize>>,
}

impl SourceFile {
    /// Reads a text file of at most `max` bytes; the error says in plain words why it cannot be `what`.
    pub fn read(path: &Path, what: &str, max: u64) -> Result<Self, String> {
        let bytes = input_file::read(path, max).map_err(|refused| match refused {
            Refused::Io(e) if e.kind() == ErrorKind::NotFound => "the file does not exist".to_owned(),
            Refused::Io(e) if e.kind() == ErrorKind::PermissionDenied => {
                "the file may not be read (permission denied)".to_owned()
            }
            Refused::Io(e) => format!("the file cannot be read: {e}"),
            Refused::Odd(kind) => format!("this is {kind}, not {what}"),
            Refused::Larger { .. } => format!("the file is larger than {} MiB, too large for {what}", max >> 20),
            other => other.to_string(),
        })?;
        Self::of_bytes(path, &bytes)
    }

    /// The text that stands, or would stand, in the file `path`.
    pub fn of_bytes(path: &Path, bytes: &[u8]) -> Result<Self, String> {
        let text = decode(bytes)?;
        let base = path.parent().map(Path::to_path_buf).unwrap_or_default();
        Ok(Self::new(path.display().to_string(), base, text))
    }

    pub fn new(name: impl Into<String>, base: impl Into<PathBuf>, text: impl Into<String>) -> Self {
        Self { name: name.into(), base: base.into(), text: text.into(), starts: OnceLock::new() }
    }

    /// The text of line `line` (from 1), without its line break.
    pub fn line(&self, line: u32) -> Option<&str> {
        let starts = self
            .starts
            .get_or_init(|| std::iter::once(0).chain(self.text.match_indices('\n').map(|(at, _)| at + 1)).collect());
        let start = *starts.get((line as usize).checked_sub(1)?)?;
        self.text[start..].lines().next()
    }
}

/// A text file that was read, and what it said.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct TextRead {
    path: PathBuf,
    text: Digest,
    most: u64,
}

impl TextRead {
    /// A file of at most `most` bytes in which `text` stood.
    pub fn of(path: &Path, text: &str, most: u64) -> Self {
        Self { path: path.to_owned(), text: Digest::of(text.as_bytes()), most }
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Whether the file says the same now.
    pub fn is_same(&self) -> bool {
        SourceFile::read(&self.path, "a text", self.most).is_ok_and(|now| Digest::of(now.text.as_bytes()) == self.text)
    }
}

fn decode(bytes: &[u8]) -> Result<String, String> {
    let utf16 = bytes.starts_with(&[0xff, 0xfe]) || bytes.starts_with(&[0xfe, 0xff]);
    let text = std::str::from_utf8(bytes).map_err(|e| {
        if utf16 {
            return "the file is UTF-16; save it as UTF-8".to_owned();
        }
        let at = e.valid_up_to();
        let line = bytes[..at].iter().filter(|b| **b == b'\n').count() + 1;
        format!("the file is not UTF-8 text (byte {at}, line {line}); save it as UTF-8")
    })?;
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    if text.contains('\0') {
        return Err("the file holds NUL bytes, so it is not a text file".to_owned());
    }
    Ok(text.to_owned())
}
