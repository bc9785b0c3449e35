//! Many bodies of one kind: sizes drawn, places found, each an object of its own.

use std::collections::{BTreeMap, BTreeSet};

use glam::DVec3;
use turbid_contract::payload::Shape;
use turbid_contract::{AngleDeg, Length, Problem, Problems};
use turbid_draw::stream;
use turbid_optics::solid::Frame;

use crate::assemble::drawn::{Source, source};
use crate::assemble::shape::{cylinder, spheroid};
use crate::params::{Drawn, Params, Quantity, RegionParams, ScatterParams};
use crate::scatter::{Body, Region, Stuck, TRIES, Wanted, place, unit_of};

/// Each is an object that every ray is tried against.
const MOST: u32 = 1000;

/// Shapes of all bodies; `None` where there was a mistake.
pub fn scatter(name: &str, s: &ScatterParams, problems: &mut Problems) -> Option<Vec<Shape>> {
    let at = |field: &str| format!("objects.{name}.scatter.{field}");
    let rule = "be at most 1000: each is an object of its own";
    problems.require(s.count <= MOST, at("count"), f64::from(s.count), "", rule);
    problems.require(s.apart.0 >= 0.0, at("apart"), s.apart.0, "mm", "be >= 0");
    let region = region(&at("within"), &s.within, problems);
    let kind = kind(name, s, problems);
    let ((region, depth), kind) = (region?, kind?);
    if s.count > MOST || s.apart.0 < 0.0 {
        return None;
    }
    let seed = stream(s.seed, name);
    let drawn: Vec<(Cast, f64)> =
        (0..s.count).map(|i| (kind.cast(i, seed), depth.at(unit_of(i, DEPTH, seed)))).collect();
    let bodies: Vec<Wanted> = drawn.iter().map(|(cast, depth)| Wanted { body: cast.body(), depth: *depth }).collect();
    // What a choice gives is known only when it is chosen.
    if let Some(i) = drawn.iter().position(|(cast, _)| !cast.sizes.iter().all(|size| *size > 0.0)) {
        let message = format!("of {name}_{i} the sizes {:?} mm were drawn, but must be > 0", drawn[i].0.sizes);
        problems.push(at(kind.name()), message);
        return None;
    }
    match place(&bodies, &region, s.apart.0, seed) {
        Ok(places) => Some(drawn.iter().zip(places).map(|((cast, _), p)| cast.shape(p)).collect()),
        Err(stuck) => {
            problems.push_with_hint(at("count"), unplaced(s, &bodies, stuck), WAY_OUT);
            None
        }
    }
}

const WAY_OUT: &str = "ask for fewer, smaller or nearer ones (`count`, sizes, `apart`), or a larger region (`within`)";

fn unplaced(s: &ScatterParams, bodies: &[Wanted], Stuck { placed, too_large }: Stuck) -> String {
    let count = s.count;
    if too_large {
        let [x, y, z] = (2.0 * bodies[placed].body.half()).to_array();
        return format!(
            "count = {count}: {placed} were placed; the next one is {x:.4} x {y:.4} x {z:.4} mm large and does not fit into `within`, even alone"
        );
    }
    let apart = s.apart.0;
    format!(
        "count = {count}: {placed} were placed; the next one found none in {TRIES} random places {apart} mm or more from them"
    )
}

/// The object that each scattered body stands for, by the names of both.
pub fn scattered(params: &Params) -> BTreeMap<String, String> {
    let of = |(name, o): (&String, &crate::params::ObjectParams)| {
        let count = o.scatter.as_ref().map_or(0, |s| s.count.min(MOST));
        let name = name.clone();
        (0..count).map(move |i| (body_name(&name, i as usize), name.clone())).collect::<Vec<_>>()
    };
    params.objects.iter().flat_map(of).collect()
}

pub fn body_name(name: &str, i: usize) -> String {
    format!("{name}_{i}")
}

