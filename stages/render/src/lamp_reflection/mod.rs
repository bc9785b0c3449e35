//! Lamp reflections: light that comes from a lamp to the camera by smooth interfaces alone. A lamp reflection is a point of the image, which no path can hit: it is
//! computed once, without noise, and added.
//!
//! `docs/theory/render.md` derives the radiance of its pixel.

mod field;
mod manifold_sampling;
mod stack;

use std::collections::BTreeMap;

use glam::DVec3;
use turbid_contract::{Ctx, Error};
use turbid_optics::elementary::sin_cos_turns;
use turbid_optics::view::Lens;

pub use field::WithLampReflections;
pub use manifold_sampling::{ManifoldSampled, by_manifold_sampling, by_several_interfaces};

use crate::camera::Camera;
use crate::connection::Connection;
use crate::lamp::{Lamp, Source};
use crate::level::named;
use crate::light::Carrier;
use crate::mirrors::has_mirrors;
use crate::projected::Projected;
use crate::projected_images::ProjectedImages;
use crate::rig::Rig;
use crate::setting::{Nee, Setting};
use crate::strata::Bending;
use crate::walker::Walker;
use crate::world::World;

/// By pixel, responses as [`Layout`](crate::response::Layout) says.
pub type LampReflections = BTreeMap<usize, Vec<f64>>;

/// Places all over a lens through which a lamp reflection is found: the disc that it is blurred to is made of so many points.
const LENS_PLACES: usize = 1 << 14;
/// Of them, those of a tile.
const TILE: usize = 512;
/// The golden ratio's part behind the point: turns between neighbours of an even spiral.
const GOLDEN_TURNS: f64 = 0.618_033_988_749_894_9;

/// The lamp reflections of every channel; empty where interfaces turn no light or where they are excluded.
///
/// Error: there are too many chains to follow, or light is in focus at the camera.
pub fn lamp_reflections(rig: &Rig, projected: &Projected, ctx: Ctx<'_>) -> Result<Vec<LampReflections>, Error> {
    let eyes = eyes(&rig.camera);
    let tiles = eyes.len().div_ceil(TILE);
    let channels = rig.worlds.len();
    if rig.excludes_specular || !rig.worlds.iter().any(turns_light) {
        return Ok(vec![LampReflections::new(); channels]);
    }
    let parts = ctx.map_tiles(channels * tiles, |i| {
        let (channel, tile) = (i / tiles, i % tiles);
        let mut walker =
            Walker::new(setting(rig, channel, &projected.carriers, &projected.projected_images), named(ctx.simd()));
        let mut lamp_reflections = LampReflections::new();
        for &eye in &eyes[tile * TILE..eyes.len().min((tile + 1) * TILE)] {
            walker.add_lamp_reflections(eye, 1.0 / eyes.len() as f64, &mut lamp_reflections)?;
        }
        Ok::<_, Error>(lamp_reflections)
    })?;
    let mut all = vec![LampReflections::new(); channels];
    for (i, part) in parts.into_iter().enumerate() {
        for (pixel, responses) in part? {
            let width = responses.len();
            let sum = all[i / tiles].entry(pixel).or_insert_with(|| vec![0.0; width]);
            sum.iter_mut().zip(responses).for_each(|(sum, response)| *sum += response);
        }
    }
    Ok(all)
}

/// Whether interfaces bring light to a focus at the camera, a pinhole, within the image: on the axis of round ones they do.
pub fn in_focus(rig: &Rig) -> bool {
    if Bending::of(&rig.worlds[0]) != Bending::AtInterfaces || rig.camera.has_aperture() {
        return false;
    }
    let projected_images = ProjectedImages::NONE;
    let mut walker = Walker::new(setting(rig, 0, &[], &projected_images), named(""));
    walker.add_lamp_reflections(rig.camera.view.position, 1.0, &mut LampReflections::new()).is_err()
}

/// Whether some of it comes to the camera by interfaces alone.
fn turns_light(world: &World) -> bool {
    matches!(Bending::of(world), Bending::AtPlanes(_) | Bending::AtInterfaces) || has_mirrors(world)
}

fn setting<'a>(
    rig: &'a Rig,
    channel: usize,
    carriers: &'a [Carrier],
    projected_images: &'a ProjectedImages,
) -> Setting<'a> {
    Setting {
        world: &rig.worlds[channel],
        camera: &rig.camera,
        light: &rig.lights[channel],
        steady: &rig.steady[channel],
        carriers,
        projected_images,
        // Nothing is drawn.
        key: [0; 2],
        channel: channel as u32,
        nee: Nee::Line,
        shared: None,
    }
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

