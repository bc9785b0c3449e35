//! The preview: a top view and a side view with objects, camera, projector and their fields.

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

/// Height and width of each of the two panels, pixels.
const PANEL: usize = 360;
const GAP: usize = 8;

/// Where the bar that gives the scale starts.
const BAR_LEFT: usize = 10;
const BAR_ROW: usize = PANEL - 12;

/// Pieces of each side of a field whose edge is not straight.
const EDGE_STEPS: u32 = 16;

const PAPER: [f32; 3] = [0.97, 0.97, 0.95];
const GAP_COLOUR: [f32; 3] = [0.75, 0.75, 0.75];
const BAR_COLOUR: [f32; 3] = [0.125; 3];
const CAMERA: [f32; 3] = [0.05, 0.25, 0.75];
const PROJECTOR: [f32; 3] = [0.85, 0.45, 0.0];
const LAMP: [f32; 3] = [0.75, 0.0, 0.35];
const DETECTOR: [f32; 3] = [0.0, 0.5, 0.3];
/// Objects in the order of their names (colour-blind safe: Paul Tol's light scheme).
const OBJECTS: [[f32; 3]; 6] = [
    [0.93, 0.75, 0.73],
    [0.60, 0.80, 0.93],
    [0.67, 0.67, 0.0],
    [0.73, 0.80, 0.20],
    [1.0, 0.67, 0.73],
    [0.87, 0.87, 0.6],
];

