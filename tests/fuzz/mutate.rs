//! From seeds to inputs.

use crate::files::{self, What};
use crate::random::Random;
use crate::{bytes, checksums, text};

/// Larger inputs show nothing that smaller ones do not, and take longer.
const LARGEST: usize = 1 << 20;

const LARGE: usize = 32 << 10;

/// How inputs of a reader are changed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Form {
    Text,
    Binary,
    Png,
    /// Bytes behind which their digest stands.
    Digested,
    /// A folder of texts (see [`files`]).
    Texts,
    /// A folder of a store.
    Store,
}

/// An input: one of the seeds, changed in one to six places.
pub fn mutated(form: Form, seeds: &[Vec<u8>], random: &mut Random) -> Vec<u8> {
    let mut input = random.pick(seeds).clone();
    // Large seeds take a hundred times as long.
    if input.len() > LARGE && !random.one_in(20) {
        input = random.pick(seeds).clone();
    }
    let other = random.pick(seeds);
    let times = 1 + random.below(6);
    match form {
        Form::Text => (0..times).for_each(|_| text::mutate(&mut input, other, random)),
        Form::Binary | Form::Png | Form::Digested => (0..times).for_each(|_| bytes::mutate(&mut input, other, random)),
        Form::Texts | Form::Store => {
            let mut entries = files::split(&input);
            let others = files::split(other);
            for _ in 0..times {
                files::mutate(&mut entries, random, |name, content, random| {
                    let same = others.iter().find(|e| e.name == name).map(|e| &e.what);
                    let other = if let Some(What::File(other)) = same { other } else { &content.clone() };
                    if form == Form::Texts {
                        text::mutate(content, other, random);
                    } else {
                        bytes::mutate(content, other, random);
                    }
                    content.truncate(LARGEST);
                });
            }
            if form == Form::Store && !random.one_in(3) {
                entries.iter_mut().for_each(repair);
            }
            return files::join(&entries);
        }
    }
    input.truncate(LARGEST);
    // Some stay wrong: the checksum's own branch is a reader too.
    if form == Form::Png && !random.one_in(8) {
        checksums::png(&mut input);
    }
    if form == Form::Digested && random.one_in(2) {
        checksums::tail(&mut input);
    }
    input
}

/// Gets what was changed past the checksums of its file.
fn repair(entry: &mut files::Entry) {
    if let What::File(bytes) = &mut entry.what {
        if entry.name.ends_with(".pack") {
            checksums::pack(bytes);
        } else if entry.name.ends_with(".index") {
            checksums::index(bytes);
        }
    }
}
