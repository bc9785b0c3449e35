//! Every joint of two stages: what is wrong with what comes on a port is found by the check of the stage that reads it, before anything runs.
//!
//! The joints are those of the shipped pipelines and of [`MORE`]. Of each the form of what comes is made wrong in every way that applies to it, and
//! the table [`JOINTS`] says which of these ways the consumer refuses, and why the others are no mistake of the joint.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use turbid::plan::Plan;
use turbid::registry::Registry;
use turbid::resolve::Resolver;
use turbid::spec;
use turbid::store::Store;
use turbid_contract::payload::RIG;
use turbid_contract::serde_json::{Value, json};
use turbid_contract::{Form, Known, LayerInfo, LayerKind, Problems};

/// A way in which what comes on a port can be wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Wrong {
    /// One row of pixels more.
    Size,
    /// Twice the spatial frequency.
    Frequency,
    /// Another wavelength.
    Wavelength,
    /// Fringes turned by a quarter.
    Orientation,
    /// All phases the same.
    Phases,
    /// Values in another unit.
    Unit,
    /// No standard errors and covariances.
    Errors,
    /// Quantities of other names.
    Quantity,
    /// Columns of other names.
    Columns,
    Convention,
    G,
    N,
    Rig,
}
use Wrong::*;

const ALL: [Wrong; 13] =
    [Size, Frequency, Wavelength, Orientation, Phases, Unit, Errors, Quantity, Columns, Convention, G, N, Rig];

impl Wrong {
    /// The form made wrong; `None` where it has nothing to be wrong in this way.
    fn done_to(self, form: &Form) -> Option<Form> {
        let mut wrong = form.clone();
        let each = |wrong: &mut Form, change: &dyn Fn(&mut LayerInfo)| {
            wrong.layers.iter_mut().flatten().chain(&mut wrong.perhaps).for_each(change);
        };
        match self {
            Size => wrong.pixels.as_mut()?[0] += 1,
            Frequency => {
                each(&mut wrong, &|info| info.f_x_per_mm = info.f_x_per_mm.map(|f_x| 2.0 * f_x));
                if let Some(Value::Array(all)) = wrong.attributes.get_mut("f_x") {
                    all.iter_mut().for_each(|f_x| *f_x = f_x.as_f64().map_or(Value::Null, |f_x| json!(2.0 * f_x)));
                }
            }
            Wavelength => {
                each(&mut wrong, &|info| info.wavelength_nm = Some(info.wavelength_nm.map_or(650.0, |nm| nm + 50.0)));
            }
            Orientation => {
                each(&mut wrong, &|info| {
                    if info.f_x_per_mm.is_some_and(|f_x| f_x > 0.0) {
                        info.orientation_deg = Some(info.orientation_deg.unwrap_or(0.0) + 90.0);
                    }
                });
            }
            Phases => each(&mut wrong, &|info| info.phase_rad = info.phase_rad.map(|_| 0.0)),
            Unit => {
                each(&mut wrong, &|info| {
                    if info.kind != LayerKind::Mask && info.kind != LayerKind::Condition {
                        info.unit += " wrong";
                    }
                });
            }
            Errors => {
                let known = |info: &LayerInfo| !matches!(info.kind, LayerKind::StandardError | LayerKind::Covariance);
                wrong.layers.as_mut()?.retain(known);
            }
            Quantity => {
                each(&mut wrong, &|info| {
                    if info.kind == LayerKind::Value {
                        info.name += "_wrong";
                    }
                });
            }
            Columns => wrong.columns.as_mut()?.iter_mut().for_each(|column| column.name += "_wrong"),
            Convention => set(&mut wrong, "convention", json!("hemispherical_entered"))?,
            G => set(&mut wrong, "g", json!(0.123))?,
            N => set(&mut wrong, "n", json!(1.234))?,
            Rig => {
                let other = turbid_contract::payload::Rig::named("another bench");
                wrong.attributes.get(RIG)?;
                other.insert_into(&mut wrong.attributes);
            }
        }
        (wrong != *form).then_some(wrong)
    }
}

fn set(form: &mut Form, name: &str, value: Value) -> Option<()> {
    *form.attributes.get_mut(name)? = value;
    Some(())
}

/// What was tried at a joint: refused or not, by the way.
type Tried = BTreeMap<Wrong, bool>;

/// `use.port` of consumer and producer.
type Joint = (String, String);

