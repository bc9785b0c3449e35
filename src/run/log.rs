//! `outputs/runs`: what ran, when, from which files; its keys are the roots of garbage collection.

use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::{Instant, SystemTime, UNIX_EPOCH};

use serde_json::{Value, json};

use crate::digest::Digest;
use crate::panics::lock;
use crate::plan::{InstanceId, Plan};
use crate::regular::{self, NotOpened};
use crate::store::{Cost, InstanceRecord, Store};
use crate::whole_file::{self, Synced};

use super::name::file_name_of;
use super::{End, Progress, Summary};

/// So many runs protect their results from garbage collection.
const LATEST_RUNS: usize = 16;
/// Bytes; a million instances take 65 MB.
const LONGEST_ROOTS: u64 = 1 << 28;

/// The folder of one run: configuration at its start, events while it goes, metrics and roots at its end.
///
/// A service: what cannot be written ends no run, and is told at the end of it.
pub struct RunLog {
    folder: PathBuf,
    began: Instant,
    events: Mutex<Option<File>>,
    /// The first thing that could not be written.
    trouble: Mutex<Option<String>>,
}

impl RunLog {
    /// Begins the folder of a run that has something to do.
    pub fn begin(outputs: &Path, plan: &Plan) -> Self {
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let id = blake3::hash(format!("{} {}", now.as_nanos(), std::process::id()).as_bytes()).to_hex();
        let folder = outputs.join("runs").join(format!("{}-{}", timestamp(now.as_secs()), &id[..6]));
        let log = Self { folder, began: Instant::now(), events: Mutex::default(), trouble: Mutex::default() };
        log.noted(&log.folder, fs::create_dir_all(&log.folder));
        for (index, source) in plan.spec.sources.iter().enumerate() {
            log.file(&format!("{index}-{}", file_name_of(Path::new(&source.name))), &source.text);
        }
        let configuration = json!({
            "pipeline": plan.spec.pipeline, "overrides": plan.spec.overrides,
            "file": plan.spec.sources.first().map(|source| source.name.as_str()),
            "turbid_version": env!("CARGO_PKG_VERSION"),
            "stages": plan.needed.iter().map(|&s| {
                let row = plan.row(s);
                json!({"stage": plan.spec.stages[s].name, "use": row.name, "version": row.version, "instances": plan.instances_of(s).len()})
            }).collect::<Vec<_>>(),
        });
        log.file("configuration.json", &format!("{configuration:#}\n"));
        let path = log.folder.join("events.jsonl");
        *lock(&log.events) = log.noted(&path, OpenOptions::new().create(true).append(true).open(&path));
        log
    }

    fn file(&self, name: &str, text: &str) {
        let path = self.folder.join(name);
        self.noted(&path, whole_file::write(&path, ".new-", text.as_bytes(), Synced::No));
    }

    fn noted<T>(&self, path: &Path, done: io::Result<T>) -> Option<T> {
        let told = |error: io::Error| lock(&self.trouble).get_or_insert(format!("{}: {error}", path.display())).clone();
        done.map_err(told).ok()
    }

    fn event(&self, value: &Value) {
        // In one piece: a disk that runs full leaves no half of an event but the last.
        if let Some(file) = lock(&self.events).as_mut() {
            self.noted(&self.folder.join("events.jsonl"), file.write_all(format!("{value}\n").as_bytes()));
        }
    }

    /// Notes the roots of a part of long work, whose figures stand elsewhere.
    pub fn part(&self, plan: &Plan, summary: &Summary) {
        let made = plan.needed_instances().filter_map(|id| summary.brief(id));
        let roots: String = made.map(|brief| format!("{}\n", brief.key)).collect();
        let path = self.folder.join("roots");
        let file = OpenOptions::new().create(true).append(true).open(&path);
        self.noted(&path, file.and_then(|mut file| file.write_all(roots.as_bytes())));
    }

    /// The end of work that was noted in [parts](Self::part). Returns what could not be written of the log, if anything.
    pub fn end_of_parts(&self, hits: usize, ran: usize) -> Option<String> {
        self.finished(hits, ran, 0);
        lock(&self.trouble).take()
    }

    fn finished(&self, hits: usize, ran: usize, failed: usize) {
        let seconds = self.began.elapsed().as_secs_f64();
        self.event(&json!({"event": "finished", "hits": hits, "ran": ran, "failed": failed, "seconds": seconds}));
    }

