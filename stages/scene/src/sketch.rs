//! The sketch: the set-up to scale with camera, projector, their axes and fields; what they look at, enlarged; the scene from above.

mod cut;
mod panel;
mod words;

use std::collections::{BTreeMap, BTreeSet};

use glam::{DVec2, DVec3};
use turbid_contract::ImageStack;
use turbid_contract::LayerInfo;
use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{Detector, Lamp, Outline, Preview, Scene};
use turbid_contract::serde_json::{Value, json};
use turbid_geometry::{camera_view, projector_view};
use turbid_optics::elementary::sin_cos_turns;
use turbid_optics::view::{Lens, View};

use crate::assemble::{Placed, is_void, object_at, placed};
use cut::Cut;
use panel::{BAR_COLOUR, BAR_LEFT, BAR_ROW, Colour, Columns, Ink, PANEL, Panel, Seen};
use words::{Word, Words};

const GAP: usize = 8;
/// Rows over the panels for their titles.
const HEAD: usize = 24;

/// Pieces of each side of a field whose edge is not straight.
const EDGE_STEPS: u32 = 16;
/// Objects up to so many times as wide as the fields are shown whole beside them.
const WIDE: f64 = 4.0;
/// What the camera sees has a panel of its own where the whole set-up is so many times as large.
const LARGE: f64 = 1.5;

/// Pixels around a pinhole that no name may cover.
const CROSS: usize = 7;
/// Objects with fewer pixels in a panel have no name there, and no panel has more names.
const LEAST_NAMED: usize = 12;
const MOST_NAMED: usize = 10;

const HEAD_COLOUR: Colour = [1.0; 3];
const GAP_COLOUR: Colour = [0.75, 0.75, 0.75];
const CUT_COLOUR: Colour = [0.35, 0.35, 0.35];
const CAMERA: Colour = [0.05, 0.25, 0.75];
const PROJECTOR: Colour = [0.85, 0.45, 0.0];
const LAMP: Colour = [0.75, 0.0, 0.35];
const DETECTOR: Colour = [0.0, 0.5, 0.3];
/// Objects in the order of their names (colour-blind safe, after Paul Tol's light scheme; pale, so that lines stand out).
const OBJECTS: [Colour; 6] = [
    [0.93, 0.75, 0.73],
    [0.60, 0.80, 0.93],
    [0.80, 0.78, 0.48],
    [0.73, 0.80, 0.20],
    [1.0, 0.67, 0.73],
    [0.87, 0.87, 0.6],
];

/// Colours of the objects in the order of their names, one for each; scattered bodies have that of the object that they come from.
struct Colours {
    of: Vec<usize>,
}

impl Colours {
    fn new(scene: &Scene, scattered: &BTreeMap<String, String>) -> Self {
        let mut origins: Vec<&str> = Vec::new();
        let number = |name| {
            let origin = origin(name, scattered);
            origins.iter().position(|o| *o == origin).unwrap_or_else(|| {
                origins.push(origin);
                origins.len() - 1
            })
        };
        Self { of: scene.objects.keys().map(number).collect() }
    }

    fn of(&self, object: usize) -> Colour {
        OBJECTS[self.of[object] % OBJECTS.len()]
    }
}

/// The object that stands in the file.
fn origin<'a>(name: &'a String, scattered: &'a BTreeMap<String, String>) -> &'a str {
    scattered.get(name).unwrap_or(name)
}

