//! `turbid runs`: what ran here, when, and how it ended.

use clap::Args;
use serde_json::json;

use crate::report::figures::aligned;
use crate::report::history::{Run, runs, time_text};

use super::{Done, OutputsDir, print, print_json};

#[derive(Args)]
pub struct Runs {
    #[command(flatten)]
    outputs: OutputsDir,
    /// So many of the latest
    #[arg(short = 'n', long = "last", value_name = "N", default_value_t = 20)]
    last: usize,
    /// Only those of this pipeline (its name, or its file)
    #[arg(value_name = "PIPELINE")]
    pipeline: Option<String>,
    #[arg(long)]
    json: bool,
}

impl Runs {
    pub fn run(&self) -> Done {
        let wanted = |run: &Run| {
            self.pipeline.as_ref().is_none_or(|name| run.pipeline == *name || run.file.as_ref() == Some(name))
        };
        let most = if self.pipeline.is_some() { usize::MAX } else { self.last };
        let mut found: Vec<Run> = runs(self.outputs.path(), most).into_iter().filter(wanted).collect();
        found.drain(..found.len().saturating_sub(self.last));
        if self.json {
            for run in &found {
                let Run { id, time, pipeline, file, overrides, hits, ran, failed, seconds, ended, error, failures } =
                    run;
                let failures: Vec<_> =
                    failures.iter().map(|(label, message)| json!({"instance": label, "message": message})).collect();
                print_json(
                    &json!({
                        "run": id, "time": time, "pipeline": pipeline, "file": file, "overrides": overrides, "hits": hits, "ran": ran,
                        "failed": failed, "seconds": seconds, "ended": ended, "error": error, "failures": failures,
                    })
                    .to_string(),
                );
            }
            return Ok(());
        }
        if found.is_empty() {
            print("nothing has run yet");
            return Ok(());
        }
        let head = ["run", "time", "pipeline", "ran", "up to date", "failed", "seconds", "error", "overrides"];
        let mut lines = vec![head.map(str::to_owned).to_vec()];
        for run in &found {
            let seconds = match (run.ended, run.seconds) {
                (false, _) => "no end".to_owned(),
                (true, Some(seconds)) => format!("{seconds:.1}"),
                (true, None) => "-".to_owned(),
            };
            lines.push(vec![
                if run.id.is_empty() { "-".to_owned() } else { run.id.clone() },
                time_text(&run.time),
                run.file.clone().unwrap_or_else(|| run.pipeline.clone()),
                run.ran.to_string(),
                run.hits.to_string(),
                run.failed.to_string(),
                seconds,
                run.error.clone(),
                run.overrides.join(" "),
            ]);
        }
        print(&aligned(&lines));
        Ok(())
    }
}
