//! `{csv: file}`: a table whose columns are axes that go together.

use serde_json::Value;

use std::collections::HashSet;

use super::axis::{MAX_AXES, MAX_INSTANCES, MAX_VALUES};
use super::reader::is_name;
use super::scalar::{Plain, normal, plain};

/// Column names and, per row, a value for each of them.
#[derive(Debug, PartialEq)]
pub struct Table {
    pub names: Vec<String>,
    pub rows: Vec<Vec<Value>>,
}

/// Reads comma-separated values: a line of names, then rows; `"` quotes, blank lines and `#` lines are skipped.
pub fn parse(text: &str) -> Result<Table, String> {
    let mut lines = text.lines().enumerate().map(|(i, l)| (i + 1, l.trim())).filter(|(_, l)| {
        let comment = l.starts_with('#');
        !l.is_empty() && !comment
    });
    let Some((first, head)) = lines.next() else { return Err("the file is empty".to_owned()) };
    let names: Vec<String> =
        cells(head, MOST_CELLS).map_err(|e| format!("line {first}: {e}"))?.into_iter().map(|c| c.0).collect();
    if names.len() > MAX_AXES {
        let has = names.len();
        return Err(format!(
            "the first line names {has} columns, and a stage takes at most {MAX_AXES} axes; leave only columns that stages use"
        ));
    }
    let mut seen = HashSet::new();
    for name in &names {
        if !is_name(name) {
            let way_out = if head.contains(';') { "; separate columns by commas" } else { "" };
            return Err(format!(
                "the first line names the columns, and `{name}` cannot be the name of an axis{way_out}"
            ));
        }
        if plain(name) != Plain::Text {
            return Err(format!("the first line must name the columns, but holds `{name}`"));
        }
        if !seen.insert(name.as_str()) {
            return Err(format!("the column `{name}` stands twice"));
        }
    }
    let mut rows = Vec::new();
    for (line, text) in lines {
        let row = cells(text, names.len()).map_err(|e| format!("line {line}: {e}"))?;
        if row.len() > names.len() {
            return Err(format!("line {line} has more than {} values for {} columns", names.len(), names.len()));
        }
        if row.len() != names.len() {
            return Err(format!("line {line} has {} values for {} columns", row.len(), names.len()));
        }
        if rows.len() == MAX_INSTANCES {
            return Err(format!("the file has more than {MAX_INSTANCES} rows"));
        }
        if (rows.len() + 1) * names.len() > MAX_VALUES {
            return Err(format!(
                "line {line}: the file has more than {MAX_VALUES} values; split it, or leave columns out"
            ));
        }
        let typed = row.into_iter().zip(&names).map(|((cell, quoted), name)| value(cell, quoted, name));
        rows.push(typed.collect::<Result<_, _>>().map_err(|e: String| format!("line {line}: {e}"))?);
    }
    if rows.is_empty() {
        return Err("the file has a line of names, but no rows".to_owned());
    }
    Ok(Table { names, rows })
}

fn value(cell: String, quoted: bool, name: &str) -> Result<Value, String> {
    if quoted {
        return Ok(Value::String(cell));
    }
    match plain(&cell) {
        Plain::Null => Err(format!("`{name}` has no value")),
        Plain::NotFinite => Err(format!("`{name}` = `{cell}` is not a finite number")),
        Plain::Bool(b) => Ok(Value::Bool(b)),
        Plain::Number(n) => Ok(normal(&n)),
        Plain::Text => Ok(Value::String(cell)),
    }
}

/// Columns that are counted, so that a message can say how many too many there are.
const MOST_CELLS: usize = 1_000_000;

/// The cells of a line, each with whether it was quoted; of more than `most` one more.
fn cells(line: &str, most: usize) -> Result<Vec<(String, bool)>, String> {
    let mut found = Vec::new();
    let mut rest = line;
    loop {
        rest = rest.trim_start();
        if let Some(inside) = rest.strip_prefix('"') {
            let mut cell = String::new();
            let mut tail = inside;
            loop {
                let end = tail.find('"').ok_or("a quote is not closed")?;
                cell.push_str(&tail[..end]);
                tail = &tail[end + 1..];
                match tail.strip_prefix('"') {
                    Some(more) => {
                        cell.push('"');
                        tail = more;
                    }
                    None => break,
                }
            }
            found.push((cell, true));
            rest = tail.trim_start();
            if !rest.is_empty() && !rest.starts_with(',') {
                return Err("text follows a closing quote".to_owned());
            }
        } else {
            let end = rest.find(',').unwrap_or(rest.len());
            found.push((rest[..end].trim().to_owned(), false));
            rest = &rest[end..];
        }
        match rest.strip_prefix(',') {
            Some(more) if found.len() <= most => rest = more,
            _ => return Ok(found),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn cells_are_typed_and_quotes_make_text() {
        let table = parse("# measured\nmu_a, label,n\r\n0.01,\"a, \"\"b\"\"\",1.0\n\n1e-3,\"2\",1.4\n").unwrap();
        assert_eq!(table.names, ["mu_a", "label", "n"]);
        assert_eq!(table.rows[0], [json!(0.01), json!("a, \"b\""), json!(1)]);
        assert_eq!(table.rows[1], [json!(0.001), json!("2"), json!(1.4)]);
    }

    /// As many columns and values as a stage takes, and one more.
    #[test]
    fn tables_are_bounded() {
        let columns = |n: usize| {
            let names: Vec<String> = (0..n).map(|i| format!("a{i}")).collect();
            parse(&format!("{}\n{}\n", names.join(","), vec!["1"; n].join(",")))
        };
        assert_eq!(columns(MAX_AXES).unwrap().names.len(), MAX_AXES);
        let said = columns(30_000).unwrap_err();
        assert!(said.contains("30000 columns") && said.contains("at most 100 axes"), "{said}");
        let wide = (0..MAX_AXES).map(|i| format!("a{i}")).collect::<Vec<_>>().join(",");
        let row = vec!["1"; MAX_AXES].join(",");
        let text = format!("{wide}\n{}", format!("{row}\n").repeat(MAX_VALUES / MAX_AXES + 1));
        assert!(parse(&text).unwrap_err().contains("line 40002: the file has more than 4000000 values"));
    }

    #[test]
    fn wrong_tables_are_named_by_their_line() {
        for (text, says) in [
            ("", "empty"),
            ("a,b\n", "no rows"),
            ("a,b\n1\n", "line 2 has 1 values for 2 columns"),
            ("a,a\n1,2\n", "twice"),
            ("# no name\n\"a,b\n1,2\n", "line 2: a quote is not closed"),
            ("a;b\n1;2\n", "commas"),
            ("1,2\n3,4\n", "must name the columns"),
            ("a,b\n1,\n", "`b` has no value"),
            ("a,b\n1,2,3,4\n", "line 2 has more than 2 values for 2 columns"),
            ("a\n.nan\n", "line 2: `a` = `.nan` is not a finite number"),
            ("a\n\"x\n", "not closed"),
            ("a\n\"x\"y\n", "follows a closing quote"),
        ] {
            let found = parse(text).unwrap_err();
            assert!(found.contains(says), "{text:?}: {found}");
        }
    }
}
