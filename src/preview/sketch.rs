//! Stacks that are pictures already: layers `red`, `green`, `blue` or `grey` in [0, 1].
//!
//! Two attributes add words, which a stage has no letters for: `labels` is a list of `{text, row, column}`, where row and
//! column are the pixel at the left end of the baseline; `legend` is a list of `{text, colour}`, red, green, blue in
//! [0, 1].

use ndarray::Array2;
use serde_json::Value;
use turbid_contract::{ImageStack, LayerInfo};

use super::canvas::{Canvas, INK};
use super::figure::{Figure, Section};
use super::panel::{Note, Panel, Swatch};
use super::text::{Size, Text};

/// Pictures smaller than this are enlarged, by a whole number; larger than `MOST` reduced.
const LEAST: i64 = 320;
const MOST: i64 = 1600;

/// Whether a stack of these layers is a picture.
pub fn is_drawn(layers: &[LayerInfo]) -> bool {
    let has = |name: &str| layers.iter().any(|info| info.name == name);
    has("grey") || ["red", "green", "blue"].into_iter().all(has)
}

/// The figure of a picture; None where the stack is no picture.
pub fn figure(stack: &ImageStack, title: &str) -> Option<Figure> {
    let layer = |name| stack.find(name, None).map(|l| &l.data);
    let channels =
        [layer("red").or(layer("grey"))?, layer("green").or(layer("grey"))?, layer("blue").or(layer("grey"))?];
    let scale = Scale::of(stack.rows().max(stack.columns()) as i64);
    let mut image = picture(channels, scale);
    for label in list(stack, "labels") {
        if let (Some(text), Some(row), Some(column)) =
            (label["text"].as_str(), label["row"].as_i64(), label["column"].as_i64())
        {
            Text::plain(text).draw(&mut image, scale.shown(column), scale.shown(row), Size::Small, INK);
        }
    }
    let notes = list(stack, "legend").iter().filter_map(|entry| {
        let colour: Vec<f64> = entry["colour"].as_array()?.iter().filter_map(Value::as_f64).collect();
        let colour = <[f64; 3]>::try_from(colour).ok()?;
        let colour = colour.map(|c| byte(c as f32));
        Some(Note { swatch: Some(Swatch::Colour(colour)), text: Text::plain(entry["text"].as_str()?) })
    });
    let panel =
        Panel { title: Text::new(), subtitle: Text::new(), image, bar: None, axes: None, notes: notes.collect() };
    let section = Section { heading: Text::new(), rows: vec![vec![panel]] };
    Some(Figure { heading: title.to_owned(), sections: vec![section], ..Figure::default() })
}

fn list<'a>(stack: &'a ImageStack, name: &str) -> &'a [Value] {
    stack.attributes.get(name).and_then(Value::as_array).map_or(&[], Vec::as_slice)
}

/// From pixels of the stack to those of the screen.
#[derive(Clone, Copy)]
struct Scale {
    zoom: i64,
    step: i64,
}

impl Scale {
    fn of(longer: i64) -> Self {
        Self { zoom: (LEAST / longer).max(1), step: (longer + MOST - 1) / MOST }
    }

    fn shown(self, pixel: i64) -> i64 {
        pixel.clamp(0, i64::from(u32::MAX)) / self.step * self.zoom
    }
}

/// A picture's numbers may stick out of [0, 1] by rounding; a NaN becomes black.
fn byte(intensity: f32) -> u8 {
    (intensity.clamp(0.0, 1.0) * 255.0).round() as u8
}

fn picture(channels: [&Array2<f32>; 3], Scale { zoom, step }: Scale) -> Canvas {
    let (rows, columns) = channels[0].dim();
    let shown = |n: usize| (n as i64 + step - 1) / step * zoom;
    let mut canvas = Canvas::new(shown(columns), shown(rows));
    for y in 0..canvas.height() {
        for x in 0..canvas.width() {
            let at = [(y / zoom * step) as usize, (x / zoom * step) as usize];
            canvas.set(x, y, channels.map(|c| byte(c[at])));
        }
    }
    canvas
}

#[cfg(test)]
mod tests {
    use ndarray::Array2;
    use serde_json::json;

    use super::*;

    /// Labels and legends that make sense are drawn, and no others stop the picture.
    #[test]
    fn words_are_drawn_where_they_make_sense() {
        let with = |name: &str, value: Value| {
            let mut stack = ImageStack::new(30, 400);
            stack.push(LayerInfo::value("grey", "1"), Array2::ones((30, 400)));
            stack.attributes.insert(name.into(), value);
            figure(&stack, "scene").unwrap().draw()
        };
        let bare = with("nothing", Value::Null);
        assert_ne!(with("labels", json!([{"text": "top", "row": 20, "column": 10}])), bare);
        assert!(with("legend", json!([{"text": "polyp", "colour": [1, 0, 0.5]}])).height() > bare.height());
        for senseless in [
            json!(null),
            json!([3]),
            json!([{"text": "top", "row": -5e300, "column": "a"}]),
            json!([{"text": "x", "colour": [1]}]),
        ] {
            assert_eq!(with("labels", senseless.clone()), bare, "{senseless}");
            assert_eq!(with("legend", senseless.clone()), bare, "{senseless}");
        }
    }
}
