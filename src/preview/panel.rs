//! One image of a figure: title, pixels, colour bar, notes.

use super::axis::Axis;
use super::canvas::{Canvas, GREY, INK, Rgb};
use super::colour::{ColourMap, hatch, stripe};
use super::number::times_power;
use super::pixels::Pixels;
use super::range::Range;
use super::text::{Size, Text};
use super::ticks::ticks;

const TITLE_LINE: i64 = 20;
const NOTE_LINE: i64 = 16;
const BAR_GAP: i64 = 9;
const BAR_WIDTH: i64 = 12;
/// A bar is at least this high, however flat the image.
const BAR_HEIGHT: i64 = 72;
const TICK: i64 = 4;
const SWATCH: i64 = 11;
const SWATCH_GAP: i64 = 6;

/// A line under an image, perhaps behind what it explains.
#[derive(Clone, Debug)]
pub struct Note {
    pub swatch: Option<Swatch>,
    pub text: Text,
}

/// What a note explains.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Swatch {
    Colour(Rgb),
    /// The stripes over pixels whose number is not what the title says.
    Marked,
    /// A bar of so many pixels of the screen.
    Length(i64),
}

impl Swatch {
    /// What it takes of the line, with the gap behind it.
    fn width(self) -> i64 {
        let own = if let Self::Length(pixels) = self { pixels } else { SWATCH };
        own + SWATCH_GAP
    }

    /// Draws before the text whose baseline is `base`.
    fn draw(self, canvas: &mut Canvas, left: i64, base: i64) {
        let (top, side) = (base - SWATCH + 2, SWATCH - 1);
        match self {
            Self::Colour(colour) => canvas.fill(left + 1, top, side, side, colour),
            Self::Marked => {
                for (x, y) in (0..side).flat_map(|y| (0..side).map(move |x| (x, y))) {
                    if let Some(colour) = stripe(x, y) {
                        canvas.set(left + 1 + x, top + y, colour);
                    }
                }
            }
            Self::Length(pixels) => {
                let middle = base - SWATCH / 2 + 1;
                canvas.fill(left, middle, pixels, 2, INK);
                canvas.fill(left, middle - 3, 1, 8, INK);
                canvas.fill(left + pixels - 1, middle - 3, 1, 8, INK);
                return;
            }
        }
        canvas.frame(left + 1, top, side, side, GREY);
    }
}

/// A colour bar.
#[derive(Clone, Debug)]
pub struct Bar {
    pub map: ColourMap,
    pub range: Range,
}

/// Axes of a plot, at its left and under it.
#[derive(Clone, Debug)]
pub struct Axes {
    pub x: Axis,
    pub y: Axis,
}

/// An image with what belongs to it.
#[derive(Clone, Debug)]
pub struct Panel {
    pub title: Text,
    pub subtitle: Text,
    pub image: Canvas,
    pub bar: Option<Bar>,
    pub axes: Option<Axes>,
    pub notes: Vec<Note>,
}

/// Screen pixels of an image: `colour` for good cells, stripes for masked ones.
pub fn paint(pixels: &Pixels, colour: impl Fn(f64) -> Rgb) -> Canvas {
    let zoom = pixels.zoom as i64;
    let mut canvas = Canvas::new(pixels.columns as i64 * zoom, pixels.rows as i64 * zoom);
    for (i, cell) in pixels.cells.iter().enumerate() {
        let (x, y) = ((i % pixels.columns) as i64 * zoom, (i / pixels.columns) as i64 * zoom);
        if let Some(value) = cell {
            canvas.fill(x, y, zoom, zoom, colour(*value));
        } else {
            for (row, column) in (0..zoom).flat_map(|row| (0..zoom).map(move |column| (row, column))) {
                canvas.set(x + column, y + row, hatch(x + column, y + row));
            }
        }
    }
    canvas
}

/// Marks cells whose number is not what the title says: `why` is other than 0 there, in the cells of `pixels`.
pub fn mark(image: &mut Canvas, pixels: &Pixels, why: &Pixels) {
    let zoom = pixels.zoom as i64;
    for i in (0..pixels.cells.len()).filter(|&i| pixels.cells[i].is_some() && why.cells[i].is_some_and(|e| e != 0.0)) {
        let (left, top) = ((i % pixels.columns) as i64 * zoom, (i / pixels.columns) as i64 * zoom);
        for (x, y) in (top..top + zoom).flat_map(|y| (left..left + zoom).map(move |x| (x, y))) {
            if let Some(colour) = stripe(x, y) {
                image.set(x, y, colour);
            }
        }
    }
}

impl Panel {
    pub fn width(&self) -> i64 {
        let bar = self.bar.as_ref().map_or(0, Bar::width);
        let notes = self.notes.iter().map(|n| n.text.width(Size::Small) + n.swatch.map_or(0, Swatch::width));
        let texts = [self.title.width(Size::Normal), self.subtitle.width(Size::Small)];
        // Titles and notes begin where the image does.
        self.gutter() + (self.image.width() + 2 + bar).max(texts.into_iter().chain(notes).max().unwrap_or(0))
    }

