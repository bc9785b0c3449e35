//! Axes of a plot: linear or logarithmic, with ticks, labels and a name.

use super::canvas::{Canvas, GREY, INK};
use super::number::{number, times_power};
use super::text::{Size, Text};
use super::ticks::ticks;

const MAJOR: i64 = 5;
const MINOR: i64 = 3;
const LINE: i64 = 17;

/// From `low` to `high` (finite, low < high), or a row for each name.
#[derive(Clone, Debug)]
pub struct Axis {
    pub name: Text,
    low: f64,
    high: f64,
    log: bool,
    /// From the high end to the low; of numbers none.
    names: Vec<Text>,
}

struct Mark {
    /// 0 at the low end, 1 at the high end.
    position: f64,
    /// Empty for small ticks.
    label: Text,
}

impl Axis {
    pub fn linear(name: Text, low: f64, high: f64) -> Self {
        Self { name, low, high, log: false, names: Vec::new() }
    }

    /// Equal rows with names, the first at the high end: on top of a vertical axis.
    pub fn names(name: Text, names: Vec<Text>) -> Self {
        Self { names, ..Self::linear(name, 0.0, 1.0) }
    }

    /// An axis that holds ascending nodes: logarithmic where they span a factor of 20 or more.
    pub fn of_nodes(name: Text, nodes: &[f64]) -> Option<Self> {
        let (low, high) = (*nodes.first()?, *nodes.last()?);
        // A single node stands in the middle.
        let (low, high) = match high - low {
            0.0 if low == 0.0 => (-1.0, 1.0),
            0.0 => (low - 0.1 * low.abs(), low + 0.1 * low.abs()),
            _ => (low, high),
        };
        Some(Self { name, low, high, log: low > 0.0 && high >= 20.0 * low, names: Vec::new() })
    }

    /// Where a value lies: 0 at the low end, 1 at the high end; below 0 and above 1 outside.
    pub fn position(&self, value: f64) -> f64 {
        if self.log {
            libm::log(value / self.low) / libm::log(self.high / self.low)
        } else {
            (value - self.low) / (self.high - self.low)
        }
    }

    fn marks(&self) -> (Vec<Mark>, i32) {
        if !self.names.is_empty() {
            let middle = |i: usize| 1.0 - (i as f64 + 0.5) / self.names.len() as f64;
            let mark = |(i, name): (usize, &Text)| Mark { position: middle(i), label: name.clone() };
            return (self.names.iter().enumerate().rev().map(mark).collect(), 0);
        }
        if !self.log {
            let t = ticks(self.low, self.high, 7);
            let mark = |(value, label): (&f64, &String)| Mark {
                position: self.position(*value),
                label: Text::plain(label.as_str()),
            };
            return (t.values.iter().zip(&t.labels).map(mark).collect(), t.exponent);
        }
        let (first, last) = (super::number::exponent_of(self.low), super::number::exponent_of(self.high));
        // Few decades: 2 and 5 get labels too.
        let labelled: &[i32] = if last - first <= 2 { &[1, 2, 5] } else { &[1] };
        let mut marks = Vec::new();
        for (power, digit) in (first..=last).flat_map(|power| (1..10).map(move |digit| (power, digit))) {
            let value: f64 = format!("{digit}e{power}").parse().expect("a digit with an exponent is a number");
            if (self.low..=self.high).contains(&value) {
                let label = if labelled.contains(&digit) { number(value, 1) } else { Text::new() };
                marks.push(Mark { position: self.position(value), label });
            }
        }
        (marks, 0)
    }

    /// Where its labels stand (0 at the low end, 1 at the high end), in plain letters.
    pub fn labels(&self) -> Vec<(f64, String)> {
        let (marks, _) = self.marks();
        marks.into_iter().filter(|m| !m.label.is_empty()).map(|m| (m.position, m.label.letters())).collect()
    }

    /// The name as [`Self::labels`] are to be read, in plain letters.
    pub fn full(&self) -> String {
        let (_, exponent) = self.marks();
        if exponent == 0 { self.name.letters() } else { format!("{}, 10^{exponent}", self.name.letters()) }
    }

    /// The name, with the power of ten that its labels leave out.
    fn full_name(&self, exponent: i32) -> Text {
        if exponent == 0 { self.name.clone() } else { self.name.clone().then(", ").join(times_power(exponent)) }
    }

