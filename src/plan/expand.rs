//! The instances of each stage, from those of its sources and its own `foreach`.

use std::collections::BTreeSet;

use turbid_contract::Arity;

use crate::ids::{Id, IdRange, IdVec, InstanceId, StageId};
use crate::key::value_text;
use crate::spec::{Section, SourceRef, Spec, nearest};

use super::axes::{self, Instances, Joined, MAX_INSTANCES, Picks, Piece, same_value};
use super::feeds::{Feed, Feeds, Producers};
use super::points::{Places, Points};
use super::ports::Link;

/// The instances of one stage.
#[derive(Default)]
pub struct Expanded {
    first: usize,
    pub points: Points,
    pub feeds: Feeds,
    /// The stage whose points the axis `draw` counts.
    pub draws: Option<StageId>,
}

impl Expanded {
    pub fn ids(&self) -> IdRange<InstanceId> {
        IdRange::new(self.first, self.first + self.points.len())
    }

    /// The place of an instance among those of its stage.
    pub fn place(&self, id: InstanceId) -> usize {
        id.place() - self.first
    }
}

/// The stages that were expanded so far.
pub struct Expansion<'a> {
    spec: &'a Spec,
    pub expanded: IdVec<StageId, Expanded>,
    /// Where the instances of a stage begin, in the order of instances.
    pub starts: Vec<(InstanceId, StageId)>,
    /// Number of all instances.
    pub count: usize,
}

/// Section, path in it, message, hint.
pub type Mistake = (Section, Vec<String>, String, Option<String>);

/// A mistake with its way out.
type Hinted = (String, Option<String>);

/// The instances that `where` leaves, and their axes but for those that it fixes.
struct Selected {
    chosen: Vec<InstanceId>,
    axes: BTreeSet<String>,
}

fn is_many(link: &Link) -> bool {
    matches!(link.port.arity, Arity::Many | Arity::Some)
}

impl<'a> Expansion<'a> {
    pub fn new(spec: &'a Spec) -> Self {
        let expanded = spec.stages.ids().map(|_| Expanded::default()).collect();
        Self { spec, expanded, starts: Vec::new(), count: 0 }
    }

    /// Adds the instances of a stage whose sources were added before.
    pub fn add(&mut self, stage: StageId, links: &[Link]) -> Result<(), Mistake> {
        let draws = self.draw_of(stage, links)?;
        let (points, feeds) = self.expand(stage, links)?;
        self.starts.push((InstanceId::new(self.count), stage));
        let first = self.count;
        self.count += points.len();
        self.expanded[stage] = Expanded { first, points, feeds, draws };
        Ok(())
    }

