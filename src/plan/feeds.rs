//! Which instances feed those of a stage, without a list for each of them.

use crate::ids::InstanceId;

use super::Wire;

/// What feeds the instances of a stage, by their places among them.
#[derive(Debug, Default)]
pub struct Feeds {
    /// So many neighbours are fed alike: the points that the stage's own `foreach` adds.
    each: usize,
    /// Sorted by port; of one port in the order of its sources.
    feeds: Vec<Feed>,
}

/// One source of an input port.
#[derive(Debug)]
pub struct Feed {
    pub port: &'static str,
    pub many: bool,
    /// The port that is taken from each producer.
    pub out: &'static str,
    pub producers: Producers,
}

/// The producers of each row of a join.
#[derive(Debug)]
pub enum Producers {
    /// The same of all rows.
    Same(Vec<InstanceId>),
    /// One of each row.
    One(Vec<InstanceId>),
    /// Those of one of several lists, which end at these places.
    Lists { picks: Vec<u32>, ids: Vec<InstanceId>, ends: Vec<usize> },
}

impl Producers {
    fn of(&self, row: usize) -> &[InstanceId] {
        match self {
            Self::Same(ids) => ids,
            Self::One(ids) => &ids[row..=row],
            Self::Lists { picks, ids, ends } => {
                let list = picks[row] as usize;
                &ids[list.checked_sub(1).map_or(0, |before| ends[before])..ends[list]]
            }
        }
    }
}

impl Feeds {
    pub fn of(mut feeds: Vec<Feed>, each: usize) -> Self {
        feeds.sort_by_key(|feed| feed.port);
        Self { each, feeds }
    }

    /// The producers of an instance with the port taken from each, in the order of its wires.
    pub fn sources(&self, place: usize) -> impl Iterator<Item = (InstanceId, &'static str)> + Clone + '_ {
        let row = place.checked_div(self.each).unwrap_or(0);
        self.feeds.iter().flat_map(move |feed| feed.producers.of(row).iter().map(move |&id| (id, feed.out)))
    }

    pub fn wires(&self, place: usize) -> Vec<Wire> {
        let row = place.checked_div(self.each).unwrap_or(0);
        let mut wires: Vec<Wire> = Vec::with_capacity(self.feeds.len());
        for Feed { port, many, out, producers } in &self.feeds {
            let from = producers.of(row).iter().map(|&id| (id, *out));
            match wires.last_mut() {
                Some(last) if last.port == *port => last.from.extend(from),
                _ => wires.push(Wire { port, many: *many, from: from.collect() }),
            }
        }
        wires
    }
}
