//! The program, run as a user runs it.

use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

/// What a run says of one of its stages.
pub struct Ran {
    /// Of its own work, whatever else the machine does.
    pub cpu_seconds: f64,
    /// Of the process while it ran.
    pub peak_bytes: f64,
    /// Mean over the image of each frame, and its standard error.
    pub means: Vec<[f64; 2]>,
    /// Of the file of frames.
    pub path: PathBuf,
}

/// Runs a pipeline in an empty store below `space`, and asks for its stage `frames`.
///
/// Error: what the program says.
pub fn frames(space: &Path, pipeline: &str) -> Result<Ran, String> {
    let (file, outputs) = (space.join("pipeline.yaml"), space.join("outputs"));
    let _ = std::fs::remove_dir_all(&outputs);
    std::fs::write(&file, pipeline).map_err(|e| e.to_string())?;
    let turbid = |verb: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_turbid"));
        command.arg(verb).arg(&file).arg("--json").arg("--outputs").arg(&outputs).env("NO_COLOR", "1");
        let done = command.output().map_err(|e| e.to_string())?;
        let said = |bytes: Vec<u8>| String::from_utf8_lossy(&bytes).into_owned();
        if done.status.success() { Ok(said(done.stdout)) } else { Err(said(done.stderr) + &said(done.stdout)) }
    };
    turbid("run")?;
    let shown: Value = serde_json::from_str(&turbid("show")?).map_err(|e| e.to_string())?;
    let instances = shown["instances"].as_array().into_iter().flatten();
    let frames = instances.into_iter().find(|i| i["stage"] == "frames").ok_or("no stage `frames`")?;
    let number = |value: &Value| value.as_f64().unwrap_or(f64::NAN);
    let layers = frames["ports"]["frames"]["layers"].as_array().into_iter().flatten();
    let values = layers.filter(|layer| layer["kind"] == "value");
    Ok(Ran {
        cpu_seconds: number(&frames["cpu_seconds"]),
        peak_bytes: number(&frames["peak_bytes"]),
        means: values.map(|layer| [number(&layer["mean"]), number(&layer["mean_se"])]).collect(),
        path: frames["ports"]["frames"]["path"].as_str().map(PathBuf::from).ok_or("no path")?,
    })
}
