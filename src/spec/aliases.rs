//! Values that a YAML alias puts at several places: an override changes one of them, the others keep what they had.

use std::collections::HashMap;

use super::diagnostic::Diagnostic;
use super::node::{Data, Node};
use super::parse::join;
use super::source::{SourceFile, Span};

/// More places of one anchor than this are counted only.
const MOST: usize = 3;

/// A place that an override does not reach, although its text is the one that the override replaces.
#[derive(Debug, PartialEq)]
pub struct Kept {
    path: String,
    /// Of the anchor and of the alias; of these one is overridden, the other keeps its value.
    anchor: Span,
    alias: Span,
}

/// The places that keep the value which `path` replaces. Copies that aliases make keep the places of their anchor's text: that is what they
/// are known by.
pub fn kept(root: &Node, path: &str) -> Vec<Kept> {
    let mut way: Vec<(Span, &Node)> = Vec::new();
    let (mut node, mut place) = (root, root.span);
    for step in path.split('.') {
        let Some((at, next)) = node.step(step) else { break };
        // An item of a list has no key: its list's stands for it.
        place = if matches!(node.data, Data::List(_)) { place } else { at };
        node = next;
        way.push((place, node));
    }
    let depth_of: HashMap<_, usize> =
        way.iter().enumerate().filter_map(|(depth, (_, node))| Some((text_of(node)?, depth))).collect();
    let steps: Vec<&str> = path.split('.').collect();
    let mut found = Vec::new();
    let mut open = vec![(String::new(), root.span, root)];
    while let Some((at, place, node)) = open.pop() {
        let shared = text_of(node).and_then(|text| depth_of.get(&text).copied());
        if let Some(depth) = shared.filter(|&depth| at != steps[..=depth].join(".")) {
            let (own, other) = (way[depth].0, place);
            // An anchor stands in front of its text, an alias behind it.
            let (anchor, alias) = if other > node.span { (own, other) } else { (other, own) };
            found.push(Kept {
                path: steps[depth + 1..].iter().fold(at, |path, step| join(&path, step)),
                anchor,
                alias,
            });
            continue;
        }
        match &node.data {
            // Last first, so that what is found is in the order of the file.
            Data::Map(entries) => open.extend(entries.iter().rev().map(|entry| {
                // A merged key stands where its anchor has it: the map that took it stands for it.
                let own = !(entry.at < node.span && entry.at.file == node.span.file);
                (join(&at, &entry.key), if own { entry.at } else { place }, &entry.value)
            })),
            Data::List(items) => {
                open.extend(items.iter().enumerate().rev().map(|(i, item)| (join(&at, &i.to_string()), place, item)));
            }
            _ => {}
        }
    }
    found
}

/// Where the text of a value stands; `None` of what has none.
fn text_of(node: &Node) -> Option<(u32, u32, u32)> {
    let Span { file, line, column, .. } = node.span;
    (line > 0 && !matches!(node.data, Data::Null | Data::Broken)).then_some((file, line, column))
}

/// A warning for each place that keeps its value, at the override that does not reach it. `others`: the paths of all overrides.
pub fn warnings(sources: &[SourceFile], path: &str, at: Span, kept: &[Kept], others: &[&str]) -> Vec<Diagnostic> {
    let reached = |kept: &&Kept| {
        !others
            .iter()
            .any(|path| kept.path.strip_prefix(path).is_some_and(|rest| rest.is_empty() || rest.starts_with('.')))
    };
    let split: Vec<&Kept> = kept.iter().filter(reached).collect();
    let place = |span: Span| format!("{}:{}:{}", sources[span.file as usize].name, span.line, span.column);
    let more = split.len().saturating_sub(MOST);
    let told = split.iter().take(MOST).enumerate().map(|(i, kept)| {
        let more = if i + 1 == MOST && more > 0 { format!(" (and {more} places more)") } else { String::new() };
        let message = format!(
            "{} stays as it is{more}: both are one value by the alias at {} of the anchor at {}",
            kept.path,
            place(kept.alias),
            place(kept.anchor)
        );
        let hint =
            "override both, or let both take it from one place: a var, or a `rig` for camera, projector and lights";
        Diagnostic::at(sources, at, path, message).hint(hint.to_owned()).warning()
    });
    told.collect()
}

#[cfg(test)]
mod tests {
    use super::super::report::Report;
    use super::super::{overrides, parse};
    use super::*;

    const FILE: &str = "\
vars: {a: &a 5, b: *a}
stages:
  tissue:
    with:
      camera: &camera {field: [8, 8], pixels: [4, 4]}
      projector: &projector
        power: 5
  phantom:
    with: {camera: *camera, projector: *projector}
  third:
    with:
      projector: {<<: *projector, profile: flat}
      cameras: [*camera]
      own: {power: 5}
";

    /// What `check` says of a file under some overrides.
    fn said(overrides: &[&str]) -> Vec<String> {
        let mut sources = vec![SourceFile::new("p.yaml", "", FILE)];
        let mut report = Report::default();
        let mut root = parse::parse(&sources, 0, &mut report).expect("it is YAML");
        let overrides: Vec<String> = overrides.iter().map(|text| (*text).to_owned()).collect();
        overrides::apply(&mut root, &overrides, &mut sources, &mut report);
        assert!(!report.has_errors(), "{report}");
        report.warnings().iter().map(|d| format!("{}: {}", d.path, d.message)).collect()
    }

    /// Each override that reaches one of several places: the others are named, with the places of alias and anchor; whether the
    /// anchor or an alias is overridden, at the value itself or below it, through `<<` and in lists.
    #[test]
    fn what_an_alias_keeps_is_said() {
        let told = said(&["stages.tissue.with.projector.power=6"]);
        let both = "stays as it is: both are one value by the alias at";
        assert_eq!(
            told,
            [
                format!(
                    "stages.tissue.with.projector.power: stages.phantom.with.projector.power {both} p.yaml:9:29 of the anchor at p.yaml:6:7"
                ),
                format!(
                    "stages.tissue.with.projector.power: stages.third.with.projector.power {both} p.yaml:12:7 of the anchor at p.yaml:7:9"
                ),
            ]
        );
        let told = said(&["stages.phantom.with.camera.pixels.0=9"]);
        assert_eq!(told.len(), 2);
        assert!(
            told[0].contains("stages.tissue.with.camera.pixels.0 stays") && told[0].contains("alias at p.yaml:9:12"),
            "{told:?}"
        );
        assert!(
            told[1].contains("stages.third.with.cameras.0.pixels.0 stays") && told[1].contains("p.yaml:13:7"),
            "{told:?}"
        );
        let told = said(&["vars.b=6"]);
        assert!(
            told.len() == 1 && told[0].contains("vars.a stays") && told[0].contains("anchor at p.yaml:1:8"),
            "{told:?}"
        );
        let told = said(&["stages.phantom.with.camera={field: [1, 1]}"]);
        assert!(told.len() == 2 && told[0].contains("stages.tissue.with.camera stays"), "{told:?}");
    }

    /// Where every place is overridden, or there is one only, nothing is said.
    #[test]
    fn whoever_reaches_all_places_hears_nothing() {
        for overrides in [
            &["stages.third.with.own.power=6"][..],
            &["stages.third.with.projector.profile=flat"],
            &["vars.a=6", "vars.b=6"],
            &[
                "stages.tissue.with.projector.power=6",
                "stages.phantom.with.projector.power=6",
                "stages.third.with.projector={power: 6}",
            ],
        ] {
            assert_eq!(said(overrides), Vec::<String>::new(), "{overrides:?}");
        }
    }
}