/// What was found of scattered bodies, at the place of the object that they come from: of each of its fields the first mistake and
/// the first warning.
pub fn at_their_origin(mut found: Problems, scattered: &BTreeMap<String, String>) -> Problems {
    let mut said: BTreeSet<(bool, String)> = BTreeSet::new();
    let mut place = |path: String, wrong: bool| {
        let own = path.strip_prefix("objects.").map(|rest| rest.split_once('.').unwrap_or((rest, "")));
        let Some((origin, field)) = own.and_then(|(name, field)| Some((scattered.get(name)?, field))) else {
            return Some(path);
        };
        let path = if field.is_empty() { format!("objects.{origin}") } else { format!("objects.{origin}.{field}") };
        said.insert((wrong, path.clone())).then_some(path)
    };
    let mut problems = Problems::default();
    for (Problem { path, message, hint, .. }, size) in found.take_ranked() {
        if let Some(path) = place(path, false) {
            problems.warn_ranked(size, path, message, hint.unwrap_or_default());
        }
    }
    let (mistakes, warnings) = found.into_parts();
    for Problem { path, message, .. } in warnings {
        if let Some(path) = place(path, false) {
            problems.warn(path, message);
        }
    }
    for Problem { path, message, hint, .. } in mistakes {
        match (place(path, true), hint) {
            (Some(path), Some(hint)) => problems.push_with_hint(path, message, hint),
            (Some(path), None) => problems.push(path, message),
            (None, _) => {}
        }
    }
    problems
}

/// Numbers of the sizes of one body; a spheroid's turns come behind its diameters.
const TURNS: u32 = 3;
const DEPTH: u32 = 6;

/// The region with the depths in it.
fn region(path: &str, region: &RegionParams, problems: &mut Problems) -> Option<(Region, Source)> {
    match region {
        RegionParams::Rect(r) => {
            let mut wide = true;
            for (axis, [first, last]) in [("x", r.x), ("y", r.y)] {
                if first.0 >= last.0 {
                    wide = false;
                    let message = format!("{axis} = [{}, {}] mm must rise: [first, last]", first.0, last.0);
                    problems.push(format!("{path}.rect.{axis}"), message);
                }
            }
            let depth = source(&format!("{path}.rect.depth"), &r.depth, false, problems)?;
            let corner = |end: usize| [r.x[end].0, r.y[end].0];
            wide.then_some((Region::Below { low: corner(0), high: corner(1), top: r.top.0 }, depth))
        }
        RegionParams::Box(b) => {
            let mut wide = true;
            for (i, Length(size)) in b.size.iter().enumerate() {
                wide &= *size > 0.0;
                problems.require(*size > 0.0, format!("{path}.box.size.{i}"), *size, "mm", "be > 0");
            }
            let (center, half) = (DVec3::from(b.center.map(|l| l.0)), 0.5 * DVec3::from(b.size.map(|l| l.0)));
            wide.then_some((Region::Within { low: center - half, high: center + half }, Source::One(0.0)))
        }
    }
}

/// What bodies are drawn from: sizes, and turns or an axis.
#[expect(clippy::large_enum_variant, reason = "there is one for each object")]
enum Kind {
    Sphere(Source),
    Spheroid([Source; 3], [Source; 3]),
    Cylinder([Source; 2], [f64; 3]),
}

/// One body as it was drawn.
struct Cast {
    /// Diameters; a cylinder's diameter and length.
    sizes: Vec<f64>,
    turns: [f64; 3],
    /// Of a cylinder.
    axis: Option<[f64; 3]>,
}

