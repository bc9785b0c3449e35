//! Joining the axes of a stage's inputs: which instances the stage has, and which inputs each of them takes.

use std::cmp::Ordering;
use std::collections::HashMap;
use std::fmt;

use serde_json::Value;

use crate::ids::{Id, IdRange, InstanceId};
use crate::key::push_value;
use crate::spec::Spec;

use super::points::Points;

/// A stage with more instances than this is a mistake in the file.
pub const MAX_INSTANCES: usize = 1_000_000;
/// The same of all stages together.
pub const MAX_ALL: usize = 10 * MAX_INSTANCES;

/// The instances of a stage, with their points.
#[derive(Clone, Copy)]
pub struct Instances<'a> {
    pub spec: &'a Spec,
    pub points: &'a Points,
    pub ids: IdRange<InstanceId>,
}

impl<'a> Instances<'a> {
    /// The place of an instance among those of its stage.
    pub fn place(&self, id: InstanceId) -> usize {
        id.place() - self.ids.start()
    }

    /// The value of an axis, given by its number.
    pub fn value(&self, axis: usize, id: InstanceId) -> &'a Value {
        self.points.value(self.spec, axis, self.place(id))
    }
}

/// What one source brings: for each point of its axes, the instances that it stands for.
///
/// A one port brings a single instance per point; a many port has gathered some axes into the list.
pub struct Piece<'a> {
    /// Who brings it, for messages: `input "frames" (shots.frames)`.
    pub label: String,
    pub of: Instances<'a>,
    pub names: Vec<String>,
    /// The numbers of `names` among the axes of the source.
    axes: Vec<usize>,
    /// Of one point after the other, in the order of the points' texts; of one point in order of the values of all axes.
    pub ids: Vec<InstanceId>,
    /// Where the instances of a point end, if not each has one.
    pub ends: Option<Vec<usize>>,
    texts: Texts,
}

impl<'a> Piece<'a> {
    /// Groups the `chosen` instances of a source by the axes `names`, lists in order of the values of all axes.
    pub fn gather(label: String, of: Instances<'a>, mut chosen: Vec<InstanceId>, names: Vec<String>) -> Self {
        let axes: Vec<usize> = names.iter().map(|name| of.points.axis(name).expect("its own axis")).collect();
        if axes.len() < of.points.names().len() {
            // By value, so that the order in which a foreach lists its values does not enter the key.
            let all = 0..of.points.names().len();
            let compare = |a: InstanceId, b: InstanceId| {
                let mut orders = all.clone().map(|axis| compare_values(of.value(axis, a), of.value(axis, b)));
                orders.find(|order| order.is_ne()).unwrap_or(Ordering::Equal)
            };
            chosen.sort_by(|a, b| compare(*a, *b));
        }
        if names.is_empty() {
            let ends = (chosen.len() != 1).then(|| vec![chosen.len()]);
            let mut texts = Texts::default();
            texts.end();
            return Self { label, of, names, axes, ids: chosen, ends, texts };
        }
        let mut texts = Texts::default();
        for &id in &chosen {
            texts.push(axes.iter().map(|&axis| of.value(axis, id)));
        }
        let order = texts.order();
        let mut sorted = Texts::default();
        let mut ends = Vec::new();
        for (n, &at) in order.iter().enumerate() {
            let text = texts.get(at as usize);
            if n == 0 || sorted.last() != text {
                ends.extend((n > 0).then_some(n));
                sorted.all.push_str(text);
                sorted.end();
            }
        }
        ends.extend((!order.is_empty()).then_some(order.len()));
        let ids: Vec<InstanceId> = order.iter().map(|&at| chosen[at as usize]).collect();
        let single = ends.len() == ids.len();
        Self { label, of, names, axes, ids, ends: (!single).then_some(ends), texts: sorted }
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.ends.as_ref().map_or(self.ids.len(), Vec::len)
    }

    /// The first instance of a point.
    pub fn first(&self, entry: usize) -> InstanceId {
        self.ids[self.ends.as_ref().map_or(entry, |ends| entry.checked_sub(1).map_or(0, |before| ends[before]))]
    }

