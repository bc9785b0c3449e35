//! JSON Schema of a whole pipeline file, for editors: completion, descriptions, and red lines while typing.

use serde_json::{Map, Value, json};
use turbid_contract::{Arity, StageRow};

use super::study::ERRORS;
use crate::registry::Registry;

/// Where each stage's own definitions live: `#/$defs/render.Params`.
const DEFS: &str = "#/$defs/";

/// The schema (draft 2020-12) of pipelines made of the stages of `registry`.
pub fn schema(registry: &Registry) -> Value {
    let mut defs = shared();
    let mut kinds = Vec::new();
    for row in registry.rows() {
        let (with, own) = params(row);
        defs.extend(own);
        kinds.push(json!({
            "if": {"properties": {"use": {"const": row.name}}, "required": ["use"]},
            "then": {"properties": {"in": inputs(row), "with": with}}
        }));
    }
    let names: Vec<Value> = registry.rows().iter().map(|r| json!({"const": r.name, "description": r.about})).collect();
    defs.insert(
        "stage".to_owned(),
        json!({
            "type": "object",
            "additionalProperties": false,
            "required": ["use"],
            "properties": {
                "use": {"description": "The kind of stage.", "oneOf": names},
                "in": {"description": "Which outputs feed the ports.", "type": "object"},
                "with": {"description": "The parameters.", "type": "object"},
                "foreach": {"$ref": "#/$defs/foreach"},
                "product": {"description": "Combine inputs with different axes to a grid.", "type": "boolean"},
                "seed": {
                    "description": "Replaces the digests of the inputs in the seed, and as {common: N} the axes too: common random numbers.",
                    "anyOf": [
                        {"$ref": "#/$defs/seed"},
                        {"type": "object", "additionalProperties": false, "required": ["common"], "properties": {"common": {"$ref": "#/$defs/seed"}}}
                    ]
                }
            },
            "allOf": kinds
        }),
    );
    json!({
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "turbid pipeline",
        "type": "object",
        "additionalProperties": false,
        "properties": {
            "pipeline": {"description": "The name of the pipeline.", "$ref": "#/$defs/name"},
            "about": {"description": "What it is about.", "type": "string"},
            "seed": {"description": "Seed of all random numbers.", "type": "integer", "minimum": 0},
            "vars": {"description": "Named values for ${name}.", "type": "object", "propertyNames": {"$ref": "#/$defs/name"}},
            "include": {
                "description": "Files merged below this one, relative to it.",
                "anyOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}}]
            },
            "stages": {
                "description": "The steps.",
                "type": "object",
                "propertyNames": {"$ref": "#/$defs/name"},
                "additionalProperties": {"$ref": "#/$defs/stage"}
            },
            "studies": {
                "description": "Sweeps over the whole pipeline.",
                "type": "object",
                "propertyNames": {"$ref": "#/$defs/name"},
                "additionalProperties": {"$ref": "#/$defs/study"}
            }
        },
        "$defs": defs
    })
}