/// Tries every joint of a pipeline, of its first instances.
fn try_all(file: &Path, found: &mut BTreeMap<Joint, Tried>) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (spec, report) = spec::read(file, &[]);
    let spec = spec.unwrap_or_else(|| panic!("{}: {report}", file.display()));
    let plan =
        Plan::build(spec, report, &Registry::builtin(), &[]).unwrap_or_else(|e| panic!("{}: {e}", file.display()));
    let store = Store::open(folder.path()).expect("the folder is ours");
    let resolver = Resolver::new(&plan, &store);
    let survey = resolver.survey(&plan.needed);
    for &stage in &plan.needed {
        let Some(id) = plan.instances_of(stage).next() else { continue };
        let known = resolver.known(id, &survey.outputs);
        let Ok(prepared) = resolver.prepare(id) else { panic!("{}: {}", file.display(), plan.label(id)) };
        let mistakes = |known: &Known| {
            let mut problems = Problems::default();
            prepared.job.check(known, &mut problems);
            problems.into_parts().0
        };
        if !mistakes(&known).is_empty() {
            // Files that this does not lend: their mistakes are the only ones.
            assert!(!prepared.job.files().is_empty(), "{}: {:?}", plan.label(id), mistakes(&known));
        }
        let before = mistakes(&known).len();
        for wire in &plan.instances[id].wires {
            let Some((source, out)) = wire.from.first() else { continue };
            let producer = plan.row(plan.instances[*source].stage).name;
            let joint = (format!("{}.{}", plan.row(stage).name, wire.port), format!("{producer}.{out}"));
            let tried = found.entry(joint).or_default();
            for wrong in ALL {
                let forms = known.forms(wire.port);
                let made: Option<Vec<_>> = forms.iter().map(|form| wrong.done_to(form).map(Arc::new)).collect();
                let Some(made) = made.filter(|made| !made.is_empty()) else { continue };
                let mut other = known.clone();
                other.forms.insert(wire.port.to_owned(), made);
                let refused = mistakes(&other).len() > before;
                // What one pipeline cannot tell (a stage with one arm known), another can.
                *tried.entry(wrong).or_default() |= refused;
            }
        }
    }
}

fn shipped() -> Vec<PathBuf> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("pipelines");
    let mut files: Vec<PathBuf> = [folder.clone(), folder.join("checks")]
        .iter()
        .flat_map(|folder| std::fs::read_dir(folder).expect("it is there").flatten().map(|e| e.path()))
        .filter(|path| path.extension().is_some_and(|e| e == "yaml"))
        .collect();
    files.sort();
    files
}

/// Consumer, producer, what is refused, and what is let pass.
type Row = (&'static str, &'static str, &'static [Wrong], &'static [Wrong]);

