//! Glints by several walls, some of them curved or tilted: light that is mirrored to and fro in a bore, or goes into a clear body and out again. Nobody
//! knows all of these ways, so they are found by chance, without bias, and have standard errors.

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
use crate::random::Dice;
use crate::rig::Rig;
use crate::shown::Shown;
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
pub struct Chanced {
    pub moments: Moments,
    pub trials: u32,
}

/// Whether there may be any.
pub fn by_several_walls(rig: &Rig) -> bool {
    let world = &rig.worlds[0];
    let sure = Bending::of(world) != Bending::AtWalls || Mirrors::of(world).once;
    !rig.excludes_specular && rig.shines() && !sure
}

/// The glints of every channel that are found by chance, in an image of `paths` paths per pixel; `None` where there are none.
pub fn by_chance(rig: &Rig, shown: &Shown, paths: u32, ctx: Ctx<'_>) -> Result<Vec<Option<Chanced>>, Error> {
    let (channels, pixels) = (rig.worlds.len(), rig.camera.pixels());
    if !by_several_walls(rig) {
        return Ok((0..channels).map(|_| None).collect());
    }
    let trials = u64::from(paths) * pixels as u64 / PATHS_A_TRIAL;
    let trials = trials.clamp(LEAST_TRIALS, MOST_TRIALS) as usize;
    let (eyes, key) = (eyes(&rig.camera), philox::key(ctx.seed() ^ SALT));
    let tiles = trials.div_ceil(TILE);
    let parts = ctx.map_tiles(channels * tiles, |i| {
        let (channel, tile) = (i / tiles, i % tiles);
        let mut walker = Walker::new(setting(rig, channel, &shown.carriers, &shown.pictures), named(ctx.simd()));
        let mut found: Vec<(usize, Vec<f64>)> = Vec::new();
        // What was begun is thrown away.
        let until = if ctx.cancelled() { 0 } else { trials.min((tile + 1) * TILE) };
        for trial in tile * TILE..until {
            for source in walker.sources() {
                let place = [trial, source.place(), channel, 0].map(|i| i as u32);
                let mut dice = Dice::of(philox::philox4x32(place, key));
                let [eye, ..] = dice.throw();
                let eye = eyes[((eye * eyes.len() as f64) as usize).min(eyes.len() - 1)];
                if let Some(seen) = walker.seen_by_chance(source, eye, &mut dice) {
                    let responses = walker.responses_to(seen.radiance, seen.on_plane, source);
                    found.push((seen.pixel, responses.to_vec()));
                }
            }
        }
        (found, walker.given_up())
    })?;
    let mut all: Vec<Chanced> = Vec::new();
    let mut given_up = 0;
    for (i, (found, ways)) in parts.into_iter().enumerate() {
        if i % tiles == 0 {
            all.push(Chanced { moments: Moments::new(pixels, shown.layout.width()), trials: trials as u32 });
        }
        let sums = &mut all[i / tiles].moments;
        found.iter().for_each(|(pixel, responses)| sums.add(*pixel, responses));
        given_up += ways;
    }
    if given_up > 0 {
        ctx.measure("glints given up", given_up as f64, "1");
        ctx.warn("some glints by several walls are too rare to be weighed, and are missing");
    }
    Ok(all.into_iter().map(Some).collect())
}

impl Walker<'_> {
    /// What one trial finds.
    fn seen_by_chance(&mut self, source: Source<'_>, eye: DVec3, dice: &mut Dice) -> Option<Seen> {
        let camera = self.setting.camera;
        if camera.view.lens != Lens::Orthographic {
            let shows = |link: &_| Seen::through(camera, eye, link).is_some();
            let link = self.glint_by_chance(source, eye, Beginning::Image, dice, shows)?;
            return Seen::through(camera, eye, &link);
        }
        let (at, None) = source.origin() else { return None };
        let beam = beam_of(camera);
        let shows = |link: &_| Seen::in_parallel(camera, source, at, link).is_some();
        let link = self.glint_by_chance(Source::Lamp(0, &beam), at, Beginning::Around(None), dice, shows)?;
        Seen::in_parallel(camera, source, at, &link)
    }
}