/// Side by side: the set-up to scale, in the plane that holds camera and projector, with their fields and optical axes; where it is much larger than
/// what the camera sees, that part of it as an inset, with the names of the media; the scene from above (x to the right, y up), with dashed outlines of
/// what lies below. `scattered` tells of which object a body is one of many: they share a colour and a line of the legend.
pub fn sketch(scene: &Scene, scattered: &BTreeMap<String, String>) -> Preview {
    let colours = Colours::new(scene, scattered);
    let camera = scene.camera.as_ref().and_then(|c| camera_view(c).ok());
    let projector = scene.projector.as_ref().and_then(|p| projector_view(p).ok());
    let cut = Cut::of(camera.as_ref(), projector.as_ref());
    let views: Vec<(View, Colour)> =
        camera.map(|v| (v, CAMERA)).into_iter().chain(projector.map(|v| (v, PROJECTOR))).collect();
    let lamps = lamps(scene);
    let objects = placed(scene);
    let whole = everything(&objects, &views, &lamps, scene);
    let (near, nearest) = (seen(&objects, &views, scene), seen(&objects, &views[..views.len().min(1)], scene));
    let far = 4.0 * span(&whole).1.max_element();
    let seen = |(view, colour): &(View, Colour)| Seen {
        edge: edge(view),
        pinhole: view.position,
        look_at: view.look_at,
        colour: *colour,
    };
    let ink = Ink {
        views: views.iter().map(seen).collect(),
        lamps: lamps.iter().map(|&(from, to)| (from, to, LAMP)).collect(),
        detectors: scene.detectors.values().map(|d| (outline(d, far), DETECTOR)).collect(),
    };
    let above = |p: DVec3| DVec2::new(p.x, p.y);
    let beside = |p: DVec3| cut.flatten(p);
    let widest = |points: &[DVec3]| flat_span(points, above).1.max(flat_span(points, beside).1);
    let section = Section { scene, objects: &objects, colours: &colours, cut: &cut, scattered };

    let inset = (!nearest.is_empty() && LARGE * widest(&nearest) < flat_span(&whole, beside).1)
        .then(|| Panel::around(flat_span(&nearest, beside).0, widest(&nearest)));
    // With the whole frame.
    let framed = inset.iter().flat_map(|inset| inset.corners()).map(|corner| cut.point(corner));
    let (middle, width) = flat_span(&whole.iter().copied().chain(framed).collect::<Vec<_>>(), beside);
    let mut panels = Vec::new();
    let mut set_up = Panel::around(middle, width);
    let there = section.fill(&mut set_up).0;
    set_up.draw(&ink, beside);
    let mut words = Words::new(&set_up.bar_text());
    if let Some(inset) = &inset {
        set_up.frame(inset, CUT_COLOUR);
    }
    let pinholes = ink.views.iter().filter_map(|view| Some((set_up.pixel(beside(view.pinhole))?, view.colour)));
    let pinholes: Vec<([usize; 2], Colour)> = pinholes.collect();
    for ([row, column], _) in &pinholes {
        words.take(row.saturating_sub(CROSS), column.saturating_sub(CROSS), 2 * CROSS + 1, 2 * CROSS + 1);
    }
    for (at, colour) in pinholes {
        let text = if colour == CAMERA { "camera" } else { "projector" };
        words.name_point(text, &mut set_up, colour, at, &|_| true);
    }
    let mut dashed = false;
    if let Some(mut inset) = inset {
        panels.push((set_up, format!("set-up to scale, along {}", cut.said()), words.placed));
        let (mut there, has_dashes) = section.fill(&mut inset);
        let behind = section.dash_off_plane(&there, &mut inset);
        dashed |= !behind.is_empty();
        inset.draw(&ink, beside);
        for (object, holds) in behind {
            there.iter_mut().zip(holds).filter(|(_, holds)| *holds).for_each(|(there, _)| *there = Some(object));
        }
        let words = Words::new(&inset.bar_text());
        let words = section.name(&there, &mut inset, words);
        panels.push((inset, "inset: the framed part of it".to_owned(), words));
        dashed |= has_dashes;
    } else {
        let words = section.name(&there, &mut set_up, words);
        panels.push((set_up, format!("set-up to scale, along {}", cut.said()), words));
    }

    let large = near.is_empty() || LARGE * widest(&near) >= widest(&whole);
    let (shown, width) = if large { (&whole, widest(&whole)) } else { (&near, widest(&near)) };
    let mut top = Panel::around(flat_span(shown, above).0, width);
    let columns = Columns::below(&top, scene, &objects, span(&whole).1.z + width);
    dashed |= top.fill_from_above(&columns, |i| colours.of(i));
    let ends = [-1.0, 1.0].map(|side| above(cut.point(cut.flatten(cut.through) + DVec2::X * side * 2.0 * width)));
    top.line(ends[0], ends[1], CUT_COLOUR, 4);
    top.draw(&ink, above);
    panels.push((top, "from above: x to the right, y up".to_owned(), Vec::new()));
    Preview(stack(&panels, legend(scene, scattered, &colours, dashed)))
}

