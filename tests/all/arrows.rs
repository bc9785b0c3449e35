//! Which file reads which, as docs/architecture.md says: no circles among files, floors inside `src/`, and which files of a stage know the contract.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use crate::floors::{read, root, sources, stage_crates};

/// A file by its place among the modules: `["run", "host"]`; `lib.rs` is `[]`.
type Module = Vec<String>;

/// For each file the files of the same crate that it reads, by `crate::`, `super::` and `self::` paths outside of its tests.
///
/// A file and those below its folder are a tree: that a parent names its children (`mod`, `pub use child::..`) is no arrow. What a file takes from the
/// root of its crate is none either: the root only hands on.
fn graph(src: &Path) -> BTreeMap<Module, BTreeSet<Module>> {
    let files = sources(src);
    let texts: BTreeMap<Module, String> = files.iter().map(|path| (module(src, path), code(&read(path)))).collect();
    let known: BTreeSet<&Module> = texts.keys().collect();
    let arrows = |(module, text): (&Module, &String)| {
        let found = paths(text).into_iter().filter_map(|path| {
            let absolute = absolute(module, &path)?;
            (1..=absolute.len()).rev().map(|k| absolute[..k].to_vec()).find(|prefix| known.contains(prefix))
        });
        (module.clone(), found.filter(|to| to != module).collect())
    };
    texts.iter().filter(|(module, _)| !module.is_empty()).map(arrows).collect()
}

fn module(src: &Path, path: &Path) -> Module {
    let inside = path.strip_prefix(src).expect("below the folder").with_extension("");
    let mut parts: Module = inside.iter().map(|part| part.to_string_lossy().into_owned()).collect();
    if parts.last().is_some_and(|last| ["mod", "lib", "main"].contains(&last.as_str())) {
        parts.pop();
    }
    parts
}

/// Without comments and without what follows the first module of tests.
fn code(text: &str) -> String {
    let text = text.split("\n#[cfg(test)]\nmod ").next().unwrap_or_default();
    text.lines().map(|line| line.split("//").next().unwrap_or_default()).collect::<Vec<_>>().join("\n")
}

/// All paths that begin at the crate, at the parent or at the file itself; groups in braces are spread out.
fn paths(code: &str) -> Vec<Vec<String>> {
    let mut found = Vec::new();
    for begin in ["crate::", "super::", "self::"] {
        for (at, _) in code.match_indices(begin) {
            let before = code[..at].chars().next_back().unwrap_or(' ');
            // `super::super::x` is one path; `$crate::` is a macro's.
            if !(before.is_alphanumeric() || "_:$".contains(before)) {
                spread(Vec::new(), &code[at..], &mut found);
            }
        }
    }
    found
}

/// Reads a path at the beginning of `text`, or several in braces; what is behind it.
fn spread<'a>(mut path: Vec<String>, mut text: &'a str, found: &mut Vec<Vec<String>>) -> &'a str {
    loop {
        let word = text.len() - text.trim_start_matches(|c: char| c.is_alphanumeric() || c == '_').len();
        if word > 0 {
            path.push(text[..word].to_owned());
        }
        text = &text[word..];
        let Some(rest) = text.strip_prefix("::") else {
            found.push(path);
            return text;
        };
        text = rest;
        let Some(mut rest) = text.strip_prefix('{') else { continue };
        loop {
            rest = rest.trim_start_matches(|c: char| c.is_whitespace() || c == ',');
            if rest.is_empty() || rest.starts_with('}') {
                return rest.get(1..).unwrap_or_default();
            }
            rest = spread(path.clone(), rest, found);
            // `as NAME`, `*`
            rest = rest.trim_start_matches(|c: char| !",}".contains(c));
        }
    }
}

/// The path from the crate's root.
fn absolute(module: &[String], path: &[String]) -> Option<Module> {
    let mut at = if path[0] == "crate" { Vec::new() } else { module.to_vec() };
    for part in path {
        match part.as_str() {
            "crate" | "self" => {}
            "super" => drop(at.pop()?),
            name => at.push(name.to_owned()),
        }
    }
    Some(at)
}

/// Groups of files that reach each other.
fn circles(graph: &BTreeMap<Module, BTreeSet<Module>>) -> Vec<Vec<Module>> {
    let reached = |from: &Module| {
        let (mut seen, mut left) = (BTreeSet::new(), vec![from]);
        while let Some(at) = left.pop() {
            left.extend(graph.get(at).into_iter().flatten().filter(|to| seen.insert((*to).clone())));
        }
        seen
    };
    let reached: BTreeMap<&Module, BTreeSet<Module>> = graph.keys().map(|module| (module, reached(module))).collect();
    let mut found: Vec<Vec<Module>> = Vec::new();
    for (&module, reaches) in &reached {
        if reaches.contains(module) && !found.iter().any(|circle| circle.contains(module)) {
            found.push(reaches.iter().filter(|&other| reached[other].contains(module)).cloned().collect());
        }
    }
    found
}

fn named(module: &[String]) -> String {
    module.join("::")
}

