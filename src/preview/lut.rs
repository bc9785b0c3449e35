//! Look-up tables as figures: the mesh of constant mu_a and constant mu_s' over two reflectances, and each
//! reflectance over (mu_a, mu_s').

use ndarray::{Array2, Array3};
use turbid_contract::Table;

use super::arrange::arrange;
use super::axis::Axis;
use super::canvas::{Canvas, INK, Rgb};
use super::colour::{ColourMap, hatch};
use super::figure::{Figure, Section};
use super::notation::{f_x, quantity};
use super::number::{number, plain};
use super::panel::{Axes, Bar, Note, Panel, Swatch};
use super::range::{Range, Statistics};
use super::text::{Size, Text};

/// Side of a plot in pixels.
const SIDE: i64 = 336;
/// Iso-lines of a family; all nodes where there are no more.
const MOST_LINES: usize = 12;
const MOST_MAPS: usize = 12;
const ISO_MU_A: Rgb = [0, 98, 160];
const ISO_MU_S: Rgb = [213, 94, 0];

/// A table over a full grid.
struct Grid {
    f_x: Vec<f64>,
    mu_a: Vec<f64>,
    mu_s_prime: Vec<f64>,
    /// Shape (f_x, mu_a, mu_s').
    r_d: Array3<f64>,
}

impl Grid {
    /// None where the table lacks a column, or where its rows are no full grid in order.
    fn read(table: &Table) -> Option<Self> {
        let rows = rows_of_the_first(table);
        let column = |name| table.f64s(name).and_then(|values| values.get(..rows));
        let (f_x, mu_a, mu_s_prime, r_d) = (column("f_x")?, column("mu_a")?, column("mu_s_prime")?, column("r_d")?);
        let nodes = |values: &[f64]| {
            let mut nodes = values.to_vec();
            nodes.sort_by(f64::total_cmp);
            nodes.dedup();
            nodes
        };
        let axes = [nodes(f_x), nodes(mu_a), nodes(mu_s_prime)];
        let shape = (axes[0].len(), axes[1].len(), axes[2].len());
        let r_d = Array3::from_shape_vec(shape, r_d.to_vec()).ok()?;
        let rows = f_x.iter().zip(mu_a).zip(mu_s_prime).zip(r_d.indexed_iter());
        let in_order =
            rows.clone().all(|(((f, a), s), ((i, j, k), _))| [*f, *a, *s] == [axes[0][i], axes[1][j], axes[2][k]]);
        let [f_x, mu_a, mu_s_prime] = axes;
        (in_order && !r_d.is_empty()).then_some(Self { f_x, mu_a, mu_s_prime, r_d })
    }
}

/// Rows of the first table, where an artifact holds one for each pair of g and n, one after the other.
fn rows_of_the_first(table: &Table) -> usize {
    let Some((g, n)) = table.f64s("g").zip(table.f64s("n")) else { return table.rows() };
    let pairs = || g.iter().zip(n);
    pairs().take_while(|pair| Some(*pair) == pairs().next()).count()
}

pub fn figure(table: &Table, title: &str) -> Option<Figure> {
    let grid = Grid::read(table)?;
    let mut panels = Vec::new();
    if grid.f_x.len() > 1 && grid.mu_a.len() > 1 && grid.mu_s_prime.len() > 1 {
        panels.push(mesh(&grid));
    }
    for index in 0..grid.f_x.len().min(MOST_MAPS) {
        panels.push(map(&grid, index)?);
    }
    let sections = vec![Section { heading: Text::new(), rows: arrange(vec![panels], 3) }];
    let said = |name: &str| {
        table.attributes.get(name).map(|v| v.as_str().map_or_else(|| v.to_string(), |s| s.replace('_', " ")))
    };
    let mut remark = format!("{} × {} nodes", grid.mu_a.len(), grid.mu_s_prime.len());
    for name in ["model", "convention", "g", "n", "thickness"] {
        if let Some(value) = said(name).filter(|v| v != "null") {
            remark += &format!("; {name} {value}{}", if name == "thickness" { " mm" } else { "" });
        }
    }
    let (shown, all) = (rows_of_the_first(table), table.rows());
    if shown < all {
        remark += &format!("; the first of {} tables is shown", all / shown.max(1));
    }
    if grid.f_x.len() > MOST_MAPS {
        remark += &format!("; {} further spatial frequencies are not shown", grid.f_x.len() - MOST_MAPS);
    }
    Some(Figure { heading: title.to_owned(), sections, remarks: vec![Text::plain(remark)], ..Figure::default() })
}