/// The objects as the plane of the cut shows them.
struct Section<'a> {
    scene: &'a Scene,
    objects: &'a [Placed<'a>],
    colours: &'a Colours,
    cut: &'a Cut,
    scattered: &'a BTreeMap<String, String>,
}

impl Section<'_> {
    /// Colours a panel; what is there, and whether something of it is dashed.
    fn fill(&self, panel: &mut Panel) -> (Vec<Option<usize>>, bool) {
        let object = |i: usize| self.objects[i].object;
        let there =
            panel.look(|p| object_at(self.objects, self.cut.point(p)).filter(|&i| !is_void(self.scene, object(i))));
        let dashed = panel.fill_section(&there, |i| self.colours.of(i), |a, b| object(a).priority > object(b).priority);
        (there, dashed)
    }

    /// Dashes around finite objects that the plane misses, as they look from across it; the pixels of each.
    fn dash_off_plane(&self, there: &[Option<usize>], panel: &mut Panel) -> Vec<(usize, Vec<bool>)> {
        let (normal, mut stays, mut found) = (self.cut.normal(), Vec::new(), Vec::new());
        for (object, placed) in self.objects.iter().enumerate() {
            let (low, high) = placed.solid.bounds();
            let finite = low.is_finite() && high.is_finite() && !is_void(self.scene, placed.object);
            if !finite || there.contains(&Some(object)) {
                continue;
            }
            let (middle, radius) = (0.5 * (low + high), 0.5 * low.distance(high));
            let flat = self.cut.flatten(middle);
            let holds = panel.look(|at| {
                if at.distance(flat) > radius {
                    return None;
                }
                let p = self.cut.point(at);
                let from = p + ((middle - p).dot(normal) - 1.5 * radius) * normal;
                stays.clear();
                placed.solid.cut(from, normal, None, &mut stays);
                (!stays.is_empty()).then_some(object)
            });
            let holds: Vec<bool> = holds.iter().map(Option::is_some).collect();
            if holds.contains(&true) {
                panel.dash_around(&holds, self.colours.of(object));
                found.push((object, holds));
            }
        }
        found
    }

    /// Writes what each object is made of, the smallest first; opaque ones by their own name. Of scattered bodies one stands for all.
    fn name(&self, there: &[Option<usize>], panel: &mut Panel, mut words: Words) -> Vec<Word> {
        let mut sizes = vec![0; self.objects.len()];
        there.iter().flatten().for_each(|&object| sizes[object] += 1);
        let named = |object: usize| {
            let Placed { name, object, .. } = &self.objects[object];
            object.medium.as_deref().unwrap_or(name)
        };
        let mut largest: BTreeMap<(&str, &str), usize> = BTreeMap::new();
        for object in (0..self.objects.len()).filter(|&object| sizes[object] >= LEAST_NAMED) {
            let origin =
                self.scattered.get(self.objects[object].name).map_or(self.objects[object].name, String::as_str);
            let known = largest.entry((origin, named(object))).or_insert(object);
            if sizes[object] > sizes[*known] {
                *known = object;
            }
        }
        let mut order: Vec<usize> = largest.into_values().collect();
        order.sort_by_key(|&object| (sizes[object], object));
        for object in order.into_iter().rev().take(MOST_NAMED).rev() {
            words.name(named(object), panel, BAR_COLOUR, &|i| there[i] == Some(object));
        }
        words.placed
    }
}

/// The panels side by side, with their titles, names and the lengths of their bars.
fn stack(panels: &[(Panel, String, Vec<Word>)], legend: Value) -> ImageStack {
    let columns = panels.len() * (PANEL + GAP) - GAP;
    let mut stack = ImageStack::new(HEAD + PANEL, columns);
    for (channel, name) in ["red", "green", "blue"].into_iter().enumerate() {
        let data = Array2::from_shape_fn((HEAD + PANEL, columns), |(row, column)| {
            let (panel, column) = (column / (PANEL + GAP), column % (PANEL + GAP));
            match row.checked_sub(HEAD) {
                None => HEAD_COLOUR[channel],
                Some(row) if column < PANEL => panels[panel].0.at(row, column)[channel],
                Some(_) => GAP_COLOUR[channel],
            }
        });
        stack.push(LayerInfo::value(name, "1"), data);
    }
    let words = panels.iter().enumerate().flat_map(|(k, (panel, title, words))| {
        let left = k * (PANEL + GAP);
        let own = [(title.clone(), HEAD - 7, left + 8), (panel.bar_text(), HEAD + BAR_ROW - 6, left + BAR_LEFT)];
        own.into_iter().chain(words.iter().map(move |(text, row, column)| (text.clone(), HEAD + row, left + column)))
    });
    let words = words.map(|(text, row, column)| json!({"text": text, "row": row, "column": column}));
    stack.attributes.insert("labels".into(), words.collect());
    stack.attributes.insert("legend".into(), legend);
    stack
}