    /// Space that a vertical axis takes at the left of its plot.
    pub fn gutter(&self) -> i64 {
        let (marks, _) = self.marks();
        marks.iter().map(|m| m.label.width(Size::Small)).max().unwrap_or(0) + MAJOR + 4 + LINE
    }

    /// Space that a horizontal axis takes under its plot.
    pub fn skirt(&self) -> i64 {
        MAJOR + 2 * LINE + 2
    }

    /// Draws a horizontal axis under the row `y`, from column `x` over `length` pixels.
    pub fn draw_below(&self, canvas: &mut Canvas, x: i64, y: i64, length: i64) {
        let (marks, exponent) = self.marks();
        // Labels that would touch are left out.
        let mut free = i64::MIN;
        for mark in marks {
            let at = x + (mark.position * (length - 1) as f64).round() as i64;
            canvas.fill(at, y, 1, if mark.label.is_empty() { MINOR } else { MAJOR }, GREY);
            let width = mark.label.width(Size::Small);
            if !mark.label.is_empty() && at - width / 2 > free {
                mark.label.draw(canvas, at - width / 2, y + MAJOR + 13, Size::Small, INK);
                free = at + width - width / 2 + 6;
            }
        }
        let name = self.full_name(exponent);
        name.draw(canvas, x + (length - name.width(Size::Small)) / 2, y + MAJOR + 13 + LINE, Size::Small, INK);
    }

    /// Draws a vertical axis left of the column `x`, from row `y` (its high end) over `length` pixels.
    pub fn draw_left(&self, canvas: &mut Canvas, x: i64, y: i64, length: i64) {
        let (marks, exponent) = self.marks();
        let mut free = i64::MAX;
        for mark in marks {
            let at = y + length - 1 - (mark.position * (length - 1) as f64).round() as i64;
            let tick = if mark.label.is_empty() { MINOR } else { MAJOR };
            canvas.fill(x - tick, at, tick, 1, GREY);
            if !mark.label.is_empty() && at + 8 < free {
                let width = mark.label.width(Size::Small);
                mark.label.draw(canvas, x - MAJOR - 3 - width, at + 5, Size::Small, INK);
                free = at - 8;
            }
        }
        let name = self.full_name(exponent);
        let width = name.width(Size::Small);
        let mut strip = Canvas::new(width, LINE);
        name.draw(&mut strip, 0, 12, Size::Small, INK);
        canvas.paste(x - self.gutter(), y + (length - width) / 2, &strip.turned());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_lie_on_the_axis_in_order() {
        for nodes in
            [vec![1e-4, 0.5], vec![0.1, 5.0], vec![0.3, 0.4], vec![0.0, 0.2], vec![2.0], vec![0.0], vec![1e-30, 1e30]]
        {
            let axis = Axis::of_nodes(Text::new(), &nodes).unwrap();
            let (marks, _) = axis.marks();
            assert!(marks.len() >= 2, "{nodes:?}");
            assert!(marks.iter().all(|m| (-1e-12..=1.0 + 1e-12).contains(&m.position)), "{nodes:?}");
            assert!(marks.windows(2).all(|m| m[0].position < m[1].position), "{nodes:?}");
            assert!(nodes.iter().all(|&n| (0.0..=1.0).contains(&axis.position(n))), "{nodes:?}");
        }
        assert!(Axis::of_nodes(Text::new(), &[]).is_none());
    }

    #[test]
    fn decades_have_labels() {
        let labels = |low, high| -> Vec<String> {
            let (marks, _) = Axis::of_nodes(Text::new(), &[low, high]).unwrap().marks();
            marks.iter().map(|m| m.label.letters()).filter(|l| !l.is_empty()).collect()
        };
        assert_eq!(labels(0.1, 5.0), ["0.1", "0.2", "0.5", "1", "2", "5"]);
        assert_eq!(labels(1e-4, 0.5), ["10−4", "0.001", "0.01", "0.1"]);
        assert_eq!(labels(1e-6, 5e4).len(), 11);
    }

    /// A decade is as long as the next on a logarithmic axis; 1e-12 is rounding of the logarithms.
    #[test]
    fn decades_are_equal() {
        let axis = Axis::of_nodes(Text::new(), &[1e-4, 1.0]).unwrap();
        assert!((-4..=0).all(|k| (axis.position(libm::exp10(f64::from(k))) - f64::from(k + 4) / 4.0).abs() < 1e-12));
    }
}
