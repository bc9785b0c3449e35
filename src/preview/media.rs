//! Media against what they are (`compare` of a fit): estimate over truth, and the error of each medium under its name.
//!
//! Stacks with one pixel a row whose attribute `media` names the rows.

use ndarray::Array2;
use turbid_contract::{ImageStack, Layer};

use super::axis::Axis;
use super::canvas::{Canvas, GREY, Rgb};
use super::colour::hatch;
use super::figure::{Figure, Section};
use super::notation::{in_unit, quantity};
use super::number::number;
use super::panel::{Axes, Note, Panel};
use super::text::{Size, Text};

/// Side of a plot in pixels.
const SIDE: i64 = 288;
/// Rows of the chart: as high as letters where there is room.
const ROW: i64 = 18;
const LEAST_ROW: i64 = 3;
const MOST_HEIGHT: i64 = 1200;
/// Names are cut to this width, pixels.
const MOST_NAME: i64 = 180;
const POINT: f64 = 7.0;
const INK: Rgb = [0, 98, 160];
const ZERO: Rgb = [150, 150, 150];

/// The figure; None where the rows of the stack are no media.
pub fn figure(stack: &ImageStack, title: &str) -> Option<Figure> {
    let names: Vec<String> = serde_json::from_value(stack.attributes.get("media")?.clone()).ok()?;
    if stack.columns() != 1 || names.len() != stack.rows() {
        return None;
    }
    let good: Vec<bool> = match stack.mask(None) {
        Some(mask) => mask.data.iter().map(|&reason| reason == 0.0).collect(),
        None => vec![true; names.len()],
    };
    let errors = stack.layers.iter().filter_map(|l| Some((l.info.name.strip_suffix("_error")?, l)));
    let rows: Vec<Vec<Panel>> = errors
        .map(|(name, error)| {
            let plot = stack.find(name, None).zip(stack.find(&format!("{name}_truth"), None));
            let plot = plot.and_then(|(estimate, truth)| agreement(estimate, truth, &good));
            plot.into_iter().chain([chart(error, &names, &good)]).collect()
        })
        .collect();
    let failed = good.iter().filter(|good| !**good).count();
    let mut said = format!("{} media", names.len());
    if failed > 0 {
        said += &format!("; grey stripes: {failed} without a fit");
    }
    let sections = vec![Section { heading: Text::new(), rows }];
    Some(Figure { heading: title.to_owned(), sections, remarks: vec![Text::plain(said)], ..Figure::default() })
}

fn value(data: &Array2<f32>, row: usize) -> f64 {
    f64::from(data[[row, 0]])
}

/// Estimate over truth, with the line on which they agree; None without a medium that has both.
fn agreement(estimate: &Layer, truth: &Layer, good: &[bool]) -> Option<Panel> {
    let points = (0..good.len()).filter(|&i| good[i]).map(|i| [value(&truth.data, i), value(&estimate.data, i)]);
    let points: Vec<[f64; 2]> = points.filter(|p| p.iter().all(|v| v.is_finite())).collect();
    let all = || points.iter().flatten().copied();
    let (low, high) = (all().reduce(f64::min)?, all().reduce(f64::max)?);
    // Room around the points; what may be 0 starts there.
    let ends =
        if low > 0.0 { [low / 1.3, high * 1.3] } else { [low.min(0.0), if high > 0.0 { 1.1 * high } else { 1.0 }] };
    let axis =
        |info: &turbid_contract::LayerInfo| Axis::of_nodes(quantity(&info.name).join(in_unit(&info.unit)), &ends);
    let (x, y) = (axis(&truth.info)?, axis(&estimate.info)?);
    let at = |p: [f64; 2]| [x.position(p[0]) * SIDE as f64, (1.0 - y.position(p[1])) * SIDE as f64];
    let mut image = Canvas::new(SIDE, SIDE);
    image.line(at([ends[0]; 2]), at([ends[1]; 2]), 1.0, GREY);
    points.iter().for_each(|&p| image.line(at(p), at(p), POINT, INK));
    let title = Text::plain("estimate over truth of ").join(quantity(&estimate.info.name));
    Some(Panel { title, subtitle: Text::new(), image, bar: None, axes: Some(Axes { x, y }), notes: Vec::new() })
}

