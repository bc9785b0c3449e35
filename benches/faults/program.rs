//! The program, run as a user runs it, with a limit on time.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

use super::tracer::{Ended, Follow, Logged, MOST_WALL, follow};
use super::{calls::Call, tracer::Action};

/// A place for one case: `work` is where the program works, beside it is what it says.
pub struct Place {
    pub folder: PathBuf,
}

/// What a run of the program left.
#[derive(Debug)]
pub struct Done {
    pub code: Option<i32>,
    pub hung: bool,
    pub out: String,
    pub err: String,
}

impl Place {
    /// Makes the folder.
    pub fn new(folder: PathBuf) -> io::Result<Self> {
        fs::create_dir_all(folder.join("work"))?;
        Ok(Self { folder: folder.canonicalize()? })
    }

    pub fn work(&self) -> PathBuf {
        self.folder.join("work")
    }

    pub fn outputs(&self) -> PathBuf {
        self.work().join("outputs")
    }

    /// The program with its output going to files of this name.
    fn command(&self, program: &Path, arguments: &[&str], name: &str) -> io::Result<Command> {
        let mut command = Command::new(program);
        command.args(arguments).current_dir(self.work()).env_remove("TURBID_OUTPUTS").env("NO_COLOR", "1");
        command.stdin(Stdio::null());
        command.stdout(File::create(self.folder.join(format!("{name}.out")))?);
        command.stderr(File::create(self.folder.join(format!("{name}.err")))?);
        Ok(command)
    }

    fn said(&self, name: &str) -> (String, String) {
        let read = |end: &str| fs::read(self.folder.join(format!("{name}.{end}"))).unwrap_or_default();
        let text = |bytes: Vec<u8>| String::from_utf8_lossy(&bytes).into_owned();
        (text(read("out")), text(read("err")))
    }

    /// Runs it undisturbed.
    pub fn run(&self, program: &Path, arguments: &[&str], name: &str) -> io::Result<Done> {
        let mut child = self.command(program, arguments, name)?.spawn()?;
        let (began, mut wait) = (Instant::now(), Duration::from_micros(500));
        let status = loop {
            if let Some(status) = child.try_wait()? {
                break Some(status);
            }
            if began.elapsed() > MOST_WALL {
                child.kill()?;
                child.wait()?;
                break None;
            }
            std::thread::sleep(wait);
            wait = (wait * 2).min(Duration::from_millis(10));
        };
        let (out, err) = self.said(name);
        let code = status.and_then(|s| s.code());
        Ok(Done { code, hung: status.is_none(), out, err })
    }

    /// Runs it while `decide` decides about each call that changes or reads a file below `work`; how many of each there were, with `log` those that
    /// change.
    pub fn run_broken(
        &self,
        program: &Path,
        arguments: &[&str],
        log: bool,
        decide: &mut dyn FnMut(u64, &Call) -> Action,
    ) -> io::Result<(Done, [u64; 2], Vec<Logged>)> {
        let command = self.command(program, arguments, "broken")?;
        let (folder, said) = (self.work(), self.folder.join("broken.out"));
        let ended = follow(command, Follow { folder: &folder, said: &said, log, decide })?;
        let Ended { code, hung, calls, reads, log, .. } = ended;
        let (out, err) = self.said("broken");
        Ok((Done { code, hung, out, err }, [calls, reads], log))
    }
}

impl Done {
    pub fn text(&self) -> String {
        format!("{}{}", self.out, self.err)
    }

    /// The last lines that it said.
    pub fn last_words(&self) -> String {
        let text = self.text();
        let lines: Vec<&str> = text.lines().filter(|l| !l.trim().is_empty()).collect();
        let how = match self.code {
            _ if self.hung => "hung".to_owned(),
            Some(code) => format!("exit {code}"),
            None => "killed".to_owned(),
        };
        let said: String = lines[lines.len().saturating_sub(2)..].join(" / ");
        format!("{how}: {}", said.chars().take(300).collect::<String>())
    }

    /// Labels of the instances with this event.
    pub fn instances(&self, event: &str) -> Vec<String> {
        instances(&self.out, event)
    }

    /// It died of a fault of its own.
    pub fn broke(&self) -> Option<String> {
        let text = self.text();
        if self.hung {
            return Some("it hung".to_owned());
        }
        let panicked = ["internal error", "panicked at"].iter().any(|sign| text.contains(sign));
        panicked.then(|| format!("it panicked: {}", self.last_words()))
    }
}

/// Labels of the instances with this event in JSON lines; a line that was cut short says nothing.
pub fn instances(lines: &str, event: &str) -> Vec<String> {
    let parsed = lines.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok());
    let these = parsed.filter(|value| value["event"] == event);
    these.filter_map(|value| Some(value["instance"].as_str()?.to_owned())).collect()
}
