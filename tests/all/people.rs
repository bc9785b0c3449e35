//! What people get of a run: files with the rights that they give, few lines of many instances, a way to each of them.

use std::collections::BTreeMap;
use std::path::Path;

use turbid::store::decode;
use turbid_contract::{Artifact, ArtifactKind, Cells, Table};

use crate::space::{Done, SMALL, Space, counts};

/// 70 scenes, each one of its own.
fn sweep() -> Space {
    let text = SMALL
        .replace("  tissue:\n    use: scene\n", "  tissue:\n    use: scene\n    foreach: {A_rho: {range: [1, 71]}}\n")
        .replace("A_rho: 50,", "A_rho: \"${A_rho}\",");
    Space::with(&text)
}

fn texts<'a>(table: &'a Table, name: &str) -> &'a [String] {
    let column = table.columns.iter().find(|c| c.name == name).unwrap_or_else(|| panic!("no column {name}"));
    let Cells::Text(texts) = &column.cells else { panic!("{name} is no text") };
    texts
}

/// A run that goes to a file says of 70 instances that they begin and that they are done; the events are complete.
#[test]
fn many_instances_take_few_lines() {
    let space = sweep();
    let done = space.turbid(&["run", "p.yaml", "tissue", "phantom"]);
    let lines: Vec<&str> = done.err.lines().collect();
    assert!(lines.len() <= 6, "{}", done.err);
    assert!(lines.contains(&"run   tissue: 70 instances; the first: no earlier result"), "{}", done.err);
    assert!(lines.iter().any(|line| line.starts_with("done  tissue: 70 instances in ")), "{}", done.err);
    let runs = space.files("outputs/runs");
    let events = runs.iter().find(|path| path.ends_with("events.jsonl")).expect("a log of events");
    let events = std::fs::read_to_string(events).expect("it is ours");
    assert_eq!(events.lines().filter(|line| line.contains("\"ran\"")).count(), 71);
    // And so does the plan of what is to be done, of one reason or of many.
    let changed = ["--set", "stages.tissue.with.objects.block.slab.thickness=29"];
    for (arguments, kinds) in [(&[][..], 2), (&["--outputs", "others"], 2), (&changed, 2)] {
        let plan = space.turbid(&[&["plan", "p.yaml", "tissue", "phantom"][..], arguments].concat()).ok();
        let named = plan.lines().filter(|line| line.contains("tissue") || line.contains("phantom")).count();
        assert!(named <= kinds && plan.contains("tissue[A_rho=1] .. tissue[A_rho=70]: 70 instances"), "{plan}");
        let json = space.turbid(&[&["plan", "p.yaml", "tissue", "phantom", "--json"][..], arguments].concat()).json();
        assert_eq!(json["instances"].as_array().map(Vec::len), Some(71));
    }
    let shown = space.turbid(&["show", "p.yaml"]).ok();
    assert!(shown.contains("and 66 more instances of tissue") && shown.matches("tissue[").count() == 5, "{shown}");
    let json = space.turbid(&["show", "p.yaml", "--json"]).json();
    assert_eq!(json["instances"].as_array().map(Vec::len), Some(71));
}

