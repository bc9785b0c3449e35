//! Why f32 lanes do not take a render, or a part of it: what the scene asks for, and what they hold.

use std::fmt;

use turbid_optics::solid::Solid;

use super::ground::{Ground, Part};
use super::image_lookup::MOST_PIXELS;
use super::limits::{CYCLES, LARGEST, MOST_BODIES, MOST_CHANNELS, MOST_FACES, MOST_TURNING, RANGE};
use crate::bsdf::Bsdf;
use crate::image_part::MOST_PARTS;
use crate::strata::Bending;
use crate::walker::Walker;
use crate::world::Material;

/// One reason; written out it says the value and the limit.
#[derive(Clone, Debug, PartialEq)]
pub enum Refusal {
    /// The reference estimator is asked for, which tests use.
    Reference,
    /// Cycles of the finest carrier across the projector's field.
    Cycles(f64),
    /// A coefficient, mm^-1.
    Coefficient(f64),
    /// mm from the projector to the plane of its pattern.
    Distance(f64),
    /// How many channels share a walk.
    Channels(usize),
    /// How far (mm) what the camera sees reaches from the middle of its image; greatest mu_s, mm^-1.
    Extent {
        reach: f64,
        mu_s: f64,
    },
    /// Bodies, a hole counting as one.
    Bodies(usize),
    /// The same of bodies that turn light.
    TurningBodies(usize),
    /// A kind of solid that lanes know by its distance only.
    Solid(&'static str),
    /// A solid with curved or upright faces that reaches so far from the middle of the image; how far lanes hold it, mm.
    FarSolid(f64, f64),
    /// An opaque body of which another one takes a part.
    CarvedOpaque,
    /// Bodies of one medium beside a mesh.
    RepeatedMedium,
    /// The projector's lens distorts.
    Distortion,
    /// Pixels of a pattern along its longer side.
    Pattern(usize),
    /// Lamps where interfaces turn light, or beside meshes.
    Lamps(usize),
    /// The camera's lens has an aperture, so paths begin one by one.
    Aperture,
    Mirrors,
    RoughInterfaces,
    /// Light bends at horizontal planes, but not at one alone between the light and all that scatters.
    Planes,
    /// Two refractive indices of bodies that turn light.
    Indices(f64, f64),
    /// A refractive index at or below that of the surroundings.
    Index(f64),
    /// Holes or turned solids at whose interfaces light bends.
    Interfaces(&'static str),
    /// Camera or projector is in a body at whose interfaces light bends.
    Inside,
    /// More faces than lanes hold.
    Faces,
    /// No projector shines where interfaces turn light.
    NoProjector,
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Reference => write!(f, "the reference estimator is walked one path after the other"),
            Self::Cycles(n) => write!(f, "{n:.0} cycles across the projector's field: f32 lanes hold up to {CYCLES}"),
            Self::Coefficient(mu) => {
                write!(f, "a coefficient of {mu:e} mm^-1: f32 lanes hold {:e} to {LARGEST:e} mm^-1", 1.0 / LARGEST)
            }
            Self::Distance(d) => write!(f, "a projector {d:e} mm away: f32 lanes hold up to {LARGEST:e} mm"),
            Self::Channels(n) => write!(f, "{n} channels by one walk: f32 lanes hold up to {MOST_CHANNELS}"),
            Self::Extent { reach, mu_s } => {
                // It comes as the reciprocal of a free path.
                let (taus, mu_s) = (reach * mu_s, (mu_s * 1e9).round() / 1e9);
                write!(
                    f,
                    "the camera sees up to {reach:.1} mm beside its middle, {taus:.0} mean free paths at mu_s = {mu_s} mm^-1: "
                )?;
                write!(
                    f,
                    "f32 lanes hold up to {RANGE} in each part of an image (a pixel, or a {MOST_PARTS}th of its sides)"
                )
            }
            Self::Bodies(n) => write!(f, "{n} bodies (a hole counts as one): f32 lanes hold up to {MOST_BODIES}"),
            Self::TurningBodies(n) => {
                write!(f, "{n} bodies where walls turn light: f32 lanes hold up to {MOST_TURNING} there")
            }
            Self::Solid(kind) => {
                write!(f, "{kind}: f32 lanes hold slabs, boxes, spheroids, cylinders, holes of these and meshes")
            }
            Self::FarSolid(far, range) => {
                write!(
                    f,
                    "a body that reaches {far:.1} mm from the middle of the image: f32 lanes hold up to {range:.1} mm"
                )
            }
            Self::CarvedOpaque => write!(f, "a body cuts into an opaque one: f32 lanes hold whole opaque bodies"),
            Self::RepeatedMedium => {
                write!(f, "several bodies of one medium beside a mesh: f32 lanes hold one body of each")
            }
            Self::Distortion => write!(f, "the projector's lens distorts: f32 lanes hold lenses that do not"),
            Self::Pattern(n) => write!(f, "a pattern of {n} pixels along a side: f32 lanes hold up to {MOST_PIXELS}"),
            Self::Lamps(n) => write!(
                f,
                "{n} lamps where walls turn light or a mesh stands: f32 lanes hold lamps where light goes straight on"
            ),
            Self::Aperture => write!(f, "the camera has an aperture: f32 lanes begin paths at a pinhole"),
            Self::Mirrors => write!(f, "mirrors: f32 lanes hold none"),
            Self::RoughInterfaces => write!(f, "rough walls turn light: f32 lanes hold smooth ones"),
            Self::Planes => write!(
                f,
                "light bends at planes, but not at one alone between the projector and all that scatters: f32 lanes hold one"
            ),
            Self::Indices(a, b) => write!(f, "walls of n = {a} and n = {b} turn light: f32 lanes hold one index"),
            Self::Index(n) => write!(f, "curved walls of n = {n}: f32 lanes hold n above 1"),
            Self::Interfaces(kind) => write!(f, "light bends at {kind}: f32 lanes hold whole bodies without facets"),
            Self::Inside => {
                write!(f, "camera or projector stands in a body that turns light: f32 lanes hold them outside")
            }
            Self::Faces => {
                write!(f, "bodies with more than {MOST_FACES} faces in all turn light: f32 lanes hold {MOST_FACES}")
            }
            Self::NoProjector => write!(f, "walls turn the light of lamps: f32 lanes hold that of a projector"),
        }
    }
}

