//! `turbid study`: error against run time, point by point, as a table, CSV and picture.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use serde_json::{Value, json};
use turbid_contract::Artifact;
use turbid_tables::study::{OF_NOISE, Slope, points as over_repeats, slopes};

use crate::plan::Plan;
use crate::plan::shard::Shard;
use crate::registry::Registry;
use crate::resolve::Survey;
use crate::run::latest::file_name;
use crate::run::progress::{Json, Work, choose};
use crate::run::{Interrupt, Options, Progress};
use crate::spec::{self, SourceFile, StudySpec, nearest};
use crate::store::{self, Store};
use crate::study::plot::{Mark, Plot, Series};
use crate::study::points::{effort, points as all_points};
use crate::study::studied::{Counts, Row, Stopped, Studying, mistakes};
use crate::study::table::{csv, table, unit_of};
use crate::study::{Found, Point};
use crate::threads;
use crate::whole_file;

use super::memory::{MemoryLimit, too_large};
use super::part::told_of_shard;
use super::simd::simd_level;
use super::{Done, Failure, Pipeline, print};

/// Bytes of a file of points of others.
const MOST_REFERENCE: u64 = 8 << 20;

#[derive(Args)]
pub struct Study {
    #[command(flatten)]
    pub(super) pipeline: Pipeline,
    /// The study; all of the file by default
    pub(super) name: Option<String>,
    /// Threads to use; all of the machine by default
    #[arg(short = 'j', long = "jobs", value_name = "N", value_parser = threads::parse)]
    pub(super) jobs: Option<usize>,
    #[command(flatten)]
    pub(super) memory: MemoryLimit,
    /// Print events as JSON lines
    #[arg(long)]
    pub(super) json: bool,
    /// Only these of its points, and no table: `turbid run FILE NAME --shard K/N`.
    #[arg(skip)]
    pub(super) shard: Option<Shard>,
}

impl Study {
    pub fn run(&self, registry: &Registry) -> Done {
        let plan = self.pipeline.plan_of_first_points(registry)?;
        let wrong = mistakes(&plan);
        if !wrong.is_empty() {
            return Err(spec::Report::from(wrong).into());
        }
        let studies: Vec<&StudySpec> = match &self.name {
            None => plan.spec.studies.iter().collect(),
            Some(name) => {
                let found = plan.spec.studies.iter().find(|study| study.name == *name);
                let names = || plan.spec.studies.iter().map(|study| study.name.as_str());
                let hint = || match (nearest(name, names()), plan.spec.studies.is_empty()) {
                    (Some(near), _) => format!("; did you mean `{near}`?"),
                    (None, true) => "; it has none".to_owned(),
                    (None, false) => format!("; it has {}", names().collect::<Vec<_>>().join(", ")),
                };
                let none = || {
                    Failure::Input(format!("there is no study `{name}` in pipeline `{}`{}", plan.spec.pipeline, hint()))
                };
                vec![found.ok_or_else(none)?]
            }
        };
        if studies.is_empty() {
            let text = format!(
                "pipeline `{}` has no studies: add `studies: {{NAME: {{vary: .., estimate: .., truth: .., error: ..}}}}`",
                plan.spec.pipeline
            );
            return Err(Failure::Input(text));
        }
        let outputs = self.pipeline.outputs.path();
        let open = if self.shard.is_some() { Store::open_for_shard } else { Store::open };
        let store = open(outputs).map_err(|e| Failure::Input(e.to_string()))?;
        let interrupt = Interrupt::listen().map_err(|e| Failure::Failed(format!("signals: {e}")))?;
        let mut failed = 0;
        for study in studies {
            failed += self.study(study, &plan, registry, &store, &interrupt)?;
        }
        if failed > 0 { Err(Failure::Said) } else { Ok(()) }
    }

