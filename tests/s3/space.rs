//! A folder with a pipeline file, in which the program runs with a service behind its store.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};

use serde_json::Value;

use crate::service::{BUCKET, Service};

/// A sweep of three cheap renders with large outputs, and scenes, demodulation and a gathered table with small ones.
pub const PIPELINE: &str = "\
pipeline: swept
seed: 7
stages:
  tissue:
    use: scene
    foreach: {mu_a: [0.02, 0.05, 0.1]}
    with:
      media: {m: {mu_a: \"${mu_a}\", mu_s_prime: 1, g: 0.8, n: 1.0}}
      objects: {block: {slab: {thickness: 30, top: 0}, medium: m}}
      camera: {position: [0, 0, 500], look_at: [0, 0, 0], field: [12, 12], pixels: [48, 48]}
      projector: {position: [0, 35, 500], look_at: [0, 0, 0], field: [48, 48], power: 5}
  frames: {use: render, in: {scene: tissue}, with: {f_x: [0, 0.1], samples: 16}}
  maps: {use: demodulate, in: {frames: frames}, with: {low_signal: 0}}
";

pub const KEY_ID: &str = "AKIAHIDDENHIDDENHIDD";
pub const SECRET: &str = "hiddenSecretKeyThatNobodyMaySee/0123456789";
pub const TOKEN: &str = "hiddenSessionTokenThatNobodyMaySee==";

/// The program of this package, which lies beside its tests once `cargo test` has built them.
fn program() -> PathBuf {
    let tests = std::env::current_exe().expect("a test is a file");
    let folder = tests.parent().and_then(Path::parent).expect("target/PROFILE/deps/TEST");
    let program = folder.join("examples/turbid_with_s3");
    let shown = program.display();
    assert!(program.is_file(), "{shown} is not built: run `cargo test -p turbid-s3-tests` without `--test`");
    program
}

pub struct Space {
    folder: tempfile::TempDir,
    endpoint: String,
}

/// How a command ended.
pub struct Ended(Output);

impl Space {
    pub fn with(pipeline: &str, service: &Service) -> Self {
        let space = Self { folder: tempfile::tempdir().expect("a temporary folder"), endpoint: service.endpoint() };
        fs::write(space.path("p.yaml"), pipeline).expect("the folder is ours");
        space
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// The program without anything of this machine's settings.
    pub fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(program());
        command.args(arguments).current_dir(self.folder.path()).stdin(Stdio::null()).env_clear();
        command.env("PATH", std::env::var_os("PATH").unwrap_or_default());
        command.env("HOME", self.folder.path()).env("AWS_ENDPOINT_URL_S3", &self.endpoint);
        command.env("AWS_ACCESS_KEY_ID", KEY_ID).env("AWS_SECRET_ACCESS_KEY", SECRET).env("AWS_SESSION_TOKEN", TOKEN);
        command
    }

    pub fn turbid(&self, arguments: &[&str]) -> Ended {
        Ended(self.command(arguments).output().expect("the program starts"))
    }

    /// The same with the store behind it.
    pub fn with_store(&self, arguments: &[&str]) -> Ended {
        let store = store();
        self.turbid(&[arguments, &["--store", &store]].concat())
    }

    pub fn start(&self, arguments: &[&str]) -> Child {
        let store = store();
        let mut command = self.command(&[arguments, &["--store", &store]].concat());
        command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("the program starts")
    }

    pub fn digests(&self) -> String {
        self.turbid(&["cache", "digests"]).ok()
    }

    /// Numbers of instances of `p.yaml` that are up to date, and that are not.
    pub fn planned(&self) -> (usize, usize) {
        let plan = self.turbid(&["plan", "p.yaml", "--json"]).json();
        let states = plan["instances"].as_array().expect("a list").iter().map(|i| i["state"] == "hit");
        let (hits, others): (Vec<bool>, Vec<bool>) = states.partition(|hit| *hit);
        (hits.len(), others.len())
    }

    /// The texts of all files below a folder.
    pub fn texts(&self, below: &str) -> Vec<(PathBuf, Vec<u8>)> {
        let (mut found, mut open) = (Vec::new(), vec![self.path(below)]);
        while let Some(folder) = open.pop() {
            for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
                match fs::metadata(entry.path()) {
                    Ok(meta) if meta.is_dir() => open.push(entry.path()),
                    Ok(meta) if meta.is_file() => {
                        found.push((entry.path(), fs::read(entry.path()).expect("it is ours")))
                    }
                    _ => {}
                }
            }
        }
        found
    }
}

/// The address of the store in the service.
pub fn store() -> String {
    format!("s3://{BUCKET}/some/where")
}

impl Ended {
    pub fn out(&self) -> String {
        String::from_utf8_lossy(&self.0.stdout).into_owned()
    }

    pub fn err(&self) -> String {
        String::from_utf8_lossy(&self.0.stderr).into_owned()
    }

    #[track_caller]
    pub fn ok(self) -> String {
        assert_eq!(self.0.status.code(), Some(0), "{}\n{}", self.out(), self.err());
        self.out()
    }

    /// Stderr of a command that must have failed in this way.
    #[track_caller]
    pub fn fails(self, code: i32) -> String {
        assert_eq!(self.0.status.code(), Some(code), "{}\n{}", self.out(), self.err());
        self.err()
    }

    /// The last line, as JSON.
    #[track_caller]
    pub fn json(self) -> Value {
        serde_json::from_str(self.ok().lines().last().expect("it says something")).expect("it is JSON")
    }
}
