//! The documentation against the program: commands run, pipelines check, references are fresh, links lead somewhere.
//!
//! `TURBID_RENEW_DOCS=1 cargo test --test all docs` writes `docs/reference` anew and wraps long lines.
//!
//! Fences say what a block is: "```sh" is run line by line in a folder with the shipped pipelines, of "```sh long" only the arguments and
//! the pipeline are checked; "```yaml" is a whole pipeline, "```yaml NAME.yaml" one that later commands of the page use,
//! "```yaml fragment" a part of one, "```yaml with STAGE" has the params of such a stage.

#[path = "docs/examples.rs"]
mod examples;
#[path = "docs/page.rs"]
mod page;
#[path = "docs/payloads.rs"]
mod payloads;

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use page::{Block, Page, pages, too_long, wrapped};
use serde_json::Value;
use turbid::registry::Registry;
use turbid_contract::ArtifactKind;

use crate::space::Space;

const RENEW: &str = "TURBID_RENEW_DOCS";

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn renew() -> bool {
    std::env::var_os(RENEW).is_some()
}

/// A folder in which `pipelines` are those that are shipped.
fn space() -> Space {
    let space = Space::new();
    std::os::unix::fs::symlink(root().join("pipelines"), space.path().join("pipelines")).expect("the folder is ours");
    space
}

/// `docs/reference` is what the program prints of its stages, and what it says before a run of one in a shipped pipeline; each page leads to the theory page that leads to it, and back.
#[test]
fn references_are_what_the_program_prints() {
    let (space, folder) = (Space::new(), root().join("docs/reference"));
    let theory: Vec<Page> = pages().into_iter().filter(|page| page.name.starts_with("docs/theory/")).collect();
    let made = examples::sections();
    assert!(made.len() > 12, "forms of few stages are known: {:?}", made.keys());
    let mut wanted = vec![("README.md".to_owned(), space.turbid(&["stages", "--markdown"]).ok())];
    for row in Registry::builtin().rows() {
        let text = space.turbid(&["stages", row.name, "--markdown"]).ok();
        let link = format!("../reference/{}.md", row.name);
        let of = theory.iter().find(|page| page.links().contains(&link));
        let of = of.unwrap_or_else(|| panic!("no page of docs/theory has a link to {link}"));
        let theory = of.name.strip_prefix("docs/").expect("it is below docs");
        let (head, rest) = text.split_once("\n## ").expect("a page has sections");
        let text = format!("{head}\nMethod, formulas and measured errors: [{theory}](../{theory}).\n\n## {rest}");
        let made = made.get(row.name).map_or_else(String::new, |made| format!("\n\n{made}"));
        wanted.push((format!("{}.md", row.name), format!("{}{made}", text.trim_end())));
    }
    if renew() {
        fs::create_dir_all(&folder).expect("the folder can be made");
        for (name, text) in &wanted {
            fs::write(folder.join(name), format!("{}\n", text.trim_end())).expect("it can be written");
        }
    }
    for (name, text) in &wanted {
        let found = fs::read_to_string(folder.join(name)).unwrap_or_default();
        assert_eq!(found.trim_end(), text.trim_end(), "docs/reference/{name} is stale; {RENEW}=1 renews it");
    }
    let known: BTreeSet<&String> = wanted.iter().map(|(name, _)| name).collect();
    for entry in fs::read_dir(&folder).expect("the folder is there") {
        let name = entry.expect("an entry").file_name().to_string_lossy().into_owned();
        assert!(known.contains(&name), "docs/reference/{name} is of no stage");
    }
}

/// Prose has at most 120 columns; tables, code, headings and pictures may have more.
#[test]
fn lines_are_wrapped() {
    let mut long = Vec::new();
    for page in pages() {
        if renew() && !too_long(&page.text).is_empty() {
            fs::write(&page.path, wrapped(&page.text)).expect("it can be written");
            continue;
        }
        long.extend(too_long(&page.text).into_iter().map(|line| format!("{}:{line}", page.name)));
    }
    assert!(long.is_empty(), "longer than {} columns; {RENEW}=1 wraps them:\n{}", page::WIDTH, long.join("\n"));
}

