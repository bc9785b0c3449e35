//! Charts as SVG elements of a page: text and lines by class, so that the page colours them; colours of their own for files that stand alone.

use std::fmt::Write;

use super::super::axis::Axis;
use super::super::colour::ColourMap;
use super::super::number::short;
use super::super::text::Text;
use super::{Chart, Content, Value};

const WIDTH: f64 = 640.0;
const HEIGHT: f64 = 300.0;
const TOP: f64 = 34.0;
const BOTTOM: f64 = 46.0;
const RIGHT: f64 = 20.0;
const ROW: f64 = 24.0;
const CELL: f64 = 56.0;
const COLOURS: [&str; 7] = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#808080"];
const DASHES: [&str; 4] = ["none", "7 4", "2 3", "9 3 2 3"];

/// A number as short as it reads well, in plain letters.
fn plain(value: f64) -> String {
    short(value).replace('−', "-")
}

impl Chart {
    /// What the chart shows, in words.
    pub fn title(&self) -> String {
        let unit = if matches!(self.unit.as_str(), "" | "1") { String::new() } else { format!(" ({})", self.unit) };
        let over = match &self.content {
            Content::Lines { axis, .. } => format!(" over {axis}"),
            Content::Heat { x, y, .. } => format!(" over {} and {}", x.0, y.0),
            Content::Forest { .. } => String::new(),
        };
        format!("{} of {}{unit}{over}", self.what, self.quantity)
    }

    /// The numbers behind it: heads, then a line for each.
    pub fn table(&self) -> (Vec<String>, Vec<Vec<String>>) {
        let head = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>();
        let cells = |v: &Value| [plain(v.value), v.se.map_or_else(|| "-".to_owned(), plain)];
        match &self.content {
            Content::Lines { axis, series } => {
                let rows = series.iter().flat_map(|one| {
                    one.points.iter().map(|(x, v)| [&[one.name.clone(), x.to_string()], &cells(v)[..]].concat())
                });
                (head(&["line", axis, self.what, "standard error"]), rows.collect())
            }
            Content::Forest { rows } => {
                let rows = rows.iter().map(|(name, v)| [std::slice::from_ref(name), &cells(v)[..]].concat());
                (head(&["of", self.what, "standard error"]), rows.collect())
            }
            Content::Heat { x, y, cells } => {
                let rows = cells.iter().zip(&y.1).flat_map(|(row, y)| {
                    row.iter().zip(&x.1).map(move |(cell, x)| {
                        vec![x.to_string(), y.to_string(), cell.map_or_else(|| "-".to_owned(), plain)]
                    })
                });
                (head(&[&x.0, &y.0, self.what]), rows.collect())
            }
        }
    }

