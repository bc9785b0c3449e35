//! Image stacks as figures: one panel per layer, grouped as a reader compares them.

use std::borrow::Cow;
use std::convert::Infallible;

use ndarray::Array2;
use serde_json::Value;
use turbid_contract::{Head, ImageStack, LayerInfo, LayerKind};

use super::arrange::{Grouped, arrange};
use super::classes::Classes;
use super::colour::ColourMap;
use super::figure::{Figure, Section};
use super::notation::{base, f_x, in_unit, is_error, is_truth, particulars, quantity};
use super::number::{number, with_error};
use super::panel::{Bar, Note, Panel, Swatch, mark, paint};
use super::pixels::{Pixels, Reduce, fit};
use super::range::{Range, Statistics};
use super::scale;
use super::text::Text;
use super::tristimulus::panels;

/// Longer side of an image on the screen, in pixels.
const LARGE: usize = 288;
const SMALL: usize = 144;
/// More panels than this in a section tell nobody anything.
const MOST_PANELS: usize = 48;
const MOST_COLOURS: usize = 4;

/// What a panel needs to know of a layer; its pixels themselves are given back once they were looked at.
struct Seen<'a> {
    info: &'a LayerInfo,
    /// As it is shown.
    pixels: Pixels,
    /// Of the image's pixels: how many there are, and how many are good.
    count: usize,
    good: usize,
    /// Good pixels whose number is not what the title says: as they are shown, how many they are, and what the number is.
    marks: Option<(Pixels, usize, &'static str)>,
    /// None where no pixel is good.
    statistics: Option<Statistics>,
    /// Of names: each number of good pixels, and how often it is there.
    runs: Vec<(f32, usize)>,
}

/// A layer that says why the numbers of others are not to be taken as they are, somewhere.
struct Reason<'a> {
    info: &'a LayerInfo,
    data: Cow<'a, Array2<f32>>,
}

/// Layers of a stack, read one at a time.
type Read<'r, 'a, E> = &'r dyn Fn(usize) -> Result<Cow<'a, Array2<f32>>, E>;

pub fn figure(stack: &ImageStack, title: &str) -> Figure {
    let read = |k: usize| Ok::<_, Infallible>(Cow::Borrowed(&stack.layers[k].data));
    let Ok(figure) = figure_of(&Head::of(stack), &read, colours(stack), title);
    figure
}

/// Panels of three wavelengths in colours.
pub fn colours(stack: &ImageStack) -> Vec<Panel> {
    let mut colours = panels(stack, LARGE);
    colours.truncate(MOST_COLOURS);
    colours
}

/// The same of layers that `read` gives one at a time: no more than one is held, and the reasons against pixels. `colours`: what [`colours`] makes of them.
///
/// Error: that of reading.
pub fn figure_of<'a, E>(head: &Head, read: Read<'_, 'a, E>, colours: Vec<Panel>, title: &str) -> Result<Figure, E> {
    let layers = || head.layers.iter().enumerate();
    let mut reasons: Vec<Option<Reason<'_>>> = Vec::new();
    for (k, info) in layers() {
        let data = if info.kind == LayerKind::Mask || is_outside(info) { Some(read(k)?) } else { None };
        let data = data.filter(|data| data.iter().any(|&reason| reason != 0.0));
        reasons.push(data.map(|data| Reason { info, data }));
    }
    let says_why = |info: &LayerInfo| info.kind == LayerKind::Mask || is_outside(info);
    let alone = head.layers.iter().all(LayerInfo::is_pixel_mask);
    let kinds = [
        (Text::new(), LARGE, [LayerKind::Value, LayerKind::Mask]),
        (Text::plain("Standard errors"), SMALL, [LayerKind::StandardError; 2]),
        (Text::plain("Covariances"), SMALL, [LayerKind::Covariance; 2]),
    ];
    let mut figure = Figure { heading: title.to_owned(), ..Figure::default() };
    if !colours.is_empty() {
        figure.sections.push(Section { heading: Text::new(), rows: vec![colours] });
    }
    let about = about(head);
    let (mut dropped, mut odd) = (0, false);
    for (heading, side, kinds) in kinds {
        let of_kind = |k: usize, info: &LayerInfo| {
            kinds.contains(&info.kind) && (alone || !says_why(info) || reasons[k].is_some())
        };
        let shown: Vec<usize> = layers().filter(|(k, info)| of_kind(*k, info)).map(|(k, _)| k).collect();
        dropped += shown.len().saturating_sub(MOST_PANELS);
        let mut seen = Vec::new();
        for &k in shown.iter().take(MOST_PANELS) {
            let data = match &reasons[k] {
                Some(reason) => Cow::Borrowed(reason.data.as_ref()),
                None => read(k)?,
            };
            odd |= largest(&data) >= f32::INFINITY.to_bits();
            seen.push(see(&about, &head.layers[k], &data, &reasons, side));
        }
        if !seen.is_empty() {
            let mut rows = rows(head, &about, &seen, side);
            tell_apart(&mut rows);
            figure.sections.push(Section { heading, rows });
        }
    }
    figure.remarks = remarks(head, &about, &reasons, &figure, odd, dropped);
    Ok(figure)
}

