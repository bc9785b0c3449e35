//! Every joint of two stages: what is wrong with what comes on a port is found by the check of the stage that reads it, before anything runs.
//!
//! The joints are those of the registry: each output with each input that takes its payload. They stand in the shipped pipelines or in those of
//! [`bench`]. Of each the form of what comes is made wrong in every way that applies to it; the [table] says which of these the check refuses, which
//! it warns of, and for each that it lets pass the reason. Parts that no form tells before a run are listed beside it, with the reason.

#[path = "joints/bench.rs"]
mod bench;
#[path = "joints/reason.rs"]
mod reason;
#[path = "joints/table.rs"]
mod table;
#[path = "joints/wrong.rs"]
mod wrong;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use turbid::plan::{InstanceId, Plan};
use turbid::registry::Registry;
use turbid::resolve::{Prepared, Resolver};
use turbid::spec;
use turbid::store::Store;
use turbid_contract::problem::At;
use turbid_contract::{Form, Known, Problem, Problems};

use bench::SENSELESS;
use reason::Effect;
use table::{JOINTS, OPEN, Row};
use wrong::{ALL, Wrong};

/// What the check says of a wrong joint; what one pipeline cannot tell (a stage of which one arm is known), another can.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Said {
    Nothing,
    Warning,
    Mistake,
}

/// What was said of each way of being wrong, and what became of the outputs' forms where nothing was said.
type Tried = BTreeMap<Wrong, (Said, Effect)>;

/// `use.port` of consumer and producer.
type Joint = (String, String);

#[derive(Default)]
struct Found {
    joints: BTreeMap<Joint, Tried>,
    /// Of each output that is read: its parts, and whether any pipeline knows them before the run.
    told: BTreeMap<String, BTreeMap<&'static str, bool>>,
}

/// The check of an instance with what is known of its inputs.
fn checked(prepared: &Prepared, known: &Known) -> (Vec<Problem>, Vec<Problem>) {
    let mut problems = Problems::default();
    prepared.job.check(known, &mut problems);
    problems.into_parts()
}

/// Shows `look` the first instance of each stage of a pipeline, with what is known of its inputs.
fn each_stage(path: &Path, text: Option<&str>, look: &mut dyn FnMut(&Plan, InstanceId, &Prepared, &Known)) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (spec, report) = match text {
        None => spec::read(path, &[]),
        Some(text) => spec::read_bytes(path, text.as_bytes(), &[]),
    };
    let spec = spec.unwrap_or_else(|| panic!("{}: {report}", path.display()));
    let plan =
        Plan::build(spec, report, &Registry::builtin(), &[]).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let store = Store::open(folder.path()).expect("the folder is ours");
    let resolver = Resolver::new(&plan, &store);
    let survey = resolver.survey(&plan.needed);
    for &stage in &plan.needed {
        let Some(id) = plan.instances_of(stage).next() else { continue };
        let known = resolver.known(id, &survey.outputs);
        let Ok(prepared) = resolver.prepare(id) else { panic!("{}: {}", path.display(), plan.label(id)) };
        look(&plan, id, &prepared, &known);
    }
}

/// The joints of an instance, each with its port and that of its producer.
fn joints_of(plan: &Plan, id: InstanceId) -> Vec<(&'static str, Joint)> {
    let joint = |wire: &turbid::plan::Wire| {
        let (source, out) = wire.from.first()?;
        let (consumer, producer) = (plan.row(plan.stage_of(id)).name, plan.row(plan.stage_of(*source)).name);
        Some((wire.port, (format!("{consumer}.{}", wire.port), format!("{producer}.{out}"))))
    };
    plan.wires(id).iter().filter_map(joint).collect()
}

