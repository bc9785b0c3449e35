//! `turbid export --all`, and what programs ask for: places of outputs, mistakes as JSON.

use std::path::Path;

use serde_json::Value;
use turbid::store;
use turbid_contract::{Artifact, ArtifactKind, Cells, Table};

use crate::space::{SMALL, Space};

/// Six instances along a number and a text.
fn sweep() -> Space {
    let foreach = "  tissue:\n    use: scene\n    foreach: {A_rho: [50, 60.5, 70], site: [\"µ, \\\"x\\\"\", b]}\n";
    let text =
        SMALL.replacen("  tissue:\n    use: scene\n", foreach, 1).replacen("A_rho: 50,", "A_rho: \"${A_rho}\",", 1);
    let table = concat!(
        "  table:\n    use: build_lut\n    foreach: {gg: [0.7, 0.75, 0.8], site: [\"µ, \\\"x\\\"\", b]}\n",
        "    with: {model: diffusion, f_x: [0, 0.1], mu_a: [0.01, 0.05], mu_s_prime: [0.5, 1], g: \"${gg}\", n: 1, convention: camera}\n",
    );
    let space = Space::with(&(text + table));
    space.turbid(&["run", "p.yaml", "frames.truth", "table"]).ok();
    space
}

fn table(path: &Path) -> Table {
    let bytes = std::fs::read(path).expect("it was written");
    let Ok(Artifact::Table(table)) = store::decode(ArtifactKind::Table, &bytes) else { panic!("{}", path.display()) };
    table
}

fn column<'a>(table: &'a Table, name: &str) -> &'a Cells {
    let found = table.columns.iter().find(|column| column.name == name);
    &found
        .unwrap_or_else(|| {
            panic!("no column {name} in {:?}", table.columns.iter().map(|c| &c.name).collect::<Vec<_>>())
        })
        .cells
}

/// The rows of all instances with their axes are those of each; files of a folder are the bytes of the store.
#[test]
fn all_instances_are_in_one_table() {
    let space = sweep();
    let at = |name: &str| space.path().join(name);
    space.turbid(&["export", "p.yaml", "table", "--all", "--to", "all.parquet"]).ok();
    let said = space.turbid(&["export", "p.yaml", "table.lut", "--all", "--to", "each/"]).ok();
    assert!(said.contains("wrote 6 files and instances.parquet"), "{said}");
    let (all, list) = (table(&at("all.parquet")), table(&at("each/instances.parquet")));
    let Cells::Text(files) = column(&list, "file") else { panic!("names are text") };
    let Cells::Text(sites) = column(&list, "site") else { panic!("sites are text") };
    assert_eq!(sites.iter().filter(|site| *site == "µ, \"x\"").count(), 3);
    let parts: Vec<Table> = files.iter().map(|file| table(&at("each").join(file))).collect();
    for one in &parts[0].columns {
        let together = all.columns.iter().find(|c| c.name == one.name).expect("every column");
        assert_eq!(one.unit, together.unit);
        assert_eq!(all.attributes["units"][&one.name], Value::from(one.unit.clone()));
        let text = |cells: &Cells| format!("{cells:?}").split_once('(').expect("a list").1.replace([')', '[', ']'], "");
        let joined: Vec<String> = parts.iter().map(|part| text(column(part, &one.name))).collect();
        // Of some instances a number may not be known: then of all `Some` stands before it.
        let plain = |text: &str| text.replace("Some", "").replace('(', "");
        assert_eq!(plain(&text(&together.cells)), plain(&joined.join(", ")), "{}", one.name);
    }
    let numbers: Vec<f64> = [0.7, 0.75, 0.8].into_iter().flat_map(|v| vec![v; 2 * parts[0].rows()]).collect();
    assert_eq!(column(&all, "gg"), &Cells::F64(numbers));
    for name in ["all.npz", "all.mat", "all.csv"] {
        space.turbid(&["export", "p.yaml", "table", "--all", "--to", name]).ok();
    }
    assert_eq!(std::fs::read_to_string(at("all.csv")).expect("CSV").lines().count(), 1 + all.rows());
}

