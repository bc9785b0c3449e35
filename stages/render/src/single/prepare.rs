//! The frame of a render, and when f32 is enough for it.

use std::ops::RangeInclusive;

use glam::DVec3;
use turbid_optics::solid::{Carved, Solid};

use super::bend::Plane;
use super::face::Interfaces;
use super::facets::Eyes;
use super::frame::{Frame, Leaving, Medium};
use super::ground::{Ground, Part};
use super::image_lookup::ImageLookup;
use super::lane::RoundKeys;
use super::limits::{CYCLES, LARGEST, MOST_BODIES, MOST_CHANNELS, RANGE, range};
use super::phase_function::second_terms;
use super::refusal::{self, Refusal};
use super::source::Source;
use crate::bsdf::Bsdf;
use crate::lengths::MOST_LENGTHS;
use crate::light::Carrier;
use crate::random::LAMPS_IN_LANES;
use crate::setting::{Nee, Setting};
use crate::walker::Walker;
use crate::world::{Material, World};

/// g of media in which light-directed branches pay (with g = 0 they cost more than they save: measured), up to where f32 holds their lobe.
const PEAKED: RangeInclusive<f64> = 0.5..=0.99;

impl<'a> Frame<'a> {
    /// Ready for paths; `None` where f32 cannot hold the render.
    pub fn of(walker: &Walker<'a>) -> Option<Self> {
        let mut frame = Self::held(walker).ok()?;
        let s = walker.setting();
        let light = s.light.shines().then_some(s.light.view.position);
        // Where light bends the camera's rays are followed one by one.
        let eyes = Eyes { camera: (!frame.bends()).then_some(s.camera.view.position), light };
        frame.ground.meshes.iter_mut().for_each(|mesh| mesh.prepare(&eyes));
        Some(frame)
    }

    /// For plans: its meshes are not prepared for lines. Error: why f32 cannot hold the render.
    pub fn held(walker: &Walker<'a>) -> Result<Self, Refusal> {
        let s = walker.setting();
        let range = range(s.world);
        if let Some(refusal) = too_large(s) {
            return Err(refusal);
        }
        // What the camera sees of the plane through the origin must lie within the range.
        let (origin, reach) = walker.image_part.seen(s);
        if reach.is_nan() || reach > range {
            return Err(Refusal::Extent { reach, mu_s: RANGE / range });
        }
        let parts = parts(s.world);
        let ground = Ground::about(&parts, origin, range);
        let others = (0..parts.len()).any(|j| ground.is_other(j));
        let by_distance = others || !ground.meshes.is_empty();
        let plane = if by_distance { None } else { Plane::of(walker, &parts, origin) };
        let interfaces = Interfaces::of(walker, &parts, &ground, origin);
        let image_lookup = ImageLookup::over(s.light, s.projected_images, origin);
        let bends = plane.is_some() || interfaces.is_some();
        let can = Abilities::of(s, &ground, &parts, others, bends, image_lookup.is_some());
        let Abilities { straight, blind, next_events, singly, lanes_alone, .. } = can;
        let turns = bends && lanes_alone;
        let onward = straight && !others && lanes_alone;
        let sends = onward && next_events && s.light.shines() && ground.meshes.is_empty();
        let refused = can.refused(walker, &ground, &parts, (origin, range), image_lookup.is_some());
        let (projector, unit) = Source::projector(s.light, origin);
        let (lamps, steady) = Source::lamps(s.steady, s.shared, origin);
        let shining = s.light.shines().then_some(projector);
        let first = shining.or(lamps.first().copied());
        let scales = s.shared.map_or(&[][..], |shared| &shared.channels);
        let counted_in = s.shared.map_or_else(|| vec![MOST_LENGTHS; s.world.materials.len()], |s| s.counted.clone());
        let projected =
            if s.shared.is_some() { scales.iter().map(|scale| unit * scale.projector).collect() } else { vec![unit] };
        let material = |part: &Part| &s.world.materials[part.material];
        let leaving = match plane {
            _ if parts.len() > 1 || by_distance || s.steady.ambient > 0.0 => Leaving::Unknown,
            Some(_) if turns => Leaving::Plane,
            None if straight => Leaving::Ends,
            _ => Leaving::Unknown,
        };
        let light_branches = if sends { sends_light_branches(s.world, origin, range) } else { Vec::new() };
        Ok(Self {
            origin,
            range_squared: (range * range) as f32,
            media: media(walker),
            second_terms: second_terms(&s.world.materials),
            mu_t: parts.iter().map(|part| material(part).mu_t() as f32).collect(),
            opaque: parts.iter().map(|part| material(part).is_opaque()).collect(),
            straight: straight && !others,
            onward: onward || (interfaces.is_some() && lanes_alone),
            others,
            known: if by_distance { 0.0 } else { f32::INFINITY },
            counted: parts.iter().map(|part| counted_in[part.material]).collect(),
            counted_in,
            counts: s.shared.is_some(),
            channels: scales.iter().map(|scale| scale.excess.map(|mu_a| mu_a as f32)).collect(),
            dark: ((straight && !others) || turns) && s.steady.ambient == 0.0,
            turns,
            keys: RoundKeys::of(s.key),
            channel: s.channel << 16,
            first: if bends { 4 } else { 2 },
            plain: !by_distance
                && !singly
                && (next_events || blind)
                && s.shared.is_none()
                && walker.peaked_index.is_none()
                && light_branches.is_empty(),
            leaving,
            light_branches,
            plane,
            interfaces,
            tau_sure: walker.tau_sure as f32,
            worth: parts.iter().map(|part| walker.worth[part.material] as f32).collect(),
            next_events,
            repeated: can.repeated,
            lamps: singly,
            blind,
            starts: (onward || (turns && !s.steady.shines())) && !s.camera.has_aperture(),
            stride: walker.stride(),
            weight_windows: first.zip(walker.peaked_index.map(|n| n.recip() as f32)),
            windows: (0..s.world.materials.len()).any(|m| walker.window(m) > 0.0),
            sources: shining.into_iter().chain(lamps.into_iter().filter(|_| !singly)).collect(),
            projected,
            unit,
            steady,
            carriers: carriers(s, origin),
            image_lookup,
            refused,
            parts,
            ground,
        })
    }
}