fn per_mm(name: &str) -> Text {
    quantity(name).then(" (mm").sup("−1").then(")")
}

fn reflectance(f: f64) -> Text {
    quantity("r_d").then(format!("({} mm", plain(f))).sup("−1").then(")")
}

/// One reflectance over (mu_a, mu_s').
fn map(grid: &Grid, index: usize) -> Option<Panel> {
    let x = Axis::of_nodes(per_mm("mu_a"), &grid.mu_a)?;
    let y = Axis::of_nodes(per_mm("mu_s_prime"), &grid.mu_s_prime)?;
    let plane: Array2<f64> = grid.r_d.index_axis(ndarray::Axis(0), index).to_owned();
    let pixels = plane.mapv(|v| v as f32);
    let range = Statistics::of(&pixels, &pixels.mapv(f32::is_finite)).and_then(|s| Range::robust(&[&s]));
    let columns = nearest(&x, &grid.mu_a);
    let rows = nearest(&y, &grid.mu_s_prime);
    let mut image = Canvas::new(SIDE, SIDE);
    for (row, &k) in rows.iter().rev().enumerate() {
        for (column, &j) in columns.iter().enumerate() {
            let (at, value) = ([column as i64, row as i64], plane[[j, k]]);
            let colour = range.filter(|_| value.is_finite()).map(|r| ColourMap::Sequential.colour(r.position(value)));
            image.set(at[0], at[1], colour.unwrap_or_else(|| hatch(at[0], at[1])));
        }
    }
    Some(Panel {
        title: quantity("r_d"),
        subtitle: f_x(grid.f_x[index]),
        image,
        bar: range.map(|range| Bar { map: ColourMap::Sequential, range }),
        axes: Some(Axes { x, y }),
        notes: Vec::new(),
    })
}

/// For each pixel along an axis the node that lies nearest to it.
fn nearest(axis: &Axis, nodes: &[f64]) -> Vec<usize> {
    let places: Vec<f64> = nodes.iter().map(|&n| axis.position(n)).collect();
    let mut node = 0;
    let pixel = |i: i64| {
        let at = (i as f64 + 0.5) / SIDE as f64;
        while node + 1 < places.len() && places[node + 1] - at < at - places[node] {
            node += 1;
        }
        node
    };
    (0..SIDE).map(pixel).collect()
}

/// Lines of constant mu_a and of constant mu_s' over the reflectances at the lowest and the highest f_x.
fn mesh(grid: &Grid) -> Panel {
    let last = grid.f_x.len() - 1;
    let most =
        |i| grid.r_d.index_axis(ndarray::Axis(0), i).iter().copied().filter(|v| v.is_finite()).fold(0.0, f64::max);
    // Room for the labels at the lines' ends; a table of zeros has a mesh of one point.
    let axis = |i: usize, room: f64| {
        let end: f64 = most(i) * room;
        Axis::linear(reflectance(grid.f_x[i]), 0.0, if end > 0.0 { end } else { 1.0 })
    };
    let (x, y) = (axis(0, 1.12), axis(last, 1.1));
    let at = |j: f64, k: f64| {
        let value = |i: usize| between(grid, i, j, k);
        [x.position(value(0)) * SIDE as f64, (1.0 - y.position(value(last))) * SIDE as f64]
    };
    let mut image = Canvas::new(SIDE, SIDE);
    let mut labels: Vec<([f64; 2], Text, Rgb)> = Vec::new();
    let (n_a, n_s) = (grid.mu_a.len(), grid.mu_s_prime.len());
    for (j, value) in iso_values(&grid.mu_a) {
        let points: Vec<[f64; 2]> = (0..n_s).map(|k| at(j, k as f64)).collect();
        polyline(&mut image, &points, ISO_MU_A);
        labels.push((points[n_s - 1], label(value), ISO_MU_A));
    }
    for (k, value) in iso_values(&grid.mu_s_prime) {
        let points: Vec<[f64; 2]> = (0..n_a).map(|j| at(j as f64, k)).collect();
        polyline(&mut image, &points, ISO_MU_S);
        labels.push((points[0], label(value), ISO_MU_S));
    }
    write_labels(&mut image, labels);
    let note =
        |colour, name| Note { swatch: Some(Swatch::Colour(colour)), text: Text::plain("constant ").join(per_mm(name)) };
    Panel {
        title: Text::plain("Mesh of ").join(quantity("mu_a")).then(" and ").join(quantity("mu_s_prime")),
        subtitle: Text::new(),
        image,
        bar: None,
        axes: Some(Axes { x, y }),
        notes: vec![note(ISO_MU_A, "mu_a"), note(ISO_MU_S, "mu_s_prime")],
    }
}

