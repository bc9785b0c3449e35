//! What the f32 lanes know of a render.

use fearless_simd::prelude::*;
use glam::DVec3;

use super::bend::Plane;
use super::face::Interfaces;
use super::ground::{Ground, Part};
use super::image_lookup::ImageLookup;
use super::lane::{F, RoundKeys, U, V, splat};
use super::phase_function::{Phase, Second};
use super::refusal::Refusal;
use super::rows::PathRow;
use super::source::Source;
use crate::lengths::MOST_LENGTHS;
use crate::random::Stream;

/// What becomes of paths that leave their body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Leaving {
    /// There may be other bodies, or it is not convex, or its surface is not known well enough.
    Unknown,
    /// Nothing else is there, and they end.
    Ends,
    /// They end unless its surface, a plane, reflects them.
    Plane,
}

/// A world and a light as the lanes see them.
#[derive(Clone, Debug)]
pub struct Frame<'a> {
    /// What local coordinates count from, mm: exact where most of the light is.
    pub origin: DVec3,
    /// Square of the distance (mm) from it to which lanes go.
    pub range_squared: f32,
    pub ground: Ground,
    /// Of each material.
    pub media: Vec<Medium>,
    /// Of each material the second term of its phase function; empty where none has any.
    pub second_terms: Vec<Second>,
    /// Of each body, mm^-1.
    pub mu_t: Vec<f32>,
    /// Highest priority first; as in `ground`.
    pub parts: Vec<Part>,
    /// Whether a body lets no light through.
    pub opaque: Vec<bool>,
    /// Whether there are bodies that lanes know by their distance only.
    pub others: bool,
    /// What a path that begins knows of the distance (mm) to those, or to meshes: nothing, or that there are none.
    pub known: f32,
    /// Whether light goes straight through all boundaries, and lanes know them.
    pub straight: bool,
    /// Whether flights go on into other bodies in lanes: so does next-event estimation behind boundaries.
    pub onward: bool,
    /// For each material whether light-directed branches start in it; empty where they are nowhere.
    pub light_branches: Vec<bool>,
    /// Whether a path that leaves all bodies has ended: boundaries do not turn it, and there is no light from infinity.
    pub dark: bool,
    /// Where light from the projector bends on its way to all that scatters.
    pub plane: Option<Plane>,
    /// The same where it bends at interfaces of other shapes.
    pub interfaces: Option<Interfaces>,
    /// Optical distance from the light up to which all vertices are connected to it.
    pub tau_sure: f32,
    /// Of each body, what estimates through interfaces are measured by: see `Walker::worth`.
    pub worth: Vec<f32>,
    /// Whether they turn flights in lanes, too.
    pub turns: bool,
    /// Of its random numbers: the keys of Philox's rounds, and the channel as it stands in the counter.
    pub keys: RoundKeys,
    pub channel: u32,
    /// Block of random numbers of a path's first flight within a medium: where light bends the one before brings it through the plane.
    pub first: u32,
    /// Whether next-event estimation goes in lanes: few enough bodies that lanes know.
    pub next_events: bool,
    /// Whether bodies share a medium: where they touch they are one.
    pub repeated: bool,
    /// Whether flights that stay in their medium are plain: no meshes, no surfaces that lanes do not know, no lamps that are connected one by one, no
    /// weight windows, no light-directed branches, no lengths to count.
    pub plain: bool,
    pub leaving: Leaving,
    /// Whether there is nothing to connect to: no light but from infinity.
    pub blind: bool,
    /// Whether there are lamps that are connected one by one.
    pub lamps: bool,
    /// Whether paths start in lanes.
    pub starts: bool,
    /// Whether any medium has a roulette of deep paths.
    pub windows: bool,
    /// What weight windows are about, if paths have them: a light, and one over the refractive index of the medium.
    pub weight_windows: Option<(Source, f32)>,
    /// For which they go in lanes: the projector first.
    pub sources: Vec<Source>,
    /// Irradiance of the projector at the centre of its field in each channel, W mm^-2: in lanes it is 1 there.
    pub projected: Vec<f64>,
    /// The same for what walks.
    pub unit: f64,
    /// The same of lamps.
    pub steady: f64,
    /// Numbers of a path's response.
    pub stride: usize,
    /// Cycles per mm along x and y, and at the origin, of each carrier.
    pub carriers: Vec<[f32; 3]>,
    /// Where patterns are pictures.
    pub image_lookup: Option<ImageLookup<'a>>,
    /// For each body, which of a path's lengths counts what lies in it.
    pub counted: Vec<usize>,
    /// The same for each material.
    pub counted_in: Vec<usize>,
    /// Whether paths carry lengths: several channels see them.
    pub counts: bool,
    /// Of each of those that share the paths: absorption beyond that of the walk, mm^-1, for each length.
    pub channels: Vec<[f32; MOST_LENGTHS]>,
    /// What keeps next-event estimation and starts from going in lanes.
    pub refused: Vec<Refusal>,
}

/// A material, mm^-1.
#[derive(Clone, Copy, Debug)]
pub struct Medium {
    /// mm.
    pub free_path: f32,
    pub mu_a: f32,
    pub mu_s: f32,
    /// Of the forward term of the phase function.
    pub g: f32,
    /// WINDOW mu_eff.
    pub window: f32,
}

impl Frame<'_> {
    /// Whether light bends on its way in, in lanes.
    pub fn bends(&self) -> bool {
        self.plane.is_some() || self.interfaces.is_some()
    }

    /// Unit vectors against the light of weight windows, as horizontal planes turn it on its way in.
    #[inline(always)]
    pub fn against_light<S: Simd>(&self, simd: S, r: V<S>, (source, inverse_index): &(Source, f32)) -> V<S> {
        let (towards, _) = source.towards(r);
        let (x, y) = (towards.x * *inverse_index, towards.y * *inverse_index);
        let z = (1.0 - x * x - y * y).max(splat(simd, 0.0)).sqrt().copysign(towards.z);
        V { x, y, z }
    }

    /// Of paths in these media, `g` that of their forward terms.
    #[inline(always)]
    pub fn phase_of_media<S: Simd>(&self, simd: S, g: F<S>, material: U<S>) -> Phase<S> {
        let seconds = (!self.second_terms.is_empty()).then(|| self.second_terms.iter().copied());
        Phase::of(
            simd,
            g,
            seconds,
            #[inline(always)]
            |m| material.simd_eq(m),
        )
    }

    /// The same of paths in these bodies.
    #[inline(always)]
    pub fn phase_of_bodies<S: Simd>(&self, simd: S, g: F<S>, body: U<S>) -> Phase<S> {
        let of = |part: &Part| self.second_terms.get(part.material).copied();
        let seconds = (!self.second_terms.is_empty()).then(|| self.parts.iter().filter_map(of));
        Phase::of(
            simd,
            g,
            seconds,
            #[inline(always)]
            |j| body.simd_eq(j),
        )
    }

    /// The random numbers of a path.
    pub(crate) fn stream(&self, path: &PathRow) -> Stream {
        Stream::new(self.keys.key(), path.pixel, path.sample, self.channel >> 16)
    }

    /// In local coordinates.
    pub fn local(&self, p: DVec3) -> [f32; 3] {
        (p - self.origin).as_vec3().to_array()
    }

    pub fn world(&self, p: [f32; 3]) -> DVec3 {
        self.origin + DVec3::from(p.map(f64::from))
    }
}
