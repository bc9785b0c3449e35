//! One path from the camera: free flights, analog absorption, and what follows from each.
//!
//! A path is walked backward from a random point of its pixel; what it sees of the light at its turns stands in `nee.rs`.
//! `docs/theory/render.md` derives the weights.

mod flight;
mod responses;

use std::collections::VecDeque;

use fearless_simd::Level;
use glam::DVec3;
use turbid_optics::elementary::{ln, sin_cos_turns};
use turbid_optics::henyey_greenstein as hg;
use turbid_optics::philox::{spare, unit, unit_fine};
use turbid_optics::refraction::refract;
use turbid_optics::rough::Rough;

use self::flight::End;
use crate::camera::Camera;
use crate::caustic::Known;
use crate::channels::{Lengths, NO_LENGTHS, Shared};
use crate::finish::Finish;
use crate::glint::clear;
use crate::lamp::Steady;
use crate::light::{Carrier, Light};
use crate::link::{Link, Way};
use crate::look::{self, Queue};
use crate::mirror::Mirrors;
use crate::nee::Entry;
use crate::pictures::Pictures;
use crate::random::{MOST_NUMBERS, Purpose, Stream, after, before};
use crate::response::Layout;
use crate::strata::{self, Bending};
use crate::world::{Material, Piece, Skin, Spans, World};

/// How scatterings look for the light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Nee {
    /// At the scattering itself. The reference that the others are tested against.
    Point,
    /// One scattering ahead: a point on a line along the path's own next direction or along one drawn around the light,
    /// one sample of the two, weighted by the balance heuristic. Takes the Henyey-Greenstein peak out of the variance.
    Line,
}

/// Where mu_a is below this part of mu_s', deep paths end by roulette (elsewhere it does not pay: measured) ...
const WEAK_ABSORPTION: f64 = 0.01;
/// ... against the weight (1 + WINDOW mu_eff d)^4 at distance d from the nearest boundary. It must not outrun absorption: light
/// comes back from there like exp(-mu_eff d), so below WINDOW = 1/2 the weight times its square falls with d.
const WINDOW: f64 = 0.4;

/// Everything that stays the same over the paths of one channel.
#[derive(Clone, Copy)]
pub struct Setting<'a> {
    pub world: &'a World,
    pub camera: &'a Camera,
    pub light: &'a Light,
    pub steady: &'a Steady,
    /// Those with f_x > 0.
    pub carriers: &'a [Carrier],
    pub pictures: &'a Pictures,
    pub key: [u32; 2],
    pub channel: u32,
    pub nee: Nee,
    /// Where several channels share the paths, what tells them apart.
    pub shared: Option<&'a Shared>,
}

impl Setting<'_> {
    pub fn layout(&self) -> Layout {
        Layout { carriers: self.carriers.len(), pictures: self.pictures.layers(), steady: self.steady.shines() }
    }

    /// How many channels see what a path brings.
    pub fn channels(&self) -> usize {
        self.shared.map_or(1, |shared| shared.channels.len())
    }
}

/// Walks paths and keeps their scratch.
pub struct Walker<'a> {
    pub(crate) setting: Setting<'a>,
    pub(crate) spans: Spans,
    pub(crate) pieces: Vec<Piece>,
    pub(crate) way: Way,
    /// Ways to a light.
    pub(crate) links: Vec<Link>,
    /// Those through walls of any shape that are known for sure, and places where there may be one.
    pub(crate) known: Vec<Known>,
    pub(crate) places: Vec<DVec3>,
    /// What walls do to a ray on the way that is being looked for: whether they reflect it.
    pub(crate) events: Vec<bool>,
    /// Ways found by chance that were too rare to be weighed.
    pub(crate) given_up: u64,
    /// Where light bends in the world.
    pub(crate) bending: Bending,
    /// Where it bends at planes, what upright light keeps of itself in each layer, at most.
    pub(crate) clear: Vec<f64>,
    /// Whether facets do that.
    pub(crate) facetted: bool,
    /// Whether all walls are flat.
    pub(crate) flat: bool,
    pub(crate) mirrors: Mirrors,
    /// Ways of light by them.
    pub(crate) mirrored: Vec<Link>,
    /// Path after path, channel after channel of each, as [`Layout`] says.
    pub(crate) responses: Vec<f64>,
    /// The part of it that comes by the queue; apart, so that it does not matter when the queue is flushed.
    pub(crate) queued: Vec<f64>,
    /// The part that comes by f32 lanes.
    single: Vec<f64>,
    pub(crate) queue: Queue,
    pub(crate) level: Level,
    /// For each material 1 / mu_s, infinite where nothing scatters.
    free_paths: Vec<f64>,
    /// For each material its body, where looks ahead are free of branches.
    pub(crate) body_of: Option<Vec<u64>>,
    /// For each material WINDOW mu_eff (mm^-1), 0 where there is no roulette.
    windows: Vec<f64>,
    /// Pieces of media that the flight under way came into, from elsewhere.
    pub(crate) entries: Vec<Entry>,
    /// For each material whether scouts are sent in it; empty where they are nowhere.
    pub scouts: Vec<bool>,
    /// Scouts that have not gone yet, in the order in which they were sent.
    pub(crate) sent: VecDeque<Place>,
    /// Of how many paths there are responses.
    pub(crate) paths: usize,
    flights: u64,
    endless: bool,
    ending: Ending,
    /// Whether light that was never scattered, only turned by walls, is not seen.
    pub excludes_specular: bool,
}

