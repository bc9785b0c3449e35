//! Mistakes in params, found although the graph is not whole: so that the user sees all mistakes at once.

use turbid_contract::{Axes, Known, Problems};

use crate::spec::{Diagnostic, Section, Spec, read_params};

use super::{IdVec, StageId, StageInfo};

/// Reads and checks the params of every stage that can be read by itself.
pub fn params(spec: &Spec, infos: &IdVec<StageId, Option<StageInfo>>) -> Vec<Diagnostic> {
    let mut found = Vec::new();
    for (stage, info) in infos.iter_ids() {
        let Some(info) = info else { continue };
        let stage_spec = &spec.stages[stage];
        let first = stage_spec.foreach.rows.first();
        let mut axes: Axes =
            stage_spec.foreach.names.iter().cloned().zip(first.into_iter().flatten().cloned()).collect();
        if let Some(draw) = &stage_spec.foreach.draw {
            draw.put_into(&mut axes);
        }
        // Axes that come with inputs are not known here; what depends on them is found in a whole graph.
        let Ok(params) = spec.params(stage, &axes) else { continue };
        let (job, problems) = read_params(&info.row, &params);
        found.extend(problems.into_iter().map(|p| spec.diagnostic(stage, Section::With, &p.path, p.mistake, None)));
        if let Some(job) = job {
            let connected = stage_spec.inputs.iter().map(|i| i.port.clone()).collect();
            let mut problems = Problems::default();
            job.check(&Known { connected, ..Known::default() }, &mut problems);
            found.extend(problems.into_parts().0.into_iter().map(|problem| spec.problem(stage, problem)));
        }
    }
    found
}
