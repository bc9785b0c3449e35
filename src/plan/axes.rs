//! Joining the axes of a stage's inputs: which instances the stage has, and which inputs each of them takes.

use std::cmp::Ordering;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::fmt;

use serde_json::Value;
use turbid_contract::Axes;

use crate::key::value_text;

/// More instances than this are a mistake in the file.
pub const MAX_INSTANCES: usize = 1_000_000;

/// What one source brings: for each point of its axes, the instances that it stands for.
///
/// A one port brings a single instance per point; a many port has gathered some axes into the list.
#[derive(Debug)]
pub struct Piece {
    /// Who brings it, for messages: `input "frames" (shots.frames)`.
    pub label: String,
    pub names: Vec<String>,
    pub entries: Vec<Entry>,
}

/// A point of some axes (their values in the order of the names), and the instances that stand there.
pub type Entry = (Vec<Value>, Vec<usize>);

/// One instance: its axes, and for each piece the index of the entry it takes.
#[derive(Debug, PartialEq)]
pub struct Joined {
    pub axes: Axes,
    pub picks: Vec<usize>,
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
pub fn join(pieces: &[Piece], product: bool) -> Result<(Vec<String>, Vec<Joined>), NotJoined> {
    if !product {
        nested(pieces)?;
    }
    let mut order: Vec<usize> = (0..pieces.len()).collect();
    order.sort_by_key(|&i| std::cmp::Reverse(pieces[i].names.len()));

    let mut names: Vec<String> = Vec::new();
    // Values of `names`, and the picks in the sequence of `order`.
    let mut rows: Vec<(Vec<Value>, Vec<usize>)> = vec![(Vec::new(), Vec::new())];
    for (done, &index) in order.iter().enumerate() {
        let piece = &pieces[index];
        let shared: Vec<(usize, usize)> = names
            .iter()
            .enumerate()
            .filter_map(|(mine, name)| piece.names.iter().position(|n| n == name).map(|theirs| (mine, theirs)))
            .collect();
        let fresh: Vec<usize> = (0..piece.names.len()).filter(|i| shared.iter().all(|(_, t)| t != i)).collect();
        let mut by_shared: HashMap<String, Vec<usize>> = HashMap::new();
        for (entry, (values, _)) in piece.entries.iter().enumerate() {
            by_shared.entry(point_key(shared.iter().map(|&(_, t)| &values[t]))).or_default().push(entry);
        }
        let mut met = BTreeSet::new();
        let mut next = Vec::with_capacity(rows.len());
        for (values, picks) in &rows {
            let key = point_key(shared.iter().map(|&(m, _)| &values[m]));
            let Some(entries) = by_shared.get(&key) else {
                let point = shared.iter().map(|&(m, _)| format!("{} = {}", names[m], value_text(&values[m])));
                let point = point.collect::<Vec<_>>().join(", ");
                let other = pieces[order[done - 1]].label.clone();
                return Err(NotJoined::Lacks { piece: piece.label.clone(), point, other });
            };
            met.insert(key);
            if next.len() + entries.len() > MAX_INSTANCES {
                return Err(NotJoined::TooMany);
            }
            for &entry in entries {
                let mut values = values.clone();
                values.extend(fresh.iter().map(|&i| piece.entries[entry].0[i].clone()));
                let mut picks = picks.clone();
                picks.push(entry);
                next.push((values, picks));
            }
        }
        if let Some(key) = by_shared.keys().filter(|key| !met.contains(*key)).min() {
            let names: Vec<&str> = shared.iter().map(|&(_, t)| piece.names[t].as_str()).collect();
            let point = format!("{} = {}", names.join(", "), key.replace('\u{1f}', ", "));
            let other = pieces[order[done - 1]].label.clone();
            return Err(NotJoined::Exceeds { piece: piece.label.clone(), point, other });
        }
        names.extend(fresh.iter().map(|&i| piece.names[i].clone()));
        rows = next;
    }
    let joined = rows
        .into_iter()
        .map(|(values, picks)| {
            let mut by_piece = vec![0; pieces.len()];
            for (&piece, pick) in order.iter().zip(picks) {
                by_piece[piece] = pick;
            }
            Joined { axes: names.iter().cloned().zip(values).collect(), picks: by_piece }
        })
        .collect();
    Ok((names, joined))
}

/// Any two pieces must have nested axes, else the user has to ask for the product.
fn nested(pieces: &[Piece]) -> Result<(), NotJoined> {
    for (i, a) in pieces.iter().enumerate() {
        for b in &pieces[i + 1..] {
            let within = |x: &Piece, y: &Piece| x.names.iter().all(|n| y.names.contains(n));
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

/// Groups the instances of a source by the axes `names`, lists in order of the values of all axes.
pub fn gather(instances: &[(usize, &Axes)], names: &[String]) -> Vec<Entry> {
    let mut sorted: Vec<&(usize, &Axes)> = instances.iter().collect();
    // By value, so that the order in which a foreach lists its values does not enter the key.
    sorted.sort_by(|a, b| compare_axes(a.1, b.1));
    let mut groups: BTreeMap<String, (Vec<Value>, Vec<usize>)> = BTreeMap::new();
    for (id, axes) in sorted {
        let values = || names.iter().map(|n| &axes[n]);
        let group = groups.entry(point_key(values())).or_insert_with(|| (values().cloned().collect(), Vec::new()));
        group.1.push(*id);
    }
    groups.into_values().collect()
}

/// Order of two points that have the same axes.
fn compare_axes(a: &Axes, b: &Axes) -> Ordering {
    a.values().zip(b.values()).map(|(a, b)| compare_values(a, b)).find(|o| o.is_ne()).unwrap_or(Ordering::Equal)
}

fn compare_values(a: &Value, b: &Value) -> Ordering {
    match (a.as_f64(), b.as_f64()) {
        (Some(a), Some(b)) => a.total_cmp(&b),
        _ => value_text(a).cmp(&value_text(b)),
    }
}

/// Whether an axis value is the one that `where` asks for; 1 and 1.0 are the same.
pub fn same_value(a: &Value, b: &Value) -> bool {
    compare_values(a, b).is_eq()
}

fn point_key<'a>(values: impl Iterator<Item = &'a Value>) -> String {
    values.map(value_text).collect::<Vec<_>>().join("\u{1f}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn piece(label: &str, names: &[&str], points: &[&[i32]]) -> Piece {
        Piece {
            label: label.into(),
            names: names.iter().map(|n| (*n).to_owned()).collect(),
            entries: points.iter().enumerate().map(|(i, p)| (p.iter().map(|v| json!(v)).collect(), vec![i])).collect(),
        }
    }

    #[test]
    fn equal_names_join_by_value_and_missing_axes_are_broadcast() {
        let pieces = [
            piece("a", &["m"], &[&[1], &[2]]),
            piece("b", &["m", "s"], &[&[2, 7], &[1, 7], &[1, 8], &[2, 8]]),
            piece("c", &[], &[&[]]),
        ];
        let (names, rows) = join(&pieces, false).unwrap();
        assert_eq!(names, ["m", "s"]);
        assert_eq!(rows.len(), 4);
        for row in &rows {
            assert_eq!(pieces[0].entries[row.picks[0]].0[0], row.axes["m"]);
            assert_eq!(pieces[1].entries[row.picks[1]].0, [row.axes["m"].clone(), row.axes["s"].clone()]);
            assert_eq!(row.picks[2], 0);
        }
    }

    #[test]
    fn different_axes_need_a_product() {
        let pieces = [piece("a", &["m"], &[&[1], &[2]]), piece("b", &["s"], &[&[7], &[8], &[9]])];
        let apart = join(&pieces, false).unwrap_err();
        let [both, axes] = [["a", "b"], ["m", "s"]].map(|words| words.map(str::to_owned));
        assert_eq!(apart, NotJoined::Apart { pieces: both, axes });
        assert!(apart.hint().is_some_and(|hint| hint.contains("product")));
        assert_eq!(join(&pieces, true).unwrap().1.len(), 6);
    }

    #[test]
    fn other_values_on_a_shared_axis_are_an_error() {
        let a = || piece("a", &["m"], &[&[1], &[2]]);
        let told = |b: &[&[i32]]| join(&[a(), piece("b", &["m"], b)], false).unwrap_err();
        assert_eq!(told(&[&[1]]).to_string(), "b has nothing at m = 2, which a has");
        assert_eq!(told(&[&[1], &[2], &[3]]).to_string(), "b has m = 3, which a does not have");
        // Its name may say what it likes: only axes that are apart have a product as their way out.
        let odd = piece("neither contains the other", &["m"], &[&[1]]);
        assert_eq!(join(&[a(), odd], false).unwrap_err().hint(), None);
    }

    #[test]
    fn gathering_sorts_by_value() {
        let points: Vec<Axes> = [[3, 1], [1, 1], [2, 2], [1, 2]]
            .iter()
            .map(|p| [("a".to_owned(), json!(p[0])), ("b".to_owned(), json!(p[1]))].into())
            .collect();
        let instances: Vec<(usize, &Axes)> = points.iter().enumerate().collect();
        let groups = gather(&instances, &["b".to_owned()]);
        assert_eq!(groups, vec![(vec![json!(1)], vec![1, 0]), (vec![json!(2)], vec![3, 2])]);
    }
}