/// A number that is too large for f32, or for the lanes.
fn too_large(s: &Setting<'_>) -> Option<Refusal> {
    if s.nee != Nee::Line {
        return Some(Refusal::Reference);
    }
    let view = &s.light.view;
    let cycles = view.field.length() * s.carriers.iter().fold(0.0, |most: f64, c| most.max(c.f_x()));
    let dense = s.world.materials.iter().find(|m| m.mu_t() > LARGEST || (m.mu_s > 0.0 && m.mu_s < 1.0 / LARGEST));
    let distance = (view.position - view.look_at).length();
    match dense {
        _ if cycles > CYCLES => Some(Refusal::Cycles(cycles)),
        Some(m) => Some(Refusal::Coefficient(if m.mu_t() > LARGEST { m.mu_t() } else { m.mu_s })),
        None if distance > LARGEST => Some(Refusal::Distance(distance)),
        None if s.channels() > MOST_CHANNELS => Some(Refusal::Channels(s.channels())),
        None => None,
    }
}

fn media(walker: &Walker<'_>) -> Vec<Medium> {
    let materials = walker.setting().world.materials.iter().enumerate();
    let medium = |(i, m): (usize, &Material)| Medium {
        free_path: walker.free_path(i) as f32,
        mu_a: m.mu_a as f32,
        mu_s: m.mu_s as f32,
        g: m.phase.g_forward() as f32,
        window: walker.window(i) as f32,
    };
    materials.map(medium).collect()
}

/// Cycles per mm along x and y of each carrier, and at the origin.
fn carriers(s: &Setting<'_>, origin: DVec3) -> Vec<[f32; 3]> {
    let carrier = |c: &Carrier| {
        let (x, y) = c.along();
        let turns = x * origin.x + y * origin.y;
        [x as f32, y as f32, (turns - turns.round()) as f32]
    };
    s.carriers.iter().map(carrier).collect()
}

/// What of a render goes in lanes.
struct Abilities {
    /// Light goes straight through all boundaries; or it bends where lanes know how.
    straight: bool,
    bends: bool,
    /// There is nothing to connect to.
    blind: bool,
    repeated: bool,
    /// No other body shares the medium of one that is a mesh.
    alone: bool,
    next_events: bool,
    /// Lamps are connected by the scalar walker.
    singly: bool,
    /// Nothing but divergent flights is left to that.
    lanes_alone: bool,
}

impl Abilities {
    fn of(s: &Setting<'_>, ground: &Ground, parts: &[Part], others: bool, bends: bool, pictured: bool) -> Self {
        let matt = |m: &Material| m.is_opaque() && m.bsdf != Bsdf::Mirror;
        let straight = |m: &Material| matt(m) || (m.n == 1.0 && m.bsdf == Bsdf::Smooth);
        let straight = s.world.materials.iter().all(straight);
        let blind = !s.light.shines() && s.steady.lamps.is_empty();
        // Lenses are looked up one by one; so are lamps where interfaces bend their light, and beside meshes.
        let plain = s.light.view.distortion.is_none() && (s.projected_images.layers() == 0 || pictured);
        let for_lamps = straight && ground.meshes.is_empty() && s.steady.lamps.len() <= LAMPS_IN_LANES;
        let for_any = if s.light.shines() { plain } else { for_lamps && !blind };
        let repeated = repeats(parts);
        // Rays meet the facets of their own body only.
        let alone = !repeated || ground.meshes.is_empty();
        let next_events = (straight || bends) && !others && can_connect(s.world, parts) && for_any && alone;
        let singly = !(s.steady.lamps.is_empty() || (next_events && for_lamps));
        let lanes_alone = blind || (next_events && !singly);
        Self { straight, bends, blind, repeated, alone, next_events, singly, lanes_alone }
    }