    /// The `<svg>` element; `id` keeps the names of its title apart from those of others in the page. `None` where there is nothing to draw.
    pub fn svg(&self, id: &str) -> Option<String> {
        let [low, high] = self.content.range(self.what != "mean")?;
        let mut svg = String::new();
        let (width, height) = match &self.content {
            Content::Lines { series, .. } => self.lines(&mut svg, series, [low, high])?,
            Content::Forest { rows } => self.forest(&mut svg, rows, [low, high]),
            Content::Heat { x, y, cells } => self.heat(&mut svg, x, y, cells),
        };
        let title = escaped(&self.title());
        let said =
            "bars are 95 % by the standard errors, cut where they leave the frame; the table below has the numbers";
        Some(format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.0} {height:.0}\" width=\"{width:.0}\" height=\"{height:.0}\" role=\"img\" aria-labelledby=\"{id}-title {id}-about\" font-family=\"sans-serif\" font-size=\"13\">\n<title id=\"{id}-title\">{title}</title>\n<desc id=\"{id}-about\">{said}</desc>\n<rect class=\"cb\" width=\"{width:.0}\" height=\"{height:.0}\" fill=\"#ffffff\"/>\n{}{svg}</svg>",
            text(12.0, 20.0, "start", &format!("{} of {}", self.what, self.quantity))
        ))
    }

    fn unit_name(&self) -> String {
        let unit = if matches!(self.unit.as_str(), "" | "1") { String::new() } else { format!(" ({})", self.unit) };
        format!("{}{unit}", self.what)
    }

    fn lines(&self, svg: &mut String, series: &[super::Series], [low, high]: [f64; 2]) -> Option<(f64, f64)> {
        let Content::Lines { axis, .. } = &self.content else { return None };
        let x = Axis::of_nodes(Text::plain(axis.as_str()), &self.content.axis_range()?)?;
        let y = Axis::linear(Text::plain(self.unit_name()), low, high);
        let left = 64.0;
        let (inner, bottom) = (WIDTH - left - RIGHT, HEIGHT - BOTTOM);
        let px = |v: f64| left + 10.0 + x.position(v) * (inner - 20.0);
        let py = |v: f64| bottom - y.position(v) * (bottom - TOP);
        for (position, label) in y.labels() {
            let at = bottom - position * (bottom - TOP);
            let _ = writeln!(svg, "<path class=\"cg\" d=\"M{left} {at:.1}H{:.1}\" stroke=\"#dddddd\"/>", WIDTH - RIGHT);
            svg.push_str(&text(left - 8.0, at + 4.0, "end", &label));
        }
        for (position, label) in x.labels() {
            let at = left + 10.0 + position * (inner - 20.0);
            let _ = writeln!(svg, "<path class=\"cg\" d=\"M{at:.1} {TOP}V{bottom:.1}\" stroke=\"#dddddd\"/>");
            svg.push_str(&text(at, bottom + 18.0, "middle", &label));
        }
        if self.what != "mean" {
            let zero = py(0.0);
            let _ =
                writeln!(svg, "<path class=\"cf\" d=\"M{left} {zero:.1}H{:.1}\" stroke=\"#686868\"/>", WIDTH - RIGHT);
        }
        let _ = writeln!(
            svg,
            "<rect class=\"cf\" x=\"{left}\" y=\"{TOP}\" width=\"{inner:.1}\" height=\"{:.1}\" fill=\"none\" stroke=\"#686868\"/>",
            bottom - TOP
        );
        svg.push_str(&text(left + inner / 2.0, bottom + 38.0, "middle", &x.full()));
        let mut row = HEIGHT + 6.0;
        for (k, one) in series.iter().enumerate() {
            let (colour, dash) = (COLOURS[k % COLOURS.len()], DASHES[k % DASHES.len()]);
            let places: Vec<String> =
                one.points.iter().map(|(x, v)| format!("{:.1} {:.1}", px(*x), py(v.value))).collect();
            if places.len() > 1 {
                let _ = writeln!(
                    svg,
                    "<path d=\"M{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"2\" stroke-dasharray=\"{dash}\"/>",
                    places.join("L")
                );
            }
            for (at, value) in &one.points {
                bar(svg, value.interval_within([low, high]), colour, |v| [px(*at), py(v)]);
                svg.push_str(&mark(k, px(*at), py(value.value), colour));
            }
            if !one.name.is_empty() {
                let _ = writeln!(
                    svg,
                    "<path d=\"M{left} {row:.1}h30\" stroke=\"{colour}\" stroke-width=\"2\" stroke-dasharray=\"{dash}\"/>{}",
                    mark(k, left + 15.0, row, colour)
                );
                svg.push_str(&text(left + 40.0, row + 4.0, "start", &one.name));
                row += 20.0;
            }
        }
        Some((WIDTH, row + 2.0))
    }

    fn forest(&self, svg: &mut String, rows: &[(String, Value)], [low, high]: [f64; 2]) -> (f64, f64) {
        let x = Axis::linear(Text::plain(self.unit_name()), low, high);
        // Letters are about 7 wide.
        let longest = rows.iter().map(|(name, _)| name.chars().count()).max().unwrap_or(0).min(40);
        let left = 24.0 + 7.2 * longest as f64;
        let inner = WIDTH - left - RIGHT;
        let bottom = TOP + ROW * rows.len() as f64;
        let px = |v: f64| left + x.position(v) * inner;
        for (position, label) in x.labels() {
            let at = left + position * inner;
            let _ = writeln!(svg, "<path class=\"cg\" d=\"M{at:.1} {TOP}V{bottom:.1}\" stroke=\"#dddddd\"/>");
            svg.push_str(&text(at, bottom + 18.0, "middle", &label));
        }
        if self.what != "mean" {
            let _ = writeln!(svg, "<path class=\"cf\" d=\"M{:.1} {TOP}V{bottom:.1}\" stroke=\"#686868\"/>", px(0.0));
        }
        for (i, (name, value)) in rows.iter().enumerate() {
            let row = TOP + (i as f64 + 0.5) * ROW;
            let name: String = name.chars().take(40).collect();
            svg.push_str(&text(left - 10.0, row + 4.0, "end", &name));
            bar(svg, value.interval_within([low, high]), COLOURS[0], |v| [px(v), row]);
            svg.push_str(&mark(0, px(value.value), row, COLOURS[0]));
        }
        svg.push_str(&text(left + inner / 2.0, bottom + 38.0, "middle", &x.full()));
        (WIDTH, bottom + BOTTOM)
    }

    fn heat(
        &self,
        svg: &mut String,
        x: &(String, Vec<f64>),
        y: &(String, Vec<f64>),
        cells: &[Vec<Option<f64>>],
    ) -> (f64, f64) {
        let [low, high] = self.content.range(false).unwrap_or([-1.0, 1.0]);
        let signed = self.what != "mean" && low < 0.0;
        let largest = low.abs().max(high.abs());
        let across = (WIDTH / x.1.len() as f64).min(CELL);
        let down = (2.0 * HEIGHT / y.1.len() as f64).min(28.0);
        let left = 80.0;
        for (j, row) in cells.iter().enumerate() {
            let top = TOP + down * (y.1.len() - 1 - j) as f64;
            if down >= 12.0 {
                svg.push_str(&text(left - 6.0, top + down / 2.0 + 4.0, "end", &plain(y.1[j])));
            }
            for (i, cell) in row.iter().enumerate() {
                let at = left + across * i as f64;
                let Some(value) = cell else {
                    svg.push_str(&text(at + across / 2.0, top + down / 2.0 + 4.0, "middle", "-"));
                    continue;
                };
                let t = if signed { 0.5 + 0.5 * value / largest } else { (value - low) / (high - low) };
                let map = if signed { ColourMap::Diverging } else { ColourMap::Sequential };
                let [r, g, b] = map.colour(t);
                let _ = write!(
                    svg,
                    "<rect x=\"{at:.1}\" y=\"{top:.1}\" width=\"{across:.1}\" height=\"{down:.1}\" fill=\"#{r:02x}{g:02x}{b:02x}\"/>"
                );
                if across >= 40.0 && down >= 14.0 {
                    let bright = 0.3 * f64::from(r) + 0.6 * f64::from(g) + 0.1 * f64::from(b) > 130.0;
                    let ink = if bright { "#202020" } else { "#ffffff" };
                    let _ = writeln!(
                        svg,
                        "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\" font-size=\"11\" fill=\"{ink}\">{}</text>",
                        at + across / 2.0,
                        top + down / 2.0 + 4.0,
                        plain(*value)
                    );
                }
            }
        }
        let bottom = TOP + down * y.1.len() as f64;
        if across >= 40.0 {
            for (i, value) in x.1.iter().enumerate() {
                svg.push_str(&text(left + across * (i as f64 + 0.5), bottom + 16.0, "middle", &plain(*value)));
            }
        }
        let width = left + across * x.1.len() as f64 + RIGHT;
        let named = format!("{} across, {} up; {}", x.0, y.0, self.unit_name());
        svg.push_str(&text(left, bottom + 36.0, "start", &named));
        (width.max(left + 7.2 * named.chars().count() as f64), bottom + BOTTOM)
    }
}

