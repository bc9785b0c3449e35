//! Charts as panels of a PNG.

use turbid_contract::Table;

use super::super::axis::Axis;
use super::super::canvas::{Canvas, INK, Rgb};
use super::super::colour::{ColourMap, hatch};
use super::super::figure::{Figure, Section};
use super::super::notation::{in_unit, quantity};
use super::super::number::short;
use super::super::panel::{Axes, Bar, Note, Panel, Swatch};
use super::super::range::Range;
use super::super::text::{Size, Text};
use super::{Chart, Content, Value, charts};

const WIDTH: i64 = 420;
const HEIGHT: i64 = 260;
/// Rows of a forest plot, and cells of a heat map.
const ROW: i64 = 22;
const CELL: i64 = 46;
const MOST_SIDE: i64 = 640;
const MOST_NAME: i64 = 220;
const POINT: f64 = 7.0;
const BAND: Rgb = [150, 150, 150];
/// Okabe and Ito's colours, told apart by people who see fewer of them.
const COLOURS: [Rgb; 7] =
    [[0, 114, 178], [213, 94, 0], [0, 158, 115], [204, 121, 167], [230, 159, 0], [86, 180, 233], [68, 68, 68]];

/// The figure of a table of metrics; `None` where it has no chart.
pub fn figure(table: &Table, title: &str) -> Option<Figure> {
    let panels: Vec<Panel> = charts(table).iter().filter_map(panel).collect();
    if panels.is_empty() {
        return None;
    }
    let rows = panels.chunks(2).map(<[Panel]>::to_vec).collect();
    let sections = vec![Section { heading: Text::new(), rows }];
    let remarks = vec![Text::plain("bars: 95 % by the standard errors, cut where they leave the frame")];
    Some(Figure { heading: title.to_owned(), sections, remarks, ..Figure::default() })
}

fn panel(chart: &Chart) -> Option<Panel> {
    let named = Text::plain(format!("{} of ", chart.what)).join(quantity(&chart.quantity));
    let measured = named.clone().join(in_unit(&chart.unit));
    let with_zero = chart.what != "mean";
    let [low, high] = chart.content.range(with_zero)?;
    let [bottom, top] = [low, high];
    let mut notes: Vec<Note> = Vec::new();
    let (image, axes, bar) = match &chart.content {
        Content::Lines { axis, series } => {
            let ends = chart.content.axis_range()?;
            let x = Axis::of_nodes(Text::plain(axis.replace('_', " ")), &ends)?;
            let y = Axis::linear(measured, low, high);
            let mut image = Canvas::new(WIDTH, HEIGHT);
            // Marks stand off the frame.
            let px = |v: f64| 8.0 + x.position(v) * (WIDTH as f64 - 16.0);
            let py = |v: f64| (1.0 - y.position(v)) * HEIGHT as f64;
            if with_zero {
                image.line([0.0, py(0.0)], [WIDTH as f64, py(0.0)], 1.0, BAND);
            }
            for (k, one) in series.iter().enumerate() {
                let colour = COLOURS[k % COLOURS.len()];
                let at = |(x, v): &(f64, Value)| [px(*x), py(v.value)];
                one.points.windows(2).for_each(|pair| image.line(at(&pair[0]), at(&pair[1]), 1.4, colour));
                for point in &one.points {
                    if let Some([low, high]) = point.1.interval_within([bottom, top]) {
                        image.line([px(point.0), py(low)], [px(point.0), py(high)], 1.0, colour);
                    }
                    image.line(at(point), at(point), POINT, colour);
                }
                if !one.name.is_empty() {
                    notes.push(Note { swatch: Some(Swatch::Colour(colour)), text: Text::plain(one.name.as_str()) });
                }
            }
            (image, Some(Axes { x, y }), None)
        }
        Content::Forest { rows } => {
            let names = rows.iter().map(|(name, _)| Text::shortened(name, Size::Small, MOST_NAME)).collect();
            let (x, y) = (Axis::linear(measured, low, high), Axis::names(Text::new(), names));
            let mut image = Canvas::new(WIDTH, ROW * rows.len() as i64);
            let px = |v: f64| x.position(v) * WIDTH as f64;
            if with_zero {
                image.line([px(0.0), 0.0], [px(0.0), image.height() as f64], 1.0, BAND);
            }
            for (i, (_, value)) in rows.iter().enumerate() {
                let row = (i as f64 + 0.5) * ROW as f64;
                if let Some([low, high]) = value.interval_within([bottom, top]) {
                    image.line([px(low), row], [px(high), row], 1.4, COLOURS[0]);
                }
                image.line([px(value.value), row], [px(value.value), row], POINT, COLOURS[0]);
            }
            (image, Some(Axes { x, y }), None)
        }
        Content::Heat { x, y, cells } => {
            let largest = cells.iter().flatten().flatten().fold(0.0_f64, |most, v| most.max(v.abs()));
            let (map, range) = match with_zero && low < 0.0 {
                true => (ColourMap::Diverging, Range::of([-largest, largest])),
                false => (ColourMap::Sequential, Range::of([low, high])),
            };
            let [across, down] = [x.1.len(), y.1.len()].map(|n| (MOST_SIDE / n as i64).clamp(3, CELL));
            let mut image = Canvas::new(across * x.1.len() as i64, down * y.1.len() as i64);
            for (j, row) in cells.iter().enumerate() {
                let top = down * (y.1.len() - 1 - j) as i64;
                for (i, cell) in row.iter().enumerate() {
                    let left = across * i as i64;
                    let Some(value) = cell else {
                        for (dy, dx) in (0..down).flat_map(|dy| (0..across).map(move |dx| (dy, dx))) {
                            image.set(left + dx, top + dy, hatch(left + dx, top + dy));
                        }
                        continue;
                    };
                    let t = range.position(*value);
                    image.fill(left, top, across, down, map.colour(t));
                    let text = Text::plain(short(*value));
                    if text.width(Size::Small) + 4 <= across && down >= ROW {
                        // Readable on either end of the map.
                        let [r, g, b] = map.colour(t).map(f64::from);
                        let ink = if 0.3 * r + 0.6 * g + 0.1 * b > 130.0 { INK } else { [255, 255, 255] };
                        let at = left + (across - text.width(Size::Small)) / 2;
                        text.draw(&mut image, at, top + down / 2 + 4, Size::Small, ink);
                    }
                }
            }
            let said = |values: &[f64]| values.iter().map(|v| short(*v)).collect::<Vec<_>>().join(", ");
            for (way, (name, values)) in [("across", x), ("up", y)] {
                notes.push(Note { swatch: None, text: Text::plain(format!("{way}: {name} = {}", said(values))) });
            }
            (image, None, Some(Bar { map, range }))
        }
    };
    notes.extend(chart.notes.iter().map(|text| Note { swatch: None, text: Text::plain(text.as_str()) }));
    Some(Panel { title: named, subtitle: Text::new(), image, bar, axes, notes })
}