    /// The text of some axes of a point, given by their places among `names`.
    fn text(&self, entry: usize, places: impl Iterator<Item = usize>) -> String {
        let (mut text, id) = (String::new(), self.first(entry));
        push_point(&mut text, places.map(|place| self.of.value(self.axes[place], id)));
        text
    }
}

/// Texts of points, one after the other.
#[derive(Default, PartialEq)]
struct Texts {
    all: String,
    ends: Vec<usize>,
}

impl Texts {
    fn push<'v>(&mut self, values: impl Iterator<Item = &'v Value>) {
        push_point(&mut self.all, values);
        self.end();
    }

    fn end(&mut self) {
        self.ends.push(self.all.len());
    }

    fn get(&self, at: usize) -> &str {
        &self.all[at.checked_sub(1).map_or(0, |before| self.ends[before])..self.ends[at]]
    }

    fn last(&self) -> &str {
        self.ends.len().checked_sub(1).map_or("", |last| self.get(last))
    }

    /// Their places in order; equal ones as they came.
    fn order(&self) -> Vec<u32> {
        // Most are told apart by their first letters.
        let head = |at: u32| {
            let (text, mut head) = (self.get(at as usize).as_bytes(), [0; 8]);
            let length = text.len().min(8);
            head[..length].copy_from_slice(&text[..length]);
            u64::from_be_bytes(head)
        };
        let mut order: Vec<(u64, u32)> = (0..self.ends.len() as u32).map(|at| (head(at), at)).collect();
        let text = |at: u32| self.get(at as usize);
        order.sort_unstable_by(|a, b| a.0.cmp(&b.0).then_with(|| text(a.1).cmp(text(b.1))).then(a.1.cmp(&b.1)));
        order.into_iter().map(|(_, at)| at).collect()
    }
}

/// One text for one point of some axes.
fn push_point<'v>(text: &mut String, values: impl Iterator<Item = &'v Value>) {
    for (i, value) in values.enumerate() {
        if i > 0 {
            text.push('\u{1f}');
        }
        push_value(text, value);
    }
}

/// The rows of a join: one instance for each, or as many as the stage's own `foreach` makes of it.
pub struct Joined {
    /// The axes, each with the piece that brings it.
    pub names: Vec<(String, usize)>,
    /// Of each piece the points that the rows take.
    pub picks: Vec<Picks>,
    pub rows: usize,
}

/// Which point of a piece each row takes.
pub enum Picks {
    /// One after the other.
    All,
    /// The only one.
    Only,
    These(Vec<u32>),
}

impl Picks {
    pub fn at(&self, row: usize) -> usize {
        match self {
            Self::All => row,
            Self::Only => 0,
            Self::These(points) => points[row] as usize,
        }
    }
}

/// Why pieces do not join.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum NotJoined {
    /// Of two pieces each has an axis that the other has not; `product: true` asks for every combination.
    Apart {
        pieces: [String; 2],
        axes: [String; 2],
    },
    /// A piece has nothing at a point of an axis that both have.
    Lacks {
        piece: String,
        point: String,
        other: String,
    },
    /// A piece has a point more than another on an axis that both have.
    Exceeds {
        piece: String,
        point: String,
        other: String,
    },
    TooMany,
}

impl NotJoined {
    /// The way out, where there is one.
    pub fn hint(&self) -> Option<String> {
        let apart = matches!(self, Self::Apart { .. });
        apart.then(|| "say `product: true` to take every combination".to_owned())
    }
}

impl fmt::Display for NotJoined {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Apart { pieces: [a, b], axes: [of_a, of_b] } => {
                write!(f, "{a} has the axes {of_a}, {b} has the axes {of_b}: neither contains the other")
            }
            Self::Lacks { piece, point, other } => write!(f, "{piece} has nothing at {point}, which {other} has"),
            Self::Exceeds { piece, point, other } => write!(f, "{piece} has {point}, which {other} does not have"),
            Self::TooMany => write!(f, "the axes of its inputs make more than {MAX_INSTANCES} instances"),
        }
    }
}

