//! Image stacks as figures: one panel per layer, grouped as a reader compares them.

use ndarray::Array2;
use serde_json::Value;
use turbid_contract::{ImageStack, Layer, LayerInfo, LayerKind};

use super::arrange::{Grouped, arrange};
use super::classes::Classes;
use super::colour::ColourMap;
use super::figure::{Figure, Section};
use super::notation::{base, f_x, in_unit, is_error, is_truth, particulars, quantity};
use super::number::{number, with_error};
use super::panel::{Bar, Note, Panel, Swatch, mark, paint};
use super::pixels::{Reduce, fit};
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

/// A layer with what a panel needs to know of it.
struct Seen<'a> {
    layer: &'a Layer,
    good: Array2<bool>,
    /// Pixels whose number is not what the title says (other than 0 there), and what it is.
    marks: Option<(&'a Layer, &'static str)>,
    /// None where no pixel is good.
    statistics: Option<Statistics>,
}

pub fn figure(stack: &ImageStack, title: &str) -> Figure {
    let masks: Vec<&Layer> = stack.layers.iter().filter(|l| l.info.is_pixel_mask()).collect();
    let says_why = |l: &Layer| l.info.kind == LayerKind::Mask || is_outside(&l.info);
    let clean = |l: &Layer| says_why(l) && l.data.iter().all(|&m| m == 0.0);
    let alone = masks.len() == stack.layers.len();
    let kinds = [
        (Text::new(), LARGE, [LayerKind::Value, LayerKind::Mask]),
        (Text::plain("Standard errors"), SMALL, [LayerKind::StandardError; 2]),
        (Text::plain("Covariances"), SMALL, [LayerKind::Covariance; 2]),
    ];
    let mut figure = Figure { heading: title.to_owned(), ..Figure::default() };
    let mut colours = panels(stack, LARGE);
    colours.truncate(MOST_COLOURS);
    if !colours.is_empty() {
        figure.sections.push(Section { heading: Text::new(), rows: vec![colours] });
    }
    let mut dropped = 0;
    for (heading, side, kinds) in kinds {
        let of_kind = |l: &&Layer| kinds.contains(&l.info.kind) && (alone || !clean(l));
        let mut shown: Vec<&Layer> = stack.layers.iter().filter(of_kind).collect();
        dropped += shown.len().saturating_sub(MOST_PANELS);
        shown.truncate(MOST_PANELS);
        let seen: Vec<Seen> = shown.into_iter().map(|layer| see(stack, layer, &masks)).collect();
        if !seen.is_empty() {
            let mut rows = rows(stack, &seen, side);
            tell_apart(&mut rows);
            figure.sections.push(Section { heading, rows });
        }
    }
    figure.remarks = remarks(stack, &masks, &figure, dropped);
    figure
}

/// A pixel is good where it is a number and no mask that speaks for the layer names a reason against it.
fn see<'a>(stack: &'a ImageStack, layer: &'a Layer, masks: &[&Layer]) -> Seen<'a> {
    let mut good = layer.data.mapv(f32::is_finite);
    if layer.info.kind != LayerKind::Mask {
        for mask in masks.iter().filter(|mask| speaks_for(&mask.info, &layer.info)) {
            good.zip_mut_with(&mask.data, |good, &reason| *good &= reason == 0.0);
        }
    }
    let statistics = Statistics::of(&layer.data, &good);
    let marks = at_end(stack, &layer.info).or_else(|| unknown(stack, &layer.info));
    let marks = marks.filter(|(why, _)| why.data.iter().any(|&reason| reason != 0.0));
    Seen { layer, good, marks, statistics }
}

/// The side of the table where the pixels of a map, its standard error or its error left it.
fn at_end<'a>(stack: &'a ImageStack, info: &LayerInfo) -> Option<(&'a Layer, &'static str)> {
    let touched = info.kind != LayerKind::Mask && !is_outside(info) && !is_truth(&info.name);
    let outside = stack.layers.iter().find(|l| touched && is_outside(&l.info) && speaks_for(&l.info, info))?;
    Some((outside, " hold the end of the table"))
}