/// A bar for the error of each medium, the first on top.
fn chart(error: &Layer, names: &[String], good: &[bool]) -> Panel {
    let count = names.len() as i64;
    let row = ROW.min(MOST_HEIGHT / count).max(LEAST_ROW);
    let values = || (0..names.len()).filter(|&i| good[i]).map(|i| value(&error.data, i)).filter(|v| v.is_finite());
    let ends = values().fold([0.0_f64; 2], |[low, high], v| [low.min(v), high.max(v)]);
    let room = 0.06 * (ends[1] - ends[0]);
    let [low, high] = if room > 0.0 { [ends[0] - room, ends[1] + room] } else { [-1.0, 1.0] };
    let x = Axis::linear(quantity(&error.info.name).join(in_unit(&error.info.unit)), low, high);
    let labels = names.iter().map(|name| Text::shortened(name, Size::Small, MOST_NAME)).collect();
    let y = Axis::names(Text::plain("medium"), labels);
    let column = |v: f64| (x.position(v) * (SIDE - 1) as f64).round() as i64;
    let mut image = Canvas::new(SIDE, row * count);
    for (i, &good) in good.iter().enumerate() {
        let (top, error) = (i as i64 * row, value(&error.data, i));
        if good && error.is_finite() {
            let (from, to) = (column(0.0).min(column(error)), column(0.0).max(column(error)));
            image.fill(from, top + row / 6, to - from + 1, (row - row / 3).max(1), INK);
        } else {
            for (x, y) in (top..top + row).flat_map(|y| (0..SIDE).map(move |x| (x, y))) {
                image.set(x, y, hatch(x, y));
            }
        }
    }
    image.fill(column(0.0), 0, 1, row * count, ZERO);
    let n = values().count() as f64;
    let rms = (values().map(|v| v * v).sum::<f64>() / n).sqrt();
    let said = if n > 0.0 {
        Text::plain("RMS ")
            .join(number(rms, 3))
            .then(", min ")
            .join(number(ends_of(values(), f64::min), 3))
            .then(", max ")
            .join(number(ends_of(values(), f64::max), 3))
    } else {
        Text::plain("no medium has a fit")
    };
    Panel {
        title: quantity(&error.info.name),
        subtitle: Text::new(),
        image,
        bar: None,
        axes: Some(Axes { x, y }),
        notes: vec![Note { swatch: None, text: said }],
    }
}

fn ends_of(values: impl Iterator<Item = f64>, pick: fn(f64, f64) -> f64) -> f64 {
    values.reduce(pick).unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use serde_json::json;
    use turbid_contract::{LayerInfo, LayerKind};

    use super::*;

    fn stack(errors: &[f32]) -> ImageStack {
        let mut stack = ImageStack::new(errors.len(), 1);
        let column = |of: &dyn Fn(f32) -> f32| Array2::from_shape_fn((errors.len(), 1), |(i, _)| of(errors[i]));
        stack.push(LayerInfo::value("mu_a", "mm^-1"), column(&|e| 0.1 * (1.0 + e / 100.0)));
        stack.push(LayerInfo::value("mu_a_truth", "mm^-1"), column(&|_| 0.1));
        stack.push(LayerInfo::value("mu_a_error", "%"), column(&|e| if e.is_finite() { e } else { 0.0 }));
        stack.push(LayerInfo::new("mask", LayerKind::Mask, "1"), column(&|e| if e.is_finite() { 0.0 } else { 14.0 }));
        let names: Vec<String> = (0..errors.len()).map(|i| format!("medium_{i}")).collect();
        stack.attributes.insert("media".into(), json!(names));
        stack
    }

    /// Each medium has a bar from 0 to its error in its own row; one without a fit has stripes.
    #[test]
    fn each_medium_has_its_bar() {
        let figure = figure(&stack(&[10.0, -5.0, f32::NAN, 0.0]), "errors").unwrap();
        let [plot, chart] = &figure.sections[0].rows[0][..] else { panic!("a plot and a chart") };
        assert_eq!(plot.title.letters(), "estimate over truth of μa");
        let axes = chart.axes.as_ref().unwrap();
        assert_eq!(axes.x.name.letters(), "error of μa (%)");
        // Rows of 18 pixels; the axis runs from -5.9 to 10.9 %.
        let place = |percent: f64| ((percent + 5.9) / 16.8 * 287.0).round() as i64;
        let inked =
            |row: i64| -> Vec<i64> { (0..SIDE).filter(|&x| chart.image.get(x, 18 * row + 9) == Some(INK)).collect() };
        assert_eq!(inked(0), (place(0.0) + 1..=place(10.0)).collect::<Vec<_>>());
        assert_eq!(inked(1), (place(-5.0)..place(0.0)).collect::<Vec<_>>());
        assert!(
            inked(2).is_empty() && chart.image.get(5, 40).is_some_and(|c| super::super::colour::HATCH.contains(&c))
        );
        assert!(inked(3).is_empty());
        assert_eq!(figure.remarks[0].letters(), "4 media; grey stripes: 1 without a fit");
    }

    /// Whatever the number of media and their errors, there is a figure of a size that can be looked at.
    #[test]
    fn many_media_and_extreme_errors_fit() {
        for errors in [vec![f32::NAN; 3], vec![0.0], vec![1e30, -1e30], vec![-100.0; 500], vec![f32::MAX]] {
            let canvas = figure(&stack(&errors), "errors").unwrap().draw();
            assert!(canvas.width() < 1200 && canvas.height() < 1800, "{} media", errors.len());
        }
        let mut other = stack(&[1.0, 2.0]);
        other.attributes.insert("media".into(), json!(["one"]));
        assert!(figure(&other, "errors").is_none());
    }
}
