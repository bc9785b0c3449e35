//! `outputs/runs` read again: what ran, when, from which file, and how it ended.

use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::brief::Measure;
use crate::input_file;

use super::measures::errors;

/// Bytes of a file of a run; a longer one is none of ours.
const MOST: u64 = 64 << 20;
/// So many lines are read of the list of runs that had nothing to do.
const MOST_HITS: usize = 1000;

/// One run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Run {
    /// Name of its folder; empty for a run that had nothing to do.
    pub id: String,
    /// `20260131T235959Z`
    pub time: String,
    pub pipeline: String,
    pub file: Option<String>,
    pub overrides: Vec<String>,
    pub hits: u64,
    pub ran: u64,
    pub failed: u64,
    /// `None` where it has no end: killed, or still running.
    pub seconds: Option<f64>,
    pub ended: bool,
    /// What the last stage that ran and knows its error says of it.
    pub error: String,
    /// Instances that failed, with the reason.
    pub failures: Vec<(String, String)>,
}

/// The runs in the order of their time, the latest last; at most so many, and so many that had nothing to do.
pub fn runs(outputs: &Path, most: usize) -> Vec<Run> {
    let folder = outputs.join("runs");
    let names = names(outputs);
    let skipped = names.len().saturating_sub(most);
    let mut found: Vec<Run> = names[skipped..].iter().map(|name| run(&folder, name)).collect();
    found.extend(hits(&folder, most));
    found.sort_by(|a, b| (&a.time, &a.id).cmp(&(&b.time, &b.id)));
    found.drain(..found.len().saturating_sub(most));
    found
}

/// Names of the folders of all runs; they begin with the time.
pub fn names(outputs: &Path) -> Vec<String> {
    let entries = fs::read_dir(outputs.join("runs")).into_iter().flatten().flatten();
    let folders = entries.filter(|entry| entry.path().is_dir());
    let mut names: Vec<String> = folders.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

/// The run of this folder. What cannot be read of it is not known.
pub fn run(folder: &Path, name: &str) -> Run {
    let path = folder.join(name);
    let configuration = json(&path.join("configuration.json")).unwrap_or_default();
    let text = |key: &str| configuration[key].as_str().map(str::to_owned);
    let mut run = Run {
        id: name.to_owned(),
        time: name.split('-').next().unwrap_or_default().to_owned(),
        pipeline: text("pipeline").unwrap_or_default(),
        file: text("file"),
        overrides: configuration["overrides"]
            .as_array()
            .into_iter()
            .flatten()
            .filter_map(|given| given.as_str().map(str::to_owned))
            .collect(),
        ..Run::default()
    };
    let events = read(&path.join("events.jsonl")).unwrap_or_default();
    for event in events.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok()) {
        let word = |key: &str| event[key].as_str().unwrap_or_default().to_owned();
        let count = |key: &str| event[key].as_u64().unwrap_or(0);
        match event["event"].as_str() {
            Some("ran") => run.ran += 1,
            Some("failed") => run.failures.push((word("instance"), word("message"))),
            Some("finished") => {
                (run.hits, run.ran, run.failed) = (count("hits"), count("ran"), count("failed"));
                (run.seconds, run.ended) = (event["seconds"].as_f64(), true);
            }
            _ => {}
        }
    }
    run.failed = run.failed.max(run.failures.len() as u64);
    run.error = error(&json(&path.join("metrics.json")).unwrap_or_default());
    run
}

/// The instances that a run made or found: label (of older runs none) and key of each; inputs first.
pub fn instances(folder: &Path, name: &str) -> Vec<(Option<String>, String)> {
    let one = |line: &str| {
        let found: Value = serde_json::from_str(line).ok()?;
        Some((Some(found["instance"].as_str()?.to_owned()), found["key"].as_str()?.to_owned()))
    };
    match read(&folder.join(name).join("instances.jsonl")) {
        Some(text) => text.lines().filter_map(one).collect(),
        None => {
            let keys = read(&folder.join(name).join("roots")).unwrap_or_default();
            keys.lines().map(|key| (None, key.to_owned())).collect()
        }
    }
}

/// The error of the last stage that measured one.
fn error(metrics: &Value) -> String {
    let mut last = (String::new(), Vec::new());
    for one in metrics.as_array().into_iter().flatten() {
        let measures: Vec<Measure> = serde_json::from_value(one["measures"].clone()).unwrap_or_default();
        if errors(std::iter::once(measures.as_slice())).is_empty() {
            continue;
        }
        let stage = one["instance"].as_str().unwrap_or_default().split('[').next().unwrap_or_default().to_owned();
        if stage != last.0 {
            last = (stage, Vec::new());
        }
        last.1.push(measures);
    }
    let (stage, measures) = last;
    let said = errors(measures.iter().map(Vec::as_slice));
    if said.is_empty() { said } else { format!("{stage}: {said}") }
}

