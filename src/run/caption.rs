//! What a picture of `outputs/latest` says of the run that it comes from.

use std::collections::{BTreeMap, BTreeSet};

use crate::digest::{Digest, PartHasher};
use crate::plan::{InstanceId, Plan, StageId};
use crate::preview::Caption;
use crate::store::Blob;

/// Raised whenever pictures of the same artifact look different: those of an older turbid are then drawn anew.
const PICTURES: &str = "3";

/// `pipeline · stage[axes] · port`; of [`overrides`] those of the stage (`set`); the key of the instance. What of the run did not matter to the
/// artifact (its time, other overrides) is left out, so that equal artifacts keep equal pictures.
pub fn caption(plan: &Plan, id: InstanceId, key: &Digest, port: &str, blob: &Blob, set: &[String]) -> Caption {
    of(plan, id, key, port, set, ("Content", blob.digest.to_string()))
}

/// The same of what an instance has before it ends; `done`: how much that is.
pub fn so_far(plan: &Plan, id: InstanceId, key: &Digest, port: &str, set: &[String], done: &str) -> Caption {
    let caption = of(plan, id, key, port, set, ("So far", done.to_owned()));
    let words = [format!("so far: {done}"), caption.subtitle].into_iter().filter(|text| !text.is_empty());
    Caption { subtitle: words.collect::<Vec<_>>().join(" · "), ..caption }
}

/// `last`: what tells artifacts of one key apart.
fn of(plan: &Plan, id: InstanceId, key: &Digest, port: &str, set: &[String], last: (&'static str, String)) -> Caption {
    let (pipeline, stage) = (&plan.spec.pipeline, &plan.spec.stages[plan.stage_of(id)]);
    let facts = [
        ("Title", format!("{pipeline} {} {port}", plan.label(id))),
        ("Software", concat!("turbid ", env!("CARGO_PKG_VERSION")).to_owned()),
        ("Pipeline", pipeline.clone()),
        ("Stage", stage.name.clone()),
        ("Stage kind", stage.use_name.clone()),
        ("Axes", plan.axes_text(id)),
        ("Port", port.to_owned()),
        ("Overrides", set.join("\n")),
        ("Key", key.to_string()),
        last,
    ];
    Caption {
        title: format!("{pipeline} · {} · {port}", plan.label(id)),
        subtitle: set.join(" "),
        facts: facts.into_iter().filter(|(_, text)| !text.is_empty()).collect(),
    }
}

/// Stands for a picture: equal for the same artifact under the same caption.
pub fn fingerprint(caption: &Caption) -> String {
    let mut parts = PartHasher::new("turbid picture");
    parts.add("pictures", PICTURES.as_bytes());
    for (keyword, text) in &caption.facts {
        parts.add(keyword, text.as_bytes());
    }
    parts.finish().to_string()
}

/// For each needed stage the overrides that it, or a stage that feeds it, depends on, as they were given.
pub fn overrides(plan: &Plan) -> BTreeMap<StageId, Vec<String>> {
    let mut found: BTreeMap<StageId, BTreeSet<usize>> = BTreeMap::new();
    // Sources come first.
    for &stage in &plan.needed {
        let own = found.entry(stage).or_default();
        own.extend(plan.spec.overrides_of(stage));
        let passed = own.clone();
        for &consumer in plan.consumers(stage) {
            found.entry(consumer).or_default().extend(&passed);
        }
    }
    let texts =
        |places: BTreeSet<usize>| places.into_iter().map(|i| format!("--set {}", plan.spec.overrides[i])).collect();
    found.into_iter().map(|(stage, places)| (stage, texts(places))).collect()
}