/// Where lights stand and what they look at.
fn lamps(scene: &Scene) -> Vec<(DVec3, DVec3)> {
    let place = |lamp: &Lamp| match *lamp {
        Lamp::Point { position, .. } => Some((position.into(), position.into())),
        Lamp::Spot { position, look_at, .. } | Lamp::Collimated { position, look_at, .. } => {
            Some((position.into(), look_at.into()))
        }
        Lamp::Ambient { .. } => None,
    };
    scene.lights.values().filter_map(place).collect()
}

/// Objects with their media, camera and projector, in the colours of the sketch; `hidden`: some outline is dashed.
fn legend(scene: &Scene, scattered: &BTreeMap<String, String>, colours: &Colours, hidden: bool) -> Value {
    let objects = scene.objects.iter().enumerate().filter(|(_, (_, o))| !is_void(scene, o));
    let said =
        |name: &str, medium: Option<&String>| medium.map_or_else(|| name.to_owned(), |m| format!("{name} ({m})"));
    let mut entries: Vec<(String, Colour)> =
        objects.map(|(i, (name, o))| (said(origin(name, scattered), o.medium.as_ref()), colours.of(i))).collect();
    let mut told = BTreeSet::new();
    entries.retain(|(text, _)| told.insert(text.clone()));
    let camera = scene.camera.as_ref().map(|c| ("camera and what it sees", c.field, c.position, c.look_at, CAMERA));
    let projector = scene.projector.as_ref();
    let projector = projector.map(|p| ("projector and what it lights", p.field, p.position, p.look_at, PROJECTOR));
    for (what, [x, y], position, look_at, colour) in camera.into_iter().chain(projector) {
        let away = DVec3::from(position).distance(look_at.into());
        entries.push((format!("{what}: {} x {} mm, {} mm away", round(x), round(y), round(away)), colour));
    }
    entries.extend((!scene.lights.is_empty()).then(|| ("steady lights".to_owned(), LAMP)));
    entries.extend((!scene.detectors.is_empty()).then(|| ("detectors".to_owned(), DETECTOR)));
    entries.push(("dotted from above: the plane of the set-up".to_owned(), CUT_COLOUR));
    entries.extend(
        hidden.then(|| ("dashed: outlines of what lies below the surface, or off the plane".to_owned(), BAR_COLOUR)),
    );
    entries.into_iter().map(|(text, colour)| json!({"text": text, "colour": colour})).collect()
}

/// To 4 digits.
fn round(mm: f64) -> f64 {
    if mm == 0.0 || !mm.is_finite() {
        return mm;
    }
    let unit = libm::exp10(libm::floor(libm::log10(mm.abs())) - 3.0);
    if unit < 1.0 { (mm / unit).round() / (1.0 / unit).round() } else { (mm / unit).round() * unit }
}

