//! A data set at a glance: some of its samples, and how its numbers are spread in each split.

use std::collections::{BTreeMap, BTreeSet};

use ndarray::Array2;

use super::axis::Axis;
use super::canvas::{Canvas, GREY, INK, Rgb};
use super::caption::Caption;
use super::colour::{ColourMap, category};
use super::figure::{Figure, Section};
use super::notation::{in_unit, is_error, unit};
use super::panel::{Axes, Note, Panel, paint};
use super::pixels::{Reduce, fit};
use super::range::{Range, Statistics};
use super::text::{Size, Text};

/// What the picture shows.
#[derive(Clone, Debug, Default)]
pub struct Overview {
    pub channels: Vec<Channel>,
    pub samples: Vec<Shown>,
    /// In the order of their colours, with the number of their samples.
    pub splits: Vec<(String, u64)>,
    pub marginals: Vec<Marginal>,
    /// Lines under the samples.
    pub remarks: Vec<String>,
}

/// A column of images.
#[derive(Clone, Debug)]
pub struct Channel {
    pub name: String,
    /// Its parts in words: `radiance`, `f_x 0.1 mm^-1`.
    pub about: Vec<String>,
    pub unit: String,
}

/// A row of images.
#[derive(Clone, Debug)]
pub struct Shown {
    pub id: String,
    pub split: String,
    /// One per channel.
    pub images: Vec<Array2<f32>>,
}

/// How a quantity is spread.
#[derive(Clone, Debug)]
pub struct Marginal {
    pub name: String,
    pub unit: String,
    pub of: Spread,
}

/// The values in each split, in the order of [`Overview::splits`].
#[derive(Clone, Debug)]
pub enum Spread {
    /// What is not known is NaN.
    Numbers(Vec<Vec<f32>>),
    /// How often each name occurs.
    Names(Vec<BTreeMap<String, u64>>),
}

/// A PNG file. The same overview and caption give the same bytes.
///
/// Images of one channel have one scale, that of the bar under them; pixels that are no number have grey stripes. Histograms give the
/// share of each split: the first is filled, all have outlines; numbers over a factor of 20 and more whose logarithms are spread
/// more evenly than they themselves stand on a logarithmic axis.
pub fn overview(of: &Overview, caption: &Caption) -> Vec<u8> {
    let (samples, spread) = (samples(of), marginals(of));
    let head = Figure { heading: caption.title.clone(), subheading: caption.subtitle.clone(), ..Figure::default() };
    let parts = [Some(head.draw()), samples, legend(of), spread];
    let parts: Vec<Canvas> = parts.into_iter().flatten().collect();
    let width = parts.iter().map(Canvas::width).max().unwrap_or(1);
    let mut canvas = Canvas::new(width, parts.iter().map(Canvas::height).sum());
    let mut y = 0;
    for part in &parts {
        canvas.paste(0, y, part);
        y += part.height();
    }
    canvas.to_png(&caption.facts)
}

const MARGIN: i64 = 24;
/// Longer side of an image, about, and the least width of its column.
const SIDE: usize = 112;
const COLUMN: i64 = 112;
const GAP: i64 = 22;
const ROW_GAP: i64 = 10;
const LINE: i64 = 16;
const BAR: i64 = 9;

/// A channel with its scale, its images and their width.
struct Column {
    title: Text,
    about: Vec<Text>,
    images: Vec<Canvas>,
    width: i64,
    scale: Option<(ColourMap, Range, Text)>,
}

