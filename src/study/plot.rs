//! Error over CPU time as a picture: SVG of its own, both axes logarithmic, a line with its own colour, dashes and marks for each series.

use std::fmt::Write;

/// What is drawn.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Plot {
    pub title: String,
    pub y_name: String,
    pub series: Vec<Series>,
}

/// One line.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Series {
    pub name: String,
    /// CPU seconds, error, and what the result states of itself; numbers > 0.
    pub points: Vec<Mark>,
    /// Points of others: marks without a line.
    pub reference: bool,
    /// Lines under the picture.
    pub note: String,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mark {
    pub seconds: f64,
    pub error: f64,
    pub stated: Option<f64>,
    /// Least and largest error of the repeats.
    pub span: Option<[f64; 2]>,
}

const WIDTH: f64 = 720.0;
const HEIGHT: f64 = 430.0;
const LEFT: f64 = 78.0;
const RIGHT: f64 = 24.0;
const TOP: f64 = 48.0;
const BOTTOM: f64 = 58.0;
/// Okabe and Ito's colours, told apart by people who see fewer of them.
const COLOURS: [&str; 7] = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#444444"];
const DASHES: [&str; 4] = ["none", "7 4", "2 3", "9 3 2 3"];

impl Plot {
    /// The picture; none where no point has an error and a time above 0.
    pub fn svg(&self) -> Option<String> {
        let marks = || self.series.iter().flat_map(|s| &s.points);
        let x = Axis::around(marks().map(|m| m.seconds))?;
        let y = Axis::around(marks().flat_map(|m| {
            let span = m.span.into_iter().flatten().filter(|v| *v > 0.0);
            [Some(m.error), m.stated].into_iter().flatten().chain(span)
        }))?;
        let legend = 22.0 * self.series.len() as f64;
        let height = HEIGHT + legend;
        let px = |seconds: f64| LEFT + x.place(seconds) * (WIDTH - LEFT - RIGHT);
        let py = |error: f64| HEIGHT - BOTTOM - y.place(error) * (HEIGHT - TOP - BOTTOM);
        let mut svg = String::new();
        let said = "error over CPU seconds, both logarithmic; the numbers stand in study.csv";
        let _ = write!(
            svg,
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height}\" width=\"{WIDTH}\" height=\"{height}\" role=\"img\" aria-labelledby=\"title about\" font-family=\"sans-serif\" font-size=\"13\">\n\
             <title id=\"title\">{}</title>\n<desc id=\"about\">{said}</desc>\n\
             <rect width=\"{WIDTH}\" height=\"{height}\" fill=\"#ffffff\"/>\n\
             <text x=\"{LEFT}\" y=\"26\" font-size=\"15\" font-weight=\"bold\" fill=\"#202020\">{}</text>\n",
            escaped(&self.title),
            escaped(&self.title)
        );
        let (right, bottom) = (WIDTH - RIGHT, HEIGHT - BOTTOM);
        for (value, major) in x.ticks() {
            let (at, colour) = (px(value), if major { "#d6d6d6" } else { "#efefef" });
            let _ = writeln!(svg, "<path d=\"M{at:.1} {TOP}V{bottom}\" stroke=\"{colour}\"/>");
            if major || x.decades() < 1.5 {
                let _ = writeln!(
                    svg,
                    "<text x=\"{at:.1}\" y=\"{:.1}\" text-anchor=\"middle\" fill=\"#202020\">{}</text>",
                    bottom + 18.0,
                    short(value)
                );
            }
        }
        for (value, major) in y.ticks() {
            let (at, colour) = (py(value), if major { "#d6d6d6" } else { "#efefef" });
            let _ = writeln!(svg, "<path d=\"M{LEFT} {at:.1}H{right}\" stroke=\"{colour}\"/>");
            if major || y.decades() < 1.5 {
                let _ = writeln!(
                    svg,
                    "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\" fill=\"#202020\">{}</text>",
                    LEFT - 7.0,
                    at + 4.5,
                    short(value)
                );
            }
        }
        let _ = write!(
            svg,
            "<rect x=\"{LEFT}\" y=\"{TOP}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"none\" stroke=\"#686868\"/>\n\
             <text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\" fill=\"#202020\">CPU seconds</text>\n\
             <text transform=\"translate(20 {:.1}) rotate(-90)\" text-anchor=\"middle\" fill=\"#202020\">{}</text>\n",
            right - LEFT,
            bottom - TOP,
            (LEFT + right) / 2.0,
            bottom + 40.0,
            (TOP + bottom) / 2.0,
            escaped(&self.y_name)
        );
        let mut drawn = 0;
        for (k, series) in self.series.iter().enumerate() {
            let (colour, dash) = (COLOURS[k % COLOURS.len()], DASHES[k % DASHES.len()]);
            let mut points = series.points.clone();
            points.sort_by(|a, b| a.seconds.total_cmp(&b.seconds));
            let line = |of: &dyn Fn(&Mark) -> Option<f64>| {
                let places = points.iter().filter_map(|m| Some(format!("{:.1} {:.1}", px(m.seconds), py(of(m)?))));
                places.collect::<Vec<_>>().join("L")
            };
            if !series.reference && points.len() > 1 {
                let d = line(&|m| Some(m.error));
                let _ = writeln!(
                    svg,
                    "<path d=\"M{d}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"2\" stroke-dasharray=\"{dash}\"/>"
                );
            }
            for m in &points {
                let (at, error) = (px(m.seconds), py(m.error));
                if let Some([low, high]) = m.span.filter(|[low, high]| *low > 0.0 && high > low) {
                    let _ = writeln!(svg, "<path d=\"M{at:.1} {:.1}V{:.1}\" stroke=\"{colour}\"/>", py(low), py(high));
                }
                if let Some(stated) = m.stated.filter(|s| *s > 0.0) {
                    let stated = py(stated);
                    let _ = writeln!(
                        svg,
                        "<path d=\"M{:.1} {stated:.1}H{:.1}\" stroke=\"{colour}\" stroke-width=\"1.5\"/>",
                        at - 8.0,
                        at + 8.0
                    );
                }
                let _ = writeln!(svg, "{}", mark(k, at, error, colour));
                drawn += 1;
            }
            let row = HEIGHT + 22.0 * k as f64 + 4.0;
            let dash = if series.reference { "none" } else { dash };
            let stroke = if series.reference { "none" } else { colour };
            let _ = writeln!(
                svg,
                "<path d=\"M{LEFT} {row:.1}h34\" stroke=\"{stroke}\" stroke-width=\"2\" stroke-dasharray=\"{dash}\"/>{}",
                mark(k, LEFT + 17.0, row, colour)
            );
            let note = if series.note.is_empty() { String::new() } else { format!(": {}", series.note) };
            let _ = writeln!(
                svg,
                "<text x=\"{:.1}\" y=\"{:.1}\" fill=\"#202020\">{}{}</text>",
                LEFT + 44.0,
                row + 4.5,
                escaped(&series.name),
                escaped(&note)
            );
        }
        svg.push_str("</svg>\n");
        (drawn > 0).then_some(svg)
    }
}