#[test]
fn what_does_not_go_together_is_refused() {
    let space = sweep();
    for (arguments, says) in [
        (&["frames.truth", "--to", "x.tiff"][..], "go into one .npz or .mat"),
        (&["frames.truth", "--to", "x.parquet"], "go into one .npz or .mat"),
        (&["table", "--to", "x.jpeg"], "`.jpeg` is not a format"),
        (&["frames.truth", "--to", "x.npz", "--bits", "8"], "cannot be used with"),
        (&["nothing", "--to", "x.npz"], "nothing"),
    ] {
        let message = space.turbid(&[&["export", "p.yaml", "--all"], arguments].concat()).fails(2);
        assert!(message.contains(says), "{message}");
    }
    let message = space.turbid(&["export", "p.yaml", "frames.truth", "--to", "x.npz"]).fails(2);
    assert!(message.contains("or --all"), "{message}");
    let message = space
        .turbid(&["export", "p.yaml", "frames.truth", "--all", "--to", "x.npz", "--set", "vars.samples=17"])
        .fails(1);
    assert!(
        message.contains("has not run yet with these parameters; try `turbid run p.yaml frames.truth`"),
        "{message}"
    );
    assert!(!space.path().join("x.npz").exists() && !space.path().join("x.csv").exists());
}

/// The bytes that `show --places` names are those of the digest, in packs and in files of their own.
#[test]
fn places_are_where_the_bytes_are() {
    let space = Space::with(&SMALL.replacen("pixels: [12, 12]", "pixels: [96, 96]", 1));
    space.turbid(&["run", "p.yaml"]).ok();
    let told = space.turbid(&["show", "p.yaml", "--json", "--places"]).json();
    let (mut packed, mut own) = (0, 0);
    for instance in told["instances"].as_array().expect("instances") {
        let ports = instance["ports"].as_object().expect("ports");
        assert!(
            ports.contains_key(instance["first"].as_str().expect("a name")) || instance["stage"] == "tissue",
            "{instance}"
        );
        for port in ports.values() {
            let number = |name: &str| usize::try_from(port[name].as_u64().expect("a number")).expect("it is short");
            let bytes = std::fs::read(port["file"].as_str().expect("a file")).expect("it is there");
            let (offset, length) = (number("offset"), number("bytes"));
            let digest = turbid::digest::Digest::of(&bytes[offset..offset + length]).to_string();
            assert_eq!(port["digest"], Value::from(digest));
            *(if offset == 0 && length == bytes.len() { &mut own } else { &mut packed }) += 1;
        }
    }
    assert!(packed > 2 && own > 2, "{packed} in packs, {own} files");
}

/// Mistakes are one line of JSON on stderr, whoever finds them: the command line, the file, the store.
#[test]
fn mistakes_are_json_for_programs() {
    let space = Space::with(SMALL);
    let mistakes = |arguments: &[&str]| {
        let done = space.command(arguments).env("TURBID_ERRORS", "json").output().expect("it starts");
        let err = String::from_utf8(done.stderr).expect("UTF-8");
        assert_eq!(err.lines().count(), 1, "{err}");
        let told: Value = serde_json::from_str(&err).expect("JSON");
        (done.status.code(), told["mistakes"][0].clone())
    };
    for (arguments, code, kind, says) in [
        (&["run"][..], 2, "usage", "required"),
        (&["plan", "p.yaml", "--set", "vars.samples=x"], 2, "wrong_type", "samples"),
        (&["run", "none.yaml"], 2, "file", "none.yaml"),
        (&["show", "p.yaml", "nothing"], 2, "usage", "nothing"),
        (&["show", "p.yaml", "frames.nothing"], 2, "unknown_name", "nothing"),
        (&["show", "p.yaml", "frames[A=1]"], 2, "unknown_name", "no instance"),
        (&["show", "p.yaml", "frames"], 1, "not_run", "has not run yet"),
        (&["export", "p.yaml", "frames.frames", "--to", "x.npz"], 1, "not_run", "has not run yet"),
    ] {
        let (ended, mistake) = mistakes(arguments);
        assert_eq!((ended, &mistake["kind"]), (Some(code), &Value::from(kind)), "{mistake}");
        assert!(mistake.to_string().contains(says), "{mistake}");
    }
    let (_, mistake) = mistakes(&["plan", "p.yaml", "--set", "stages.frames.with.samples=-1"]);
    assert_eq!((&mistake["file"], &mistake["line"]), (&Value::from("--set"), &Value::from(1)), "{mistake}");
}

/// What `explain` tells people it tells programs.
#[test]
fn explanations_are_json() {
    let space = Space::with(SMALL);
    space.turbid(&["run", "p.yaml", "frames"]).ok();
    let told = space.turbid(&["explain", "p.yaml", "frames", "--set", "vars.samples=32", "--json"]).json();
    let one = &told["instances"][0];
    assert_eq!((&one["state"], &told["more"]), (&Value::from("run"), &Value::from(0)));
    let difference = &one["nearest"]["differences"][0];
    assert_eq!(
        (&difference["field"], &difference["before"], &difference["now"]),
        (&"with.samples".into(), &"16".into(), &"32".into())
    );
}
