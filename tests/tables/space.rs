//! A folder with a pipeline file, in which the program runs.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};

use serde_json::Value;

/// Cheap scenes: 6 x 6 pixels at 16 paths, groups of patients, a far split, a limit.
pub const PIPELINE: &str = "\
pipeline: drawn
seed: 7
vars: {n: 16}
stages:
  tissue:
    use: scene
    foreach:
      draw:
        n: \"${n}\"
        mu_a: {loguniform: [0.005, 0.2]}
        contrast: {lognormal: {median: 1.5, sigma: 0.4, within: [0.25, 6]}}
        shape: {choice: {spheroid: 3, none: 1}}
        patient: {group: 8}
        lesion_a: {product: [mu_a, contrast]}
        width: {uniform: [4, 8], per: patient}
        only: [[lesion_a, below, 0.25]]
    with:
      media:
        healthy: {mu_a: \"${mu_a}\", mu_s_prime: 1, g: 0.8, n: 1.0}
        lesion: {mu_a: \"${lesion_a}\", mu_s_prime: 1, g: 0.8, n: 1.0}
      objects:
        block: {slab: {thickness: 30, top: 0}, medium: healthy}
        ball: {when: {shape: spheroid}, spheroid: {diameters: [\"${width}\", \"${width}\", 4], center: [0, 0, -2.1]}, medium: lesion, priority: 1}
      camera: {position: [0, 0, 500], look_at: [0, 0, 0], field: [12, 12], pixels: [6, 6]}
      projector: {position: [0, 35, 500], look_at: [0, 0, 0], field: [48, 48], power: 5}
  frames: {use: render, in: {scene: tissue}, with: {f_x: [0, 0.1], samples: 16}}
  maps: {use: demodulate, in: {frames: frames}}
datasets:
  spots:
    about: Spheroids in tissue
    license: CC-BY-4.0
    sample:
      frames: {from: frames.frames, f_x: 0.1, phase: 0}
      ac: {from: maps.modulation.m_ac, f_x: 0.1}
      mu_a: frames.truth.mu_a
      mask: maps.mask
    splits: {train: 0.5, test: 0.5, by: patient}
    far: {test_far: [[lesion_a, above, 0.15]]}
    shards: {rows: 4}
";

/// The program of this package, which lies beside its tests once `cargo test` has built them.
fn program() -> PathBuf {
    let tests = std::env::current_exe().expect("a test is a file");
    let folder = tests.parent().and_then(Path::parent).expect("target/PROFILE/deps/TEST");
    let program = folder.join("examples/turbid_with_tables");
    assert!(
        program.is_file(),
        "{} is not built: run `cargo test -p turbid-tables-tests` without `--test`",
        program.display()
    );
    program
}

pub struct Space {
    folder: tempfile::TempDir,
}

/// A command that goes on.
pub struct Begun {
    child: Child,
}

impl Begun {
    /// Its last event.
    pub fn finished(self) -> Value {
        let ended = Ended { output: self.child.wait_with_output().expect("it was started") };
        serde_json::from_str(ended.ok().lines().last().expect("it says how it ended")).expect("events are JSON")
    }
}

/// How a command ended.
pub struct Ended {
    output: Output,
}

impl Space {
    pub fn with(pipeline: &str) -> Self {
        let space = Self { folder: tempfile::tempdir().expect("a temporary folder") };
        space.write("p.yaml", pipeline);
        space
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub fn write(&self, name: &str, bytes: impl AsRef<[u8]>) {
        fs::write(self.path(name), bytes).expect("the folder is ours");
    }

    pub fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(program());
        command.args(arguments).current_dir(self.folder.path()).env_remove("TURBID_OUTPUTS");
        command
    }

    pub fn turbid(&self, arguments: &[&str]) -> Ended {
        Ended { output: self.command(arguments).output().expect("the program starts") }
    }

    /// The same where no file may become longer than this (bytes, in blocks of 512).
    pub fn turbid_with_files_of_at_most(&self, bytes: u64, arguments: &[&str]) -> Ended {
        let mut command = Command::new("sh");
        // Ignored, the signal is an error of the write.
        let script = format!("trap '' XFSZ; ulimit -f {}; exec \"$0\" \"$@\"", bytes / 512);
        command.arg("-c").arg(script).arg(program()).args(arguments);
        command.current_dir(self.folder.path()).env_remove("TURBID_OUTPUTS");
        Ended { output: command.output().expect("the shell starts") }
    }

    pub fn start(&self, arguments: &[&str]) -> Child {
        let mut command = self.command(arguments);
        command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("the program starts")
    }

    /// A command that goes on beside others, with what it says.
    pub fn begin(&self, arguments: &[&str]) -> Begun {
        let mut command = self.command(arguments);
        Begun { child: command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().expect("the program starts") }
    }

    /// The same; what it prints goes to a file.
    pub fn start_to(&self, arguments: &[&str], log: &str) -> Child {
        let log = fs::File::create(self.path(log)).expect("the folder is ours");
        self.command(arguments).stdout(log).stderr(Stdio::null()).spawn().expect("the program starts")
    }

    /// Builds the data set of `p.yaml` in `to`: the last event.
    pub fn build(&self, to: &str, more: &[&str]) -> Value {
        let arguments = [&["dataset", "build", "p.yaml", "--to", to, "--json"], more].concat();
        let text = self.turbid(&arguments).ok();
        let last = text.lines().last().expect("a build says how it ended");
        let last: Value = serde_json::from_str(last).expect("events are JSON");
        assert_eq!(last["event"], "finished", "{text}");
        last
    }

    pub fn verify(&self, to: &str) -> Ended {
        self.turbid(&["dataset", "verify", "p.yaml", "--to", to])
    }

    pub fn manifest(&self, to: &str) -> Value {
        let text = fs::read_to_string(self.path(to).join("dataset.json")).expect("the build wrote it");
        serde_json::from_str(&text).expect("it is JSON")
    }

    /// Name, digest and rows of each shard.
    pub fn shards(&self, to: &str) -> Vec<(String, String, u64)> {
        let manifest = self.manifest(to);
        let shards = manifest["shards"].as_array().expect("a list").iter();
        let text = |value: &Value| value.as_str().expect("a text").to_owned();
        shards.map(|s| (text(&s["file"]), text(&s["sha256"]), s["rows"].as_u64().expect("a number"))).collect()
    }
}

impl Ended {
    fn said(&self) -> String {
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        text(&self.output.stdout) + &text(&self.output.stderr)
    }

    pub fn ok(&self) -> String {
        assert!(self.output.status.success(), "{}", self.said());
        String::from_utf8_lossy(&self.output.stdout).into_owned()
    }

    /// Everything that was said; it ended with this code.
    pub fn fails(&self, code: i32) -> String {
        assert_eq!(self.output.status.code(), Some(code), "{}", self.said());
        self.said()
    }
}
