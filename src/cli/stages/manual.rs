//! The manual of a stage as text for a terminal.

use turbid_contract::StageRow;

use super::fields::{Field, ITEM, NAME, Presence, fields};
use super::{arity, example};

/// How deep the manual follows parameters; deeper ones are in `turbid stages NAME --markdown` and `turbid schema`.
const DEPTH: usize = 4;

pub fn manual(row: &StageRow) -> String {
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
        for held in port.holds {
            let unit = held.unit.map_or_else(String::new, |unit| format!(" ({unit})"));
            text.push_str(&format!("  {:<14}   {}{unit}: {}\n", "", held.name, held.about));
        }
    }
    text.push_str("\nwith:\n");
    fields(&(row.schema)()).iter().for_each(|field| text.push_str(&line(field)));
    if let Some(example) = example::of(row.name) {
        let indented = example.lines().map(|line| format!("  {line}\n").replace("  \n", "\n"));
        text.push_str(&format!("\nexample:\n{}", indented.collect::<String>()));
    }
    if !row.stopping.is_empty() {
        text.push_str(&format!(
            "\nA longer run continues a shorter one: {} only say when to stop.\n",
            row.stopping.join(", ")
        ));
    }
    text
}

/// A parameter and the words that it may be, a line each; empty beyond [`DEPTH`].
fn line(field: &Field) -> String {
    let depth = field.path.iter().filter(|part| *part != NAME && *part != ITEM).count();
    let Some(name) = field.path.last().filter(|_| depth <= DEPTH) else { return String::new() };
    let presence = match &field.presence {
        Presence::Required => " (required)".to_owned(),
        Presence::OneOf => " (one of these)".to_owned(),
        Presence::Default(value) => format!(" [{value}]"),
        Presence::Optional => String::new(),
    };
    // What it holds stands at the end, unless the words below say it.
    let said = match (field.about.is_empty(), field.choices.is_empty()) {
        (true, _) => field.kind.clone(),
        (false, true) => format!("{} ({})", field.about, field.kind),
        (false, false) => field.about.clone(),
    };
    let mut text = format!("{:width$}{name}{presence}: {said}\n", "", width = 2 * depth);
    for (word, meaning) in &field.choices {
        let meaning = if meaning.is_empty() { String::new() } else { format!(": {meaning}") };
        text.push_str(&format!("{:width$}- {word}{meaning}\n", "", width = 2 * (depth + 1)));
    }
    text
}
