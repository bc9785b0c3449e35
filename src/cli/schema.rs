//! `turbid schema`: the JSON Schema of pipeline files.

use crate::registry::Registry;
use crate::spec;

use super::{Done, print_json};

pub fn run(registry: &Registry) -> Done {
    print_json(&format!("{:#}", spec::schema(registry)));
    Ok(())
}
