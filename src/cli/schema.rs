//! `turbid schema`: the JSON Schema of pipeline files.

use crate::registry::Registry;
use crate::spec;

use super::{Done, print};

pub fn run(registry: &Registry) -> Done {
    print(&format!("{:#}", spec::schema(registry)));
    Ok(())
}
