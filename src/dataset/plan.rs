//! A data set joined with its pipeline: features, limits, splits.

use std::collections::BTreeSet;

use turbid_contract::Form;

use crate::dataset::feature::{Feature, Shape, can_be};
use crate::dataset::split::{self, Split};
use crate::plan::{Plan, StageId, Target};
use crate::registry::Registry;
use crate::spec::{DRAW_AXIS, DatasetSpec, Diagnostic, Draw, KeepSpec, Kind, Mistake, Report, Spec, nearest};

/// A data set that can be built.
pub struct DatasetPlan {
    pub spec: DatasetSpec,
    pub features: Vec<Feature>,
    pub keep: Vec<Keep>,
    /// The stage that draws.
    pub draws: StageId,
    pub splits: Vec<Split>,
    /// What a run must bring up to date.
    pub targets: Vec<Target>,
}

/// A limit with what it is on.
#[derive(Clone, Debug)]
pub struct Keep {
    pub spec: KeepSpec,
    pub stage: StageId,
    pub on: Limited,
}

#[derive(Clone, Debug, PartialEq)]
pub enum Limited {
    Measure(String),
    Column { port: &'static str, column: String },
}

impl DatasetPlan {
    /// Joins the data set of this name (the only one where none is given) with a plan of the whole file.
    pub fn build(plan: &Plan, name: Option<&str>) -> Result<Self, Report> {
        let spec = named(&plan.spec, name)?.clone();
        let mut problems = Vec::new();
        let mut features = Vec::new();
        for feature in &spec.sample {
            match Feature::find(feature, plan, &["datasets", &spec.name, "sample", &feature.name]) {
                Ok(found) => features.push(found),
                Err(problem) => problems.push(*problem),
            }
        }
        for feature in &features {
            problems.extend(of_one_sample(plan, &spec, feature));
        }
        let drawn: BTreeSet<StageId> = features.iter().filter_map(|f| plan.draw_of(f.stage)).map(|(s, _)| s).collect();
        if drawn.len() > 1 {
            let names: Vec<&str> = drawn.iter().map(|&stage| plan.spec.stages[stage].name.as_str()).collect();
            let message = format!("the features belong to the points of several stages: {}", names.join(", "));
            let mistake = Mistake::new(Kind::Graph, message);
            problems.push(plan.spec.at_path(&["datasets", &spec.name, "sample"], mistake, None));
        }
        let Some((&draws, draw)) = drawn.iter().next().and_then(|d| Some((d, plan.draw_of(*d)?.1))) else {
            return Err(reported(problems));
        };
        problems.extend(unknown_names(plan, &spec, (draws, draw)));
        let keep: Vec<Keep> = spec
            .keep
            .iter()
            .filter_map(|limit| match Keep::find(limit, plan, &spec) {
                Ok(keep) => Some(keep),
                Err(problem) => {
                    problems.push(*problem);
                    None
                }
            })
            .collect();
        if !problems.is_empty() {
            return Err(reported(problems));
        }
        let mut targets: Vec<Target> = Vec::new();
        let ports = features.iter().map(|feature| (feature.stage, Some(feature.port)));
        let limits = keep.iter().map(|keep| match keep.on {
            Limited::Measure(_) => (keep.stage, None),
            Limited::Column { port, .. } => (keep.stage, Some(port)),
        });
        for (stage, port) in ports.chain(limits) {
            let target = Target { stage: plan.spec.stages[stage].name.clone(), port: port.map(str::to_owned) };
            if !targets.contains(&target) {
                targets.push(target);
            }
        }
        let splits = split::assign(&spec, draw, plan.spec.seed);
        Ok(Self { spec, features, keep, draws, splits, targets })
    }

    /// The plan of the samples of these raw indices (ascending).
    pub fn of_samples(&self, plan: &Plan, registry: &Registry, indices: &[u64]) -> Result<Plan, Report> {
        let spec = plan.spec.with_points(self.draws, indices);
        let fresh = Plan::build(spec, Report::default(), registry, &self.targets)?;
        Ok(fresh.without_previews())
    }

    /// What the features will hold, by the forms of one sample's outputs; nothing where a form is open.
    pub fn shapes(&self, form: impl Fn(&Feature) -> Option<Form>, plan: &Plan) -> Result<Vec<Option<Shape>>, Report> {
        let mut problems = Vec::new();
        let mut shapes = Vec::new();
        for feature in &self.features {
            let shape = form(feature).map_or(Ok(None), |form| feature.shape_of(&form));
            shapes.push(shape.unwrap_or_else(|message| {
                let at = ["datasets", &self.spec.name, "sample", &feature.spec.name];
                problems.push(plan.spec.at_path(&at, Mistake::new(Kind::Graph, message), None));
                None
            }));
        }
        if problems.is_empty() { Ok(shapes) } else { Err(reported(problems)) }
    }
}

fn reported(problems: Vec<Diagnostic>) -> Report {
    let mut report = Report::default();
    report.extend(problems);
    report
}

fn named<'s>(spec: &'s Spec, name: Option<&str>) -> Result<&'s DatasetSpec, Report> {
    let names: Vec<&str> = spec.datasets.iter().map(|dataset| dataset.name.as_str()).collect();
    let wrong = |message: String| Err(Report::from(Diagnostic::error(message, None)));
    match (name, spec.datasets.as_slice()) {
        (None, [one]) => Ok(one),
        (None, []) => wrong(format!("pipeline `{}` has no `datasets:`", spec.pipeline)),
        (None, _) => {
            wrong(format!("pipeline `{}` has several data sets; name one of {}", spec.pipeline, names.join(", ")))
        }
        (Some(name), datasets) => match datasets.iter().find(|dataset| dataset.name == name) {
            Some(found) => Ok(found),
            None => wrong(format!(
                "there is no data set `{name}` in pipeline `{}`; it has {}",
                spec.pipeline,
                names.join(", ")
            )),
        },
    }
}

