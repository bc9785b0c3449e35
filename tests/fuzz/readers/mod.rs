//! What reads files and arguments: each with its seeds, and the laws that hold for whatever it is given.

mod arguments;
mod artifacts;
mod laboratory;
mod memos;
mod meshes;
pub mod pictures;
mod pipelines;
mod stage;
mod stores;

use crate::mutate::Form;

/// One of turbid's readers.
pub struct Reader {
    pub name: &'static str,
    pub form: Form,
    /// Its part of the time.
    pub share: u32,
    /// Inputs without a fault; each must be taken.
    pub seeds: fn() -> Vec<Vec<u8>>,
    /// Bytes that the input claims to decode to, whether it is taken or not.
    pub claims: fn(&[u8]) -> usize,
    /// Reads an input; time and memory of it are limited. Error: a law that does not hold.
    pub read: fn(&[u8]) -> Result<Seen, String>,
    /// What must hold of an input that was taken, in the time of a run.
    pub law: fn(&[u8]) -> Result<(), String>,
}

/// What became of an input.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seen {
    /// Whether it was read; else it was refused with a reason.
    pub taken: bool,
    /// Bytes of what it decodes to.
    pub decoded: usize,
}

impl Seen {
    /// An input that decodes to about its own size.
    fn as_large(taken: bool, input: &[u8]) -> Self {
        Self { taken, decoded: input.len() }
    }
}

/// Where no header says what the input decodes to.
fn nothing(_: &[u8]) -> usize {
    0
}

/// Where `read` sees all that there is to see.
fn no_more(_: &[u8]) -> Result<(), String> {
    Ok(())
}

pub fn all() -> Vec<Reader> {
    let mut all = pipelines::readers();
    all.extend(arguments::readers());
    all.extend(meshes::readers());
    all.extend(pictures::readers());
    all.extend(laboratory::readers());
    all.extend(artifacts::readers());
    all.extend(stores::readers());
    all.extend(memos::readers());
    all
}