/// Joins by value: equal names are the same axis; a piece without an axis is broadcast along it.
///
/// Errors: two pieces with different axes (unless `product`), axes whose values differ, too many points.
pub fn join(pieces: &[Piece<'_>], product: bool) -> Result<Joined, NotJoined> {
    if !product {
        nested(pieces)?;
    }
    let mut order: Vec<usize> = (0..pieces.len()).collect();
    order.sort_by_key(|&i| std::cmp::Reverse(pieces[i].names.len()));
    let picks = pieces.iter().map(|_| Picks::Only).collect();
    let mut joined = Joined { names: Vec::new(), picks, rows: 1 };
    for (done, &index) in order.iter().enumerate() {
        let (piece, first) = (&pieces[index], &pieces[order[0]]);
        let all_of_first = matches!(joined.picks[order[0]], Picks::All) && joined.rows == first.len();
        if done == 0 && !piece.names.is_empty() {
            (joined.picks[index], joined.rows) = (Picks::All, piece.len());
            joined.names = piece.names.iter().map(|name| (name.clone(), index)).collect();
        } else if piece.names.is_empty() {
            joined.picks[index] = Picks::Only;
        } else if all_of_first && joined.names.len() == first.names.len() && piece.is_along(first) {
            joined.picks[index] = Picks::All;
        } else {
            joined.add(pieces, &order[..done], index)?;
        }
        if joined.rows > MAX_INSTANCES {
            return Err(NotJoined::TooMany);
        }
    }
    Ok(joined)
}

impl Piece<'_> {
    /// Whether it has the same points as another one, in the same order.
    fn is_along(&self, other: &Self) -> bool {
        self.names == other.names && self.texts == other.texts
    }
}

