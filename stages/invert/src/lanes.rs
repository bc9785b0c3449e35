//! `method: table` without sections, many pixels at a time: the logarithms, the exponentials and all that noise does to a pixel in vector
//! lanes, the look into the table pixel by pixel. Bit for bit what [`Pass::run`] makes of [`Inverter::solve`].

use std::ops::Range;

use fearless_simd::{Level, Simd, dispatch};
use turbid_contract::payload::MaskReason;
use turbid_optics::elementary::exp;

use crate::forward::Bend;
use crate::pair::{Inverter, spread};
use crate::pass::{Pass, Settled, Solved, Tally, settle};
use crate::profile::Correction;

/// Pixels at a time: all that is between stays in the first-level cache.
const CHUNK: usize = 64;

type Column = [f64; CHUNK];

/// One wavelength of an image.
pub struct Lanes<'a> {
    pub inverter: &'a Inverter<'a>,
    /// Of a shape without errors.
    pub correction: Option<&'a Correction>,
    pub r: [&'a [f32]; 2],
    pub noise: Option<Noise<'a>>,
    pub level: Level,
}

/// Standard errors of both reflectances, and their covariance where they have one.
#[derive(Clone, Copy)]
pub struct Noise<'a> {
    pub se: [&'a [f32]; 2],
    pub covariance: Option<&'a [f32]>,
}

/// Where a pixel's values come from.
#[derive(Clone, Copy, PartialEq)]
enum Way {
    Lanes,
    /// Not in the table: what becomes of it is for [`Inverter::solve`] to say.
    Alone,
    /// Masked before.
    Masked(f32),
}

/// What is between the steps, a column for each number.
struct Scratch {
    r: [Column; 2],
    /// (u, v), later p.
    at: [Column; 2],
    slope: [Column; 4],
    bend: [Column; 6],
    /// Relative variances of the table.
    variances: [Column; 2],
    /// Covariances of R: 00, 01, 11.
    noise: [Column; 3],
    /// mu_a, mu_s', their standard errors and covariances aa, as, ss; for the tally own variances, common errors, excess.
    values: [Column; 12],
    /// The first of `values`, as images hold them. (Loops over numbers of two sizes are hardly ever turned into lanes.)
    planes: [[f32; CHUNK]; 7],
    ways: [Way; CHUNK],
}