/// The sources of every crate of turbid: its name and folder.
fn crates() -> Vec<(String, std::path::PathBuf)> {
    let stages = stage_crates().into_iter().map(|name| (name.clone(), root().join("stages").join(name).join("src")));
    stages.chain([("turbid".to_owned(), root().join("src"))]).collect()
}

/// No file reads a file that reads it, however long the way.
#[test]
fn no_files_read_each_other_in_a_circle() {
    let mut told = Vec::new();
    for (name, src) in crates() {
        let graph = graph(&src);
        assert!(graph.len() > 1 && graph.values().any(|arrows| !arrows.is_empty()), "{name}: nothing was understood");
        for circle in circles(&graph) {
            told.push(format!(
                "{name}: {} files: {}",
                circle.len(),
                circle.iter().map(|module| named(module)).collect::<Vec<_>>().join(", ")
            ));
            for from in &circle {
                let to: Vec<String> =
                    graph[from].iter().filter(|to| circle.contains(to)).map(|module| named(module)).collect();
                told.push(format!("    {} reads {}", named(from), to.join(", ")));
            }
        }
    }
    assert!(told.is_empty(), "files read each other in circles:\n{}", told.join("\n"));
}

/// The folders and files of `src/`, from the ground up: each reads only what lies below it.
const FLOORS: [&[&str]; 12] = [
    &["child"],
    &[
        "child",
        "digest",
        "ids",
        "leftover",
        "memory",
        "missing",
        "preview",
        "registry",
        "regular",
        "stamp",
        "statistics",
        "terminal",
        "threads",
    ],
    &["panics", "whole_file"],
    &["export", "input_file", "store"],
    &["spec"],
    &["brief", "key", "warned"],
    &["plan"],
    &["explain", "memo", "recipe"],
    &["resolve", "unchanged"],
    &["estimate", "run"],
    &["dataset", "report", "study", "submit"],
    &["cli"],
];

/// The arrows inside `src/`: from each floor down, never up or across.
#[test]
fn the_engine_reads_downwards() {
    let floor = |name: &str| FLOORS.iter().position(|floor| floor.contains(&name));
    for (module, arrows) in graph(&root().join("src")) {
        let own = floor(&module[0]).unwrap_or_else(|| panic!("src/{}: say in FLOORS what it stands on", module[0]));
        for to in arrows.iter().filter(|to| to[0] != module[0]) {
            let below = floor(&to[0]).is_some_and(|floor| floor < own);
            assert!(below, "src: {} reads {}, which does not lie below it", named(&module), named(to));
        }
    }
}

/// What only the files that are a stage's face to the engine may name: the trait, its ports, plan and problems that are not about a value of its own.
const FACE: [&str; 4] = ["impl Stage for", "in_ports!", "out_ports!", "StageRow"];

/// A stage's face to the engine is a file of its own: nothing else of its crate reads it, but for the root, which hands it on. All other files take
/// payloads, quantities, `Ctx` and errors from the contract, as they need them.
#[test]
fn nothing_reads_the_face_of_a_stage() {
    for (name, src) in crates() {
        if ["turbid", "contract", "draw", "optics", "geometry"].contains(&name.as_str()) {
            continue;
        }
        let faces: BTreeSet<Module> = sources(&src)
            .iter()
            .filter(|path| FACE.iter().any(|word| code(&read(path)).contains(word)))
            .map(|path| module(&src, path))
            .collect();
        assert!(!faces.is_empty(), "{name} has no stage");
        for (from, arrows) in graph(&src) {
            let read = arrows.intersection(&faces).next();
            assert!(
                read.is_none(),
                "{name}: {} reads {}, a stage's face",
                named(&from),
                named(read.expect("it is some"))
            );
        }
    }
}

/// The reader of arrows reads what the language allows.
#[test]
fn arrows_are_understood() {
    let code = "use crate::a::{self, b::{c, D as E}, f};\nuse super::g;\nlet x = crate::h::i(self::j());\n$crate::k::l";
    let mut found: Vec<String> = paths(code).iter().map(|path| path.join("::")).collect();
    found.sort();
    let want =
        ["crate::a::b::D", "crate::a::b::c", "crate::a::f", "crate::a::self", "crate::h::i", "self::j", "super::g"];
    assert_eq!(found, want);
    let of = |text: &str| text.split("::").map(str::to_owned).collect::<Module>();
    assert_eq!(absolute(&of("run::host"), &of("super::worker::W")), Some(of("run::worker::W")));
    assert_eq!(absolute(&of("run"), &of("super::super")), None);
    let arrows = |list: &[(&str, &str)]| {
        let mut graph: BTreeMap<Module, BTreeSet<Module>> = BTreeMap::new();
        for (from, to) in list {
            graph.entry(of(from)).or_default().insert(of(to));
            graph.entry(of(to)).or_default();
        }
        graph
    };
    assert!(circles(&arrows(&[("a", "b"), ("b", "c"), ("a", "c")])).is_empty());
    let circle = arrows(&[("a", "b"), ("b", "c"), ("c", "b"), ("c", "d")]);
    assert_eq!(circles(&circle), [vec![of("b"), of("c")]]);
}