    /// Runs one study; how many of its points failed.
    fn study(
        &self,
        study: &StudySpec,
        plan: &Plan,
        registry: &Registry,
        store: &Store,
        interrupt: &Interrupt,
    ) -> Result<usize, Failure> {
        let began = Instant::now();
        let reference = study.reference.as_ref().map(|name| self.reference(name)).transpose()?;
        let outputs = self.pipeline.outputs.path();
        let jobs = self.jobs.unwrap_or_else(threads::of_machine);
        let budget = self.memory.budget(jobs);
        let options = Options {
            jobs,
            keep_going: true,
            force: Vec::new(),
            replace: false,
            simd: simd_level()?,
            keep_states: true,
            memory: budget.as_ref().map(|budget| budget.bytes),
            live: None,
        };
        let progress =
            |work: &Work| -> Box<dyn Progress> { if self.json { choose(true, work) } else { Box::new(Quiet) } };
        let refused = |plan: &Plan, survey: &Survey| too_large(plan, survey, self.memory.budget(jobs));
        let total = all_points(study).len();
        let told =
            |point: &Point, done: usize, found: &Result<Found, String>| self.told(study, point, (done, total), found);
        let studying = Studying {
            file: &self.pipeline.file,
            overrides: &self.pipeline.set,
            study,
            registry,
            store,
            outputs,
            options: &options,
            interrupt,
            progress: &progress,
            refused: &refused,
            told: &told,
        };
        let stopped = |stopped| match stopped {
            Stopped::Failed(message) => Failure::Failed(message),
            Stopped::Interrupted => Failure::Interrupted,
        };
        if let Some(shard) = self.shard {
            let (points, counts) = studying.make(shard).map_err(stopped)?;
            let failed = points.iter().filter(|found| found.is_err()).count();
            let counts = (points.len() - failed, counts.hits, counts.ran);
            told_of_shard((shard, self.json), ("points", &study.name), counts, began.elapsed().as_secs_f64());
            return Ok(failed);
        }
        let (rows, counts) = studying.run().map_err(stopped)?;
        let table = table(study, &rows);
        let told = |e: turbid_tables::Error| Failure::Failed(e.to_string());
        let means = over_repeats(&table, study.error.starts_with("bias")).map_err(told)?;
        let slopes = slopes(&table).map_err(told)?;
        let unit = rows.iter().find_map(|row| row.found.as_ref().ok()).map_or("", |found| found.unit.as_str());
        let unit = unit_of(&study.error, unit).to_owned();
        let picture = plot(plan, study, &rows, &means, &slopes, &unit, reference.as_deref().unwrap_or_default()).svg();
        let folder =
            outputs.join("latest").join(file_name(&plan.spec.pipeline)).join("studies").join(file_name(&study.name));
        let parquet = store::encode(&Artifact::Table(table.clone())).map_err(|e| Failure::Failed(e.to_string()))?;
        write(&folder, "study.parquet", &parquet)?;
        write(&folder, "study.csv", csv(&table).as_bytes())?;
        match &picture {
            Some(svg) => write(&folder, "study.svg", svg.as_bytes())?,
            // That of an earlier run shows what is no more.
            None => drop(std::fs::remove_file(folder.join("study.svg"))),
        }
        let failed = rows.iter().filter(|row| row.found.is_err()).count();
        let closing = Closing {
            study,
            rows: &rows,
            means: &means,
            slopes: &slopes,
            unit: &unit,
            folder: &folder,
            counts,
            seconds: began.elapsed().as_secs_f64(),
            picture: picture.is_some(),
        };
        let found = serde_json::to_string_pretty(&closing.found()).expect("texts");
        write(&folder, crate::report::studies::FILE, found.as_bytes())?;
        self.closing(&closing);
        Ok(failed)
    }

