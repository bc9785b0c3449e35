//! The process that reads the inputs of one reader. It says what it is about to read before it does, so that whoever started it knows what
//! ended it.

use std::fs::{self, File};
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use crate::corpus::Corpus;
use crate::limits::judge;
use crate::readers::Reader;

/// What a worker is asked to do.
pub struct Task {
    pub seed: u64,
    /// The first input.
    pub from: u64,
    pub seconds: f64,
    /// Where inputs go.
    pub folder: PathBuf,
}

/// The inputs that were read, on the way to the parent.
#[derive(Clone, Copy, Debug, Default)]
pub struct Counts {
    pub read: u64,
    pub taken: u64,
}

/// The file that holds the input at work: its index (8 bytes), its length (8), the input.
pub fn at_work(folder: &Path, name: &str) -> PathBuf {
    folder.join(format!("{name}.at_work"))
}

/// Reads inputs until the time is up, the fixed ones in any case. Prints `failed PATH MESSAGE` for each that fails, `read N taken M` at the end.
pub fn work(reader: &Reader, task: &Task) {
    let corpus = Corpus::new(reader, task.seed);
    let end = Instant::now() + Duration::from_secs_f64(task.seconds);
    let mut file = File::create(at_work(&task.folder, reader.name)).expect("the folder is ours");
    let mut counts = Counts::default();
    let mut index = task.from;
    while index < corpus.fixed() as u64 || Instant::now() < end {
        let input = corpus.input(index);
        let head = [index.to_le_bytes(), (input.len() as u64).to_le_bytes()].concat();
        file.seek(SeekFrom::Start(0))
            .and_then(|_| file.write_all(&[head, input.clone()].concat()))
            .expect("the file is ours");
        let judged = judge(reader, &input);
        counts.read += 1;
        match judged {
            Ok(seen) => {
                counts.taken += u64::from(seen.taken);
                if corpus.is_seed(index) && !seen.taken {
                    fail(reader, task, index, &input, "a seed is refused");
                }
            }
            Err(message) => fail(reader, task, index, &input, &message),
        }
        index += 1;
        if counts.read % 16 == 0 {
            println!("read {} taken {}", counts.read, counts.taken);
        }
    }
    println!("read {} taken {}", counts.read, counts.taken);
}

fn fail(reader: &Reader, task: &Task, index: u64, input: &[u8], message: &str) {
    println!("failed {} {message}", keep(&task.folder, reader.name, task.seed, index, input).display());
}

/// Writes an input to where the user finds it.
pub fn keep(folder: &Path, name: &str, seed: u64, index: u64, input: &[u8]) -> PathBuf {
    let path = folder.join(format!("{name}-{seed}-{index}"));
    fs::write(&path, input).expect("the folder is ours");
    path
}

/// The index and the input that were at work.
pub fn last(folder: &Path, name: &str) -> Option<(u64, Vec<u8>)> {
    let bytes = fs::read(at_work(folder, name)).ok()?;
    let number = |at: usize| Some(u64::from_le_bytes(*bytes.get(at..)?.first_chunk()?));
    let length = usize::try_from(number(8)?).ok()?;
    Some((number(0)?, bytes.get(16..16 + length)?.to_vec()))
}
