//! A square window on the world, and what is drawn in it.

use glam::{DVec2, DVec3};
use turbid_contract::payload::Scene;

use crate::assemble::{Placed, is_void};

/// Red, green, blue in [0, 1].
pub type Colour = [f32; 3];

/// Height and width of a panel, pixels.
pub const PANEL: usize = 360;

/// Where the bar that gives the scale starts.
pub const BAR_LEFT: usize = 10;
pub const BAR_ROW: usize = PANEL - 12;
pub const BAR_COLOUR: Colour = [0.125; 3];

const PAPER: Colour = [0.97, 0.97, 0.95];
/// An outline below the surface, over the colour of what it is of.
const SHADE: f32 = 0.45;
/// Pixels of a dash, and of the gap behind it.
const DASH: usize = 4;

/// From where to where, mm.
pub type Line = (DVec3, DVec3);

/// Lines and crosses over the objects.
pub struct Ink {
    pub views: Vec<Seen>,
    /// From where to where.
    pub lamps: Vec<(DVec3, DVec3, Colour)>,
    pub detectors: Vec<(Vec<DVec3>, Colour)>,
}

/// Of a camera or projector.
pub struct Seen {
    /// Edge of the field with where the ray to each of its points comes from.
    pub edge: Vec<Line>,
    pub pinhole: DVec3,
    pub look_at: DVec3,
    pub colour: Colour,
}

/// A square window on the world with the same scale along both axes.
pub struct Panel {
    /// Top left.
    corner: DVec2,
    mm_per_pixel: f64,
    pixels: Vec<Colour>,
    /// Where lines run.
    lines: Vec<bool>,
}

/// For each pixel of a view from above the objects that a line straight down meets, the visible one first.
pub struct Columns(Vec<Vec<usize>>);

impl Columns {
    /// Of what lies below the height `top`, mm; void objects hide nothing and are left out.
    pub fn below(panel: &Panel, scene: &Scene, objects: &[Placed<'_>], top: f64) -> Self {
        let void: Vec<bool> = objects.iter().map(|o| is_void(scene, o.object)).collect();
        let (mut stays, mut spans, mut ends) = (Vec::new(), Vec::new(), Vec::new());
        let pixel = |i: usize| {
            let at = panel.point(i / PANEL, i % PANEL).extend(top);
            spans.clear();
            for (object, placed) in objects.iter().enumerate() {
                stays.clear();
                placed.solid.cut(at, DVec3::NEG_Z, None, &mut stays);
                spans.extend(stays.iter().map(|s| (s.enter, s.leave, object)));
            }
            ends.clear();
            ends.extend(spans.iter().flat_map(|s: &(f64, f64, usize)| [s.0.max(0.0), s.1.max(0.0)]));
            ends.sort_by(f64::total_cmp);
            let mut met: Vec<usize> = Vec::new();
            for pair in ends.windows(2).filter(|pair| pair[1] > pair[0]) {
                let within = if pair[1].is_finite() { 0.5 * (pair[0] + pair[1]) } else { pair[0] + 1.0 };
                let here = spans.iter().filter(|s| s.0 < within && within < s.1);
                let owner = here.map(|s| s.2).max_by_key(|&o| objects[o].object.priority);
                met.extend(owner.filter(|&o| !void[o] && !met.contains(&o)));
            }
            met
        };
        Self((0..PANEL * PANEL).map(pixel).collect())
    }
}

impl Panel {
    /// Around a point of its plane; `width` in mm.
    pub fn around(middle: DVec2, width: f64) -> Self {
        let corner = middle + 0.5 * width * DVec2::new(-1.0, 1.0);
        let (pixels, lines) = (vec![PAPER; PANEL * PANEL], vec![false; PANEL * PANEL]);
        Self { corner, mm_per_pixel: width / PANEL as f64, pixels, lines }
    }

    pub fn at(&self, row: usize, column: usize) -> Colour {
        self.pixels[row * PANEL + column]
    }

    /// The middle of a pixel in the plane of the panel, mm.
    fn point(&self, row: usize, column: usize) -> DVec2 {
        self.corner + self.mm_per_pixel * DVec2::new(column as f64 + 0.5, -(row as f64 + 0.5))
    }

    /// What is `there` at each pixel.
    pub fn look(&self, mut there: impl FnMut(DVec2) -> Option<usize>) -> Vec<Option<usize>> {
        (0..PANEL * PANEL).map(|i| there(self.point(i / PANEL, i % PANEL))).collect()
    }

