//! `${name}`: typed when alone, text inside a longer string; `$${` stands for a literal `${`.

use serde_json::Value;

/// A text cut at its `${}`s.
#[derive(Clone, Debug, PartialEq)]
pub enum Piece {
    Text(String),
    Name(String),
}

/// Whether `text` holds anything to substitute.
pub fn is_dynamic(text: &str) -> bool {
    text.contains("${")
}

/// Cuts `text`; the error says what is wrong with a `${`.
pub fn pieces(text: &str) -> Result<Vec<Piece>, String> {
    let mut found = Vec::new();
    let mut literal = String::new();
    let mut rest = text;
    while let Some(at) = rest.find("${") {
        if rest[..at].ends_with('$') {
            literal.push_str(&rest[..at]);
            literal.push('{');
            rest = &rest[at + 2..];
            continue;
        }
        literal.push_str(&rest[..at]);
        let inside = &rest[at + 2..];
        let end = inside.find('}').ok_or("`${` is not closed by `}` (write `$${` for a literal `${`)")?;
        let name = inside[..end].trim();
        if name.is_empty() {
            return Err("`${}` names nothing".to_owned());
        }
        if !literal.is_empty() {
            found.push(Piece::Text(std::mem::take(&mut literal)));
        }
        found.push(Piece::Name(name.to_owned()));
        rest = &inside[end + 1..];
    }
    literal.push_str(rest);
    if !literal.is_empty() {
        found.push(Piece::Text(literal));
    }
    Ok(found)
}

/// Puts values in; `value` must know every name. Alone, a value keeps its type.
///
/// Error: a list, map or null inside a longer text.
pub fn fill<'v>(pieces: &[Piece], value: impl Fn(&str) -> &'v Value) -> Result<Value, String> {
    if let [Piece::Name(name)] = pieces {
        return Ok(value(name).clone());
    }
    let mut text = String::new();
    for piece in pieces {
        match piece {
            Piece::Text(literal) => text.push_str(literal),
            Piece::Name(name) => match value(name) {
                Value::String(s) => text.push_str(s),
                scalar @ (Value::Number(_) | Value::Bool(_)) => text.push_str(&scalar.to_string()),
                other => {
                    let what = if other.is_null() { "empty" } else { "a list or a map" };
                    return Err(format!("`${{{name}}}` is {what}, which cannot stand inside a longer text"));
                }
            },
        }
        if text.len() > MAX_TEXT {
            return Err(format!("this text grows beyond {MAX_TEXT} bytes"));
        }
    }
    Ok(Value::String(text))
}

/// A `${name}` without quotes inside brackets, in a line (counted from 1) or shortly above it.
pub fn unquoted(text: &str, line: usize) -> Option<String> {
    let above = text.lines().take(line).collect::<Vec<_>>();
    above.iter().rev().take(3).find_map(|line| {
        let mut quote = None;
        for (i, c) in line.char_indices() {
            match (quote, c) {
                (None, '#') if line[..i].ends_with([' ', '\t']) => return None,
                (None, '"' | '\'') => quote = Some(c),
                (Some(open), c) if open == c => quote = None,
                (None, '$') if line[i..].starts_with("${") && line[..i].contains(['{', '[']) => {
                    let end = line[i..].find('}')?;
                    return Some(line[i..=i + end].to_owned());
                }
                _ => {}
            }
        }
        None
    })
}

/// Texts that double with each var would fill the memory.
const MAX_TEXT: usize = 1 << 20;

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn alone_typed_inside_text_escaped_literal() {
        let (x, list) = (json!(0.5), json!([1, 2]));
        let read = |t: &str| pieces(t).and_then(|p| fill(&p, |name| if name == "list" { &list } else { &x }));
        assert_eq!(read("${x}"), Ok(json!(0.5)));
        assert_eq!(read("${ x }"), Ok(json!(0.5)));
        assert_eq!(read("${list}"), Ok(json!([1, 2])));
        assert_eq!(read("${x} mm to ${x}"), Ok(json!("0.5 mm to 0.5")));
        assert_eq!(read("$${x} costs $5"), Ok(json!("${x} costs $5")));
        assert!(read("a ${list}").unwrap_err().contains("longer text"));
        assert!(read("${x").unwrap_err().contains("not closed"));
        assert!(read("${}").unwrap_err().contains("names nothing"));
    }

    /// Only inside brackets does YAML want quotes; a comment is none of it.
    #[test]
    fn vars_without_quotes_are_found() {
        let at = |text: &str| unquoted(text, 1);
        assert_eq!(at("with: {f_x: ${x}, k: 1}").as_deref(), Some("${x}"));
        assert_eq!(at("with: [\"${a}\", ${ b }]").as_deref(), Some("${ b }"));
        assert_eq!(at("f_x: ${x}"), None);
        assert_eq!(at("with: {f_x: '${x}'} # {${x}}"), None);
    }
}