/// Tries every joint of a pipeline.
fn try_all(path: &Path, text: Option<&str>, found: &mut Found) {
    each_stage(path, text, &mut |plan, id, prepared, known| {
        let (mistakes, warnings) = checked(prepared, known);
        // Files that this does not lend: their mistakes are the only ones.
        let alone = mistakes.is_empty() || !prepared.job.files().is_empty();
        assert!(alone, "{}: {mistakes:?}", plan.label(id));
        let forms = mistakes.is_empty().then(|| prepared.job.describe(known));
        for (port, joint) in joints_of(plan, id) {
            let told = found.told.entry(joint.1.clone()).or_default();
            for form in known.forms(port) {
                for (part, is) in parts(form) {
                    *told.entry(part).or_default() |= is;
                }
            }
            let tried = found.joints.entry(joint.clone()).or_default();
            for wrong in ALL {
                let Some(other) = wrong.on(port, known) else { continue };
                let (new, warned) = checked(prepared, &other);
                let said = match () {
                    () if new.len() > mistakes.len() => Said::Mistake,
                    () if warned.len() > warnings.len() => Said::Warning,
                    () => Said::Nothing,
                };
                for problem in
                    new.iter().filter(|p| !mistakes.contains(p)).chain(warned.iter().filter(|w| !warnings.contains(w)))
                {
                    if let Some(lacks) = mistold(problem, wrong, known) {
                        panic!("{joint:?} {wrong:?} {lacks}: {problem}");
                    }
                }
                let unlike = said == Said::Nothing
                    && forms.as_ref().is_some_and(|forms| prepared.job.describe(&other) != *forms);
                let effect = if unlike { Effect::Shows } else { Effect::None };
                let entry = tried.entry(wrong).or_insert((said, effect));
                *entry = (*entry).max((said, effect));
            }
        }
    });
}

/// The parts of a form, and whether they are known: of images and tables, as far as it says which it is.
fn parts(form: &Form) -> Vec<(&'static str, bool)> {
    let images = [("pixels", form.pixels.is_some()), ("layers", form.layers.is_some())];
    let table = [("rows", form.rows.is_some()), ("columns", form.columns.is_some())];
    [images, table].into_iter().filter(|parts| parts.iter().any(|(_, is)| *is)).flatten().collect()
}

/// What is wrong with how a mistake is told: it names a stage that is connected, stands at an input or at the param that does not fit, and has a way
/// out. What is missing in a scene stands at the port with the scene's name beside it.
fn mistold(problem: &Problem, wrong: Wrong, known: &Known) -> Option<&'static str> {
    let named = wrong == Wrong::Empty || known.producers.values().any(|label| problem.message.contains(label.as_str()));
    match problem.at {
        At::In if !known.is_connected(&problem.path) => Some("is at no port"),
        At::In if !named => Some("names no stage"),
        At::In if problem.hint.is_none() => Some("has no way out"),
        _ => None,
    }
}

fn pipelines() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("pipelines")
}

fn shipped() -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = [pipelines(), pipelines().join("checks")]
        .iter()
        .flat_map(|folder| std::fs::read_dir(folder).expect("it is there").flatten().map(|e| e.path()))
        .filter(|path| path.extension().is_some_and(|e| e == "yaml"))
        .collect();
    files.sort();
    files
}

/// Outputs with the inputs that take their payload.
fn of_the_registry() -> BTreeSet<Joint> {
    let registry = Registry::builtin();
    let mut joints = BTreeSet::new();
    for (consumer, producer) in registry.rows().iter().flat_map(|a| registry.rows().iter().map(move |b| (a, b))) {
        for (port, out) in
            (consumer.inputs)().iter().flat_map(|p| (producer.outputs)().into_iter().map(move |o| (p.clone(), o)))
        {
            if port.accepts.contains(&out.payload) {
                joints.insert((format!("{}.{}", consumer.name, port.name), format!("{}.{}", producer.name, out.name)));
            }
        }
    }
    joints
}

/// How what was said of a joint differs from its row.
fn unlike_its_row(row: Option<&Row>, tried: &Tried) -> Option<String> {
    let of = |said: Said| tried.iter().filter(|(_, t)| t.0 == said).map(|(wrong, _)| *wrong).collect::<Vec<_>>();
    let said = [Said::Mistake, Said::Warning, Said::Nothing].map(of);
    let told = row.map(|row| {
        let passes = row.passes.iter().flat_map(|(wrongs, _)| *wrongs).copied().collect();
        [row.refused.to_vec(), row.warned.to_vec(), passes].map(|mut wrongs: Vec<Wrong>| {
            wrongs.sort();
            wrongs
        })
    });
    let [refused, warned, passes] = &said;
    (told.as_ref() != Some(&said)).then(|| format!("refused {refused:?}, warned {warned:?}, passes {passes:?}"))
}

