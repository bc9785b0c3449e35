//! `turbid dataset` of a program that was built without polars.

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

impl Dataset {
    pub fn run(&self, _: &Registry) -> Done {
        let message = "`turbid dataset` needs tables by polars, and this turbid was built without them; \
                       build it with `cargo install --path . --locked --features tables`";
        Err(Failure::Input(message.to_owned()))
    }
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

    /// Whatever is asked, the answer is how to build with tables, as a mistake of the user's.
    #[test]
    fn it_says_what_to_build() {
        for line in ["x", "x build p.yaml spots --to set --json", "x stats --to set p.yaml"] {
            let asked = Line::try_parse_from(line.split(' ')).map_err(|e| e.to_string()).unwrap();
            let failure = asked.dataset.run(&Registry::builtin()).unwrap_err();
            let (report, code) = failure.told();
            assert_eq!(code, 2, "{line}");
            assert!(report.render(false).contains("cargo install --path . --locked --features tables"), "{line}");
        }
    }
}
