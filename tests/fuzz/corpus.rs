//! The inputs of a reader in their order: what once failed, the seeds as they are, then one mutation after another.

use std::fs;
use std::path::{Path, PathBuf};

use crate::mutate::mutated;
use crate::random::Random;
use crate::readers::Reader;

pub struct Corpus<'a> {
    reader: &'a Reader,
    seed: u64,
    regressions: Vec<PathBuf>,
    seeds: Vec<Vec<u8>>,
}

impl<'a> Corpus<'a> {
    pub fn new(reader: &'a Reader, seed: u64) -> Self {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fuzz/regressions").join(reader.name);
        let mut regressions: Vec<PathBuf> =
            fs::read_dir(folder).into_iter().flatten().flatten().map(|e| e.path()).collect();
        regressions.sort();
        Self { reader, seed, regressions, seeds: (reader.seeds)() }
    }

    /// The input at a place in the order.
    pub fn input(&self, index: u64) -> Vec<u8> {
        let i = index as usize;
        if let Some(path) = self.regressions.get(i) {
            return fs::read(path).expect("the file was listed");
        }
        if let Some(seed) = self.seeds.get(i - self.regressions.len()) {
            return seed.clone();
        }
        // Counted without the regressions, so that one more of them leaves the others as they are.
        let mutation = index - self.regressions.len() as u64;
        mutated(self.reader.form, &self.seeds, &mut Random::new(self.seed, self.reader.name, mutation))
    }

    /// Whether the input is one of the seeds, which are right.
    pub fn is_seed(&self, index: u64) -> bool {
        (self.regressions.len()..self.fixed()).contains(&(index as usize))
    }

    /// Inputs before the first mutation.
    pub fn fixed(&self) -> usize {
        self.regressions.len() + self.seeds.len()
    }
}
