//! Rules that hold for the outputs of every stage, and that a test can see.

use std::collections::BTreeMap;

use serde_json::Value;

use crate::artifact::{Artifact, Cells, ImageStack, Table};
use crate::kit::Trial;

/// The outputs of a run by port.
type Ports = BTreeMap<&'static str, Artifact>;

impl Trial {
    /// Runs the stage several times and asserts what the engine and the stages behind it take for granted:
    ///
    /// - `check` finds no mistake, and canonical params read back are themselves;
    /// - outputs are as `describe` says;
    /// - the same bytes on one thread and on three, whose tiles come in another order;
    /// - all ports that are declared and wanted, of their kind; optional ones change nothing of the others;
    /// - every layer and column has a name and a unit ("1" for pure numbers, "" for text), no two layers say the same of themselves, and no value is
    ///   NaN or infinite.
    pub fn keeps_the_rules(&self) {
        let (stage, (mistakes, _)) = (self.row.name, self.check());
        assert!(mistakes.is_empty(), "{stage}: {mistakes:#?}");
        self.canonical_params_are_themselves();
        let run = |trial: &Self| {
            let made = trial.run().unwrap_or_else(|error| panic!("{stage}: {error}"));
            trial.makes_what_it_declares(&made.ports);
            made.ports
        };
        let made = run(&self.clone().threads(1));
        for (port, artifact) in &made {
            let wrong = match artifact {
                Artifact::Images(stack) => wrong_layer(stack),
                Artifact::Table(table) => wrong_column(table),
                Artifact::Record(_) => None,
            };
            assert!(wrong.is_none(), "{stage}: `{port}`: {}", wrong.unwrap_or_default());
        }
        assert!(run(&self.clone().threads(3)) == made, "{stage}: three threads give other outputs than one");
        let alone = run(&Self { wanted: Vec::new(), ..self.clone() });
        for (port, artifact) in &alone {
            assert!(made.get(port) == Some(artifact), "{stage}: `{port}` depends on which optional ports are wanted");
        }
    }

    fn canonical_params_are_themselves(&self) {
        let read = |params: &Value| {
            let canonical = self.clone().with(params.clone()).job().canonical();
            canonical.unwrap_or_else(|error| panic!("{}: canonical params: {error}", self.row.name))
        };
        let once = read(&self.params);
        assert_eq!(read(&once), once, "{}: canonical params, read back, are others", self.row.name);
    }

    fn makes_what_it_declares(&self, made: &Ports) {
        let (stage, declared) = (self.row.name, (self.row.outputs)());
        for port in &declared {
            let wanted = !port.optional || self.wanted.iter().any(|wanted| wanted == port.name);
            assert_eq!(made.contains_key(port.name), wanted, "{stage}: whether `{}` is made and wanted", port.name);
        }
        for (name, artifact) in made {
            let port = declared.iter().find(|port| port.name == *name);
            let port = port.unwrap_or_else(|| panic!("{stage}: `{name}` is not among its output ports"));
            assert_eq!(artifact.kind(), port.kind, "{stage}: kind of `{name}`");
        }
    }
}

fn wrong_layer(stack: &ImageStack) -> Option<String> {
    let mut seen = Vec::new();
    for layer in &stack.layers {
        let info = &layer.info;
        if info.name.is_empty() || info.unit.is_empty() {
            return Some(format!("layer `{}` has unit `{}`; pure numbers have \"1\"", info.name, info.unit));
        }
        if let Some(((row, column), value)) = layer.data.indexed_iter().find(|(_, value)| !value.is_finite()) {
            return Some(format!(
                "layer `{}` is {value} at row {row}, column {column}; mask it, with a reason",
                info.name
            ));
        }
        let mut identity = info.clone();
        identity.mean_se = None;
        if seen.contains(&identity) {
            return Some(format!("two layers say the same of themselves: {identity:?}"));
        }
        seen.push(identity);
    }
    None
}

fn wrong_column(table: &Table) -> Option<String> {
    table.columns.iter().find_map(|column| {
        let text = matches!(column.cells, Cells::Text(_) | Cells::Bool(_));
        if column.name.is_empty() || (column.unit.is_empty() && !text) {
            return Some(format!("column `{}` has no unit; pure numbers have \"1\"", column.name));
        }
        let finite = match &column.cells {
            Cells::F64(values) => values.iter().all(|v| v.is_finite()),
            Cells::MaybeF64(values) => values.iter().flatten().all(|v| v.is_finite()),
            _ => true,
        };
        (!finite)
            .then(|| format!("column `{}` has a value that is no finite number; what is unknown is null", column.name))
    })
}