    /// Width of what stands left of the image.
    fn gutter(&self) -> i64 {
        self.axes.as_ref().map_or(0, |axes| axes.y.gutter())
    }

    /// Height over the image, where `subtitles` says whether the row has any.
    pub fn head(subtitles: bool) -> i64 {
        TITLE_LINE + if subtitles { NOTE_LINE } else { 0 } + 2
    }

    /// Height of the image with its axis, or of its bar.
    pub fn body(&self) -> i64 {
        let skirt = self.axes.as_ref().map_or(0, |axes| axes.x.skirt());
        (self.image.height() + skirt).max(if self.bar.is_some() { BAR_HEIGHT } else { 0 }) + 2
    }

    /// Height of the notes.
    pub fn foot(&self) -> i64 {
        if self.notes.is_empty() { 0 } else { 6 + NOTE_LINE * self.notes.len() as i64 }
    }

    /// Draws with the top left corner at (x, y); `head` and `body` are those of the row.
    pub fn draw(&self, canvas: &mut Canvas, x: i64, y: i64, head: i64, body: i64) {
        let left = x + self.gutter();
        self.title.draw(canvas, left, y + 15, Size::Normal, INK);
        self.subtitle.draw(canvas, left, y + 15 + NOTE_LINE + 1, Size::Small, GREY);
        let (width, height, top) = (self.image.width(), self.image.height(), y + head + 1);
        canvas.paste(left + 1, top, &self.image);
        canvas.frame(left + 1, top, width, height, GREY);
        if let Some(axes) = &self.axes {
            axes.x.draw_below(canvas, left + 1, top + height + 1, width);
            axes.y.draw_left(canvas, left, top, height);
        }
        if let Some(bar) = &self.bar {
            bar.draw(canvas, left + 1 + width + BAR_GAP, top, height.max(BAR_HEIGHT));
        }
        for (i, note) in self.notes.iter().enumerate() {
            let base = y + head + body + 3 + NOTE_LINE * (i as i64 + 1) - 2;
            let mut left = left;
            if let Some(swatch) = note.swatch {
                swatch.draw(canvas, left, base);
                left += swatch.width();
            }
            note.text.draw(canvas, left, base, Size::Small, GREY);
        }
    }
}

impl Bar {
    fn ticks(&self) -> super::ticks::Ticks {
        ticks(self.range.low, self.range.high, 7)
    }

    /// From the image to the end of the longest label.
    fn width(&self) -> i64 {
        let ticks = self.ticks();
        let labels = ticks.labels.iter().map(|label| Text::plain(label.as_str()).width(Size::Small));
        let power = if ticks.exponent == 0 { 0 } else { times_power(ticks.exponent).width(Size::Small) };
        BAR_GAP + (BAR_WIDTH + TICK + 4 + labels.max().unwrap_or(0)).max(power)
    }

    fn draw(&self, canvas: &mut Canvas, x: i64, top: i64, height: i64) {
        let most = (height / 38).clamp(2, 7) as usize;
        let ticks = ticks(self.range.low, self.range.high, most);
        let (mut first, mut last) = (top, top + height);
        if ticks.exponent != 0 {
            times_power(ticks.exponent).draw(canvas, x, top + 10, Size::Small, INK);
            first += 18;
        }
        // Pixels beyond an end: the bar ends in a point there.
        if self.range.over() {
            first += BAR_WIDTH / 2;
            point(canvas, x, first, -1, self.map.colour(1.0));
        }
        if self.range.under() {
            last -= BAR_WIDTH / 2;
            point(canvas, x, last - 1, 1, self.map.colour(0.0));
        }
        let span = last - first;
        for row in 0..span {
            let t = 1.0 - (row as f64 + 0.5) / span as f64;
            canvas.fill(x, first + row, BAR_WIDTH, 1, self.map.colour(t));
        }
        canvas.fill(x - 1, first, 1, span, GREY);
        canvas.fill(x + BAR_WIDTH, first, 1, span, GREY);
        if !self.range.over() {
            canvas.fill(x - 1, first - 1, BAR_WIDTH + 2, 1, GREY);
        }
        if !self.range.under() {
            canvas.fill(x - 1, last, BAR_WIDTH + 2, 1, GREY);
        }
        for (value, label) in ticks.values.iter().zip(&ticks.labels) {
            let y = last - 1 - (self.range.position(*value) * (span - 1) as f64).round() as i64;
            canvas.fill(x + BAR_WIDTH + 1, y, TICK, 1, GREY);
            Text::plain(label.as_str()).draw(canvas, x + BAR_WIDTH + TICK + 4, y + 5, Size::Small, INK);
        }
    }
}

/// A triangle as wide as the bar that points up (`way` = -1) or down (1) from row `y`.
fn point(canvas: &mut Canvas, x: i64, y: i64, way: i64, colour: Rgb) {
    for step in 1..=BAR_WIDTH / 2 {
        canvas.fill(x + step - 1, y + way * step, BAR_WIDTH - 2 * step + 2, 1, colour);
        canvas.set(x + step - 2, y + way * step, GREY);
        canvas.set(x + BAR_WIDTH - step + 1, y + way * step, GREY);
    }
}
