//! `turbid stages`: the kinds of stages, or the manual of one: params, units, defaults, ports.

mod example;
mod fields;
mod manual;
mod markdown;

use clap::Args;
use serde_json::{Value, json};
use turbid_contract::{Arity, StageRow};

use crate::registry::Registry;
use crate::spec::nearest;

use super::{Done, Failure, print, print_json};

#[derive(Args)]
pub struct Stages {
    /// The stage whose manual to print
    name: Option<String>,
    #[arg(long)]
    json: bool,
    /// Print the reference page, with every parameter, as Markdown
    #[arg(long, conflicts_with = "json")]
    markdown: bool,
}

impl Stages {
    pub fn run(&self, registry: &Registry) -> Done {
        let Some(name) = &self.name else {
            self.list(registry.rows());
            return Ok(());
        };
        let row = registry.find(name).ok_or_else(|| {
            let hint = nearest(name, registry.rows().iter().map(|r| r.name));
            Failure::Input(format!(
                "there is no stage kind `{name}`{}",
                hint.map(|h| format!("; did you mean `{h}`?")).unwrap_or_default()
            ))
        })?;
        if self.json {
            print_json(&to_json(row).to_string());
        } else {
            print(&if self.markdown { markdown::page(row) } else { manual::manual(row) });
        }
        Ok(())
    }

    fn list(&self, rows: &[StageRow]) {
        if self.json {
            print_json(&Value::from(rows.iter().map(to_json).collect::<Vec<_>>()).to_string());
        } else if self.markdown {
            print(&markdown::index(rows));
        } else {
            rows.iter().for_each(|row| print(&format!("{:<14} {}", row.name, row.about)));
        }
    }
}

fn to_json(row: &StageRow) -> Value {
    let inputs: Vec<Value> = (row.inputs)()
        .iter()
        .map(|p| json!({"name": p.name, "payload": p.payload, "arity": arity(p.arity), "about": p.about}))
        .collect();
    let outputs: Vec<Value> = (row.outputs)()
        .iter()
        .map(|p| json!({"name": p.name, "payload": p.payload, "optional": p.optional, "about": p.about}))
        .collect();
    json!({"name": row.name, "version": row.version, "about": row.about, "in": inputs, "out": outputs, "with": (row.schema)()})
}

fn arity(arity: Arity) -> &'static str {
    match arity {
        Arity::One => "one",
        Arity::Optional => "optional",
        Arity::Many => "many",
        Arity::Some => "one or more",
    }
}
