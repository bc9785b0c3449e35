//! The direct inverse: rays of every projector pixel to the surface, and the fringe's value where they arrive.

use turbid_contract::{Ctx, Error};
use turbid_optics::elementary::sin_cos_turns;

use crate::sample::Sample;
use crate::screen::Screen;
use crate::wall::{Met, Wall};

/// Pixels of a tile.
const TILE: usize = 1024;

/// Samples of all pixels, row by row; `None` where no ray of the pixel meets the surface.
///
/// `side` x `side` rays through the middles of equal parts of the pixel; those that miss the surface have no say.
pub fn trace(
    screen: &Screen,
    wall: &Wall<'_>,
    f_x: &[f64],
    side: u32,
    ctx: Ctx<'_>,
) -> Result<Vec<Option<Sample>>, Error> {
    let tiles = ctx.map_tiles(screen.pixels().div_ceil(TILE), |tile| {
        let pixels = tile * TILE..screen.pixels().min((tile + 1) * TILE);
        pixels.map(|pixel| sample(screen, wall, f_x, side, pixel)).collect::<Vec<_>>()
    })?;
    Ok(tiles.into_iter().flatten().collect())
}

fn sample(screen: &Screen, wall: &Wall<'_>, f_x: &[f64], side: u32, pixel: usize) -> Option<Sample> {
    let meet = |x: f64, y: f64| {
        let (origin, w) = screen.ray(pixel, x, y);
        wall.meet(origin, w).map(|met| (met, w))
    };
    let mut phasors = vec![(0.0, 0.0); f_x.len()];
    let (mut irradiance, mut nearest, mut met) = (0.0, None, 0.0);
    let (mut first_face, mut one_face) = (None, true);
    for (i, j) in (0..side).flat_map(|i| (0..side).map(move |j| (i, j))) {
        let [x, y] = [j, i].map(|k| (f64::from(k) + 0.5) / f64::from(side));
        let Some((Met { hit, face, s }, w)) = meet(x, y) else { continue };
        met += 1.0;
        one_face &= *first_face.get_or_insert(face) == face;
        irradiance += screen.intensity(w) * -hit.normal.dot(w) / (hit.t * hit.t);
        for (phasor, f) in phasors.iter_mut().zip(f_x) {
            let (sin, cos) = sin_cos_turns(f * s);
            *phasor = (phasor.0 + cos, phasor.1 + sin);
        }
        let off = (x - 0.5) * (x - 0.5) + (y - 0.5) * (y - 0.5);
        if nearest.is_none_or(|(least, _)| off < least) {
            nearest = Some((off, s));
        }
    }
    let (_, near) = nearest?;
    let at = |x: f64, y: f64| meet(x, y).map(|(met, _)| met.s);
    let middle = at(0.5, 0.5);
    let across = change(at(0.0, 0.5), middle, at(1.0, 0.5));
    let down = change(at(0.5, 0.0), middle, at(0.5, 1.0));
    phasors.iter_mut().for_each(|(cos, sin)| (*cos, *sin) = (*cos / met, *sin / met));
    let whole = one_face && met == f64::from(side * side);
    Some(Sample { s: middle.unwrap_or(near), phasors, slope: across.max(down), whole, irradiance: irradiance / met })
}

/// Change of the coordinate from one side of the pixel to the other; where an edge cuts the pixel, twice that of the half that is there.
fn change(low: Option<f64>, middle: Option<f64>, high: Option<f64>) -> f64 {
    match (low, middle, high) {
        (Some(a), _, Some(b)) => (b - a).abs(),
        (Some(a), Some(m), None) | (None, Some(m), Some(a)) => 2.0 * (m - a).abs(),
        _ => 0.0,
    }
}