    fn instances(&self, stage: StageId) -> Instances<'_> {
        let expanded = &self.expanded[stage];
        Instances { spec: self.spec, points: &expanded.points, ids: expanded.ids() }
    }

    /// The stage whose points the axis `draw` of a stage counts: its own, or that of its sources.
    ///
    /// Error: two of them, whose indices have nothing to do with each other; a drawn name that is an axis already.
    fn draw_of(&self, stage: StageId, links: &[Link]) -> Result<Option<StageId>, Mistake> {
        let spec = self.spec;
        let own = spec.stages[stage].foreach.draw.is_some().then_some(stage);
        let mut found = own.map(|own| (own, None));
        let mut axes = BTreeSet::new();
        for link in links {
            for (source, from) in &link.sources {
                axes.extend(self.expanded[from.stage].points.names().map(String::as_str));
                let Some(draw) = self.expanded[from.stage].draws else { continue };
                match found {
                    Some((other, by)) if other != draw => {
                        let name = |stage: StageId| &spec.stages[stage].name;
                        let by = by.map_or_else(String::new, |by: &str| format!(" (by `{by}`)"));
                        let message = format!(
                            "`{}` is drawn by `{}`, and not by `{}`{by}",
                            source.stage,
                            name(draw),
                            name(other)
                        );
                        let hint = "one `draw` per chain: draw once, and let both take their values from it";
                        return Err((Section::In, vec![link.port.name.to_owned()], message, Some(hint.to_owned())));
                    }
                    _ => found = Some((draw, Some(source.stage.as_str()))),
                }
            }
        }
        let draw = found.map(|(draw, _)| draw);
        let drawn = draw.and_then(|draw| spec.stages[draw].foreach.draw.as_ref());
        let names = || drawn.into_iter().flat_map(|draw| draw.names());
        let taken = |name: &str| {
            axes.contains(name) || own.is_none() && spec.stages[stage].foreach.names.iter().any(|n| n == name)
        };
        if let Some(name) = names().find(|name| taken(name)) {
            let message = format!("`{name}` is both drawn and an axis");
            let hint = Some("give one of them another name".to_owned());
            return Err((Section::Foreach, vec![name.to_owned()], message, hint));
        }
        Ok(draw)
    }

    fn expand(&self, stage: StageId, links: &[Link]) -> Result<(Points, Feeds), Mistake> {
        let stage_spec = &self.spec.stages[stage];
        let pieces = self.pieces(links)?;
        let joined = axes::join(&pieces, stage_spec.product)
            .map_err(|apart| (Section::In, Vec::new(), apart.to_string(), apart.hint()))?;
        let carried = |name: &&String| joined.names.iter().any(|(known, _)| known == *name);
        if let Some(name) = stage_spec.foreach.names.iter().find(carried) {
            let message = format!("an input of `{}` carries the axis `{name}` already", stage_spec.name);
            let hint = Some("give the new axis another name".to_owned());
            return Err((Section::Foreach, vec![name.clone()], message, hint));
        }
        // Without a `foreach` one point without values.
        let own = stage_spec.foreach.rows.len();
        if own.saturating_mul(joined.rows) > MAX_INSTANCES {
            let name = &stage_spec.name;
            let message = format!("`{name}` has {} x {own} instances, more than {MAX_INSTANCES}", joined.rows);
            return Err((Section::Foreach, Vec::new(), message, None));
        }
        let mut points = Points::of(stage, &stage_spec.foreach, joined.rows);
        for (at, piece) in pieces.iter().enumerate() {
            let names: Vec<&str> =
                joined.names.iter().filter(|(_, by)| *by == at).map(|(name, _)| name.as_str()).collect();
            if !names.is_empty() {
                points.take(&names, piece.of.points, &places(piece, &joined.picks[at], joined.rows), own);
            }
        }
        let sources = links.iter().flat_map(|link| link.sources.iter().map(move |(_, found)| (link, found.port.name)));
        let feeds = sources.zip(pieces).zip(&joined.picks).map(|(((link, out), piece), picks)| Feed {
            port: link.port.name,
            many: is_many(link),
            out,
            producers: producers(piece, picks, &joined),
        });
        let feeds = Feeds::of(feeds.collect(), own);
        Ok((points, feeds))
    }

    /// What the sources of a stage bring, one after the other.
    fn pieces(&self, links: &[Link]) -> Result<Vec<Piece<'_>>, Mistake> {
        let at_port =
            |link: &Link, (message, hint): Hinted| (Section::In, vec![link.port.name.to_owned()], message, hint);
        // Axes that one and optional ports bring; a many port gathers the others.
        let mut brought = BTreeSet::new();
        let mut selected: Vec<Selected> = Vec::new();
        for link in links {
            for (source, found) in &link.sources {
                let some = select(self.instances(found.stage), source).map_err(|mistake| at_port(link, mistake))?;
                if !is_many(link) {
                    brought.extend(some.axes.iter().cloned());
                }
                selected.push(some);
            }
        }
        let mut pieces = Vec::new();
        let mut some = selected.into_iter();
        for link in links {
            for (source, found) in &link.sources {
                let Selected { chosen, axes: has } = some.next().expect("one per source");
                let gathered = match (&source.over, is_many(link)) {
                    (Some(over), _) => {
                        if let Some(unknown) = over.iter().find(|name| !has.contains(*name)) {
                            let message = format!("`{}` has no axis `{unknown}` to gather over", source.stage);
                            let hint = nearest(unknown, has.iter().map(String::as_str));
                            return Err(at_port(link, (message, hint.map(|n| format!("did you mean `{n}`?")))));
                        }
                        over.iter().cloned().collect()
                    }
                    (None, true) => has.difference(&brought).cloned().collect(),
                    (None, false) => BTreeSet::new(),
                };
                let names: Vec<String> = has.difference(&gathered).cloned().collect();
                let label = format!("input `{}` ({}.{})", link.port.name, source.stage, found.port.name);
                pieces.push(Piece::gather(label, self.instances(found.stage), chosen, names));
            }
        }
        Ok(pieces)
    }
}

/// The instances of a piece that the rows of a join take their axes from.
fn places(piece: &Piece<'_>, picks: &Picks, rows: usize) -> Places {
    let place = |entry: usize| piece.of.place(piece.first(entry)) as u32;
    let is_whole = matches!(picks, Picks::All) && rows == piece.of.points.len();
    if is_whole && (0..rows).all(|row| place(row) as usize == row) {
        return Places::All;
    }
    Places::These((0..rows).map(|row| place(picks.at(row))).collect())
}

fn producers(piece: Piece<'_>, picks: &Picks, joined: &Joined) -> Producers {
    let entries = piece.len();
    let rows = 0..joined.rows;
    match (piece.ends, picks) {
        (_, Picks::Only) => Producers::Same(piece.ids),
        (None, Picks::All) => Producers::One(piece.ids),
        (None, Picks::These(_)) => Producers::One(rows.map(|row| piece.ids[picks.at(row)]).collect()),
        (Some(ends), _) => {
            assert_eq!(ends.len(), entries);
            Producers::Lists { picks: rows.map(|row| picks.at(row) as u32).collect(), ids: piece.ids, ends }
        }
    }
}

fn select(of: Instances<'_>, source: &SourceRef) -> Result<Selected, Hinted> {
    let mut chosen: Vec<InstanceId> = of.ids.collect();
    for (name, value) in &source.filter {
        let Some(axis) = of.points.axis(name) else {
            let hint = nearest(name, of.points.names().map(String::as_str)).map(|n| format!("did you mean `{n}`?"));
            return Err((format!("`{}` has no axis `{name}`", source.stage), hint));
        };
        let left: Vec<InstanceId> =
            chosen.iter().copied().filter(|&id| same_value(of.value(axis, id), value)).collect();
        if left.is_empty() {
            let mut values: Vec<String> = chosen.iter().map(|&id| value_text(of.value(axis, id))).collect();
            values.sort();
            values.dedup();
            values.truncate(12);
            let message = format!("`{}` has no {name} = {}", source.stage, value_text(value));
            return Err((message, Some(format!("it has {}", values.join(", ")))));
        }
        chosen = left;
    }
    let names = of.points.names().filter(|name| !source.filter.contains_key(*name));
    Ok(Selected { chosen, axes: names.cloned().collect() })
}