/// A sample takes one instance of each stage, and nothing that gathers several samples.
fn of_one_sample(plan: &Plan, spec: &DatasetSpec, feature: &Feature) -> Option<Diagnostic> {
    let at = ["datasets", &spec.name, "sample", &feature.spec.name];
    let wrong = |message: String, hint: &str| {
        Some(plan.spec.at_path(&at, Mistake::new(Kind::Graph, message), Some(hint.to_owned())))
    };
    let name = &plan.spec.stages[feature.stage].name;
    if !plan.outputs(feature.stage).iter().any(|port| port.name == feature.port && can_be(port.kind)) {
        return wrong(format!("{name}.{} holds no images and no table", feature.port), "take another output");
    }
    let first = plan.instances_of(feature.stage).into_iter().next()?;
    let axes: Vec<&str> = plan.axis_names(plan.stage_of(first)).filter(|axis| *axis != DRAW_AXIS).collect();
    if !axes.is_empty() {
        let message = format!("`{name}` has several instances per sample: they differ by {}", axes.join(", "));
        return wrong(message, "take a stage that has one per sample, or draw what differs");
    }
    let mut open = vec![feature.stage];
    let mut seen = BTreeSet::new();
    while let Some(stage) = open.pop().filter(|&stage| seen.insert(stage)) {
        let Some(first) = plan.instances_of(stage).into_iter().next() else { continue };
        for wire in &plan.wires(first) {
            let gathers = |id: &crate::plan::InstanceId| plan.axis(*id, DRAW_AXIS).is_some();
            if plan.axis(first, DRAW_AXIS).is_none() && wire.from.iter().any(|(id, _)| gathers(id)) {
                let message =
                    format!("`{}` gathers all samples, and this feature depends on it", plan.spec.stages[stage].name);
                return wrong(message, "give that stage inputs of its own, which are not drawn");
            }
            open.extend(wire.from.iter().map(|(id, _)| plan.stage_of(*id)));
        }
    }
    None
}

/// Columns that every shard (the first three) or the index has.
const COLUMNS: [&str; 8] = ["id", "draw", "group", "split", "seed", "shard", "row", "reject"];

/// Groups and conditions must name what is drawn.
fn unknown_names(plan: &Plan, spec: &DatasetSpec, (draws, draw): (StageId, &Draw)) -> Vec<Diagnostic> {
    let names: Vec<&str> = draw.names().collect();
    let wrong = |path: &[&str], message: String, known: &[&str]| {
        let hint = if known.is_empty() { None } else { Some(format!("known: {}", known.join(", "))) };
        plan.spec.at_path(path, Mistake::new(Kind::Graph, message), hint)
    };
    let mut problems = Vec::new();
    let groups: Vec<&str> = draw.groups().collect();
    if let Some(by) = spec.by.as_ref().filter(|by| !groups.contains(&by.as_str())) {
        let path = ["datasets", &spec.name, "splits", "by"];
        problems.push(wrong(&path, format!("`{by}` is no group of the draw"), &groups));
    }
    for (far, conditions) in &spec.far {
        for condition in conditions.iter().filter(|condition| !names.contains(&condition.name.as_str())) {
            let path = ["datasets", &spec.name, "far", far];
            problems.push(wrong(&path, format!("`{}` is not drawn", condition.name), &names));
        }
    }
    for name in names.iter().filter(|name| COLUMNS.contains(name)) {
        let path = ["stages", &plan.spec.stages[draws].name, "foreach", "draw", name];
        problems.push(wrong(&path, format!("`{name}` is a column of every data set already"), &[]));
    }
    for feature in spec.sample.iter().filter(|feature| COLUMNS[..3].contains(&feature.name.as_str())) {
        let path = ["datasets", &spec.name, "sample", &feature.name];
        problems.push(wrong(&path, format!("`{}` is a column of every data set already", feature.name), &[]));
    }
    problems
}

impl Keep {
    fn find(limit: &KeepSpec, plan: &Plan, dataset: &DatasetSpec) -> Result<Self, Box<Diagnostic>> {
        let at = ["datasets", &dataset.name, "keep", &limit.text];
        let Some(stage) = plan.spec.stage(&limit.stage) else {
            let hint = nearest(&limit.stage, plan.spec.stages.iter().map(|stage| stage.name.as_str()));
            let mistake = Mistake::new(Kind::Graph, format!("there is no stage `{}`", limit.stage));
            return Err(Box::new(plan.spec.at_path(&at, mistake, hint.map(|name| format!("did you mean `{name}`?")))));
        };
        let several = |id: crate::plan::InstanceId| plan.axis_names(plan.stage_of(id)).any(|axis| axis != DRAW_AXIS);
        let wrong = match plan.draw_of(stage) {
            None => Some(format!("`{}` is the same for all samples: no `draw` reaches it", limit.stage)),
            Some(_) if plan.instances_of(stage).into_iter().any(several) => {
                Some(format!("`{}` has several instances per sample", limit.stage))
            }
            Some(_) => None,
        };
        if let Some(message) = wrong {
            return Err(Box::new(plan.spec.at_path(&at, Mistake::new(Kind::Graph, message), None)));
        }
        let column = limit.what.split_once('.').and_then(|(port, column)| {
            let found = plan.outputs(stage).iter().find(|known| known.name == port)?;
            Some(Limited::Column { port: found.name, column: column.to_owned() })
        });
        Ok(Self { spec: limit.clone(), stage, on: column.unwrap_or_else(|| Limited::Measure(limit.what.clone())) })
    }
}