/// Wrapping breaks between words only, never makes a list of a sentence, and changes nothing but blanks.
#[test]
fn wrapping_keeps_the_words() {
    let word = "abcdefghi ".repeat(11);
    let text = format!(
        "# Head\n\n- {word}and `a code span` {word}1. no list - nor here {word}\n  more\n\n| {word}{word} |\n\n    {word}{word}\n"
    );
    let wrapped = wrapped(&text);
    assert!(too_long(&text) == [3] && too_long(&wrapped).is_empty(), "{wrapped}");
    let words = |text: &str| text.split_whitespace().map(str::to_owned).collect::<Vec<_>>();
    assert_eq!(words(&text), words(&wrapped));
    let items = wrapped.lines().filter(|line| page::marker(line.trim_start()).is_some()).count();
    assert_eq!(items, 1, "{wrapped}");
    assert!(wrapped.contains("`a code span`"), "{wrapped}");
    assert_eq!(page::wrapped(&wrapped), wrapped);
}

/// Relative links lead to files and headings that are there.
#[test]
fn links_lead_somewhere() {
    let pages = pages();
    let mut dead = Vec::new();
    for page in &pages {
        for link in page.links().iter().filter(|link| !link.contains("://")) {
            let (file, anchor) = link.split_once('#').unwrap_or((link, ""));
            let folder = page.path.parent().expect("a page is in a folder");
            let target = if file.is_empty() { page.path.clone() } else { folder.join(file) };
            let target = target.canonicalize().unwrap_or(target);
            let there = pages.iter().find(|page| page.path == target);
            let known = anchor.is_empty() || there.is_some_and(|page| page.anchors().contains(&anchor.to_owned()));
            if !target.exists() || !known {
                dead.push(format!("{}: {link}", page.name));
            }
        }
    }
    assert!(dead.is_empty(), "{}", dead.join("\n"));
}

/// Results that pages name exist: `outputs/latest/PIPELINE/STAGE/PORT.exr` of a shipped pipeline.
#[test]
fn named_results_exist() {
    let mut checked = 0;
    for page in pages() {
        for at in page.text.match_indices("outputs/latest/").map(|(at, name)| at + name.len()) {
            let ends = |c: char| c.is_whitespace() || matches!(c, '`' | '"' | ')' | ',' | '\'');
            let path = page.text[at..].split(ends).next().unwrap_or_default().trim_end_matches('.');
            let parts: Vec<&str> = path.split('/').collect();
            let [pipeline, stage, .., file] = parts.as_slice() else { continue };
            let source = root().join("pipelines").join(format!("{pipeline}.yaml"));
            let Ok(source) = fs::read_to_string(source) else { continue };
            let pipeline: Value = serde_yaml::from_str(&source).expect("it is YAML");
            let kind = pipeline["stages"][*stage]["use"].as_str();
            let kind = kind.unwrap_or_else(|| panic!("{}: {path}: there is no stage {stage}", page.name));
            let ports = (Registry::builtin().find(kind).expect("a stage").outputs)();
            let (port, ending) = file.split_once('.').unwrap_or((file, ""));
            let fits = |kind: &ArtifactKind| match ending {
                "png" => true,
                "exr" => *kind == ArtifactKind::Images,
                _ => ending == "parquet" && *kind != ArtifactKind::Images,
            };
            let known = ports.iter().any(|p| p.name == port && fits(&p.kind));
            assert!(known || file.is_empty(), "{}: {path}: {kind} makes no {file}", page.name);
            checked += 1;
        }
    }
    assert!(checked >= 3, "the paths were not understood");
}

/// A line of a shell block without its comment, as arguments; and the file that stdout goes to.
fn arguments(line: &str) -> (Vec<String>, Option<String>) {
    let (mut found, mut word, mut quote) = (Vec::new(), String::new(), None);
    let mut quoted = false;
    for c in line.chars() {
        match (quote, c) {
            (None, '"' | '\'') => (quote, quoted) = (Some(c), true),
            (Some(q), _) if q == c => quote = None,
            (None, '#') if word.is_empty() => break,
            (None, _) if c.is_whitespace() => {
                if quoted || !word.is_empty() {
                    found.push(std::mem::take(&mut word));
                }
                quoted = false;
            }
            _ => word.push(c),
        }
    }
    if quoted || !word.is_empty() {
        found.push(word);
    }
    let to = found.iter().position(|word| word == ">").map(|at| {
        let file = found[at + 1].clone();
        found.truncate(at);
        file
    });
    (found, to)
}

