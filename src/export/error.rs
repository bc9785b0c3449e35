//! Why an artifact could not be exported.

use std::fmt;
use std::path::PathBuf;

use turbid_contract::ArtifactKind;

use super::Format;

#[derive(Debug)]
pub enum ExportError {
    /// No format has that ending.
    UnknownFormat { to: PathBuf, ending: String },
    /// The format cannot hold such an artifact.
    WrongKind { to: PathBuf, format: Format, kind: ArtifactKind },
    /// More bytes than the format can count.
    TooLarge { to: PathBuf, format: Format },
    /// Whole numbers are written to TIFF only.
    BitsOfTiff { to: PathBuf },
    /// Neither 8 nor 16.
    Bits { bits: u32 },
    /// A pixel that no whole number of that many bits is.
    NotWhole { layer: String, value: f32, bits: u32 },
    /// One file name for several frames.
    SameName { to: PathBuf, count: usize },
    /// Instances that do not go into one file.
    Differs { label: String, what: String },
    /// A file for many image stacks of a format that holds one.
    NotStacked { to: PathBuf },
    /// The file could not be written.
    Io { to: PathBuf, source: std::io::Error },
}

impl fmt::Display for ExportError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::UnknownFormat { to, ending } if ending.is_empty() => {
                write!(f, "{}: the name has no ending; known: {}", to.display(), endings(|_| true))
            }
            Self::UnknownFormat { to, ending } => {
                write!(f, "{}: `.{ending}` is not a format of export; known: {}", to.display(), endings(|_| true))
            }
            Self::WrongKind { to, format, kind } => {
                let (article, name) = match kind {
                    ArtifactKind::Images => ("an", "image stack"),
                    ArtifactKind::Table => ("a", "table"),
                    ArtifactKind::Record => ("a", "record"),
                };
                let instead = endings(|f| f.takes(*kind));
                let ending = format.extension();
                write!(
                    f,
                    "{}: {article} {name} cannot be a .{ending} file; for {article} {name}: {instead}",
                    to.display()
                )
            }
            Self::TooLarge { to, format } => {
                let ending = format.extension();
                write!(f, "{}: more than the 4 GiB that a .{ending} file can hold; .csv has no limit", to.display())
            }
            Self::BitsOfTiff { to } => {
                write!(f, "{}: whole numbers (--bits) are written as .tiff, from an image stack", to.display())
            }
            Self::Bits { bits } => write!(f, "--bits = {bits} must be 8 or 16"),
            Self::NotWhole { layer, value, bits } => {
                let highest = (1_u64 << bits) - 1;
                write!(
                    f,
                    "a pixel of `{layer}` is {value}, and --bits {bits} writes whole numbers from 0 to {highest}; the port `numbers` of sensor holds such"
                )
            }
            Self::SameName { to, count } => write!(
                f,
                "`{}` names {count} frames alike; write {{f_x}}, {{phase}} or {{wavelength}} into it",
                to.display()
            ),
            Self::Differs { label, what } => {
                write!(
                    f,
                    "{label} has {what}; what goes into one file must be alike: pick some with [axis=value], or write --to FOLDER/"
                )
            }
            Self::NotStacked { to } => write!(
                f,
                "{}: image stacks of many instances go into one .npz or .mat, or each into a file of its own: --to FOLDER/",
                to.display()
            ),
            Self::Io { to, source } => write!(f, "{}: cannot be written: {source}", to.display()),
        }
    }
}

impl std::error::Error for ExportError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::Io { source, .. } => Some(source),
            _ => None,
        }
    }
}

fn endings(which: impl Fn(Format) -> bool) -> String {
    let known: Vec<String> =
        Format::ALL.into_iter().filter(|f| which(*f)).map(|f| format!(".{}", f.extension())).collect();
    known.join(", ")
}
