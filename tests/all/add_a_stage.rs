//! `docs/add-a-stage.md` counts what the author of a stage writes: the counts are those of the files.

use std::collections::BTreeMap;

use crate::floors::{read, root, sources};

/// File and lines of each row of the page's first table.
fn counted(page: &str) -> BTreeMap<String, usize> {
    let rows =
        page.lines().skip_while(|line| !line.starts_with("|---")).skip(1).take_while(|line| line.starts_with('|'));
    rows.map(|row| {
        let cells: Vec<&str> = row.trim_matches('|').split('|').map(str::trim).collect();
        (cells[0].trim_matches('`').to_owned(), cells[1].parse().unwrap_or_else(|_| panic!("lines in {row}")))
    })
    .collect()
}

/// All files of the example below a folder, by their place in it.
fn files(folder: &std::path::Path, inside: &str, found: &mut BTreeMap<String, usize>) {
    for entry in std::fs::read_dir(folder).expect("the example is there").flatten() {
        let name = format!("{inside}{}", entry.file_name().to_string_lossy());
        if entry.path().is_dir() {
            files(&entry.path(), &format!("{name}/"), found);
        } else {
            found.insert(name, read(entry.path()).lines().count());
        }
    }
}

#[test]
fn the_example_is_as_large_as_the_page_says() {
    let mut said = counted(&read(root().join("docs/add-a-stage.md")));
    let mut there = BTreeMap::new();
    files(&root().join("examples/own_stage"), "", &mut there);
    let total = said.remove(&format!("{} files", there.len()));
    assert_eq!(said, there);
    assert_eq!(total, Some(there.values().sum()), "the sum, and the number of files");
}

/// A third party's crate knows the program and the contract.
#[test]
fn the_example_depends_on_the_contract_alone() {
    let manifest = read(root().join("examples/own_stage/Cargo.toml"));
    let dependencies = manifest.split("[dependencies]").nth(1).expect("it has some");
    let names: Vec<&str> =
        dependencies.lines().filter_map(|line| line.split_once(" = ")).map(|(name, _)| name).collect();
    assert_eq!(names, ["turbid", "turbid-contract"]);
}

/// The files that a built-in table stage touches: its own, the root of its crate, the registry; and the page that explains it.
#[test]
fn a_table_stage_touches_four_files() {
    let mut code = sources(&root().join("src"));
    for stage in crate::floors::stage_crates() {
        code.extend(sources(&root().join("stages").join(stage).join("src")));
    }
    let names = |path: &std::path::PathBuf| {
        let text = read(path);
        let mut words = text.split(|c: char| !c.is_alphanumeric() && c != '_');
        words
            .any(|word| word == "Tabulate" || word == "TabulateParams")
            .then(|| path.strip_prefix(root()).expect("below the root").to_string_lossy().replace('\\', "/"))
    };
    let mut touched: Vec<String> = code.iter().filter_map(names).collect();
    touched.sort();
    assert_eq!(touched, ["src/registry.rs", "stages/compare/src/lib.rs", "stages/compare/src/tabulate.rs"]);
    let page = read(root().join("docs/add-a-stage.md"));
    for file in touched.iter().map(String::as_str).chain(["docs/theory/compare.md"]) {
        assert!(page.contains(&format!("`{file}`")), "docs/add-a-stage.md does not name {file}");
    }
    assert!(read(root().join("docs/theory/compare.md")).contains("tabulate"));
}
