//! The way of the paper: the pattern is wrapped as a texture on the wall of a white tube, lamps along its axis light it, the camera's
//! picture of it is the pattern. (Crowley and Gordon, Biomed. Opt. Express 14, 2523 (2023).)
//!
//! Where they render it by path tracing, here the light is found without noise: the direct light of the lamps and all
//! inter-reflections, ring by ring, because tube, lamps and texture are round about one axis.

use turbid_contract::{Ctx, Error};
use turbid_optics::elementary::sin_cos_turns;
use turbid_optics::view::View;

use crate::wall::{Met, Wall};

/// A bore of which only rings are told apart.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tunnel {
    /// mm.
    pub radius: f64,
    pub length: f64,
    pub rings: usize,
}

impl Tunnel {
    /// Depth of a ring's middle, mm.
    pub fn depth(&self, ring: usize) -> f64 {
        (ring as f64 + 0.5) * self.length / self.rings as f64
    }

    /// Irradiance of the rings by `lamps` equal lamps in the middles of equal parts of the axis, each of intensity 1 / lamps.
    pub fn direct(&self, lamps: u32) -> Vec<f64> {
        let square = self.radius * self.radius;
        let lamp = |k: u32| (f64::from(k) + 0.5) * self.length / f64::from(lamps);
        let at = |ring: usize| {
            let part = |k: u32| {
                let d = square + (self.depth(ring) - lamp(k)).powi(2);
                self.radius / (d * d.sqrt())
            };
            (0..lamps).map(part).sum::<f64>() / f64::from(lamps)
        };
        (0..self.rings).map(at).collect()
    }

    /// Radiosity of rings of these albedos under this irradiance: B = albedo (E + sum F B), by iteration until it changes by less than
    /// 1e-9 of its mean. What leaves through the ends is lost.
    pub fn radiosity(&self, albedo: &[f64], direct: &[f64]) -> Vec<f64> {
        // Share of a ring's light that reaches the ring so many places away: it depends on the distance alone.
        let step = self.length / self.rings as f64 / (2.0 * self.radius);
        let edge = |k: f64| arrived((k * step).abs());
        let mut shares: Vec<f64> = (0..self.rings).map(|k| edge(k as f64 + 0.5) - edge(k as f64 - 0.5)).collect();
        shares[0] = 2.0 * (edge(0.5) - arrived(0.0));
        let mut b: Vec<f64> = albedo.iter().zip(direct).map(|(rho, e)| rho * e).collect();
        loop {
            let mut change = 0.0;
            let mut next = Vec::with_capacity(b.len());
            for ring in 0..b.len() {
                let before = b[..ring].iter().rev().zip(&shares[1..]).map(|(b, f)| b * f).sum::<f64>();
                let behind = b[ring..].iter().zip(&shares).map(|(b, f)| b * f).sum::<f64>();
                let new = albedo[ring] * (direct[ring] + before + behind);
                change += (new - b[ring]).abs();
                next.push(new);
            }
            b = next;
            if change <= 1e-9 * b.iter().sum::<f64>() {
                return b;
            }
        }
    }
}

/// Share of the light of a ring that falls on the wall between it and the distance 2 R x on one side:
/// x - sqrt(x^2 + 1) + 1 / (2 sqrt(x^2 + 1)) and a constant. (Siegel and Howell, Thermal Radiation Heat Transfer, configuration
/// factors between rings of a cylinder.)
fn arrived(x: f64) -> f64 {
    let root = (x * x + 1.0).sqrt();
    // x - root without loss for large x.
    0.5 / root - 1.0 / (x + root)
}

/// What a picture of the wall needs.
pub struct Picture<'a> {
    pub camera: &'a View,
    pub columns: usize,
    pub rows: usize,
    pub wall: &'a Wall<'a>,
    pub tunnel: Tunnel,
    /// Rays per side of a pixel.
    pub side: u32,
}