/// What kind of solid it is, where it turns light.
fn kind(solid: &Solid) -> &'static str {
    match solid {
        Solid::Turned(_) => "a turned body",
        Solid::Carved(_) => "a body with a hole",
        Solid::Mesh(_) => "a mesh",
        _ => "a body",
    }
}

/// The bodies that lanes know by their distance only, `range` being how far (mm) f32 holds curved and upright faces.
pub fn of_solids(ground: &Ground, parts: &[Part], origin: glam::DVec3, range: f64) -> Option<Refusal> {
    let part = parts.iter().enumerate().find(|(j, _)| ground.is_other(*j))?.1;
    let (low, high) = part.solid.bounds();
    let far = (low - origin).abs().max((high - origin).abs()).max_element();
    let whole = match &part.solid {
        Solid::Turned(turned) => &turned.solid,
        solid => solid,
    };
    let held = match whole {
        Solid::Box { .. } | Solid::Ellipsoid { .. } | Solid::Cylinder { .. } => true,
        Solid::Mesh(_) => !matches!(part.solid, Solid::Turned(_)),
        _ => false,
    };
    Some(if held && far > range { Refusal::FarSolid(far, range) } else { Refusal::Solid(kind(&part.solid)) })
}

/// Why lanes do not know the connections by the interfaces that turn light.
pub fn of_interfaces(walker: &Walker<'_>, parts: &[Part]) -> Refusal {
    let setting = walker.setting();
    let of = |part: &Part| &setting.world.materials[part.material];
    let refracts = |m: &&Material| !m.is_opaque() && m.n != 1.0;
    if setting.world.materials.iter().any(|m| m.bsdf == Bsdf::Mirror) {
        return Refusal::Mirrors;
    }
    if setting.world.materials.iter().any(|m| matches!(m.bsdf, Bsdf::Rough(_))) {
        return Refusal::RoughInterfaces;
    }
    if matches!(walker.bending, Bending::AtPlanes(_)) {
        return Refusal::Planes;
    }
    if !setting.light.shines() {
        return Refusal::NoProjector;
    }
    let first = parts.iter().map(of).find(refracts).map_or(1.0, |m| m.n);
    let other = parts.iter().map(of).find(|m| !m.is_opaque() && m.n != first);
    if let Some(other) = other {
        return Refusal::Indices(first, other.n);
    }
    if first <= 1.0 {
        return Refusal::Index(first);
    }
    let whole = |solid: &Solid| !matches!(solid, Solid::Turned(_) | Solid::Carved(_));
    if let Some(body) = setting.world.bodies.iter().find(|body| !whole(&body.solid)) {
        return Refusal::Interfaces(kind(&body.solid));
    }
    if parts.len() > MOST_TURNING {
        return Refusal::TurningBodies(parts.len());
    }
    let (eye, lamp) = (setting.camera.view.position, setting.light.view.position);
    if parts.iter().any(|part| part.solid.contains(eye) || part.solid.contains(lamp)) {
        return Refusal::Inside;
    }
    Refusal::Faces
}