/// Definitions that belong to the grammar.
fn shared() -> Map<String, Value> {
    let number = json!({"anyOf": [{"type": "number"}, {"$ref": "#/$defs/substitution"}]});
    let several = |least: usize, most: usize, what: &str| {
        json!({"description": what, "anyOf": [
            {"type": "array", "items": number, "minItems": least, "maxItems": most}, {"$ref": "#/$defs/substitution"}
        ]})
    };
    let three = |what: &str| several(3, 3, what);
    let bell = |middle: &str| json!({"type": ["object", "array"], "description": format!("{{{middle}, sigma, within: [first, last]}}")});
    let scalar = json!({"type": ["number", "string", "boolean"]});
    let defs = json!({
        // No ASCII but letters, digits, `_` and `-`: classes such as \p{L} are not known to every validator.
        "name": {"type": "string", "pattern": "^[^\\s!-/:-@\\[-^`{-~][^\\s!-,./:-@\\[-^`{-~]{0,79}$"},
        "seed": {"anyOf": [{"type": "integer", "minimum": 0}, {"$ref": "#/$defs/substitution"}]},
        "substitution": {"description": "a var or an axis: ${name}", "type": "string", "pattern": "\\$\\{"},
        "source": {
            "anyOf": [
                {"type": "string", "description": "stage or stage.port"},
                {
                    "type": "object", "additionalProperties": false, "required": ["from"],
                    "properties": {
                        "from": {"type": "string", "description": "stage or stage.port"},
                        "where": {"type": "object", "additionalProperties": scalar, "description": "only instances with these values"},
                        "over": {"type": "array", "items": {"type": "string"}, "description": "the axes that are gathered"}
                    }
                }
            ]
        },
        "sources": {"anyOf": [{"$ref": "#/$defs/source"}, {"type": "array", "minItems": 1, "items": {"$ref": "#/$defs/source"}}]},
        "values": {
            "anyOf": [
                {"type": "array", "minItems": 1, "items": scalar},
                {"$ref": "#/$defs/substitution"},
                {"type": "object", "additionalProperties": false, "minProperties": 1, "maxProperties": 1, "properties": {
                    "linspace": three("first, last, count; both ends included"),
                    "logspace": three("first, last, count; both ends included, given as values"),
                    "range": several(2, 3, "first, last (left out), step"),
                    "csv": {"type": "string", "description": "a file whose columns are axes that go together"}
                }}
            ]
        },
        "foreach": {
            "description": "Axes: one instance of the stage for each combination of values.",
            "type": "object",
            "properties": {
                "zip": {"type": "array", "items": {"type": "array", "minItems": 2, "items": {"type": "string"}}, "description": "axes that go together"},
                "csv": {"type": "string", "description": "a file whose columns are axes that go together"},
                "draw": {"$ref": "#/$defs/draw"}
            },
            "additionalProperties": {"$ref": "#/$defs/values"}
        },
        "when": {
            "description": "This entry is there only where all of these are met: {NAME: VALUE} or {NAME: {above | below | is | in: VALUE}}.",
            "type": "object"
        },
        "number_of_draws": {
            "anyOf": [
                {"type": "number"},
                {"type": "string", "description": "the name of a drawn number, or ${var}"},
                {"type": "object", "additionalProperties": false, "minProperties": 1, "maxProperties": 1, "properties": {
                    "product": {"type": "array", "minItems": 1, "items": {"$ref": "#/$defs/number_of_draws"}},
                    "sum": {"type": "array", "minItems": 1, "items": {"$ref": "#/$defs/number_of_draws"}}
                }}
            ]
        },
        "ends": {"type": "array", "minItems": 2, "maxItems": 2, "items": {"$ref": "#/$defs/number_of_draws"}},
        "draw": {
            "description": "One joint set of points, on one axis `draw`; `${NAME}` are their coordinates.",
            "type": "object",
            "required": ["n"],
            "properties": {
                "n": {"anyOf": [{"type": "integer", "minimum": 1, "maximum": 1_000_000}, {"$ref": "#/$defs/substitution"}]},
                "method": {"enum": ["sobol", "lhs", "random"], "default": "sobol"},
                "only": {
                    "description": "points that do not meet all of these are left out: [[NAME, above | below | is | in, VALUE], ..]",
                    "type": "array",
                    "items": {"type": "array", "minItems": 3, "maxItems": 3}
                }
            },
            "additionalProperties": {
                "type": "object", "additionalProperties": false, "minProperties": 1, "maxProperties": 3,
                "properties": {
                    "uniform": {"$ref": "#/$defs/ends"},
                    "loguniform": {"$ref": "#/$defs/ends"},
                    "integer": {"$ref": "#/$defs/ends"},
                    "normal": bell("mean"),
                    "lognormal": bell("median"),
                    "beta": {"type": ["object", "array"], "description": "{alpha, beta, on: [first, last]}"},
                    "choice": {"type": ["object", "array"], "description": "values, or values with their weights: {a: 3, b: 1}"},
                    "within": {"$ref": "#/$defs/ends"},
                    "per": {"type": "string", "description": "drawn once in each group of this name"},
                    "group": {"type": "integer", "minimum": 1, "description": "the number of groups"},
                    "product": {"type": "array", "minItems": 1, "items": {"$ref": "#/$defs/number_of_draws"}},
                    "sum": {"type": "array", "minItems": 1, "items": {"$ref": "#/$defs/number_of_draws"}}
                }
            }
        },
        "study": {
            "description": "Error of an estimate against what is varied, and against run time (turbid study).",
            "type": "object", "additionalProperties": false, "required": ["vary", "estimate", "error"],
            "properties": {
                "about": {"type": "string"},
                "vary": {"type": "object", "additionalProperties": {"$ref": "#/$defs/values"}, "description": "paths as --set takes them"},
                "estimate": {"type": "string", "description": "stage.quantity or stage.port.quantity"},
                "truth": {"type": "string", "description": "stage.port, or stage.port.quantity; without it the scatter of the repeats is the error"},
                "error": {"enum": ERRORS},
                "repeats": {"type": "integer", "minimum": 1, "maximum": 1000, "description": "how often each point is computed, with other random numbers"},
                "also": {"type": "array", "items": {"type": "string"}, "description": "other results, a column each: stage.quantity with the same error, or stage.measure"},
                "reference": {"type": "string", "description": "a CSV file of points of others: cpu_seconds, error, label"}
            }
        }
    });
    match defs {
        Value::Object(map) => map,
        _ => unreachable!("an object was written above"),
    }
}

/// The ports of a stage.
fn inputs(row: &StageRow) -> Value {
    let ports = (row.inputs)();
    let required: Vec<&str> =
        ports.iter().filter(|p| matches!(p.arity, Arity::One | Arity::Some)).map(|p| p.name).collect();
    let each: Map<String, Value> = ports
        .iter()
        .map(|p| {
            let source = if matches!(p.arity, Arity::Many | Arity::Some) { "sources" } else { "source" };
            let about = format!("{} ({})", p.about, p.payload);
            (p.name.to_owned(), json!({"description": about, "$ref": format!("{DEFS}{source}")}))
        })
        .collect();
    json!({"type": "object", "additionalProperties": false, "required": required, "properties": each})
}