/// What became of a path that has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// On its way to infinity.
    Left,
    /// In this body or at its surface.
    Absorbed(usize),
    /// Between the facets of a rough wall.
    Lost,
    /// It would not end.
    Endless,
}

/// A path between two flights.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    pub r: DVec3,
    /// Direction of flight.
    pub w: DVec3,
    pub material: usize,
    pub skin: Option<Skin>,
    /// No boundary is nearer than this.
    pub clear: f64,
    /// Optical depth of absorption that is left until the path ends.
    pub life: f64,
    /// What the path stands for, after the roulettes it survived.
    pub weight: f64,
    pub pixel: u32,
    pub sample: u32,
    /// Number of the next flight, by which its random numbers are known (`random.rs`).
    pub number: u64,
    /// Whether the next flight has been scored ahead, up to its first boundary (beyond it is when it gets there) ...
    pub ahead: bool,
    /// ... or wholly: where nothing has scattered it yet.
    pub wholly: bool,
    /// Whether it has been scattered, by a medium or diffusely.
    pub scattered: bool,
    /// Whether smooth or rough walls have turned it, and nothing has scattered it.
    pub glint: bool,
    /// Of the light that the next flight's end sees, what is left beside a scout's.
    pub share: f64,
    /// Whether it is a scout: it ends where its flight does.
    pub scout: bool,
    /// Which of the walker's responses is its own.
    pub response: usize,
    /// How far it has come in each medium that tells channels apart.
    pub lengths: Lengths,
}

impl Place {
    /// Number of the flight that has come here; 0 at the camera.
    pub(crate) fn flight(&self) -> u64 {
        before(self.number, self.scout)
    }
}

impl<'a> Walker<'a> {
    pub fn new(setting: Setting<'a>, level: Level) -> Self {
        let window = |m: &Material| {
            let reduced = m.mu_s * (1.0 - m.g);
            let weak = setting.nee == Nee::Line && m.mu_a < WEAK_ABSORPTION * reduced;
            if weak { WINDOW * (3.0 * m.mu_a * (m.mu_a + reduced)).sqrt() } else { 0.0 }
        };
        let windows = setting.world.materials.iter().map(window).collect();
        let (spans, pieces) = (Spans::default(), Vec::new());
        let free_paths = setting.world.materials.iter().map(|m| 1.0 / m.mu_s).collect();
        // Pictures are looked up one by one, and lengths are counted only there.
        let lanes = setting.pictures.layers() == 0 && setting.shared.is_none();
        let body_of = if lanes { look::bodies_by_material(setting.world) } else { None };
        let bending = Bending::of(setting.world);
        let clear = if let Bending::AtPlanes(strata) = &bending { clear(setting.world, strata) } else { Vec::new() };
        let (responses, queued, queue) = (Vec::new(), Vec::new(), Queue::default());
        Self {
            setting,
            spans,
            pieces,
            way: Way::default(),
            links: Vec::new(),
            known: Vec::new(),
            places: Vec::new(),
            events: Vec::new(),
            given_up: 0,
            bending,
            clear,
            flat: strata::is_flat(setting.world),
            facetted: strata::turns_at_facets(setting.world),
            mirrors: Mirrors::of(setting.world),
            mirrored: Vec::new(),
            responses,
            queued,
            single: Vec::new(),
            queue,
            level,
            free_paths,
            body_of,
            windows,
            entries: Vec::new(),
            scouts: Vec::new(),
            sent: VecDeque::new(),
            paths: 0,
            flights: 0,
            endless: false,
            ending: Ending::Left,
            excludes_specular: false,
        }
    }