impl Column {
    fn of(channel: &Channel, images: &[&Array2<f32>]) -> Self {
        let good: Vec<Array2<bool>> = images.iter().map(|image| image.mapv(f32::is_finite)).collect();
        let known: Vec<Statistics> =
            images.iter().zip(&good).filter_map(|(image, good)| Statistics::of(image, good)).collect();
        let about = channel.about.first().map_or("", String::as_str);
        let map = if is_error(about) { ColourMap::Diverging } else { ColourMap::Sequential };
        let range = Range::robust(&known.iter().collect::<Vec<_>>());
        let range = range.map(|range| if map == ColourMap::Diverging { range.around_zero() } else { range });
        let colour = |value: f64| map.colour(range.map_or(0.5, |range| range.position(value)));
        let drawn =
            |(image, good): (&&Array2<f32>, &Array2<bool>)| paint(&fit(image, good, SIDE, Reduce::Mean), colour);
        let images: Vec<Canvas> = images.iter().zip(&good).map(drawn).collect();
        let width = images.iter().map(Canvas::width).max().unwrap_or(0).max(COLUMN);
        let fitted = |text: &String| {
            let whole = unit(text);
            if whole.width(Size::Small) <= width { whole } else { Text::shortened(text, Size::Small, width) }
        };
        Self {
            title: Text::shortened(&channel.name, Size::Normal, width),
            about: channel.about.iter().map(fitted).collect(),
            images,
            width,
            scale: range.map(|range| (map, range, unit(&channel.unit))),
        }
    }
}

/// The grid of images: a row per sample, a column per channel.
fn samples(of: &Overview) -> Option<Canvas> {
    let column = |(place, channel)| {
        let images: Vec<&Array2<f32>> = of.samples.iter().map(|sample| &sample.images[place]).collect();
        Column::of(channel, &images)
    };
    let columns: Vec<Column> = of.channels.iter().enumerate().map(column).collect();
    if columns.is_empty() || of.samples.is_empty() {
        return None;
    }
    let label = |text: &String| Text::plain(text.as_str()).width(Size::Small);
    let gutter = of.samples.iter().flat_map(|s| [label(&s.id), label(&s.split)]).max().unwrap_or(0) + 12;
    let lines = columns.iter().map(|column| column.about.len()).max().unwrap_or(0) as i64;
    let head = 20 + LINE * lines + 6;
    let height = |row: usize| columns.iter().map(|column| column.images[row].height()).max().unwrap_or(0);
    let rows: i64 = (0..of.samples.len()).map(|row| height(row) + ROW_GAP).sum();
    let foot = 2 + BAR + 46;
    let width = 2 * MARGIN + gutter + columns.iter().map(|column| column.width + GAP).sum::<i64>();
    let remarks: Vec<Text> = of.remarks.iter().map(|remark| Text::plain(remark.as_str())).collect();
    let widest = remarks.iter().map(|remark| remark.width(Size::Small)).max().unwrap_or(0);
    let mut canvas =
        Canvas::new(width.max(widest + 2 * MARGIN), head + rows + foot + 18 * remarks.len() as i64 + 2 * ROW_GAP);
    let mut y = head;
    for (row, sample) in of.samples.iter().enumerate() {
        let middle = y + height(row) / 2;
        Text::plain(sample.id.as_str()).draw(&mut canvas, MARGIN, middle - 2, Size::Small, INK);
        Text::plain(sample.split.as_str()).draw(&mut canvas, MARGIN, middle + 14, Size::Small, GREY);
        y += height(row) + ROW_GAP;
    }
    let mut x = MARGIN + gutter;
    for column in &columns {
        column.title.draw(&mut canvas, x, 15, Size::Normal, INK);
        for (line, about) in column.about.iter().enumerate() {
            about.draw(&mut canvas, x, 15 + LINE * (line as i64 + 1) + 2, Size::Small, GREY);
        }
        let mut y = head;
        for (row, image) in column.images.iter().enumerate() {
            canvas.paste(x, y, image);
            canvas.frame(x, y, image.width(), image.height(), GREY);
            y += height(row) + ROW_GAP;
        }
        if let Some((map, range, unit)) = &column.scale {
            let (top, length) = (y + 2, column.images[0].width());
            for at in 0..length {
                canvas.fill(x + at, top, 1, BAR, map.colour((at as f64 + 0.5) / length as f64));
            }
            canvas.frame(x, top, length, BAR, GREY);
            Axis::linear(unit.clone(), range.low, range.high).draw_below(&mut canvas, x, top + BAR + 1, length);
        }
        x += column.width + GAP;
    }
    for (line, remark) in remarks.iter().enumerate() {
        remark.draw(&mut canvas, MARGIN, y + foot + 14 + 18 * line as i64, Size::Small, GREY);
    }
    Some(canvas)
}

