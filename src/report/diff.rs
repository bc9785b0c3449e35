//! What two results differ in: what they were made from, what they cost, their numbers with z scores, their pictures.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use turbid_contract::ndarray::Array2;
use turbid_contract::payload::is_pictured;
use turbid_contract::{Artifact, Cells, ImageStack, Layer, LayerInfo, LayerKind, Table};

use crate::explain::{dependencies_of, differences};
use crate::preview::{self, Caption};
use crate::statistics::{self, label, shown_unit, significant};
use crate::store::{InstanceRecord, Recipe, Store};

use super::page::{Cell, Figure, Grid, Image};
use super::params::shortened;
use super::pictures::size;

/// Bytes of all pictures of a page.
const MOST_BYTES: usize = 1_300_000;
/// Rows of one table.
const MOST_ROWS: usize = 200;

/// A result and what went into it.
pub type Made = (InstanceRecord, Recipe);

/// One of the two: a run, a pipeline or an instance.
pub struct Side {
    /// As it was named.
    pub name: String,
    /// What it is: file, time, overrides.
    pub about: Vec<String>,
    /// Label, result, what went in; inputs first.
    pub instances: Vec<(String, Made)>,
    /// Labels of what has not run.
    pub missing: Vec<String>,
}

/// Two sides beside each other.
#[derive(Debug, Default)]
pub struct Comparison {
    pub names: [String; 2],
    pub about: [Vec<String>; 2],
    pub summary: Vec<String>,
    pub instances: Vec<Compared>,
}

/// A pair of instances whose results or origins differ.
#[derive(Debug, Default)]
pub struct Compared {
    pub label: String,
    /// What went in: field, A, B.
    pub origin: Grid,
    pub costs: Grid,
    /// Quantity, A, B, B - A, z.
    pub numbers: Vec<Grid>,
    /// For each layered output a row of three: A, B, difference.
    pub figures: Vec<Vec<Figure>>,
    pub notes: Vec<String>,
}

/// Compares what both have under the same label; a pair of single instances whatever they are called. Pictures where they are wanted.
pub fn compare(store: &Store, a: &Side, b: &Side, with_pictures: bool) -> Comparison {
    let mut found = Comparison {
        names: [a.name.clone(), b.name.clone()],
        about: [a.about.clone(), b.about.clone()],
        ..Comparison::default()
    };
    let single = a.instances.len() == 1 && b.instances.len() == 1;
    let by_label = |side: &Side| -> HashMap<String, usize> {
        side.instances.iter().enumerate().map(|(i, (label, _))| (label.clone(), i)).collect()
    };
    let (in_a, in_b) = (by_label(a), by_label(b));
    let pairs: Vec<(usize, usize)> = match single {
        true => vec![(0, 0)],
        false => a.instances.iter().enumerate().filter_map(|(i, (l, _))| Some((i, *in_b.get(l)?))).collect(),
    };
    let mut budget = if with_pictures { MOST_BYTES } else { 0 };
    let mut same = 0;
    let mut shared = false;
    for &(i, j) in &pairs {
        let ((of_a, one), (of_b, other)) = (&a.instances[i], &b.instances[j]);
        if one.0.key == other.0.key {
            same += 1;
            continue;
        }
        shared |= one.0.seed.is_some() && one.0.seed == other.0.seed;
        let label = if of_a == of_b { of_a.clone() } else { format!("{of_a} and {of_b}") };
        found.instances.push(pair(store, label, one, other, &mut budget));
    }
    let count = |n: usize| if n == 1 { "1 instance".to_owned() } else { format!("{n} instances") };
    found.summary.push(format!(
        "{} in both: {same} with the same key, {} that differ",
        count(pairs.len()),
        found.instances.len()
    ));
    if shared {
        let text = "both drew the same random numbers (equal seeds), so their z scores are smaller than those of independent results";
        found.summary.push(text.to_owned());
    }
    for (side, other, name) in [(a, &in_b, "A"), (b, &in_a, "B")] {
        let only: Vec<&str> = side
            .instances
            .iter()
            .map(|(label, _)| label.as_str())
            .filter(|label| !single && !other.contains_key(*label))
            .collect();
        if !only.is_empty() {
            found.summary.push(format!("only in {name}: {}", listed(&only)));
        }
        let missing: Vec<&str> = side.missing.iter().map(String::as_str).collect();
        if !missing.is_empty() {
            found.summary.push(format!("not run in {name}: {}", listed(&missing)));
        }
    }
    found
}