/// Runs a command of a page as its reader would.
fn execute(space: &Space, place: &str, arguments: &[String], to: Option<String>) {
    let words: Vec<&str> = arguments[1..].iter().map(String::as_str).collect();
    let done = space.turbid(&words);
    assert_eq!(done.code, Some(0), "{place}: {}\n{}", arguments.join(" "), done.err);
    if let Some(name) = to {
        space.write(&name, &done.out);
    }
}

/// Checks a command that takes long: its flags, its pipeline under its overrides, the stages that it names.
fn inspect(space: &Space, place: &str, arguments: &[String]) {
    let words: Vec<&str> = arguments[1..].iter().map(String::as_str).collect();
    let done = space.turbid(&[&words[..], &["--help"]].concat());
    assert_eq!(done.code, Some(0), "{place}: {}\n{}", arguments.join(" "), done.err);
    let ["run" | "plan" | "check" | "show" | "export", file, rest @ ..] = words.as_slice() else { return };
    let mut check = vec!["check", *file];
    let mut named = Vec::new();
    let mut rest = rest.iter();
    while let Some(&word) = rest.next() {
        match word {
            "--set" => check.extend([word, *rest.next().expect("the flags were read")]),
            "--to" | "--bits" | "-j" | "--force" | "--outputs" | "--store" => drop(rest.next()),
            _ if word.starts_with('-') => {}
            _ => named.push(word.split(['.', '[']).next().unwrap_or(word)),
        }
    }
    let done = space.turbid(&check);
    assert_eq!(done.code, Some(0), "{place}: {}\n{}", check.join(" "), done.err);
    let graph = space.turbid(&["graph", *file]).ok();
    let unknown = named.iter().find(|stage| !graph.contains(**stage));
    assert_eq!(unknown, None, "{place}: {file} has no such stage");
}

/// Commands in fenced blocks of `sh` run, those of `sh long` are inspected; so are those that sentences quote.
#[test]
fn commands_work() {
    let mut seen = BTreeSet::new();
    let (mut ran, mut inspected) = (0, 0);
    for page in pages() {
        let space = space();
        for block in page.blocks() {
            match (block.language.as_str(), block.words.first()) {
                ("yaml", Some(name)) if name.ends_with(".yaml") => space.write(name, &block.text),
                ("sh", mode) => {
                    for (at, line) in block.text.lines().enumerate().filter(|(_, l)| l.starts_with("turbid ")) {
                        let place = format!("{}:{}", page.name, block.line + 1 + at);
                        let (arguments, to) = arguments(line);
                        if mode.is_some_and(|mode| mode == "long") {
                            inspected += 1;
                            inspect(&space, &place, &arguments);
                        } else {
                            ran += 1;
                            execute(&space, &place, &arguments, to);
                        }
                    }
                }
                _ => {}
            }
        }
        for line in page.code_spans().iter().filter(|span| span.starts_with("turbid ")) {
            let (arguments, _) = arguments(line);
            // `FILE`, `N` stand for what the reader chooses.
            let stands_for = |word: &str| word.chars().all(|c| c.is_ascii_uppercase());
            let chosen = |word: &String| word.split(['.', '=', '[', ']', '|']).any(stands_for);
            let shipped = arguments.get(2).is_some_and(|file| file.starts_with("pipelines/"));
            if shipped && !arguments.iter().any(chosen) && seen.insert(line.clone()) {
                inspected += 1;
                inspect(&space, &page.name, &arguments);
            }
        }
    }
    assert!(ran > 10 && inspected > 15, "{ran} commands ran, {inspected} were inspected");
}

