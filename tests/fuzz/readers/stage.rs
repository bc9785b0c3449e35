//! An input file of a stage, as `check` and a run read it.

use std::sync::Arc;

use serde_json::Value;
use turbid::registry::Registry;
use turbid::store::encode;
use turbid_contract::kit::Inputs;
use turbid_contract::{Ctx, Known, MemoryHost, Problems};

/// A stage with one input file.
pub struct FileOf {
    pub stage: &'static str,
    /// The field that names the file.
    pub at: &'static str,
    pub params: Value,
}

impl FileOf {
    fn file(&self, input: &[u8]) -> [(String, Arc<[u8]>); 1] {
        [(self.at.to_owned(), Arc::from(input))]
    }

    /// Whether the stage takes the file.
    pub fn check(&self, input: &[u8]) -> bool {
        let registry = Registry::builtin();
        let row = registry.find(self.stage).expect("the stage is built in");
        let mut problems = Problems::default();
        row.check(&self.params, &Known { files: self.file(input).into(), ..Known::default() }, &mut problems);
        problems.into_parts().0.is_empty()
    }

    /// A stage that took a file gives results, and nothing in them is NaN or infinite: encoding such would be an error.
    pub fn run(&self, input: &[u8]) -> Result<(), String> {
        let registry = Registry::builtin();
        let row = registry.find(self.stage).expect("the stage is built in");
        let host = MemoryHost { files: self.file(input).into(), ..MemoryHost::default() };
        let made = row.run(&self.params, &Inputs::none(), Ctx::new(&host));
        let made = made.map_err(|e| format!("`check` takes it, the run fails: {e}"))?;
        made.iter().try_for_each(|(port, artifact)| match encode(artifact) {
            Ok(_) => Ok(()),
            Err(error) => Err(format!("`{port}` cannot be stored: {error}")),
        })
    }
}