/// The bar of an interval, where there is one.
fn bar(svg: &mut String, interval: Option<[f64; 2]>, colour: &str, at: impl Fn(f64) -> [f64; 2]) {
    if let Some([low, high]) = interval {
        let ([x0, y0], [x1, y1]) = (at(low), at(high));
        let _ =
            writeln!(svg, "<path d=\"M{x0:.1} {y0:.1}L{x1:.1} {y1:.1}\" stroke=\"{colour}\" stroke-width=\"1.5\"/>");
    }
}

fn text(x: f64, y: f64, anchor: &str, content: &str) -> String {
    format!(
        "<text class=\"ct\" x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\" fill=\"#202020\">{}</text>\n",
        escaped(content)
    )
}

/// A mark whose form tells lines apart as their colour and dashes do.
fn mark(k: usize, x: f64, y: f64, colour: &str) -> String {
    match k % 4 {
        0 => format!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4\" fill=\"{colour}\"/>\n"),
        1 => format!("<rect x=\"{:.1}\" y=\"{:.1}\" width=\"7\" height=\"7\" fill=\"{colour}\"/>\n", x - 3.5, y - 3.5),
        2 => format!("<path d=\"M{x:.1} {:.1}l4.5 8h-9z\" fill=\"{colour}\"/>\n", y - 5.0),
        _ => format!("<path d=\"M{x:.1} {:.1}l5 5l-5 5l-5 -5z\" fill=\"{colour}\"/>\n", y - 5.0),
    }
}