/// The schema of a stage's params with its definitions, renamed so that stages do not disturb each other.
fn params(row: &StageRow) -> (Value, Map<String, Value>) {
    let mut schema = (row.schema)();
    let mut own = Map::new();
    if let Value::Object(map) = &mut schema {
        map.remove("$schema");
        if let Some(Value::Object(defs)) = map.remove("$defs") {
            own = defs.into_iter().map(|(name, def)| (format!("{}.{name}", row.name), def)).collect();
        }
    }
    let prefix = format!("{DEFS}{}.", row.name);
    adapt(&mut schema, &prefix);
    for def in own.values_mut() {
        adapt(def, &prefix);
        conditional(def);
    }
    (schema, own)
}

/// Lets `when` stand in the entries of maps.
fn conditional(schema: &mut Value) {
    let Value::Object(map) = schema else { return };
    let closed = map.get("additionalProperties") == Some(&json!(false));
    if let Some(Value::Object(fields)) = map.get_mut("properties").filter(|_| closed) {
        fields.insert("when".to_owned(), json!({"$ref": "#/$defs/when"}));
    }
    for keyword in ["anyOf", "oneOf", "allOf"] {
        map.get_mut(keyword).and_then(Value::as_array_mut).into_iter().flatten().for_each(conditional);
    }
}

/// Renames references, and lets `${name}` stand wherever a value stands.
fn adapt(schema: &mut Value, prefix: &str) {
    let Value::Object(map) = schema else { return };
    if let Some(Value::String(reference)) = map.get_mut("$ref")
        && let Some(name) = reference.strip_prefix(DEFS)
    {
        *reference = format!("{prefix}{name}");
    }
    for (keyword, part) in map.iter_mut() {
        match (keyword.as_str(), part) {
            ("properties" | "patternProperties", Value::Object(fields)) => {
                for field in fields.values_mut() {
                    adapt(field, prefix);
                    substitutable(field);
                }
            }
            ("items" | "additionalProperties", part) => {
                adapt(part, prefix);
                substitutable(part);
            }
            ("prefixItems", Value::Array(items)) => {
                for item in items {
                    adapt(item, prefix);
                    substitutable(item);
                }
            }
            ("anyOf" | "oneOf" | "allOf", Value::Array(parts)) => parts.iter_mut().for_each(|p| adapt(p, prefix)),
            ("not" | "if" | "then" | "else", part) => adapt(part, prefix),
            _ => {}
        }
    }
}

fn substitutable(schema: &mut Value) {
    let Value::Object(map) = schema else { return };
    let takes_text = |t: &Value| t == "string" || t.as_array().is_some_and(|types| types.contains(&json!("string")));
    if map.get("type").is_some_and(takes_text) {
        return;
    }
    // Description and default stay outside, where editors look for them.
    let mut outside = Map::new();
    for key in ["description", "default", "title"] {
        outside.extend(map.remove(key).map(|value| (key.to_owned(), value)));
    }
    outside.insert("anyOf".to_owned(), json!([std::mem::take(map), {"$ref": "#/$defs/substitution"}]));
    *map = outside;
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    fn references<'a>(schema: &'a Value, found: &mut BTreeSet<&'a str>) {
        match schema {
            Value::Object(map) => {
                found.extend(map.get("$ref").and_then(Value::as_str));
                map.values().for_each(|part| references(part, found));
            }
            Value::Array(parts) => parts.iter().for_each(|part| references(part, found)),
            _ => {}
        }
    }

    /// Every stage has its own part, and no reference leads nowhere.
    #[test]
    fn the_schema_is_closed_and_knows_every_stage() {
        let registry = Registry::builtin();
        let schema = schema(&registry);
        let mut found = BTreeSet::new();
        references(&schema, &mut found);
        for reference in found {
            let pointer = reference.strip_prefix('#').expect("references stay in the document");
            assert!(schema.pointer(pointer).is_some(), "{reference}");
        }
        let kinds = schema["$defs"]["stage"]["allOf"].as_array().expect("one part for each stage");
        let named = |row: &StageRow| kinds.iter().any(|k| k["if"]["properties"]["use"]["const"] == row.name);
        assert!(registry.rows().iter().all(named));
    }

    /// `${name}` may stand for any value, once: what takes text anyway is left alone.
    #[test]
    fn values_may_be_substituted() {
        let mut schema = json!({"type": "object", "properties": {
            "properties": {"type": "integer", "description": "d"},
            "label": {"type": "string"},
            "f_x": {"type": "array", "items": {"$ref": "#/$defs/PerLength"}}
        }});
        adapt(&mut schema, "#/$defs/render.");
        let substitution = json!({"$ref": "#/$defs/substitution"});
        let fields = &schema["properties"];
        assert_eq!(fields["properties"], json!({"description": "d", "anyOf": [{"type": "integer"}, substitution]}));
        assert_eq!(fields["label"], json!({"type": "string"}));
        let item = json!({"anyOf": [{"$ref": "#/$defs/render.PerLength"}, substitution]});
        assert_eq!(fields["f_x"]["anyOf"][0], json!({"type": "array", "items": item}));
    }
}
