//! Artifacts as files for other programs: NumPy, TIFF, CSV, MATLAB. The same artifact gives the same bytes.

mod csv;
mod error;
mod frames;
mod mat;
mod names;
mod npz;
mod tiff;

use std::io::Write;
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde_json::Value;
use turbid_contract::{Artifact, ArtifactKind};

use crate::digest::Digest;
use crate::leftover;

pub use error::ExportError;
pub use frames::export_frames;

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
/// a full disk, more than the format's 4 GiB.
pub fn export(artifact: &Artifact, to: &Path) -> Result<(), ExportError> {
    let format = Format::of(to, artifact.kind())?;
    let bytes = encode(artifact, format).map_err(|TooLarge| ExportError::TooLarge { to: to.to_owned(), format })?;
    publish(&bytes, to).map_err(|source| ExportError::Io { to: to.to_owned(), source })
}

fn encode(artifact: &Artifact, format: Format) -> Result<Vec<u8>, TooLarge> {
    match (format, artifact) {
        (Format::Npz, _) => npz::encode(artifact),
        (Format::Mat, _) => mat::encode(artifact),
        (Format::Csv, _) => Ok(csv::encode(artifact)),
        (Format::Tiff, Artifact::Images(stack)) => tiff::encode(stack),
        (Format::Tiff, other) => unreachable!("Format::of refuses {:?} as TIFF", other.kind()),
    }
}

/// Sizes in these files are 32-bit numbers.
#[derive(Debug)]
struct TooLarge;

fn size_u32(bytes: usize) -> Result<u32, TooLarge> {
    u32::try_from(bytes).map_err(|_| TooLarge)
}

/// Descriptions as JSON, keys sorted.
fn json<T: Serialize>(what: &T) -> Value {
    serde_json::to_value(what).expect("descriptions are words and numbers under text keys")
}

fn publish(bytes: &[u8], to: &Path) -> std::io::Result<()> {
    let folder = to.parent().filter(|p| !p.as_os_str().is_empty()).map_or_else(|| PathBuf::from("."), Path::to_owned);
    if to.is_dir() {
        return Err(std::io::Error::new(std::io::ErrorKind::IsADirectory, "it is a folder"));
    }
    let prefix = temporary_prefix(to);
    leftover::sweep(&folder, &prefix);
    let mut file = crate::shared_file().prefix(&prefix).tempfile_in(folder)?;
    leftover::hold(file.as_file());
    file.write_all(bytes)?;
    file.as_file().sync_all()?;
    file.persist(to)?;
    Ok(())
}

/// How the temporary files of a target are called, so that the next export to it finds what a killed one has left.
fn temporary_prefix(to: &Path) -> String {
    let name = to.file_name().unwrap_or_default().to_string_lossy();
    format!(".turbid-export-{}-", Digest::of(name.as_bytes()).short())
}

#[cfg(test)]
mod tests;