/// Light that a pixel sees.
#[derive(Clone, Copy, Debug)]
struct Seen {
    pixel: usize,
    /// Mean over the pixel, at pattern value 1.
    radiance: f64,
    /// Where the light leaves the pattern's plane.
    on_plane: DVec3,
}

impl Seen {
    /// What comes to a place of the lens; `None` outside the image.
    fn through(camera: &Camera, eye: DVec3, connection: &Connection) -> Option<Self> {
        let (pixel, gain) = camera.image_of(eye, connection.towards)?;
        Some(Self {
            pixel,
            radiance: gain * connection.irradiance * libm::exp(-connection.tau),
            on_plane: connection.on_plane,
        })
    }

    /// What comes from a light at `at` to a camera whose rays are parallel: backwards, they are a beam that falls on the light, by that connection.
    fn in_parallel(camera: &Camera, source: Source<'_>, at: DVec3, connection: &Connection) -> Option<Self> {
        // Behind the last interface the light goes where the beam came from.
        let (pixel, area) = camera.seen_along_axis(connection.on_plane)?;
        let arrival = source.arrival(at + connection.towards)?;
        let intensity = arrival.irradiance * arrival.distance * arrival.distance;
        let radiance = intensity * connection.irradiance * libm::exp(-connection.tau) / area;
        Some(Self { pixel, radiance, on_plane: arrival.on_plane })
    }
}

/// Rays that reach a camera of parallel rays, backwards: all over the image and beyond.
fn beam_of(camera: &Camera) -> Lamp {
    let (center, along) = (camera.view.position, camera.view.forward);
    Lamp::Beam { center, along, radius: f64::INFINITY, irradiance: 1.0 }
}

impl Walker<'_> {
    /// Adds the lamp reflections that come through `eye`, times `weight`.
    fn add_lamp_reflections(
        &mut self,
        eye: DVec3,
        weight: f64,
        lamp_reflections: &mut LampReflections,
    ) -> Result<(), Error> {
        for source in self.sources() {
            for Seen { pixel, radiance, on_plane } in self.lamp_reflections_of(source, eye)? {
                if radiance == f64::INFINITY {
                    return Err(Error::failed_with_hint(
                        "walls bring the light of a lamp to a focus at the camera: its reflection is endlessly bright",
                        "move the camera or the light aside, or write `specular: exclude`",
                    ));
                }
                let responses = self.responses_to(weight * radiance, on_plane, source);
                let sum = lamp_reflections.entry(pixel).or_insert_with(|| vec![0.0; responses.len()]);
                sum.iter_mut().zip(responses).for_each(|(sum, response)| *sum += response);
            }
        }
        Ok(())
    }

    /// Those of a source that are known for sure.
    fn lamp_reflections_of(&mut self, source: Source<'_>, eye: DVec3) -> Result<Vec<Seen>, Error> {
        let camera = self.setting.camera;
        if camera.view.lens != Lens::Orthographic {
            let connections = self.chains_by_interfaces(source, eye)?;
            return Ok(connections.iter().filter_map(|connection| Seen::through(camera, eye, connection)).collect());
        }
        let (at, None) = source.origin() else { return Ok(Vec::new()) };
        let beam = beam_of(camera);
        let connections = self.chains_by_interfaces(Source::Lamp(0, &beam), at)?;
        Ok(connections.iter().filter_map(|connection| Seen::in_parallel(camera, source, at, connection)).collect())
    }

    /// Every lit connection from a source to `r` that smooth planes turn; or, where interfaces are curved or tilted, those by one reflection.
    fn chains_by_interfaces(&mut self, source: Source<'_>, r: DVec3) -> Result<Vec<Connection>, Error> {
        if self.bending == Bending::AtInterfaces {
            let mut known = Vec::new();
            self.by_one_reflection(source, (r, None), true, &mut known);
            return Ok(known.into_iter().map(|known| known.connection).filter(|connection| connection.lit).collect());
        }
        let mut connections = self.chains_through_planes(source, r)?;
        self.by_one_mirror(source, r, None, &mut connections);
        Ok(connections)
    }

    /// What a radiance at pattern value 1 means for all responses.
    fn responses_to(&mut self, radiance: f64, on_plane: DVec3, source: Source<'_>) -> &[f64] {
        self.clear_responses(1);
        self.add(0, radiance, on_plane, source);
        &self.responses
    }
}
