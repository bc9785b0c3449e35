//! A program error of ours ends an instance, with its place, and never the run; params are read once to look at an instance, and once to run it.

mod forms;
mod stopping;

use std::sync::atomic::{AtomicIsize, Ordering};
use std::sync::mpsc::channel;
use std::time::Duration;

use turbid_contract::payload::Metrics;
use turbid_contract::{
    Artifact, ArtifactKind, Cells, Ctx, Error, InPorts, Known, OutPort, OutPorts, Problems, Shared, Stage, Table,
    in_ports, out_ports,
};

use super::progress::Lines;
use super::{End, Interrupt, Options, run};
use crate::plan::Plan;
use crate::registry::Registry;
use crate::resolve::Resolver;
use crate::store::Store;

#[derive(serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
struct Params {
    n: f64,
}

in_ports! {
    struct In {}
}

/// Makes a port that it did not name: the engine finds out after the stage has run.
struct Out;
impl OutPorts for Out {
    fn ports() -> Vec<OutPort> {
        let kind = ArtifactKind::Table;
        vec![OutPort { name: "table", payload: "table", kind, optional: false, preview: false, about: "", holds: &[] }]
    }
    fn into_artifacts(self) -> Vec<(&'static str, Artifact)> {
        vec![("another", Artifact::Table(Table::default()))]
    }
    fn into_shared(self) -> Vec<(&'static str, Shared)> {
        self.into_artifacts().into_iter().map(|(port, artifact)| (port, Shared::new(artifact))).collect()
    }
}

struct Odd;
impl Stage for Odd {
    const NAME: &'static str = "odd";
    const VERSION: u32 = 1;
    const ABOUT: &'static str = "Makes a port that it did not name.";
    type Params = Params;
    type In = In<'static>;
    type Out = Out;
    fn check(_: &Params, _: &Known, _: &mut Problems) {}
    fn run(_: &Params, _: <In<'static> as InPorts>::Loaded<'_>, _: Ctx<'_>) -> Result<Out, Error> {
        Ok(Out)
    }
}

/// A panic of the engine while it deals with an instance, outside of the stage: each instance fails with message and place, and the run ends.
#[test]
fn panics_outside_of_stages_end_their_instance() {
    let (send, receive) = channel();
    std::thread::spawn(move || {
        crate::panics::speak();
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("p.yaml");
        std::fs::write(&file, "stages: {odd: {use: odd, foreach: {n: [1, 2, 3]}, with: {n: \"${n}\"}}}").unwrap();
        let (spec, report) = crate::spec::read(&file, &[]);
        let plan = Plan::build(spec.unwrap(), report, &Registry::default().with::<Odd>(), &[]).unwrap();
        let store = Store::open(&folder.path().join("outputs")).unwrap();
        let resolver = Resolver::new(&plan, &store);
        let options = Options::of_tests(2);
        let survey = resolver.survey(&[]);
        let summary = run(&resolver, survey, &options, &Lines::default(), &Interrupt::default()).unwrap();
        // Nobody may wait any more.
        let _ = send.send(summary.ends);
    });
    let ends = receive.recv_timeout(Duration::from_secs(60)).expect("the run ends");
    assert_eq!(ends.len(), 3);
    for end in ends.values() {
        let End::Failed(message) = end else { panic!("{end:?}") };
        assert!(
            message.starts_with("internal error, please report it: ") && message.contains("execute.rs:"),
            "{message}"
        );
    }
}

/// Params that were read, and those of them that are still held.
static READ: AtomicIsize = AtomicIsize::new(0);
static HELD: AtomicIsize = AtomicIsize::new(0);

#[derive(serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(from = "Params")]
struct Counted {
    n: f64,
}

impl From<Params> for Counted {
    fn from(params: Params) -> Self {
        READ.fetch_add(1, Ordering::Relaxed);
        HELD.fetch_add(1, Ordering::Relaxed);
        Self { n: params.n }
    }
}

impl Drop for Counted {
    fn drop(&mut self) {
        HELD.fetch_sub(1, Ordering::Relaxed);
    }
}

out_ports! {
    struct Tables {
        /// One row.
        table: one Metrics,
    }
}

struct Plain;
impl Stage for Plain {
    const NAME: &'static str = "plain";
    const VERSION: u32 = 1;
    const ABOUT: &'static str = "Makes a table of one row.";
    type Params = Counted;
    type In = In<'static>;
    type Out = Tables;
    fn check(_: &Counted, _: &Known, _: &mut Problems) {}
    fn run(params: &Counted, _: <In<'static> as InPorts>::Loaded<'_>, _: Ctx<'_>) -> Result<Tables, Error> {
        let mut table = Table::default();
        table.push("n", "", Cells::F64(vec![params.n]));
        Ok(Tables { table: Metrics(table) })
    }
}

/// Once to survey an instance and once to run it; what was read is given back at once, however many instances there are.
#[test]
fn params_are_read_twice_and_not_kept() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("p.yaml");
    std::fs::write(&file, "stages: {plain: {use: plain, foreach: {n: [1, 2, 3]}, with: {n: \"${n}\"}}}").unwrap();
    let (spec, report) = crate::spec::read(&file, &[]);
    let plan = Plan::build(spec.unwrap(), report, &Registry::default().with::<Plain>(), &[]).unwrap();
    let store = Store::open(&folder.path().join("outputs")).unwrap();
    let resolver = Resolver::new(&plan, &store);
    let options = Options::of_tests(2);
    let counts = || [&READ, &HELD].map(|count| count.load(Ordering::Relaxed));
    let survey = resolver.survey(&[]);
    assert_eq!(counts(), [3, 0], "read and held after the survey");
    let summary = run(&resolver, survey, &options, &Lines::default(), &Interrupt::default()).unwrap();
    assert_eq!(summary.ran(), 3, "{:?}", summary.ends);
    assert_eq!(counts(), [6, 0], "read and held after the run");
}
