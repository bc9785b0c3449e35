//! Artifacts as files for other programs: NumPy, TIFF, CSV, MATLAB; those of many instances in one. The same artifact gives the same bytes.

pub mod archive;
mod csv;
mod error;
mod frames;
mod gather;
mod heads;
mod mat;
mod names;
mod npz;
mod stacked;
mod tiff;

use std::fs::File;
use std::io::{self, BufWriter, Seek, Write};
use std::path::Path;

use serde::Serialize;
use serde_json::Value;
use turbid_contract::{Artifact, ArtifactKind};

use crate::digest::Digest;
use crate::leftover;
use crate::whole_file::{self, Synced};

pub use error::ExportError;
pub use frames::export_frames;
pub use gather::Gathered;
pub use stacked::{Images, Stacks};

/// Bytes that are written at a time.
const BUFFER: usize = 1 << 20;

/// A file format, chosen by the ending of the file's name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// NumPy arrays in a zip archive.
    Npz,
    /// One 32-bit float page per layer.
    Tiff,
    /// Text in columns.
    Csv,
    /// MATLAB version 5.
    Mat,
}

impl Format {
    pub const ALL: [Self; 4] = [Self::Npz, Self::Tiff, Self::Csv, Self::Mat];

    pub fn extension(self) -> &'static str {
        match self {
            Self::Npz => "npz",
            Self::Tiff => "tiff",
            Self::Csv => "csv",
            Self::Mat => "mat",
        }
    }

    /// Whether artifacts of that kind can be written in this format.
    pub fn takes(self, kind: ArtifactKind) -> bool {
        self != Self::Tiff || kind == ArtifactKind::Images
    }

    /// The format that a file's name asks for (`.tif` is `.tiff`; upper case is fine).
    ///
    /// Errors: an ending that is not known, or one that cannot hold the artifact.
    pub fn of(to: &Path, kind: ArtifactKind) -> Result<Self, ExportError> {
        let ending = to.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
        let known = |format: &Self| ending == format.extension() || (*format == Self::Tiff && ending == "tif");
        let format =
            Self::ALL.into_iter().find(known).ok_or(ExportError::UnknownFormat { to: to.to_owned(), ending })?;
        if format.takes(kind) { Ok(format) } else { Err(ExportError::WrongKind { to: to.to_owned(), format, kind }) }
    }
}

/// Writes an artifact to a file in the format of its ending. An existing file is replaced, at once and as a whole;
/// after an error it is what it was.
///
/// Errors: unknown ending, a format that cannot hold the artifact, a folder that is missing or cannot be written,
/// a full disk, more than the 4 GiB of a .mat file.
pub fn export(artifact: &Artifact, to: &Path) -> Result<(), ExportError> {
    let format = Format::of(to, artifact.kind())?;
    publish(to, format, |file| encode(artifact, format, file))
}

/// Writes bytes of another writer in the same way. Errors: as [`export`].
pub fn export_bytes(bytes: &[u8], to: &Path) -> Result<(), ExportError> {
    // The format is only named where there are too many bytes for it, and these have no limit.
    publish(to, Format::Csv, |file| Ok(file.write_all(bytes)?))
}

fn encode(artifact: &Artifact, format: Format, mut to: impl Write + Seek) -> Result<(), Unwritten> {
    match (format, artifact) {
        (Format::Npz, _) => Ok(npz::encode(artifact, to)?),
        (Format::Mat, _) => Ok(to.write_all(&mat::encode(artifact)?)?),
        (Format::Csv, _) => Ok(to.write_all(&csv::encode(artifact))?),
        (Format::Tiff, Artifact::Images(stack)) => tiff::encode(stack, to),
        (Format::Tiff, other) => unreachable!("Format::of refuses {:?} as TIFF", other.kind()),
    }
}

/// More than the 32-bit numbers of a format count.
#[derive(Debug)]
struct TooLarge;

/// Why a file was not written.
#[derive(Debug)]
enum Unwritten {
    TooLarge,
    Io(io::Error),
}

impl From<TooLarge> for Unwritten {
    fn from(TooLarge: TooLarge) -> Self {
        Self::TooLarge
    }
}

impl From<io::Error> for Unwritten {
    fn from(error: io::Error) -> Self {
        Self::Io(error)
    }
}

/// Descriptions as JSON, keys sorted.
fn json<T: Serialize>(what: &T) -> Value {
    serde_json::to_value(what).expect("descriptions are words and numbers under text keys")
}

/// A file of what `encode` writes; piece by piece, so that what is large is not held a second time.
fn publish(
    to: &Path,
    format: Format,
    encode: impl FnOnce(&mut BufWriter<&mut File>) -> Result<(), Unwritten>,
) -> Result<(), ExportError> {
    let failed = |source: io::Error| ExportError::Io { to: to.to_owned(), source };
    if to.is_dir() {
        return Err(failed(io::Error::new(io::ErrorKind::IsADirectory, "it is a folder")));
    }
    let prefix = temporary_prefix(to);
    let folder = whole_file::folder_of(to);
    leftover::sweep(folder, &prefix);
    let mut file = whole_file::begin(folder, &prefix).map_err(failed)?;
    let mut buffer = BufWriter::with_capacity(BUFFER, file.as_file_mut());
    encode(&mut buffer).and_then(|()| Ok(buffer.flush()?)).map_err(|error| match error {
        Unwritten::TooLarge => ExportError::TooLarge { to: to.to_owned(), format },
        Unwritten::Io(source) => failed(source),
    })?;
    drop(buffer);
    whole_file::place(file, to, Synced::BytesAndName).map_err(failed)
}

/// How the temporary files of a target are called, so that the next export to it finds what a killed one has left.
fn temporary_prefix(to: &Path) -> String {
    let name = to.file_name().unwrap_or_default().to_string_lossy();
    format!(".turbid-export-{}-", Digest::of(name.as_bytes()).short())
}

#[cfg(test)]
mod tests;