    /// Writes roots, which instance each stands for, and metrics. Returns what could not be written of the log, if anything.
    pub fn end(&self, plan: &Plan, store: &Store, summary: &Summary) -> Option<String> {
        let made = || plan.needed_instances().filter_map(|id| Some((id, summary.brief(id)?)));
        self.long_file("roots", &|to| made().try_for_each(|(_, brief)| writeln!(to, "{}", brief.key)));
        self.long_file("instances.jsonl", &|to| {
            let line = |id: InstanceId, key: &Digest| json!({"instance": plan.label(id), "key": key.to_string()});
            made().try_for_each(|(id, brief)| writeln!(to, "{}", line(id, &brief.key)))
        });
        self.long_file("metrics.json", &|to| {
            let mut any = false;
            for id in plan.needed_instances() {
                let Some(End::Ran(brief)) = summary.ends.get(&id) else { continue };
                let Some(record) = store.record(&brief.key) else { continue };
                // As an array is written, without all of it in memory.
                let text = format!("{:#}", metrics(&plan.label(id), &brief.cost, &record)).replace('\n', "\n  ");
                write!(to, "{}\n  {text}", if any { "," } else { "[" })?;
                any = true;
            }
            to.write_all(if any { b"\n]\n" } else { b"[]\n" })
        });
        self.finished(summary.hits(), summary.ran(), summary.failed());
        lock(&self.trouble).take()
    }

    /// A file that is written line by line.
    fn long_file(&self, name: &str, write: &dyn Fn(&mut dyn Write) -> io::Result<()>) {
        let path = self.folder.join(name);
        let written = whole_file::begin(&self.folder, ".new-").and_then(|mut file| {
            let mut to = BufWriter::new(file.as_file_mut());
            write(&mut to)?;
            to.flush()?;
            drop(to);
            whole_file::place(file, &path, Synced::No)
        });
        self.noted(&path, written);
    }
}

fn metrics(label: &str, cost: &Cost, record: &InstanceRecord) -> Value {
    json!({
        "instance": label, "wall_s": cost.wall_s, "cpu_s": cost.cpu_s, "peak_bytes": cost.peak_bytes,
        "alone": cost.alone, "measures": record.measures, "warnings": record.warnings,
    })
}

/// Keys of the records that the latest runs named: what garbage collection removes last.
///
/// Error: something is there and cannot be read. A run that was killed has left no roots, and other things than files hold none.
pub fn roots(outputs: &Path) -> Result<Vec<Digest>, String> {
    let runs = outputs.join("runs");
    let failed = |path: &Path, error: io::Error| {
        format!("cannot read which results the latest runs named ({}): {error}; nothing was removed", path.display())
    };
    let mut folders: Vec<PathBuf> = match fs::read_dir(&runs) {
        Ok(entries) => entries.map(|entry| Ok(entry?.path())).collect::<io::Result<_>>(),
        Err(error) if is_absent(&error) => Ok(Vec::new()),
        Err(error) => Err(error),
    }
    .map_err(|error| failed(&runs, error))?;
    // Names begin with the time.
    folders.sort();
    let mut keys = Vec::new();
    for path in folders.iter().rev().take(LATEST_RUNS).map(|folder| folder.join("roots")) {
        match read_roots(&path) {
            Ok(text) => keys.extend(text.lines().filter_map(|line| line.parse::<Digest>().ok())),
            Err(error) if is_absent(&error) => {}
            Err(error) => return Err(failed(&path, error)),
        }
    }
    Ok(keys)
}

fn is_absent(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory)
}

/// Nothing where there is no file, or one longer than any.
fn read_roots(path: &Path) -> io::Result<String> {
    let file = match regular::open(path, OpenOptions::new().read(true)) {
        Ok(file) => file,
        Err(NotOpened::Odd(_)) => return Ok(String::new()),
        Err(NotOpened::Io(error)) => return Err(error),
    };
    let mut bytes = Vec::new();
    if file.metadata()?.len() <= LONGEST_ROOTS {
        file.take(LONGEST_ROOTS).read_to_end(&mut bytes)?;
    }
    // A damaged line is none.
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

/// One line for a run that found everything up to date. Returns why it could not be written, if so.
pub fn note_up_to_date(outputs: &Path, pipeline: &str, hits: usize) -> Option<String> {
    let line = json!({
        "time": timestamp(SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_secs())),
        "pipeline": pipeline, "hits": hits,
    });
    let path = outputs.join("runs").join("log.jsonl");
    let written = fs::create_dir_all(outputs.join("runs"))
        .and_then(|()| OpenOptions::new().create(true).append(true).open(&path))
        .and_then(|mut file| file.write_all(format!("{line}\n").as_bytes()));
    written.err().map(|error| format!("{}: {error}", path.display()))
}

