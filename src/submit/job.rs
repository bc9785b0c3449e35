//! A job: what was handed over to an engine, in a folder of `outputs/jobs` that all of its tasks read.
//!
//! ```text
//! outputs/jobs/20260131T235959Z-3fa2b1/
//!   job.json            what is to be done; with a check over it
//!   0-sweep.yaml        the pipeline file and what it includes, as they were
//!   task.sh             what a task runs: sh task.sh ROUND SHARD
//!   submissions.jsonl   a line for each array: round, shards, the engine's number
//!   1/                  the first round: SHARD.log, and SHARD.exit-CODE once the task has ended
//!   stop                whoever makes this file ends all tasks
//! ```

use std::collections::BTreeMap;
use std::fs::{self, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use serde::{Deserialize, Serialize};
use turbid_contract::canonical::canonical_text;
use turbid_contract::file::MOST_BYTES;

use crate::digest::Digest;
use crate::input_file;
use crate::run::log::timestamp;
use crate::run::name::file_name_of;
use crate::spec::SourceFile;
use crate::whole_file::{self, Synced};

use super::engine::Ticket;

/// The number of this form of the file.
const FORM: u32 = 1;
/// Bytes of a file of a job; a longer one is none of ours.
const MOST: u64 = 64 << 20;
/// With which a task can end by itself.
const CODES: [i32; 4] = [0, 1, 2, 130];
const FILE: &str = "job.json";
const SUBMISSIONS: &str = "submissions.jsonl";

/// What is to be done. All paths are absolute.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Work {
    pub form: u32,
    /// Name of the pipeline.
    pub pipeline: String,
    pub file: PathBuf,
    pub outputs: PathBuf,
    /// Where it was submitted; tasks begin there.
    pub cwd: PathBuf,
    pub overrides: Vec<String>,
    /// As the user gave them.
    pub targets: Vec<String>,
    /// As `--engine` takes it.
    pub engine: String,
    pub options: Vec<String>,
    /// Into so many shards the work is cut.
    pub shards: u32,
    /// Of each task.
    pub threads: usize,
    /// What a task runs: arguments of turbid, [`SHARD`](Self::SHARD) among them.
    pub command: Vec<String>,
    /// The pipeline file, what it includes, tables and input files, with the digests of their bytes.
    pub read: Vec<(PathBuf, Digest)>,
}

impl Work {
    pub const FORM: u32 = FORM;
    /// What stands in a command for the shard.
    pub const SHARD: &str = "--shard=K/N";

    /// What the task of a shard runs.
    pub fn command_of(&self, shard: u32) -> Vec<String> {
        let own = format!("--shard={shard}/{}", self.shards);
        self.command.iter().map(|word| if word == Self::SHARD { own.clone() } else { word.clone() }).collect()
    }

    /// What this job asks for that the other one of the same file does not; nothing where they ask for the same.
    pub fn differs(&self, other: &Self) -> Vec<String> {
        let words = |words: &[String]| if words.is_empty() { "none".to_owned() } else { words.join(" ") };
        let mut found = Vec::new();
        for (name, own, others) in
            [("--set", &self.overrides, &other.overrides), ("targets", &self.targets, &other.targets)]
        {
            if own != others {
                found.push(format!("its {name}: {}, here: {}", words(own), words(others)));
            }
        }
        let before = |path: &Path| other.read.iter().find(|(known, _)| known == path).map(|(_, digest)| digest);
        let changed = self.read.iter().filter(|(path, digest)| before(path) != Some(digest));
        found.extend(changed.map(|(path, _)| format!("{} was another one", path.display())));
        found
    }

    /// Which files are not any more what they were when the job was submitted.
    pub fn changed(&self) -> Vec<&Path> {
        let same =
            |path: &Path, digest: &Digest| input_file::digest(path, MOST_BYTES).is_ok_and(|(now, _)| now == *digest);
        self.read.iter().filter(|(path, digest)| !same(path, digest)).map(|(path, _)| path.as_path()).collect()
    }
}

