//! Which instances a shard of a plan runs: whole chains, in blocks of neighbouring points; what gathers across shards is left.
//!
//! The split depends on the plan alone: which instances there are, what feeds them, and their axes. So every machine that is
//! given a shard finds the same one.

mod links;

use std::ops::Range;
use std::str::FromStr;

use links::{Feed, Links};

use super::{IdVec, InstanceId, Plan};

/// One of the shards that a plan is split into.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Shard {
    /// From 1.
    pub number: u32,
    pub of: u32,
}

impl FromStr for Shard {
    type Err = String;

    /// Reads `K/N`. Error: what is wrong with it, and what to write.
    fn from_str(text: &str) -> Result<Self, String> {
        let parts = text.split_once('/').and_then(|(k, n)| Some((k.parse().ok()?, n.parse().ok()?)));
        let Some((number, of)) = parts else {
            return Err("a shard is written K/N, for example 3/8: the third of eight".to_owned());
        };
        match (number, of) {
            (_, 0) => Err("a plan is split into one shard at least: write 1/1, or leave --shard out".to_owned()),
            (0, _) => Err(format!("shards count from 1: write 1/{of} to {of}/{of}")),
            _ if number > of => Err(format!("there are {of} shards: write 1/{of} to {of}/{of}")),
            _ => Ok(Self { number, of }),
        }
    }
}

impl Shard {
    /// Which of `count` things in a row belong to it: a block, as long as those of the others, or one longer or shorter.
    pub fn block(self, count: usize) -> Range<usize> {
        // 128 bits: the product of two numbers of 64 bits at the most.
        let before = |shards: u32| (shards as u128 * count as u128).div_ceil(self.of as u128) as usize;
        before(self.number - 1)..before(self.number)
    }
}

/// Which shards run what.
pub struct Split {
    of: u32,
    links: Links,
    /// Where each node belongs.
    homes: Vec<Home>,
}

/// Where an instance belongs.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Home {
    /// To one shard (from 0).
    Shard(u32),
    /// To all that need it.
    Shared,
    /// To none: it gathers what several shards make, or follows from that.
    Left,
}

impl Split {
    /// Splits the needed instances of a plan.
    pub fn of(plan: &Plan, shards: u32) -> Self {
        Self::of_links(Links::of(plan), shards)
    }

    fn of_links(links: Links, of: u32) -> Self {
        let homes = homes(&links, of);
        Self { of, links, homes }
    }

    /// The instances of a shard, each after those that feed it.
    ///
    /// # Panics
    /// Where `shard` is none of this split.
    pub fn instances(&self, shard: Shard) -> Vec<InstanceId> {
        self.nodes(shard).into_iter().map(|node| self.links.ids[node]).collect()
    }

    fn nodes(&self, shard: Shard) -> Vec<usize> {
        assert!(shard.of == self.of && (1..=shard.of).contains(&shard.number), "{shard:?} of {}", self.of);
        let own = Home::Shard(shard.number - 1);
        let mut runs: Vec<bool> = self.homes.iter().map(|home| *home == own).collect();
        for node in (0..runs.len()).rev().filter(|&node| self.homes[node] != Home::Left) {
            if runs[node] {
                self.links.feeds(node).for_each(|feed| runs[feed.node] = true);
            }
        }
        (0..runs.len()).filter(|&node| runs[node]).collect()
    }

    /// Where each needed instance belongs; those that feed it come before it.
    pub fn homes(&self) -> impl Iterator<Item = (InstanceId, Home)> + '_ {
        self.links.ids.iter().copied().zip(self.homes.iter().copied())
    }

    /// How many instances no shard runs.
    pub fn left(&self) -> usize {
        self.homes.iter().filter(|home| **home == Home::Left).count()
    }
}

/// All that is needed for some instances: they and what feeds them, each after those that feed it.
pub fn closure(plan: &Plan, some: impl IntoIterator<Item = InstanceId>) -> Vec<InstanceId> {
    let mut needed = IdVec::<InstanceId, _>::filled(false, plan.instances().len());
    let mut open: Vec<InstanceId> = some.into_iter().collect();
    while let Some(id) = open.pop() {
        if !std::mem::replace(&mut needed[id], true) {
            open.extend(plan.sources(id).map(|(from, _)| from));
        }
    }
    plan.needed_instances().filter(|id| needed[*id]).collect()
}