#[test]
fn wrong_joints_are_refused_before_the_run() {
    let mut found = Found::default();
    shipped().iter().for_each(|file| try_all(file, None, &mut found));
    try_all(&pipelines().join("joints.yaml"), Some(&bench::more()), &mut found);
    let row = |joint: &Joint| JOINTS.iter().find(|row| joint.0 == row.consumer && joint.1 == row.producer);
    let unlike = |(joint, tried): (&Joint, &Tried)| Some(format!("{joint:?}: {}", unlike_its_row(row(joint), tried)?));
    let differs: Vec<String> = found.joints.iter().filter_map(unlike).collect();
    assert!(differs.is_empty(), "the table says otherwise:\n{}", differs.join("\n"));
    assert_eq!(JOINTS.len(), found.joints.len(), "a row stands twice, or for no pipeline");
    for row in &JOINTS {
        let tried = &found.joints[&(row.consumer.to_owned(), row.producer.to_owned())];
        for (wrong, reason) in row.passes.iter().flat_map(|(wrongs, reason)| wrongs.iter().map(|w| (*w, *reason))) {
            reason.assert(wrong, tried[&wrong].1, row.producer, row.consumer);
        }
    }
    let parts =
        found.told.iter().flat_map(|(out, told)| told.iter().map(move |(part, known)| (out.as_str(), *part, *known)));
    let open: Vec<_> = parts.filter(|(.., known)| !known).map(|(out, part, _)| (out, part)).collect();
    let listed: Vec<_> = OPEN.iter().map(|(out, part, _)| (*out, *part)).collect();
    assert_eq!(open, listed, "what only a run can tell");
}

/// Every joint that the registry allows stands in one of the two tables, and in one only.
#[test]
fn every_joint_of_the_registry_is_in_a_table() {
    let tables = JOINTS.iter().map(|row| (row.consumer, row.producer)).chain(SENSELESS.iter().map(|s| (s.0, s.1)));
    let told: Vec<Joint> = tables.map(|(consumer, producer)| (consumer.to_owned(), producer.to_owned())).collect();
    let once: BTreeSet<Joint> = told.iter().cloned().collect();
    assert_eq!(once.len(), told.len(), "a joint stands twice");
    let all = of_the_registry();
    assert_eq!(all.difference(&once).collect::<Vec<_>>(), Vec::<&Joint>::new(), "joints in no table");
    assert_eq!(once.difference(&all).collect::<Vec<_>>(), Vec::<&Joint>::new(), "no joints of the registry");
}

/// Joints of payloads that agree but of contents that never can: refused at their port whatever the params.
#[test]
fn joints_that_make_no_sense_are_refused() {
    let mut seen = 0;
    each_stage(&pipelines().join("joints.yaml"), Some(&bench::senseless()), &mut |plan, id, prepared, known| {
        let name = plan.stage_name(id);
        let Some(k) = name.strip_prefix("wrong_").and_then(|k| k.parse::<usize>().ok()) else { return };
        let (consumer, producer, _, words) = SENSELESS[k];
        let joints = joints_of(plan, id);
        let joint = joints.iter().find(|(_, joint)| (joint.0.as_str(), joint.1.as_str()) == (consumer, producer));
        let (port, joint) = joint.unwrap_or_else(|| panic!("{consumer} < {producer} is not in {joints:?}"));
        let (mistakes, _) = checked(prepared, known);
        let Some(mistake) = mistakes.first() else { panic!("{joint:?} passes") };
        assert!(
            mistake.at == At::In && mistake.path == *port && mistake.message.contains(words),
            "{joint:?}: {mistake}"
        );
        seen += 1;
    });
    assert_eq!(seen, SENSELESS.len());
}