    /// Points of others: label, CPU seconds, error.
    fn reference(&self, name: &str) -> Result<Vec<(String, f64, f64)>, Failure> {
        let path = self.pipeline.file.parent().unwrap_or(Path::new("")).join(name);
        let failed = |what: String| Failure::Input(format!("the reference {}: {what}", path.display()));
        let file = SourceFile::read(&path, "a CSV file", MOST_REFERENCE).map_err(failed)?;
        let table = spec::csv::parse(&file.text).map_err(failed)?;
        let column = |name: &str| table.names.iter().position(|n| n == name);
        let needed = |name: &str| {
            column(name).ok_or_else(|| failed(format!("it has no column `{name}`; it has {}", table.names.join(", "))))
        };
        let (seconds, error, label) = (needed("cpu_seconds")?, needed("error")?, column("label"));
        let number = |row: &[Value], k: usize| {
            row[k].as_f64().filter(|v| v.is_finite()).ok_or_else(|| failed(format!("`{}` is no number", row[k])))
        };
        let labelled = |row: &[Value]| label.and_then(|k| row[k].as_str()).unwrap_or("others").to_owned();
        table.rows.iter().map(|row| Ok((labelled(row), number(row, seconds)?, number(row, error)?))).collect()
    }

    /// A line for each point that ended.
    fn told(&self, study: &StudySpec, point: &Point, (done, total): (usize, usize), found: &Result<Found, String>) {
        if self.json {
            let paths = study.vary.iter().map(|(path, _)| path.clone()).zip(point.values.iter().cloned());
            let values: serde_json::Map<String, Value> = paths.collect();
            let failed = found.as_ref().err();
            let errors = found.as_ref().ok().map(|found| found.errors);
            Json::event(json!({
                "event": "point", "study": study.name, "values": values, "repeat": point.repeat, "done": done, "of": total,
                "error": errors.and_then(|e| e.error), "stated_se": errors.and_then(|e| e.stated), "failed": failed,
            }));
            return;
        }
        let label = point.label(study);
        let said = match found {
            Err(message) => format!("failed: {message}"),
            Ok(found) => {
                let cpu: f64 = found.spent.values().map(|s| s.cpu_s).sum();
                let unit = unit_of(&study.error, &found.unit);
                let error = found.errors.error.map_or(String::new(), |e| format!("{} {}, ", digits(e), unit));
                format!("{error}{} CPU s", digits(cpu))
            }
        };
        crate::terminal::tell(&format!("{done}/{total} {label}: {said}"));
    }

    fn closing(&self, closing: &Closing<'_>) {
        let Closing { study, rows, means, slopes, folder, counts, seconds, picture, .. } = closing;
        let Counts { hits, ran } = counts;
        let failed = rows.iter().filter(|row| row.found.is_err()).count();
        if self.json {
            for mean in *means {
                Json::event(json!({
                    "event": "study_point", "study": study.name, "series": mean.series, "point": mean.point, "repeats": mean.n, "error": mean.error,
                    "stated_se": mean.stated, "ratio": mean.ratio, "cpu_seconds": mean.cpu_seconds, "efficiency": mean.efficiency,
                }));
            }
            for slope in *slopes {
                Json::event(json!({
                    "event": "slope", "study": study.name, "series": slope.series, "slope": slope.slope, "interval": slope.interval, "floor": slope.floor,
                }));
            }
            Json::event(json!({
                "event": "finished", "study": study.name, "points": rows.len(), "failed": failed, "hits": hits, "ran": ran, "seconds": seconds,
            }));
            return;
        }
        let head = ["study", "point", "error", "stated", "error / stated (95 %)", "CPU s", "1 / (error^2 CPU s)"];
        let mut lines = vec![head.map(str::to_owned).to_vec()];
        lines.extend(closing.lines().into_iter().map(|line| [vec![study.name.clone()], line.to_vec()].concat()));
        let mut text = crate::report::figures::aligned(&lines);
        for line in closing.slopes_said().iter().chain(&closing.failures()) {
            text += &format!("{line}\n");
        }
        let files = if *picture { "study.svg, study.csv, study.parquet" } else { "study.csv, study.parquet" };
        text += &format!(
            "{} points, {failed} failed; {hits} up to date, {ran} ran in {seconds:.2} s\n{}: {files}",
            rows.len(),
            folder.display()
        );
        print(&text);
    }
}