/// Of many instances people have a list; each of its lines writes its instance as a file, and one command writes all.
#[cfg(unix)]
#[test]
fn every_instance_of_a_list_has_its_way() {
    let space = sweep();
    let out = space.turbid(&["run", "p.yaml", "tissue", "phantom", "--set", "vars.samples=17"]).ok();
    assert!(out.contains("results and pictures: ") && out.contains("and no pictures: tissue (70 instances)"), "{out}");
    let bytes = std::fs::read(space.outputs().join("latest/small/tissue/instances.parquet")).expect("it is there");
    let Artifact::Table(list) = decode(ArtifactKind::Table, &bytes).expect("a table") else { panic!("a table") };
    let lines = texts(&list, "scene.export");
    assert_eq!(lines.len(), 70);
    let bin = Path::new(env!("CARGO_BIN_EXE_turbid")).parent().expect("it lies in a folder");
    let typed = |line: &str| {
        let mut command = std::process::Command::new("sh");
        let path = format!("{}:{}", bin.display(), std::env::var("PATH").unwrap_or_default());
        command.args(["-c", line]).current_dir(space.path()).env("PATH", path).env_remove("TURBID_OUTPUTS");
        Done::from(command.output().expect("sh is there"), &[line]).ok()
    };
    assert_eq!(typed(&lines[4]), "wrote tissue,A_rho=5.scene.npz\n");
    let one = std::fs::read(space.path().join("tissue,A_rho=5.scene.npz")).expect("it was written");
    let all = out.lines().find_map(|line| line.strip_prefix("all of them: ")).expect("the command for all");
    assert_eq!(typed(all).lines().count(), 70);
    assert_eq!(std::fs::read(space.path().join("tissue,A_rho=5.scene.npz")).expect("it was written"), one);
    // Where only such stages ran, there are no pictures to speak of.
    let out = space.turbid(&["run", "p.yaml", "tissue", "--set", "vars.samples=17"]).ok();
    assert!(out.contains("lists of results: ") && !out.contains("results and pictures"), "{out}");
    let message = space.turbid(&["export", "p.yaml", "tissue.scene", "--to", "a.npz"]).fails(2);
    assert!(message.contains("{A_rho} into the name"), "{message}");
    assert!(!space.path().join("a.npz").exists());
}

/// The rights of all files are those that the user's umask leaves; what is a copy of the store, or in it, nobody writes to.
#[cfg(unix)]
#[test]
fn files_have_the_rights_that_the_user_gives() {
    use std::os::unix::fs::PermissionsExt;
    for (umask, written, kept) in [("022", 0o644, 0o444), ("077", 0o600, 0o400)] {
        let space = sweep();
        let under = |arguments: &str| {
            let mut command = std::process::Command::new("sh");
            let line = format!("umask {umask}; exec '{}' {arguments}", env!("CARGO_BIN_EXE_turbid"));
            command.args(["-c", &line]).current_dir(space.path()).env_remove("TURBID_OUTPUTS");
            Done::from(command.output().expect("sh is there"), &[arguments]).ok();
        };
        under("run p.yaml tissue phantom_frames --set stages.tissue.foreach.A_rho.range='[1,66]'");
        under("export p.yaml phantom_frames.frames --to a.npz");
        let mode = |path: &Path| path.metadata().expect("it is there").permissions().mode() & 0o777;
        let mut kinds: BTreeMap<u32, Vec<String>> = BTreeMap::new();
        for path in space.files("outputs").into_iter().chain([space.path().join("a.npz")]) {
            let name = path.strip_prefix(space.path()).expect("below it").display().to_string();
            kinds.entry(mode(&path)).or_default().push(name);
        }
        let modes: Vec<u32> = kinds.keys().copied().collect();
        let mut expected = vec![written, kept];
        expected.sort_unstable();
        assert_eq!(modes, expected, "umask {umask}: {kinds:#?}");
        for (ending, of) in
            [(".png", written), ("instances.parquet", written), ("a.npz", written), ("frames.exr", kept)]
        {
            let found = kinds[&of].iter().any(|name| name.ends_with(ending));
            assert!(found, "umask {umask}: {ending} is not {of:o}: {kinds:#?}");
        }
        assert!(kinds[&written].iter().any(|name| name.contains("memos/")), "{kinds:#?}");
    }
}

/// In a folder that another user has filled, a run that finds all up to date ends well, with one warning where something cannot be written.
#[cfg(unix)]
#[test]
fn an_up_to_date_run_needs_no_rights() {
    let space = Space::with(SMALL);
    counts(&space, &["phantom"]);
    std::fs::remove_dir_all(space.outputs().join("runs")).expect("it is ours");
    space.write("outputs/runs", "in the way");
    std::fs::remove_dir_all(space.outputs().join("latest")).expect("it is ours");
    space.write("outputs/latest", "in the way");
    let done = space.turbid(&["run", "p.yaml", "phantom"]);
    assert_eq!(done.err.lines().count(), 1, "{}", done.err);
    assert!(done.err.contains("were not renewed: ") && done.err.contains("log of this run could not be written"));
    assert!(!done.err.contains(".new-") && done.out.contains("results: outputs/store"), "{} {}", done.err, done.out);
    done.ok();
}