/// An array that was submitted.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Submission {
    /// From 1.
    pub round: usize,
    pub shards: Vec<u32>,
    pub ticket: Ticket,
}

/// What the files of a round say of its tasks.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Marks {
    /// Shards whose task has begun.
    pub begun: Vec<u32>,
    /// With which exit code those ended that have.
    pub ended: BTreeMap<u32, i32>,
}

/// A job with its folder.
#[derive(Clone, Debug)]
pub struct Job {
    pub folder: PathBuf,
    pub work: Work,
}

/// The work with the check over its canonical text.
#[derive(Serialize, Deserialize)]
struct Checked {
    check: Digest,
    job: Work,
}

impl Job {
    /// Makes the folder of a new job, with copies of the texts that it reads.
    ///
    /// Error: what cannot be written, and where.
    pub fn begin(work: Work, program: &Path, texts: &[SourceFile]) -> Result<Self, String> {
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let id = Digest::of(format!("{} {}", now.as_nanos(), std::process::id()).as_bytes()).to_string();
        let folder = jobs(&work.outputs).join(format!("{}-{}", timestamp(now.as_secs()), &id[..6]));
        let job = Self { folder, work };
        fs::create_dir_all(&job.folder).map_err(|error| told(&job.folder, error))?;
        for (index, source) in texts.iter().enumerate() {
            job.write(&format!("{index}-{}", file_name_of(Path::new(&source.name))), &source.text)?;
        }
        job.write("task.sh", &script(&job, program)?)?;
        // What is there with its check is whole.
        let checked = Checked { check: check(&job.work)?, job: job.work.clone() };
        let text = serde_json::to_string_pretty(&checked).map_err(|error| told(&job.folder, error.into()))?;
        job.write(FILE, &format!("{text}\n"))?;
        Ok(job)
    }

    /// The job whose file this is.
    ///
    /// Error: the file is not there, or not as turbid wrote it.
    pub fn read(file: &Path) -> Result<Self, String> {
        let folder = whole_file::folder_of(file).to_owned();
        let bytes = input_file::read(file, MOST).map_err(|refused| format!("{}: {refused}", file.display()))?;
        let altered = || {
            format!(
                "{}: this is not the job file that turbid wrote: it was edited or cut off; submit again, what is done is kept",
                file.display()
            )
        };
        let Checked { check: written, job } = serde_json::from_slice(&bytes).map_err(|_| altered())?;
        if job.form != FORM || check(&job)? != written { Err(altered()) } else { Ok(Self { folder, work: job }) }
    }

    /// The jobs that were submitted with these outputs, the latest first; of those that cannot be read, why.
    pub fn all(outputs: &Path) -> Vec<Result<Self, String>> {
        let entries = fs::read_dir(jobs(outputs)).into_iter().flatten().flatten();
        // One that was killed while it made its folder has no file.
        let mut files: Vec<PathBuf> =
            entries.map(|entry| entry.path().join(FILE)).filter(|file| file.exists()).collect();
        files.sort();
        files.iter().rev().map(|file| Self::read(file)).collect()
    }

    pub fn file(&self) -> PathBuf {
        self.folder.join(FILE)
    }

    pub fn script(&self) -> PathBuf {
        self.folder.join("task.sh")
    }

    /// Whoever makes this file ends all tasks.
    pub fn stop(&self) -> PathBuf {
        self.folder.join("stop")
    }

    pub fn round(&self, round: usize) -> PathBuf {
        self.folder.join(round.to_string())
    }

    pub fn log(&self, round: usize, shard: u32) -> PathBuf {
        self.round(round).join(format!("{shard}.log"))
    }

    /// Makes the folder of a round.
    pub fn begin_round(&self, round: usize) -> Result<PathBuf, String> {
        let folder = self.round(round);
        fs::create_dir_all(&folder).map_err(|error| told(&folder, error))?;
        Ok(folder)
    }