/// The flags of a standard error that is unknown.
fn unknown<'a>(stack: &'a ImageStack, info: &LayerInfo) -> Option<(&'a Layer, &'static str)> {
    let (name, unit) = (format!("{}_unknown", info.name), "1".to_owned());
    let flags = LayerInfo { name, unit, kind: LayerKind::Mask, mean_se: None, ..info.clone() };
    let layer = stack.layers.iter().find(|l| info.kind == LayerKind::StandardError && l.info == flags)?;
    Some((layer, " unknown: at least what is shown"))
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

fn rows(stack: &ImageStack, seen: &[Seen], side: usize) -> Vec<Vec<Panel>> {
    let mut groups: Vec<Grouped<Panel>> = Vec::new();
    let mut firsts: Vec<&LayerInfo> = Vec::new();
    for one in seen {
        let info = &one.layer.info;
        let scale: Vec<&Statistics> = seen
            .iter()
            .filter(|other| same_scale(&other.layer.info, info))
            .filter_map(|other| other.statistics.as_ref())
            .collect();
        let panel = panel(stack, one, Range::robust(&scale), side);
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

fn panel(stack: &ImageStack, seen: &Seen, range: Option<Range>, side: usize) -> Panel {
    let info = &seen.layer.info;
    if let Some(classes) = Classes::of(info, &stack.attributes) {
        return categorical(stack, seen, &classes, side);
    }
    let map = colour_map(info);
    let range = range.map(|r| match map {
        ColourMap::Diverging => r.around_zero(),
        ColourMap::Cyclic => Range::turn(),
        ColourMap::Sequential => r,
    });
    let reduce = if map == ColourMap::Cyclic { Reduce::First } else { Reduce::Mean };
    let pixels = fit(&seen.layer.data, &seen.good, side, reduce);
    let mut image = paint(&pixels, |v| map.colour(range.map_or(0.5, |r| r.position(v))));
    if let Some((why, _)) = seen.marks {
        mark(&mut image, &pixels, &fit(&why.data, &seen.good, side, Reduce::MostFrequent));
    }
    let title = match info.kind {
        // The section's heading says what these are.
        LayerKind::StandardError => quantity(base(&info.name)),
        LayerKind::Covariance => covariance_title(stack, info),
        _ => quantity(&info.name),
    };
    Panel {
        title: title.join(in_unit(&info.unit)),
        subtitle: particulars(info),
        image,
        bar: range.map(|range| Bar { map, range }),
        axes: None,
        notes: scale::bar(stack, &pixels).into_iter().chain(notes(seen, info)).collect(),
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

fn notes(seen: &Seen, info: &LayerInfo) -> Vec<Note> {
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
    let masked = seen.good.iter().filter(|good| !**good).count();
    if masked > 0 {
        notes.push(plain(share(masked, seen.good.len()).then(" masked")));
    }
    if let Some((why, what)) = seen.marks {
        let marked = why.data.iter().zip(&seen.good).filter(|(reason, good)| **good && **reason != 0.0).count();
        notes.push(Note { swatch: Some(Swatch::Marked), text: share(marked, seen.good.len()).then(what) });
    }
    notes
}

/// `12.3 %`, and never `0 %` of something that is there.
fn share(part: usize, whole: usize) -> Text {
    number(100.0 * part as f64 / whole as f64, 3).then(" %")
}

/// Classes in a legend; more tell nobody anything.
const MOST_CLASSES: usize = 20;

fn categorical(stack: &ImageStack, seen: &Seen, classes: &Classes, side: usize) -> Panel {
    let pixels = fit(&seen.layer.data, &seen.good, side, Reduce::MostFrequent);
    let mut values: Vec<f32> = seen.layer.data.iter().zip(&seen.good).filter(|(_, g)| **g).map(|(v, _)| *v).collect();
    values.sort_by(f32::total_cmp);
    let whole = seen.good.len();
    let runs: Vec<&[f32]> = values.chunk_by(|a, b| a == b).collect();
    let named = runs.iter().take(MOST_CLASSES).map(|run| {
        let value = f64::from(run[0]);
        let text = Text::plain(classes.name(value) + ", ").join(share(run.len(), whole));
        Note { swatch: Some(Swatch::Colour(classes.colour(value))), text }
    });
    let rest = runs.len().saturating_sub(MOST_CLASSES);
    let rest = (rest > 0).then(|| Note { swatch: None, text: Text::plain(format!("and {rest} more")) });
    Panel {
        title: quantity(&seen.layer.info.name),
        subtitle: particulars(&seen.layer.info),
        image: paint(&pixels, |v| classes.colour(v)),
        bar: None,
        axes: None,
        notes: scale::bar(stack, &pixels).into_iter().chain(named).chain(rest).collect(),
    }
}

/// `var M_AC` or `cov M_DC, M_AC`, from the attribute `quantities` or the layers that `pair` points to.
fn covariance_title(stack: &ImageStack, info: &LayerInfo) -> Text {
    let Some([i, j]) = info.pair else { return quantity(&info.name) };
    let name = |index: u32| -> Text {
        if let Some(Value::Array(quantities)) = stack.attributes.get("quantities") {
            let Some(q) = quantities.get(index as usize) else { return Text::plain(format!("[{index}]")) };
            let part = q["part"].as_str().unwrap_or("?").to_owned();
            let at = q["f_x_per_mm"].as_f64().filter(|_| part != "dc");
            return Text::plain(part).join(at.map_or(Text::new(), |f| Text::plain(", ").join(f_x(f))));
        }
        stack.layers.get(index as usize).map_or(Text::plain(format!("[{index}]")), |l| {
            let at =
                l.info.f_x_per_mm.map_or(Text::new(), |f| Text::plain("(").then(super::number::plain(f)).then(")"));
            quantity(&l.info.name).join(at)
        })
    };
    if i == j { Text::plain("var ").join(name(i)) } else { Text::plain("cov ").join(name(i)).then("; ").join(name(j)) }
}

fn remarks(stack: &ImageStack, masks: &[&Layer], figure: &Figure, dropped: usize) -> Vec<Text> {
    let panels = || figure.sections.iter().flat_map(|s| s.rows.iter().flatten());
    let bars = || panels().filter_map(|p| p.bar.as_ref());
    let mut said = vec![format!("{} × {} pixels{}", stack.columns(), stack.rows(), scale::of_pixels(stack))];
    if bars().any(|bar| bar.range.under() || bar.range.over()) {
        said.push("a pointed bar: up to 0.5 % of the pixels lie beyond that end".to_owned());
    }
    // Of the magnitude's bits: a loop that ends early is slower.
    let largest = |l: &Layer| l.data.iter().fold(0, |most, v| v.abs().to_bits().max(most));
    let not_a_number = || stack.layers.iter().any(|l| largest(l) >= f32::INFINITY.to_bits());
    let masked = masks.iter().any(|m| m.data.iter().any(|&r| r != 0.0));
    if stack.layers.iter().any(|l| is_outside(&l.info) && l.data.iter().any(|&reason| reason != 0.0)) {
        said.push("pink stripes: outside the table, the value is that of its nearest node".to_owned());
    }
    if masked || not_a_number() {
        said.push("grey stripes: masked".to_owned());
    } else if !masks.is_empty() {
        said.push("no pixel is masked".to_owned());
    }
    if dropped > 0 {
        said.push(format!("{dropped} further layers are not shown"));
    }
    vec![Text::plain(said.join("; "))]
}
