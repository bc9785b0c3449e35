//! Text with symbols, subscripts and superscripts, drawn from a small atlas of glyphs (see `glyphs/make.py`).

use std::sync::LazyLock;

use super::canvas::{Canvas, Rgb};

/// Heights of letters that the atlas holds, in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Size {
    /// Subscripts.
    Tiny = 10,
    /// Ticks, captions.
    Small = 12,
    /// Titles of panels.
    Normal = 14,
    /// The bold heading.
    Heading = 15,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Style {
    Upright,
    Symbol,
    Sub,
    Super,
}

/// A line of text in pieces of one style each.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Text {
    runs: Vec<(Style, String)>,
}

impl Text {
    pub fn new() -> Self {
        Self::default()
    }

    /// Upright text, as it stands: nothing in it is markup.
    pub fn plain(text: impl Into<String>) -> Self {
        Self::new().then(text)
    }

    /// A symbol of a quantity, in italics.
    pub fn symbol(text: impl Into<String>) -> Self {
        Self { runs: vec![(Style::Symbol, text.into())] }
    }

    #[must_use]
    pub fn then(mut self, text: impl Into<String>) -> Self {
        self.runs.push((Style::Upright, text.into()));
        self
    }

    #[must_use]
    pub fn sub(mut self, text: impl Into<String>) -> Self {
        self.runs.push((Style::Sub, text.into()));
        self
    }

    #[must_use]
    pub fn sup(mut self, text: impl Into<String>) -> Self {
        self.runs.push((Style::Super, text.into()));
        self
    }

    #[must_use]
    pub fn join(mut self, other: Text) -> Self {
        self.runs.extend(other.runs);
        self
    }

    pub fn is_empty(&self) -> bool {
        self.runs.iter().all(|(_, text)| text.is_empty())
    }

    /// The letters without their style.
    pub fn letters(&self) -> String {
        self.runs.iter().map(|(_, text)| text.as_str()).collect()
    }

    /// Width in pixels.
    pub fn width(&self, size: Size) -> i64 {
        self.runs.iter().map(|(style, text)| GLYPHS.font(*style, size).width(text)).sum()
    }

    /// The text, shortened with an ellipsis until it fits; only for upright text such as titles from outside.
    pub fn shortened(text: &str, size: Size, width: i64) -> Text {
        let mut letters: Vec<char> = text.chars().collect();
        let whole = Text::plain(text);
        if whole.width(size) <= width {
            return whole;
        }
        loop {
            let shorter = Text::plain(letters.iter().collect::<String>() + "…");
            if shorter.width(size) <= width || letters.pop().is_none() {
                return shorter;
            }
        }
    }

    /// Draws with the left end at `x` and the baseline at `y`; returns where the pen ends.
    pub fn draw(&self, canvas: &mut Canvas, x: i64, y: i64, size: Size, colour: Rgb) -> i64 {
        let mut pen = x;
        for (style, text) in &self.runs {
            let shift = match style {
                Style::Sub => 3,
                Style::Super => -(size as i64) / 3,
                _ => 0,
            };
            pen = GLYPHS.font(*style, size).draw(&GLYPHS, canvas, pen, y + shift, text, colour);
        }
        pen
    }
}

/// White columns left and right of each glyph's advance in the atlas: letters may lean out.
const PAD: i64 = 5;

static GLYPHS: LazyLock<Glyphs> =
    LazyLock::new(|| Glyphs::read(include_bytes!("glyphs/glyphs.png"), include_str!("glyphs/glyphs.txt")));

struct Glyphs {
    characters: Vec<char>,
    fonts: Vec<Font>,
    /// Coverage 0..=255, rows of `width`.
    coverage: Vec<u8>,
    width: i64,
}

struct Font {
    face: String,
    size: i64,
    ascent: i64,
    height: i64,
    /// First row in the atlas.
    top: i64,
    advances: Vec<i64>,
    /// First column of each cell in the atlas.
    starts: Vec<i64>,
}