    /// The arrays so far; a line that was cut off is none.
    pub fn submissions(&self) -> Vec<Submission> {
        let text = input_file::read(&self.folder.join(SUBMISSIONS), MOST).unwrap_or_default();
        let lines = text.split(|byte| *byte == b'\n');
        lines.filter_map(|line| serde_json::from_slice(line).ok()).collect()
    }

    /// Notes an array.
    pub fn submitted(&self, submission: &Submission) -> Result<(), String> {
        let path = self.folder.join(SUBMISSIONS);
        let line = serde_json::to_string(submission).map_err(|error| told(&path, error.into()))?;
        let file = OpenOptions::new().create(true).append(true).open(&path);
        let written = file.and_then(|mut file| {
            file.write_all(format!("{line}\n").as_bytes())?;
            file.sync_all()
        });
        written.map_err(|error| told(&path, error))
    }

    /// What the files of a round say.
    pub fn marks(&self, round: usize) -> Marks {
        let entries = fs::read_dir(self.round(round)).into_iter().flatten().flatten();
        let mut marks = Marks::default();
        for entry in entries {
            let name = entry.file_name();
            let Some((shard, what)) = name.to_str().and_then(|name| name.split_once('.')) else { continue };
            let Ok(shard) = shard.parse() else { continue };
            match what.strip_prefix("exit-").map(str::parse) {
                Some(Ok(code)) => drop(marks.ended.insert(shard, code)),
                Some(Err(_)) => {}
                None if what == "log" => marks.begun.push(shard),
                None => {}
            }
        }
        marks.begun.sort_unstable();
        marks
    }

    fn write(&self, name: &str, text: &str) -> Result<(), String> {
        let path = self.folder.join(name);
        whole_file::write(&path, ".new-", text.as_bytes(), Synced::BytesAndName).map_err(|error| told(&path, error))
    }
}

/// The files by which a task says that it ended.
pub struct Marked {
    round: PathBuf,
    shard: u32,
}

impl Marked {
    /// Of a task of the job whose file this is, whatever stands in it.
    pub fn of(job: &Path, round: usize, shard: u32) -> Self {
        Self { round: whole_file::folder_of(job).join(round.to_string()), shard }
    }

    /// Removes what an earlier start of the task left: the engine runs it again.
    pub fn forget(&self) {
        CODES.iter().for_each(|code| drop(fs::remove_file(self.path(*code))));
    }

    /// Notes that it ended with this exit code.
    pub fn ended(&self, code: i32) -> Result<(), String> {
        let path = self.path(code);
        fs::write(&path, "").map_err(|error| told(&path, error))
    }

    fn path(&self, code: i32) -> PathBuf {
        self.round.join(format!("{}.exit-{code}", self.shard))
    }
}

fn jobs(outputs: &Path) -> PathBuf {
    outputs.join("jobs")
}

fn told(path: &Path, error: io::Error) -> String {
    format!("{}: {error}", path.display())
}

fn check(work: &Work) -> Result<Digest, String> {
    let value = serde_json::to_value(work).map_err(|error| format!("a path of the job is no text: {error}"))?;
    Ok(Digest::of(canonical_text(&value).as_bytes()))
}