/// The middles of detectors, lights, pinholes, the corners of the fields, and finite objects; of infinite ones the highest point.
fn everything(objects: &[Placed<'_>], views: &[(View, Colour)], lamps: &[(DVec3, DVec3)], scene: &Scene) -> Vec<DVec3> {
    let mut points: Vec<DVec3> = lamps.iter().flat_map(|&(from, to)| [from, to]).collect();
    points.extend(scene.detectors.values().map(|d| DVec3::from(d.position)));
    for (view, _) in views {
        points.push(view.position);
        points.extend(edge(view).into_iter().flat_map(|(from, to)| [from, to]));
    }
    for placed in objects {
        let (low, high) = placed.solid.bounds();
        if low.is_finite() && high.is_finite() {
            points.extend(corners(low, high));
        } else if high.z.is_finite() {
            points.push(DVec3::new(0.0, 0.0, high.z));
        }
    }
    points
}

/// The corners of the fields, and finite objects that are not much wider than those; nothing without camera and projector.
fn seen(objects: &[Placed<'_>], views: &[(View, Colour)], scene: &Scene) -> Vec<DVec3> {
    let mut points: Vec<DVec3> = views.iter().flat_map(|(view, _)| edge(view)).map(|(_, to)| to).collect();
    if points.is_empty() {
        return points;
    }
    let (low, high) = span(&points);
    let (middle, width) = (0.5 * (low + high), (high - low).truncate().max_element());
    let mut top = f64::NEG_INFINITY;
    for placed in objects.iter().filter(|p| !is_void(scene, p.object)) {
        let (low, high) = placed.solid.bounds();
        if (high - low).truncate().max_element() <= WIDE * width {
            points.extend(corners(low, high).map(|c| DVec3::new(c.x, c.y, middle.z)));
        }
        top = top.max(high.z.min(middle.z + WIDE * width));
    }
    // The section is a square that hangs from the highest thing in it.
    let (low, high) = span(&points);
    let width = (high - low).truncate().max_element();
    let top = if top.is_finite() { top.clamp(middle.z, middle.z + 0.75 * width) } else { middle.z };
    points.extend([top, top - width].map(|z| DVec3 { z, ..middle }));
    points
}

fn corners(low: DVec3, high: DVec3) -> [DVec3; 8] {
    std::array::from_fn(|i| DVec3::select(glam::BVec3::new(i & 1 > 0, i & 2 > 0, i & 4 > 0), high, low))
}

/// Lowest and highest coordinates; of nothing those of a cube of 2 mm.
fn span(points: &[DVec3]) -> (DVec3, DVec3) {
    let fold = |pick: fn(DVec3, DVec3) -> DVec3| points.iter().copied().reduce(pick);
    (fold(DVec3::min).unwrap_or(DVec3::NEG_ONE), fold(DVec3::max).unwrap_or(DVec3::ONE))
}

/// Middle and width of the square that holds the points as a panel sees them, with a margin of 5 %.
fn flat_span(points: &[DVec3], flatten: impl Fn(DVec3) -> DVec2) -> (DVec2, f64) {
    let flat: Vec<DVec3> = points.iter().map(|&p| flatten(p).extend(0.0)).collect();
    let (low, high) = span(&flat);
    let (low, high) = (low.truncate(), high.truncate());
    (0.5 * (low + high), 1.1 * (high - low).max_element().max(1e-6))
}

/// The edge of a detector, drawn in where it is farther than `most` from the middle.
fn outline(detector: &Detector, most: f64) -> Vec<DVec3> {
    let (middle, facing) = (DVec3::from(detector.position), DVec3::from(detector.facing));
    let corners: Vec<DVec3> = match detector.outline {
        Outline::Disc { diameter } => {
            let (x, y) = facing.any_orthonormal_pair();
            let rim = (0..4 * EDGE_STEPS).map(|i| sin_cos_turns(f64::from(i) / f64::from(4 * EDGE_STEPS)));
            rim.map(|(sin, cos)| 0.5 * diameter * (cos * x + sin * y)).collect()
        }
        Outline::Rectangle { up, size } => {
            let right = DVec3::from(up).cross(facing).normalize_or_zero();
            let (x, y) = (0.5 * size[0] * right, 0.5 * size[1] * facing.cross(right));
            vec![x + y, y - x, -x - y, x - y]
        }
    };
    corners.into_iter().map(|corner| middle + corner.clamp_length_max(most)).collect()
}

/// Along the edge of the field, with where the ray to each comes from.
fn edge(view: &View) -> Vec<(DVec3, DVec3)> {
    let corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0), (0.0, 0.0)];
    let straight = view.distortion.is_none() && view.lens != Lens::Fisheye;
    let steps = if straight { 1 } else { EDGE_STEPS };
    let sides = corners.windows(2).flat_map(|ends| {
        let ((x0, y0), (x1, y1)) = (ends[0], ends[1]);
        (0..steps).map(move |i| {
            let t = f64::from(i) / f64::from(steps);
            (x0 + t * (x1 - x0), y0 + t * (y1 - y0))
        })
    });
    sides.map(|(x, y)| (view.ray(x, y).0, view.seen(x, y))).collect()
}
