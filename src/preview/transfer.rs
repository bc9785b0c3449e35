//! Photon transfer: variance over level with the fitted line, tables with the columns of `photon_transfer`.

use turbid_contract::Table;
use turbid_contract::payload::CameraNoise;

use super::axis::Axis;
use super::canvas::{Canvas, Rgb};
use super::figure::{Figure, Section};
use super::number::number;
use super::panel::{Axes, Note, Panel, Swatch};
use super::text::Text;

const WIDTH: i64 = 460;
const HEIGHT: i64 = 300;
const POINT: f64 = 6.0;
const MEASURED: Rgb = [0, 98, 160];
const FITTED: Rgb = [200, 92, 0];

/// The figure; None where the table is no photon transfer.
pub fn figure(table: &Table, title: &str) -> Option<Figure> {
    let noise = CameraNoise::of(&table.attributes).ok()?;
    let [level, variance, se, fitted] =
        [table.f64s("level")?, table.f64s("variance")?, table.f64s("variance_se")?, table.f64s("fitted")?];
    let most = |of: &[f64]| of.iter().copied().filter(|v| v.is_finite()).fold(0.0, f64::max);
    let end = |highest: f64| if highest > 0.0 { 1.08 * highest } else { 1.0 };
    let tops: Vec<f64> = variance.iter().zip(se).map(|(v, se)| v + se).collect();
    let x = Axis::linear(Text::plain("level above black (numbers)"), 0.0, end(most(level)));
    let y = Axis::linear(Text::plain("variance (numbers squared)"), 0.0, end(most(&tops).max(most(fitted))));
    let at = |level: f64, v: f64| [x.position(level) * WIDTH as f64, (1.0 - y.position(v)) * HEIGHT as f64];
    let mut image = Canvas::new(WIDTH, HEIGHT);
    let mut line: Vec<[f64; 2]> = level.iter().zip(fitted).map(|(l, v)| at(*l, *v)).collect();
    line.sort_by(|a, b| a[0].total_cmp(&b[0]));
    line.windows(2).for_each(|pair| image.line(pair[0], pair[1], 1.6, FITTED));
    for ((l, v), se) in level.iter().zip(variance).zip(se) {
        image.line(at(*l, v - se), at(*l, v + se), 1.0, MEASURED);
        image.line(at(*l, *v), at(*l, *v), POINT, MEASURED);
    }
    let said = |value: f64, se: f64| number(value, 4).then(" +- ").join(number(se, 2));
    let notes = vec![
        Note {
            swatch: Some(Swatch::Colour(MEASURED)),
            text: Text::plain("pixels of like level, with standard errors"),
        },
        Note {
            swatch: Some(Swatch::Colour(FITTED)),
            text: Text::plain("line: ")
                .join(said(noise.electrons_per_number, noise.electrons_per_number_se))
                .then(" electrons per number"),
        },
        Note {
            swatch: None,
            text: Text::plain("read noise ")
                .join(said(noise.read_noise, noise.read_noise_se))
                .then(" electrons, black level ")
                .join(number(noise.black_level, 4)),
        },
    ];
    let title_of = Text::plain("variance of a number over its level");
    let panel = Panel { title: title_of, subtitle: Text::new(), image, bar: None, axes: Some(Axes { x, y }), notes };
    let sections = vec![Section { heading: Text::new(), rows: vec![vec![panel]] }];
    Some(Figure { heading: title.to_owned(), sections, ..Figure::default() })
}