/// Top view (x to the right, y up) beside side view (x to the right, z up, cut through the camera's look_at).
pub fn sketch(scene: &Scene) -> Preview {
    let camera = scene.camera.as_ref().and_then(|c| camera_view(c).ok()).map(|v| (v, CAMERA));
    let projector = scene.projector.as_ref().and_then(|p| projector_view(p).ok()).map(|v| (v, PROJECTOR));
    let views: Vec<(View, [f32; 3])> = camera.into_iter().chain(projector).collect();
    let cut = views.first().map_or(DVec3::ZERO, |(v, _)| v.look_at);
    let lamps = lamps(scene);
    let objects = placed(scene);
    let (low, high) = extent(&objects, &views, &lamps, scene);
    let detectors: Vec<Vec<DVec3>> =
        scene.detectors.values().map(|d| outline(d, 4.0 * (high - low).max_element())).collect();
    let colour_of = |p: DVec3| {
        let seen = object_at(&objects, p).filter(|&i| !is_void(scene, objects[i].object));
        seen.map(|i| OBJECTS[i % OBJECTS.len()])
    };
    let from_above = |x: f64, y: f64| {
        // The first object that a ray straight down meets, seen just below its skin.
        let ray = DVec3::new(x, y, high.z);
        let mut stays = Vec::new();
        for placed in &objects {
            placed.solid.cut(ray, DVec3::NEG_Z, None, &mut stays);
        }
        let mut entries: Vec<f64> = stays.iter().flat_map(|s| [s.enter.max(0.0), s.leave.max(0.0)]).collect();
        entries.sort_by(f64::total_cmp);
        entries.into_iter().find_map(|t| colour_of(ray - (t + 1e-6 * (1.0 + t)) * DVec3::Z))
    };
    let top = Panel::new(DVec2::new(low.x, low.y), DVec2::new(high.x, high.y));
    let side = Panel::new(DVec2::new(low.x, low.z), DVec2::new(high.x, high.z));
    let panels = [
        top.draw(from_above, &views, &lamps, &detectors, |p| DVec2::new(p.x, p.y)),
        side.draw(|x, z| colour_of(DVec3::new(x, cut.y, z)), &views, &lamps, &detectors, |p| DVec2::new(p.x, p.z)),
    ];
    let mut stack = ImageStack::new(PANEL, 2 * PANEL + GAP);
    for (channel, name) in ["red", "green", "blue"].into_iter().enumerate() {
        let data = Array2::from_shape_fn((PANEL, 2 * PANEL + GAP), |(row, column)| match column {
            c if c < PANEL => panels[0][row * PANEL + c][channel],
            c if c < PANEL + GAP => GAP_COLOUR[channel],
            c => panels[1][row * PANEL + c - PANEL - GAP][channel],
        });
        stack.push(LayerInfo::value(name, "1"), data);
    }
    stack.attributes.insert("labels".into(), labels([&top, &side]));
    stack.attributes.insert("legend".into(), legend(scene));
    Preview(stack)
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

/// What each panel shows and how long its bar is; `preview` has the letters.
fn labels(panels: [&Panel; 2]) -> Value {
    let words = panels.iter().zip([("from above", 0), ("from the side, cut", PANEL + GAP)]);
    let labels = words.flat_map(|(panel, (view, left))| {
        let (length, _) = panel.bar();
        let scale = format!("{length} mm");
        [
            json!({"text": view, "row": 18, "column": left + 8}),
            json!({"text": scale, "row": BAR_ROW - 6, "column": left + BAR_LEFT}),
        ]
    });
    labels.collect()
}

/// Objects with their media, camera and projector, in the colours of the sketch.
fn legend(scene: &Scene) -> Value {
    let objects = scene.objects.iter().enumerate().filter(|(_, (_, o))| !is_void(scene, o));
    let said =
        |name: &str, medium: Option<&String>| medium.map_or_else(|| name.to_owned(), |m| format!("{name} ({m})"));
    let mut entries: Vec<(String, [f32; 3])> =
        objects.map(|(i, (name, o))| (said(name, o.medium.as_ref()), OBJECTS[i % OBJECTS.len()])).collect();
    entries.extend(scene.camera.iter().map(|_| ("camera and what it sees".to_owned(), CAMERA)));
    entries.extend(scene.projector.iter().map(|_| ("projector and what it lights".to_owned(), PROJECTOR)));
    entries.extend((!scene.lights.is_empty()).then(|| ("steady lights".to_owned(), LAMP)));
    entries.extend((!scene.detectors.is_empty()).then(|| ("detectors".to_owned(), DETECTOR)));
    entries.into_iter().map(|(text, colour)| json!({"text": text, "colour": colour})).collect()
}

/// What both panels show: the middles of detectors, pinholes, the corners of their fields, and finite objects, with a margin of 5 %.
fn extent(
    objects: &[Placed<'_>],
    views: &[(View, [f32; 3])],
    lamps: &[(DVec3, DVec3)],
    scene: &Scene,
) -> (DVec3, DVec3) {
    let mut points: Vec<DVec3> = lamps.iter().flat_map(|&(from, to)| [from, to]).collect();
    points.extend(scene.detectors.values().map(|d| DVec3::from(d.position)));
    for (view, _) in views {
        points.push(view.position);
        points.extend(edge(view).into_iter().flat_map(|(from, to)| [from, to]));
    }
    for placed in objects {
        let (low, high) = placed.solid.bounds();
        if low.x.is_finite() {
            points.extend([low, high]);
        } else {
            points.push(DVec3::new(0.0, 0.0, high.z));
        }
    }
    let low = points.iter().copied().reduce(DVec3::min).unwrap_or(DVec3::splat(-1.0));
    let high = points.iter().copied().reduce(DVec3::max).unwrap_or(DVec3::splat(1.0));
    let margin = 0.05 * (high - low).max_element().max(1e-6);
    (low - margin, high + margin)
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

/// A square window on the world with the same scale along both axes.
struct Panel {
    corner: DVec2,
    mm_per_pixel: f64,
}

impl Panel {
    fn new(low: DVec2, high: DVec2) -> Self {
        let width = (high - low).max_element();
        Self { corner: 0.5 * (low + high) + 0.5 * width * DVec2::new(-1.0, 1.0), mm_per_pixel: width / PANEL as f64 }
    }

    fn draw(
        &self,
        colour: impl Fn(f64, f64) -> Option<[f32; 3]>,
        views: &[(View, [f32; 3])],
        lamps: &[(DVec3, DVec3)],
        detectors: &[Vec<DVec3>],
        flatten: impl Fn(DVec3) -> DVec2,
    ) -> Vec<[f32; 3]> {
        let mut pixels: Vec<[f32; 3]> = (0..PANEL * PANEL)
            .map(|i| {
                let at = DVec2::new((i % PANEL) as f64 + 0.5, -((i / PANEL) as f64 + 0.5));
                let p = self.corner + self.mm_per_pixel * at;
                colour(p.x, p.y).unwrap_or(PAPER)
            })
            .collect();
        for (view, ink) in views {
            let edge: Vec<(DVec2, DVec2)> = edge(view).into_iter().map(|(a, b)| (flatten(a), flatten(b))).collect();
            for (i, &(from, to)) in edge.iter().enumerate() {
                self.line(&mut pixels, to, edge[(i + 1) % edge.len()].1, *ink, 1);
                if i % (edge.len() / 4) == 0 {
                    self.line(&mut pixels, from, to, *ink, 3);
                }
            }
            let pinhole = flatten(view.position);
            self.cross(&mut pixels, pinhole, *ink);
        }
        for &(from, to) in lamps {
            self.line(&mut pixels, flatten(from), flatten(to), LAMP, 3);
            self.cross(&mut pixels, flatten(from), LAMP);
        }
        for outline in detectors {
            for (i, &corner) in outline.iter().enumerate() {
                let next = outline[(i + 1) % outline.len()];
                self.line(&mut pixels, flatten(corner), flatten(next), DETECTOR, 1);
            }
        }
        let (_, pixels_long) = self.bar();
        for column in BAR_LEFT..BAR_LEFT + pixels_long {
            for row in BAR_ROW..BAR_ROW + 2 {
                pixels[row * PANEL + column] = BAR_COLOUR;
            }
        }
        pixels
    }

    fn cross(&self, pixels: &mut [[f32; 3]], middle: DVec2, ink: [f32; 3]) {
        let arm = 5.0 * self.mm_per_pixel;
        for (a, b) in [(DVec2::X, DVec2::Y), (DVec2::Y, DVec2::X)] {
            for side in -2..=2 {
                let shift = f64::from(side) * self.mm_per_pixel * b;
                self.line(pixels, middle - arm * a + shift, middle + arm * a + shift, ink, 1);
            }
        }
    }

    /// A round length in mm, up to a third of the panel, and how many pixels that are.
    fn bar(&self) -> (f64, usize) {
        let third = self.mm_per_pixel * PANEL as f64 / 3.0;
        let power = libm::exp10(libm::floor(libm::log10(third)));
        let length = [5.0, 2.0, 1.0].map(|digit| digit * power).into_iter().find(|l| *l <= third).unwrap_or(third);
        (length, (length / self.mm_per_pixel) as usize)
    }

    /// Draws every `dash`-th pixel of a line.
    fn line(&self, pixels: &mut [[f32; 3]], from: DVec2, to: DVec2, ink: [f32; 3], dash: usize) {
        let place = |p: DVec2| (p - self.corner) / self.mm_per_pixel * DVec2::new(1.0, -1.0);
        let (from, to) = (place(from), place(to));
        let steps = (to - from).abs().max_element().ceil().max(1.0) as usize;
        for i in (0..=steps).step_by(dash) {
            let p = from + (i as f64 / steps as f64) * (to - from);
            let (column, row) = (p.x.floor(), p.y.floor());
            if (0.0..PANEL as f64).contains(&column) && (0.0..PANEL as f64).contains(&row) {
                pixels[row as usize * PANEL + column as usize] = ink;
            }
        }
    }
}