/// Which colour is which split.
fn legend(of: &Overview) -> Option<Canvas> {
    if of.marginals.is_empty() {
        return None;
    }
    let name = |(split, n): &(String, u64)| Text::plain(format!("{split}, {n} samples"));
    let names: Vec<Text> = of.splits.iter().map(name).collect();
    let title = Text::plain("Share of each split");
    let widths = names.iter().map(|name| name.width(Size::Small) + 42).sum::<i64>();
    let mut canvas = Canvas::new(2 * MARGIN + title.width(Size::Normal) + 20 + widths, 40);
    let mut x = title.draw(&mut canvas, MARGIN, 22, Size::Normal, INK) + 20;
    for (split, name) in names.iter().enumerate() {
        let colour = colour(split);
        canvas.fill(x, 12, 14, 12, if split == 0 { pale(colour) } else { [255; 3] });
        canvas.frame(x, 12, 14, 12, colour);
        canvas.frame(x + 1, 13, 12, 10, colour);
        x = name.draw(&mut canvas, x + 20, 22, Size::Small, INK) + 22;
    }
    Some(canvas)
}

fn colour(split: usize) -> Rgb {
    // The first category is that of nothing.
    category(split + 1)
}

fn pale(colour: Rgb) -> Rgb {
    colour.map(|c| (255 - (255 - u32::from(c)) * 2 / 5) as u8)
}

/// Sizes of a histogram.
const WIDTH: i64 = 208;
const HEIGHT: i64 = 104;
/// Of bars beside names, which take room themselves.
const BARS: i64 = 160;
const MOST_BINS: usize = 20;
const MOST_NAMES: usize = 12;
const PER_ROW: usize = 4;

fn marginals(of: &Overview) -> Option<Canvas> {
    let panels: Vec<Panel> = of.marginals.iter().filter_map(panel).collect();
    if panels.is_empty() {
        return None;
    }
    let mut rows: Vec<Vec<Panel>> = Vec::new();
    for panel in panels {
        match rows.last_mut().filter(|row| row.len() < PER_ROW) {
            Some(row) => row.push(panel),
            None => rows.push(vec![panel]),
        }
    }
    let figure = Figure { sections: vec![Section { heading: Text::new(), rows }], ..Figure::default() };
    Some(figure.draw())
}

/// The histogram of a quantity; none where nothing of it is known.
fn panel(of: &Marginal) -> Option<Panel> {
    let name = Text::shortened(&of.name, Size::Normal, WIDTH).join(in_unit(&of.unit));
    let (image, axes, left_out) = match &of.of {
        Spread::Numbers(splits) => numbers(splits)?,
        Spread::Names(splits) => names(splits)?,
    };
    let note = left_out.map(|said| Note { swatch: None, text: Text::plain(said) });
    Some(Panel {
        title: name,
        subtitle: Text::new(),
        image,
        bar: None,
        axes: Some(axes),
        notes: note.into_iter().collect(),
    })
}

/// Where the bins of a quantity lie.
fn bins(splits: &[Vec<f32>]) -> Option<(Axis, usize)> {
    let known = || splits.iter().flatten().copied().filter(|v| v.is_finite()).map(f64::from);
    let (low, high) = (known().reduce(f64::min)?, known().reduce(f64::max)?);
    if high - low < MOST_BINS as f64 && known().all(|v| v.fract() == 0.0) {
        return Some((Axis::linear(Text::new(), low - 0.5, high + 0.5), (high - low) as usize + 1));
    }
    // The rule of Rice.
    let many = 2.0 * libm::cbrt(known().count() as f64);
    let axis = if low < high && !is_of_decades(known().collect()) {
        Axis::linear(Text::new(), low, high)
    } else {
        Axis::of_nodes(Text::new(), &[low, high])?
    };
    Some((axis, (many as usize).clamp(6, MOST_BINS)))
}

