//! Canonical JSON: sorted keys, shortest numbers, no negative zero, no non-finite number.

use serde::Serialize;
use serde_json::Value;

/// Turns params or attributes into their canonical value.
///
/// Errors: a non-finite number (JSON would store it as `null` in silence), named by its path.
pub fn canonical_value<T: Serialize>(what: &T) -> Result<Value, String> {
    let mut value = serde_json::to_value(what).map_err(|e| e.to_string())?;
    normalise(&mut value);
    Ok(value)
}

/// The text that is hashed and stored.
pub fn canonical_text(value: &Value) -> String {
    // serde_json's map is a BTreeMap here (`preserve_order` is off), so keys come out sorted.
    serde_json::to_string(value).expect("a JSON value has text keys and finite numbers")
}

fn normalise(value: &mut Value) {
    match value {
        Value::Number(n) if n.as_f64() == Some(0.0) && n.is_f64() => *value = Value::from(0.0),
        Value::Array(items) => items.iter_mut().for_each(normalise),
        Value::Object(map) => map.values_mut().for_each(normalise),
        _ => {}
    }
}