/// What a task runs.
fn script(job: &Job, program: &Path) -> Result<String, String> {
    let word = |path: &Path| match path.to_str() {
        Some(text) => Ok(format!("'{}'", text.replace('\'', "'\\''"))),
        None => Err(format!("{}: tasks cannot be given a path that is no text", path.display())),
    };
    Ok(format!(
        "#!/bin/sh\n\
         # One task of the job in this folder: sh task.sh ROUND SHARD. Slurm and HyperQueue name the shard themselves.\n\
         shard=${{2:-${{SLURM_ARRAY_TASK_ID:-$HQ_TASK_ID}}}}\n\
         cd {} || exit 1\n\
         exec {} task {} \"$1\" \"$shard\" >>{}/\"$1/$shard.log\" 2>&1\n",
        word(&job.work.cwd)?,
        word(program)?,
        word(&job.file())?,
        word(&job.folder)?,
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn work(outputs: &Path) -> Work {
        Work {
            form: FORM,
            pipeline: "p".to_owned(),
            file: outputs.join("p.yaml"),
            outputs: outputs.to_owned(),
            cwd: outputs.to_owned(),
            overrides: vec!["vars.n=2".to_owned()],
            targets: Vec::new(),
            engine: "slurm".to_owned(),
            options: Vec::new(),
            shards: 8,
            threads: 1,
            command: vec!["run".to_owned()],
            read: Vec::new(),
        }
    }

    /// A job is read as it was written; any other text in its file is told.
    #[test]
    fn a_job_file_is_read_as_written_or_not_at_all() {
        let outputs = tempfile::tempdir().unwrap();
        let job = Job::begin(work(outputs.path()), Path::new("/bin/turbid"), &[]).unwrap();
        assert_eq!(Job::read(&job.file()).unwrap().work, job.work);
        assert_eq!(Job::all(outputs.path()).len(), 1);
        let text = fs::read_to_string(job.file()).unwrap();
        for (old, new) in [("vars.n=2", "vars.n=3"), ("\"shards\": 8", "\"shards\": 9"), ("\"form\": 1", "\"form\": 2")]
        {
            assert!(text.contains(old), "{text}");
            fs::write(job.file(), text.replace(old, new)).unwrap();
            let message = Job::read(&job.file()).unwrap_err();
            assert!(message.contains("job.json") && message.contains("edited"), "{message}");
        }
        fs::write(job.file(), &text[..text.len() / 2]).unwrap();
        assert!(Job::read(&job.file()).is_err());
        // White space is no other job.
        fs::write(job.file(), text.replace("  ", "\t")).unwrap();
        assert!(Job::read(&job.file()).is_ok());
    }

    #[test]
    fn files_that_changed_are_named() {
        let outputs = tempfile::tempdir().unwrap();
        let (one, two) = (outputs.path().join("one"), outputs.path().join("two"));
        fs::write(&one, "1").unwrap();
        fs::write(&two, "2").unwrap();
        let read = vec![(one.clone(), Digest::of(b"1")), (two.clone(), Digest::of(b"2"))];
        let work = Work { read, ..work(outputs.path()) };
        assert!(work.changed().is_empty());
        fs::write(&two, "3").unwrap();
        assert_eq!(work.changed(), [two.as_path()]);
        fs::remove_file(&one).unwrap();
        assert_eq!(work.changed(), [one.as_path(), two.as_path()]);
    }

    #[test]
    fn submissions_and_marks_are_what_was_noted() {
        let outputs = tempfile::tempdir().unwrap();
        let job = Job::begin(work(outputs.path()), Path::new("/bin/turbid"), &[]).unwrap();
        assert_eq!((job.submissions(), job.marks(1)), (Vec::new(), Marks::default()));
        let ticket = Ticket { id: "17".to_owned(), place: None, server: None };
        let first = Submission { round: 1, shards: vec![1, 2, 3], ticket: ticket.clone() };
        job.submitted(&first).unwrap();
        // A kill while the second line was written.
        let mut file = OpenOptions::new().append(true).open(job.folder.join(SUBMISSIONS)).unwrap();
        file.write_all(b"{\"round\":2,\"sha").unwrap();
        assert_eq!(job.submissions(), [first]);
        job.begin_round(1).unwrap();
        for shard in [1, 2, 3] {
            fs::write(job.log(1, shard), "").unwrap();
        }
        let mark = |shard: u32| Marked::of(&job.file(), 1, shard);
        mark(1).ended(0).unwrap();
        mark(2).ended(130).unwrap();
        fs::write(job.round(1).join("notes"), "").unwrap();
        let marks = job.marks(1);
        assert_eq!((marks.begun, marks.ended), (vec![1, 2, 3], BTreeMap::from([(1, 0), (2, 130)])));
        mark(2).forget();
        assert_eq!(job.marks(1).ended, BTreeMap::from([(1, 0)]));
    }
}
