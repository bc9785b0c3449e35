//! Error against time as a figure, both logarithmic.

use std::fmt::Write as _;

pub struct Curve {
    pub name: String,
    pub dashed: bool,
    pub color: usize,
    /// (seconds, error)
    pub points: Vec<(f64, f64)>,
}

/// 1 us to 10 ms, errors 1e-8 to 0.1.
pub fn plot(curves: &[Curve]) -> String {
    const COLORS: [&str; 4] = ["#1f77b4", "#d62728", "#2ca02c", "#9467bd"];
    let (left, top, width, height) = (70.0, 20.0, 480.0, 360.0);
    let x = |s: f64| left + width * (s.log10() + 6.0) / 4.0;
    let y = |e: f64| top + height * (-1.0 - e.log10()) / 7.0;
    let mut svg = String::from(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 780 430\" font-family=\"sans-serif\" font-size=\"12\">\n<rect width=\"780\" height=\"430\" fill=\"white\"/>\n",
    );
    for (decade, label) in [(-6, "1 us"), (-5, "10 us"), (-4, "100 us"), (-3, "1 ms"), (-2, "10 ms")] {
        let at = x(10f64.powi(decade));
        let (bottom, text) = (top + height, top + height + 18.0);
        let _ = writeln!(
            svg,
            "<path d=\"M{at:.1} {top}V{bottom}\" stroke=\"#ddd\"/><text x=\"{at:.1}\" y=\"{text}\" text-anchor=\"middle\">{label}</text>"
        );
    }
    for decade in -8..=-1 {
        let at = y(10f64.powi(decade));
        let (right, text) = (left + width, left - 6.0);
        let _ = writeln!(
            svg,
            "<path d=\"M{left} {at:.1}H{right}\" stroke=\"#ddd\"/><text x=\"{text}\" y=\"{:.1}\" text-anchor=\"end\">1e{decade}</text>",
            at + 4.0
        );
    }
    let _ = writeln!(
        svg,
        "<text x=\"{}\" y=\"422\" text-anchor=\"middle\">CPU time of one calculation or solution</text><text x=\"16\" y=\"{}\" transform=\"rotate(-90 16 {1})\" text-anchor=\"middle\">worst error (inverse: relative)</text>",
        left + 0.5 * width,
        top + 0.5 * height
    );
    for (i, curve) in curves.iter().enumerate() {
        let color = COLORS[curve.color % COLORS.len()];
        let dash = if curve.dashed { "6 3" } else { "none" };
        let line: Vec<String> = curve.points.iter().map(|&(s, e)| format!("{:.1},{:.1}", x(s), y(e))).collect();
        let _ = writeln!(
            svg,
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"1.6\" stroke-dasharray=\"{dash}\"/>",
            line.join(" ")
        );
        for &(s, e) in &curve.points {
            let _ = writeln!(svg, "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"3\" fill=\"{color}\"/>", x(s), y(e));
        }
        let row = top + 12.0 + 18.0 * i as f64;
        let (start, text) = (left + width + 12.0, left + width + 46.0);
        let _ = writeln!(
            svg,
            "<path d=\"M{start} {row}h28\" stroke=\"{color}\" stroke-width=\"1.6\" stroke-dasharray=\"{dash}\"/><text x=\"{text}\" y=\"{}\">{}</text>",
            row + 4.0,
            curve.name
        );
    }
    svg.push_str("</svg>\n");
    svg
}