/// What a stack says of itself and of the size of its pixels.
fn about(head: &Head) -> ImageStack {
    let mut about = ImageStack::new(head.rows, head.columns);
    about.attributes = head.attributes.clone();
    about
}

/// Of the magnitudes' bits: a loop that ends early is slower.
fn largest(data: &Array2<f32>) -> u32 {
    data.iter().fold(0, |most, v| v.abs().to_bits().max(most))
}

/// A pixel is good where it is a number and no mask that speaks for the layer names a reason against it.
fn see<'a>(
    about: &ImageStack,
    info: &'a LayerInfo,
    data: &Array2<f32>,
    reasons: &[Option<Reason<'_>>],
    side: usize,
) -> Seen<'a> {
    let mut good = data.mapv(f32::is_finite);
    if info.kind != LayerKind::Mask {
        let masks = reasons.iter().flatten().filter(|reason| reason.info.is_pixel_mask());
        for mask in masks.filter(|mask| speaks_for(mask.info, info)) {
            good.zip_mut_with(&mask.data, |good, &reason| *good &= reason == 0.0);
        }
    }
    let named = Classes::of(info, &about.attributes).is_some();
    let reduce = match colour_map(info) {
        _ if named => Reduce::MostFrequent,
        ColourMap::Cyclic => Reduce::First,
        _ => Reduce::Mean,
    };
    let marks = at_end(reasons, info).or_else(|| unknown(reasons, info)).map(|(why, what)| {
        let marked = why.data.iter().zip(&good).filter(|(reason, good)| **good && **reason != 0.0).count();
        (fit(&why.data, &good, side, Reduce::MostFrequent), marked, what)
    });
    Seen {
        info,
        pixels: fit(data, &good, side, reduce),
        count: good.len(),
        good: good.iter().map(|&good| usize::from(good)).sum(),
        marks: marks.filter(|_| !named),
        statistics: if named { None } else { Statistics::of(data, &good) },
        runs: if named { runs(data, &good) } else { Vec::new() },
    }
}

/// The numbers of good pixels in their order, each with how often it is there.
fn runs(data: &Array2<f32>, good: &Array2<bool>) -> Vec<(f32, usize)> {
    let mut values: Vec<f32> = data.iter().zip(good).filter(|(_, g)| **g).map(|(v, _)| *v).collect();
    values.sort_by(f32::total_cmp);
    values.chunk_by(|a, b| a == b).map(|run| (run[0], run.len())).collect()
}

/// The side of the table where the pixels of a map, its standard error or its error left it.
fn at_end<'r, 'a>(reasons: &'r [Option<Reason<'a>>], info: &LayerInfo) -> Option<(&'r Reason<'a>, &'static str)> {
    let touched = info.kind != LayerKind::Mask && !is_outside(info) && !is_truth(&info.name);
    let ends = |reason: &&Reason<'_>| touched && is_outside(reason.info) && speaks_for(reason.info, info);
    Some((reasons.iter().flatten().find(ends)?, " hold the end of the table"))
}

/// The flags of a standard error that is unknown.
fn unknown<'r, 'a>(reasons: &'r [Option<Reason<'a>>], info: &LayerInfo) -> Option<(&'r Reason<'a>, &'static str)> {
    let (name, unit) = (format!("{}_unknown", info.name), "1".to_owned());
    let flags = LayerInfo { name, unit, kind: LayerKind::Mask, mean_se: None, ..info.clone() };
    let is = |reason: &&Reason<'_>| info.kind == LayerKind::StandardError && *reason.info == flags;
    Some((reasons.iter().flatten().find(is)?, " unknown: at least what is shown"))
}

/// The layer in which `invert` names the side of the table where it ended (`outside: nearest`): the mask calls such pixels good.
fn is_outside(info: &LayerInfo) -> bool {
    info.name == "outside" && info.kind == LayerKind::Value
}