/// What is let pass is no mistake of the joint (images of any size can be demodulated), or shows in what the consumer makes of it and is refused behind
/// it (g of a reflectance at its table), or is not compared yet. Records, as scenes are, have no form: their content is there when they are checked.
const JOINTS: [Row; 42] = [
    (
        "build_lut.phantoms",
        "demodulate.modulation",
        &[Size, Frequency, Wavelength, Orientation, Unit, Quantity, Rig],
        &[Errors],
    ),
    ("build_lut.properties", "calibrate_iad.fit", &[], &[Columns]),
    (
        "build_lut.references",
        "demodulate.modulation",
        &[Size, Frequency, Wavelength, Orientation, Unit, Quantity, Rig],
        &[Errors],
    ),
    ("build_lut.sections", "section_tube.sections", &[Size], &[Wavelength, Unit, Quantity]),
    ("build_lut.truths", "render.truth", &[], &[Size, Wavelength, Unit, Quantity, Rig]),
    (
        "calibrate.reference",
        "demodulate.modulation",
        &[Size, Frequency, Wavelength, Orientation, Unit, Quantity, Rig],
        &[Errors],
    ),
    (
        "calibrate.sample",
        "demodulate.modulation",
        &[Size, Frequency, Wavelength, Orientation, Unit, Quantity, Rig],
        &[Errors],
    ),
    ("calibrate_iad.readings", "calibrate_dis.readings", &[Columns], &[]),
    ("compare.estimate", "calibrate_iad.fit", &[Columns], &[]),
    (
        "compare.estimate",
        "invert.maps",
        &[Size, Unit, Quantity],
        &[Frequency, Wavelength, Errors, Convention, G, N, Rig],
    ),
    ("compare.estimate", "profilometry.height", &[Size, Unit, Quantity], &[Wavelength, Errors]),
    ("compare.truth", "calibrate_dis.readings", &[Columns], &[]),
    ("compare.truth", "render.truth", &[Size, Wavelength, Unit, Quantity], &[Rig]),
    ("demodulate.covariance", "render.covariance", &[Size, Errors], &[Wavelength, Unit, Rig]),
    ("demodulate.covariance", "sensor.covariance", &[Size, Errors], &[Wavelength, Unit]),
    (
        "demodulate.frames",
        "import_frames.frames",
        &[Phases],
        &[Size, Frequency, Wavelength, Orientation, Unit, Errors, Quantity, Rig],
    ),
    (
        "demodulate.frames",
        "render.frames",
        &[Size, Frequency, Wavelength, Orientation, Phases],
        &[Unit, Errors, Quantity, Rig],
    ),
    (
        "demodulate.frames",
        "sensor.frames",
        &[Size, Frequency, Wavelength, Orientation, Phases],
        &[Unit, Errors, Quantity, Rig],
    ),
    ("demodulate.scene", "scene.scene", &[], &[]),
    ("invert.height", "profilometry.height", &[Size, Quantity], &[Wavelength, Unit, Errors]),
    ("invert.height", "render.truth", &[Size, Quantity], &[Wavelength, Unit, Rig]),
    ("invert.lut", "build_lut.lut", &[Frequency, Columns, Convention, G, N], &[]),
    (
        "invert.reflectance",
        "calibrate.reflectance",
        &[Size, Frequency, Orientation, Quantity, Convention, G, N],
        &[Wavelength, Unit, Errors, Rig],
    ),
    ("invert.scene", "scene.scene", &[], &[]),
    ("invert.sections", "section_tube.sections", &[Size], &[Wavelength, Unit, Quantity]),
    ("pattern.scene", "scene.scene", &[], &[]),
    ("predistort.scene", "scene.scene", &[], &[]),
    (
        "profilometry.reference",
        "demodulate.phase",
        &[Size, Frequency, Wavelength, Orientation, Quantity, Rig],
        &[Unit, Errors],
    ),
    (
        "profilometry.sample",
        "demodulate.phase",
        &[Size, Frequency, Wavelength, Orientation, Quantity, Rig],
        &[Unit, Errors],
    ),
    ("profilometry.scene", "scene.scene", &[], &[]),
    ("render.pattern", "pattern.pattern", &[Size], &[Wavelength, Unit, Quantity]),
    ("render.pattern", "predistort.pattern", &[Size], &[Frequency, Wavelength, Orientation, Phases, Unit, Quantity]),
    ("render.scene", "scene.scene", &[], &[]),
    ("scene.rig", "scene.scene", &[], &[]),
    (
        "section_tube.modulation",
        "demodulate.modulation",
        &[Size, Quantity],
        &[Frequency, Wavelength, Orientation, Unit, Errors, Rig],
    ),
    ("section_tube.truth", "render.truth", &[Size, Quantity], &[Wavelength, Unit, Rig]),
    ("sensor.covariance", "render.covariance", &[Size, Errors], &[Wavelength, Unit, Rig]),
    (
        "sensor.frames",
        "render.frames",
        &[Size, Frequency, Wavelength, Orientation, Phases],
        &[Unit, Errors, Quantity, Rig],
    ),
    ("summarize.metrics", "compare.metrics", &[Columns], &[]),
    ("tabulate.minus", "render.frames", &[Wavelength, Quantity], &[Size, Unit, Errors, Rig]),
    ("tabulate.relative_to", "render.frames", &[Wavelength, Quantity], &[Size, Unit, Errors, Rig]),
    ("tabulate.values", "render.frames", &[Wavelength, Quantity], &[Size, Unit, Errors, Rig]),
];

#[test]
fn wrong_joints_are_refused_before_the_run() {
    let mut found = BTreeMap::new();
    for file in shipped() {
        try_all(&file, &mut found);
    }
    let which = |tried: &Tried, refused: bool| -> Vec<Wrong> {
        tried.iter().filter(|(_, was)| **was == refused).map(|(wrong, _)| *wrong).collect()
    };
    let found: Vec<_> = found
        .iter()
        .map(|((consumer, producer), tried)| {
            (consumer.as_str(), producer.as_str(), which(tried, true), which(tried, false))
        })
        .collect();
    let told: Vec<_> =
        JOINTS.iter().map(|(consumer, producer, a, b)| (*consumer, *producer, a.to_vec(), b.to_vec())).collect();
    assert_eq!(found, told);
}
