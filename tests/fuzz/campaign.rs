//! Runs a worker for each reader, and starts it anew behind the input that ended it: an abort, a stack that overflows, a hang.

use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread;
use std::time::{Duration, Instant};

use crate::readers::Reader;
use crate::worker::{self, Counts};

/// Without a word for so long a worker hangs. It speaks after 16 inputs of a few CPU seconds at most, on a machine that may be busy.
const SILENCE: Duration = Duration::from_secs(90);
/// So many failures of one kind are shown of a reader.
const SHOWN: usize = 3;
/// So often a worker is started anew.
const STARTS: usize = 20;

/// What came of a reader's inputs.
#[derive(Default)]
pub struct Outcome {
    pub counts: Counts,
    /// Path of the input and what it did.
    pub failures: Vec<(PathBuf, String)>,
}

/// Gives a reader `seconds` of time, more if its fixed inputs need it.
pub fn run(reader: &Reader, seed: u64, seconds: f64, folder: &Path) -> Outcome {
    let mut outcome = Outcome::default();
    let end = Instant::now() + Duration::from_secs_f64(seconds);
    let mut from = 0;
    for _ in 0..STARTS {
        let left = end.saturating_duration_since(Instant::now()).as_secs_f64();
        let Some(ended_by) = start(reader, seed, from, left, folder, &mut outcome) else { return outcome };
        let Some((index, input)) = worker::last(folder, reader.name) else {
            outcome.failures.push((folder.to_owned(), format!("the worker did not begin: {ended_by}")));
            return outcome;
        };
        outcome.failures.push((worker::keep(folder, reader.name, seed, index, &input), ended_by));
        from = index + 1;
    }
    outcome
}

/// One worker; what ended it, if it did not end by itself.
fn start(reader: &Reader, seed: u64, from: u64, seconds: f64, folder: &Path, outcome: &mut Outcome) -> Option<String> {
    let mut child = Command::new(std::env::current_exe().expect("this program has a path"))
        .args(["--work", reader.name, &seed.to_string(), &from.to_string(), &seconds.to_string()])
        .arg(folder)
        // To find the lines of a backtrace takes longer than a thousand inputs.
        .env("RUST_BACKTRACE", "0")
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("this program starts");
    let before = outcome.counts;
    let lines = lines(&mut child);
    let mut errors = child.stderr.take().expect("it is piped");
    let said = thread::spawn(move || {
        let mut text = Vec::new();
        let _ = errors.read_to_end(&mut text);
        String::from_utf8_lossy(&text).trim().replace('\n', " ")
    });
    loop {
        match lines.recv_timeout(SILENCE) {
            Ok(line) => hear(&line, before, outcome),
            Err(RecvTimeoutError::Timeout) => {
                let _ = child.kill();
                let _ = child.wait();
                return Some(format!("hangs: nothing was heard for {} s", SILENCE.as_secs()));
            }
            Err(RecvTimeoutError::Disconnected) => break,
        }
    }
    let status = child.wait().expect("it was started");
    let said = said.join().unwrap_or_default();
    (!status.success()).then(|| format!("ends the program ({status}): {}", said.chars().take(300).collect::<String>()))
}

fn lines(child: &mut Child) -> mpsc::Receiver<String> {
    let out = BufReader::new(child.stdout.take().expect("it is piped"));
    let (send, lines) = mpsc::channel();
    thread::spawn(move || out.lines().map_while(Result::ok).try_for_each(|line| send.send(line)));
    lines
}

/// `failed PATH MESSAGE` or `read N taken M`, counted from the start of the worker.
fn hear(line: &str, before: Counts, outcome: &mut Outcome) {
    let mut words = line.splitn(3, ' ');
    match (words.next(), words.next(), words.next()) {
        (Some("failed"), Some(path), Some(message)) => outcome.failures.push((path.into(), message.to_owned())),
        (Some("read"), Some(read), Some(taken)) => {
            let number = |text: &str| text.parse::<u64>().unwrap_or(0);
            let taken = number(taken.trim_start_matches("taken "));
            outcome.counts = Counts { read: before.read + number(read), taken: before.taken + taken };
        }
        _ => {}
    }
}

/// Failures of one kind (that differ in numbers only) together: the first few of each, and how many there are.
pub fn kinds(failures: &[(PathBuf, String)]) -> Vec<(String, usize, Vec<&Path>)> {
    let mut kinds: Vec<(String, String, usize, Vec<&Path>)> = Vec::new();
    for (path, message) in failures {
        let kind: String = message.chars().filter(|c| !c.is_ascii_digit()).take(120).collect();
        let at = kinds.iter().position(|k| k.0 == kind).unwrap_or_else(|| {
            kinds.push((kind, message.clone(), 0, Vec::new()));
            kinds.len() - 1
        });
        kinds[at].2 += 1;
        if kinds[at].3.len() < SHOWN {
            kinds[at].3.push(path);
        }
    }
    kinds.into_iter().map(|(_, message, count, paths)| (message, count, paths)).collect()
}