/// First the chains of what gathers nothing, or only what belongs to its own point: they are dealt out. Then what gathers: it
/// belongs to the shard that has all of its sources, if there is one.
fn homes(links: &Links, of: u32) -> Vec<Home> {
    let joins = joins(links, of);
    let is_chained = chained(links, &joins);
    let chains = chains(links, &joins, &is_chained);
    let mut homes = deal(links, &is_chained, &chains, of);
    let mut spans = spans(links, &homes);
    for node in (0..homes.len()).filter(|&node| !is_chained[node]) {
        let mut span = Some((0, of - 1));
        for feed in links.feeds(node) {
            span = span.zip(spans[feed.node]).map(|((a, b), (c, d))| (a.max(c), b.min(d))).filter(|(a, b)| a <= b);
        }
        homes[node] = span.map_or(Home::Left, |(first, _)| Home::Shard(first));
        spans[node] = span.map(|(first, _)| (first, first));
    }
    homes
}

/// The stages whose instances belong to a chain with all that they gather: each gathers what lies at its own point, and there
/// are enough of them to deal out. (Thirty means over three repeats each are thirty chains; one mean over ninety is none.)
fn joins(links: &Links, of: u32) -> Vec<bool> {
    let mut joins: Vec<bool> = links.counts.iter().map(|count| *count >= of as usize).collect();
    for node in 0..links.len() {
        let own = |feed: Feed| links.extends(feed.node, node);
        if !links.feeds(node).filter(|feed| feed.gathered).all(own) {
            joins[links.stages[node]] = false;
        }
    }
    joins
}

/// Whether a node gathers nothing but what belongs to its chain, nor does anything that feeds it.
fn chained(links: &Links, joins: &[bool]) -> Vec<bool> {
    let mut chained = Vec::with_capacity(links.len());
    for node in 0..links.len() {
        let joins = joins[links.stages[node]];
        chained.push(links.feeds(node).all(|feed| (joins || !feed.gathered) && chained[feed.node]));
    }
    chained
}

/// For each node the first node of its chain: nodes of one point that feed each other are one chain.
fn chains(links: &Links, joins: &[bool], is_chained: &[bool]) -> Vec<usize> {
    let mut first: Vec<usize> = (0..links.len()).collect();
    for node in (0..links.len()).filter(|&node| is_chained[node]) {
        for feed in links.feeds(node) {
            if links.points[node] == links.points[feed.node] || (feed.gathered && joins[links.stages[node]]) {
                let (a, b) = (root(&mut first, node), root(&mut first, feed.node));
                first[a.max(b)] = a.min(b);
            }
        }
    }
    (0..first.len()).map(|node| root(&mut first, node)).collect()
}

fn root(first: &mut [usize], mut node: usize) -> usize {
    while first[node] != node {
        first[node] = first[first[node]];
        node = first[node];
    }
    node
}

/// Deals the chains that nothing else goes on from to the shards, in blocks of neighbouring points as equal as can be.
fn deal(links: &Links, is_chained: &[bool], chains: &[usize], of: u32) -> Vec<Home> {
    let mut goes_on = vec![false; links.len()];
    for node in (0..links.len()).filter(|&node| is_chained[node]) {
        links.feeds(node).for_each(|feed| goes_on[feed.node] = true);
    }
    let ends = (0..links.len()).filter(|&node| is_chained[node] && !goes_on[node]);
    let mut dealt: Vec<(usize, usize, usize)> = ends.map(|end| (links.points[end], end, chains[end])).collect();
    // The first end of a chain says where it stands.
    dealt.sort_unstable_by_key(|&(point, end, chain)| (chain, point, end));
    dealt.dedup_by_key(|(_, _, chain)| *chain);
    dealt.sort_unstable();
    let mut home_of = vec![Home::Shared; links.len()];
    for number in 1..=of {
        for (_, _, chain) in &dealt[Shard { number, of }.block(dealt.len())] {
            home_of[*chain] = Home::Shard(number - 1);
        }
    }
    chains.iter().map(|chain| home_of[*chain]).collect()
}

/// The first and the last shard that needs a node, among those that were dealt out; none for what waits for its turn.
fn spans(links: &Links, homes: &[Home]) -> Vec<Option<(u32, u32)>> {
    let of = |home: &Home| if let Home::Shard(shard) = home { Some((*shard, *shard)) } else { None };
    let mut spans: Vec<Option<(u32, u32)>> = homes.iter().map(of).collect();
    for node in (0..links.len()).rev() {
        let Some((first, last)) = spans[node] else { continue };
        for feed in links.feeds(node) {
            let (a, b) = spans[feed.node].unwrap_or((first, last));
            spans[feed.node] = Some((a.min(first), b.max(last)));
        }
    }
    spans
}

#[cfg(test)]
mod tests;