impl Joined {
    /// Joins one more piece to those that were joined before.
    fn add(&mut self, pieces: &[Piece<'_>], before: &[usize], index: usize) -> Result<(), NotJoined> {
        let piece = &pieces[index];
        let place = |name: &String| piece.names.iter().position(|own| own == name);
        // The axes that both have: the piece that brought it, its place there, its place here.
        let shared: Vec<(usize, usize, usize)> = self
            .names
            .iter()
            .filter_map(|(name, by)| {
                let there = pieces[*by].names.iter().position(|own| own == name).expect("it brought the axis");
                Some((*by, there, place(name)?))
            })
            .collect();
        let mut by_shared: HashMap<String, (Vec<u32>, bool)> = HashMap::new();
        for entry in 0..piece.len() {
            let text = piece.text(entry, shared.iter().map(|&(_, _, here)| here));
            by_shared.entry(text).or_default().0.push(entry as u32);
        }
        let other = || pieces[before[before.len() - 1]].label.clone();
        // Which row of those before, and which point of the piece, each row takes.
        let (mut rows, mut points) = (Vec::new(), Vec::new());
        for row in 0..self.rows {
            let value = |&(by, there, _): &(usize, usize, usize)| {
                let (piece, entry) = (&pieces[by], self.picks[by].at(row));
                piece.of.value(piece.axes[there], piece.first(entry))
            };
            let mut key = String::new();
            push_point(&mut key, shared.iter().map(value));
            let Some((entries, met)) = by_shared.get_mut(&key) else {
                let text =
                    |s: &(usize, usize, usize)| format!("{} = {}", piece.names[s.2], crate::key::value_text(value(s)));
                let point = shared.iter().map(text).collect::<Vec<_>>().join(", ");
                return Err(NotJoined::Lacks { piece: piece.label.clone(), point, other: other() });
            };
            *met = true;
            if rows.len() + entries.len() > MAX_INSTANCES {
                return Err(NotJoined::TooMany);
            }
            rows.extend(std::iter::repeat_n(row as u32, entries.len()));
            points.extend(entries.iter().copied());
        }
        if let Some(key) = by_shared.iter().filter(|(_, (_, met))| !met).map(|(key, _)| key).min() {
            let names: Vec<&str> = shared.iter().map(|&(_, _, here)| piece.names[here].as_str()).collect();
            let point = format!("{} = {}", names.join(", "), key.replace('\u{1f}', ", "));
            return Err(NotJoined::Exceeds { piece: piece.label.clone(), point, other: other() });
        }
        for &by in before.iter().filter(|&&by| !pieces[by].names.is_empty()) {
            let picks = rows.iter().map(|&row| self.picks[by].at(row as usize) as u32).collect();
            self.picks[by] = Picks::These(picks);
        }
        (self.picks[index], self.rows) = (Picks::These(points), rows.len());
        let is_new = |name: &&String| self.names.iter().all(|(known, _)| known != *name);
        let fresh: Vec<(String, usize)> = piece.names.iter().filter(is_new).map(|name| (name.clone(), index)).collect();
        self.names.extend(fresh);
        Ok(())
    }
}

/// Any two pieces must have nested axes, else the user has to ask for the product.
fn nested(pieces: &[Piece<'_>]) -> Result<(), NotJoined> {
    for (i, a) in pieces.iter().enumerate() {
        for b in &pieces[i + 1..] {
            let within = |x: &Piece<'_>, y: &Piece<'_>| x.names.iter().all(|n| y.names.contains(n));
            if !within(a, b) && !within(b, a) {
                let both = [a, b];
                return Err(NotJoined::Apart {
                    pieces: both.map(|piece| piece.label.clone()),
                    axes: both.map(|piece| piece.names.join(", ")),
                });
            }
        }
    }
    Ok(())
}

fn compare_values(a: &Value, b: &Value) -> Ordering {
    match (a.as_f64(), b.as_f64()) {
        (Some(a), Some(b)) => a.total_cmp(&b),
        _ => crate::key::value_text(a).cmp(&crate::key::value_text(b)),
    }
}

/// Whether an axis value is the one that `where` asks for; 1 and 1.0 are the same.
pub fn same_value(a: &Value, b: &Value) -> bool {
    compare_values(a, b).is_eq()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::ids::StageId;
    use crate::spec;

    /// A stage for each list of points, on axes of these names.
    fn spec_of(stages: &[(&[&str], &[&[i32]])]) -> Spec {
        let mut text = "pipeline: p\nstages:\n".to_owned();
        for (i, (names, points)) in stages.iter().enumerate() {
            text.push_str(&format!("  s{i}:\n    use: scene\n"));
            if names.is_empty() {
                continue;
            }
            text.push_str("    foreach:\n");
            for (at, name) in names.iter().enumerate() {
                let values: Vec<String> = points.iter().map(|point| point[at].to_string()).collect();
                text.push_str(&format!("      {name}: [{}]\n", values.join(", ")));
            }
            if names.len() > 1 {
                text.push_str(&format!("      zip: [[{}]]\n", names.join(", ")));
            }
        }
        let (spec, report) = spec::read_bytes(Path::new("p.yaml"), text.as_bytes(), &[]);
        assert!(!report.has_errors(), "{text}");
        spec.expect("it is whole")
    }

    fn points_of(spec: &Spec) -> Vec<Points> {
        spec.stages.iter_ids().map(|(stage, found)| Points::of(stage, &found.foreach, 1)).collect()
    }

    fn pieces<'a>(spec: &'a Spec, points: &'a [Points], names: &[&[&str]]) -> Vec<Piece<'a>> {
        let piece = |(stage, names): (StageId, &&[&str])| {
            let points = &points[stage.place()];
            let of = Instances { spec, points, ids: IdRange::new(0, points.len()) };
            let label = ["a", "b", "c"][stage.place()].to_owned();
            Piece::gather(label, of, of.ids.collect(), names.iter().map(|n| (*n).to_owned()).collect())
        };
        spec.stages.ids().zip(names).map(piece).collect()
    }

    fn values(joined: &Joined, pieces: &[Piece<'_>], row: usize, piece: usize) -> Vec<i64> {
        let (piece, picks) = (&pieces[piece], &joined.picks[piece]);
        let id = piece.first(picks.at(row));
        piece.axes.iter().map(|&axis| piece.of.value(axis, id).as_i64().unwrap()).collect()
    }

    #[test]
    fn equal_names_join_by_value_and_missing_axes_are_broadcast() {
        let b: &[&[i32]] = &[&[2, 7], &[1, 7], &[1, 8], &[2, 8]];
        let spec = spec_of(&[(&["m"], &[&[1], &[2]]), (&["m", "s"], b), (&[], &[])]);
        let points = points_of(&spec);
        let pieces = pieces(&spec, &points, &[&["m"], &["m", "s"], &[]]);
        let joined = join(&pieces, false).unwrap();
        let names: Vec<&str> = joined.names.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!((names, joined.rows), (vec!["m", "s"], 4));
        for row in 0..4 {
            let own = values(&joined, &pieces, row, 1);
            assert_eq!(values(&joined, &pieces, row, 0), own[..1]);
            assert_eq!(joined.picks[2].at(row), 0);
        }
        let rows: Vec<Vec<i64>> = (0..4).map(|row| values(&joined, &pieces, row, 1)).collect();
        assert_eq!(rows, [[1, 7], [1, 8], [2, 7], [2, 8]]);
    }

    #[test]
    fn different_axes_need_a_product() {
        let spec = spec_of(&[(&["m"], &[&[1], &[2]]), (&["s"], &[&[7], &[8], &[9]])]);
        let points = points_of(&spec);
        let pieces = pieces(&spec, &points, &[&["m"], &["s"]]);
        let apart = join(&pieces, false).err().unwrap();
        let [both, axes] = [["a", "b"], ["m", "s"]].map(|words| words.map(str::to_owned));
        assert_eq!(apart, NotJoined::Apart { pieces: both, axes });
        assert!(apart.hint().is_some_and(|hint| hint.contains("product")));
        let joined = join(&pieces, true).unwrap();
        let rows: Vec<_> =
            (0..joined.rows).map(|row| [0, 1].map(|piece| values(&joined, &pieces, row, piece)[0])).collect();
        assert_eq!(rows, [[1, 7], [1, 8], [1, 9], [2, 7], [2, 8], [2, 9]]);
    }

    #[test]
    fn other_values_on_a_shared_axis_are_an_error() {
        let told = |b: &[&[i32]]| {
            let spec = spec_of(&[(&["m"], &[&[1], &[2]]), (&["m"], b)]);
            let points = points_of(&spec);
            join(&pieces(&spec, &points, &[&["m"], &["m"]]), false).err().unwrap()
        };
        assert_eq!(told(&[&[1]]).to_string(), "b has nothing at m = 2, which a has");
        assert_eq!(told(&[&[1], &[2], &[3]]).to_string(), "b has m = 3, which a does not have");
        // Only axes that are apart have a product as their way out.
        assert_eq!(told(&[&[1]]).hint(), None);
    }

    #[test]
    fn gathering_sorts_by_value() {
        let spec = spec_of(&[(&["a", "b"], &[&[3, 1], &[1, 1], &[2, 2], &[1, 2]])]);
        let points = points_of(&spec);
        let piece = &pieces(&spec, &points, &[&["b"]])[0];
        assert_eq!(piece.ids, [1, 0, 3, 2].map(InstanceId::new));
        assert_eq!(piece.ends, Some(vec![2, 4]));
    }

    /// Points stand in the order of their texts, as labels do in a sorted list: 10 before 9.
    #[test]
    fn points_stand_in_the_order_of_their_texts() {
        let spec = spec_of(&[(&["a"], &[&[9], &[100], &[10], &[-1]])]);
        let points = points_of(&spec);
        let piece = &pieces(&spec, &points, &[&["a"]])[0];
        assert_eq!((&piece.ids, &piece.ends), (&[3, 2, 1, 0].map(InstanceId::new).to_vec(), &None));
    }
}
