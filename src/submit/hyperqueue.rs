//! HyperQueue: by its command `hq` where that is on PATH, or else by its Python package, through a small program that stands beside the job.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::{Value, json};

use crate::input_file;

use super::engine::{Array, Engine, Look, Task, Ticket, Trouble, ranges, said_by};
use super::program::{self, Said};

/// The program between turbid and the Python package.
const DRIVER: &str = include_str!("hyperqueue.py");
const NO_SERVER: &str = "start a server (`hq server start`), or name the folder of the one that runs in HQ_SERVER_DIR";
const NO_PACKAGE: &str = "put `hq` on PATH, or install the Python package (`pip install hyperqueue`) for the `python3` on PATH, or for the one that TURBID_PYTHON names";
/// Bytes of the file by which clients find their server.
const MOST: u64 = 1 << 16;

/// The server whose folder HQ_SERVER_DIR names, or else the usual one.
pub struct HyperQueue {
    by: By,
    /// What HQ_SERVER_DIR says.
    folder: Option<PathBuf>,
}

enum By {
    Hq,
    Python(String),
}

impl HyperQueue {
    pub fn found() -> Self {
        let variable = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty());
        let python = variable("TURBID_PYTHON").map(|path| path.to_string_lossy().into_owned());
        let by = if on_path("hq") { By::Hq } else { By::Python(python.unwrap_or_else(|| "python3".to_owned())) };
        Self { by, folder: variable("HQ_SERVER_DIR").map(PathBuf::from) }
    }

    /// Which server answers in this folder, by the file that it writes there; `None` where that cannot be read.
    fn server(folder: &Path) -> Option<String> {
        let access = input_file::read(&folder.join("hq-current").join("access.json"), MOST).ok()?;
        let access: Value = serde_json::from_slice(&access).ok()?;
        Some(access["server_uid"].as_str()?.to_owned())
    }

    /// The folder of a server that is named nowhere.
    fn folder(&self) -> Option<PathBuf> {
        self.folder.clone().or_else(|| Some(std::env::home_dir()?.join(".hq-server")))
    }

    fn hq(&self, folder: Option<&str>, arguments: &[String]) -> Result<Said, Trouble> {
        let mut command = Command::new("hq");
        command.args(["--output-mode", "json"]).args(arguments);
        if let Some(folder) = folder {
            command.env("HQ_SERVER_DIR", folder);
        }
        program::run(&mut command, "").map_err(|why| Trouble::not_run("hq", why, NO_SERVER))
    }

    /// The answer of the Python package to a request.
    fn ask(&self, python: &str, request: &Value) -> Result<Value, Trouble> {
        let mut command = Command::new(python);
        command.args(["-c", DRIVER]);
        let said = program::run(&mut command, &request.to_string());
        let said = said.map_err(|why| Trouble::not_run(python, why, NO_PACKAGE))?;
        let line = said.out.lines().next_back().unwrap_or_default();
        let Ok(answer) = serde_json::from_str::<Value>(line) else {
            return Err(Trouble::Refused { what: said_by(python, &said), hint: NO_PACKAGE.to_owned() });
        };
        let what = format!("HyperQueue: {}", answer["text"].as_str().unwrap_or_default());
        match answer["error"].as_str() {
            None => Ok(answer),
            Some("absent") => Err(Trouble::Absent { what, hint: NO_PACKAGE.to_owned() }),
            Some("silent") => Err(Trouble::Silent { what, hint: NO_SERVER.to_owned() }),
            Some(_) => Err(Trouble::Refused { what, hint: "is its version the one of the server?".to_owned() }),
        }
    }

    fn submit_by_hq(&self, array: &Array<'_>, folder: Option<&str>) -> Result<String, Trouble> {
        let mut arguments = vec!["submit".to_owned(), format!("--array={}", ranges(array.shards))];
        arguments.push(format!("--name={}", array.name));
        arguments.push(format!("--cwd={}", array.cwd.display()));
        arguments.push(format!("--cpus={}", array.threads));
        arguments.extend(["--stdout=none".to_owned(), "--stderr=none".to_owned()]);
        arguments.extend_from_slice(array.options);
        arguments.extend(["--".to_owned(), "sh".to_owned(), array.script.display().to_string()]);
        arguments.push(array.round.to_string());
        let said = self.hq(folder, &arguments)?;
        let answer: Value = serde_json::from_str(&said.out).unwrap_or_default();
        match answer["id"].as_u64().filter(|_| said.good) {
            Some(id) => Ok(id.to_string()),
            None => Err(refusal(&said, &answer)),
        }
    }

    fn submit_by_python(&self, python: &str, array: &Array<'_>, folder: Option<&str>) -> Result<String, Trouble> {
        if !array.options.is_empty() {
            return Err(Trouble::Refused {
                what: "--engine-args are options of `hq submit`, and `hq` is not on PATH".to_owned(),
                hint: "HyperQueue's Python package takes none; leave them out, or put `hq` on PATH".to_owned(),
            });
        }
        let answer = self.ask(
            python,
            &json!({
                "server": folder, "name": array.name, "script": array.script, "cwd": array.cwd, "round": array.round,
                "shards": array.shards, "threads": array.threads,
            }),
        )?;
        Ok(answer["id"].to_string())
    }
}