/// Text as XML takes it.
pub fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            // XML has no sign for them.
            c if c.is_control() => out.push(' '),
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::super::charts;
    use super::super::tests::table;

    /// Ends of all elements: each that is opened is closed, in order.
    fn assert_well_formed(svg: &str) {
        let mut open: Vec<&str> = Vec::new();
        for tag in svg.split('<').skip(1) {
            let inside = tag.split('>').next().expect("a tag ends");
            let name = inside.split([' ', '/']).find(|name| !name.is_empty()).unwrap_or_default();
            if inside.starts_with('/') {
                assert_eq!(open.pop(), Some(name), "{svg}");
            } else if !inside.ends_with('/') {
                open.push(name);
            }
        }
        assert!(open.is_empty(), "{open:?} are not closed");
        assert!(!svg.contains("NaN") && !svg.contains("inf") && !svg.contains("style="), "{svg}");
    }

    /// Whatever the numbers: whole elements, no NaN, no style attribute, names as text.
    #[test]
    fn elements_are_whole() {
        /// Rows (metric, values of the axes, value) and the names of the axes.
        type Case<'a> = (&'a [(&'a str, &'a [f64], f64)], &'a [&'a str]);
        let cases: [Case; 6] = [
            (&[("<script>\"&'", &[], 2.0), ("b", &[], -1.0)], &[]),
            (&[("a", &[], 0.0), ("b", &[], 0.0)], &[]),
            (&[("a", &[1.0], 5.0), ("a", &[2.0], 5.0)], &["n"]),
            (&[("a", &[-1.0], 5.0), ("a", &[0.0], -5.0), ("b", &[1e6], 1e300)], &["n"]),
            (&[("a", &[0.001], 1e-300), ("a", &[1000.0], 2e-300)], &["mu_a"]),
            (
                &[
                    ("a", &[1.0, 1.0], 1.0),
                    ("a", &[1.0, 2.0], -2.0),
                    ("a", &[1.0, 3.0], 3.0),
                    ("a", &[2.0, 1.0], 4.0),
                    ("a", &[2.0, 2.0], 4.0),
                    ("a", &[2.0, 3.0], 4.0),
                    ("a", &[3.0, 1.0], 4.0),
                ],
                &["p", "q"],
            ),
        ];
        for (rows, axes) in cases {
            let found = charts(&table(rows, axes));
            assert_eq!(found.len(), 1, "{rows:?}");
            let svg = found[0].svg("c0").expect("there is something to draw");
            assert_well_formed(&svg);
            assert!(!svg.contains("<script"), "{svg}");
            assert_eq!(svg, found[0].svg("c0").unwrap());
            assert!(super::super::panel::figure(&table(rows, axes), "t").is_some());
            let (head, lines) = found[0].table();
            assert!(lines.len() >= rows.len() && lines.iter().all(|line| line.len() == head.len()));
        }
    }

    /// The bar of +2 (1) % reaches from +0.04 to +3.96: where the axis says.
    #[test]
    fn bars_are_where_the_axis_says() {
        let found = charts(&table(&[("a", &[], 2.0), ("b", &[], -2.0)], &[]));
        let svg = found[0].svg("c").unwrap();
        let circles: Vec<f64> =
            svg.split("<circle cx=\"").skip(1).map(|t| t.split('"').next().unwrap().parse().unwrap()).collect();
        let bars: Vec<f64> = svg
            .split("stroke-width=\"1.5\"")
            .filter_map(|t| t.rsplit_once("<path d=\"M")?.1.split(' ').next()?.parse().ok())
            .collect();
        // Two values 4 % apart give the scale; a bar begins 1.96 % left of its mark.
        let scale = (circles[0] - circles[1]) / 4.0;
        assert!((circles[0] - bars[0] - 1.96 * scale).abs() < 0.2, "{circles:?} {bars:?}");
    }
}
