//! The arrows of docs/architecture.md, read from the manifests and the sources.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

pub fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

pub fn read(path: impl AsRef<Path>) -> String {
    let path = path.as_ref();
    fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

pub fn stage_crates() -> Vec<String> {
    let mut names: Vec<String> = fs::read_dir(root().join("stages"))
        .expect("the folder of stages")
        .map(|entry| entry.expect("an entry").file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

/// Names of the dependencies in one section of a manifest.
fn dependencies(manifest: &str, section: &str) -> BTreeSet<String> {
    let mut names = BTreeSet::new();
    let mut inside = false;
    for line in manifest.lines() {
        if line.starts_with('[') {
            inside = line.trim() == format!("[{section}]");
        } else if inside && let Some((name, _)) = line.split_once(['=', '.']) {
            names.insert(name.trim().to_owned());
        }
    }
    names
}

/// The Rust files below a folder, those of tests left out.
pub fn sources(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if path.is_dir() && path.file_name().is_some_and(|name| name != "tests") {
            found.extend(sources(&path));
        } else if path.extension().is_some_and(|e| e == "rs") && path.file_name().is_some_and(|name| name != "tests.rs")
        {
            found.push(path);
        }
    }
    found.sort();
    found
}

/// Stages meet at payload types: contract, optics and the geometry between both are all of turbid that they may know, tests included. Drawn
/// quantities are one language for pipeline files and scattered bodies: scene reads it too.
#[test]
fn no_stage_depends_on_a_stage() {
    for name in stage_crates() {
        let manifest = read(root().join("stages").join(&name).join("Cargo.toml"));
        let allowed: &[&str] = match name.as_str() {
            "contract" | "optics" => &[],
            "geometry" => &["turbid-contract", "turbid-optics"],
            "scene" => &["turbid-contract", "turbid-draw", "turbid-optics", "turbid-geometry"],
            _ => &["turbid-contract", "turbid-optics", "turbid-geometry"],
        };
        for section in ["dependencies", "dev-dependencies", "build-dependencies"] {
            let known = dependencies(&manifest, section);
            assert!(!known.is_empty() || section != "dependencies", "{name}: the manifest was not understood");
            for dependency in known.iter().filter(|d| d.starts_with("turbid")) {
                assert!(allowed.contains(&dependency.as_str()), "stages/{name} [{section}] has {dependency}");
            }
        }
    }
}

/// Only the store writes EXR and Parquet, but for the shards of data sets, and only the root package can. (Foreign files such as PNG are read from their bytes by the
/// stage that they belong to.)
#[test]
fn file_formats_stay_in_the_root_package() {
    for name in stage_crates() {
        let manifest = read(root().join("stages").join(&name).join("Cargo.toml"));
        for dependency in dependencies(&manifest, "dependencies") {
            let format = ["exr", "parquet", "arrow-array", "arrow-schema", "polars"].contains(&dependency.as_str());
            // Foreign files are read, from bytes, by the stage that owns them.
            let reads = name == "import" && dependency == "exr";
            assert!(!format || reads, "stages/{name} has {dependency}");
        }
    }
    for path in sources(&root().join("src")) {
        let inside = path.strip_prefix(root()).expect("below the root").to_string_lossy().replace('\\', "/");
        let text = read(&path);
        for format in ["exr::", "parquet::"] {
            let used = text.lines().any(|l| l.trim_start().starts_with("use ") && l.contains(&format!("use {format}")));
            // Shards of data sets are for other programs.
            let shard = format == "parquet::" && ["src/dataset/shard.rs", "src/dataset/verify.rs"].contains(&&*inside);
            assert!(!used || shard || inside.starts_with("src/store"), "{inside} uses {format}");
        }
    }
}

/// Files that the user names are read by `input_file` alone: regular ones, of bounded size. The rest of the program opens what it wrote.
#[test]
fn input_files_are_read_in_one_place() {
    let own = [
        "src/input_file.rs",
        "src/whole_file.rs",
        "src/store",
        "src/dataset/folder.rs",
        "src/dataset/verify.rs",
        "src/run/latest",
        "src/run/log.rs",
        "src/memory/machine.rs",
    ];
    for path in sources(&root().join("src")) {
        let inside = path.strip_prefix(root()).expect("below the root").to_string_lossy().replace('\\', "/");
        if own.iter().any(|own| inside.starts_with(own)) {
            continue;
        }
        let text = read(&path);
        let code = text.split("#[cfg(test)]").next().unwrap_or_default();
        for line in code.lines().filter(|l| !l.trim_start().starts_with("//")) {
            // What Linux says of a process.
            let ours = line.contains("\"/proc/self/");
            let reads = ["fs::read(", "read_to_string(", "File::open("].iter().any(|call| line.contains(call));
            assert!(!reads || ours || inside.ends_with("tests.rs"), "{inside}: {line}");
        }
    }
}

/// polars, which takes as long to build as all the rest, is known to one crate, and only the feature `tables` brings that one.
#[test]
fn polars_comes_with_its_feature_alone() {
    let root_manifest = read(root().join("Cargo.toml"));
    assert!(root_manifest.contains("turbid-tables = { workspace = true, optional = true }"));
    assert!(root_manifest.contains("\ntables = [\"dep:turbid-tables\"]\n") && !root_manifest.contains("\ndefault = ["));
    assert!(dependencies(&read(root().join("tables/Cargo.toml")), "dependencies").contains("polars"));
    for name in stage_crates() {
        let manifest = read(root().join("stages").join(&name).join("Cargo.toml"));
        assert!(!manifest.contains("polars") && !manifest.contains("turbid-tables"), "stages/{name} has polars");
    }
    // Crates of other machines need not be there.
    const TARGET: &str = "x86_64-unknown-linux-gnu";
    let cargo = option_env!("CARGO").unwrap_or("cargo");
    let tree = |more: &[&str]| {
        let arguments =
            ["tree", "--offline", "--locked", "-p", "turbid", "-e", "normal", "--prefix", "none", "--target", TARGET];
        let done = std::process::Command::new(cargo).args(arguments).args(more).current_dir(root()).output();
        let done = done.expect("cargo starts");
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
        String::from_utf8_lossy(&done.stdout).into_owned()
    };
    assert!(!tree(&[]).contains("polars"), "turbid without `tables` has polars");
    assert!(tree(&["--features", "tables"]).contains("polars"));
}

/// Files that must appear whole are written in one way: with the rights that the user gives, under another name until all of it is there.
#[test]
fn whole_files_are_written_in_one_place() {
    for path in sources(&root().join("src")) {
        let text = read(&path);
        let code = text.split("#[cfg(test)]").next().unwrap_or_default();
        let own = path.ends_with("whole_file.rs");
        for call in [".tempfile_in(", "NamedTempFile::new", "from_mode("] {
            assert!(own || path.ends_with("tests.rs") || !code.contains(call), "{}: {call}", path.display());
        }
    }
}

/// A stage opens no file, reads no clock, prints nothing: all of that goes through `Ctx`.
#[test]
fn stages_touch_the_world_only_through_ctx() {
    let forbidden =
        ["std::fs", "std::net", "std::process", "std::time", "std::env", "SystemTime", "println!", "eprintln!", "dbg!"];
    for name in stage_crates() {
        for path in sources(&root().join("stages").join(&name).join("src")) {
            let text = read(&path);
            // Unit tests may read their tables and say what they measured.
            let code = text.split("#[cfg(test)]").next().unwrap_or_default();
            for line in code.lines().filter(|l| !l.trim_start().starts_with("//")) {
                for word in forbidden {
                    assert!(!line.contains(word), "{}: `{word}` in {line}", path.display());
                }
            }
        }
    }
}

/// The engine knows no stage's params, measures or payloads by name: where a stage stops, what it kept and what is drawn of it, its row and its run say.
#[test]
fn the_engine_knows_no_stages_words() {
    let words = ["max_seconds", "target_error", "\"samples\"", "\"covariance\"", "photons"];
    for path in sources(&root().join("src")) {
        let inside = path.strip_prefix(root()).expect("below the root").to_string_lossy().replace('\\', "/");
        // Pictures and tables name quantities for people to read; the samples of a data set are counted.
        if ["src/preview", "src/cli/show", "src/cli/figures.rs", "src/dataset", "src/cli/dataset"]
            .iter()
            .any(|face| inside.starts_with(face))
        {
            continue;
        }
        let text = read(&path);
        let code = text.split("#[cfg(test)]").next().unwrap_or_default();
        for line in code.lines().filter(|l| !l.trim_start().starts_with("//")) {
            for word in words {
                assert!(!line.contains(word), "{inside}: `{word}` in {line}");
            }
        }
    }
}

/// The engine names no physics: whatever it knows of a stage it knows from its row. (The store knows what describes a
/// layer, `f_x_per_mm` among it, because the contract does.)
#[test]
fn the_engine_names_no_physics() {
    let words = ["mu_a", "mu_s", "m_ac", "reflectance", "radiance", "albedo", "scatter"];
    for file in ["key.rs", "resolve.rs", "explain.rs", "estimate.rs", "plan", "run", "store"] {
        let path = root().join("src").join(file);
        let files = if path.is_dir() { sources(&path) } else { vec![path] };
        for path in files {
            let text = read(&path);
            let code = text.split("#[cfg(test)]").next().unwrap_or_default();
            for line in code.lines().filter(|l| !l.trim_start().starts_with("//")) {
                for word in words {
                    assert!(!line.contains(word), "{}: `{word}` in {line}", path.display());
                }
            }
        }
    }
}

/// The transcendental functions of the standard library differ between machines; optics and `libm` do not.
/// A mistake is known by its kind; its words may change.
#[test]
fn nothing_is_decided_by_the_words_of_a_message() {
    let mut found = Vec::new();
    for path in sources(&root().join("src")) {
        let code = read(&path);
        for (i, line) in code.split("#[cfg(test)]").next().unwrap_or_default().lines().enumerate() {
            for text in ["message", "rule", "info", "hint", "text()", "to_string()"] {
                for asked in ["contains", "starts_with", "ends_with", "strip_prefix", "find"] {
                    let asks = format!("{text}.{asked}(\"");
                    if line.contains(&asks) {
                        found.push(format!("{}:{}: {asks}", path.display(), i + 1));
                    }
                }
            }
        }
    }
    assert_eq!(found, Vec::<String>::new());
}

#[test]
fn stages_use_portable_transcendentals() {
    let forbidden = [
        ".ln()",
        ".exp()",
        ".sin()",
        ".cos()",
        ".sin_cos()",
        ".tan()",
        ".powf(",
        ".log10()",
        ".log2()",
        ".exp_m1()",
        ".ln_1p()",
        ".atan2(",
        ".acos()",
        ".asin()",
        ".atan()",
        ".sinh()",
        ".cosh()",
        ".tanh()",
        ".hypot(",
        ".cbrt()",
        ".mul_add(",
    ];
    for name in stage_crates() {
        for path in sources(&root().join("stages").join(&name).join("src")) {
            let text = read(&path);
            let code = text.split("#[cfg(test)]").next().unwrap_or_default();
            for line in code.lines().filter(|l| !l.trim_start().starts_with("//")) {
                for word in forbidden {
                    assert!(!line.contains(word), "{}: `{word}` in {line}", path.display());
                }
            }
        }
    }
}
