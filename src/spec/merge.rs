//! `include:` — pipeline files made of several — with the including file winning, key by key.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use super::diagnostic::Diagnostic;
use super::mistake::{Kind, Mistake};
use super::node::{Data, Node};
use super::parse::{join, parse};
use super::reader::Reader;
use super::report::Report;
use super::source::{MAX_PIPELINE, SourceFile, Span};

const WHAT: &str = "a pipeline file";

/// More files than this are a mistake (and bound what repeated includes can cost).
const MAX_FILES: usize = 100;

/// The text of a pipeline file.
pub fn read_source(path: &Path) -> Result<SourceFile, String> {
    SourceFile::read(path, WHAT, MAX_PIPELINE)
}

/// Reads a file, which stands at `path`, and everything it includes into one tree.
pub fn read_all(
    file: Result<SourceFile, String>,
    path: &Path,
    sources: &mut Vec<SourceFile>,
    report: &mut Report,
) -> Option<Node> {
    match file {
        Ok(file) => read_one(file, path, &mut Vec::new(), sources, report),
        Err(why) => {
            let mut lost = Diagnostic::nowhere(Mistake::new(Kind::File, why));
            lost.file = path.display().to_string();
            report.push(lost);
            None
        }
    }
}

fn read_one(
    file: SourceFile,
    path: &Path,
    open: &mut Vec<PathBuf>,
    sources: &mut Vec<SourceFile>,
    report: &mut Report,
) -> Option<Node> {
    let base = file.base.clone();
    let index = sources.len();
    sources.push(file);
    let mut own = parse(sources, index, report)?;
    let whole = Span { file: index as u32, ..Span::default() };
    match &own.data {
        Data::Map(_) => {}
        Data::Null => {
            Reader { sources, report }.error(
                whole,
                "",
                "the file is empty",
                "`turbid new` writes a first pipeline".to_owned(),
            );
            return None;
        }
        _ => {
            let message =
                format!("a pipeline file is a map with `pipeline:` and `stages:`, but this is {}", own.described());
            Reader { sources, report }.error(own.span, "", message, None);
            return None;
        }
    }
    let Some((wanted, key)) = take_include(&mut own) else { return Some(own) };

    open.push(identity(path));
    let mut merged: Option<Node> = None;
    for (name, span) in include_names(&wanted, key, &mut Reader { sources, report }) {
        let included = base.join(&name);
        if open.contains(&identity(&included)) {
            Reader { sources, report }.error(span, "include", format!("`{name}` includes itself"), None);
            continue;
        }
        let left = MAX_PIPELINE.saturating_sub(sources.iter().map(|s| s.text.len() as u64).sum());
        if sources.len() >= MAX_FILES {
            Reader { sources, report }.error(
                span,
                "include",
                format!("more than {MAX_FILES} files are included"),
                None,
            );
            break;
        }
        match SourceFile::read(&included, WHAT, left) {
            Ok(file) => {
                if let Some(tree) = read_one(file, &included, open, sources, report) {
                    merged = Some(match merged {
                        Some(before) => overlay(before, tree),
                        None => tree,
                    });
                }
            }
            Err(why) => {
                let lost = Mistake::new(Kind::File, format!("`{}`: {why}", included.display()));
                Reader { sources, report }.error(span, "include", lost, None);
            }
        }
    }
    open.pop();
    Some(match merged {
        Some(below) => overlay(below, own),
        None => own,
    })
}

/// The same file under any spelling of its path.
fn identity(path: &Path) -> PathBuf {
    std::fs::canonicalize(path).unwrap_or_else(|_| path.to_path_buf())
}

fn take_include(root: &mut Node) -> Option<(Node, Span)> {
    let Data::Map(entries) = &mut root.data else { return None };
    let at = entries.iter().position(|e| e.key == "include")?;
    let entry = entries.remove(at);
    Some((entry.value, entry.at))
}

fn include_names(wanted: &Node, key: Span, reader: &mut Reader<'_>) -> Vec<(String, Span)> {
    let rule = "the path of a pipeline file, or a list of them";
    let items: Vec<(String, &Node)> = match &wanted.data {
        Data::List(items) => items.iter().enumerate().map(|(i, n)| (join("include", &i.to_string()), n)).collect(),
        _ => vec![("include".to_owned(), wanted)],
    };
    items
        .into_iter()
        .filter_map(|(path, node)| reader.text(node, key, &path, rule).map(|name| (name.to_owned(), node.span)))
        .collect()
}

/// Maps merge key by key, `above` winning; everything else is replaced. Keys keep the order of `below`.
pub fn overlay(below: Node, above: Node) -> Node {
    match (below.data, above.data) {
        (Data::Map(mut entries), Data::Map(more)) => {
            let places: HashMap<String, usize> = entries.iter().enumerate().map(|(i, e)| (e.key.clone(), i)).collect();
            for entry in more {
                match places.get(&entry.key).map(|i| &mut entries[*i]) {
                    Some(known) => {
                        let old = std::mem::replace(&mut known.value, Node::new(entry.at, Data::Null));
                        known.value = overlay(old, entry.value);
                        known.at = entry.at;
                    }
                    None => entries.push(entry),
                }
            }
            Node { span: above.span, data: Data::Map(entries) }
        }
        (_, data) => Node { span: above.span, data },
    }
}