/// Tells the log and somebody else.
pub struct Logged<'a> {
    pub log: &'a RunLog,
    pub progress: &'a dyn Progress,
}

impl Progress for Logged<'_> {
    fn started(&self, label: &str, reasons: &[String]) {
        self.log.event(&json!({"event": "started", "instance": label, "reasons": reasons}));
        self.progress.started(label, reasons);
    }
    fn advanced(&self, label: &str, done: f64, total: Option<f64>, unit: &str) {
        self.progress.advanced(label, done, total, unit);
    }
    fn ran(&self, label: &str, record: &InstanceRecord) {
        self.log.event(
            &json!({"event": "ran", "instance": label, "key": record.key.to_string(), "seconds": record.cost.wall_s}),
        );
        self.progress.ran(label, record);
    }
    fn found(&self, label: &str) {
        self.log.event(&json!({"event": "found", "instance": label}));
        self.progress.found(label);
    }
    fn failed(&self, label: &str, message: &str) {
        self.log.event(&json!({"event": "failed", "instance": label, "message": message}));
        self.progress.failed(label, message);
    }
    fn warn(&self, label: &str, message: &str) {
        self.log.event(&json!({"event": "warning", "instance": label, "message": message}));
        self.progress.warn(label, message);
    }
    fn ended(&self) {
        self.progress.ended();
    }
}

/// `20260131T235959Z` of seconds since 1970.
pub fn timestamp(seconds: u64) -> String {
    let (days, rest) = ((seconds / 86_400) as i64, seconds % 86_400);
    // Days since 0000-03-01 in years of 400-year eras (Howard Hinnant's civil calendar).
    let z = days + 719_468;
    let (era, day_of_era) = (z.div_euclid(146_097), z.rem_euclid(146_097));
    let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month_index = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month_index + 2) / 5 + 1;
    let month = if month_index < 10 { month_index + 3 } else { month_index - 9 };
    let year = year_of_era + era * 400 + i64::from(month <= 2);
    format!("{year:04}{month:02}{day:02}T{:02}{:02}{:02}Z", rest / 3600, rest / 60 % 60, rest % 60)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a run named is read, a run that was killed named nothing, and what cannot be read is an error.
    #[test]
    fn roots_that_cannot_be_read_are_no_empty_list() {
        let outputs = tempfile::tempdir().unwrap();
        assert_eq!(roots(outputs.path()), Ok(Vec::new()), "nothing has run");
        let (run, key) = (outputs.path().join("runs/20260101T000000Z-abcdef"), Digest::of(b"key"));
        fs::create_dir_all(&run).unwrap();
        fs::write(outputs.path().join("runs/log.jsonl"), "{}\n").unwrap();
        assert_eq!(roots(outputs.path()), Ok(Vec::new()));
        fs::write(run.join("roots"), format!("{key}\nno key\n")).unwrap();
        assert_eq!(roots(outputs.path()), Ok(vec![key]));
        #[cfg(unix)]
        {
            // A link to itself cannot be opened, and is not absent either.
            fs::remove_file(run.join("roots")).unwrap();
            std::os::unix::fs::symlink(run.join("roots"), run.join("roots")).unwrap();
            let message = roots(outputs.path()).unwrap_err();
            assert!(message.contains("roots") && message.ends_with("nothing was removed"), "{message}");
        }
    }

    #[test]
    fn timestamps_are_civil_dates() {
        assert_eq!(timestamp(0), "19700101T000000Z");
        assert_eq!(timestamp(951_782_399), "20000228T235959Z");
        assert_eq!(timestamp(951_782_400), "20000229T000000Z");
        assert_eq!(timestamp(4_102_444_800), "21000101T000000Z");
    }
}
