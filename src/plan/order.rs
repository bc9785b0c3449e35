//! In which order the stages of a pipeline come.

use crate::ids::{IdVec, StageId};
use crate::spec::Spec;

/// Stages in an order in which inputs come first (file order where free), or a cycle.
///
/// By the names that inputs give, whether or not ports and payloads fit: those hardly ever do in a circle.
pub fn topological(spec: &Spec) -> Result<Vec<StageId>, Vec<StageId>> {
    #[derive(Clone, Copy, PartialEq)]
    enum Mark {
        New,
        Open,
        Done,
    }
    let sources = |stage: StageId| -> Vec<StageId> {
        let named = spec.stages[stage].inputs.iter().flat_map(|input| &input.sources);
        named.filter_map(|source| spec.stage(&source.stage)).collect()
    };
    let mut marks = IdVec::<StageId, _>::filled(Mark::New, spec.stages.len());
    let mut order = Vec::new();
    for root in spec.stages.ids() {
        // An explicit stack: a chain of a million stages must not end the process.
        let mut path: Vec<(StageId, Vec<StageId>)> = Vec::new();
        if marks[root] == Mark::New {
            marks[root] = Mark::Open;
            path.push((root, sources(root)));
        }
        while let Some((stage, rest)) = path.last_mut() {
            match rest.pop() {
                Some(next) if marks[next] == Mark::New => {
                    marks[next] = Mark::Open;
                    path.push((next, sources(next)));
                }
                Some(next) if marks[next] == Mark::Open => {
                    let start = path.iter().position(|(s, _)| *s == next).expect("open stages are on the path");
                    let mut cycle: Vec<StageId> = path[start..].iter().map(|(s, _)| *s).collect();
                    cycle.reverse();
                    let first = cycle.iter().copied().min().expect("a cycle has stages");
                    let turn = cycle.iter().position(|&s| s == first).expect("it is in it");
                    cycle.rotate_left(turn);
                    cycle.push(first);
                    return Err(cycle);
                }
                Some(_) => {}
                None => {
                    marks[*stage] = Mark::Done;
                    order.push(*stage);
                    path.pop();
                }
            }
        }
    }
    Ok(order)
}
