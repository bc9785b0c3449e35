//! The program, run as a user runs it.

use std::path::Path;
use std::process::Command;

use serde_json::Value;

/// Runs a pipeline in an empty store below `space`; what `turbid show --json` says of its stages afterwards: `cpu_seconds` (of a stage's
/// own work, whatever else the machine does), `peak_bytes` (of the process while it ran), `ports` and so on.
///
/// Error: what the program says.
pub fn run(space: &Path, pipeline: &str) -> Result<Value, String> {
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
    serde_json::from_str(&turbid("show")?).map_err(|e| e.to_string())
}

/// One stage of what [`run`] gave.
pub fn stage<'a>(shown: &'a Value, name: &str) -> Result<&'a Value, String> {
    let mut instances = shown["instances"].as_array().into_iter().flatten();
    instances.find(|i| i["stage"] == name).ok_or(format!("no stage `{name}`"))
}

/// NaN where there is none.
pub fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or(f64::NAN)
}