fn listed(labels: &[&str]) -> String {
    const NAMED: usize = 8;
    let more = labels.len().saturating_sub(NAMED);
    let named = labels.iter().take(NAMED).copied().collect::<Vec<_>>().join(", ");
    if more > 0 { format!("{named} and {more} more") } else { named }
}

fn heads(names: &[&str]) -> Vec<String> {
    names.iter().map(|name| (*name).to_owned()).collect()
}

fn pair(store: &Store, label: String, a: &Made, b: &Made, budget: &mut usize) -> Compared {
    let mut compared = Compared { label, ..Compared::default() };
    let (before, now) = (dependencies_of(a), dependencies_of(b));
    let text = |text: Option<String>| Cell::text(text.map_or_else(|| "-".to_owned(), |text| shortened(&text)));
    let mut inputs = BTreeSet::new();
    let mut rows = Vec::new();
    for difference in differences(&before, &now) {
        // Digests of inputs tell nobody anything.
        match difference.field.strip_prefix("in.") {
            Some(port) => drop(inputs.insert(port.split('[').next().unwrap_or(port).to_owned())),
            None => rows.push(vec![Cell::text(&difference.field), text(difference.before), text(difference.now)]),
        }
    }
    if !inputs.is_empty() {
        compared.notes.push(format!("inputs differ: {}", inputs.into_iter().collect::<Vec<_>>().join(", ")));
    }
    let more = rows.len().checked_sub(MOST_ROWS).filter(|more| *more > 0).map(|more| format!("and {more} more fields"));
    rows.truncate(MOST_ROWS);
    compared.origin = Grid { head: heads(&["field", "A", "B"]), rows, more, ..Grid::default() };
    compared.costs = costs(&a.0, &b.0);
    for (port, of_a) in &a.0.ports {
        let Some(of_b) = b.0.ports.get(port) else {
            compared.notes.push(format!("only A has the output {port}"));
            continue;
        };
        if of_a.blob.digest == of_b.blob.digest {
            compared.notes.push(format!("{port}: the same bytes"));
            continue;
        }
        let read = |blob| {
            if store.is_released(blob) {
                Err("its bytes were given back".to_owned())
            } else {
                store.get(blob).map_err(|e| e.to_string())
            }
        };
        match (read(&of_a.blob), read(&of_b.blob)) {
            (Ok(Artifact::Images(a)), Ok(Artifact::Images(b))) => {
                let shown = is_pictured(&of_a.payload);
                let mut none = 0;
                images(&mut compared, port, (&a, &b), if shown { &mut *budget } else { &mut none });
            }
            (Ok(Artifact::Table(a)), Ok(Artifact::Table(b))) => compared.numbers.extend(tables(port, &a, &b)),
            (Ok(_), Ok(_)) => compared.notes.push(format!("{port}: another record")),
            (Err(error), _) => compared.notes.push(format!("{port} of A: {error}")),
            (_, Err(error)) => compared.notes.push(format!("{port} of B: {error}")),
        }
    }
    compared
}

/// CPU seconds, and the measures that differ.
fn costs(a: &InstanceRecord, b: &InstanceRecord) -> Grid {
    let number = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), significant);
    let mut rows = vec![vec![
        Cell::text("CPU s"),
        Cell::run(significant(a.cost.cpu_s)),
        Cell::run(significant(b.cost.cpu_s)),
        Cell::text("s"),
    ]];
    let of = |record: &InstanceRecord| -> BTreeMap<String, (f64, String)> {
        record.measures.iter().map(|(name, value, unit)| (name.clone(), (*value, unit.clone()))).collect()
    };
    let (of_a, of_b) = (of(a), of(b));
    for name in of_a.keys().chain(of_b.keys().filter(|name| !of_a.contains_key(*name))) {
        let (one, other) = (of_a.get(name), of_b.get(name));
        if one == other {
            continue;
        }
        let unit = one.or(other).map(|(_, unit)| shown_unit(unit)).unwrap_or_default();
        let cell = |found: Option<&(f64, String)>| Cell::text(number(found.map(|(value, _)| *value)));
        rows.push(vec![Cell::text(name), cell(one), cell(other), Cell::text(unit)]);
    }
    Grid { head: heads(&["measure", "A", "B", "unit"]), rows, ..Grid::default() }
}