fn kind(name: &str, s: &ScatterParams, problems: &mut Problems) -> Option<Kind> {
    let at = |field: &str| format!("objects.{name}.scatter.{field}");
    let given = [s.sphere.is_some(), s.spheroid.is_some(), s.cylinder.is_some()].into_iter().filter(|g| *g).count();
    if given != 1 {
        let rule = if given == 0 { "has no kind of body" } else { "has more than one kind of body" };
        problems.push_with_hint(
            format!("objects.{name}.scatter"),
            format!("{name} {rule}"),
            "give exactly one of sphere, spheroid, cylinder; bodies of another kind are another object",
        );
        return None;
    }
    if let Some(sphere) = &s.sphere {
        return source(&at("sphere.diameter"), &sphere.diameter, true, problems).map(Kind::Sphere);
    }
    if let Some(spheroid) = &s.spheroid {
        let diameters = three(&at("spheroid.diameters"), &spheroid.diameters, true, problems);
        let turns = three(&at("spheroid.rotation_deg"), &spheroid.rotation_deg, false, problems);
        return Some(Kind::Spheroid(diameters?, turns?));
    }
    let cylinder = s.cylinder.as_ref()?;
    let diameter = source(&at("cylinder.diameter"), &cylinder.diameter, true, problems);
    let length = source(&at("cylinder.length"), &cylinder.length, true, problems);
    let axis = cylinder.axis.unit();
    if axis.is_none() {
        let hint = "write x, y, z, or a vector that is not zero";
        problems.push_with_hint(at("cylinder.axis"), "[0, 0, 0] has no direction", hint);
    }
    Some(Kind::Cylinder([diameter?, length?], axis?))
}

fn three<T: Quantity>(
    path: &str,
    drawn: &[Drawn<T>; 3],
    above_zero: bool,
    problems: &mut Problems,
) -> Option<[Source; 3]> {
    let [a, b, c] = [0, 1, 2].map(|i| source(&format!("{path}.{i}"), &drawn[i], above_zero, problems));
    Some([a?, b?, c?])
}

impl Kind {
    fn name(&self) -> &'static str {
        match self {
            Self::Sphere(_) => "sphere",
            Self::Spheroid(..) => "spheroid",
            Self::Cylinder(..) => "cylinder",
        }
    }

    /// The sizes of the `i`-th body.
    fn cast(&self, i: u32, seed: u64) -> Cast {
        let draw = |source: &Source, which: u32| source.at(unit_of(i, which, seed));
        match self {
            Self::Sphere(diameter) => Cast { sizes: vec![draw(diameter, 0)], turns: [0.0; 3], axis: None },
            Self::Spheroid(diameters, turns) => Cast {
                sizes: (0..3).zip(diameters).map(|(k, d)| draw(d, k)).collect(),
                turns: [0, 1, 2].map(|k| draw(&turns[k], TURNS + k as u32)),
                axis: None,
            },
            Self::Cylinder(sizes, axis) => {
                Cast { sizes: (0..2).zip(sizes).map(|(k, s)| draw(s, k)).collect(), turns: [0.0; 3], axis: Some(*axis) }
            }
        }
    }
}

impl Cast {
    fn body(&self) -> Body {
        match (self.axis, &self.sizes[..]) {
            (Some(axis), [diameter, length, ..]) => {
                Body::Cylinder { radius: 0.5 * diameter, half_length: 0.5 * length, axis: axis.into() }
            }
            _ => Body::Ellipsoid {
                radii: 0.5 * DVec3::from(self.diameters()),
                frame: Frame::turned(DVec3::ZERO, self.turns),
            },
        }
    }

    fn shape(&self, center: DVec3) -> Shape {
        let center = center.to_array().map(|x| x + 0.0);
        match (self.axis, &self.sizes[..]) {
            (Some(axis), &[diameter, length, ..]) => cylinder(diameter, length, center, axis),
            _ => spheroid(self.diameters(), center, self.turns.map(AngleDeg)),
        }
    }

    /// Of a sphere's one diameter three.
    fn diameters(&self) -> [f64; 3] {
        [0, 1, 2].map(|k| self.sizes.get(k).copied().unwrap_or(self.sizes[0]))
    }
}