/// What a study ended with.
struct Closing<'a> {
    study: &'a StudySpec,
    rows: &'a [Row],
    means: &'a [turbid_tables::study::Point],
    slopes: &'a [Slope],
    unit: &'a str,
    folder: &'a Path,
    counts: Counts,
    seconds: f64,
    picture: bool,
}

impl Closing<'_> {
    /// Of each point: what it is, its error, what it states, their ratio, CPU seconds, efficiency.
    fn lines(&self) -> Vec<[String; 6]> {
        let Self { study, means, unit, .. } = self;
        let points = all_points(study);
        let once = StudySpec { repeats: 1, ..(*study).clone() };
        let line = |mean: &turbid_tables::study::Point| {
            let point = &points[mean.point as usize * study.repeats as usize];
            let label = Point { repeat: 0, ..point.clone() }.label(&once);
            let number = |v: Option<f64>| v.map_or("-".to_owned(), digits);
            let with = |v: Option<f64>| v.map_or("-".to_owned(), |v| format!("{} {unit}", digits(v)));
            let ratio = mean.ratio.map_or("-".to_owned(), |[r, low, high]| format!("{r:.2} ({low:.2} to {high:.2})"));
            // No error is a limit, not a point at minus infinity of a logarithm.
            let error = if mean.error == Some(0.0) { "0 (exact)".to_owned() } else { with(mean.error) };
            [label, error, with(mean.stated), ratio, number(mean.cpu_seconds), number(mean.efficiency)]
        };
        means.iter().map(line).collect()
    }

    fn slopes_said(&self) -> Vec<String> {
        let with_truth = self.study.truth.is_some();
        let line = |slope: &Slope| {
            let name = if slope.series.is_empty() { String::new() } else { format!("{}: ", slope.series) };
            format!("{name}{}", said(slope, with_truth))
        };
        self.slopes.iter().map(line).collect()
    }

    /// Points without an error: each reason once.
    fn failures(&self) -> Vec<String> {
        let mut reasons: Vec<(&str, Vec<String>)> = Vec::new();
        for row in self.rows {
            let Err(message) = &row.found else { continue };
            match reasons.iter_mut().find(|(known, _)| known == message) {
                Some((_, labels)) => labels.push(row.point.label(self.study)),
                None => reasons.push((message, vec![row.point.label(self.study)])),
            }
        }
        let line = |(message, labels): (&str, Vec<String>)| {
            let more = if labels.len() > 1 { format!(" and {} more", labels.len() - 1) } else { String::new() };
            format!("failed: {}{more}: {message}", labels[0])
        };
        reasons.into_iter().map(line).collect()
    }

    /// The same for the report.
    fn found(&self) -> Value {
        let names = ["point", "error", "stated", "ratio", "cpu_seconds", "efficiency"];
        let points = self.lines().into_iter().map(|line| {
            names.iter().map(|name| (*name).to_owned()).zip(line.map(Value::from)).collect::<serde_json::Map<_, _>>()
        });
        json!({
            "study": self.study.name, "definition": crate::report::studies::definition(self.study),
            "points": points.collect::<Vec<_>>(), "slopes": self.slopes_said(), "failed": self.failures(),
        })
    }
}

/// The slope in words. The scatter of repeats is noise alone: that it falls more slowly than noise tells of a bias where there is a truth.
fn said(slope: &Slope, with_truth: bool) -> String {
    let interval = slope.interval.map_or(String::new(), |[low, high]| format!(" ({low:.2} to {high:.2})"));
    let floor = if slope.floor && with_truth {
        format!("; noise falls with {OF_NOISE}: something else than noise stays, however long it runs")
    } else {
        String::new()
    };
    format!("error ~ time^{:.2}{interval}{floor}", slope.slope)
}

/// Two or three digits.
fn digits(value: f64) -> String {
    match value.abs() {
        v if v >= 99_999.5 => format!("{value:.1e}"),
        v if v >= 99.5 => format!("{value:.0}"),
        v if v >= 9.95 => format!("{value:.1}"),
        v if v >= 0.0995 => format!("{value:.2}"),
        0.0 => "0".to_owned(),
        _ => format!("{value:.1e}"),
    }
}

