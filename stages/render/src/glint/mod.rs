//! Glints: light that comes from a lamp to the camera by smooth walls alone. A glint is a point of the image, which no path can hit: it is
//! computed once, without noise, and added.
//!
//! `docs/theory/render.md` derives the radiance of its pixel.

mod field;
mod stack;

use std::collections::BTreeMap;

use glam::DVec3;
use turbid_contract::{Ctx, Error};
use turbid_optics::elementary::sin_cos_turns;
use turbid_optics::view::Lens;

pub use field::Glinting;

use crate::camera::Camera;
use crate::lamp::{Lamp, Source};
use crate::level::named;
use crate::link::Link;
use crate::mirror::has_mirrors;
use crate::path::{Nee, Setting, Walker};
use crate::rig::Rig;
use crate::shown::Shown;
use crate::strata::Bending;
use crate::world::World;

/// By pixel, responses as [`Layout`](crate::response::Layout) says.
pub type Glints = BTreeMap<usize, Vec<f64>>;

/// Places all over a lens through which a glint is looked for: the disc that it is blurred to is made of so many points.
const LENS_PLACES: usize = 1 << 14;
/// Of them, those of a tile.
const TILE: usize = 512;
/// The golden ratio's part behind the point: turns between neighbours of an even spiral.
const GOLDEN_TURNS: f64 = 0.618_033_988_749_894_9;

/// The glints of every channel; empty where walls bend no light or where they are excluded.
///
/// Error: there are too many ways to follow.
pub fn glints(rig: &Rig, shown: &Shown, ctx: Ctx<'_>) -> Result<Vec<Glints>, Error> {
    let eyes = eyes(&rig.camera);
    let tiles = eyes.len().div_ceil(TILE);
    let channels = rig.worlds.len();
    let planes = |world: &World| matches!(Bending::of(world), Bending::AtPlanes(_)) || has_mirrors(world);
    if rig.excludes_specular || !rig.worlds.iter().any(planes) {
        return Ok(vec![Glints::new(); channels]);
    }
    let parts = ctx.map_tiles(channels * tiles, |i| {
        let (channel, tile) = (i / tiles, i % tiles);
        let setting = Setting {
            world: &rig.worlds[channel],
            camera: &rig.camera,
            light: &rig.lights[channel],
            steady: &rig.steady[channel],
            carriers: &shown.carriers,
            pictures: &shown.pictures,
            // Nothing is drawn.
            key: [0; 2],
            channel: channel as u32,
            nee: Nee::Line,
            shared: None,
        };
        let mut walker = Walker::new(setting, named(ctx.simd()));
        let mut glints = Glints::new();
        for &eye in &eyes[tile * TILE..eyes.len().min((tile + 1) * TILE)] {
            walker.add_glints(eye, 1.0 / eyes.len() as f64, &mut glints)?;
        }
        Ok::<_, Error>(glints)
    })?;
    let mut all = vec![Glints::new(); channels];
    for (i, part) in parts.into_iter().enumerate() {
        for (pixel, responses) in part? {
            let width = responses.len();
            let sum = all[i / tiles].entry(pixel).or_insert_with(|| vec![0.0; width]);
            sum.iter_mut().zip(responses).for_each(|(sum, response)| *sum += response);
        }
    }
    Ok(all)
}

/// Where light that the camera sees goes through: its pinhole, or places evenly over its lens.
fn eyes(camera: &Camera) -> Vec<DVec3> {
    let view = &camera.view;
    let Lens::Thin { radius, .. } = view.lens else { return vec![view.position] };
    let place = |i: usize| {
        let i = i as f64;
        let turns = i * GOLDEN_TURNS;
        let (sin, cos) = sin_cos_turns(turns - turns.floor());
        let off = radius * ((i + 0.5) / LENS_PLACES as f64).sqrt();
        view.position + off * (cos * view.right + sin * view.top)
    };
    (0..LENS_PLACES).map(place).collect()
}

impl Walker<'_> {
    /// Adds the glints that come through `eye`, times `share`.
    fn add_glints(&mut self, eye: DVec3, share: f64, glints: &mut Glints) -> Result<(), Error> {
        for source in self.sources() {
            if self.setting.camera.view.lens == Lens::Orthographic {
                self.add_parallel(source, glints)?;
                continue;
            }
            for link in self.ways_by_planes(source, eye)? {
                let Some((pixel, gain)) = self.setting.camera.image_of(eye, link.towards) else { continue };
                let radiance = share * gain * link.irradiance * libm::exp(-link.tau);
                self.add_glint(glints, pixel, radiance, link.on_plane, source);
            }
        }
        Ok(())
    }

    /// Every lit way from a source to `r` that smooth planes turn.
    fn ways_by_planes(&mut self, source: Source<'_>, r: DVec3) -> Result<Vec<Link>, Error> {
        let mut ways = self.ways_through_planes(source, r)?;
        self.by_one_mirror(source, r, None, &mut ways);
        Ok(ways)
    }

    /// Rays that reach the camera are parallel: backwards, they are a beam that falls on the light.
    fn add_parallel(&mut self, source: Source<'_>, glints: &mut Glints) -> Result<(), Error> {
        let camera = self.setting.camera;
        let (at, None) = source.origin() else { return Ok(()) };
        // All over the image and beyond.
        let (center, along) = (camera.view.position, camera.view.forward);
        let beam = Lamp::Beam { center, along, radius: f64::INFINITY, irradiance: 1.0 };
        for link in self.ways_by_planes(Source::Lamp(0, &beam), at)? {
            // Behind the last plane the light goes where the beam came from.
            let Some((pixel, area)) = camera.seen_along_axis(link.on_plane) else { continue };
            let Some(arrival) = source.arrival(at + link.towards) else { continue };
            let intensity = arrival.irradiance * arrival.distance * arrival.distance;
            let radiance = intensity * link.irradiance * libm::exp(-link.tau) / area;
            self.add_glint(glints, pixel, radiance, arrival.on_plane, source);
        }
        Ok(())
    }

    fn add_glint(&mut self, glints: &mut Glints, pixel: usize, radiance: f64, on_plane: DVec3, source: Source<'_>) {
        self.clear_responses(1);
        self.add(0, radiance, on_plane, source);
        let sum = glints.entry(pixel).or_insert_with(|| vec![0.0; self.responses.len()]);
        sum.iter_mut().zip(&self.responses).for_each(|(sum, response)| *sum += response);
    }
}
