//! `turbid new`: a commented starter pipeline that ends in maps.

use std::fs::OpenOptions;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};

use super::{Done, Failure, print};

#[derive(Args)]
pub struct New {
    /// Name of the pipeline; writes NAME.yaml
    name: String,
    /// What it begins from
    #[arg(long, value_enum, default_value_t = Starter::Planar)]
    from: Starter,
}

/// Each ends in maps with a picture.
#[derive(Clone, Copy, ValueEnum)]
enum Starter {
    /// A rendered slab with a lesion, maps of mu_a and mu_s' and their errors
    Planar,
    /// Frames that a camera wrote to disk, with files to try it with
    Measured,
    /// Four wavelengths, oxygen saturation
    Wavelengths,
    /// The inside of a tube, with tables made in it
    Tube,
    /// Drawn scenes as a data set for training
    Dataset,
}

/// Stands for the name of the pipeline.
const NAME: &str = "PIPELINE_NAME";

/// Frames for `measured`, made by `pipelines/measured_source.yaml`: name and bytes.
macro_rules! frames {
    ($($name:literal),*) => {
        [$(($name, include_bytes!(concat!("../../pipelines/data/measured/", $name)))),*]
    };
}
const FRAMES: [(&str, &[u8]); 10] = frames!(
    "dark.tif",
    "flat.tif",
    "phantom_0_0.tif",
    "phantom_0.1_0.tif",
    "phantom_0.1_1.tif",
    "phantom_0.1_2.tif",
    "tissue_0_0.tif",
    "tissue_0.1_0.tif",
    "tissue_0.1_1.tif",
    "tissue_0.1_2.tif"
);

impl Starter {
    fn text(self) -> &'static str {
        match self {
            Self::Planar => include_str!("new/planar.yaml"),
            Self::Measured => include_str!("new/measured.yaml"),
            Self::Wavelengths => include_str!("new/wavelengths.yaml"),
            Self::Tube => include_str!("new/tube.yaml"),
            Self::Dataset => include_str!("new/dataset.yaml"),
        }
    }

    fn frames(self) -> &'static [(&'static str, &'static [u8])] {
        match self {
            Self::Measured => &FRAMES,
            _ => &[],
        }
    }
}

impl New {
    pub fn run(&self) -> Done {
        let name = self.name.trim_end_matches(".yaml");
        let path = PathBuf::from(format!("{name}.yaml"));
        let stem = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
        if stem.is_empty() || !stem.chars().all(|c| c.is_alphanumeric() || "-_".contains(c)) {
            return Err(Failure::Input(format!("`{}` is not a good name; use letters, digits, - and _", self.name)));
        }
        // The pipeline comes last: where it is, its frames are.
        let folder = path.with_file_name(format!("{stem}_frames"));
        if path.exists() {
            return Err(exists(&path));
        }
        if !self.from.frames().is_empty() {
            std::fs::create_dir(&folder).map_err(|e| failed(&folder, &e))?;
        }
        for (name, bytes) in self.from.frames() {
            write(&folder.join(name), bytes)?;
        }
        write(&path, self.from.text().replace(NAME, &stem).as_bytes())?;
        let with = if self.from.frames().is_empty() { String::new() } else { format!(" and {}", folder.display()) };
        print(&format!("wrote {0}{with}; try `turbid check {0}`, then `turbid run {0}`", path.display()));
        Ok(())
    }
}

fn write(path: &Path, bytes: &[u8]) -> Done {
    let written = OpenOptions::new().write(true).create_new(true).open(path).and_then(|mut file| file.write_all(bytes));
    written.map_err(|e| failed(path, &e))
}

fn exists(path: &Path) -> Failure {
    Failure::Input(format!("{} exists already; choose another name", path.display()))
}

fn failed(path: &Path, error: &std::io::Error) -> Failure {
    match error.kind() {
        ErrorKind::AlreadyExists => exists(path),
        _ => Failure::Input(format!("{}: {error}", path.display())),
    }
}
