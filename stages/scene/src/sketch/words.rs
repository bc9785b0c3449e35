//! Where names stand in a panel: inside of what they name where they fit, else beside it with a line that leads there. No two overlap.

use super::panel::{BAR_ROW, Colour, PANEL, Panel};

/// Height of a line of letters, and where in it the baseline is.
const HEIGHT: usize = 14;
const BASE: usize = 11;
/// Between letters and what they must not touch.
const GAP: usize = 3;
/// Longer names end in dots.
const LONGEST: usize = 28;
/// So many pixels farther away is better than one more pixel over a line.
const OVER_LINE: f64 = 2.0;
/// Places that are tried lie so many pixels apart.
const STEP: usize = 2;
/// Names farther from their point than this have a line to it.
const NEAR: f64 = 18.0;

/// A name, and the left end of its baseline, as row and column of the panel.
pub type Word = (String, usize, usize);

/// The names in one panel.
pub struct Words {
    /// Pixels that no other name may take.
    taken: Vec<bool>,
    pub placed: Vec<Word>,
}

/// Pixels of a letter; not less than it takes, and mostly more.
fn width_of(letter: char) -> usize {
    match letter {
        'i' | 'j' | 'l' | 't' | 'f' | 'r' | 'I' | ' ' | '.' | ',' | ':' | '\'' | '(' | ')' | '-' => 5,
        'm' | 'w' | 'M' | 'W' | '%' | '@' => 11,
        'A'..='Z' => 9,
        ' '..='~' => 7,
        _ => 13,
    }
}

/// What a name takes of a line.
pub fn width(text: &str) -> usize {
    text.chars().map(width_of).sum::<usize>() + 2 * GAP
}

/// A name that is not too long.
fn short(text: &str) -> String {
    if text.chars().count() <= LONGEST {
        return text.to_owned();
    }
    text.chars().take(LONGEST - 1).chain(['…']).collect()
}

fn length([row, column]: [f64; 2]) -> f64 {
    (row * row + column * column).sqrt()
}

/// Sums over rectangles of a panel.
struct Sums(Vec<u32>);

impl Sums {
    fn of(holds: impl Fn(usize) -> bool) -> Self {
        let mut sums = vec![0; (PANEL + 1) * (PANEL + 1)];
        for row in 0..PANEL {
            let mut along = 0;
            for column in 0..PANEL {
                along += u32::from(holds(row * PANEL + column));
                sums[(row + 1) * (PANEL + 1) + column + 1] = sums[row * (PANEL + 1) + column + 1] + along;
            }
        }
        Self(sums)
    }

    fn within(&self, top: usize, left: usize, width: usize) -> usize {
        let at = |row: usize, column: usize| self.0[row * (PANEL + 1) + column];
        let (bottom, right) = (top + HEIGHT, left + width);
        (at(bottom, right) + at(top, left) - at(top, right) - at(bottom, left)) as usize
    }
}

impl Words {
    /// Beside the bar of the scale, whose words are `bar`.
    pub fn new(bar: &str) -> Self {
        let mut words = Self { taken: vec![false; PANEL * PANEL], placed: Vec::new() };
        let top = BAR_ROW - 20;
        words.take(top, 0, PANEL - top, width(bar).max(PANEL / 3 + 16));
        words
    }

    /// Keeps names off a part of the panel.
    pub fn take(&mut self, top: usize, left: usize, height: usize, width: usize) {
        for row in top..(top + height).min(PANEL) {
            self.taken[row * PANEL + left.min(PANEL)..row * PANEL + (left + width).min(PANEL)].fill(true);
        }
    }

    /// Names the pixels that `is_its` tells: in their midst, else as near to it as there is room. Nothing where there is none at all.
    pub fn name(&mut self, text: &str, panel: &mut Panel, colour: Colour, is_its: &dyn Fn(usize) -> bool) {
        let its: Vec<usize> = (0..PANEL * PANEL).filter(|&i| is_its(i)).collect();
        if its.is_empty() {
            return;
        }
        let sum = its.iter().fold([0, 0], |sum, i| [sum[0] + i / PANEL, sum[1] + i % PANEL]);
        let middle = sum.map(|sum| sum as f64 / its.len() as f64);
        let away =
            |i: usize| (((i / PANEL) as f64 - middle[0]).powi(2) + ((i % PANEL) as f64 - middle[1]).powi(2)).sqrt();
        let text = short(text);
        if let Some(place) = self.best(&text, panel, middle, &|i| is_its(i), &|centre, _| centre) {
            self.put(text, place);
            return;
        }
        let nearest = its.iter().copied().min_by(|&a, &b| away(a).total_cmp(&away(b))).expect("there are some");
        self.name_point(&text, panel, colour, [nearest / PANEL, nearest % PANEL], &|i| !is_its(i));
    }

