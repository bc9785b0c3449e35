//! Stacks that are pictures already: layers `red`, `green`, `blue` or `grey` in [0, 1].

use ndarray::Array2;
use turbid_contract::ImageStack;

use super::canvas::Canvas;
use super::figure::{Figure, Section};
use super::panel::Panel;
use super::text::Text;

/// Pictures smaller than this are enlarged, by a whole number; larger than `MOST` reduced.
const LEAST: i64 = 320;
const MOST: i64 = 1600;

/// The figure of a picture; None where the stack is no picture.
pub fn figure(stack: &ImageStack, title: &str) -> Option<Figure> {
    let layer = |name| stack.find(name, None).map(|l| &l.data);
    let channels =
        [layer("red").or(layer("grey"))?, layer("green").or(layer("grey"))?, layer("blue").or(layer("grey"))?];
    let panel = Panel {
        title: Text::new(),
        subtitle: Text::new(),
        image: picture(channels),
        bar: None,
        axes: None,
        notes: vec![],
    };
    let section = Section { heading: Text::new(), rows: vec![vec![panel]] };
    Some(Figure { heading: title.to_owned(), sections: vec![section], remarks: vec![] })
}

fn picture(channels: [&Array2<f32>; 3]) -> Canvas {
    let (rows, columns) = channels[0].dim();
    let longer = rows.max(columns) as i64;
    let (zoom, step) = ((LEAST / longer).max(1), (longer + MOST - 1) / MOST);
    let shown = |n: usize| (n as i64 + step - 1) / step * zoom;
    let mut canvas = Canvas::new(shown(columns), shown(rows));
    for y in 0..canvas.height() {
        for x in 0..canvas.width() {
            let at = [(y / zoom * step) as usize, (x / zoom * step) as usize];
            // A picture's numbers may stick out of [0, 1] by rounding; a NaN becomes black.
            canvas.set(x, y, channels.map(|c| (c[at].clamp(0.0, 1.0) * 255.0).round() as u8));
        }
    }
    canvas
}
