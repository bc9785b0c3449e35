//! Parts of a plan, and processes that share work: together they are one run, whatever happens to them.

use std::collections::HashMap;
use std::fs;
use std::process::{Child, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::space::{Done, SMALL, Space, counts};

/// Eight points of tissue, two renders of each, what they have in common, and a table of all. The phantom is for all.
fn swept() -> String {
    let tissue = "  tissue:\n    use: scene\n    foreach: {A_rho: {linspace: [20, 90, 8]}}\n";
    let frames = "  frames:\n    use: render\n    foreach: {samples: [16, 24]}\n";
    SMALL
        .replace("pipeline: small", "pipeline: swept")
        .replace("vars: {samples: 16}\n", "vars: {samples: 16, n: 1.0}\n")
        .replace("  tissue:\n    use: scene\n", tissue)
        .replace("A_rho: 50,", "A_rho: \"${A_rho}\",")
        .replace("  frames:\n    use: render\n", frames)
        + "  levels: {use: tabulate, in: {values: {from: frames, over: [samples]}}}
  table: {use: tabulate, in: {values: reflectance}}
"
}

/// Those of `swept`: scenes, frames, modulations and reflectances, levels; the phantom's three; the table, which gathers all.
const ALL: u64 = 8 + 3 * 16 + 8 + 3 + GATHERED;
const GATHERED: u64 = 1;

/// The digests of one process that has run everything.
fn reference() -> &'static str {
    static DIGESTS: OnceLock<String> = OnceLock::new();
    DIGESTS.get_or_init(|| {
        let space = Space::with(&swept());
        assert_eq!(counts(&space, &[]), (0, ALL));
        space.digests()
    })
}

/// The last line of `run --json`.
fn finished(done: Done) -> Value {
    let last = done.json();
    assert_eq!(last["event"], "finished");
    last
}

fn ran(last: &Value) -> u64 {
    last["ran"].as_u64().expect("a count")
}

/// Starts a command that prints JSON, to be waited for.
fn begin(space: &Space, arguments: &[&str]) -> Child {
    let mut command = space.command(arguments);
    command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("the program starts")
}

