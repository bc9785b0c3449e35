//! A temporary folder with a pipeline, and the program run in it.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};

use serde_json::Value;

/// A small but whole pipeline: two scenes, renders, demodulation, calibration. So few paths leave no signal above the noise: it is
/// not to be masked, or every change would end in the same zeros.
pub const SMALL: &str = "\
pipeline: small
seed: 7
vars: {samples: 16}
stages:
  tissue:
    use: scene
    with:
      media: {m: {A_rho: 50, S_rho: 5000, g: 0.8, n: 1.0}}
      objects: {block: {slab: {thickness: 30, top: 0}, medium: m}}
      camera: &camera {position: [0, 0, 500], look_at: [0, 0, 0], field: [12, 12], pixels: [12, 12]}
      projector: &projector {position: [0, 35, 500], look_at: [0, 0, 0], field: [48, 48], power: 5}
  phantom:
    use: scene
    with:
      media: {m: &reference {mu_a: 0.05, mu_s_prime: 1.2, g: 0.8, n: 1.0}}
      objects: {block: {slab: {thickness: 30, top: 0}, medium: m}}
      camera: *camera
      projector: *projector
  frames:
    use: render
    in: {scene: tissue}
    with: {f_x: [0, 0.1], phases: 3, samples: \"${samples}\"}
  phantom_frames:
    use: render
    in: {scene: phantom}
    with: {f_x: [0, 0.1], phases: 3, samples: \"${samples}\"}
  modulation:
    use: demodulate
    in: {frames: frames, covariance: frames.covariance}
    with: {method: phase_shift, low_signal: 0}
  phantom_modulation:
    use: demodulate
    in: {frames: phantom_frames, covariance: phantom_frames.covariance}
    with: {method: phase_shift, low_signal: 0}
  reflectance:
    use: calibrate
    in: {sample: modulation, reference: phantom_modulation}
    with: {reference: *reference, model: diffusion, convention: camera}
";

pub struct Space {
    folder: tempfile::TempDir,
}

impl Space {
    pub fn new() -> Self {
        Self { folder: tempfile::tempdir().expect("a temporary folder") }
    }

    /// A space with `text` in `p.yaml`.
    pub fn with(text: &str) -> Self {
        let space = Self::new();
        space.write("p.yaml", text);
        space
    }

    /// A space with everything that `other` holds.
    pub fn copy_of(other: &Self) -> Self {
        let space = Self::new();
        let done = Command::new("cp").arg("-a").arg(format!("{}/.", other.path().display())).arg(space.path()).status();
        assert!(done.expect("cp is there").success());
        space
    }

    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    pub fn outputs(&self) -> PathBuf {
        self.path().join("outputs")
    }

    pub fn write(&self, name: &str, text: &str) {
        let path = self.path().join(name);
        std::fs::create_dir_all(path.parent().expect("names are relative")).expect("the folder is ours");
        std::fs::write(path, text).expect("the folder is ours");
    }

    pub fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_turbid"));
        command.args(arguments).current_dir(self.path()).env_remove("TURBID_OUTPUTS").stdin(Stdio::null());
        command
    }

    pub fn turbid(&self, arguments: &[&str]) -> Done {
        Done::from(self.command(arguments).output().expect("the program starts"), arguments)
    }

    pub fn start(&self, arguments: &[&str]) -> Child {
        self.command(arguments).stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("the program starts")
    }

    /// Sorted digests of all blobs in the store.
    pub fn digests(&self) -> String {
        self.turbid(&["cache", "digests"]).ok()
    }

    /// All files below a folder of the space that hold something, sorted.
    pub fn files(&self, below: &str) -> Vec<PathBuf> {
        let mut found = Vec::new();
        let mut open = vec![self.path().join(below)];
        while let Some(folder) = open.pop() {
            for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
                let kind = entry.file_type().expect("the entry was listed");
                if kind.is_dir() {
                    open.push(entry.path());
                } else if kind.is_file() && entry.metadata().is_ok_and(|m| m.len() > 0) {
                    found.push(entry.path());
                }
            }
        }
        found.sort();
        found
    }
}

/// What a run of the program left.
pub struct Done {
    pub code: Option<i32>,
    pub out: String,
    pub err: String,
    arguments: String,
}

impl Done {
    pub fn from(output: Output, arguments: &[&str]) -> Self {
        Self {
            code: output.status.code(),
            out: String::from_utf8_lossy(&output.stdout).into_owned(),
            err: String::from_utf8_lossy(&output.stderr).into_owned(),
            arguments: arguments.join(" "),
        }
    }

    /// Stdout of a run that must have gone well.
    #[track_caller]
    pub fn ok(self) -> String {
        assert_eq!(self.code, Some(0), "turbid {}\n{}\n{}", self.arguments, self.out, self.err);
        self.out
    }

    /// Stderr of a run that must have ended with `code`, and without a panic.
    #[track_caller]
    pub fn fails(self, code: i32) -> String {
        assert_eq!(self.code, Some(code), "turbid {}\n{}\n{}", self.arguments, self.out, self.err);
        assert!(!self.err.contains("panicked") && !self.err.contains("internal error"), "{}", self.err);
        self.err
    }

    /// The last line of stdout as JSON.
    #[track_caller]
    pub fn json(self) -> Value {
        let arguments = self.arguments.clone();
        let out = self.ok();
        let last = out.lines().last().unwrap_or_default();
        serde_json::from_str(last).unwrap_or_else(|e| panic!("turbid {arguments}: {e}\n{out}"))
    }
}

/// (hits, ran) of `run --json`.
#[track_caller]
pub fn counts(space: &Space, more: &[&str]) -> (u64, u64) {
    let mut arguments = vec!["run", "p.yaml", "--json"];
    arguments.extend(more);
    let last = space.turbid(&arguments).json();
    assert_eq!(last["event"], "finished");
    (last["hits"].as_u64().expect("a count"), last["ran"].as_u64().expect("a count"))
}

/// State of each stage in `plan --json`.
#[track_caller]
pub fn states(space: &Space, more: &[&str]) -> Vec<(String, String)> {
    let mut arguments = vec!["plan", "p.yaml", "--json"];
    arguments.extend(more);
    let plan = space.turbid(&arguments).json();
    let text = |v: &Value| v.as_str().expect("text").to_owned();
    plan["instances"].as_array().expect("a list").iter().map(|i| (text(&i["stage"]), text(&i["state"]))).collect()
}
