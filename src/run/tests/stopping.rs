//! Where stages stop: what the clock stopped is stored as what it reached, whatever the stage calls it; cost of a continued run; what is kept on the way.

use std::path::Path;
use std::sync::Arc;

use serde_json::json;
use turbid_contract::payload::Metrics;
use turbid_contract::{Cells, Ctx, Error, Known, Problems, Stage, Table, in_ports, out_ports};

use super::super::progress::Lines;
use super::super::{End, Interrupt, Options, run};
use crate::plan::{Plan, Target};
use crate::registry::Registry;
use crate::resolve::Resolver;
use crate::store::{InstanceRecord, Store};

/// Params of `strides`: how many, after which time to stop, how many times the work of a stride is done, whether a state is read by half.
#[derive(serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
struct Params {
    #[serde(default, skip_serializing_if = "Option::is_none")]
    strides: Option<u64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    patience: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    weight: Option<u64>,
    #[serde(default)]
    torn: bool,
}

in_ports! {
    struct In {}
}

out_ports! {
    struct Out {
        /// How many strides were made.
        made: one Metrics,
        /// The same again.
        again: optional Metrics,
    }
}

/// Strides of some milliseconds of CPU each, one after the other, until it is told to stop.
struct Strides;

impl Stage for Strides {
    const NAME: &'static str = "strides";
    const VERSION: u32 = 1;
    const ABOUT: &'static str = "strides";
    const STOPPING: &'static [&'static str] = &["strides", "patience", "weight"];
    type Params = Params;
    type In = In<'static>;
    type Out = Out;

    fn check(_: &Params, _: &Known, _: &mut Problems) {}

    fn run(params: &Params, _: In<'_>, ctx: Ctx<'_>) -> Result<Out, Error> {
        let most = params.strides.unwrap_or(u64::MAX);
        let mut done = 0;
        ctx.resume_with(most, &mut |from| {
            let mut state = [0; 8];
            // One that reads half of a state cannot go on from it.
            let length = if params.torn { 4 } else { 8 };
            if from.read_exact(&mut state[..length]).is_ok() && !params.torn {
                done = u64::from_le_bytes(state);
            }
        });
        while done < most && !params.patience.is_some_and(|limit| done > 0 && ctx.time_is_up(limit)) {
            ctx.map_tiles(1, |_| (0..params.weight.unwrap_or(1)).map(|_| stride()).fold(0, u64::wrapping_add))?;
            done += 1;
            // To ask whether a checkpoint is due is no question about the time.
            let _ = ctx.checkpoint_is_due();
        }
        ctx.checkpoint(&done.to_le_bytes(), done);
        ctx.measure("strides", done as f64, "1");
        ctx.reached(&[("strides", done.into())]);
        let mut table = Table::default();
        table.push("strides", "1", Cells::I64(vec![done as i64]));
        let again = ctx.wants("again").then(|| Metrics(table.clone()));
        Ok(Out { made: Metrics(table), again })
    }
}

/// Work that no optimiser takes away.
fn stride() -> u64 {
    (0..4_000_000_u64).fold(1, |x, i| std::hint::black_box(x.wrapping_mul(6_364_136_223_846_793_005) ^ i))
}

/// Runs `strides` with these params in a store; wants these ports. The record, and whether it had to run.
fn strides(folder: &Path, with: &str, ports: &[&str]) -> (bool, Arc<InstanceRecord>) {
    let file = folder.join("p.yaml");
    std::fs::write(&file, format!("stages: {{s: {{use: strides, with: {with}}}}}")).unwrap();
    let (spec, report) = crate::spec::read(&file, &[]);
    let targets: Vec<Target> = ports.iter().map(|port| Target::parse(&format!("s.{port}"))).collect();
    let plan = Plan::build(spec.unwrap(), report, &Registry::default().with::<Strides>(), &targets).unwrap();
    let store = Store::open(&folder.join("outputs")).unwrap();
    let resolver = Resolver::new(&plan, &store);
    let options = Options::of_tests(1);
    let survey = resolver.survey(&[]);
    let mut summary = run(&resolver, survey, &options, &Lines::default(), &Interrupt::default()).unwrap();
    assert_eq!(summary.ends.len(), 1);
    let (ran, brief) = match summary.ends.drain().next() {
        Some((_, End::Hit(brief))) => (false, brief),
        Some((_, End::Ran(brief))) => (true, brief),
        other => panic!("{other:?}"),
    };
    (ran, store.record(&brief.key).expect("it was published"))
}

fn made(record: &InstanceRecord) -> f64 {
    record.measures.iter().find(|measure| measure.0 == "strides").expect("it measures them").1
}

/// The clock stops it somewhere: the same file is up to date, what asks for as many strides is it, and another port is made of just as many.
#[test]
fn what_the_clock_stopped_is_what_asks_for_what_it_reached() {
    let folder = tempfile::tempdir().unwrap();
    let timed = "{patience: 0.05}";
    let (ran, first) = strides(folder.path(), timed, &["made"]);
    let n = made(&first);
    assert!(ran && n >= 1.0);
    assert_eq!(first.reached, Some([("strides".to_owned(), json!(n as u64))].into()));
    assert!(!strides(folder.path(), timed, &["made"]).0);
    let (ran, plain) = strides(folder.path(), &format!("{{strides: {n}}}"), &["made"]);
    assert!(!ran && plain.ports == first.ports && plain.key != first.key);
    let (ran, both) = strides(folder.path(), timed, &["made", "again"]);
    assert!(ran && made(&both) == n && both.ports["made"] == first.ports["made"], "{both:?}");
    assert_eq!((&both.reached, both.ports["again"].blob.digest), (&first.reached, first.ports["made"].blob.digest));
}

/// Without a clock nothing but the params says where it stops: one record, whatever was kept on the way.
#[test]
fn what_asks_for_no_time_is_stored_once() {
    let folder = tempfile::tempdir().unwrap();
    let (_, record) = strides(folder.path(), "{strides: 3}", &["made"]);
    assert_eq!(record.reached, None);
    assert_eq!(Store::open(&folder.path().join("outputs")).unwrap().stat().unwrap().records, 1);
}

/// CPU time of what was made before is part of the cost of a run that goes on from it, once; what cannot be gone on from costs nothing. Equal strides
/// vary by a tenth or two with what else runs, and by much more on a loaded machine: so what was made before costs eight times as much as what is added.
#[test]
fn a_continued_run_costs_the_whole() {
    let folder = tempfile::tempdir().unwrap();
    let cost = |with: &str| strides(folder.path(), with, &["made"]).1.cost.cpu_s;
    let eight = cost("{strides: 8}");
    let nine = cost("{strides: 9}");
    assert!(eight > 0.0 && nine > eight && nine < 2.0 * eight, "{eight} s, then {nine} s");
    let long = cost("{strides: 1, weight: 16, torn: true}");
    let short = cost("{strides: 2, torn: true}");
    assert!(short > 0.0 && short < long, "{long} s, then {short} s");
}
