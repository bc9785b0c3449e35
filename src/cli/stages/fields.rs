//! The parameters of a stage, read from its JSON Schema: what the manual and the reference pages list.

use serde_json::Value;

/// One parameter, or one of several ways to write one.
pub struct Field {
    /// Where it stands below `with`. `NAME` is a name that the user chooses, `[]` an item of a list.
    pub path: Vec<String>,
    /// What may stand there, with unit and range: `number, mm`, `2 whole numbers >= 1`.
    pub kind: String,
    pub presence: Presence,
    /// What it is; empty where the schema does not say.
    pub about: String,
    /// The words that may stand there, each with what it means.
    pub choices: Vec<(String, String)>,
}

/// Whether a parameter has to be there.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Presence {
    Required,
    /// One of several ways, of which none is required.
    OneOf,
    Default(String),
    /// May be left out, and then is not there.
    Optional,
}

/// A name that the user chooses.
pub const NAME: &str = "NAME";
/// An item of a list.
pub const ITEM: &str = "[]";

/// Schemas may refer to themselves; nothing that is written by hand goes deeper.
const DEPTH: usize = 12;

/// All parameters that `schema` knows, each before those inside of it.
pub fn fields(schema: &Value) -> Vec<Field> {
    let mut walk = Walk { root: schema, fields: Vec::new() };
    walk.inside(schema, &[], false);
    walk.fields
}

struct Walk<'a> {
    root: &'a Value,
    fields: Vec<Field>,
}

impl<'a> Walk<'a> {
    /// Adds what stands inside of `schema`; `option`: it is one of several ways.
    fn inside(&mut self, schema: &'a Value, path: &[String], option: bool) {
        if path.len() > DEPTH {
            return;
        }
        let below = |name: &str| [path, &[name.to_owned()]].concat();
        let required: Vec<&str> = texts(&schema["required"]).collect();
        for (name, field) in schema["properties"].as_object().into_iter().flatten() {
            let target = self.target(field);
            let presence = match field.get("default") {
                Some(default) if !default.is_null() => Presence::Default(plain(default)),
                _ if option => Presence::OneOf,
                _ if required.contains(&name.as_str()) => Presence::Required,
                _ => Presence::Optional,
            };
            let path = below(name);
            self.fields.push(Field {
                path: path.clone(),
                kind: self.kind(target),
                presence,
                about: about(field).or_else(|| about(target)).unwrap_or_default(),
                choices: choices(target),
            });
            self.inside(target, &path, false);
        }
        for way in ways(schema) {
            let way = self.target(way);
            let single = way["properties"].as_object().is_some_and(|fields| fields.len() == 1);
            self.inside(way, path, single);
        }
        for (inner, name) in [("additionalProperties", NAME), ("items", ITEM)] {
            if schema[inner].is_object() {
                self.inside(self.target(&schema[inner]), &below(name), false);
            }
        }
    }

