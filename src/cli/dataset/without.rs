//! `turbid dataset` and `turbid study` of a program that was built without polars.

use std::ffi::OsString;

use clap::Args;

use crate::cli::{Done, Failure};
use crate::registry::Registry;

/// Takes whatever follows: it is right for the program that has the command.
#[derive(Args)]
pub struct Dataset {
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, hide = true)]
    _arguments: Vec<OsString>,
}

/// The same of studies.
#[derive(Args)]
pub struct Study {
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, hide = true)]
    _arguments: Vec<OsString>,
}

impl Dataset {
    pub fn run(&self, _: &Registry) -> Done {
        Err(without("dataset"))
    }
}

impl Study {
    pub fn run(&self, _: &Registry) -> Done {
        Err(without("study"))
    }
}

pub fn without(command: &str) -> Failure {
    Failure::Input(format!(
        "`turbid {command}` needs tables by polars, and this turbid was built without them; build it with `cargo install --path . --locked --features tables`"
    ))
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        dataset: Dataset,
    }

    #[derive(Parser)]
    struct OfStudies {
        #[command(flatten)]
        study: Study,
    }

    fn study(line: &str) -> Study {
        OfStudies::try_parse_from(line.split(' ')).map_err(|e| e.to_string()).unwrap().study
    }

    /// Whatever is asked, the answer is how to build with tables, as a mistake of the user's.
    #[test]
    fn it_says_what_to_build() {
        for line in ["x", "x build p.yaml spots --to set --json", "x stats --to set p.yaml"] {
            let asked = Line::try_parse_from(line.split(' ')).map_err(|e| e.to_string()).unwrap();
            for failure in [asked.dataset.run(&Registry::builtin()), study(line).run(&Registry::builtin())] {
                let (report, code) = failure.unwrap_err().told();
                assert_eq!(code, 2, "{line}");
                assert!(report.render(false).contains("cargo install --path . --locked --features tables"), "{line}");
            }
        }
    }
}