/// Panels of one title are numbered.
fn tell_apart(rows: &mut [Vec<Panel>]) {
    let titles: Vec<(Text, Text)> =
        rows.iter().flatten().map(|panel| (panel.title.clone(), panel.subtitle.clone())).collect();
    for (i, panel) in rows.iter_mut().flatten().enumerate() {
        let alike = |others: &[(Text, Text)]| others.iter().filter(|title| **title == titles[i]).count();
        let (no, count) = (alike(&titles[..=i]), alike(&titles));
        if count > 1 {
            let comma = if panel.subtitle.is_empty() { "" } else { ", " };
            panel.subtitle = panel.subtitle.clone().then(format!("{comma}no. {no} of {count}"));
        }
    }
}

/// A mask speaks for the layers that share what it says about f_x and wavelength.
fn speaks_for(mask: &LayerInfo, layer: &LayerInfo) -> bool {
    let agree = |mask: Option<f64>, layer: Option<f64>| mask.is_none() || mask == layer;
    agree(mask.f_x_per_mm, layer.f_x_per_mm) && agree(mask.wavelength_nm, layer.wavelength_nm)
}

/// Layers side by side in one row: all of a quantity; with phases, those of one spatial frequency.
fn same_row(a: &LayerInfo, b: &LayerInfo) -> bool {
    let phased = a.phase_rad.is_some() && b.phase_rad.is_some();
    base(&a.name) == base(&b.name)
        && a.kind == b.kind
        && a.wavelength_nm == b.wavelength_nm
        && (!phased || (a.f_x_per_mm == b.f_x_per_mm && a.orientation_deg == b.orientation_deg))
}

/// Layers on one scale: estimate and truth of a quantity, the phases of one spatial frequency.
fn same_scale(a: &LayerInfo, b: &LayerInfo) -> bool {
    same_row(a, b) && a.f_x_per_mm == b.f_x_per_mm && is_error(&a.name) == is_error(&b.name) && a.pair == b.pair
}

