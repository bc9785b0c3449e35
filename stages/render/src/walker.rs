//! Who walks paths: its scratch, and what it knows of the world before the first of them.

use std::collections::VecDeque;

use fearless_simd::Level;
use glam::DVec3;
use turbid_optics::rough::FacetFlight;
use turbid_optics::solid::Chord;

use crate::ahead;
use crate::connection::{Connection, Known, SpecularChain};
use crate::image_part::ImagePart;
use crate::lengths::Lengths;
use crate::mirrors::Mirrors;
use crate::random::Stream;
use crate::setting::{Nee, Place, Setting};
use crate::strata::{self, Bending, clear};
use crate::weight_window;
use crate::world::{Chords, Interface, Material, RaySegment};

/// Where mu_a is below this part of mu_s', deep paths end by roulette (elsewhere it does not pay: measured) ...
const WEAK_ABSORPTION: f64 = 0.01;
/// ... against the weight (1 + WINDOW mu_eff d)^4 at distance d from the nearest boundary. It must not outrun absorption: light
/// comes back from there like exp(-mu_eff d), so below WINDOW = 1/2 the weight times its square falls with d.
const WINDOW: f64 = 0.4;

/// Walks paths and keeps their scratch.
pub struct Walker<'a> {
    pub(crate) setting: Setting<'a>,
    pub(crate) chords: Chords,
    pub(crate) segments: Vec<RaySegment>,
    pub(crate) chain: SpecularChain,
    /// Connections to a light.
    pub(crate) connections: Vec<Connection>,
    /// Those through interfaces of any shape that are known for sure, and places where there may be one.
    pub(crate) known: Vec<Known>,
    pub(crate) places: Vec<DVec3>,
    /// Of a line and one body.
    pub(crate) scratch: Vec<Chord>,
    /// What interfaces do to a ray on the chain that is being searched: whether they reflect it.
    pub(crate) events: Vec<bool>,
    /// Connections found by manifold sampling that were too rare to be weighed.
    pub(crate) given_up: u64,
    /// Where light bends in the world.
    pub(crate) bending: Bending,
    /// Where it bends at planes, what upright light keeps of itself in each layer, at most.
    pub(crate) clear: Vec<f64>,
    /// Whether facets do that.
    pub(crate) facetted: bool,
    /// Whether all interfaces are flat.
    pub(crate) flat: bool,
    pub(crate) mirrors: Mirrors,
    /// Connections by them.
    pub(crate) mirrored: Vec<Connection>,
    /// Path after path, channel after channel of each, as [`crate::response::Layout`] says.
    pub(crate) responses: Vec<f64>,
    /// What lanes leave to be connected one by one; apart, so that it does not matter when that is done.
    pub(crate) connected: Vec<f64>,
    /// The part that comes by f32 lanes.
    pub(crate) single: Vec<f64>,
    pub(crate) level: Level,
    /// For each material 1 / mu_s, infinite where nothing scatters.
    pub(crate) free_paths: Vec<f64>,
    /// For each material WINDOW mu_eff (mm^-1), 0 where there is no roulette.
    pub(crate) windows: Vec<f64>,
    /// Optical distance from the light up to which all vertices are connected to it.
    pub(crate) tau_sure: f64,
    /// For each material, what estimates through curved interfaces are measured by: the part of what a path is expected to bring, over the
    /// irradiance.
    pub(crate) worth: Vec<f64>,
    /// Of the last walk among facets.
    pub(crate) facet_flights: Vec<FacetFlight>,
    /// Segments of media that the flight under way came into, from elsewhere.
    pub(crate) entries: Vec<Entry>,
    /// For each material whether light-directed branches start in it; empty where they are nowhere.
    pub light_branches: Vec<bool>,
    /// Light-directed branches that are not followed yet, in the order in which they started.
    pub(crate) sent: VecDeque<Place>,
    /// Refractive index of the medium for which paths have weight windows, if they do.
    pub(crate) peaked_index: Option<f64>,
    /// Copies of paths that were split, the last first.
    pub(crate) copies: Vec<Place>,
    /// Of how many paths there are responses.
    pub(crate) paths: usize,
    pub(crate) flights: u64,
    pub(crate) endless: bool,
    pub(crate) ending: Ending,
    /// Whether light that was never scattered, only turned by interfaces, is not seen.
    pub excludes_specular: bool,
    /// What all its paths begin in.
    pub image_part: ImagePart,
}

/// What became of a path that has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// On its way to infinity.
    Left,
    /// In this body or at its surface.
    Absorbed(usize),
    /// It would not end.
    Endless,
}

/// A segment of a medium that a flight comes into across a boundary. If it gets there, the light that its scattering there will see is scored
/// by one point on the segment: where light grazes the interface, few collisions are near enough to it to see any.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Entry {
    pub r: DVec3,
    /// mm.
    pub length: f64,
    pub material: usize,
    /// Where it comes in.
    pub interface: Option<Interface>,
    /// Up to there.
    pub lengths: Lengths,
}

impl<'a> Walker<'a> {
    pub fn new(setting: Setting<'a>, level: Level) -> Self {
        let window = |m: &Material| {
            let reduced = m.mu_s_prime();
            let weak = setting.nee == Nee::Line && m.mu_a < WEAK_ABSORPTION * reduced;
            if weak { WINDOW * (3.0 * m.mu_a * (m.mu_a + reduced)).sqrt() } else { 0.0 }
        };
        let windows = setting.world.materials.iter().map(window).collect();
        let worth = setting.world.materials.iter().map(ahead::worth).collect();
        let (chords, segments) = (Chords::default(), Vec::new());
        let free_paths = setting.world.materials.iter().map(|m| 1.0 / m.mu_s).collect();
        let bending = Bending::of(setting.world);
        let dear = bending == Bending::AtInterfaces;
        let tau_sure = if dear { ahead::TAU_SURE_WHERE_DEAR } else { ahead::TAU_SURE };
        let peaked_index = weight_window::peaked_index(&setting, &bending);
        let clear = if let Bending::AtPlanes(strata) = &bending { clear(setting.world, strata) } else { Vec::new() };
        Self {
            setting,
            chords,
            segments,
            chain: SpecularChain::default(),
            connections: Vec::new(),
            known: Vec::new(),
            places: Vec::new(),
            scratch: Vec::new(),
            events: Vec::new(),
            given_up: 0,
            bending,
            clear,
            flat: strata::is_flat(setting.world),
            facetted: strata::turns_at_facets(setting.world),
            mirrors: Mirrors::of(setting.world),
            mirrored: Vec::new(),
            responses: Vec::new(),
            connected: Vec::new(),
            single: Vec::new(),
            level,
            free_paths,
            windows,
            tau_sure,
            worth,
            facet_flights: Vec::new(),
            entries: Vec::new(),
            light_branches: Vec::new(),
            sent: VecDeque::new(),
            peaked_index,
            copies: Vec::new(),
            paths: 0,
            flights: 0,
            endless: false,
            ending: Ending::Left,
            excludes_specular: false,
            image_part: ImagePart::WHOLE,
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

    /// How many connections were found by manifold sampling, but too rarely to be weighed: they are missing.
    pub fn given_up(&self) -> u64 {
        self.given_up
    }

    /// Flights since the last call.
    pub fn take_flights(&mut self) -> u64 {
        std::mem::take(&mut self.flights)
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
}