impl Lanes<'_> {
    /// As [`Pass::run`].
    pub fn run(&self, pass: &Pass, mask: Option<&[f32]>, pixels: Range<usize>, planes: &mut [&mut [f32]]) -> Tally {
        let mut tally = Tally::default();
        let mut scratch = Scratch {
            r: [[0.0; CHUNK]; 2],
            at: [[0.0; CHUNK]; 2],
            slope: [[0.0; CHUNK]; 4],
            bend: [[0.0; CHUNK]; 6],
            variances: [[0.0; CHUNK]; 2],
            noise: [[0.0; CHUNK]; 3],
            values: [[0.0; CHUNK]; 12],
            planes: [[0.0; CHUNK]; 7],
            ways: [Way::Alone; CHUNK],
        };
        let mut start = pixels.start;
        while start < pixels.end {
            let chunk = start..(start + CHUNK).min(pixels.end);
            self.read(chunk.clone(), &mut scratch);
            self.inverter.table.places(self.level, &scratch.r, &mut scratch.at);
            let carried = mask.map(|m| &m[chunk.clone()]);
            match self.noise {
                Some(_) => self.look_up::<true>(carried, chunk.clone(), &mut scratch),
                None => self.look_up::<false>(carried, chunk.clone(), &mut scratch),
            }
            dispatch!(self.level, simd => simd.vectorize(#[inline(always)] || self.settle(pass.corrects, &mut scratch)));
            self.write(pass, chunk.clone(), chunk.start - pixels.start, &scratch, planes, &mut tally);
            start = chunk.end;
        }
        tally
    }

    fn read(&self, chunk: Range<usize>, scratch: &mut Scratch) {
        let fill = |column: &mut Column, from: &[f32]| {
            column.iter_mut().zip(&from[chunk.clone()]).for_each(|(x, &y)| *x = f64::from(y));
        };
        (0..2).for_each(|k| fill(&mut scratch.r[k], self.r[k]));
        if let Some(noise) = &self.noise {
            fill(&mut scratch.noise[0], noise.se[0]);
            fill(&mut scratch.noise[2], noise.se[1]);
            if let Some(covariance) = noise.covariance {
                fill(&mut scratch.noise[1], covariance);
            }
        }
    }

    fn look_up<const NOISE: bool>(&self, mask: Option<&[f32]>, chunk: Range<usize>, scratch: &mut Scratch) {
        let table = self.inverter.table;
        for (o, i) in chunk.enumerate() {
            let carried = mask.map_or(0.0, |m| m[o]);
            if carried != 0.0 {
                scratch.ways[o] = Way::Masked(carried);
                continue;
            }
            scratch.ways[o] = Way::Alone;
            let Ok(patch) = table.patch([scratch.at[0][o], scratch.at[1][o]]) else { continue };
            if !table.holds(patch.p) {
                continue;
            }
            scratch.ways[o] = Way::Lanes;
            let shift = self.correction.map_or(0.0, |correction| correction.ln_stretch(i));
            (scratch.at[0][o], scratch.at[1][o]) = (patch.p[0] + shift, patch.p[1] + shift);
            if NOISE {
                let bend = table.bend(&patch);
                (0..4).for_each(|k| scratch.slope[k][o] = patch.slope[k / 2][k % 2]);
                (0..6).for_each(|k| scratch.bend[k][o] = bend[k / 3][k % 3]);
                if self.inverter.errors.is_some() {
                    [scratch.variances[0][o], scratch.variances[1][o]] = self.inverter.variances(patch.p);
                }
            }
        }
    }

    /// Of a pixel that takes another way it makes numbers that nobody reads.
    #[inline(always)]
    fn settle(&self, corrects: bool, scratch: &mut Scratch) {
        let Scratch { r, at, slope, bend, variances, noise, values, planes, .. } = scratch;
        let table = self.inverter.table;
        if self.noise.is_none() {
            for o in 0..CHUNK {
                (planes[0][o], planes[1][o]) = (exp(at[0][o]) as f32, exp(at[1][o]) as f32);
            }
            return;
        }
        for o in 0..CHUNK {
            let (r_0, r_1) = (r[0][o], r[1][o]);
            let between = noise[1][o] / (r_0 * r_1);
            let c_r = [
                [noise[0][o] * noise[0][o] / (r_0 * r_0), between],
                [between, noise[2][o] * noise[2][o] / (r_1 * r_1)],
            ];
            let slope = [[slope[0][o], slope[1][o]], [slope[2][o], slope[3][o]]];
            let bend: Bend = [[bend[0][o], bend[1][o], bend[2][o]], [bend[3][o], bend[4][o], bend[5][o]]];
            let gain = table.gain_of([r_0, r_1], &slope);
            let spread = spread(&gain, &c_r, Some(bend), [variances[0][o], variances[1][o]]);
            let Settled { mu, covariance, own, common, excess } = settle([at[0][o], at[1][o]], &spread, corrects);
            (values[0][o], values[1][o]) = (mu[0], mu[1]);
            (values[2][o], values[3][o]) = (covariance[0].sqrt(), covariance[2].sqrt());
            (values[4][o], values[5][o], values[6][o]) = (covariance[0], covariance[1], covariance[2]);
            (values[7][o], values[8][o]) = (own[0], own[1]);
            (values[9][o], values[10][o]) = (common[0], common[1]);
            values[11][o] = excess;
        }
        for (plane, value) in planes.iter_mut().zip(values) {
            (0..CHUNK).for_each(|o| plane[o] = value[o] as f32);
        }
    }

    fn write(
        &self,
        pass: &Pass,
        chunk: Range<usize>,
        first: usize,
        scratch: &Scratch,
        planes: &mut [&mut [f32]],
        tally: &mut Tally,
    ) {
        let Scratch { planes: made, values, ways, .. } = scratch;
        let count = chunk.len();
        let filled = pass.value_planes();
        let known = |k: usize| self.noise.is_none() || made[2][k].is_finite() && made[3][k].is_finite();
        if (0..count).all(|k| ways[k] == Way::Lanes && known(k)) {
            for (plane, made) in planes.iter_mut().zip(&made[..filled]) {
                plane[first..first + count].copy_from_slice(&made[..count]);
            }
            (0..count).for_each(|k| self.count(k, values, tally));
            return;
        }
        let last = planes.len() - 1;
        for (k, i) in chunk.enumerate() {
            let o = first + k;
            match ways[k] {
                Way::Masked(reason) => planes[last][o] = reason,
                Way::Alone => pass.write(o, self.alone(i), planes, tally),
                Way::Lanes if known(k) => {
                    planes.iter_mut().zip(&made[..filled]).for_each(|(plane, made)| plane[o] = made[k]);
                    self.count(k, values, tally);
                }
                Way::Lanes => planes[last][o] = MaskReason::NotFinite.code(),
            }
        }
    }

    #[inline]
    fn count(&self, k: usize, values: &[Column; 12], tally: &mut Tally) {
        if self.noise.is_some() {
            let at = |column: usize| values[column][k];
            tally.add_noise(at(0), [at(7), at(8)], [at(9), at(10)], at(11));
        }
        tally.good += 1;
    }

    fn alone(&self, i: usize) -> Result<Solved, MaskReason> {
        let r = self.r.map(|r| f64::from(r[i]));
        let c_r = self.noise.map(|noise| {
            let se = noise.se.map(|se| f64::from(se[i]));
            let between = noise.covariance.map_or(0.0, |c| f64::from(c[i])) / (r[0] * r[1]);
            [[se[0] * se[0] / (r[0] * r[0]), between], [between, se[1] * se[1] / (r[1] * r[1])]]
        });
        let solved = self.inverter.solve(r, c_r)?;
        Ok(self.correction.map_or(solved, |correction| correction.stretched(i, solved)))
    }
}