/// The shortest that says the value to two digits: 0.1, not 0.10.
fn label(value: f64) -> Text {
    let exact = format!("{value:.0e}").parse() == Ok(value);
    number(value, if exact { 1 } else { 2 })
}

/// Reflectance between nodes, bilinear in their indices: good enough for lines of a picture.
fn between(grid: &Grid, i: usize, j: f64, k: f64) -> f64 {
    let split =
        |x: f64, n: usize| ((x as usize).min(n.saturating_sub(2)), x - ((x as usize).min(n.saturating_sub(2))) as f64);
    let ((j, s), (k, t)) = (split(j, grid.mu_a.len()), split(k, grid.mu_s_prime.len()));
    let r = |dj: usize, dk: usize| grid.r_d[[i, j + dj, k + dk]];
    (r(0, 0) * (1.0 - s) + r(1, 0) * s) * (1.0 - t) + (r(0, 1) * (1.0 - s) + r(1, 1) * s) * t
}

/// Indices (perhaps between nodes) and values of the lines to draw: all nodes where they are few, else round numbers
/// and both ends.
fn iso_values(nodes: &[f64]) -> Vec<(f64, f64)> {
    if nodes.len() <= MOST_LINES {
        return nodes.iter().enumerate().map(|(i, &v)| (i as f64, v)).collect();
    }
    let (low, high) = (nodes[0], nodes[nodes.len() - 1]);
    let round = |digits: &[u32]| -> Vec<f64> {
        let powers = super::number::exponent_of(low.max(high * 1e-6))..=super::number::exponent_of(high);
        let values = powers.flat_map(|p| digits.iter().map(move |d| format!("{d}e{p}").parse().expect("a number")));
        values.filter(|v| (low..=high).contains(v)).collect()
    };
    let choices = [vec![1, 2, 5], vec![1, 3], vec![1]].map(|digits| round(&digits));
    let mut values = choices.into_iter().find(|v| v.len() <= MOST_LINES).unwrap_or_default();
    values.extend([low, high]);
    values.sort_by(f64::total_cmp);
    values.dedup();
    let index = |v: f64| {
        let above = nodes.partition_point(|n| *n < v).clamp(1, nodes.len() - 1);
        above as f64 - 1.0 + (v - nodes[above - 1]) / (nodes[above] - nodes[above - 1])
    };
    values.into_iter().map(|v| (index(v), v)).collect()
}

fn polyline(image: &mut Canvas, points: &[[f64; 2]], colour: Rgb) {
    for pair in points.windows(2).filter(|pair| pair.iter().flatten().all(|v| v.is_finite())) {
        image.line(pair[0], pair[1], 1.2, colour);
    }
}

/// Labels at the ends of lines; one that would cover another is left out.
fn write_labels(image: &mut Canvas, labels: Vec<([f64; 2], Text, Rgb)>) {
    let mut taken: Vec<[i64; 4]> = Vec::new();
    for ([x, y], text, colour) in labels.into_iter().filter(|([x, y], ..)| x.is_finite() && y.is_finite()) {
        let width = text.width(Size::Tiny);
        // The mesh leaves room over its bright edge, where lines of mu_a end, and right of its edge of low absorption.
        let (left, base) =
            if colour == ISO_MU_A { (x as i64 - width - 2, y as i64 - 4) } else { (x as i64 + 7, y as i64 + 4) };
        let left = left.clamp(2, (image.width() - width - 2).max(2));
        let area = [left - 2, base - 9, left + width + 2, base + 2];
        let covers = |b: &[i64; 4]| area[0] < b[2] && b[0] < area[2] && area[1] < b[3] && b[1] < area[3];
        if base > 10 && base < image.height() - 2 && !taken.iter().any(covers) {
            text.draw(image, left, base, Size::Tiny, if colour == ISO_MU_A { colour } else { darker(colour) });
            taken.push(area);
        }
    }
}

/// Small letters need more ink than lines.
fn darker(colour: Rgb) -> Rgb {
    std::array::from_fn(|c| ((u32::from(colour[c]) * 3 + u32::from(INK[c])) / 4) as u8)
}
