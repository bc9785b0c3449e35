//! Lamp reflections by several interfaces, some of them curved or tilted: light that is reflected to and fro in a bore, or goes into a clear body and out again. Nobody
//! knows all of these chains, so they are found by specular manifold sampling, without bias, and have standard errors.

use glam::DVec3;
use turbid_contract::{Ctx, Error};
use turbid_optics::philox;
use turbid_optics::view::Lens;

use super::{Seen, beam_of, eyes, setting};
use crate::caustic::Beginning;
use crate::lamp::Source;
use crate::level::named;
use crate::mirrors::Mirrors;
use crate::moments::Moments;
use crate::projected::Projected;
use crate::random::Dice;
use crate::rig::Rig;
use crate::strata::Bending;
use crate::walker::Walker;

/// A trial for so many paths of the image: they cost about as much as some of those.
const PATHS_A_TRIAL: u64 = 4;
const LEAST_TRIALS: u64 = 1 << 12;
const MOST_TRIALS: u64 = 1 << 26;
/// Trials of a tile.
const TILE: usize = 1 << 10;
/// Sets these random numbers apart from those of paths.
const SALT: u64 = 0x676c_696e_7473;

/// What trials have seen, pixel by pixel.
pub struct ManifoldSampled {
    pub moments: Moments,
    pub trials: u32,
}

/// Whether there may be any.
pub fn by_several_interfaces(rig: &Rig) -> bool {
    let world = &rig.worlds[0];
    let sure = Bending::of(world) != Bending::AtInterfaces || Mirrors::of(world).once;
    !rig.excludes_specular && rig.shines() && !sure
}

/// The lamp reflections of every channel that are found by manifold sampling, in an image of `paths` paths per pixel; `None` where there are none.
pub fn by_manifold_sampling(
    rig: &Rig,
    projected: &Projected,
    paths: u32,
    ctx: Ctx<'_>,
) -> Result<Vec<Option<ManifoldSampled>>, Error> {
    let (channels, pixels) = (rig.worlds.len(), rig.camera.pixels());
    if !by_several_interfaces(rig) {
        return Ok((0..channels).map(|_| None).collect());
    }
    let trials = u64::from(paths) * pixels as u64 / PATHS_A_TRIAL;
    let trials = trials.clamp(LEAST_TRIALS, MOST_TRIALS) as usize;
    let (eyes, key) = (eyes(&rig.camera), philox::key(ctx.seed() ^ SALT));
    let tiles = trials.div_ceil(TILE);
    let parts = ctx.map_tiles(channels * tiles, |i| {
        let (channel, tile) = (i / tiles, i % tiles);
        let mut walker =
            Walker::new(setting(rig, channel, &projected.carriers, &projected.projected_images), named(ctx.simd()));
        let mut found: Vec<(usize, Vec<f64>)> = Vec::new();
        // What was begun is thrown away.
        let until = if ctx.cancelled() { 0 } else { trials.min((tile + 1) * TILE) };
        for trial in tile * TILE..until {
            for source in walker.sources() {
                let place = [trial, source.place(), channel, 0].map(|i| i as u32);
                let mut dice = Dice::of(philox::philox4x32(place, key));
                let [eye, ..] = dice.throw();
                let eye = eyes[((eye * eyes.len() as f64) as usize).min(eyes.len() - 1)];
                if let Some(seen) = walker.seen_by_sampling(source, eye, &mut dice) {
                    let responses = walker.responses_to(seen.radiance, seen.on_plane, source);
                    found.push((seen.pixel, responses.to_vec()));
                }
            }
        }
        (found, walker.given_up())
    })?;
    let mut all: Vec<ManifoldSampled> = Vec::new();
    let mut given_up = 0;
    for (i, (found, connections)) in parts.into_iter().enumerate() {
        if i % tiles == 0 {
            all.push(ManifoldSampled {
                moments: Moments::new(pixels, projected.layout.width()),
                trials: trials as u32,
            });
        }
        let sums = &mut all[i / tiles].moments;
        found.iter().for_each(|(pixel, responses)| sums.add(*pixel, responses));
        given_up += connections;
    }
    if given_up > 0 {
        ctx.measure("glints given up", given_up as f64, "1");
        ctx.warn("some lamp reflections by several walls are too rare to be weighed, and are missing");
    }
    Ok(all.into_iter().map(Some).collect())
}

impl Walker<'_> {
    /// What one trial finds.
    fn seen_by_sampling(&mut self, source: Source<'_>, eye: DVec3, dice: &mut Dice) -> Option<Seen> {
        let camera = self.setting.camera;
        if camera.view.lens != Lens::Orthographic {
            let shows = |connection: &_| Seen::through(camera, eye, connection).is_some();
            let connection = self.sample_manifold_of_lamp_reflection(source, eye, Beginning::Image, dice, shows)?;
            return Seen::through(camera, eye, &connection);
        }
        let (at, None) = source.origin() else { return None };
        let beam = beam_of(camera);
        let shows = |connection: &_| Seen::in_parallel(camera, source, at, connection).is_some();
        let connection =
            self.sample_manifold_of_lamp_reflection(Source::Lamp(0, &beam), at, Beginning::Around(None), dice, shows)?;
        Seen::in_parallel(camera, source, at, &connection)
    }
}
