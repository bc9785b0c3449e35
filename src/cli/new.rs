//! `turbid new`: a commented starter pipeline.

use std::fs::OpenOptions;
use std::io::Write;
use std::path::PathBuf;

use clap::Args;

use super::{Done, Failure, print};

#[derive(Args)]
pub struct New {
    /// Name of the pipeline; writes NAME.yaml
    name: String,
}

const STARTER: &str = include_str!("starter.yaml");

impl New {
    pub fn run(&self) -> Done {
        let name = self.name.trim_end_matches(".yaml");
        let path = PathBuf::from(format!("{name}.yaml"));
        let stem = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
        if stem.is_empty() || !stem.chars().all(|c| c.is_alphanumeric() || "-_".contains(c)) {
            return Err(Failure::Input(format!("`{}` is not a good name; use letters, digits, - and _", self.name)));
        }
        let fail = |e: std::io::Error| match e.kind() {
            std::io::ErrorKind::AlreadyExists => {
                Failure::Input(format!("{} exists already; choose another name", path.display()))
            }
            _ => Failure::Input(format!("{}: {e}", path.display())),
        };
        let mut file = OpenOptions::new().write(true).create_new(true).open(&path).map_err(fail)?;
        file.write_all(STARTER.replace("PIPELINE_NAME", &stem).as_bytes()).map_err(fail)?;
        print(&format!("wrote {0}; try `turbid check {0}`, then `turbid run {0}`", path.display()));
        Ok(())
    }
}
