//! `seed:` of a stage — which of its instances, and of other stages, see the same random numbers.

use crate::digest::Digest;

use super::node::{Data, Entry};
use super::parse::join;
use super::reader::Reader;

/// A seed that a stage states itself, in place of the one that its inputs give.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SeedSpec {
    /// `seed: 7`: one per point of the axes, whatever the inputs are.
    PerInstance(u64),
    /// `seed: {common: 7}`: one for all instances, and for every stage of the same kind that says so with this number.
    Common(u64),
}

impl SeedSpec {
    /// With other random numbers.
    pub(super) fn repeated(self, repeat: u64) -> Self {
        match self {
            Self::PerInstance(seed) => Self::PerInstance(of_repeat(seed, repeat)),
            Self::Common(seed) => Self::Common(of_repeat(seed, repeat)),
        }
    }
}

/// The seed that a repeat (from 1) has in place of this one.
pub(super) fn of_repeat(seed: u64, repeat: u64) -> u64 {
    let mut bytes = seed.to_le_bytes().to_vec();
    bytes.extend(repeat.to_le_bytes());
    u64::from_le_bytes(*Digest::of(&bytes).0.first_chunk().expect("a digest has 32 bytes"))
}

/// Reads the `seed` of a stage, at `path`; vars are expanded.
pub fn parse(entry: &Entry, path: &str, reader: &mut Reader<'_>) -> Option<SeedSpec> {
    if !matches!(entry.value.data, Data::Map(_)) {
        let rule = format!("{}, or {{common: NUMBER}}", Reader::WHOLE_NUMBER);
        return reader.whole_number_as(&entry.value, entry.at, path, &rule).map(SeedSpec::PerInstance);
    }
    let known = reader.known_keys(&entry.value, path, &["common"], "a seed");
    let Some(common) = entry.value.entry("common") else {
        if known {
            reader.wrong(&entry.value, entry.at, path, "a whole number or {common: NUMBER}");
        }
        return None;
    };
    reader.whole_number(&common.value, common.at, &join(path, "common")).map(SeedSpec::Common)
}
