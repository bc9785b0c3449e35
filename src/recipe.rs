//! What a pipeline would do, as one digest: known before anything runs, and without a store.

use crate::digest::{Digest, PartHasher};
use crate::input_file;
use crate::plan::Plan;
use turbid_contract::canonical::canonical_text;

const FORMAT: &str = "turbid recipe 1";

/// Two plans with one recipe make the same results under the same names: stages with their VERSIONs, canonical params, wires, input files, seeds.
///
/// Comments, YAML order, spelling and wanted ports are not in it. Error: params that cannot be read, or an input file that is not there.
pub fn recipe(plan: &Plan) -> Result<Digest, String> {
    let mut parts = PartHasher::new(FORMAT);
    for id in plan.needed_instances() {
        let stage = plan.stage_of(id);
        let row = plan.row(stage);
        parts.add("instance", plan.label(id).as_bytes());
        parts.add(row.name, &row.version.to_le_bytes());
        let told = |messages: Vec<crate::spec::Diagnostic>| {
            messages.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n")
        };
        let params = plan.spec.params(stage, &plan.values(id)).map_err(told)?;
        let job = (row.prepare)(&params).map_err(|e| e.to_string())?;
        parts.add("with", canonical_text(&job.canonical()?).as_bytes());
        for wire in &plan.wires(id) {
            for (source, port) in &wire.from {
                parts.add(wire.port, format!("{} {port}", plan.label(*source)).as_bytes());
            }
        }
        for file in &job.files() {
            let path = plan.spec.input_file_base(stage, &file.at).join(&file.path);
            let read = input_file::digest(&path, file.most);
            let (digest, _) = read.map_err(|refused| format!("{}: {refused}", path.display()))?;
            parts.add(&file.at, &digest.0);
        }
        if job.draws() {
            parts.add("axes", plan.axes_text(id).as_bytes());
            parts.add("seed", format!("{} {:?}", plan.spec.seed, plan.spec.stages[stage].seed).as_bytes());
        }
    }
    Ok(parts.finish())
}
