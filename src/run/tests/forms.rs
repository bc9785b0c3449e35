//! Params are read once in a survey and once in a run; an output that breaks its form fails its instance.

use std::sync::atomic::{AtomicUsize, Ordering};

use serde::{Deserialize, Deserializer, Serialize};
use turbid_contract::payload::Metrics;
use turbid_contract::{Cells, Ctx, Error, Form, Forms, InPorts, Known, Problems, Stage, Table, in_ports, out_ports};

use super::{Interrupt, Options, run};
use crate::plan::Plan;
use crate::registry::Registry;
use crate::resolve::Resolver;
use crate::run::progress::Lines;
use crate::run::{End, Summary};
use crate::store::Store;

static READ: AtomicUsize = AtomicUsize::new(0);

fn counted<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
    READ.fetch_add(1, Ordering::SeqCst);
    f64::deserialize(from)
}

#[derive(Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
struct Params {
    /// How many rows the table gets; it says that it gets `said`.
    #[serde(deserialize_with = "counted")]
    rows: f64,
    #[serde(default)]
    said: Option<f64>,
}

in_ports! {
    struct In {
        /// To have a chain.
        before: optional Metrics,
    }
}

out_ports! {
    struct Out {
        /// Rows of zeros.
        table: one Metrics,
    }
}

struct Rows;
impl Stage for Rows {
    const NAME: &'static str = "rows";
    const VERSION: u32 = 1;
    const ABOUT: &'static str = "Makes a table.";
    type Params = Params;
    type In = In<'static>;
    type Out = Out;
    fn check(params: &Params, known: &Known, problems: &mut Problems) {
        if let Some(rows) = known.form("before").and_then(|form| form.rows).filter(|rows| *rows as f64 != params.rows) {
            problems.at_input("before", format!("{} has {rows} rows", known.producer("before")), "take as many");
        }
    }
    fn describe(params: &Params, _: &Known) -> Forms {
        Forms::from([("table", Form::table(Some(params.said.unwrap_or(params.rows) as u64), &[("x", "1")]))])
    }
    fn run(params: &Params, _: <In<'static> as InPorts>::Loaded<'_>, _: Ctx<'_>) -> Result<Out, Error> {
        let mut table = Table::default();
        table.push("x", "1", Cells::F64(vec![0.0; params.rows as usize]));
        Ok(Out { table: Metrics(table) })
    }
}

/// A file of these stages; its plan, checked and run in an empty store.
fn tried(stages: &str) -> (Vec<String>, Option<Summary>) {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("p.yaml");
    std::fs::write(&file, format!("stages:\n{stages}")).unwrap();
    let (spec, report) = crate::spec::read(&file, &[]);
    let plan = Plan::build(spec.unwrap(), report, &Registry::default().with::<Rows>(), &[]).unwrap();
    let store = Store::open(&folder.path().join("outputs")).unwrap();
    let resolver = Resolver::new(&plan, &store);
    let survey = resolver.survey(&[]);
    let problems: Vec<String> = survey.problems.iter().map(ToString::to_string).collect();
    if !problems.is_empty() {
        return (problems, None);
    }
    let options = Options::of_tests(1);
    let summary = run(&resolver, survey, &options, &Lines::default(), &Interrupt::default()).unwrap();
    (problems, Some(summary))
}

/// One test, for the count is one of the process.
#[test]
fn params_are_read_twice_and_forms_are_held() {
    let (_, summary) = tried(
        "  a: {use: rows, foreach: {n: [1, 2, 3]}, with: {rows: \"${n}\"}}\n  b: {use: rows, in: {before: a}, with: {rows: \"${n}\"}}",
    );
    assert_eq!(summary.unwrap().ran(), 6);
    assert_eq!(READ.load(Ordering::SeqCst), 12, "once to survey and once to run, each of six instances");

    // What the first says of its table, the second is checked against, although nothing was run.
    let (problems, _) = tried("  a: {use: rows, with: {rows: 2}}\n  b: {use: rows, in: {before: a}, with: {rows: 3}}");
    let [problem] = &problems[..] else { panic!("{problems:?}") };
    assert!(problem.contains("p.yaml:3:") && problem.contains("a.table has 2 rows"), "{problem}");

    let (_, summary) = tried("  a: {use: rows, with: {rows: 2, said: 3}}");
    let ends = summary.unwrap().ends;
    let Some(End::Failed(message)) = ends.values().next() else { panic!("{ends:?}") };
    assert!(message.contains("output `table` of rows has 2 rows instead of 3"), "{message}");
}
