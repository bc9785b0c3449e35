//! `turbid stages`: the kinds of stages, or the manual of one: params, units, defaults, ports.

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
}

impl Stages {
    pub fn run(&self, registry: &Registry) -> Done {
        match &self.name {
            None if self.json => {
                print_json(&Value::from(registry.rows().iter().map(to_json).collect::<Vec<_>>()).to_string())
            }
            None => {
                for row in registry.rows() {
                    print(&format!("{:<14} {}", row.name, row.about));
                }
            }
            Some(name) => {
                let row = registry.find(name).ok_or_else(|| {
                    let hint = nearest(name, registry.rows().iter().map(|r| r.name));
                    Failure::Input(format!(
                        "there is no stage kind `{name}`{}",
                        hint.map(|h| format!("; did you mean `{h}`?")).unwrap_or_default()
                    ))
                })?;
                if self.json { print_json(&to_json(row).to_string()) } else { print(&manual(row)) }
            }
        }
        Ok(())
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

fn manual(row: &StageRow) -> String {
    let mut text = format!("{} (version {})\n  {}\n", row.name, row.version, row.about);
    let inputs = (row.inputs)();
    if !inputs.is_empty() {
        text.push_str("\nin:\n");
        for port in inputs {
            text.push_str(&format!("  {:<14} {} ({}): {}\n", port.name, port.payload, arity(port.arity), port.about));
        }
    }
    text.push_str("\nout:\n");
    for port in (row.outputs)() {
        let when = if port.optional { " (when wanted)" } else { "" };
        text.push_str(&format!("  {:<14} {}{when}: {}\n", port.name, port.payload, port.about));
    }
    let schema = (row.schema)();
    text.push_str("\nwith:\n");
    fields(&schema, &schema, 1, false, &mut text);
    if let Some(example) = example(row.name) {
        text.push_str(&format!("\nexample:\n{example}"));
    }
    if !row.stopping.is_empty() {
        text.push_str(&format!(
            "\nA longer run continues a shorter one: {} only say when to stop.\n",
            row.stopping.join(", ")
        ));
    }
    text
}

/// How deep the manual follows fields; deeper ones are in `turbid schema`.
const DEPTH: usize = 4;

/// The fields of a schema, one line each; `option`: they are one way of several, of which none is required.
fn fields(root: &Value, schema: &Value, depth: usize, option: bool, text: &mut String) {
    let schema = follow(root, schema);
    let required: Vec<&str> = schema["required"].as_array().into_iter().flatten().filter_map(Value::as_str).collect();
    for (name, field) in schema["properties"].as_object().into_iter().flatten() {
        let target = follow(root, field);
        let about = field["description"].as_str().or(target["description"].as_str()).unwrap_or_default();
        let about = if about.is_empty() { kind(root, target) } else { about.replace('\n', " ") };
        let default = match field.get("default") {
            Some(Value::Null) | None if option => " (one of these)".to_owned(),
            Some(Value::Null) | None if required.contains(&name.as_str()) => " (required)".to_owned(),
            Some(Value::Null) | None => String::new(),
            Some(default) => format!(" [{default}]"),
        };
        text.push_str(&format!("{:width$}{name}{default}: {about}\n", "", width = 2 * depth));
        if depth < DEPTH {
            fields(root, target, depth + 1, false, text);
            for inner in ["items", "additionalProperties"] {
                if target[inner].is_object() {
                    fields(root, &target[inner], depth + 1, false, text);
                }
            }
        }
    }
    for choice in ["oneOf", "anyOf"] {
        for option in schema[choice].as_array().into_iter().flatten() {
            if let Some(name) = option["const"].as_str() {
                let about = option["description"].as_str().unwrap_or_default().replace('\n', " ");
                text.push_str(&format!("{:width$}- {name}: {about}\n", "", width = 2 * depth));
            } else if depth < DEPTH {
                let single = follow(root, option)["properties"].as_object().is_some_and(|fields| fields.len() == 1);
                fields(root, option, depth, single, text);
            }
        }
    }
}

/// What a field without a description holds: `a text`, `3 numbers in mm`, `a map of names`.
fn kind(root: &Value, schema: &Value) -> String {
    let schema = follow(root, schema);
    let unit =
        schema["unit"].as_str().filter(|unit| *unit != "1").map(|unit| format!(" in {unit}")).unwrap_or_default();
    let of = |name: &str| match name {
        "string" if schema["unit"].is_string() => None,
        "string" => Some("a text".to_owned()),
        "integer" => Some("a whole number".to_owned()),
        "number" => Some(format!("a number{unit}")),
        "boolean" => Some("true or false".to_owned()),
        "array" => {
            let item = if schema["items"].is_object() { kind(root, &schema["items"]) } else { String::new() };
            let count = schema["minItems"].as_u64().filter(|_| schema["minItems"] == schema["maxItems"]);
            Some(match (count, item.strip_prefix("a number")) {
                (Some(count), Some(unit)) => format!("{count} numbers{unit}"),
                (None, Some(unit)) => format!("a list of numbers{unit}"),
                (Some(count), None) => format!("a list of {count}"),
                (None, None) => "a list".to_owned(),
            })
        }
        "object" if schema["additionalProperties"].is_object() => Some("by name".to_owned()),
        "object" => Some("a map".to_owned()),
        _ => None,
    };
    let kinds: Vec<String> = match &schema["type"] {
        Value::String(name) => of(name).into_iter().collect(),
        Value::Array(names) => names.iter().filter_map(Value::as_str).filter_map(of).collect(),
        _ => vec!["one of".to_owned()],
    };
    kinds.join(" or ")
}

/// Where stages describe themselves; the first block of YAML that uses a stage is its example.
const SOURCES: [&str; 14] = [
    include_str!("../../stages/calibrate/src/lib.rs"),
    include_str!("../../stages/compare/src/lib.rs"),
    include_str!("../../stages/demodulate/src/lib.rs"),
    include_str!("../../stages/dis/src/lib.rs"),
    include_str!("../../stages/iad/src/stage.rs"),
    include_str!("../../stages/import/src/lib.rs"),
    include_str!("../../stages/invert/src/lib.rs"),
    include_str!("../../stages/lut/src/lib.rs"),
    include_str!("../../stages/pattern/src/lib.rs"),
    include_str!("../../stages/profilometry/src/lib.rs"),
    include_str!("../../stages/render/src/lib.rs"),
    include_str!("../../stages/scene/src/lib.rs"),
    include_str!("../../stages/section/src/lib.rs"),
    include_str!("../../stages/sensor/src/lib.rs"),
];

fn example(name: &str) -> Option<String> {
    let uses = format!("use: {name}");
    // `compare` is not `compare_all`.
    let ends = |rest: &str| rest.chars().next().is_none_or(|c| !c.is_alphanumeric() && c != '_');
    let used = |block: &&str| block.match_indices(&uses).any(|(at, _)| ends(&block[at + uses.len()..]));
    let blocks = SOURCES.iter().flat_map(|source| source.split("//! ```yaml\n").skip(1));
    let block = blocks.filter_map(|rest| rest.split("//! ```").next()).find(used)?;
    let plain = |line: &str| line.trim_start_matches("//!").strip_prefix(' ').unwrap_or_default().to_owned();
    Some(block.lines().map(|line| format!("  {}\n", plain(line)).replace("  \n", "\n")).collect())
}

fn follow<'a>(root: &'a Value, schema: &'a Value) -> &'a Value {
    let mut schema = schema;
    // A schema that refers to itself ends at the depth limit of the caller.
    while let Some(pointer) = schema["$ref"].as_str().and_then(|r| r.strip_prefix('#')) {
        match root.pointer(pointer) {
            Some(target) => schema = target,
            None => break,
        }
    }
    schema
}
