//! `--set stages.frames.with.samples=64`: values from the command line, typed by the rules of YAML.

use super::diagnostic::Diagnostic;
use super::mistake::{Kind, Mistake};
use super::node::{Data, Entry, Node};
use super::parse::{parse, shortened};
use super::report::Report;
use super::source::{SourceFile, Span};
use super::{ROOT_KEYS, aliases, stage, suggest};

/// What is wrong with a path, and the way out.
pub type PathError = (String, Option<String>);

/// Applies the overrides in order; the mistakes of all of them are reported, and what an alias keeps of a value that one of them changes.
pub fn apply(root: &mut Node, overrides: &[String], sources: &mut Vec<SourceFile>, report: &mut Report) {
    let paths: Vec<&str> = overrides.iter().filter_map(|text| Some(text.split_once('=')?.0.trim())).collect();
    let mut kept = paths.iter().map(|path| aliases::kept(root, path)).collect::<Vec<_>>().into_iter();
    for text in overrides {
        let file = sources.len();
        let (path, value) = match text.split_once('=') {
            Some((path, value)) => (path.trim(), value),
            None => {
                let hint = "write --set PATH=VALUE, such as --set vars.samples=64".to_owned();
                report.push(Diagnostic::error(format!("--set {text}: there is no `=`"), Some(hint)));
                continue;
            }
        };
        let kept = kept.next().expect("one for each path");
        // Blanks in place of the path keep the columns of the value those of the override as typed.
        let blank = " ".repeat(text.chars().count() - value.chars().count());
        sources.push(SourceFile::new("--set", "", format!("{blank}{value}")));
        let mut found = Report::default();
        let node = parse(sources, file, &mut found);
        sources[file] = SourceFile::new("--set", "", text.clone());
        // The mistakes show the text as typed, not the blanked one.
        report.extend(found.into_vec().into_iter().map(|d| d.shown_in(text)));
        let Some(node) = node else { continue };
        let span = Span { file: file as u32, line: 1, column: 1, len: path.chars().count() as u32 };
        if matches!(node.data, Data::Null) && value.trim().is_empty() {
            let hint = "write `null` for nothing, or '' for an empty text".to_owned();
            report.push(Diagnostic::at(sources, span, path, "no value follows `=`").hint(hint));
            continue;
        }
        match check_path(root, path) {
            Ok(()) => {
                report.extend(aliases::warnings(sources, path, span, &kept, &paths));
                set(root, path, node, span);
            }
            Err((message, hint)) => {
                let mistake = Mistake::new(Kind::UnknownName, message).hint(hint);
                report.push(Diagnostic::at(sources, span, path, mistake));
            }
        }
    }
}

/// Whether `path` can be set: sections, stages and vars must be there; what lies below `with` is the stage's to judge.
pub fn check_path(root: &Node, path: &str) -> Result<(), PathError> {
    let steps: Vec<&str> = path.split('.').collect();
    if steps.iter().any(|s| s.is_empty()) {
        return Err((format!("`{}` is no path such as stages.frames.with.samples", shortened(path)), None));
    }
    let settable = ROOT_KEYS.iter().copied().filter(|k| *k != "include");
    match steps[..] {
        ["pipeline" | "about" | "seed"] => Ok(()),
        ["pipeline" | "about" | "seed", ..] => Err((format!("`{}` has no parts", steps[0]), None)),
        [section @ ("vars" | "stages" | "studies")] => {
            Err((format!("`{section}` can only be set part by part, such as {section}.NAME"), None))
        }
        [section @ ("vars" | "stages" | "studies"), name, ..] => {
            let known = root.get(section).map(Node::entries).unwrap_or_default();
            let Some(entry) = known.iter().find(|e| e.key == name) else {
                let hint = suggest::hint(name, known.iter().map(|e| e.key.as_str()));
                let noun = section.trim_end_matches('s').replace("studie", "study");
                return Err((format!("there is no {noun} `{name}`"), hint));
            };
            if section == "stages" && steps.len() == 2 {
                return Err((format!("a stage is set part by part, such as stages.{name}.with.KEY"), None));
            }
            if section == "stages" && !stage::KEYS.contains(&steps[2]) {
                let hint = suggest::hint(steps[2], stage::KEYS);
                return Err((format!("a stage has no key `{}`", steps[2]), hint));
            }
            check_steps(&entry.value, &steps[2..])
        }
        [name, ..] => {
            // A var or a stage that was named alone.
            let below = |section: &str| root.get(section).and_then(|found| found.get(name)).is_some();
            let meant = ["vars", "stages"].into_iter().find(|section| below(section));
            let meant = meant.map(|section| format!("did you mean `{section}.{}`?", shortened(path)));
            let hint = meant.or_else(|| suggest::hint(name, settable));
            Err((format!("a pipeline has no section `{}`", shortened(name)), hint))
        }
        [] => unreachable!("splitting a text gives at least one part"),
    }
}

/// Lists cannot grow, and only maps (or nothing) can take a key.
fn check_steps(mut at: &Node, steps: &[&str]) -> Result<(), PathError> {
    for step in steps {
        match &at.data {
            Data::Map(_) => match at.get(step) {
                Some(next) => at = next,
                None => return Ok(()),
            },
            Data::List(items) => match step.parse::<usize>().ok().and_then(|i| items.get(i)) {
                Some(next) => at = next,
                None => {
                    return Err((
                        format!("`{step}` is no place in a list of {} (they count from 0)", items.len()),
                        None,
                    ));
                }
            },
            Data::Null | Data::Broken => return Ok(()),
            _ => return Err((format!("`{step}` cannot be set inside {}", at.described()), None)),
        }
    }
    Ok(())
}

fn set(root: &mut Node, path: &str, value: Node, span: Span) {
    let mut at = root;
    for step in path.split('.') {
        if matches!(at.data, Data::Null | Data::Broken) {
            *at = Node::new(span, Data::Map(Vec::new()));
        }
        at = match &mut at.data {
            Data::Map(entries) => {
                let place = entries.iter().position(|e| e.key == step).unwrap_or_else(|| {
                    entries.push(Entry { key: step.to_owned(), at: span, value: Node::new(span, Data::Null) });
                    entries.len() - 1
                });
                let entry = &mut entries[place];
                &mut entry.value
            }
            Data::List(items) => {
                let place: usize = step.parse().expect("`check_path` saw this index");
                &mut items[place]
            }
            _ => unreachable!("`check_path` saw a list or a map here"),
        };
    }
    *at = value;
}