/// Whether the quartiles of the logarithms lie more evenly about their median than those of the values.
fn is_of_decades(mut values: Vec<f64>) -> bool {
    values.sort_unstable_by(f64::total_cmp);
    let quartile = |quarter: usize| values[quarter * (values.len() - 1) / 4];
    let [low, middle, high] = [1, 2, 3].map(quartile);
    let uneven = |f: fn(f64) -> f64| ((f(low) + f(high) - 2.0 * f(middle)) / (f(high) - f(low))).abs();
    low > 0.0 && high > low && uneven(libm::log) < uneven(|value| value)
}

/// A histogram, its axes, and what is not in it.
type Drawn = (Canvas, Axes, Option<String>);

fn numbers(splits: &[Vec<f32>]) -> Option<Drawn> {
    let (x, count) = bins(splits)?;
    let unknown = splits.iter().flatten().filter(|v| !v.is_finite()).count();
    let share = |values: &Vec<f32>| {
        let mut found = vec![0.0; count];
        let known: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).map(f64::from).collect();
        for value in &known {
            let bin = (x.position(*value) * count as f64) as usize;
            found[bin.min(count - 1)] += 100.0 / known.len() as f64;
        }
        found
    };
    let shares: Vec<Vec<f64>> = splits.iter().map(share).collect();
    // A split of few samples has high bars by chance: they may leave the picture where others do not.
    let many = |least: usize| splits.iter().zip(&shares).filter(move |(values, _)| values.len() >= least);
    let most = |least| many(least).flat_map(|(_, shares)| shares).copied().reduce(f64::max);
    let y = Axis::linear(Text::plain("%"), 0.0, 1.08 * most(count).or_else(|| most(0))?);
    let edge = |bin: usize| (bin as f64 / count as f64 * WIDTH as f64).round() as i64;
    let top = |share: f64| ((1.0 - y.position(share).min(1.1)) * HEIGHT as f64).round() as i64;
    let mut image = Canvas::new(WIDTH, HEIGHT);
    for (bin, &share) in shares.first().into_iter().flatten().enumerate() {
        let high = top(share);
        image.fill(edge(bin), high, edge(bin + 1) - edge(bin), HEIGHT - high, pale(colour(0)));
    }
    // The first split lies on top: where outlines meet it is the one to compare with.
    for (split, shares) in shares.iter().enumerate().rev() {
        let mut before = HEIGHT;
        for (bin, &share) in shares.iter().enumerate() {
            let high = top(share);
            image.fill(edge(bin), before.min(high) - 1, 2, (before - high).abs() + 2, colour(split));
            image.fill(edge(bin), high - 1, edge(bin + 1) - edge(bin) + 2, 2, colour(split));
            before = high;
        }
        image.fill(WIDTH - 2, before - 1, 2, HEIGHT - before + 1, colour(split));
    }
    Some((image, Axes { x, y }, (unknown > 0).then(|| format!("{unknown} not known"))))
}