/// Waits for processes; a hang ends them and the test.
fn wait(children: Vec<Child>) -> Vec<Done> {
    // Their output is small: no pipe fills up before it is read.
    let began = Instant::now();
    let mut children = children;
    while children.iter_mut().any(|child| child.try_wait().expect("it was started").is_none()) {
        if began.elapsed() > Duration::from_secs(300) {
            children.iter_mut().for_each(|child| drop(child.kill()));
            panic!("a process hangs");
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    children.into_iter().map(|child| Done::from(child.wait_with_output().expect("it has ended"), &["a run"])).collect()
}

/// How often each key was computed, as the logs of all runs say.
fn computed(space: &Space) -> HashMap<String, usize> {
    let mut times = HashMap::new();
    for path in space.files("outputs/runs").into_iter().filter(|path| path.ends_with("events.jsonl")) {
        // The last line of a killed run may be cut.
        let text = fs::read_to_string(path).expect("it is there");
        for event in text.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok()) {
            if event["event"] == "ran" {
                *times.entry(event["key"].as_str().expect("a digest").to_owned()).or_default() += 1;
            }
        }
    }
    times
}

/// The run that follows the shards: it makes what gathers, and nothing else; then all is as one process would have made it.
fn end_of_shards(space: &Space, reference: &str) {
    assert!(!space.outputs().join("latest").exists(), "shards fill no folder for people");
    assert_eq!(counts(space, &[]), (ALL - GATHERED, GATHERED));
    assert!(space.outputs().join("latest/swept/reflectance").is_dir());
    assert_eq!(space.digests(), reference);
    space.turbid(&["cache", "verify"]).ok();
    assert!(computed(space).values().all(|times| *times == 1), "{:?}", computed(space));
}

/// Shards one after the other, and side by side: each instance is computed once, and the last run computes the gathers.
#[test]
fn shards_and_a_last_run_are_one_run() {
    let reference = reference();
    let space = Space::with(&swept());
    let mut made = 0;
    for k in 1..=8 {
        let last = finished(space.turbid(&["run", "p.yaml", "--json", "--shard", &format!("{k}/8")]));
        assert_eq!((&last["shard"]["shard"], &last["shard"]["of"]), (&k.into(), &8.into()));
        assert_eq!(last["left"], GATHERED);
        made += ran(&last);
        let store = space.outputs().join("store");
        assert!(!store.join("index").exists() && !store.join("memos").exists(), "no files that all share");
        assert_eq!(fs::read_dir(store.join("packs")).expect("it is there").count(), k, "a pack for each");
    }
    assert_eq!(made, ALL - GATHERED);
    end_of_shards(&space, reference);

    let space = Space::with(&swept());
    let shard = |k: usize| begin(&space, &["run", "p.yaml", "--json", "-j", "1", "--shard", &format!("{k}/8")]);
    let made: u64 = wait((1..=8).map(shard).collect()).into_iter().map(|done| ran(&finished(done))).sum();
    assert_eq!(made, ALL - GATHERED);
    end_of_shards(&space, reference);
}

/// The same command twice at a time: the processes share the work, and nothing is computed twice.
#[test]
fn processes_with_one_command_share_the_work() {
    let reference = reference();
    let space = Space::with(&swept());
    let two = (0..2).map(|_| begin(&space, &["run", "p.yaml", "--json", "-j", "1"])).collect();
    let counts: Vec<(u64, u64)> =
        wait(two).into_iter().map(finished).map(|last| (ran(&last), last["hits"].as_u64().expect("a count"))).collect();
    assert_eq!(counts.iter().map(|(ran, _)| ran).sum::<u64>(), ALL, "{counts:?}");
    assert!(counts.iter().all(|(ran, hits)| ran + hits == ALL), "{counts:?}");
    assert_eq!(space.digests(), reference);
    assert!(computed(&space).values().all(|times| *times == 1));
}

/// Shards are killed at random moments (`TURBID_KILLS` of them) and begun again: what was published is not computed again.
#[test]
fn killed_shards_lose_nothing() {
    let reference = reference();
    let kills = std::env::var("TURBID_KILLS").ok().and_then(|text| text.parse().ok()).unwrap_or(10);
    let space = Space::with(&swept());
    let shard = |k: usize| begin(&space, &["run", "p.yaml", "--json", "-j", "1", "--shard", &format!("{k}/4")]);
    let mut running: Vec<Child> = (1..=4).map(shard).collect();
    for kill in 0..kills {
        // Spread over the time that a run takes, in no order.
        std::thread::sleep(Duration::from_millis(20 + kill * 7919 % 400));
        let k = (kill * 5 % 4) as usize;
        // It may have ended already.
        let _ = running[k].kill();
        running[k].wait().expect("it was started");
        running[k] = shard(k + 1);
    }
    wait(running).into_iter().for_each(|done| drop(finished(done)));
    end_of_shards(&space, reference);
}

/// Every instance of a plan is in a shard's plan or left, and a shard runs what its plan says.
#[test]
fn plans_of_shards_are_what_they_run() {
    let space = Space::with(&swept());
    let labels = |more: &[&str]| -> Vec<String> {
        let plan = space.turbid(&[&["plan", "p.yaml", "--json"], more].concat()).json();
        let of = |i: &Value| format!("{}{}", i["stage"], i["axes"]);
        plan["instances"].as_array().expect("a list").iter().map(of).collect()
    };
    let all = labels(&[]);
    assert_eq!(all.len() as u64, ALL);
    let shards: Vec<Vec<String>> = (1..=3).map(|k| labels(&["--shard", &format!("{k}/3")])).collect();
    let left: Vec<&String> = all.iter().filter(|label| shards.iter().all(|shard| !shard.contains(label))).collect();
    assert_eq!(left, ["\"table\"{}"]);
    let twice = all.iter().filter(|label| shards.iter().filter(|shard| shard.contains(label)).count() > 1);
    assert!(twice.clone().all(|label| label.contains("phantom")) && twice.count() == 3);
    let last = finished(space.turbid(&["run", "p.yaml", "--json", "--shard", "2/3"]));
    assert_eq!(ran(&last), shards[1].len() as u64);
    // More shards than points: the others have nothing to do.
    let empty = (1..=40).filter(|k| labels(&["--shard", &format!("{k}/40")]).is_empty());
    let empty: Vec<usize> = empty.take(1).collect();
    let last = finished(space.turbid(&["run", "p.yaml", "--json", "--shard", &format!("{}/40", empty[0])]));
    assert_eq!((ran(&last), &last["hits"]), (0, &0.into()));
    let text = space.turbid(&["run", "p.yaml", "--shard", "1/3", "--set", "vars.n=1.0"]).ok();
    assert!(text.contains("when all shards have run: turbid run p.yaml --set vars.n=1.0"), "{text}");
}

/// What is selected, and what feeds it; nothing for people.
#[test]
fn only_what_is_selected_runs() {
    let space = Space::with(&swept());
    let run = |more: &[&str]| finished(space.turbid(&[&["run", "p.yaml", "--json"], more].concat()));
    assert_eq!(ran(&run(&["--only", "frames[A_rho=20]"])), 3);
    let two = run(&["--only", "frames[A_rho=20,samples=16]", "--only", "levels[A_rho=90]"]);
    assert_eq!((ran(&two), &two["hits"]), (4, &2.into()));
    assert!(!space.outputs().join("latest").exists());
    assert_eq!(ran(&run(&["--only", "frames", "--shard", "1/2"])), 3 * 4 - 3);
    // All that the table needs but the scenes (5) and renders (10) that are there; no levels.
    assert_eq!(ran(&run(&["--only", "table"])), ALL - 8 - 5 - 10);
}

/// What is wrong with a part is named, with a way out.
#[test]
fn wrong_parts_are_refused() {
    let studies = "studies:\n  accuracy:\n    vary: {vars.samples: [16, 32]}\n    estimate: reflectance.r_d\n    error: rmse\n    repeats: 2\n";
    let space = Space::with(&(swept() + studies));
    let wrong = |more: &[&str]| space.turbid(&[&["run", "p.yaml"], more].concat()).fails(2);
    let cases: [(&[&str], &str); 10] = [
        (&["--shard", "0/8"], "write 1/8 to 8/8"),
        (&["--shard", "9/8"], "write 1/8 to 8/8"),
        (&["--shard", "a/b"], "for example 3/8"),
        (&["--shard", "1/0"], "leave --shard out"),
        (&["--only", "frame"], "there is no stage `frame`"),
        (&["--only", "frames[A_rho=1]"], "there are frames[A_rho=20"),
        (&["--only", "frames[A_rho"], "must look like"),
        (&["--only", "frames.frames"], "without `.frames`"),
        (&["frames", "--only", "levels"], "name it as a target too"),
        (&["accuracy", "--only", "frames"], "accuracy is no stage"),
    ];
    for (more, says) in cases {
        let text = wrong(more);
        assert!(text.contains(says), "{more:?}: {text}");
    }
    space.turbid(&["run", "p.yaml", "--json", "--shard", "1/8", "--force", "frames"]).ok();
}