impl Picture<'_> {
    /// The camera's picture of each texture (1 + cos(2 pi (f s + turns))) / 2, stretched so that the wall in all of them spans 0 to 1;
    /// what is not wall is 0. Empty where the camera does not see the wall.
    pub fn take(&self, textures: &[(f64, f64)], lamps: u32, ctx: Ctx<'_>) -> Result<Vec<Vec<f32>>, Error> {
        let tunnel = &self.tunnel;
        let direct = tunnel.direct(lamps);
        let glow = ctx.map_tiles(textures.len(), |i| {
            let (f, turns) = textures[i];
            let albedo: Vec<f64> =
                (0..tunnel.rings).map(|k| 0.5 + 0.5 * sin_cos_turns(f * tunnel.depth(k) + turns).1).collect();
            tunnel.radiosity(&albedo, &direct)
        })?;
        let lines = ctx.map_tiles(self.rows, |row| {
            (0..self.columns).map(|column| self.pixel(row, column, &glow)).collect::<Vec<_>>()
        })?;
        let pixels: Vec<Option<Vec<f64>>> = lines.into_iter().flatten().collect();
        let values = || pixels.iter().flatten().flatten().copied();
        let (least, most) = (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max));
        if most <= least {
            return Ok(Vec::new());
        }
        let stretched = |value: f64| ((value - least) / (most - least)) as f32;
        let layer = |i: usize| pixels.iter().map(|p| p.as_ref().map_or(0.0, |values| stretched(values[i]))).collect();
        Ok((0..textures.len()).map(layer).collect())
    }

    /// Mean radiosity over the rays that meet the wall, for each texture.
    fn pixel(&self, row: usize, column: usize, glow: &[Vec<f64>]) -> Option<Vec<f64>> {
        let mut sums = vec![0.0; glow.len()];
        let mut met = 0.0;
        for (i, j) in (0..self.side).flat_map(|i| (0..self.side).map(move |j| (i, j))) {
            let [x, y] = [j, i].map(|k| (f64::from(k) + 0.5) / f64::from(self.side));
            let (origin, w) =
                self.camera.ray((column as f64 + x) / self.columns as f64, (row as f64 + y) / self.rows as f64);
            let Some(Met { s, .. }) = self.wall.meet(origin, w) else { continue };
            met += 1.0;
            let place =
                (s / self.tunnel.length * self.tunnel.rings as f64 - 0.5).clamp(0.0, self.tunnel.rings as f64 - 1.0);
            let (first, part) = (place as usize, place - place.floor());
            let next = (first + 1).min(self.tunnel.rings - 1);
            for (sum, b) in sums.iter_mut().zip(glow) {
                *sum += b[first] + part * (b[next] - b[first]);
            }
        }
        (met > 0.0).then(|| sums.iter().map(|s| s / met).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Far from the ends of a long tube of one albedo in even light B = albedo E / (1 - albedo); the light comes from within some 20 radii
    /// (shares fall like (2 R / z)^4), so that 80 radii see no end to 1e-4.
    #[test]
    fn an_even_tube_glows_evenly() {
        let tunnel = Tunnel { radius: 10.0, length: 1600.0, rings: 800 };
        for albedo in [0.0, 0.3, 0.5] {
            let b = tunnel.radiosity(&vec![albedo; 800], &vec![2.0; 800]);
            let expected = 2.0 * albedo / (1.0 - albedo);
            assert!((b[400] - expected).abs() <= 1e-4 * expected, "{albedo}: {} {expected}", b[400]);
        }
    }

    /// White walls lose light through the ends only: the flux of the lamps that falls on the wall leaves through the two mouths. The share
    /// of a ring's light that leaves through the mouth at the distance 2 R x is that which no ring beyond it would get.
    #[test]
    fn white_walls_keep_the_power() {
        let tunnel = Tunnel { radius: 10.0, length: 120.0, rings: 600 };
        let direct = tunnel.direct(40);
        let b = tunnel.radiosity(&vec![1.0; 600], &direct);
        let leaves = |k: usize| {
            let share = |z: f64| arrived(1e9) - arrived(z / 20.0);
            share(tunnel.depth(k)) + share(tunnel.length - tunnel.depth(k))
        };
        let (out, into): (f64, f64) = ((0..600).map(|k| b[k] * leaves(k)).sum(), direct.iter().sum());
        // Rings of a fiftieth of the diameter exchange by the kernel at their middles: second order in the width.
        assert!((out / into - 1.0).abs() < 1e-4, "{out} {into}");
    }

    /// In the middle of a long row of lamps the irradiance is that of an even line, 2 intensity / (spacing R).
    #[test]
    fn a_row_of_lamps_is_a_line() {
        let tunnel = Tunnel { radius: 10.0, length: 1000.0, rings: 500 };
        let (lamps, spacing) = (400, 2.5);
        let expected = 2.0 / f64::from(lamps) / spacing / 10.0;
        // The ends at 50 radii lack 1 / (2 50^2) of it, the lamps a quarter of a radius apart leave no ripple.
        assert!((tunnel.direct(lamps)[250] / expected - 1.0).abs() < 4e-4);
    }
}
