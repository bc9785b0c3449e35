//! turbid: declarative pipelines that design and simulate spatial frequency domain imaging systems.
//!
//! Data flows one way: YAML -> [`spec`] -> [`plan`] -> [`key`] -> [`run`] -> [`store`]; `docs/architecture.md` is the map.

pub mod cli;
pub mod digest;
pub mod estimate;
pub mod explain;
pub mod export;
mod ids;
pub mod input_file;
pub mod key;
mod leftover;
pub mod memo;
pub mod memory;
mod missing;
mod panics;
pub mod plan;
pub mod preview;
pub mod recipe;
pub mod registry;
mod regular;
pub mod resolve;
pub mod run;
pub mod spec;
pub mod store;
mod terminal;
mod threads;
mod warned;

/// Temporary files with the rights that the user gives to new files, not with those of secrets: others may be meant to read them.
fn shared_file() -> tempfile::Builder<'static, 'static> {
    #[allow(unused_mut, reason = "only Unix has rights to set")]
    let mut builder = tempfile::Builder::new();
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // Less what the umask takes away.
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    builder
}
