//! The plan of a point, and what is stale of it.

use std::path::Path;

use crate::estimate::estimates;
use crate::plan::{Plan, Target};
use crate::registry::Registry;
use crate::resolve::{Resolver, State};
use crate::spec::{self, Report, Severity, Spec, StudySpec};
use crate::store::Store;

use super::points::{Point, points as all};

/// What there is to do for a point.
#[derive(Clone, Debug, PartialEq)]
pub struct PointAhead {
    /// `accuracy: samples = 64, repeat 1`
    pub label: String,
    pub hits: usize,
    pub stale: usize,
    /// CPU seconds that what is stale takes.
    pub cpu_s: f64,
}

/// All points of a study, in the order of [`points`](all).
///
/// Error: the first point that cannot be run, and why.
pub fn points(
    file: &Path,
    overrides: &[String],
    study: &StudySpec,
    registry: &Registry,
    store: &Store,
) -> Result<Vec<PointAhead>, String> {
    let points = all(study);
    let look = |point: &Point| {
        let label = format!("{}: {}", study.name, point.label(study));
        let plan = plan(file, overrides, study, registry, point).map_err(|what| format!("{label}: {what}"))?;
        let resolver = Resolver::new(&plan, store);
        let survey = resolver.survey(&[]);
        let report = Report::from(survey.problems.clone());
        if report.has_errors() {
            return Err(format!("{label}: {}", first(&report)));
        }
        let is_hit = |state: &&State| matches!(state, State::Hit(_));
        let (hits, known) =
            (survey.states.iter().flatten().filter(is_hit).count(), survey.states.iter().flatten().count());
        let cpu_s = if hits < known { estimates(&resolver, &survey).values().map(|of| of.seconds).sum() } else { 0.0 };
        Ok(PointAhead { label, hits, stale: known - hits, cpu_s })
    };
    points.iter().map(look).collect()
}

/// The plan of what a study looks at, at one of its points.
pub fn plan(
    file: &Path,
    overrides: &[String],
    study: &StudySpec,
    registry: &Registry,
    point: &Point,
) -> Result<Plan, String> {
    let overrides = [overrides, &point.overrides(study)].concat();
    let (spec, report) = spec::read(file, &overrides);
    let Some(spec) = spec.filter(|_| !report.has_errors()) else { return Err(first(&report)) };
    let spec = spec.repeated(point.repeat);
    let names = [Some(&study.estimate), study.truth.as_ref()];
    let texts = names.into_iter().flatten().chain(&study.also);
    let targets: Vec<Target> = texts.map(|text| target(text, &spec, registry)).collect();
    let plan = Plan::build(spec, report, registry, &targets).map_err(|report| first(&report))?;
    Ok(plan.without_previews())
}

/// The stage of a quantity, and its port where it names one.
fn target(text: &str, spec: &Spec, registry: &Registry) -> Target {
    let mut words = text.split('.');
    let stage = words.next().unwrap_or_default().to_owned();
    let row = spec.stage(&stage).and_then(|id| registry.find(&spec.stages[id].use_name));
    let port = words.next().filter(|word| row.is_some_and(|row| (row.outputs)().iter().any(|p| p.name == *word)));
    Target { stage, port: port.map(str::to_owned) }
}

/// The first thing that keeps a point from being run.
pub fn first(report: &Report) -> String {
    let all = report.diagnostics();
    let error = all.iter().find(|d| d.severity == Severity::Error);
    error.map(|error| error.in_short()).unwrap_or_else(|| "it cannot be run".to_owned())
}
