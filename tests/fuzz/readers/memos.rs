//! Memos: the short way of a run that has nothing to do.

use std::collections::BTreeMap;
use std::fs;
use std::sync::{Arc, LazyLock};

use tempfile::TempDir;
use turbid::brief::Brief;
use turbid::memo;
use turbid::plan::Plan;
use turbid::registry::Registry;
use turbid::resolve::Resolver;
use turbid::spec;
use turbid::store::{Cost, InstanceRecord, PortRecord, Provenance, Recipe, Store};
use turbid_contract::{Artifact, Record};

use super::{Reader, Seen, no_more, nothing};
use crate::mutate::Form;

pub fn readers() -> Vec<Reader> {
    vec![Reader {
        name: "memo",
        form: Form::Digested,
        share: 1,
        claims: nothing,
        seeds: || vec![WORLD.memo(&WORLD.plan)],
        read,
        law: no_more,
    }]
}

/// Two pipelines that differ in a number, and a store that holds the results of both.
struct World {
    folder: TempDir,
    plan: Plan,
    other: Plan,
    store: Store,
    right: Vec<Arc<Brief>>,
}

static WORLD: LazyLock<World> = LazyLock::new(World::new);

impl World {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let store = Store::open(folder.path()).expect("the folder is ours");
        let [plan, other] = ["0.05", "0.06"].map(|mu_a| plan(folder.path(), mu_a));
        let [right, wrong] = [&plan, &other].map(|plan| publish(plan, &store));
        store.finish().expect("the folder is ours");
        for (plan, records) in [(&plan, &right), (&other, &wrong)] {
            memo::keep(plan, &records.iter().collect::<Vec<_>>(), &[], &folder.path().join("kept"));
        }
        Self { folder, plan, other, store, right }
    }

    /// The bytes of the memo of a plan.
    fn memo(&self, plan: &Plan) -> Vec<u8> {
        let path = self.folder.path().join("kept").join(memo::identity(plan).to_string());
        fs::read(path).expect("it was kept")
    }
}

fn plan(folder: &std::path::Path, mu_a: &str) -> Plan {
    let path = folder.join(format!("p{mu_a}.yaml"));
    fs::write(&path, PIPELINE.replace("MU_A", mu_a)).expect("the folder is ours");
    let spec = spec::load(&path, &[]).expect("the pipeline is right");
    Plan::build(spec, spec::Report::default(), &Registry::builtin(), &[]).expect("the pipeline is right")
}

/// Results of all instances, as a run leaves them.
fn publish(plan: &Plan, store: &Store) -> Vec<Arc<Brief>> {
    let resolver = Resolver::new(plan, store);
    let publish = |id| {
        let key = resolver.keyed(id, &plan.instances().map(|_| None).collect()).expect("the pipeline is right").key;
        let artifact =
            Artifact::Record(Record { fields: BTreeMap::from([("key".to_owned(), key.to_string().into())]) });
        let blob = store.put(&artifact).expect("there is no number in it");
        let port = PortRecord { payload: "scene".into(), blob };
        let stage = plan.stage_of(id);
        let wanted = plan.wanted(stage);
        let record = InstanceRecord {
            key,
            use_name: "scene".into(),
            version: 1,
            ports: wanted.iter().map(|name| ((*name).to_owned(), port.clone())).collect(),
            cost: Cost::default(),
            seed: None,
            state_key: None,
            reached: None,
            measures: Vec::new(),
            warnings: Vec::new(),
            kernel: None,
            refused: Vec::new(),
            provenance: Provenance::default(),
        };
        store.publish(&record, &Recipe::default()).expect("its numbers are finite");
        let record = store.record(&key).expect("it was published");
        Arc::new(Brief::of(&record, plan.outputs(stage)))
    };
    plan.needed_instances().map(publish).collect()
}

/// A memo gives the results of its own pipeline or none, whatever became of it; that of another pipeline under its name gives none.
fn read(input: &[u8]) -> Result<Seen, String> {
    let folder = tempfile::tempdir().map_err(|e| e.to_string())?;
    let recall = |plan: &Plan, bytes: &[u8]| {
        fs::write(folder.path().join(memo::identity(plan).to_string()), bytes).map_err(|e| e.to_string())?;
        Ok::<_, String>(memo::recall(plan, &WORLD.store, folder.path()).map(|found| found.briefs))
    };
    let found = recall(&WORLD.plan, input)?;
    if found.as_ref().is_some_and(|found| *found != WORLD.right) {
        return Err("a memo led to results that are not those of its pipeline".to_owned());
    }
    if recall(&WORLD.other, input)?.is_some_and(|found| found == WORLD.right) {
        return Err("a memo under the name of another pipeline gave its results for that one's".to_owned());
    }
    Ok(Seen::as_large(found.is_some(), input))
}

const PIPELINE: &str = "\
pipeline: p
stages:
  slab:
    use: scene
    with:
      media: {m: {mu_a: MU_A, mu_s_prime: 1, g: 0.8, n: 1.0}}
      objects: {s: {slab: {thickness: 100, top: 0}, medium: m}}
      camera: {position: [0, 0, 500], look_at: [0, 0, 0], field: [8, 8], pixels: [8, 8]}
      projector: {position: [35, 0, 500], look_at: [0, 0, 0], field: [32, 32], power: 5}
";