    /// What keeps next-event estimation and starts from going in lanes.
    fn refused(
        &self,
        walker: &Walker<'_>,
        ground: &Ground,
        parts: &[Part],
        (origin, range): (DVec3, f64),
        pictured: bool,
    ) -> Vec<Refusal> {
        let s = walker.setting();
        let mut refused = Vec::new();
        if !(self.next_events || self.blind) {
            refused.extend((!(self.straight || self.bends)).then(|| refusal::of_interfaces(walker, parts)));
            refused.extend(refusal::of_solids(ground, parts, origin, range));
            refused.extend((parts.len() > MOST_BODIES).then_some(Refusal::Bodies(parts.len())));
            refused.extend(carves_opaque(s.world, parts).then_some(Refusal::CarvedOpaque));
            let distorted = s.light.view.distortion.is_some() && s.light.shines();
            refused.extend(distorted.then_some(Refusal::Distortion));
            let images = s.projected_images;
            let longer = images.size().into_iter().max().filter(|_| images.layers() > 0 && !pictured);
            refused.extend(longer.map(Refusal::Pattern));
            refused.extend((!self.alone).then_some(Refusal::RepeatedMedium));
        }
        let lamps = self.singly && (self.next_events || !s.light.shines());
        refused.extend(lamps.then_some(Refusal::Lamps(s.steady.lamps.len())));
        refused.extend(s.camera.has_aperture().then_some(Refusal::Aperture));
        refused.dedup();
        refused
    }
}

/// The bodies of a world; the holes of carved ones are voids before them, where there is nothing else to be seen in a hole.
fn parts(world: &World) -> Vec<Part> {
    let mut parts = Vec::with_capacity(world.bodies.len());
    for (i, body) in world.bodies.iter().enumerate() {
        let m = &world.materials[body.material];
        let filled = body.material != 0;
        let mut part = |solid: &Solid, material: usize, open: bool| {
            parts.push(Part { solid: solid.clone(), material, filled: material != 0, open });
        };
        let open = m.mu_s > 0.0 && !m.is_opaque();
        match &body.solid {
            Solid::Carved(carved)
                if filled && !world.bodies[i + 1..].iter().any(|below| shows_in(carved, &below.solid)) =>
            {
                carved.holes.iter().for_each(|hole| part(hole, 0, false));
                part(&carved.whole, body.material, open);
            }
            solid => part(solid, body.material, open),
        }
    }
    parts
}

/// For each material whether it fills bodies that have a bore or a hollow, within the range of f32, and scatters with a peak: what comes by way of
/// other interfaces is then rare and bright. Empty where none does.
fn sends_light_branches(world: &World, origin: DVec3, range: f64) -> Vec<bool> {
    let near = |solid: &Solid| {
        let (low, high) = solid.bounds();
        (low - origin).abs().max((high - origin).abs()).length() <= range
    };
    let sends = |(m, material): (usize, &Material)| {
        let mut filled = world.bodies.iter().filter(|body| body.material == m);
        let hollow = filled.clone().any(|body| matches!(body.solid, Solid::Carved(_)));
        m != 0
            && material.mu_s > 0.0
            && PEAKED.contains(&material.phase.g_forward())
            && hollow
            && filled.all(|body| near(&body.solid))
    };
    let of: Vec<bool> = world.materials.iter().enumerate().map(sends).collect();
    if of.contains(&true) { of } else { Vec::new() }
}

/// Whether a body of lower priority may be seen in a carved one, or where its holes, some of them without end, would carve that body too.
fn shows_in(carved: &Carved, below: &Solid) -> bool {
    std::iter::once(&carved.whole).chain(&carved.holes).any(|solid| overlap(below, solid))
}

/// Whether bounding boxes share more than faces.
fn overlap(a: &Solid, b: &Solid) -> bool {
    let ((a_low, a_high), (b_low, b_high)) = (a.bounds(), b.bounds());
    a_low.cmplt(b_high).all() && b_low.cmplt(a_high).all()
}

/// Whether next-event estimation in lanes is right: few bodies that they know, and nothing that carves opaque ones.
fn can_connect(world: &World, parts: &[Part]) -> bool {
    parts.len() <= MOST_BODIES && !carves_opaque(world, parts)
}

/// Whether a body of higher priority may take a part of an opaque one.
fn carves_opaque(world: &World, parts: &[Part]) -> bool {
    parts.iter().enumerate().any(|(i, part)| {
        let opaque = world.materials[part.material].is_opaque();
        opaque && parts[..i].iter().any(|other| overlap(&other.solid, &part.solid))
    })
}

/// Whether bodies share a medium.
fn repeats(parts: &[Part]) -> bool {
    let again = |(i, part): (usize, &Part)| part.open && parts[..i].iter().any(|other| other.material == part.material);
    parts.iter().enumerate().any(again)
}

impl Frame<'_> {
    /// Distance (mm) of the nearest surface that lanes do not know.
    pub fn clearance(&self, p: DVec3) -> f64 {
        let others = self.parts.iter().enumerate().filter(|(j, _)| self.ground.is_other(*j));
        others.map(|(_, part)| part.solid.clearance(p)).fold(f64::INFINITY, f64::min)
    }
}