fn plot(
    plan: &Plan,
    study: &StudySpec,
    rows: &[Row],
    means: &[turbid_tables::study::Point],
    slopes: &[Slope],
    unit: &str,
    reference: &[(String, f64, f64)],
) -> Plot {
    let mut series: Vec<Series> = Vec::new();
    for mean in means {
        let errors =
            |k: usize| rows.get(k).and_then(|row| row.found.as_ref().ok()).and_then(|found| found.errors.error);
        let first = mean.point as usize * study.repeats as usize;
        let all: Vec<f64> = (first..first + study.repeats as usize).filter_map(errors).map(f64::abs).collect();
        let ends = [all.iter().copied().reduce(f64::min), all.iter().copied().reduce(f64::max)];
        let Some((error, seconds)) = mean.error.zip(mean.cpu_seconds).filter(|(e, s)| *e > 0.0 && *s > 0.0) else {
            continue;
        };
        let mark = Mark { seconds, error, stated: mean.stated, span: ends[0].zip(ends[1]).map(|(a, b)| [a, b]) };
        match series.iter_mut().find(|known| known.name == mean.series) {
            Some(known) => known.points.push(mark),
            None => series.push(Series { name: mean.series.clone(), points: vec![mark], ..Series::default() }),
        }
    }
    for own in &mut series {
        let own_slope = slopes.iter().find(|s| s.series == own.name);
        own.note = own_slope.map(|slope| said(slope, study.truth.is_some())).unwrap_or_default();
        if own.name.is_empty() {
            own.name = study.estimate.clone();
        }
    }
    let mut others: BTreeMap<&str, Vec<Mark>> = BTreeMap::new();
    for (label, seconds, error) in reference.iter().filter(|(_, s, e)| *s > 0.0 && *e > 0.0) {
        others.entry(label).or_default().push(Mark { seconds: *seconds, error: *error, stated: None, span: None });
    }
    series.extend(others.into_iter().map(|(name, points)| Series {
        name: name.to_owned(),
        points,
        reference: true,
        ..Series::default()
    }));
    let varied = effort(study).map_or(String::new(), |k| format!(", {}", study.vary[k].0));
    let what = study.error.trim_end_matches("_percent").replace('_', " ");
    Plot {
        title: format!("{} · {}{varied}", plan.spec.pipeline, study.name),
        y_name: format!("{what} of {} ({unit}); bars: stated", study.estimate),
        series,
    }
}

fn write(folder: &Path, name: &str, bytes: &[u8]) -> Done {
    let path: PathBuf = folder.join(name);
    let failed = |e: std::io::Error| Failure::Failed(format!("{}: {e}", path.display()));
    std::fs::create_dir_all(folder).map_err(failed)?;
    whole_file::write(&path, ".new-", bytes, whole_file::Synced::No).map_err(failed)
}

/// Says nothing but warnings: a line for each point is enough.
struct Quiet;

impl Progress for Quiet {
    fn started(&self, _: &str, _: &[String]) {}
    fn advanced(&self, _: &str, _: f64, _: Option<f64>, _: &str) {}
    fn ran(&self, _: &str, _: &store::InstanceRecord) {}
    fn found(&self, _: &str) {}
    fn failed(&self, _: &str, _: &str) {}
    fn warn(&self, _: &str, _: &str) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_few_digits() {
        assert_eq!(
            [6.385e12, 1234.4, 12.345, 1.2345, 0.012_345, 0.0].map(digits),
            ["6.4e12", "1234", "12.3", "1.23", "1.2e-2", "0"]
        );
        let slope = Slope { series: String::new(), slope: -0.1, interval: Some([-0.2, 0.0]), floor: true };
        assert!(said(&slope, true).contains("something else than noise stays"));
        assert!(!said(&slope, false).contains("noise"));
    }
}
