//! A figure: a heading, rows of panels, remarks at its foot.

use super::canvas::{Canvas, GREY, INK};
use super::panel::Panel;
use super::text::{Size, Text};

const MARGIN: i64 = 24;
const COLUMN_GAP: i64 = 26;
const ROW_GAP: i64 = 18;
/// A long heading may widen the figure up to here.
const HEADING_WIDTH: i64 = 900;

/// Height of a line under the heading, and how many there may be.
const LINE: i64 = 17;
const MOST_LINES: usize = 3;

/// Rows of panels that share column widths.
#[derive(Clone, Debug, Default)]
pub struct Section {
    /// Empty for the first, whose heading is the figure's.
    pub heading: Text,
    pub rows: Vec<Vec<Panel>>,
}

#[derive(Clone, Debug, Default)]
pub struct Figure {
    pub heading: String,
    /// A line under the heading, which may fill two.
    pub subheading: String,
    pub sections: Vec<Section>,
    pub remarks: Vec<Text>,
}

impl Section {
    fn cell_width(&self) -> i64 {
        self.rows.iter().flatten().map(Panel::width).max().unwrap_or(0)
    }

    fn width(&self) -> i64 {
        let columns = self.rows.iter().map(Vec::len).max().unwrap_or(0) as i64;
        (columns * (self.cell_width() + COLUMN_GAP) - COLUMN_GAP).max(self.heading.width(Size::Normal))
    }

    fn head(&self) -> i64 {
        if self.heading.is_empty() { 0 } else { 28 }
    }

    fn height(&self) -> i64 {
        self.head() + self.rows.iter().map(|row| row_heights(row).iter().sum::<i64>() + ROW_GAP).sum::<i64>()
    }

    fn draw(&self, canvas: &mut Canvas, mut y: i64) {
        if !self.heading.is_empty() {
            canvas.fill(MARGIN, y, canvas.width() - 2 * MARGIN, 1, [214, 214, 214]);
            self.heading.draw(canvas, MARGIN, y + 19, Size::Normal, GREY);
            y += self.head();
        }
        let cell = self.cell_width();
        for row in &self.rows {
            let [head, body, foot] = row_heights(row);
            for (column, panel) in row.iter().enumerate() {
                panel.draw(canvas, MARGIN + column as i64 * (cell + COLUMN_GAP), y, head, body);
            }
            y += head + body + foot + ROW_GAP;
        }
    }
}

/// Heights over, of and under the images of a row, so that they align.
fn row_heights(row: &[Panel]) -> [i64; 3] {
    let most = |of: fn(&Panel) -> i64| row.iter().map(of).max().unwrap_or(0);
    [Panel::head(row.iter().any(|p| !p.subtitle.is_empty())), most(Panel::body), most(Panel::foot)]
}

impl Figure {
    pub fn draw(&self) -> Canvas {
        let heading = Text::shortened(&self.heading, Size::Heading, HEADING_WIDTH);
        let lines = wrapped(&self.subheading);
        let head = if self.heading.is_empty() { 0 } else { 30 } + LINE * lines.len() as i64;
        let foot = 18 * self.remarks.len() as i64;
        let widths = self.sections.iter().map(Section::width);
        let remarks = self.remarks.iter().map(|r| r.width(Size::Small));
        let subheadings = lines.iter().map(|line| line.width(Size::Small));
        let inner = widths.chain(remarks).chain(subheadings).chain([heading.width(Size::Heading)]).max().unwrap_or(0);
        let sections: i64 = self.sections.iter().map(Section::height).sum();
        let mut canvas = Canvas::new(inner + 2 * MARGIN, MARGIN + head + sections + foot + MARGIN - ROW_GAP / 2);
        heading.draw(&mut canvas, MARGIN, MARGIN + 12, Size::Heading, INK);
        for (i, line) in lines.iter().enumerate() {
            line.draw(&mut canvas, MARGIN, MARGIN + 12 + LINE * (i as i64 + 1), Size::Small, GREY);
        }
        let mut y = MARGIN + head;
        for section in &self.sections {
            section.draw(&mut canvas, y);
            y += section.height();
        }
        for remark in &self.remarks {
            remark.draw(&mut canvas, MARGIN, y + 8, Size::Small, GREY);
            y += 18;
        }
        canvas
    }
}

/// Lines of whole words no wider than a heading may be; the last of them is cut off where there are too many.
fn wrapped(text: &str) -> Vec<Text> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        let longer = lines.last().map_or(word.to_owned(), |line| format!("{line} {word}"));
        let full = lines.len() == MOST_LINES;
        match lines.last_mut() {
            Some(line) if full || Text::plain(longer.as_str()).width(Size::Small) <= HEADING_WIDTH => *line = longer,
            _ => lines.push(word.to_owned()),
        }
    }
    lines.iter().map(|line| Text::shortened(line, Size::Small, HEADING_WIDTH)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_subheadings_wrap_and_end() {
        assert!(wrapped("").is_empty());
        assert_eq!(wrapped("--set vars.samples=64").len(), 1);
        let many = "--set vars.samples=64 ".repeat(60);
        let lines = wrapped(&many);
        assert_eq!(lines.len(), MOST_LINES);
        assert!(lines.iter().all(|line| line.width(Size::Small) <= HEADING_WIDTH));
        assert!(lines[MOST_LINES - 1].letters().ends_with('…'));
        assert!(wrapped(&"x".repeat(3000))[0].width(Size::Small) <= HEADING_WIDTH);
    }
}
