//! Which outputs feed which inputs, stage by stage: the graph as people look at it.

use std::collections::HashSet;

use super::{Plan, StageId};

/// An output of a stage that feeds an input of another.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Edge {
    pub from: StageId,
    pub output: &'static str,
    pub to: StageId,
    pub input: &'static str,
}

impl Edge {
    /// The port, or both where their names differ.
    pub fn label(&self) -> String {
        if self.output == self.input { self.input.to_owned() } else { format!("{} → {}", self.output, self.input) }
    }
}

impl Plan {
    /// Every edge once. The instances of a stage are wired alike, so the first one tells those of its stage.
    pub fn edges(&self) -> Vec<Edge> {
        let (mut edges, mut known) = (Vec::new(), HashSet::new());
        for &(_, to) in &self.starts {
            let Some(first) = self.instances_of(to).into_iter().next() else { continue };
            for wire in self.wires(first) {
                for (source, output) in wire.from {
                    let edge = Edge { from: self.stage_of(source), output, to, input: wire.port };
                    if known.insert(edge) {
                        edges.push(edge);
                    }
                }
            }
        }
        edges
    }
}