/// Runs that had nothing to do: a line each.
fn hits(folder: &Path, most: usize) -> Vec<Run> {
    let text = read(&folder.join("log.jsonl")).unwrap_or_default();
    let lines = text.lines().rev().take(most.min(MOST_HITS));
    let run = |line: &str| {
        let found: Value = serde_json::from_str(line).ok()?;
        Some(Run {
            time: found["time"].as_str()?.to_owned(),
            pipeline: found["pipeline"].as_str()?.to_owned(),
            hits: found["hits"].as_u64()?,
            ended: true,
            ..Run::default()
        })
    };
    lines.filter_map(run).collect()
}

/// What failed in the last run of this pipeline that had something to do.
pub fn last_failures(outputs: &Path, pipeline: &str) -> Vec<(String, String)> {
    let of = |run: &Run| run.pipeline == pipeline && !run.id.is_empty();
    // Of several pipelines in one folder the last of this one may lie further back.
    runs(outputs, 32).into_iter().rev().find(of).map(|run| run.failures).unwrap_or_default()
}

fn read(path: &Path) -> Option<String> {
    let bytes = input_file::read(path, MOST).ok()?;
    Some(String::from_utf8_lossy(&bytes).into_owned())
}

fn json(path: &Path) -> Option<Value> {
    serde_json::from_str(&read(path)?).ok()
}

/// `2026-01-31 23:59:59 UTC` of seconds since 1970.
pub fn timestamp_text(seconds: u64) -> String {
    time_text(&crate::run::log::timestamp(seconds))
}

/// The same of `20260131T235959Z`; other text as it is.
pub fn time_text(stamp: &str) -> String {
    let part = |from: usize, to: usize| stamp.get(from..to).unwrap_or_default();
    if stamp.len() != 16 || !stamp.is_ascii() {
        return stamp.to_owned();
    }
    format!("{}-{}-{} {}:{}:{} UTC", part(0, 4), part(4, 6), part(6, 8), part(9, 11), part(11, 13), part(13, 15))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn write(folder: &Path, name: &str, text: &str) {
        fs::create_dir_all(folder).unwrap();
        fs::write(folder.join(name), text).unwrap();
    }

    /// Runs in the order of time, one without an end, one that had nothing to do, and one that is damaged.
    #[test]
    fn runs_are_read_again() {
        let outputs = tempfile::tempdir().unwrap();
        let at = |name: &str| outputs.path().join("runs").join(name);
        assert!(runs(outputs.path(), 10).is_empty());
        let one = at("20260101T000000Z-aaaaaa");
        write(&one, "configuration.json", r#"{"pipeline": "p", "file": "p.yaml", "overrides": ["vars.n=2"]}"#);
        write(
            &one,
            "events.jsonl",
            "{\"event\":\"ran\",\"instance\":\"a\"}\n{\"event\":\"failed\",\"instance\":\"b\",\"message\":\"no\"}\n{\"event\":\"finished\",\"hits\":3,\"ran\":1,\"failed\":1,\"seconds\":2.5}\n",
        );
        write(
            &one,
            "metrics.json",
            r#"[{"instance": "a[x=1]", "measures": [["error: worst bias", 2.5, "%"]]}, {"instance": "c", "measures": [["flights", 9, "1"]]}]"#,
        );
        write(&at("20260103T000000Z-bbbbbb"), "events.jsonl", "{\"event\":\"ran\"}\n{\"event\":\"fini");
        write(
            &outputs.path().join("runs"),
            "log.jsonl",
            "{\"time\":\"20260102T000000Z\",\"pipeline\":\"p\",\"hits\":4}\nno\n",
        );
        let found = runs(outputs.path(), 10);
        let [first, second, third] = &found[..] else { panic!("{found:?}") };
        assert_eq!((first.hits, first.ran, first.failed, first.seconds), (3, 1, 1, Some(2.5)));
        assert_eq!(
            (first.error.as_str(), &first.overrides[..]),
            ("a: 2.50 % worst bias", &["vars.n=2".to_owned()][..])
        );
        assert_eq!((second.hits, second.id.as_str(), second.ended), (4, "", true));
        assert_eq!((third.ran, third.ended, third.pipeline.as_str()), (1, false, ""));
        assert_eq!(last_failures(outputs.path(), "p"), [("b".to_owned(), "no".to_owned())]);
        assert_eq!(runs(outputs.path(), 1).len(), 1);
        assert_eq!(time_text("20260131T235959Z"), "2026-01-31 23:59:59 UTC");
    }
}
