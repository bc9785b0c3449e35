//! `index.parquet`: a row per raw index, with its split, its place in a shard or why it has none; `costs.parquet` beside it.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::ops::Range;

use serde_json::Value;
use turbid_contract::{Cells, Table};
use turbid_draw::Type;

use super::format::Format;
use super::shard::Sample;
use crate::key::value_text;
use crate::plan::StageId;
use crate::spec::Draw;

/// What became of a point.
#[derive(Clone, Copy, Debug)]
pub struct Point {
    /// Raw index.
    pub index: u64,
    pub seed: Option<u64>,
    pub cpu_s: f64,
    pub wall_s: f64,
    /// Place of its split, number of its shard.
    pub shard: (u16, u32),
    /// Row in the shard; where it is in none, the [reason](Points::reason).
    pub row: Result<u32, u32>,
}

/// What became of the points that were looked at, in columns: of a large set nothing is held twice.
#[derive(Default)]
pub struct Points {
    all: Vec<Point>,
    reasons: Vec<String>,
    /// Names of measures, STAGE.MEASURE, each with its values: NaN where a point has none.
    measures: Vec<(String, Vec<f64>)>,
    /// Which column a measure of a stage has, in the order in which its records name them.
    known: BTreeMap<StageId, Vec<(String, usize)>>,
}

/// Rows that are brought into a table at once.
const ROWS: usize = 8192;

impl Points {
    /// For so many points.
    pub fn for_points(n: usize) -> Self {
        Self { all: Vec::with_capacity(n), ..Self::default() }
    }

    /// How many points there are going to be.
    pub fn expected(&self) -> usize {
        self.all.capacity()
    }

    pub fn all(&self) -> &[Point] {
        &self.all
    }

    pub fn push(&mut self, point: Point) {
        self.all.push(point);
        let rows = self.all.len();
        self.measures.iter_mut().for_each(|(_, column)| column.resize(rows, f64::NAN));
    }

    /// The point that was pushed last, to be completed.
    pub fn last_mut(&mut self) -> Option<&mut Point> {
        self.all.last_mut()
    }

    /// A measure of the point that was pushed last; `place` is that of the measure in its record.
    pub fn measure(&mut self, stage: (StageId, &str), place: usize, measure: &str, value: f64) {
        let known = self.known.entry(stage.0).or_default();
        let found = known.get(place).filter(|(name, _)| name == measure);
        let found = found.or_else(|| known.iter().find(|(name, _)| name == measure)).map(|(_, column)| *column);
        let column = found.unwrap_or_else(|| {
            let mut column = Vec::with_capacity(self.all.capacity());
            column.resize(self.all.len(), f64::NAN);
            self.measures.push((format!("{}.{measure}", stage.1), column));
            known.push((measure.to_owned(), self.measures.len() - 1));
            self.measures.len() - 1
        });
        if let Some(cell) = self.measures[column].1.last_mut() {
            *cell = value;
        }
    }

    /// The number of a reason for which points are left out.
    pub fn number_of(&mut self, reason: &str) -> u32 {
        let found = self.reasons.iter().position(|known| known == reason);
        let place = found.unwrap_or_else(|| {
            self.reasons.push(reason.to_owned());
            self.reasons.len() - 1
        });
        place as u32
    }

    /// Why a point is in no shard.
    pub fn reason(&self, point: &Point) -> Option<&str> {
        point.row.err().map(|reason| self.reasons[reason as usize].as_str())
    }

    /// How many points are left out, by reason.
    pub fn rejects(&self) -> BTreeMap<String, u64> {
        let mut rejects: BTreeMap<String, u64> = BTreeMap::new();
        let mut counts = vec![0_u64; self.reasons.len()];
        self.all.iter().filter_map(|point| point.row.err()).for_each(|reason| counts[reason as usize] += 1);
        for (reason, n) in self.reasons.iter().zip(counts).filter(|(_, n)| *n > 0) {
            *rejects.entry(reason.clone()).or_default() += n;
        }
        rejects
    }

    /// How many points of a split are left out.
    pub fn rejected(&self, split: usize) -> u64 {
        self.all.iter().filter(|point| usize::from(point.shard.0) == split && point.row.is_err()).count() as u64
    }

    /// Places of the points by raw index.
    fn order(&self) -> Vec<u32> {
        let mut order: Vec<u32> = (0..self.all.len() as u32).collect();
        order.sort_unstable_by_key(|&at| self.all[at as usize].index);
        order
    }

