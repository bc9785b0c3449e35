//! Joining the axes of a stage's inputs: which instances the stage has, and which inputs each of them takes.

use std::cmp::Ordering;
use std::collections::{BTreeMap, BTreeSet, HashMap};

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

/// Joins by value: equal names are the same axis; a piece without an axis is broadcast along it.
///
/// Errors: two pieces with different axes (unless `product`), axes whose values differ, too many points.
pub fn join(pieces: &[Piece], product: bool) -> Result<(Vec<String>, Vec<Joined>), String> {
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
                return Err(format!(
                    "{} has nothing at {}, which {} has",
                    piece.label,
                    point.collect::<Vec<_>>().join(", "),
                    pieces[order[done - 1]].label
                ));
            };
            met.insert(key);
            if next.len() + entries.len() > MAX_INSTANCES {
                return Err(format!("the axes of its inputs make more than {MAX_INSTANCES} instances"));
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
            return Err(format!(
                "{} has {} = {}, which {} does not have",
                piece.label,
                names.join(", "),
                key.replace('\u{1f}', ", "),
                pieces[order[done - 1]].label
            ));
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
fn nested(pieces: &[Piece]) -> Result<(), String> {
    for (i, a) in pieces.iter().enumerate() {
        for b in &pieces[i + 1..] {
            let within = |x: &Piece, y: &Piece| x.names.iter().all(|n| y.names.contains(n));
            if !within(a, b) && !within(b, a) {
                return Err(format!(
                    "{} has the axes {}, {} has the axes {}: neither contains the other",
                    a.label,
                    a.names.join(", "),
                    b.label,
                    b.names.join(", ")
                ));
            }
        }
    }
    Ok(())
}

/// Groups the instances of a source by the axes that remain after `gathered` are taken out, lists in order of values.
pub fn gather(instances: &[(usize, &Axes)], gathered: &BTreeSet<String>) -> (Vec<String>, Vec<Entry>) {
    let names: Vec<String> = instances
        .first()
        .map(|(_, axes)| axes.keys().filter(|n| !gathered.contains(*n)).cloned().collect())
        .unwrap_or_default();
    let mut sorted: Vec<&(usize, &Axes)> = instances.iter().collect();
    // By value, so that the order in which a foreach lists its values does not enter the key.
    sorted.sort_by(|a, b| compare_axes(a.1, b.1));
    let mut groups: BTreeMap<String, (Vec<Value>, Vec<usize>)> = BTreeMap::new();
    for (id, axes) in sorted {
        let values: Vec<Value> = names.iter().map(|n| axes[n].clone()).collect();
        groups.entry(point_key(values.iter())).or_insert_with(|| (values, Vec::new())).1.push(*id);
    }
    (names, groups.into_values().collect())
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
        let message = join(&pieces, false).unwrap_err();
        assert!(message.contains("a has the axes m") && message.contains("b has the axes s"), "{message}");
        assert_eq!(join(&pieces, true).unwrap().1.len(), 6);
    }

    #[test]
    fn other_values_on_a_shared_axis_are_an_error() {
        let a = || piece("a", &["m"], &[&[1], &[2]]);
        assert!(join(&[a(), piece("b", &["m"], &[&[1]])], false).unwrap_err().contains("nothing at m = 2"));
        assert!(join(&[a(), piece("b", &["m"], &[&[1], &[2], &[3]])], false).unwrap_err().contains("m = 3"));
    }

    #[test]
    fn gathering_sorts_by_value() {
        let points: Vec<Axes> = [[3, 1], [1, 1], [2, 2], [1, 2]]
            .iter()
            .map(|p| [("a".to_owned(), json!(p[0])), ("b".to_owned(), json!(p[1]))].into())
            .collect();
        let instances: Vec<(usize, &Axes)> = points.iter().enumerate().collect();
        let (names, groups) = gather(&instances, &["a".to_owned()].into());
        assert_eq!(names, ["b"]);
        assert_eq!(groups, vec![(vec![json!(1)], vec![1, 0]), (vec![json!(2)], vec![3, 2])]);
    }
}