    /// Colours the objects that are `there` in a section, with dashes where they end below the surface and a whole line where it is; whether there are
    /// any dashes. `above`: of two objects that meet, whether the first is in the other, and not the other way around.
    pub fn fill_section(
        &mut self,
        there: &[Option<usize>],
        colour: impl Fn(usize) -> Colour,
        above: impl Fn(usize, usize) -> bool,
    ) -> bool {
        let mut dashed = false;
        for (i, object) in there.iter().enumerate() {
            let Some(object) = *object else { continue };
            let (row, column) = (i / PANEL, i % PANEL);
            self.pixels[i] = colour(object);
            // Lines are 2 pixels thick, within the object that they are of.
            let near = (row.saturating_sub(2)..PANEL.min(row + 3))
                .flat_map(|r| (column.saturating_sub(2)..PANEL.min(column + 3)).map(move |c| (r, c)))
                .filter(|&(r, c)| r.abs_diff(row) + c.abs_diff(column) <= 2)
                .map(|(r, c)| there[r * PANEL + c]);
            let (mut surface, mut below) = (false, false);
            for other in near.filter(|other| *other != Some(object)) {
                surface |= other.is_none();
                below |= other.is_some_and(|other| above(object, other));
            }
            if surface || below {
                self.lines[i] = true;
                dashed |= !surface;
                if surface || is_dash(row, column) {
                    self.pixels[i] = colour(object).map(|c| SHADE * c);
                }
            }
        }
        dashed
    }

    /// Colours what is seen from above, and outlines with dashes what lies below it; whether there is any such.
    pub fn fill_from_above(&mut self, columns: &Columns, colour: impl Fn(usize) -> Colour) -> bool {
        let mut hidden = false;
        for (i, met) in columns.0.iter().enumerate() {
            let (row, column) = (i / PANEL, i % PANEL);
            self.pixels[i] = met.first().map_or(PAPER, |&o| colour(o));
            let inside = [row > 0, row + 1 < PANEL, column > 0, column + 1 < PANEL];
            let neighbours = [i.wrapping_sub(PANEL), i + PANEL, i.wrapping_sub(1), i + 1];
            let misses = |o: &usize| inside.iter().zip(neighbours).any(|(is, at)| *is && !columns.0[at].contains(o));
            // Where a neighbouring line misses a hidden object, its outline runs.
            if let Some(&object) = met.iter().skip(1).find(|o| misses(o)) {
                hidden = true;
                if is_dash(row, column) {
                    self.pixels[i] = colour(object).map(|c| SHADE * c);
                }
            }
        }
        hidden
    }

    /// Dashes around pixels that hold an object which is not in the section.
    pub fn dash_around(&mut self, holds: &[bool], colour: Colour) {
        for i in (0..PANEL * PANEL).filter(|&i| holds[i]) {
            let (row, column) = (i / PANEL, i % PANEL);
            let inside = [row > 0, row + 1 < PANEL, column > 0, column + 1 < PANEL];
            let neighbours = [i.wrapping_sub(PANEL), i + PANEL, i.wrapping_sub(1), i + 1];
            if inside.iter().zip(neighbours).any(|(is, at)| *is && !holds[at]) && is_dash(row, column) {
                (self.pixels[i], self.lines[i]) = (colour.map(|c| SHADE * c), true);
            }
        }
    }

    /// The corners, mm.
    pub fn corners(&self) -> [DVec2; 4] {
        let width = self.mm_per_pixel * PANEL as f64;
        [DVec2::ZERO, DVec2::X, DVec2::new(1.0, -1.0), DVec2::NEG_Y].map(|corner| self.corner + width * corner)
    }

    /// Fields, pinholes, lights, detectors, and the bar of the scale.
    pub fn draw(&mut self, ink: &Ink, flatten: impl Fn(DVec3) -> DVec2) {
        for Seen { edge, pinhole, look_at, colour } in &ink.views {
            let edge: Vec<(DVec2, DVec2)> = edge.iter().map(|&(a, b)| (flatten(a), flatten(b))).collect();
            for (i, &(from, to)) in edge.iter().enumerate() {
                self.line(to, edge[(i + 1) % edge.len()].1, *colour, 1);
                if i % (edge.len() / 4) == 0 {
                    self.line(from, to, *colour, 3);
                }
            }
            self.axis(flatten(*pinhole), flatten(*look_at), *colour);
            self.cross(flatten(*pinhole), *colour);
        }
        for &(from, to, colour) in &ink.lamps {
            self.line(flatten(from), flatten(to), colour, 3);
            self.cross(flatten(from), colour);
        }
        for (outline, colour) in &ink.detectors {
            for (i, &corner) in outline.iter().enumerate() {
                let next = outline[(i + 1) % outline.len()];
                self.line(flatten(corner), flatten(next), *colour, 1);
            }
        }
        let (_, pixels_long) = self.bar();
        for column in BAR_LEFT..BAR_LEFT + pixels_long {
            for row in BAR_ROW..BAR_ROW + 2 {
                self.pixels[row * PANEL + column] = BAR_COLOUR;
            }
        }
    }