fn rows(head: &Head, about: &ImageStack, seen: &[Seen<'_>], side: usize) -> Vec<Vec<Panel>> {
    let mut groups: Vec<Grouped<Panel>> = Vec::new();
    let mut firsts: Vec<&LayerInfo> = Vec::new();
    for one in seen {
        let info = one.info;
        let scale: Vec<&Statistics> = seen
            .iter()
            .filter(|other| same_scale(other.info, info))
            .filter_map(|other| other.statistics.as_ref())
            .collect();
        let panel = panel(head, about, one, Range::robust(&scale));
        match firsts.iter().position(|first| same_row(first, info)) {
            Some(i) => groups[i].push(panel),
            None => {
                firsts.push(info);
                groups.push(vec![panel]);
            }
        }
    }
    arrange(groups, if side == LARGE { 4 } else { 6 })
}

fn panel(head: &Head, about: &ImageStack, seen: &Seen<'_>, range: Option<Range>) -> Panel {
    let info = seen.info;
    if let Some(classes) = Classes::of(info, &about.attributes) {
        return categorical(about, seen, &classes);
    }
    let map = colour_map(info);
    let range = range.map(|r| match map {
        ColourMap::Diverging => r.around_zero(),
        ColourMap::Cyclic => Range::turn(),
        ColourMap::Sequential => r,
    });
    let mut image = paint(&seen.pixels, |v| map.colour(range.map_or(0.5, |r| r.position(v))));
    if let Some((why, ..)) = &seen.marks {
        mark(&mut image, &seen.pixels, why);
    }
    let title = match info.kind {
        // The section's heading says what these are.
        LayerKind::StandardError => quantity(base(&info.name)),
        LayerKind::Covariance => covariance_title(head, info),
        _ => quantity(&info.name),
    };
    Panel {
        title: title.join(in_unit(&info.unit)),
        subtitle: particulars(info),
        image,
        bar: range.map(|range| Bar { map, range }),
        axes: None,
        notes: scale::bar(about, &seen.pixels).into_iter().chain(notes(seen, info)).collect(),
    }
}

fn colour_map(info: &LayerInfo) -> ColourMap {
    let signed = is_error(&info.name) || ["normal_x", "normal_y"].contains(&info.name.as_str());
    let off_diagonal = info.kind == LayerKind::Covariance && info.pair.is_none_or(|[i, j]| i != j);
    if signed || off_diagonal {
        ColourMap::Diverging
    } else if info.name == "phase" && info.kind == LayerKind::Value {
        ColourMap::Cyclic
    } else {
        ColourMap::Sequential
    }
}

fn notes(seen: &Seen<'_>, info: &LayerInfo) -> Vec<Note> {
    let plain = |text| Note { swatch: None, text };
    let Some(s) = &seen.statistics else { return vec![plain(Text::plain("every pixel is masked"))] };
    let mean = info.mean_se.map_or_else(|| number(s.mean, 4), |se| with_error(s.mean, se));
    let mut notes = vec![
        plain(Text::plain("mean ").join(mean)),
        plain(Text::plain("min ").join(number(s.min, 3)).then(", max ").join(number(s.max, 3))),
    ];
    if is_error(&info.name) {
        notes[0].text = notes[0].text.clone().then(", RMS ").join(number(s.rms, 3));
    }
    if seen.good < seen.count {
        notes.push(plain(share(seen.count - seen.good, seen.count).then(" masked")));
    }
    if let Some((_, marked, what)) = seen.marks {
        notes.push(Note { swatch: Some(Swatch::Marked), text: share(marked, seen.count).then(what) });
    }
    notes
}

/// `12.3 %`, and never `0 %` of something that is there.
fn share(part: usize, whole: usize) -> Text {
    number(100.0 * part as f64 / whole as f64, 3).then(" %")
}

/// Classes in a legend; more tell nobody anything.
const MOST_CLASSES: usize = 20;

fn categorical(about: &ImageStack, seen: &Seen<'_>, classes: &Classes) -> Panel {
    let Seen { runs, pixels, .. } = seen;
    let named = runs.iter().take(MOST_CLASSES).map(|&(value, count)| {
        let value = f64::from(value);
        let text = Text::plain(classes.name(value) + ", ").join(share(count, seen.count));
        Note { swatch: Some(Swatch::Colour(classes.colour(value))), text }
    });
    let rest = runs.len().saturating_sub(MOST_CLASSES);
    let rest = (rest > 0).then(|| Note { swatch: None, text: Text::plain(format!("and {rest} more")) });
    Panel {
        title: quantity(&seen.info.name),
        subtitle: particulars(seen.info),
        image: paint(pixels, |v| classes.colour(v)),
        bar: None,
        axes: None,
        notes: scale::bar(about, pixels).into_iter().chain(named).chain(rest).collect(),
    }
}

/// `var M_AC` or `cov M_DC, M_AC`, from the attribute `quantities` or the layers that `pair` points to.
fn covariance_title(head: &Head, info: &LayerInfo) -> Text {
    let Some([i, j]) = info.pair else { return quantity(&info.name) };
    let name = |index: u32| -> Text {
        if let Some(Value::Array(quantities)) = head.attributes.get("quantities") {
            let Some(q) = quantities.get(index as usize) else { return Text::plain(format!("[{index}]")) };
            let part = q["part"].as_str().unwrap_or("?").to_owned();
            let at = q["f_x_per_mm"].as_f64().filter(|_| part != "dc");
            return Text::plain(part).join(at.map_or(Text::new(), |f| Text::plain(", ").join(f_x(f))));
        }
        head.layers.get(index as usize).map_or(Text::plain(format!("[{index}]")), |l| {
            let at = l.f_x_per_mm.map_or(Text::new(), |f| Text::plain("(").then(super::number::plain(f)).then(")"));
            quantity(&l.name).join(at)
        })
    };
    if i == j { Text::plain("var ").join(name(i)) } else { Text::plain("cov ").join(name(i)).then("; ").join(name(j)) }
}

fn remarks(
    head: &Head,
    about: &ImageStack,
    reasons: &[Option<Reason<'_>>],
    figure: &Figure,
    odd: bool,
    dropped: usize,
) -> Vec<Text> {
    let panels = || figure.sections.iter().flat_map(|s| s.rows.iter().flatten());
    let bars = || panels().filter_map(|p| p.bar.as_ref());
    let mut said = vec![format!("{} × {} pixels{}", head.columns, head.rows, scale::of_pixels(about))];
    if bars().any(|bar| bar.range.under() || bar.range.over()) {
        said.push("a pointed bar: up to 0.5 % of the pixels lie beyond that end".to_owned());
    }
    let masked = reasons.iter().flatten().any(|reason| reason.info.is_pixel_mask());
    if reasons.iter().flatten().any(|reason| is_outside(reason.info)) {
        said.push("pink stripes: outside the table, the value is that of its nearest node".to_owned());
    }
    if masked || odd {
        said.push("grey stripes: masked".to_owned());
    } else if head.layers.iter().any(LayerInfo::is_pixel_mask) {
        said.push("no pixel is masked".to_owned());
    }
    if dropped > 0 {
        said.push(format!("{dropped} further layers are not shown"));
    }
    vec![Text::plain(said.join("; "))]
}