    /// What a schema stands for: behind references, and without the `null` that only says that it may be left out.
    fn target(&self, schema: &'a Value) -> &'a Value {
        let mut schema = schema;
        for _ in 0..DEPTH {
            let referred = schema["$ref"].as_str().and_then(|r| r.strip_prefix('#'));
            if let Some(there) = referred.and_then(|pointer| self.root.pointer(pointer)) {
                schema = there;
                continue;
            }
            let mut real = ways(schema).filter(|way| way["type"] != "null");
            match (real.next(), real.next()) {
                (Some(only), None) => schema = only,
                _ => break,
            }
        }
        schema
    }

    /// What a value of `schema` is, in words.
    fn kind(&self, schema: &'a Value) -> String {
        let unit = schema["unit"].as_str();
        let mut kinds: Vec<String> = Vec::new();
        let mut add = |kind: String| {
            if !kinds.contains(&kind) {
                kinds.push(kind);
            }
        };
        for name in texts(&schema["type"]).chain(schema["type"].as_str()) {
            match name {
                // A quantity may be written with its unit.
                "string" if unit.is_some() || !choices(schema).is_empty() => {}
                "string" => add("text".to_owned()),
                "integer" => add(format!("whole number{}", range(schema))),
                "number" => add(format!("number{}{}", of_unit(unit), range(schema))),
                "boolean" => add("true or false".to_owned()),
                "array" => add(self.list(schema)),
                "object" if schema["additionalProperties"].is_object() => add("map by name".to_owned()),
                "object" => add("map".to_owned()),
                _ => {}
            }
        }
        if !choices(schema).is_empty() {
            add("one of the words".to_owned());
        }
        for way in ways(schema).filter(|way| way["const"].is_null()) {
            add(self.kind(self.target(way)));
        }
        kinds.join(" or ")
    }

    fn list(&self, schema: &'a Value) -> String {
        let count = schema["minItems"].as_u64().filter(|_| schema["minItems"] == schema["maxItems"]);
        let item = if schema["items"].is_object() { self.kind(self.target(&schema["items"])) } else { String::new() };
        let several = ["whole number", "number", "text", "map"];
        let plural = several.iter().find_map(|one| item.strip_prefix(one).map(|rest| format!("{one}s{rest}")));
        match (count, plural) {
            (Some(count), Some(items)) => format!("{count} {items}"),
            (Some(count), None) => format!("list of {count}"),
            (None, Some(items)) => format!("list of {items}"),
            (None, None) if item.is_empty() => "list".to_owned(),
            (None, None) => format!("list, each {item}"),
        }
    }
}

/// The alternatives of a schema.
fn ways(schema: &Value) -> impl Iterator<Item = &Value> {
    ["oneOf", "anyOf"].into_iter().flat_map(|which| schema[which].as_array().into_iter().flatten())
}

fn texts(list: &Value) -> impl Iterator<Item = &str> {
    list.as_array().into_iter().flatten().filter_map(Value::as_str)
}

/// What a schema says of itself; what a type of quantity says (`number in mm, ..`) is its kind.
fn about(schema: &Value) -> Option<String> {
    let own = schema["description"].as_str().filter(|_| schema["unit"].is_null());
    // The first paragraph is for users, what follows for programmers.
    own.map(|text| text.split("\n\n").next().unwrap_or_default().replace('\n', " "))
}

/// The words that may stand there.
fn choices(schema: &Value) -> Vec<(String, String)> {
    let own = texts(&schema["enum"]).map(|word| (word.to_owned(), String::new()));
    let ways = ways(schema).flat_map(|way| {
        let said = way["description"].as_str().unwrap_or_default().replace('\n', " ");
        let word = way["const"].as_str().map(|word| (word.to_owned(), said));
        word.into_iter().chain(texts(&way["enum"]).map(|word| (word.to_owned(), String::new())))
    });
    own.chain(ways).collect()
}

fn of_unit(unit: Option<&str>) -> String {
    unit.filter(|unit| *unit != "1").map(|unit| format!(", {unit}")).unwrap_or_default()
}

fn range(schema: &Value) -> String {
    let bounds = [("exclusiveMinimum", ">"), ("minimum", ">="), ("exclusiveMaximum", "<"), ("maximum", "<=")];
    let said = bounds.iter().filter_map(|(key, sign)| Some(format!("{sign} {}", plain(schema.get(key)?))));
    let said: Vec<String> = said.collect();
    if said.is_empty() { String::new() } else { format!(" {}", said.join(" and ")) }
}

/// A value as a user writes it: `3` for 3.0.
fn plain(value: &Value) -> String {
    match value {
        Value::Number(number) => {
            let whole = number.as_f64().filter(|n| n.fract() == 0.0 && n.abs() < 1e15);
            whole.map_or_else(|| number.to_string(), |n| format!("{n:.0}"))
        }
        Value::Array(items) => format!("[{}]", items.iter().map(plain).collect::<Vec<_>>().join(", ")),
        Value::String(text) => text.clone(),
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn found(schema: &Value) -> Vec<(String, String, Presence)> {
        fields(schema).into_iter().map(|f| (f.path.join("."), f.kind, f.presence)).collect()
    }

    /// Each parameter has its unit, range and default, those of maps and lists among them; of several ways none is required.
    #[test]
    fn schemas_become_parameters() {
        let schema = json!({
            "required": ["thickness", "media"],
            "properties": {
                "thickness": {"$ref": "#/$defs/Length"},
                "size": {"type": ["array", "null"], "items": {"$ref": "#/$defs/Length"}, "minItems": 2, "maxItems": 2},
                "count": {"type": "integer", "minimum": 1, "default": 3.0},
                "media": {"type": "object", "additionalProperties": {"properties": {"g": {"type": "number"}}}},
                "method": {"$ref": "#/$defs/Method"},
                "nodes": {"anyOf": [{"$ref": "#/$defs/Nodes"}, {"type": "null"}]},
            },
            "$defs": {
                "Length": {"type": ["number", "string"], "unit": "mm", "description": "number in mm, or text"},
                "Method": {"oneOf": [{"const": "auto", "description": "The cheapest."}, {"enum": ["fit", "path"]}]},
                "Nodes": {"anyOf": [
                    {"type": "array", "items": {"type": "number"}},
                    {"type": "object", "required": ["linspace"], "properties": {"linspace": {"type": "array"}}},
                ]},
            },
        });
        let wanted = [
            ("count", "whole number >= 1", Presence::Default("3".to_owned())),
            ("media", "map by name", Presence::Required),
            ("media.NAME.g", "number", Presence::Optional),
            ("method", "one of the words", Presence::Optional),
            ("nodes", "list of numbers or map", Presence::Optional),
            ("nodes.linspace", "list", Presence::OneOf),
            ("size", "2 numbers, mm", Presence::Optional),
            ("thickness", "number, mm", Presence::Required),
        ];
        let wanted = wanted.map(|(path, kind, presence)| (path.to_owned(), kind.to_owned(), presence));
        assert_eq!(found(&schema), wanted);
        let words: Vec<String> = fields(&schema).into_iter().flat_map(|f| f.choices).map(|(word, _)| word).collect();
        assert_eq!(words, ["auto", "fit", "path"]);
    }
}
