//! The reference page of a stage, and the list of all, as Markdown: `docs/reference` holds what this writes.

use turbid_contract::StageRow;

use super::fields::{Field, Presence, fields};
use super::{arity, example};

/// The page of one stage: ports, parameters, an example.
pub fn page(row: &StageRow) -> String {
    let mut text = format!("# {}\n\n{}.\n", row.name, sentence(row.about.trim_end_matches('.')));
    let inputs = (row.inputs)().into_iter().map(|port| {
        let takes: Vec<String> = port.accepts.iter().map(|payload| linked(payload)).collect();
        vec![code(port.name), takes.join(", "), arity(port.arity).to_owned(), port.about.to_owned()]
    });
    section(&mut text, "Inputs", ["port", "takes", "how many", "what"], inputs.collect());
    let outputs = (row.outputs)().into_iter().map(|port| {
        let when = if port.optional { "when wanted" } else { "always" };
        vec![code(port.name), linked(port.payload), when.to_owned(), port.about.to_owned()]
    });
    section(&mut text, "Outputs", ["port", "holds", "computed", "what"], outputs.collect());
    let rows = fields(&(row.schema)()).iter().map(parameter).collect();
    section(&mut text, "Parameters", ["parameter", "type, unit", "default", "what"], rows);
    if !row.stopping.is_empty() {
        let names: Vec<String> = row.stopping.iter().map(|name| code(name)).collect();
        text.push_str(&format!(
            "\nA longer run continues a shorter one: {} only say when to stop.\n",
            names.join(", ")
        ));
    }
    if let Some(example) = example::of(row.name) {
        text.push_str(&format!("\n## Example\n\n```yaml fragment\n{}\n```\n", example.trim_end()));
    }
    text
}

/// All stages with links to their pages.
pub fn index(rows: &[StageRow]) -> String {
    let mut text = "# Stages\n\nWhat every stage takes, makes and can be told.\n".to_owned();
    let rows = rows.iter().map(|row| vec![format!("[{0}]({0}.md)", row.name), sentence(row.about)]).collect();
    section(&mut text, "", ["stage", "what it does"], rows);
    text
}

fn parameter(field: &Field) -> Vec<String> {
    let presence = match &field.presence {
        Presence::Required => "required".to_owned(),
        Presence::OneOf => "one of these".to_owned(),
        Presence::Default(value) => code(value),
        Presence::Optional => String::new(),
    };
    let meaning = |(word, meaning): &(String, String)| match meaning.is_empty() {
        true => code(word),
        false => format!("{}: {meaning}", code(word)),
    };
    let about = Some(field.about.clone()).filter(|about| !about.is_empty());
    let said: Vec<String> = about.into_iter().chain(field.choices.iter().map(meaning)).collect();
    vec![code(&field.path.join(".").replace(".[]", "[]")), field.kind.clone(), presence, said.join("<br>")]
}

/// A heading and a table below it; nothing where there are no rows.
fn section<const N: usize>(text: &mut String, title: &str, heads: [&str; N], rows: Vec<Vec<String>>) {
    if rows.is_empty() {
        return;
    }
    if !title.is_empty() {
        text.push_str(&format!("\n## {title}\n"));
    }
    let line = |cells: Vec<String>| {
        let cells: String = cells.iter().map(|c| format!(" {} |", c.replace('|', "\\|"))).collect();
        format!("|{cells}\n").replace("|  |", "| |")
    };
    text.push('\n');
    text.push_str(&line(heads.map(str::to_owned).to_vec()));
    text.push_str(&format!("|{}\n", "---|".repeat(N)));
    rows.into_iter().for_each(|cells| text.push_str(&line(cells)));
}

/// The name of a payload, which leads to its layers or columns.
fn linked(payload: &str) -> String {
    format!("[{payload}](../payloads.md#{payload})")
}

/// With a capital, unless it begins with a symbol such as `mu_a`.
fn sentence(text: &str) -> String {
    let symbol = text.split_whitespace().next().is_some_and(|word| word.contains('_'));
    match text.chars().next().filter(|_| !symbol) {
        Some(first) => format!("{}{}", first.to_uppercase(), &text[first.len_utf8()..]),
        None => text.to_owned(),
    }
}

fn code(text: &str) -> String {
    format!("`{text}`")
}