/// Cells of a column as numbers.
fn number(cells: &Cells, row: usize) -> Option<f64> {
    match cells {
        Cells::F64(v) => v.get(row).copied(),
        Cells::MaybeF64(v) => v.get(row).copied().flatten(),
        Cells::I64(v) => v.get(row).map(|n| *n as f64),
        Cells::Bool(_) | Cells::Text(_) => None,
    }
}

/// Rows of two tables beside each other, those whose texts are equal: a line for each column that has a standard error
/// (`mean` and `mean_se`), with z; in tables without any, for each column the largest difference.
fn tables(port: &str, a: &Table, b: &Table) -> Vec<Grid> {
    let column = |table: &Table, name: &str| table.columns.iter().position(|c| c.name == name);
    let named = |table: &Table, row: usize| -> Vec<String> {
        let texts = table.columns.iter().filter_map(|column| match &column.cells {
            Cells::Text(v) if column.name != "unit" => v.get(row).cloned(),
            _ => None,
        });
        texts.filter(|text| !text.is_empty()).collect()
    };
    // A name may stand for several rows: the first of A with the first of B, and so on.
    let mut places: BTreeMap<Vec<String>, Vec<usize>> = BTreeMap::new();
    (0..b.rows()).rev().for_each(|row| places.entry(named(b, row)).or_default().push(row));
    let pairs: Vec<(usize, usize)> =
        (0..a.rows()).filter_map(|row| Some((row, places.get_mut(&named(a, row))?.pop()?))).collect();
    let measured: Vec<(&str, usize, usize, usize, usize)> = a
        .columns
        .iter()
        .filter_map(|of| {
            let error = format!("{}_se", of.name);
            Some((of.name.as_str(), column(a, &of.name)?, column(a, &error)?, column(b, &of.name)?, column(b, &error)?))
        })
        .collect();
    let unit_column = column(a, "unit");
    let mut rows = Vec::new();
    for &(i, j) in &pairs {
        let name = named(a, i).join(" ");
        for &(quantity, value_a, se_a, value_b, se_b) in &measured {
            let cells = |table: &Table, column: usize, row| number(&table.columns[column].cells, row);
            let (Some(x), Some(y)) = (cells(a, value_a, i), cells(b, value_b, j)) else { continue };
            let z = cells(a, se_a, i).zip(cells(b, se_b, j)).and_then(|(s, t)| z_score(y - x, s, t));
            let unit = match unit_column.map(|column| &a.columns[column].cells) {
                Some(Cells::Text(units)) => units[i].clone(),
                _ => a.columns[value_a].unit.clone(),
            };
            rows.push(vec![
                Cell::text(format!("{name} {quantity}")),
                Cell::text(significant(x)),
                Cell::text(significant(y)),
                Cell::text(significant(y - x)),
                Cell::text(z.map_or_else(|| "-".to_owned(), |z| format!("{z:.2}"))),
                Cell::text(shown_unit(&unit)),
            ]);
        }
    }
    if measured.is_empty() && a.rows() == b.rows() {
        for (of, in_a) in a.columns.iter().enumerate().map(|(k, of)| (of, k)) {
            let Some(in_b) = column(b, &of.name) else { continue };
            let gaps = (0..a.rows()).filter_map(|row| {
                let (x, y) = (number(&a.columns[in_a].cells, row)?, number(&b.columns[in_b].cells, row)?);
                Some((x, y))
            });
            let Some((x, y)) = gaps.max_by(|(x, y), (u, v)| (y - x).abs().total_cmp(&(v - u).abs())) else { continue };
            if x != y {
                let name = format!("{} (where they differ most)", of.name);
                let cells = [significant(x), significant(y), significant(y - x)].map(Cell::Text);
                let unit = Cell::text(shown_unit(&of.unit));
                rows.push([&[Cell::text(name)], &cells[..], &[Cell::text("-"), unit]].concat());
            }
        }
    }
    let more = rows.len().checked_sub(MOST_ROWS).filter(|more| *more > 0).map(|more| format!("and {more} more rows"));
    rows.truncate(MOST_ROWS);
    let size = (a.rows() != b.rows()).then(|| format!(", {} rows in A, {} in B", a.rows(), b.rows()));
    let caption = format!("{port}{}", size.unwrap_or_default());
    if rows.is_empty() && a.rows() == b.rows() {
        return Vec::new();
    }
    vec![Grid { caption, head: heads(&["quantity", "A", "B", "B - A", "z", "unit"]), rows, more }]
}