/// YAML in pages is what its fence says: a pipeline that `check` takes, or a part that a stage's own reader takes.
#[test]
fn snippets_are_right() {
    let registry = Registry::builtin();
    let mut checked = 0;
    for page in pages() {
        let space = space();
        for block in page.blocks().iter().filter(|block| block.language == "yaml") {
            let place = format!("{}:{}", page.name, block.line);
            let value: Value = serde_yaml::from_str(&block.text).unwrap_or_else(|e| panic!("{place}: {e}"));
            let words: Vec<&str> = block.words.iter().map(String::as_str).collect();
            match words.as_slice() {
                ["with", stage] => {
                    let row = registry.find(stage).unwrap_or_else(|| panic!("{place}: no stage {stage}"));
                    let read = (row.prepare)(&value["with"]);
                    assert!(read.is_ok(), "{place}: {:?}", read.err());
                }
                ["fragment"] => {}
                // What it includes is made by the commands of the page.
                [name] if name.ends_with(".yaml") => {}
                [] => {
                    space.write("p.yaml", &block.text);
                    let done = space.turbid(&["check", "p.yaml"]);
                    assert_eq!(done.code, Some(0), "{place}: {}", done.err);
                }
                _ => panic!("{place}: what is a block of `yaml {}`?", words.join(" ")),
            }
            stages_in(&value, &mut |stage, with| {
                let Some(row) = registry.find(stage) else { panic!("{place}: no stage `{stage}`") };
                // What a variable holds is not known here.
                if !with.to_string().contains("${") && !with.is_null() {
                    let read = (row.prepare)(with);
                    assert!(read.is_ok(), "{place}: {stage}: {:?}", read.err());
                    checked += 1;
                }
            });
        }
    }
    assert!(checked > 10, "{checked} blocks of params were found");
}

/// Calls `each` with the kind and the params of every stage in `value`.
fn stages_in(value: &Value, each: &mut dyn FnMut(&str, &Value)) {
    let Some(map) = value.as_object() else { return };
    if let Some(stage) = map.get("use").and_then(Value::as_str) {
        each(stage, map.get("with").unwrap_or(&Value::Null));
        return;
    }
    map.values().for_each(|part| stages_in(part, each));
}

/// Words of our own that a reader cannot know; `docs/terms.md` says what they mean.
const PRIVATE: [&str; 9] =
    ["scout", "scouts", "stand-in", "stand-ins", "flock", "way out", "ways out", "house unit", "house units"];

/// Pages say it in the field's words. Names in code spans are those of files and flags.
#[test]
fn private_words_stand_in_the_list_of_terms_only() {
    let mut found = Vec::new();
    for page in pages().iter().filter(|page| page.name != "docs/terms.md") {
        let plain = page.prose().split('`').step_by(2).collect::<Vec<_>>().join(" ").to_lowercase();
        // Paths of links are no words.
        let plain = plain.replace("](", " ](").replace(|c: char| !c.is_alphanumeric() && c != '-', " ");
        let words = format!(" {} ", plain.split_whitespace().collect::<Vec<_>>().join(" "));
        let private = PRIVATE.iter().filter(|word| words.contains(&format!(" {word} ")));
        found.extend(private.map(|word| format!("{}: {word}", page.name)));
    }
    assert!(found.is_empty(), "say it in the field's words, or explain it in docs/terms.md: {found:#?}");
}

/// Theory pages say what is, not what some version of the program did.
#[test]
fn theory_has_no_version_history() {
    let mut found = Vec::new();
    for page in pages().iter().filter(|page| page.name.starts_with("docs/theory/")) {
        let prose = page.prose();
        let words: Vec<&str> = prose.split_whitespace().collect();
        for pair in words.windows(2) {
            let number = pair[1].trim_end_matches([',', '.', ':', ')', ';']);
            // Version 4 is that of another program.
            let ours = ["version", "(version", "render", "(render"].contains(&pair[0]) && number != "4";
            if ours && !number.is_empty() && number.chars().all(|c| c.is_ascii_digit()) {
                found.push(format!("{}: {} {}", page.name, pair[0], pair[1]));
            }
        }
    }
    assert!(found.is_empty(), "{found:#?}");
}

/// Blocks are of the kinds that are looked at.
#[test]
fn fences_name_their_language() {
    const KNOWN: [&str; 8] = ["sh", "yaml", "text", "json", "python", "matlab", "rust", "toml"];
    for page in pages() {
        let odd = |block: &&Block| !KNOWN.contains(&block.language.as_str());
        let odd = page.blocks().iter().find(odd).map(|block| format!("{}:{}", page.name, block.line));
        assert_eq!(odd, None, "a fence without a language, or of an unknown one");
    }
}
