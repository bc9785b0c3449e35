//! `--shard K/N` and `--only SELECTOR`: a part of what the targets need.

use std::path::Path;

use clap::Args;
use serde_json::{Value, json};

use crate::plan::shard::{Shard, Split, closure};
use crate::plan::{InstanceId, Plan};
use crate::run::latest;
#[cfg(feature = "tables")]
use crate::run::progress::Json;
#[cfg(feature = "tables")]
use crate::terminal::print;

use super::{Failure, Selector};

#[derive(Args, Clone, Default)]
pub(super) struct PartOf {
    /// Only the K-th of N parts of the plan (K from 1), for N processes or machines that share the outputs folder
    #[arg(long, value_name = "K/N")]
    pub shard: Option<Shard>,
    /// Only these instances and what feeds them: STAGE or STAGE[axis=value,..]; may be given several times
    #[arg(long, value_name = "SELECTOR")]
    pub only: Vec<String>,
}

/// The last words of a shard of a data set or a study: how many of its samples or points are there, hits, and instances that ran.
#[cfg(feature = "tables")]
pub(super) fn told_of_shard(
    (shard, json): (Shard, bool),
    (what, name): (&str, &str),
    (done, hits, ran): (usize, usize, usize),
    seconds: f64,
) {
    let Shard { number, of } = shard;
    if json {
        Json::event(json!({
            "event": "finished", what: done, "hits": hits, "ran": ran, "failed": 0, "seconds": seconds, "interrupted": false,
            "shard": {"shard": number, "of": of}, "left": 0,
        }));
        return;
    }
    print(&format!(
        "{name}, shard {number} of {of}: {done} {what} are in the store, {hits} up to date, {ran} ran, {seconds:.1} s; when all \
         shards have run, the same command without --shard finds them there"
    ));
}

impl PartOf {
    /// Whether all that the targets need is asked for.
    pub fn is_whole(&self) -> bool {
        self.shard.is_none() && self.only.is_empty()
    }

    /// Leaves of a plan what is asked for. How many instances no shard runs, because they gather what several make.
    ///
    /// Error: a selector names nothing that the targets need.
    pub fn restrict(&self, plan: &mut Plan) -> Result<usize, Failure> {
        if !self.only.is_empty() {
            let mut some = Vec::new();
            for text in &self.only {
                some.extend(self.selected(plan, text)?);
            }
            plan.restrict(&closure(plan, some));
        }
        let Some(shard) = self.shard else { return Ok(0) };
        let split = Split::of(plan, shard.of);
        plan.restrict(&split.instances(shard));
        Ok(split.left())
    }

    fn selected(&self, plan: &Plan, text: &str) -> Result<Vec<InstanceId>, Failure> {
        let named = |failure| match failure {
            Failure::Input(message) => Failure::Input(format!("--only {text}: {message}")),
            other => other,
        };
        let selector = Selector::parse(text).map_err(named)?;
        let found = selector.instances(plan).map_err(named)?;
        if let Some(port) = &selector.port {
            let message = format!("an instance makes all its outputs at once; write it without `.{port}`");
            return Err(named(Failure::Input(message)));
        }
        let is_needed = found.first().is_some_and(|&id| plan.needs(plan.stage_of(id)));
        let message = format!("no target needs `{}`; name it as a target too", selector.stage);
        if is_needed { Ok(found) } else { Err(named(Failure::Input(message))) }
    }

    /// What programs are told of a shard.
    pub fn event(&self, left: usize) -> Vec<(&'static str, Value)> {
        let Some(Shard { number, of }) = self.shard else { return Vec::new() };
        vec![("shard", json!({"shard": number, "of": of})), ("left", json!(left))]
    }

    /// What people are told of a part at its end, with the command that follows.
    pub fn text(&self, plan: &Plan, targets: &[String], outputs: &Path, left: usize) -> Option<String> {
        let command = latest::Command::of(plan, outputs).run_of(targets);
        let instances = |n: usize| if n == 1 { "1 instance".to_owned() } else { format!("{n} instances") };
        if let Some(Shard { number, of }) = self.shard {
            let here = instances(plan.needed_instances().count());
            let rest = match left {
                0 => "when all shards have run, this only brings outputs/latest up to date:".to_owned(),
                left => format!("{} more gather what several shards make; when all shards have run:", instances(left)),
            };
            return Some(format!("shard {number} of {of}: {here}; {rest} {command}"));
        }
        (!self.only.is_empty())
            .then(|| format!("a part of the plan: outputs/latest stays as it is; all of it: {command}"))
    }
}