/// A difference in units of its standard error; none where that is 0 or not known.
fn z_score(difference: f64, se_a: f64, se_b: f64) -> Option<f64> {
    let z = difference / se_a.hypot(se_b);
    z.is_finite().then_some(z)
}

/// The value layers of two stacks: means, root mean square difference, and that of z over the pixels that are good in both.
fn images(compared: &mut Compared, port: &str, (a, b): (&ImageStack, &ImageStack), budget: &mut usize) {
    if (a.rows(), a.columns()) != (b.rows(), b.columns()) {
        compared.notes.push(format!(
            "{port}: {} x {} pixels in A, {} x {} in B",
            a.columns(),
            a.rows(),
            b.columns(),
            b.rows()
        ));
        return;
    }
    let mut rows = Vec::new();
    let mut stack = ImageStack::new(a.rows(), a.columns());
    stack.attributes.clone_from(&a.attributes);
    let (mut good_anywhere, mut only) = (Array2::<f32>::zeros((a.rows(), a.columns())), 0);
    let described = statistics::layers(a);
    for (k, layer) in a.layers.iter().enumerate().filter(|(_, layer)| layer.info.kind == LayerKind::Value) {
        let same = |other: &&Layer| same_quantity(&layer.info, &other.info);
        let Some(other) = b.layers.iter().find(same) else {
            only += 1;
            continue;
        };
        let masks = [a.mask(layer.info.wavelength_nm), b.mask(other.info.wavelength_nm)].map(|m| m.map(Layer::pixels));
        let errors = [a.standard_error(&layer.info), b.standard_error(&other.info)].map(|l| l.map(Layer::pixels));
        let (x, y) = (layer.pixels(), other.pixels());
        let mut pixels = Vec::with_capacity(x.len());
        let (mut n, mut sums, mut squares, mut zs, mut known) = (0_u64, [0.0, 0.0], 0.0, 0.0, 0_u64);
        for i in 0..x.len() {
            let good = masks.iter().flatten().all(|mask| mask[i] == 0.0);
            let (one, two) = (f64::from(x[i]), f64::from(y[i]));
            pixels.push(if good { (two - one) as f32 } else { 0.0 });
            if !good {
                continue;
            }
            good_anywhere.as_slice_mut().expect("a new array")[i] = 1.0;
            (n, squares) = (n + 1, squares + (two - one).powi(2));
            sums = [sums[0] + one, sums[1] + two];
            if let [Some(s), Some(t)] = &errors
                && let Some(z) = z_score(two - one, f64::from(s[i]), f64::from(t[i]))
            {
                (zs, known) = (zs + z * z, known + 1);
            }
        }
        let mean = |sum: f64| if n == 0 { "-".to_owned() } else { significant(sum / n as f64) };
        let root = |sum: f64, n: u64| if n == 0 { "-".to_owned() } else { significant((sum / n as f64).sqrt()) };
        rows.push(vec![
            Cell::text(label(&described[k], &described, &a.attributes)),
            Cell::Text(mean(sums[0])),
            Cell::Text(mean(sums[1])),
            Cell::Text(root(squares, n)),
            Cell::Text(root(zs, known)),
            Cell::text(shown_unit(&layer.info.unit)),
        ]);
        let name = format!("{}_difference", layer.info.name);
        let data = Array2::from_shape_vec((a.rows(), a.columns()), pixels).expect("as many as in A");
        stack.push(LayerInfo { name, mean_se: None, ..layer.info.clone() }, data);
    }
    let others = b.layers.iter().filter(|l| l.info.kind == LayerKind::Value).count() + only;
    let others = others.saturating_sub(rows.len());
    if others > 0 {
        compared.notes.push(format!("{port}: {others} layers that only one of them has"));
    }
    let rows_there = !rows.is_empty();
    rows.truncate(MOST_ROWS);
    if rows_there {
        compared.numbers.push(Grid {
            caption: format!("{port}: over the pixels that are good in both"),
            head: heads(&["layer", "mean of A", "mean of B", "rms of B - A", "rms of z", "unit"]),
            rows,
            more: None,
        });
        stack.push(LayerInfo::new("mask", LayerKind::Mask, "1"), good_anywhere.mapv(|good| 1.0 - good));
        let titles = ["A", "B", "B - A"].map(|which| format!("{} · {port} · {which}", compared.label));
        let shown = [a, b, &stack].into_iter().zip(titles).map(|(stack, title)| {
            let caption = Caption { title: title.clone(), ..Caption::default() };
            let bytes = (*budget > 0).then(|| preview::picture(&Artifact::Images(quantities(stack)), &caption))??;
            let (width, height) = size(&bytes)?;
            let image = Image::Png { bytes, width, height };
            Some(Figure { alt: title.clone(), title, image, file: None, behind: None })
        });
        let shown: Option<Vec<Figure>> = shown.collect();
        let bytes =
            shown.iter().flatten().map(|f| if let Image::Png { bytes, .. } = &f.image { bytes.len() } else { 0 });
        let bytes: usize = bytes.sum();
        if let Some(shown) = shown.filter(|_| bytes <= *budget) {
            *budget -= bytes;
            compared.figures.push(shown);
        } else if *budget > 0 {
            compared.notes.push(format!("{port}: its pictures are more than the page carries"));
        }
    }
}