/// Bars beside the names: of each name one per split.
fn names(splits: &[BTreeMap<String, u64>]) -> Option<Drawn> {
    let known: BTreeSet<&String> = splits.iter().flat_map(BTreeMap::keys).collect();
    let others = known.len().saturating_sub(MOST_NAMES);
    let known: Vec<&String> = known.into_iter().take(MOST_NAMES).collect();
    if known.is_empty() {
        return None;
    }
    let total = |split: &BTreeMap<String, u64>| split.values().sum::<u64>().max(1) as f64;
    let share =
        |split: &BTreeMap<String, u64>, name: &str| 100.0 * split.get(name).copied().unwrap_or(0) as f64 / total(split);
    let most = splits.iter().flat_map(|split| known.iter().map(move |name| share(split, name))).fold(0.0, f64::max);
    let x = Axis::linear(Text::plain("%"), 0.0, 1.08 * most.max(1e-3));
    let row = (HEIGHT / known.len() as i64).max(4 * splits.len() as i64 + 6);
    let bar = ((row - 6) / splits.len().max(1) as i64).min(14);
    let mut image = Canvas::new(BARS, row * known.len() as i64);
    for (place, name) in known.iter().enumerate() {
        let first = row * place as i64 + (row - bar * splits.len() as i64) / 2;
        for (split, of) in splits.iter().enumerate() {
            let length = (x.position(share(of, name)) * BARS as f64).round() as i64;
            image.fill(0, first + bar * split as i64, length, bar - 1, colour(split));
        }
    }
    let labels = known.iter().map(|name| Text::shortened(name, Size::Small, 70)).collect();
    let axes = Axes { x, y: Axis::names(Text::new(), labels) };
    Some((image, axes, (others > 0).then(|| format!("and {others} more"))))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows of a column of the picture that have this colour.
    fn rows(image: &Canvas, x: i64, colour: Rgb) -> usize {
        (0..image.height()).filter(|&y| image.get(x, y) == Some(colour)).count()
    }

    /// Bars are as high as the shares: of whole numbers each has its own; to the outline's two pixels and one of rounding.
    #[test]
    fn bars_are_as_high_as_shares() {
        let first: Vec<f32> = [1.0; 40].into_iter().chain([2.0; 20]).chain([4.0; 20]).collect();
        let (image, axes, unknown) = numbers(&[first, vec![3.0, f32::NAN]]).unwrap();
        assert_eq!(unknown.as_deref(), Some("1 not known"));
        // Bins 1, 2, 3, 4; the split of one sample does not set the height of 50 % in 54.
        let fill = |bin: i64| rows(&image, bin * WIDTH / 4 + WIDTH / 8, pale(colour(0))) as f64;
        let percent = |share: f64| axes.y.position(share) * HEIGHT as f64;
        for (bin, share) in [(0, 50.0), (1, 25.0), (3, 25.0)] {
            assert!((fill(bin) - percent(share)).abs() <= 3.0, "bin {bin}: {}", fill(bin));
        }
        assert_eq!(fill(2), 0.0);
        assert!((percent(50.0) - HEIGHT as f64 / 1.08).abs() < 1.0);

        let count = |names: &[(&str, u64)]| names.iter().map(|(name, n)| ((*name).to_owned(), *n)).collect();
        let (image, axes, more) = names(&[count(&[("a", 3), ("b", 1)]), count(&[("b", 5)])]).unwrap();
        let long = |colour| (0..BARS).filter(|&x| rows(&image, x, colour) > 0).count() as f64;
        let percent = |share: f64| axes.x.position(share) * BARS as f64;
        assert!(more.is_none() && (long(colour(0)) - percent(75.0)).abs() <= 1.0);
        assert!((long(colour(1)) - percent(100.0)).abs() <= 1.0);
    }

    /// Whatever there is, or is not, has a picture of a size that can be looked at, the same every time.
    #[test]
    fn every_set_has_a_picture() {
        let spreads = [vec![0.0; 9], vec![f32::NAN; 3], vec![-1e30, 1e30], vec![1e-9, 1.0, 1e9], vec![]];
        let marginals = spreads.into_iter().map(|values| Marginal {
            name: "x".repeat(60),
            unit: "mm^-1".into(),
            of: Spread::Numbers(vec![values.clone(), values]),
        });
        let channel =
            |name: &str| Channel { name: name.repeat(9), about: vec!["f_x 0.1 mm^-1".into(); 2], unit: "mm".into() };
        let image = |rows, columns, value| Array2::from_elem((rows, columns), value);
        let images = vec![image(1, 1, 0.5), image(64, 3, f32::NAN), image(2000, 500, 1.0)];
        let shown = Shown { id: "00000000".into(), split: "validation".into(), images };
        let of = Overview {
            channels: ["a", "mu_a_true", "c"].map(channel).into(),
            samples: vec![shown.clone(), shown],
            splits: vec![("train".into(), 9), ("test".into(), 9)],
            marginals: marginals.collect(),
            remarks: vec!["2 of 18 samples".into()],
        };
        let caption = Caption { title: "set".into(), ..Caption::default() };
        for of in [of, Overview::default()] {
            let bytes = overview(&of, &caption);
            assert!(bytes == overview(&of, &caption));
            let reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
            assert!(reader.info().width < 1500 && reader.info().height < 2000, "{:?}", reader.info().size());
        }
    }
}
