//! The JSON Schema of pipeline files against the pipelines that are shipped.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

/// What of `value` the schema does not take, at its place; empty where all is well. Patterns are left to editors, and so are formats.
fn wrong(root: &Value, schema: &Value, value: &Value, at: &str) -> Vec<String> {
    let mut found = Vec::new();
    let Some(rules) = schema.as_object() else {
        return if *schema == json!(false) { vec![format!("{at}: nothing may stand here")] } else { found };
    };
    let valid = |schema: &Value, value: &Value| wrong(root, schema, value, at).is_empty();
    for (rule, wanted) in rules {
        match (rule.as_str(), value) {
            ("$ref", _) => {
                let pointer =
                    wanted.as_str().and_then(|r| r.strip_prefix('#')).expect("references stay in the document");
                found.extend(wrong(root, root.pointer(pointer).expect("it leads somewhere"), value, at));
            }
            ("type", _) => {
                let named = |name: &Value| match name.as_str() {
                    Some("integer") => value.as_f64().is_some_and(|n| n.fract() == 0.0),
                    Some("number") => value.is_number(),
                    Some("string") => value.is_string(),
                    Some("boolean") => value.is_boolean(),
                    Some("array") => value.is_array(),
                    Some("object") => value.is_object(),
                    Some("null") => value.is_null(),
                    other => panic!("the type {other:?}"),
                };
                let holds = wanted.as_array().map_or_else(|| named(wanted), |names| names.iter().any(named));
                found.extend((!holds).then(|| format!("{at}: {value} is no {wanted}")));
            }
            ("const", _) => found.extend((value != wanted).then(|| format!("{at}: {value} is not {wanted}"))),
            ("enum", _) => {
                let known = wanted.as_array().expect("a list").contains(value);
                found.extend((!known).then(|| format!("{at}: {value} is none of {wanted}")));
            }
            ("anyOf" | "oneOf", _) => {
                let ways = wanted.as_array().expect("a list");
                let count = ways.iter().filter(|way| valid(way, value)).count();
                if count == 0 || rule == "oneOf" && count > 1 {
                    found.push(format!("{at}: {count} ways of {rule} fit {value}"));
                }
            }
            ("allOf", _) => {
                found.extend(wanted.as_array().expect("a list").iter().flat_map(|part| wrong(root, part, value, at)));
            }
            ("if", _) if valid(wanted, value) => found.extend(wrong(root, &rules["then"], value, at)),
            ("properties", Value::Object(fields)) => {
                for (name, part) in wanted.as_object().expect("a map") {
                    if let Some(field) = fields.get(name) {
                        found.extend(wrong(root, part, field, &format!("{at}.{name}")));
                    }
                }
            }
            ("additionalProperties", Value::Object(fields)) => {
                let known = |name: &&String| rules.get("properties").is_some_and(|p| p.get(name.as_str()).is_some());
                for name in fields.keys().filter(|name| !known(name)) {
                    found.extend(wrong(root, wanted, &fields[name], &format!("{at}.{name}")));
                }
            }
            ("required", Value::Object(fields)) => {
                let missing =
                    wanted.as_array().expect("a list").iter().filter(|n| !fields.contains_key(n.as_str().unwrap()));
                found.extend(missing.map(|name| format!("{at}: {name} is missing")));
            }
            ("items", Value::Array(items)) => {
                for (i, item) in items.iter().enumerate() {
                    found.extend(wrong(root, wanted, item, &format!("{at}.{i}")));
                }
            }
            ("minItems", Value::Array(items)) if items.len() < wanted.as_u64().unwrap() as usize => {
                found.push(format!("{at}: fewer than {wanted} items"));
            }
            ("maxItems", Value::Array(items)) if items.len() > wanted.as_u64().unwrap() as usize => {
                found.push(format!("{at}: more than {wanted} items"));
            }
            ("minProperties", Value::Object(map)) if map.len() < wanted.as_u64().unwrap() as usize => {
                found.push(format!("{at}: fewer than {wanted} keys"));
            }
            ("maxProperties", Value::Object(map)) if map.len() > wanted.as_u64().unwrap() as usize => {
                found.push(format!("{at}: more than {wanted} keys"));
            }
            ("minimum", Value::Number(n)) if n.as_f64() < wanted.as_f64() => {
                found.push(format!("{at}: below {wanted}"))
            }
            ("maximum", Value::Number(n)) if n.as_f64() > wanted.as_f64() => {
                found.push(format!("{at}: above {wanted}"))
            }
            ("pattern", Value::String(text)) if wanted.as_str() == Some("\\$\\{") && !text.contains("${") => {
                found.push(format!("{at}: no ${{name}}"));
            }
            _ => {}
        }
    }
    found
}

fn pipelines(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).expect("the folder of pipelines").map(|entry| entry.expect("an entry").path());
    let mut found: Vec<PathBuf> = entries.filter(|path| path.extension().is_some_and(|e| e == "yaml")).collect();
    found.sort();
    found
}

/// Every pipeline that is shipped is a right one to an editor too, and a wrong one is not.
#[test]
fn shipped_pipelines_validate() {
    let schema = turbid::spec::schema(&turbid::registry::Registry::builtin());
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines");
    let files = [pipelines(&folder), pipelines(&folder.join("checks"))].concat();
    assert!(files.len() > 30, "{files:?}");
    let read = |path: &Path| -> Value {
        let text = fs::read_to_string(path).expect("it is there");
        let mut value: Value = serde_yaml::from_str(&text).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        merge(&mut value);
        value
    };
    let mut failures = Vec::new();
    for path in &files {
        let found = wrong(&schema, &schema, &read(path), "");
        failures.extend(found.into_iter().map(|what| format!("{}: {what}", path.display())));
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
    let mut spoilt = read(&folder.join("quickstart.yaml"));
    spoilt["stages"]["frames"]["with"]["samplse"] = json!(3);
    assert!(!wrong(&schema, &schema, &spoilt, "").is_empty());
    spoilt = read(&folder.join("quickstart.yaml"));
    spoilt["stages"]["tissue"]["foreach"] = json!({"a": {"range": [0]}});
    assert!(!wrong(&schema, &schema, &spoilt, "").is_empty());
}

/// YAML's `<<`, where the reader left it: keys that are written out win.
fn merge(value: &mut Value) {
    match value {
        Value::Object(map) => {
            map.values_mut().for_each(merge);
            let merged = match map.remove("<<") {
                Some(Value::Array(maps)) => maps,
                Some(one) => vec![one],
                None => Vec::new(),
            };
            for (name, value) in merged.iter().filter_map(Value::as_object).flatten() {
                map.entry(name).or_insert_with(|| value.clone());
            }
        }
        Value::Array(items) => items.iter_mut().for_each(merge),
        _ => {}
    }
}

/// Names are checked without classes that only some validators know.
#[test]
fn patterns_are_plain() {
    let text = turbid::spec::schema(&turbid::registry::Registry::builtin()).to_string();
    assert!(!text.contains(r"\\p{"), "Python's jsonschema knows no \\p{{L}}");
}
