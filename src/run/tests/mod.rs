//! A program error of ours ends an instance, with its place, and never the run.

mod forms;
mod stopping;

use std::sync::mpsc::channel;
use std::time::Duration;

use turbid_contract::{
    Artifact, ArtifactKind, Ctx, Error, InPorts, Known, OutPort, OutPorts, Problems, Stage, Table, in_ports,
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
        let options =
            Options { jobs: 2, keep_going: true, force: Vec::new(), replace: false, simd: String::new(), memory: None };
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
