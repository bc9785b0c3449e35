//! The spatial frequency that a pattern reaches on the surfaces that it falls on, found by projecting its own pixels back.
//!
//! The phase of the shown fringe is read from the layers as a camera would read it, so that whatever is wrong with the pattern shows.

use std::f64::consts::TAU;

use glam::DVec3;
use turbid_contract::{Ctx, Error};
use turbid_geometry::Hit;
use turbid_optics::elementary::{atan2, sin_cos_turns};

use crate::screen::Screen;

/// What a fringe does at a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reached {
    /// Spatial frequency along the surface, mm^-1.
    pub f_surface: f64,
    /// Over the pixel, the larger of both sides.
    pub cycles: f64,
}

/// Re and Im of the fringe in layers of even phase steps, 2/N sum v_n exp(-i d_n) pixel by pixel.
pub fn fringe(layers: &[&[f32]]) -> Vec<(f64, f64)> {
    let n = layers.len() as f64;
    let steps: Vec<(f64, f64)> = (0..layers.len()).map(|k| sin_cos_turns(k as f64 / n)).collect();
    let pixel = |i: usize| {
        let (mut re, mut im) = (0.0, 0.0);
        for (layer, (sin, cos)) in layers.iter().zip(&steps) {
            re += f64::from(layer[i]) * cos;
            im -= f64::from(layer[i]) * sin;
        }
        (re * 2.0 / n, im * 2.0 / n)
    };
    (0..layers.first().map_or(0, |l| l.len())).map(pixel).collect()
}

/// Pixels of a tile.
const TILE: usize = 4096;

/// Where the light of each pixel's centre arrives; `None` where that does not count.
pub type Places = Vec<Option<Hit>>;

/// By `hit` of the pixel, on all threads.
pub fn places(screen: &Screen, hit: &(dyn Fn(usize) -> Option<Hit> + Sync), ctx: Ctx<'_>) -> Result<Places, Error> {
    tiled(screen, hit, ctx)
}

/// What the fringe reaches at each pixel; `None` where `places` or `fringe` is, or no neighbour along a side of the image has both.
///
/// With the change a, b of the phase over a pixel along the image's two sides and the way X_a, X_b of the lit point, the gradient q along
/// the surface has q . X_a = a, q . X_b = b. Both are differences between the same neighbours, so that the curvature of the mapping cancels;
/// what is left is chord for arc, 1 / 24 of the square of the angle by which the surface turns between them.
pub fn reached(
    screen: &Screen,
    places: &Places,
    fringe: &[Option<(f64, f64)>],
    ctx: Ctx<'_>,
) -> Result<Vec<Option<Reached>>, Error> {
    let shown = Shown { columns: screen.columns, rows: screen.rows, places, fringe };
    tiled(screen, &|pixel| shown.reached(pixel), ctx)
}

fn tiled<T: Send + Sync>(screen: &Screen, of: &(dyn Fn(usize) -> T + Sync), ctx: Ctx<'_>) -> Result<Vec<T>, Error> {
    let tiles = ctx.map_tiles(screen.pixels().div_ceil(TILE), |tile| {
        let pixels = tile * TILE..screen.pixels().min((tile + 1) * TILE);
        pixels.map(of).collect::<Vec<_>>()
    })?;
    Ok(tiles.into_iter().flatten().collect())
}

struct Shown<'a> {
    columns: usize,
    rows: usize,
    places: &'a Places,
    fringe: &'a [Option<(f64, f64)>],
}

/// From one pixel to the next: of the phase in turns, and of the lit point in mm.
#[derive(Clone, Copy)]
struct Change {
    turns: f64,
    way: DVec3,
}

impl Shown<'_> {
    fn reached(&self, pixel: usize) -> Option<Reached> {
        let (column, row) = (pixel % self.columns, pixel / self.columns);
        let across = self.change(|step| {
            let column = column.checked_add_signed(step).filter(|&c| c < self.columns)?;
            Some(row * self.columns + column)
        })?;
        let down = self.change(|step| {
            let row = row.checked_add_signed(step).filter(|&r| r < self.rows)?;
            Some(row * self.columns + column)
        })?;
        let (a, b) = (across.turns, down.turns);
        let (aa, ab, bb) = (across.way.dot(across.way), across.way.dot(down.way), down.way.dot(down.way));
        // |q|^2 = (a, b) G^-1 (a, b) with the metric G.
        let square = (a * a * bb - 2.0 * a * b * ab + b * b * aa) / (aa * bb - ab * ab);
        let f_surface = square.max(0.0).sqrt();
        f_surface.is_finite().then_some(Reached { f_surface, cycles: a.abs().max(b.abs()) })
    }

    /// Over the pixel `at(0)`: central where both neighbours have a fringe on the same part of the surface, else to second order from the two
    /// on one side, or to first order from one.
    fn change(&self, at: impl Fn(isize) -> Option<usize>) -> Option<Change> {
        let ahead = |sign: isize| {
            let first = self.between(at(0)?, at(sign)?)?;
            let second = at(2 * sign).and_then(|beyond| self.between(at(sign)?, beyond));
            Some(second.map_or(first, |second| first.times(1.5).plus(second.times(-0.5))))
        };
        let to = |step: isize| self.between(at(0)?, at(step)?);
        match (to(-1), to(1)) {
            (Some(back), Some(on)) => Some(on.times(0.5).plus(back.times(-0.5))),
            (None, Some(_)) => ahead(1),
            (Some(_), None) => ahead(-1).map(|back| back.times(-1.0)),
            (None, None) => None,
        }
    }

    /// `None` across an edge: another object, or a surface turned by more than 60 degrees.
    fn between(&self, from: usize, to: usize) -> Option<Change> {
        let (a, b) = (self.places[from].as_ref()?, self.places[to].as_ref()?);
        let smooth = a.walls.first().map(|w| w.0) == b.walls.first().map(|w| w.0) && a.normal.dot(b.normal) > 0.5;
        let turns = turns_between(self.fringe[from]?, self.fringe[to]?);
        smooth.then_some(Change { turns, way: b.r - a.r })
    }
}

impl Change {
    fn times(self, factor: f64) -> Self {
        Self { turns: factor * self.turns, way: factor * self.way }
    }

    fn plus(self, other: Self) -> Self {
        Self { turns: self.turns + other.turns, way: self.way + other.way }
    }
}

/// Phase of `z` less that of `from`, in turns, in [-1/2, 1/2].
fn turns_between(from: (f64, f64), z: (f64, f64)) -> f64 {
    atan2(z.1 * from.0 - z.0 * from.1, z.0 * from.0 + z.1 * from.1) / TAU
}