/// The mark of a series: circle, square, triangle, diamond, in turn.
fn mark(k: usize, x: f64, y: f64, colour: &str) -> String {
    match k % 4 {
        0 => format!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4\" fill=\"{colour}\"/>"),
        1 => {
            format!("<rect x=\"{:.1}\" y=\"{:.1}\" width=\"7.4\" height=\"7.4\" fill=\"{colour}\"/>", x - 3.7, y - 3.7)
        }
        2 => format!("<path d=\"M{x:.1} {:.1}l4.6 8h-9.2z\" fill=\"{colour}\"/>", y - 5.0),
        _ => format!("<path d=\"M{x:.1} {:.1}l4.8 4.8l-4.8 4.8l-4.8 -4.8z\" fill=\"{colour}\"/>", y - 4.8),
    }
}

/// A logarithmic axis.
struct Axis {
    low: f64,
    high: f64,
}

impl Axis {
    /// Around numbers > 0, with room; none where there are none.
    fn around(values: impl Iterator<Item = f64>) -> Option<Self> {
        let good = values.filter(|v| v.is_finite() && *v > 0.0);
        let (low, high) = good.fold((f64::MAX, 0.0_f64), |(low, high), v| (low.min(v), high.max(v)));
        (high > 0.0).then(|| {
            let room = ((high / low).ln() * 0.06).max(0.18);
            Self { low: low.ln() - room, high: high.ln() + room }
        })
    }

    fn place(&self, value: f64) -> f64 {
        (value.ln() - self.low) / (self.high - self.low)
    }

    fn decades(&self) -> f64 {
        (self.high - self.low) / std::f64::consts::LN_10
    }

    /// 1, 2 and 5 times the powers of ten inside; whether it is such a power.
    fn ticks(&self) -> Vec<(f64, bool)> {
        let powers =
            (self.low / std::f64::consts::LN_10).floor() as i32..=(self.high / std::f64::consts::LN_10).ceil() as i32;
        let all = powers.flat_map(|p| [1, 2, 5].map(|m| (format!("{m}e{p}").parse::<f64>().unwrap_or(1.0), m == 1)));
        all.filter(|(v, _)| (self.low..=self.high).contains(&v.ln())).collect()
    }
}

/// 0.001 to 10000 as they are, others by powers of ten.
fn short(value: f64) -> String {
    if (0.0009..20_000.0).contains(&value) { format!("{value}") } else { format!("{value:e}") }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plot(name: &str) -> Plot {
        let mark = |seconds: f64, error: f64| Mark { seconds, error, stated: Some(error), span: None };
        let series =
            Series { name: name.to_owned(), points: vec![mark(1.0, 4.0), mark(16.0, 1.0)], ..Series::default() };
        Plot { title: "error <of> it".to_owned(), y_name: "%".to_owned(), series: vec![series] }
    }

    #[test]
    fn names_are_text_and_never_markup() {
        let svg = plot("a <script>\"&\"").svg().unwrap();
        assert!(!svg.contains("<script>") && svg.contains("a &lt;script&gt;&quot;&amp;&quot;"), "{svg}");
        assert!(svg.contains("role=\"img\"") && svg.contains("<title id=\"title\">error &lt;of&gt; it</title>"));
    }

    /// A slope of -1/2 is one: four times the time, half the error, the same way in both steps.
    #[test]
    fn places_are_logarithmic() {
        let axis = Axis::around([1.0, 100.0].into_iter()).unwrap();
        assert!((axis.place(10.0) - 0.5).abs() < 1e-12);
        assert_eq!(axis.ticks().iter().filter(|(_, major)| *major).count(), 3);
        assert!(Axis::around([0.0, -1.0].into_iter()).is_none());
        assert_eq!(Plot::default().svg(), None);
    }
}
