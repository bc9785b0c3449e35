//! `turbid submit`, on engines that small scripts stand for: arrays of tasks that run on this machine, one after the other.

use std::fs;
use std::io::Read;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::space::{Done, Space, counts};

/// 66 points of three stages each (from 65 on no pictures are drawn), and a table of all.
pub const SWEEP: &str = "\
pipeline: sweep
seed: 7
vars: {samples: 64}
stages:
  tissue:
    use: scene
    foreach: {mu_a: {linspace: [0.01, 0.1, 66]}}
    with:
      media: {m: {mu_a: \"${mu_a}\", mu_s_prime: 1, g: 0.8, n: 1.0}}
      objects: {block: {slab: {thickness: 30, top: 0}, medium: m}}
      camera: {position: [0, 0, 500], look_at: [0, 0, 0], field: [12, 12], pixels: [4, 4]}
      projector: {position: [0, 35, 500], look_at: [0, 0, 0], field: [48, 48], power: 5}
  frames:
    use: render
    in: {scene: tissue}
    with: {f_x: [0, 0.1], phases: 3, samples: \"${samples}\", method: path}
  modulation:
    use: demodulate
    in: {frames: frames, covariance: frames.covariance}
    with: {method: phase_shift, low_signal: 0}
  table: {use: tabulate, in: {values: modulation}}
";
const ALL: u64 = 3 * 66 + 1;

const SCRIPTS: [(&str, &str); 7] = [
    ("tasks.sh", include_str!("submit/tasks.sh")),
    ("sbatch", include_str!("submit/sbatch")),
    ("squeue", include_str!("submit/squeue")),
    ("sacct", include_str!("submit/sacct")),
    ("scancel", include_str!("submit/scancel")),
    ("hq", include_str!("submit/hq")),
    ("python", include_str!("submit/python")),
];

/// A space with engines.
pub struct Cluster {
    pub space: Space,
    /// Whether `hq` is among the commands that are installed.
    hq: bool,
}

impl Cluster {
    pub fn with(text: &str) -> Self {
        let cluster = Self { space: Space::with(text), hq: true };
        for (name, script) in SCRIPTS {
            cluster.space.write(&format!("fake/bin/{name}"), script);
            use std::os::unix::fs::PermissionsExt;
            let path = cluster.fake().join("bin").join(name);
            fs::set_permissions(path, fs::Permissions::from_mode(0o755)).expect("the file is ours");
        }
        cluster
    }

    fn without_hq(mut self) -> Self {
        fs::remove_file(self.fake().join("bin/hq")).expect("it was written");
        self.hq = false;
        self
    }

    pub fn fake(&self) -> PathBuf {
        self.space.path().join("fake")
    }

    /// Tells the engines what to do.
    fn tell(&self, what: &str) {
        self.space.write(&format!("fake/{what}"), "");
    }

    fn untell(&self, what: &str) {
        fs::remove_file(self.fake().join(what)).expect("it was told");
    }

    pub fn command(&self, engine: &str, more: &[&str]) -> Command {
        let mut words = vec!["submit", "p.yaml", "--engine", engine];
        // Tasks of tests are short.
        words.extend(["--task-seconds", "0"].iter().filter(|_| !more.contains(&"--task-seconds")));
        words.extend(more);
        let mut command = self.space.command(&words);
        let path = std::env::var("PATH").expect("there is a PATH");
        command.env("PATH", format!("{}:{path}", self.fake().join("bin").display()));
        command.env("FAKE", self.fake()).env("TURBID_PYTHON", self.fake().join("bin/python"));
        command.env("HQ_SERVER_DIR", self.fake());
        command
    }

    pub fn submit(&self, engine: &str, more: &[&str]) -> Done {
        wait(self.begin(engine, more))
    }

    fn begin(&self, engine: &str, more: &[&str]) -> Child {
        self.command(engine, more).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("the program starts")
    }

    /// The folders of jobs.
    fn jobs(&self) -> Vec<PathBuf> {
        let entries = fs::read_dir(self.space.outputs().join("jobs")).into_iter().flatten().flatten();
        let mut folders: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
        folders.sort();
        folders
    }
}

const PATIENCE: Duration = Duration::from_secs(300);

/// Waits for a process; a hang ends it and the test.
fn wait(mut child: Child) -> Done {
    let read = |mut from: Box<dyn Read + Send>| {
        std::thread::spawn(move || {
            let mut text = Vec::new();
            from.read_to_end(&mut text).map(|_| text)
        })
    };
    let out = read(Box::new(child.stdout.take().expect("a pipe")));
    let err = read(Box::new(child.stderr.take().expect("a pipe")));
    let began = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait().expect("it was started") {
            break status;
        }
        if began.elapsed() > PATIENCE {
            child.kill().expect("it is ours");
            panic!("turbid submit did not end");
        }
        std::thread::sleep(Duration::from_millis(20));
    };
    let text =
        |thread: std::thread::JoinHandle<std::io::Result<Vec<u8>>>| thread.join().expect("it reads").expect("a pipe");
    let output = std::process::Output { status, stdout: text(out), stderr: text(err) };
    Done::from(output, &["submit"])
}

/// Waits until something is so.
fn until(what: &str, mut is_so: impl FnMut() -> bool) {
    let began = Instant::now();
    while !is_so() {
        assert!(began.elapsed() < PATIENCE, "{what}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// The digests of one process that runs everything.
fn reference() -> &'static str {
    static REFERENCE: OnceLock<String> = OnceLock::new();
    REFERENCE.get_or_init(|| {
        let space = Space::with(SWEEP);
        assert_eq!(counts(&space, &[]), (0, ALL));
        space.digests()
    })
}

fn events(done: Done) -> Vec<Value> {
    done.ok().lines().map(|line| serde_json::from_str(line).expect("an event")).collect()
}

fn of_kind<'a>(events: &'a [Value], kind: &str) -> Vec<&'a Value> {
    events.iter().filter(|event| event["event"] == kind).collect()
}

/// On each engine: the results of one process, every instance computed once, and nothing left to submit afterwards.
#[test]
fn an_array_of_shards_is_one_run() {
    for (engine, cluster) in
        [("slurm", Cluster::with(SWEEP)), ("hq", Cluster::with(SWEEP)), ("hq", Cluster::with(SWEEP).without_hq())]
    {
        let events = events(cluster.submit(engine, &["--shards", "5", "--follow", "--json"]));
        let submitted = of_kind(&events, "submitted");
        assert_eq!(submitted.len(), 1, "{engine}: {events:?}");
        assert_eq!(
            (&submitted[0]["of"], &submitted[0]["shards"]),
            (&Value::from(5), &Value::from(vec![1, 2, 3, 4, 5]))
        );
        let last = events.last().expect("there are events");
        // The shards made all but the table.
        assert_eq!((&last["event"], &last["hits"], &last["ran"]), (&"finished".into(), &(ALL - 1).into(), &1.into()));
        assert_eq!(cluster.space.digests(), reference(), "{engine}");
        assert_eq!(cluster.space.files("outputs/latest/sweep/table").len(), 2, "the table and its picture are there");
        let said = cluster.submit(engine, &[]).ok();
        assert!(said.contains("nothing to submit: 199 of 199 instances are up to date"), "{said}");
        assert_eq!(cluster.jobs().len(), 1);
    }
}

/// As many shards as have enough to do; those that have something to do alone.
#[test]
fn tasks_have_enough_to_do() {
    let of = |values: &str| SWEEP.replace("{linspace: [0.01, 0.1, 66]}", values);
    let cluster = Cluster::with(&of(&list(66, 0)));
    // By far less than a minute of work.
    let one = events(cluster.submit("slurm", &["--shards", "5", "--task-seconds", "60", "--follow", "--json"]));
    assert_eq!(of_kind(&one, "submitted")[0]["of"], 1);
    // Of some more points the last ones are new.
    cluster.space.write("p.yaml", &of(&list(66, 6)));
    let few = events(cluster.submit("slurm", &["--shards", "3", "--follow", "--json"]));
    let submitted = of_kind(&few, "submitted")[0];
    let (shards, of) = (submitted["shards"].as_array().expect("a list"), submitted["of"].as_u64().expect("a number"));
    assert!(shards.len() <= 3 && of > 3, "{submitted}");
}

/// A list of the first values of the sweep, and of others beyond.
fn list(first: usize, beyond: usize) -> String {
    let known = (0..first).map(|i| format!("{}", 0.01 + 0.09 * i as f64 / 65.0));
    let new = (0..beyond).map(|i| format!("{}", 0.2 + 0.01 * i as f64));
    format!("[{}]", known.chain(new).collect::<Vec<_>>().join(", "))
}

/// Tasks that are killed are submitted again, alone; what the others made is kept.
#[test]
fn killed_tasks_are_submitted_again() {
    for engine in ["slurm", "hq"] {
        let cluster = Cluster::with(SWEEP);
        cluster.tell("kill-2");
        cluster.tell("kill-4");
        let events = events(cluster.submit(engine, &["--shards", "5", "--follow", "--json"]));
        let submitted: Vec<&Value> = of_kind(&events, "submitted").iter().map(|event| &event["shards"]).collect();
        assert_eq!(submitted, [&Value::from(vec![1, 2, 3, 4, 5]), &Value::from(vec![2, 4])], "{engine}");
        assert_eq!(cluster.space.digests(), reference(), "{engine}");
    }
}

/// Of what cannot be done the shards, their instances and their logs are named; the rest is kept, and the next submission does it.
#[test]
fn what_is_missing_is_named() {
    let cluster = Cluster::with(SWEEP);
    cluster.tell("always-kill-3");
    let done = cluster.submit("slurm", &["--shards", "5", "--follow", "--retries", "1"]);
    let said = done.fails(1);
    assert!(said.contains("submitted again to Slurm: job 2, 1 task, shard 3 of 5"), "{said}");
    for words in ["not done: 2 tries", "shard 3 was ended (FAILED)", "/2/3.log", "missing: ", "tissue[mu_a=", "and 3"] {
        assert!(said.contains(words), "{words}: {said}");
    }
    cluster.untell("always-kill-3");
    cluster.submit("slurm", &["--shards", "5", "--follow"]).ok();
    assert_eq!(cluster.space.digests(), reference());
    let cluster = Cluster::with(SWEEP);
    cluster.tell("always-kill-3");
    let told = cluster.submit("hq", &["--shards", "5", "--follow", "--retries", "0", "--json"]);
    assert_eq!(told.code, Some(1), "{}", told.err);
    let last: Value = serde_json::from_str(told.out.lines().last().expect("a line")).expect("an event");
    assert_eq!((&last["event"], &last["shards"][0]["shard"]), (&"finished".into(), &3.into()), "{last}");
}

/// A job that is at work is taken up and not submitted twice, with or without Ctrl-C between.
#[test]
fn a_job_at_work_is_taken_up() {
    let cluster = Cluster::with(SWEEP);
    cluster.tell("hold");
    let said = cluster.submit("slurm", &["--shards", "3"]);
    assert_eq!(said.code, Some(0), "{}", said.err);
    for words in ["turbid submit p.yaml --engine slurm --follow", "scancel 1"] {
        assert!(said.out.contains(words), "{words}: {}", said.out);
    }
    assert!(said.err.contains("submitted to Slurm: job 1, 3 tasks; "), "{}", said.err);
    let again = cluster.submit("slurm", &["--shards", "4"]);
    assert!(again.code == Some(0) && again.err.contains("job 1 of Slurm"), "{}", again.err);
    assert!(again.err.contains("0 of 3 shards done, 3 waiting; its number of shards stays as it is"), "{}", again.err);
    let mut child = cluster.command("slurm", &["--follow"]).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
    let child = child.as_mut().expect("the program starts");
    // It listens once it has said how the job stands.
    let mut line = String::new();
    let mut err = std::io::BufReader::new(child.stderr.take().expect("a pipe"));
    while !line.contains("0 of 3 shards done, 3 waiting\n") {
        line.clear();
        std::io::BufRead::read_line(&mut err, &mut line).expect("a pipe");
    }
    let interrupt = Command::new("kill").args(["-INT", &child.id().to_string()]).status();
    assert!(interrupt.expect("kill is there").success());
    let mut rest = String::new();
    err.read_to_string(&mut rest).expect("a pipe");
    assert_eq!(child.wait().expect("it was started").code(), Some(130));
    assert!(rest.contains("the tasks go on"), "{rest}");
    let mut out = String::new();
    child.stdout.take().expect("a pipe").read_to_string(&mut out).expect("a pipe");
    assert!(out.contains("--follow") && out.contains("scancel 1"), "{out}");
    cluster.untell("hold");
    cluster.submit("slurm", &["--follow"]).ok();
    assert_eq!((cluster.space.digests().as_str(), cluster.jobs().len()), (reference(), 1));
}

/// A pipeline or a job that is edited meanwhile: its tasks do nothing, and the file is named.
#[test]
fn what_changed_since_is_named() {
    let cluster = Cluster::with(SWEEP);
    for (name, old, new, words) in [
        ("job.json", "\"shards\": 2", "\"shards\": 3", "it was edited"),
        ("p.yaml", "samples: 64", "samples: 65", "p.yaml changed since the job was submitted"),
    ] {
        cluster.tell("hold");
        let before = cluster.jobs();
        let child = cluster.begin("slurm", &["--shards", "2", "--follow"]);
        let submitted = || {
            let is_new = |job: &PathBuf| job.join("submissions.jsonl").exists() && !before.contains(job);
            cluster.jobs().into_iter().find(is_new)
        };
        until("a job is submitted", || submitted().is_some());
        let folder = submitted().expect("it is there");
        let path = if name == "p.yaml" { cluster.space.path().join(name) } else { folder.join(name) };
        let text = fs::read_to_string(&path).expect("it is there");
        assert!(text.contains(old), "{text}");
        fs::write(&path, text.replace(old, new)).expect("it is ours");
        cluster.untell("hold");
        let said = wait(child).fails(1);
        assert!(said.contains("not done: ") && said.contains("1.log"), "{said}");
        let log = fs::read_to_string(folder.join("1/1.log")).expect("a log");
        assert!(log.contains(words), "{name}: {log}");
        assert!(folder.join("1/1.exit-2").exists(), "{name}");
        fs::write(&path, text).expect("it is ours");
    }
    // What was edited back is what it was.
    cluster.submit("slurm", &["--shards", "2", "--follow"]).ok();
    assert_eq!(cluster.space.digests(), reference());
}

/// A job on other values of the same file goes on beside, and is named.
#[test]
fn other_jobs_of_the_file_are_named() {
    let cluster = Cluster::with(SWEEP);
    cluster.tell("hold");
    cluster.submit("slurm", &["--shards", "2", "--set", "vars.samples=65"]).ok();
    let other = cluster.submit("slurm", &["--shards", "2"]);
    let said = &other.err;
    for words in ["job 1 of Slurm", "its --set: vars.samples=65, here: none", "scancel 1", "submitted to Slurm: job 2"]
    {
        assert!(said.contains(words), "{words}: {said}");
    }
    // All tasks end by themselves once there is such a file.
    for folder in cluster.jobs() {
        fs::write(folder.join("stop"), "").expect("the folder is ours");
    }
    cluster.untell("hold");
    let last = cluster.jobs().pop().expect("there are two");
    until("tasks stop", || last.join("1/1.exit-130").exists() && last.join("1/2.exit-130").exists());
}

/// Engines that are not there, do not answer, or say no: in words, with the way out and the right exit code.
#[test]
fn what_keeps_engines_from_it_is_named() {
    let cluster = Cluster::with(SWEEP).without_hq();
    let fails = |engine: &str, more: &[&str], code: i32, words: &[&str]| {
        let said = cluster.submit(engine, more).fails(code);
        for words in words {
            assert!(said.contains(words), "{engine} {more:?}: {words}: {said}");
        }
        assert_eq!(cluster.jobs(), Vec::<PathBuf>::new(), "nothing was submitted");
    };
    fails("slurm", &["--engine-args=--partition=none"], 2, &["invalid partition specified: none", "sinfo"]);
    fails("slurm", &["--engine-args='--partition"], 2, &["--engine-args", "not closed"]);
    fails("hq", &["--engine-args=--priority=3"], 2, &["`hq` is not on PATH"]);
    fails("slurm", &["--shards", "0"], 2, &["--shards"]);
    fails("pbs", &[], 2, &["hq, slurm"]);
    cluster.tell("silent");
    fails("slurm", &[], 1, &["Slurm does not answer", "Unable to contact slurm controller", "scontrol ping"]);
    fails("hq", &[], 1, &["HQ server is unreachable", "HQ_SERVER_DIR"]);
    cluster.tell("absent");
    fails("hq", &[], 2, &["No module named 'hyperqueue'", "pip install hyperqueue"]);
    for name in ["sbatch", "python"] {
        fs::remove_file(cluster.fake().join("bin").join(name)).expect("it was written");
    }
    fails("hq", &[], 2, &["is not on PATH", "pip install hyperqueue"]);
    let mut alone = cluster.command("slurm", &[]);
    alone.env("PATH", cluster.fake().join("bin"));
    let said = Done::from(alone.output().expect("it starts"), &["submit"]).fails(2);
    assert!(said.contains("`sbatch` is not on PATH") && said.contains("login node"), "{said}");
}

/// An engine that falls silent or forgets its job: what tasks leave in the folder of the job is enough.
#[test]
fn a_silent_engine_costs_nothing() {
    let cluster = Cluster::with(SWEEP);
    cluster.tell("hold");
    cluster.submit("slurm", &["--shards", "3"]).ok();
    cluster.tell("silent");
    cluster.untell("hold");
    // It may be at work or not: nobody answers. Its tasks end.
    let folder = cluster.jobs().pop().expect("a job");
    until("tasks end", || (1..=3).all(|shard| folder.join(format!("1/{shard}.exit-0")).exists()));
    let done = cluster.submit("slurm", &["--follow"]);
    done.ok();
    assert_eq!(cluster.space.digests(), reference());
    // What vanished without a trace is given up after the patience.
    let cluster = Cluster::with(SWEEP);
    cluster.tell("always-kill-1");
    cluster.tell("forget");
    let said = cluster.submit("slurm", &["--shards", "2", "--follow", "--retries", "0"]).fails(1);
    assert!(said.contains("shard 1 vanished"), "{said}");
    cluster.untell("forget");
    let child = cluster.begin("slurm", &["--shards", "2", "--follow", "--patience", "0"]);
    until("it is submitted", || cluster.jobs().len() == 2);
    cluster.tell("silent");
    let said = wait(child).fails(1);
    assert!(said.contains("Slurm does not answer"), "{said}");
}
