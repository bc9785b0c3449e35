//! `--store`: a store elsewhere behind the local one.

use std::path::Path;

use clap::Args;

use crate::resolve::Resolver;
use crate::store::{Address, Pushed, Remote, Store, StoreError, Traffic};
use crate::terminal::tell;

use super::cache::size_text;
use super::{Failure, OutputsDir};

#[derive(Args, Clone)]
pub(super) struct Elsewhere {
    /// A store elsewhere, s3://BUCKET/PREFIX: what is missing here is looked for there, and what a run made is sent there
    #[arg(long = "store", value_name = "URL", env = "TURBID_STORE", hide_env_values = true)]
    store: Option<String>,
}

impl Elsewhere {
    pub fn is_given(&self) -> bool {
        self.store.as_ref().is_some_and(|url| !url.is_empty())
    }

    /// The local store to work on, with the one elsewhere behind it.
    pub fn store(&self, outputs: &OutputsDir) -> Result<Store, Failure> {
        self.opened_by(Store::open, outputs)
    }

    /// The same for a shard of a run.
    pub fn store_for_shard(&self, outputs: &OutputsDir) -> Result<Store, Failure> {
        self.opened_by(Store::open_for_shard, outputs)
    }

    fn opened_by(&self, open: fn(&Path) -> Result<Store, StoreError>, outputs: &OutputsDir) -> Result<Store, Failure> {
        // First what takes no network: a slip is told at once.
        let remote = self.remote()?;
        let store = open(outputs.path()).map_err(|e| Failure::Input(e.to_string()))?;
        match remote {
            Some(remote) => store.with_remote(remote).map_err(failed),
            None => Ok(store),
        }
    }

    /// The same to look only; what comes from elsewhere is kept here all the same.
    pub fn store_to_read(&self, outputs: &OutputsDir) -> Result<Store, Failure> {
        if self.is_given() { self.store(outputs) } else { outputs.store_to_read() }
    }

    /// A store that must be named.
    pub fn required(&self, outputs: &OutputsDir) -> Result<Store, Failure> {
        if self.is_given() {
            return self.store(outputs);
        }
        Err(Failure::Input("which store? write --store s3://BUCKET/PREFIX, or set TURBID_STORE".to_owned()))
    }

    fn remote(&self) -> Result<Option<Remote>, Failure> {
        let Some(url) = self.store.as_ref().filter(|url| !url.is_empty()) else { return Ok(None) };
        let address: Address = url.parse().map_err(Failure::Input)?;
        Remote::at(address).map(Some).map_err(|e| Failure::Input(e.to_string()))
    }
}

/// Brings in what the store elsewhere has of a plan, if there is one.
pub(super) fn bring(resolver: &Resolver<'_>) -> Result<(), Failure> {
    match resolver.store.remote() {
        Some(_) => resolver.bring().map(drop).map_err(failed),
        None => Ok(()),
    }
}

/// What was found wrong with the store elsewhere.
pub(super) fn warnings(store: &Store) -> Vec<String> {
    let damage = store.remote().map(Remote::take_warnings).unwrap_or_default();
    damage.into_iter().chain(store.unread().filter(|_| store.remote().is_some())).collect()
}

/// Tells it.
pub(super) fn warn(store: &Store) {
    warnings(store).iter().for_each(|warning| tell(&format!("warning: {warning}")));
}

pub(super) fn failed(error: StoreError) -> Failure {
    Failure::Failed(error.to_string())
}

/// `pushed 120 results: 3 packs and 40 large blobs, 210.3 MB`
pub(super) fn pushed_text(pushed: &Pushed) -> String {
    let Pushed { records, large_blobs, packs, bytes, left_out, .. } = pushed;
    let mut text = match (records, bytes) {
        (0, 0) => "nothing was to be pushed".to_owned(),
        _ => format!(
            "pushed {}: {} and {}, {}",
            counted(*records, "result"),
            counted(*packs, "pack"),
            counted(*large_blobs, "large blob"),
            size_text(*bytes)
        ),
    };
    if *left_out > 0 {
        text.push_str(&format!(
            "; {left_out} were left out: some of what they name is released, damaged or gone here (`turbid cache verify`)"
        ));
    }
    text
}

/// `1 pack`, `2 packs`
pub(super) fn counted(n: u64, what: &str) -> String {
    format!("{n} {what}{}", if n == 1 { "" } else { "s" })
}

/// `52 requests, 210.3 MB sent, 1.2 kB received`
pub(super) fn traffic_text(traffic: &Traffic) -> String {
    let Traffic { requests, sent, received } = traffic;
    format!("{}, {} sent, {} received", counted(*requests, "request"), size_text(*sent), size_text(*received))
}
