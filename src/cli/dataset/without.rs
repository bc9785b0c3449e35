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