    fn cross(&mut self, middle: DVec2, colour: Colour) {
        let arm = 5.0 * self.mm_per_pixel;
        for (a, b) in [(DVec2::X, DVec2::Y), (DVec2::Y, DVec2::X)] {
            for side in -2..=2 {
                let shift = f64::from(side) * self.mm_per_pixel * b;
                self.line(middle - arm * a + shift, middle + arm * a + shift, colour, 1);
            }
        }
    }

    /// What stands over the bar.
    pub fn bar_text(&self) -> String {
        format!("{} mm", self.bar().0)
    }

    /// A round length in mm, up to a third of the panel, and how many pixels that are.
    pub fn bar(&self) -> (f64, usize) {
        let third = self.mm_per_pixel * PANEL as f64 / 3.0;
        let power = libm::exp10(libm::floor(libm::log10(third)));
        let length = [5.0, 2.0, 1.0].map(|digit| digit * power).into_iter().find(|l| *l <= third).unwrap_or(third);
        (length, (length / self.mm_per_pixel) as usize)
    }

    /// Draws every `dash`-th pixel of a line.
    pub fn line(&mut self, from: DVec2, to: DVec2, colour: Colour, dash: usize) {
        self.stroke(self.place(from), self.place(to), colour, |i| i.is_multiple_of(dash));
    }

    /// An optical axis: a dash, a dot, a dash.
    fn axis(&mut self, from: DVec2, to: DVec2, colour: Colour) {
        self.stroke(self.place(from), self.place(to), colour, |i| !matches!(i % 20, 12..15 | 17..));
    }

    /// A line between two places, as (row, column), over whatever is there.
    pub fn lead(&mut self, from: [f64; 2], to: [f64; 2], colour: Colour) {
        let [from, to] = [from, to].map(|[row, column]| DVec2::new(column + 0.5, row + 0.5));
        self.stroke(from, to, colour, |_| true);
    }

    /// The edge of what another panel shows.
    pub fn frame(&mut self, shown: &Self, colour: Colour) {
        let corners = shown.corners();
        for (i, &corner) in corners.iter().enumerate() {
            self.line(corner, corners[(i + 1) % 4], colour, 1);
        }
    }

    /// Row and column of a point, if the panel has it.
    pub fn pixel(&self, p: DVec2) -> Option<[usize; 2]> {
        let p = self.place(p).floor();
        let inside = |x: f64| (0.0..PANEL as f64).contains(&x);
        (inside(p.x) && inside(p.y)).then_some([p.y as usize, p.x as usize])
    }

    /// Whether a line runs over a pixel.
    pub fn is_line(&self, i: usize) -> bool {
        self.lines[i]
    }

    /// In pixels from the top left, to the right and down.
    fn place(&self, p: DVec2) -> DVec2 {
        (p - self.corner) / self.mm_per_pixel * DVec2::new(1.0, -1.0)
    }

    /// Draws those pixels of a line of which `on` is true, counted from its visible start.
    fn stroke(&mut self, from: DVec2, to: DVec2, colour: Colour, on: impl Fn(usize) -> bool) {
        let Some((from, to)) = clipped(from, to) else { return };
        let steps = (to - from).abs().max_element().ceil().max(1.0) as usize;
        for i in (0..=steps).filter(|&i| on(i)) {
            let p = from + (i as f64 / steps as f64) * (to - from);
            let (column, row) = (p.x.floor(), p.y.floor());
            if (0.0..PANEL as f64).contains(&column) && (0.0..PANEL as f64).contains(&row) {
                let i = row as usize * PANEL + column as usize;
                (self.pixels[i], self.lines[i]) = (colour, true);
            }
        }
    }
}

/// Dashes along a slope that no edge of an object is likely to have: along it there would be none.
fn is_dash(row: usize, column: usize) -> bool {
    ((3 * row + 5 * column) / (4 * DASH)).is_multiple_of(2)
}

/// The part of a line in pixels that lies in the panel: a pinhole may be far outside.
fn clipped(from: DVec2, to: DVec2) -> Option<(DVec2, DVec2)> {
    let (mut first, mut last) = (0.0_f64, 1.0_f64);
    let step = to - from;
    for (start, step) in [(from.x, step.x), (from.y, step.y)] {
        let ends = [(0.0 - start) / step, (PANEL as f64 - start) / step];
        if step == 0.0 {
            if !(0.0..=PANEL as f64).contains(&start) {
                return None;
            }
        } else {
            first = first.max(ends[0].min(ends[1]));
            last = last.min(ends[0].max(ends[1]));
        }
    }
    (first <= last).then(|| (from + first * step, from + last * step))
}