    /// Whether a path had to be cut because it would not end.
    pub fn endless(&self) -> bool {
        self.endless
    }

    /// How the last path ended.
    pub fn ending(&self) -> Ending {
        self.ending
    }

    /// How many ways of light were found by chance, but too rarely to be weighed: they are missing.
    pub fn given_up(&self) -> u64 {
        self.given_up
    }

    /// Flights since the last call.
    pub fn take_flights(&mut self) -> u64 {
        std::mem::take(&mut self.flights)
    }

    /// One path of a pixel: its radiances (W mm^-2 sr^-1) as [`Layout`] says. The same numbers whenever and wherever it is called.
    pub fn path(&mut self, pixel: usize, sample: u32) -> &[f64] {
        self.clear_responses(1);
        let mut at = self.begin(pixel, sample, 0);
        while self.step(&mut at) {}
        while let Some(mut scout) = self.sent.pop_front() {
            self.step(&mut scout);
        }
        self.gather();
        &self.responses
    }

    pub fn setting(&self) -> &Setting<'a> {
        &self.setting
    }

    /// WINDOW mu_eff of a material, 0 where deep paths play no roulette.
    pub fn window(&self, material: usize) -> f64 {
        self.windows[material]
    }

    /// mm, in a material; infinite where nothing scatters.
    pub fn free_path(&self, material: usize) -> f64 {
        self.free_paths[material]
    }

    /// For each material the body that it fills, where looks can go by the queue.
    pub fn body_of(&self) -> Option<&[u64]> {
        self.body_of.as_deref()
    }

    /// The vector instructions to use.
    pub fn level(&self) -> Level {
        self.level
    }

    /// Flights made on its behalf.
    pub fn count_flights(&mut self, flights: usize) {
        self.flights += flights as u64;
    }

    pub(crate) fn stream(&self, at: &Place) -> Stream {
        let s = self.setting;
        Stream::new(s.key, at.pixel, at.sample, s.channel)
    }

    /// A path at the camera, its single scattering seen to.
    pub fn begin(&mut self, pixel: usize, sample: u32, response: usize) -> Place {
        let s = self.setting;
        let stream = Stream::new(s.key, pixel as u32, sample, s.channel);
        let [jx, jy, ja, jb] = stream.block(Purpose::Begin);
        let line = s.nee == Nee::Line;
        let (r, w) = if s.camera.has_aperture() {
            let [u, v, ..] = stream.block(Purpose::Lens);
            s.camera.ray_through(pixel, unit(jx), unit(jy), unit(u), unit(v))
        } else {
            s.camera.ray(pixel, unit(jx), unit(jy))
        };
        let at = Place {
            r,
            w,
            material: 0,
            skin: None,
            clear: 0.0,
            // Absorption at a rate mu_a along the way ends the path: drawn once, exact for any albedo and sequence of media.
            life: -ln(unit_fine(ja, jb)),
            weight: 1.0,
            pixel: pixel as u32,
            sample,
            number: 2,
            ahead: line,
            wholly: line,
            scattered: false,
            glint: false,
            share: 1.0,
            scout: false,
            response,
            lengths: NO_LENGTHS,
        };
        if line {
            self.look_along(&at, &stream);
        }
        at
    }

    /// One flight and what follows from it; false where the path has ended.
    pub fn step(&mut self, at: &mut Place) -> bool {
        let stream = self.stream(at);
        let flight = at.number;
        let [a, b, c, d] = stream.block(Purpose::Flight(flight));
        at.number = after(flight, at.scout);
        self.flights += 1;
        // In a closed white cavity light has nowhere to go.
        if at.number > MOST_NUMBERS {
            self.endless = true;
            self.ending = Ending::Endless;
            return false;
        }
        let roulette = unit(d);
        let end = self.fly(at, -ln(unit_fine(a, d)));
        if !self.entries.is_empty() {
            self.look_into_entries(at, roulette);
        }
        match end {
            // The path itself sees to the light there.
            End::Left | End::Surface { .. } if at.scout => false,
            End::Gone => {
                // The first, in order of priority, that holds the place.
                let body = self.setting.world.bodies.iter().position(|body| body.solid.contains(at.r));
                self.ending = body.map_or(Ending::Left, Ending::Absorbed);
                false
            }
            End::Left => {
                self.ending = Ending::Left;
                self.see_ambient(at);
                false
            }
            End::Surface { skin, normal, rho } => {
                at.skin = Some(skin);
                at.clear = 0.0;
                (at.scattered, at.glint, at.share) = (true, false, 1.0);
                self.look_from_surface(at, normal, rho);
                if roulette >= rho {
                    self.ending = Ending::Absorbed(skin.wall.body);
                    return false;
                }
                at.w = cosine_direction(normal, unit(b), unit(c));
                (at.ahead, at.wholly) = (false, false);
                true
            }
            End::Mirror { skin, normal, from } => {
                at.glint |= !at.scattered;
                (at.skin, at.material) = (Some(skin), from);
                at.w = (at.w - 2.0 * at.w.dot(normal) * normal).normalize();
                at.clear = 0.0;
                let line = self.setting.nee == Nee::Line;
                (at.ahead, at.wholly) = (line, line && !at.scattered);
                if line {
                    self.look_along(at, &stream);
                }
                true
            }
            End::Boundary { skin, normal, from, to } => {
                let [n_from, n_to] = [from, to].map(|m| self.setting.world.materials[m].n);
                let owner = self.setting.world.bodies[skin.wall.body].material;
                at.glint |= !at.scattered;
                let on = if let Finish::Rough(alpha) = self.setting.world.materials[owner].finish {
                    let normal = if skin.inside { -normal } else { normal };
                    let rough = Rough { alpha, normal, n_from, n_to };
                    if at.scattered || !self.excludes_specular {
                        self.look_from_rough(at, &rough, skin);
                    }
                    let [fate, ..] = stream.block(Purpose::Facet(flight));
                    let Some(on) = rough.sample(at.w, [unit(b), unit(c), roulette, unit(fate)]) else {
                        self.ending = Ending::Lost;
                        return false;
                    };
                    on
                } else {
                    let refraction = refract(at.w, normal, n_from, n_to);
                    refraction.refracted.filter(|_| roulette >= refraction.reflectance).unwrap_or(refraction.reflected)
                };
                let through = (on.dot(normal) > 0.0) == skin.inside;
                (at.skin, at.material) =
                    if through { (Some(Skin { inside: !skin.inside, ..skin }), to) } else { (Some(skin), from) };
                at.w = on;
                at.clear = 0.0;
                let line = self.setting.nee == Nee::Line;
                (at.ahead, at.wholly) = (line, line && !at.scattered);
                if line {
                    self.look_along(at, &stream);
                }
                true
            }
            End::Scattered { crossed } => {
                at.skin = None;
                (at.scattered, at.glint) = (true, false);
                if !(at.ahead || (crossed && self.setting.nee == Nee::Line)) {
                    self.look_from_collision(at, roulette);
                }
                at.wholly = false;
                if !at.scout && self.windows[at.material] > 0.0 && self.ends_deep(at, spare(b, c, d)) {
                    return false;
                }
                let next = hg::sample(self.setting.world.materials[at.material].g, at.w, unit(b), unit(c));
                if self.setting.nee == Nee::Line {
                    self.look_ahead(at, next, roulette);
                    (at.ahead, at.share) = (true, 1.0);
                    if self.scouts.get(at.material) == Some(&true) && !at.scout {
                        self.send_scout(at, next);
                    }
                }
                at.w = next;
                !at.scout
            }
        }
    }

    /// Roulette of deep paths where absorption is weak.
    #[inline]
    fn ends_deep(&mut self, at: &mut Place, random: f64) -> bool {
        at.clear = self.setting.world.clearance(at.r);
        let window = deep_weight(self.windows[at.material], at.clear);
        if at.weight >= 0.5 * window {
            return false;
        }
        let survives = random * window < at.weight;
        at.weight = window;
        !survives
    }
}

/// Weight below half of which a path at distance `clear` from every boundary plays roulette for it; `window` is WINDOW mu_eff.
#[inline(always)]
pub fn deep_weight(window: f64, clear: f64) -> f64 {
    let x = 1.0 + window * clear;
    x * x * x * x
}

/// A direction off a surface with a density proportional to the cosine.
fn cosine_direction(normal: DVec3, u: f64, turns: f64) -> DVec3 {
    let (sin_phi, cos_phi) = sin_cos_turns(turns);
    hg::turn(normal, u.sqrt(), (1.0 - u).sqrt(), sin_phi, cos_phi)
}