    /// The table of all raw indices, piece by piece; those without a point have the condition that left them out, and no values.
    /// `splits` have their names and numbers of shards, which are of this format.
    /// `group` is the place of the drawn group that splits go by.
    pub fn tables<'a>(
        &'a self,
        draw: &'a Draw,
        group: Option<usize>,
        (splits, format): (&'a [(String, usize)], Format),
    ) -> impl Iterator<Item = Table> + 'a {
        let order = self.order();
        let mut columns: Vec<usize> = (0..self.measures.len()).collect();
        columns.sort_by_key(|&column| &self.measures[column].0);
        let mut at = 0;
        pieces(draw.n() as usize).map(move |piece| {
            let rows: Vec<Row<'_>> = piece
                .map(|index| {
                    let found = order.get(at).filter(|&&place| self.all[place as usize].index == index as u64);
                    at += usize::from(found.is_some());
                    Row::of(self, (draw, group), index as u64, found.map(|&place| place as usize))
                })
                .collect();
            self.table(draw, (splits, format), &columns, rows)
        })
    }

    fn table(
        &self,
        draw: &Draw,
        (splits, format): (&[(String, usize)], Format),
        columns: &[usize],
        rows: Vec<Row<'_>>,
    ) -> Table {
        let point = |row: &Row<'_>| row.place.map(|place| &self.all[place]);
        let split = |row: &Row<'_>| point(row).map_or_else(String::new, |p| splits[usize::from(p.shard.0)].0.clone());
        let file = |row: &Row<'_>| match point(row) {
            Some(Point { shard: (split, number), row: Ok(_), .. }) => {
                let (name, of) = &splits[usize::from(*split)];
                file_of(name, *number as usize, *of, format)
            }
            _ => String::new(),
        };
        let mut table = Table::default();
        table.push("id", "", Cells::Text(rows.iter().map(|row| Sample::id(row.index)).collect()));
        table.push("draw", "", Cells::I64(rows.iter().map(|row| row.index as i64).collect()));
        table.push("split", "", Cells::Text(rows.iter().map(split).collect()));
        table.push("group", "", Cells::MaybeF64(rows.iter().map(|row| row.group).collect()));
        for (place, (name, of)) in draw.names().zip(draw.types()).enumerate() {
            let value = |row: &Row<'_>| row.values.as_ref().map(|values| values[place].clone());
            let cells = match of {
                Type::Text => {
                    Cells::Text(rows.iter().map(|r| value(r).as_ref().map(value_text).unwrap_or_default()).collect())
                }
                Type::Float | Type::Integer => {
                    Cells::MaybeF64(rows.iter().map(|r| value(r).as_ref().and_then(Value::as_f64)).collect())
                }
            };
            table.push(name.to_owned(), "", cells);
        }
        let seed = |row: &Row<'_>| point(row).and_then(|p| p.seed).map(|seed| seed.to_string()).unwrap_or_default();
        table.push("seed", "", Cells::Text(rows.iter().map(seed).collect()));
        for &column in columns {
            let (name, values) = &self.measures[column];
            let value = |row: &Row<'_>| row.place.map(|place| values[place]).filter(|value| !value.is_nan());
            table.push(name.clone(), "", Cells::MaybeF64(rows.iter().map(value).collect()));
        }
        let row = |row: &Row<'_>| point(row).and_then(|p| p.row.ok()).map(f64::from);
        table.push("shard", "", Cells::Text(rows.iter().map(file).collect()));
        table.push("row", "", Cells::MaybeF64(rows.iter().map(row).collect()));
        table.push("reject", "", Cells::Text(rows.into_iter().map(|row| row.reject.into_owned()).collect()));
        table
    }

    /// CPU and wall seconds of each sample, piece by piece; no digest covers them.
    pub fn costs(&self) -> impl Iterator<Item = Table> + '_ {
        let order = self.order();
        pieces(order.len()).map(move |piece| {
            let points = || order[piece.clone()].iter().map(|&place| &self.all[place as usize]);
            let mut table = Table::default();
            table.push("id", "", Cells::Text(points().map(|point| Sample::id(point.index)).collect()));
            table.push("cpu_s", "s", Cells::F64(points().map(|point| point.cpu_s).collect()));
            table.push("wall_s", "s", Cells::F64(points().map(|point| point.wall_s).collect()));
            table
        })
    }
}

/// A row of the index while it is made.
struct Row<'p> {
    index: u64,
    /// Place among the points, where it was looked at.
    place: Option<usize>,
    values: Option<Vec<Value>>,
    group: Option<f64>,
    reject: Cow<'p, str>,
}

impl<'p> Row<'p> {
    fn of(points: &'p Points, (draw, group): (&Draw, Option<usize>), index: u64, place: Option<usize>) -> Self {
        let (values, reject) = match (draw.point(index), place) {
            (Ok(values), Some(place)) => (Some(values), points.reason(&points.all[place]).unwrap_or_default().into()),
            (Ok(values), None) => (Some(values), "not built".into()),
            (Err(reason), _) => (None, format!("only: {reason}").into()),
        };
        // Of points that were left unlooked at nothing is known but what was drawn.
        let place = place.filter(|_| values.is_some());
        let number = |at: usize| values.as_ref().filter(|_| place.is_some())?.get(at)?.as_i64();
        Self { index, place, group: group.and_then(number).map(|group| group as f64), values, reject }
    }
}

/// Ranges of at most [`ROWS`] rows; one that is empty where there are none.
fn pieces(n: usize) -> impl Iterator<Item = Range<usize>> {
    (0..n.div_ceil(ROWS).max(1)).map(move |piece| piece * ROWS..((piece + 1) * ROWS).min(n))
}

/// `data/train-00000-of-00004.parquet`
pub fn file_of(split: &str, number: usize, of: usize, format: Format) -> String {
    format!("data/{split}-{number:05}-of-{of:05}.{}", format.extension())
}