    /// Names a point of the panel, on pixels that are `free`.
    pub fn name_point(
        &mut self,
        text: &str,
        panel: &mut Panel,
        colour: Colour,
        [row, column]: [usize; 2],
        free: &dyn Fn(usize) -> bool,
    ) {
        let text = short(text);
        let point = [row as f64, column as f64];
        let Some(place) = self.best(&text, panel, point, free, &|_, edge| edge) else { return };
        let ends = [(point[0], place.0, HEIGHT), (point[1], place.1, width(&text))];
        let end = ends.map(|(at, first, long)| at.clamp(first as f64, (first + long - 1) as f64));
        if length([end[0] - point[0], end[1] - point[1]]) > NEAR {
            panel.lead(end, point, colour);
        }
        self.put(text, place);
    }

    fn put(&mut self, text: String, (top, left): (usize, usize)) {
        self.take(top, left, HEIGHT, width(&text));
        self.placed.push((text, top + BASE, left + GAP));
    }

    /// Top left of the best place: free, at the least `cost` of how far its centre and its edge are from `point`, over as few lines as may be.
    fn best(
        &self,
        text: &str,
        panel: &Panel,
        point: [f64; 2],
        free: &dyn Fn(usize) -> bool,
        cost: &dyn Fn(f64, f64) -> f64,
    ) -> Option<(usize, usize)> {
        let width = width(text);
        let (free, busy) = (Sums::of(|i| free(i) && !self.taken[i]), Sums::of(|i| panel.is_line(i)));
        let mut best: Option<(f64, (usize, usize))> = None;
        for top in (1..PANEL.saturating_sub(HEIGHT)).step_by(STEP) {
            for left in (1..PANEL.saturating_sub(width)).step_by(STEP) {
                if free.within(top, left, width) < HEIGHT * width {
                    continue;
                }
                let sides = [(point[0], top, HEIGHT), (point[1], left, width)];
                let centre = sides.map(|(at, first, long)| at - (first as f64 + 0.5 * long as f64));
                let edge = sides.map(|(at, first, long)| at - at.clamp(first as f64, (first + long) as f64));
                let cost = cost(length(centre), length(edge));
                let cost = cost + OVER_LINE * busy.within(top, left, width) as f64;
                if best.is_none_or(|(least, _)| cost < least) {
                    best = Some((cost, (top, left)));
                }
            }
        }
        best.map(|(_, place)| place)
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec2;

    use super::*;

    /// Names of one place stand beside each other, whole and off the bar; the one that does not fit in its body has a line to it.
    #[test]
    fn names_do_not_overlap() {
        let mut panel = Panel::around(DVec2::ZERO, 100.0);
        let mut words = Words::new("20 mm");
        for text in ["carcinoma", "healthy", "a name that is longer than any that a panel has room for", "x"] {
            words.name_point(text, &mut panel, [0.0; 3], [180, 180], &|_| true);
        }
        // No room nearby.
        words.take(60, 270, 90, 90);
        words.name("too wide", &mut panel, [0.0; 3], &|i| (100..105).contains(&(i / PANEL)) && i % PANEL > 350);
        assert_eq!(words.placed.len(), 5);
        assert!(words.placed[2].0.ends_with('…'));
        for (k, (a, row, column)) in words.placed.iter().enumerate() {
            assert!(*row < PANEL && column + width(a) < PANEL + GAP, "{a} at {row}, {column}");
            for (b, other_row, other) in &words.placed[..k] {
                let apart =
                    row.abs_diff(*other_row) >= HEIGHT || column + width(a) <= *other || other + width(b) <= *column;
                assert!(apart, "{a} over {b}");
            }
        }
        assert!((0..PANEL * PANEL).any(|i| panel.is_line(i)), "a line leads to what is too small");
    }
}
