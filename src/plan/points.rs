//! At which point of its axes each instance of a stage stands, without a copy of the values: they stay where a `foreach` lists them.

use std::sync::Arc;

use serde_json::Value;

use crate::ids::StageId;
use crate::spec::{Foreach, Spec};

/// The points of a stage's instances, by their places among them.
#[derive(Clone, Debug, Default)]
pub struct Points {
    /// Sorted by name.
    axes: Vec<Axis>,
    rows: Vec<Rows>,
    count: usize,
}

/// An axis: the column in which the `foreach` of a stage lists its values, and by which of `Points::rows` an instance finds its own.
#[derive(Clone, Debug)]
struct Axis {
    name: String,
    stage: StageId,
    column: usize,
    rows: usize,
}

/// Which row of a `foreach` each instance has.
#[derive(Clone, Debug)]
struct Rows {
    /// So many neighbours have the same row.
    each: usize,
    list: List,
}

#[derive(Clone, Debug)]
enum List {
    /// One after the other, and after so many from the first again.
    Around(usize),
    These(Arc<[u32]>),
}

impl Rows {
    fn at(&self, place: usize) -> usize {
        match &self.list {
            List::Around(count) => place / self.each % count,
            List::These(rows) => rows[place / self.each] as usize,
        }
    }
}

/// Where the points of a join come from: the instances of one source, as many as the join has rows.
pub enum Places {
    /// All instances of the source, in their order.
    All,
    These(Vec<u32>),
}

impl Points {
    /// The points that a stage's own `foreach` adds to each of `count` rows, with none of their axes yet.
    pub fn of(stage: StageId, foreach: &Foreach, count: usize) -> Self {
        let own = foreach.rows.len();
        let axis = |(column, name): (usize, &String)| Axis { name: name.clone(), stage, column, rows: 0 };
        let mut axes: Vec<Axis> = foreach.names.iter().enumerate().map(axis).collect();
        axes.sort_by(|a, b| a.name.cmp(&b.name));
        Self { axes, rows: vec![Rows { each: 1, list: List::Around(own) }], count: count * own }
    }

    /// Adds the axes of these names, which the rows of the join take from instances of a source.
    ///
    /// # Panics
    /// Where the source has no such axis.
    pub fn take(&mut self, names: &[&str], from: &Self, places: &Places, each: usize) {
        // Axes of one `foreach` have their rows in common.
        let mut known: Vec<Option<usize>> = vec![None; from.rows.len()];
        for name in names {
            let axis = &from.axes[from.axis(name).unwrap_or_else(|| panic!("the source has no axis {name}"))];
            let rows = *known[axis.rows].get_or_insert_with(|| {
                let rows = &from.rows[axis.rows];
                self.rows.push(match places {
                    Places::All if rows.each == 1 => Rows { each, list: rows.list.clone() },
                    Places::All => {
                        let list = (0..from.count).map(|place| rows.at(place) as u32).collect();
                        Rows { each, list: List::These(list) }
                    }
                    Places::These(places) => {
                        let list = places.iter().map(|&place| rows.at(place as usize) as u32).collect();
                        Rows { each, list: List::These(list) }
                    }
                });
                self.rows.len() - 1
            });
            self.axes.push(Axis { rows, ..axis.clone() });
        }
        self.axes.sort_by(|a, b| a.name.cmp(&b.name));
    }

    pub fn len(&self) -> usize {
        self.count
    }

    /// The names of the axes, sorted.
    pub fn names(&self) -> impl ExactSizeIterator<Item = &String> {
        self.axes.iter().map(|axis| &axis.name)
    }

    /// The number of an axis, in the order of the names.
    pub fn axis(&self, name: &str) -> Option<usize> {
        self.axes.binary_search_by(|axis| axis.name.as_str().cmp(name)).ok()
    }

    /// The value of an axis, given by its number.
    pub fn value<'s>(&self, spec: &'s Spec, axis: usize, place: usize) -> &'s Value {
        let Axis { stage, column, rows, .. } = &self.axes[axis];
        &spec.stages[*stage].foreach.rows[self.rows[*rows].at(place)][*column]
    }

    /// All axes of an instance with their values, sorted by name.
    pub fn at<'a>(&'a self, spec: &'a Spec, place: usize) -> impl Iterator<Item = (&'a String, &'a Value)> + Clone {
        self.axes.iter().enumerate().map(move |(axis, found)| (&found.name, self.value(spec, axis, place)))
    }
}
