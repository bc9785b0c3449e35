//! `turbid cache push|pull|sync`: between the local store and one elsewhere.

use std::path::PathBuf;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use clap::Args;
use serde_json::json;

use crate::digest::Digest;
use crate::registry::Registry;
use crate::resolve::Resolver;
use crate::store::{Pulled, Pushed, Store};
use crate::terminal::tell;

use super::size_text;
use crate::cli::elsewhere::{Elsewhere, counted, failed, pushed_text, traffic_text, warn};
use crate::cli::{Done, Failure, OutputsDir, Pipeline, print, print_json};

/// How often a long transfer says how far it is.
const BEAT: Duration = Duration::from_secs(10);

#[derive(Args)]
pub struct Ship {
    #[command(flatten)]
    elsewhere: Elsewhere,
    /// A pipeline file: only its results; everything by default
    file: Option<PathBuf>,
    /// Stages (or STAGE.PORT) of it, with all that they need; all leaves by default
    #[arg(value_name = "STAGE")]
    targets: Vec<String>,
    /// Override a value of the pipeline, as for `run`
    #[arg(long = "set", value_name = "KEY=VALUE", requires = "file")]
    set: Vec<String>,
    #[arg(long)]
    json: bool,
}

/// Which way.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Way {
    Push,
    Pull,
    Both,
}

impl Ship {
    pub fn run(&self, way: Way, outputs: &OutputsDir, registry: &Registry) -> Done {
        let store = self.elsewhere.required(outputs)?;
        let (keys, mut brought, mut lines) = match &self.file {
            Some(file) => {
                let (keys, brought, line) = self.of_pipeline(file, &store, outputs, registry)?;
                (Some(keys), brought, vec![line])
            }
            None => (None, Pulled::default(), Vec::new()),
        };
        let (mut pulled, mut pushed) = (None::<Pulled>, None::<Pushed>);
        if way != Way::Push {
            brought += store.pull(keys.as_deref(), &Beat::new("pulled").told()).map_err(failed)?;
            pulled = Some(brought);
        }
        if way != Way::Pull {
            pushed = Some(store.push(keys.as_deref(), true, &Beat::new("pushed").told()).map_err(failed)?);
        }
        store.finish().map_err(failed)?;
        let traffic = store.remote().map(|remote| remote.traffic()).unwrap_or_default();
        warn(&store);
        if self.json {
            let mut said = json!({"traffic": traffic});
            pulled.iter().for_each(|pulled| said["pulled"] = json!(pulled));
            pushed.iter().for_each(|pushed| said["pushed"] = json!(pushed));
            print_json(&said.to_string());
        } else {
            lines.extend(pulled.as_ref().map(pulled_text));
            lines.extend(pushed.as_ref().map(pushed_text));
            lines.push(traffic_text(&traffic));
            lines.iter().for_each(|line| print(line));
        }
        Ok(())
    }

    /// The keys of what a pipeline names and is here or elsewhere, what had to be brought here to know them, and how much that is, in words.
    fn of_pipeline(
        &self,
        file: &std::path::Path,
        store: &Store,
        outputs: &OutputsDir,
        registry: &Registry,
    ) -> Result<(Vec<Digest>, Pulled, String), Failure> {
        let pipeline = Pipeline { file: file.to_owned(), set: self.set.clone(), outputs: outputs.clone() };
        let plan = pipeline.plan(registry, &self.targets)?;
        let (keys, brought) = Resolver::new(&plan, store).bring().map_err(failed)?;
        let all = plan.needed_instances().count();
        let line = format!("{} of {all} instances are here or there", keys.len());
        Ok((keys, brought, line))
    }
}

/// Says how far a transfer is, now and then.
struct Beat {
    word: &'static str,
    last: Mutex<Instant>,
}

impl Beat {
    fn new(word: &'static str) -> Self {
        Self { word, last: Mutex::new(Instant::now()) }
    }

    fn told(self) -> impl Fn(u64, u64) + Sync {
        move |done, all| {
            let mut last = crate::panics::lock(&self.last);
            if last.elapsed() >= BEAT {
                *last = Instant::now();
                tell(&format!("{} {} of {}", self.word, size_text(done), size_text(all)));
            }
        }
    }
}

fn pulled_text(pulled: &Pulled) -> String {
    let Pulled { records, small_blobs, large_blobs, left_out } = pulled;
    let mut text = match records + small_blobs + large_blobs {
        0 => "nothing was to be pulled".to_owned(),
        _ => format!(
            "pulled {}, {} and {}",
            counted(*records, "result"),
            counted(*small_blobs, "small blob"),
            counted(*large_blobs, "large blob")
        ),
    };
    if *left_out > 0 {
        text.push_str(&format!(
            "; of {left_out} results some of what they name is not to be had: the next run makes it again"
        ));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_moved_is_said() {
        assert_eq!(pulled_text(&Pulled::default()), "nothing was to be pulled");
        let pulled = Pulled { records: 3, small_blobs: 2, large_blobs: 1, left_out: 1 };
        assert!(pulled_text(&pulled).starts_with("pulled 3 results, 2 small blobs and 1 large blob; of 1 results"));
        assert_eq!(pushed_text(&Pushed::default()), "nothing was to be pushed");
        let pushed = Pushed { records: 3, packs: 1, bytes: 5000, left_out: 2, ..Pushed::default() };
        assert!(
            pushed_text(&pushed).starts_with("pushed 3 results: 1 pack and 0 large blobs, 5.0 kB; 2 were left out")
        );
    }
}