impl Engine for HyperQueue {
    fn name(&self) -> &'static str {
        "HyperQueue"
    }

    fn submit(&self, array: &Array<'_>) -> Result<Ticket, Trouble> {
        let folder = self.folder();
        let text = folder.as_ref().map(|folder| folder.display().to_string());
        let id = match &self.by {
            By::Hq => self.submit_by_hq(array, text.as_deref()),
            By::Python(python) => self.submit_by_python(python, array, text.as_deref()),
        }?;
        Ok(Ticket { id, server: folder.as_deref().and_then(Self::server), place: text })
    }

    fn look(&self, ticket: &Ticket, shards: &[u32]) -> Result<Look, Trouble> {
        let folder = ticket.place.as_deref();
        // Another server gives the same numbers to jobs of its own.
        let now = folder.and_then(|folder| Self::server(Path::new(folder)));
        if ticket.server.is_some() && now.is_some() && now != ticket.server {
            return Ok(Look::Unknown);
        }
        match &self.by {
            By::Hq => {
                let said = self.hq(folder, &["job".to_owned(), "info".to_owned(), ticket.id.clone()])?;
                match serde_json::from_str::<Value>(&said.out).ok().filter(|_| said.good) {
                    Some(jobs) => Ok(listed(&jobs)),
                    None => Err(refusal(&said, &Value::Null)),
                }
            }
            By::Python(python) => {
                let id: u64 = ticket.id.parse().unwrap_or_default();
                Ok(counted(&self.ask(python, &json!({"server": folder, "job": id}))?, shards))
            }
        }
    }

    fn cancel(&self, ticket: &Ticket) -> Option<String> {
        matches!(self.by, By::Hq).then(|| format!("hq job cancel {}", ticket.id))
    }
}

/// Whether a program of this name is on PATH.
fn on_path(name: &str) -> bool {
    let path = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&path).any(|folder| folder.join(name).is_file())
}

/// `hq` says in words alone whether a server said no or none was there: what cannot be told apart may be asked again.
fn refusal(said: &Said, answer: &Value) -> Trouble {
    let what = match answer["error"].as_str() {
        Some(error) => format!("HyperQueue: {}", error.lines().next().unwrap_or_default()),
        None => said_by("hq", said),
    };
    Trouble::Silent { what, hint: NO_SERVER.to_owned() }
}

/// What `hq job info` says: a list of one job with all its tasks; of none where the server knows no such job.
fn listed(jobs: &Value) -> Look {
    let Some(tasks) = jobs[0]["tasks"].as_array() else { return Look::Unknown };
    let of = |task: &Value| {
        let stands = match task["state"].as_str()? {
            "waiting" => Task::Waits(None),
            "running" => Task::Runs,
            "finished" => Task::Done,
            "canceled" | "aborted" => Task::Cancelled,
            _ => Task::Failed(task["error"].as_str().unwrap_or("failed").to_owned()),
        };
        Some((u32::try_from(task["id"].as_u64()?).ok()?, stands))
    };
    Look::Tasks(tasks.iter().filter_map(of).collect())
}

/// What the Python package says: how many tasks ended well, and which ones (by their place among `shards`) did not. Of the
/// others a job that is over leaves it open which of them ended well; then they are not listed.
fn counted(answer: &Value, shards: &[u32]) -> Look {
    if answer["unknown"] == true {
        return Look::Unknown;
    }
    let count = |name: &str| answer[name].as_u64().unwrap_or_default() as usize;
    let errors = answer["failed"].as_object().cloned().unwrap_or_default();
    let failed =
        |place: usize| errors.get(&place.to_string()).map(|error| error.as_str().unwrap_or("failed").to_owned());
    let over = answer["completed"] == true;
    let others = match (over, count("finished") + errors.len() == count("total"), count("finished")) {
        (false, _, _) => Some(Task::Runs),
        (true, true, _) => Some(Task::Done),
        (true, false, 0) => Some(Task::Cancelled),
        (true, false, _) => None,
    };
    let of =
        |(place, shard): (usize, &u32)| Some((*shard, failed(place).map(Task::Failed).or_else(|| others.clone())?));
    Look::Tasks(shards.iter().enumerate().filter_map(of).collect::<BTreeMap<_, _>>())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As the Python package 0.27 and `hq` say it.
    #[test]
    fn answers_of_hyperqueue_are_read() {
        let tasks = |list: &[(u32, Task)]| Look::Tasks(list.iter().cloned().collect());
        let error = || Task::Failed("Program terminated with exit code 1.".to_owned());
        let said = |completed: bool, finished: u64, failed: Value| json!({"completed": completed, "finished": finished, "total": 3, "failed": failed});
        let one = json!({"1": "Program terminated with exit code 1."});
        let look = counted(&said(false, 1, one.clone()), &[4, 5, 9]);
        assert_eq!(look, tasks(&[(4, Task::Runs), (5, error()), (9, Task::Runs)]));
        let look = counted(&said(true, 2, one), &[4, 5, 9]);
        assert_eq!(look, tasks(&[(4, Task::Done), (5, error()), (9, Task::Done)]));
        assert_eq!(counted(&said(true, 1, json!({})), &[4, 5, 9]), tasks(&[]));
        assert_eq!(counted(&json!({"unknown": true}), &[1]), Look::Unknown);
        let jobs = json!([{"info": {"id": 1}, "tasks": [
            {"id": 1, "state": "finished"}, {"id": 2, "state": "failed", "error": "Program terminated with exit code 1."},
            {"id": 3, "state": "running"}, {"id": 4, "state": "waiting"}, {"id": 5, "state": "canceled"},
        ]}]);
        let all = [(1, Task::Done), (2, error()), (3, Task::Runs), (4, Task::Waits(None)), (5, Task::Cancelled)];
        assert_eq!(listed(&jobs), tasks(&all));
        assert_eq!(listed(&json!([])), Look::Unknown);
    }
}