/// The quantities of a stack and its masks, without errors and covariances: what the difference shows too.
fn quantities(stack: &ImageStack) -> ImageStack {
    let is_shown = |layer: &&Layer| layer.info.kind == LayerKind::Value || layer.info.is_pixel_mask();
    let mut shown = ImageStack::new(stack.rows(), stack.columns());
    shown.layers = stack.layers.iter().filter(is_shown).cloned().collect();
    shown.attributes.clone_from(&stack.attributes);
    shown
}

fn same_quantity(a: &LayerInfo, b: &LayerInfo) -> bool {
    (&a.name, a.kind, a.f_x_per_mm, a.phase_rad) == (&b.name, b.kind, b.f_x_per_mm, b.phase_rad)
        && (a.orientation_deg, a.wavelength_nm) == (b.orientation_deg, b.wavelength_nm)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stack(values: [f32; 4], se: f32, bad: Option<usize>) -> ImageStack {
        let mut stack = ImageStack::new(2, 2);
        let all = |v: Vec<f32>| Array2::from_shape_vec((2, 2), v).unwrap();
        stack.push(LayerInfo::value("mu_a", "mm^-1"), all(values.to_vec()));
        stack.push(LayerInfo::new("mu_a_se", LayerKind::StandardError, "mm^-1"), all(vec![se; 4]));
        let mask = (0..4).map(|i| if bad == Some(i) { 1.0 } else { 0.0 }).collect();
        stack.push(LayerInfo::new("mask", LayerKind::Mask, "1"), all(mask));
        stack
    }

    /// Pixels that one of them masks do not count; z is the difference over both standard errors.
    #[test]
    fn images_are_compared_where_both_are_good() {
        let mut compared = Compared::default();
        let (a, b) = (stack([1.0, 2.0, 3.0, 4.0], 3.0, Some(3)), stack([6.0, 7.0, 8.0, 99.0], 4.0, None));
        images(&mut compared, "maps", (&a, &b), &mut 1_000_000);
        let text = |i: usize| match &compared.numbers[0].rows[0][i] {
            Cell::Text(text) => text.clone(),
            other => panic!("{other:?}"),
        };
        assert_eq!([1, 2, 3, 4].map(text), ["2", "7", "5", "1"]);
        assert_eq!(compared.figures[0].len(), 3);
    }

    /// Rows find each other by their texts, in whatever order; z has the errors of both.
    #[test]
    fn rows_find_each_other() {
        let table = |regions: [&str; 2], means: [f64; 2]| {
            let mut table = Table::default();
            table.push("region", "", Cells::Text(regions.map(str::to_owned).to_vec()));
            table.push("mean", "mm^-1", Cells::F64(means.to_vec()));
            table.push("mean_se", "mm^-1", Cells::MaybeF64(vec![Some(0.3), Some(0.3)]));
            table
        };
        let found = tables("metrics", &table(["a", "b"], [1.0, 2.0]), &table(["b", "a"], [2.5, 1.0]));
        let rows: Vec<Vec<String>> = found[0]
            .rows
            .iter()
            .map(|row| row.iter().map(|c| if let Cell::Text(t) = c { t.clone() } else { String::new() }).collect())
            .collect();
        assert_eq!(rows[0][..3], ["a mean", "1", "1"]);
        assert_eq!(rows[1], ["b mean", "2", "2.5000", "0.50000", "1.18", "mm^-1"]);
    }

    #[test]
    fn no_error_gives_no_z() {
        assert_eq!(z_score(1.0, 0.0, 0.0), None);
        assert_eq!(z_score(0.0, 0.0, 0.0), None);
        assert_eq!(z_score(5.0, 3.0, 4.0), Some(1.0));
    }
}