impl Glyphs {
    fn read(atlas: &[u8], metrics: &str) -> Self {
        let mut reader = png::Decoder::new(std::io::Cursor::new(atlas)).read_info().expect("the atlas is a PNG");
        let mut coverage = vec![0; reader.output_buffer_size().expect("the atlas is small")];
        let info = reader.next_frame(&mut coverage).expect("the atlas is whole");
        let mut lines = metrics.lines();
        let characters = lines.next().expect("the first line holds the characters").chars().collect();
        let mut top = 0;
        let mut fonts = Vec::new();
        for line in lines {
            let mut words = line.split(' ');
            let face = words.next().expect("a font has a face").to_owned();
            let mut numbers = words.map(|word| word.parse::<i64>().expect("sizes and advances are whole numbers"));
            let mut next = || numbers.next().expect("a font has size, ascent, height");
            let (size, ascent, height) = (next(), next(), next());
            let advances: Vec<i64> = numbers.collect();
            let starts = advances
                .iter()
                .scan(0, |x, advance| {
                    let start = *x;
                    *x += advance + 2 * PAD;
                    Some(start)
                })
                .collect();
            fonts.push(Font { face, size, ascent, height, top, advances, starts });
            top += height;
        }
        Self { characters, fonts, coverage, width: i64::from(info.width) }
    }

    fn font(&self, style: Style, size: Size) -> &Font {
        let (face, size) = match (style, size) {
            (Style::Sub | Style::Super, _) => ("regular", Size::Tiny),
            (_, Size::Heading) => ("bold", Size::Heading),
            (Style::Symbol, size) => ("oblique", size),
            (Style::Upright, size) => ("regular", size),
        };
        let found = self.fonts.iter().find(|font| font.face == face && font.size == size as i64);
        found.expect("the atlas holds every size that is named")
    }

    /// Cell of a character; what the atlas does not hold is shown as a question mark.
    fn index(&self, c: char) -> usize {
        let find = |c| self.characters.iter().position(|&known| known == c);
        find(c).or_else(|| find('?')).expect("the atlas holds a question mark")
    }
}

impl Font {
    fn width(&self, text: &str) -> i64 {
        text.chars().map(|c| self.advances[GLYPHS.index(c)]).sum()
    }

    fn draw(&self, glyphs: &Glyphs, canvas: &mut Canvas, x: i64, y: i64, text: &str, colour: Rgb) -> i64 {
        let mut pen = x;
        for c in text.chars() {
            let index = glyphs.index(c);
            for row in 0..self.height {
                for column in 0..self.advances[index] + 2 * PAD {
                    let at = (self.top + row) * glyphs.width + self.starts[index] + column;
                    canvas.blend(pen - PAD + column, y - self.ascent + row, colour, glyphs.coverage[at as usize]);
                }
            }
            pen += self.advances[index];
        }
        pen
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every character but the space leaves ink in every font, and a cell's ink is its own: none at its edges.
    #[test]
    fn the_atlas_fits_its_metrics() {
        for font in &GLYPHS.fonts {
            assert_eq!(font.advances.len(), GLYPHS.characters.len());
            for (i, &c) in GLYPHS.characters.iter().enumerate() {
                let ink = |column: i64| -> u32 {
                    (0..font.height)
                        .map(|row| {
                            u32::from(
                                GLYPHS.coverage[((font.top + row) * GLYPHS.width + font.starts[i] + column) as usize],
                            )
                        })
                        .sum()
                };
                let width = font.advances[i] + 2 * PAD;
                assert_eq!(c != ' ', (0..width).map(ink).sum::<u32>() > 0, "{c:?} in {} {}", font.face, font.size);
                assert_eq!(ink(0) + ink(width - 1), 0, "{c:?} in {} {} is cut", font.face, font.size);
            }
        }
    }

    #[test]
    fn drawing_advances_by_the_width() {
        let text = Text::symbol("μ").sub("s").then("′ = 0.64 mm").sup("−1");
        for size in [Size::Small, Size::Normal] {
            let mut canvas = Canvas::new(200, 40);
            assert_eq!(text.draw(&mut canvas, 5, 25, size, [0, 0, 0]) - 5, text.width(size));
            assert_ne!(canvas, Canvas::new(200, 40));
        }
    }

    #[test]
    fn long_titles_are_shortened_to_fit() {
        for width in [20, 100, 333] {
            let text = Text::shortened(&"quickstart ".repeat(20), Size::Heading, width);
            assert!(text.width(Size::Heading) <= width && text.letters().ends_with('…'));
        }
        assert_eq!(Text::shortened("maps", Size::Heading, 200), Text::plain("maps"));
    }
}
