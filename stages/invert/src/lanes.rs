//! `method: table` without sections, many pixels at a time: all but the look into the table in vector lanes. Bit for bit what [`Pass::run`] makes of
//! [`Inverter::solve`].

use std::ops::Range;

use fearless_simd::{Level, Simd, dispatch};
use turbid_contract::payload::MaskReason;

use crate::cells::Eight;
use crate::forward::Bend;
use crate::pair::{Inverter, relative, spread};
use crate::pass::{COLUMNS, Pass, Settled, Solved, Sums, Tally, settle};
use crate::profile::Correction;
use crate::single::exp;

/// Pixels at a time: all that is between stays in the first-level cache.
const CHUNK: usize = 64;

type Column = [f64; CHUNK];
type Single = [f32; CHUNK];

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

/// What is between the steps, a column for each number. (Loops over numbers of two sizes are hardly ever turned into lanes: each step keeps to one.)
struct Scratch {
    /// Not 0 where a pixel was masked before, and where a chunk ends early.
    masked: Single,
    r: [Single; 2],
    cell: [u32; CHUNK],
    along: [Single; 2],
    corners: [Eight; CHUNK],
    p: [Single; 2],
    /// What the shape adds to p.
    shift: Column,
    noise: Between,
    /// mu_a, mu_s', their standard errors and covariances aa, as, ss, as images hold them.
    planes: [Single; 7],
    /// 1 for the pixels that `planes` hold; what becomes of the others is for [`Inverter::solve`] to say.
    kept: Single,
}

/// What only pixels with known noise need.
struct Between {
    slope: [Single; 4],
    bend: [Single; 6],
    of_cell: [Eight; CHUNK],
    /// Standard error, covariance, standard error of R.
    given: [Single; 3],
    /// Relative variances of the table.
    variances: [Column; 2],
    wide: [Column; 17],
    values: [Column; 7],
    /// For [`Sums`].
    summed: [Column; 6],
}

impl Lanes<'_> {
    /// As [`Pass::run`].
    pub fn run(&self, pass: &Pass, mask: Option<&[f32]>, pixels: Range<usize>, planes: &mut [&mut [f32]]) -> Tally {
        dispatch!(self.level, simd => simd.vectorize(#[inline(always)] || match self.noise {
            Some(noise) => self.tile::<true>(pass, mask, pixels, planes, Some(noise)),
            None => self.tile::<false>(pass, mask, pixels, planes, None),
        }))
    }

    #[inline(always)]
    fn tile<const NOISE: bool>(
        &self,
        pass: &Pass,
        mask: Option<&[f32]>,
        pixels: Range<usize>,
        planes: &mut [&mut [f32]],
        noise: Option<Noise<'_>>,
    ) -> Tally {
        let mut tally = Tally::default();
        let mut scratch = Scratch::default();
        let mut start = pixels.start;
        while start < pixels.end {
            let chunk = start..(start + CHUNK).min(pixels.end);
            scratch.read(mask, self.r, noise, chunk.clone());
            self.place(&mut scratch);
            self.look_up::<NOISE>(&mut scratch);
            if let Some(correction) = self.correction {
                (scratch.shift.iter_mut().zip(chunk.clone())).for_each(|(x, i)| *x = correction.ln_stretch(i));
            }
            if NOISE {
                self.settle(pass.corrects, &mut scratch)
            } else {
                scratch.values(self.correction.is_some())
            }
            self.write::<NOISE>(pass, chunk.clone(), chunk.start - pixels.start, &scratch, planes, &mut tally);
            start = chunk.end;
        }
        tally
    }

    #[inline(always)]
    fn place(&self, scratch: &mut Scratch) {
        let cells = self.inverter.table.cells();
        let Scratch { r, cell, along, .. } = scratch;
        for o in 0..CHUNK {
            let place = cells.place([r[0][o], r[1][o]]);
            (cell[o], along[0][o], along[1][o]) = (place.cell, place.along[0], place.along[1]);
        }
    }

    #[inline(always)]
    fn look_up<const NOISE: bool>(&self, scratch: &mut Scratch) {
        let table = self.inverter.table;
        let cells = table.cells();
        let Scratch { cell, along, corners, p, noise, kept, masked, .. } = scratch;
        // The only step that goes pixel by pixel.
        for o in 0..CHUNK {
            corners[o] = *cells.corners(cell[o]);
            if NOISE {
                noise.of_cell[o] = *table.bend(cell[o]);
            }
        }
        for o in 0..CHUNK {
            let patch = cells.between(&corners[o], [along[0][o], along[1][o]]);
            (p[0][o], p[1][o]) = (patch.p[0], patch.p[1]);
            if NOISE {
                (0..4).for_each(|k| noise.slope[k][o] = patch.slope[k / 2][k % 2]);
                (0..6).for_each(|k| noise.bend[k][o] = noise.of_cell[o].0[k]);
            }
            kept[o] = if cells.holds(patch.p) & (masked[o] == 0.0) { 1.0 } else { 0.0 };
        }
        if NOISE && self.inverter.errors.is_some() {
            let [low, high] = &mut noise.variances;
            for ((low, high), (&p_0, &p_1)) in low.iter_mut().zip(high).zip(p[0].iter().zip(&p[1])) {
                [*low, *high] = self.inverter.variances([p_0, p_1].map(f64::from));
            }
        }
    }

    /// Of a pixel that takes another way it makes numbers that nobody reads.
    #[inline(always)]
    fn settle(&self, corrects: bool, scratch: &mut Scratch) {
        let Scratch { r, p, shift, planes, kept, noise, .. } = scratch;
        let Between { slope, bend, given, variances, wide, values, summed, .. } = noise;
        let all = r.iter().chain(p.iter()).chain(slope.iter()).chain(bend.iter()).chain(given.iter());
        wide.iter_mut().zip(all).for_each(|(to, from)| widen(from, to));
        let [r_0, r_1, p_0, p_1, slopes @ .., se_0, between, se_1] = &*wide;
        let [s_0, s_1, s_2, s_3, b_0, b_1, b_2, b_3, b_4, b_5] = slopes;
        let table = self.inverter.table;
        for o in 0..CHUNK {
            let (r_0, r_1) = (r_0[o], r_1[o]);
            let c_r = relative([r_0, r_1], [se_0[o], se_1[o]], between[o]);
            let slope = [[s_0[o], s_1[o]], [s_2[o], s_3[o]]];
            let bend: Bend = [[b_0[o], b_1[o], b_2[o]], [b_3[o], b_4[o], b_5[o]]];
            let gain = table.gain([r_0, r_1], &slope);
            let spread = spread(&gain, &c_r, Some(bend), [variances[0][o], variances[1][o]]);
            let p = [p_0[o] + shift[o], p_1[o] + shift[o]];
            let Settled { mu, covariance, own, common, excess } = settle(p, &spread, corrects);
            (values[0][o], values[1][o]) = (mu[0], mu[1]);
            (values[2][o], values[3][o]) = (covariance[0].sqrt(), covariance[2].sqrt());
            (values[4][o], values[5][o], values[6][o]) = (covariance[0], covariance[1], covariance[2]);
            (summed[0][o], summed[1][o], summed[2][o], summed[3][o]) = (own[0], own[1], common[0], common[1]);
            (summed[4][o], summed[5][o]) = (excess, mu[0]);
        }
        if self.inverter.errors.is_some() {
            (2..4).for_each(|k| (0..CHUNK).for_each(|o| summed[k][o] = summed[k][o].sqrt()));
        }
        for (plane, value) in planes.iter_mut().zip(values) {
            (0..CHUNK).for_each(|o| plane[o] = value[o] as f32);
        }
        for o in 0..CHUNK {
            let known = (planes[2][o] < f32::INFINITY) & (planes[3][o] < f32::INFINITY);
            kept[o] = if known { kept[o] } else { 0.0 };
        }
    }

    #[inline(always)]
    fn write<const NOISE: bool>(
        &self,
        pass: &Pass,
        chunk: Range<usize>,
        first: usize,
        scratch: &Scratch,
        planes: &mut [&mut [f32]],
        tally: &mut Tally,
    ) {
        let Scratch { planes: made, kept, noise, .. } = scratch;
        let count = chunk.len();
        let filled = pass.value_planes();
        if kept.iter().map(|&k| u32::from(k == 1.0)).sum::<u32>() == CHUNK as u32 {
            for (plane, made) in planes.iter_mut().zip(&made[..filled]) {
                plane[first..first + CHUNK].copy_from_slice(made);
            }
            if NOISE {
                noise.add_to(&mut tally.sums);
            }
            tally.good += count as u64;
            return;
        }
        self.write_mixed(pass, chunk, first, scratch, planes, tally);
    }

    /// A chunk of which some pixels take another way, pixel by pixel.
    #[inline(never)]
    fn write_mixed(
        &self,
        pass: &Pass,
        chunk: Range<usize>,
        first: usize,
        scratch: &Scratch,
        planes: &mut [&mut [f32]],
        tally: &mut Tally,
    ) {
        let Scratch { planes: made, kept, masked, noise, .. } = scratch;
        let last = planes.len() - 1;
        for (k, i) in chunk.enumerate() {
            let o = first + k;
            if masked[k] != 0.0 {
                planes[last][o] = masked[k];
            } else if kept[k] == 0.0 {
                pass.write(o, self.alone(i), planes, tally);
            } else {
                planes.iter_mut().zip(&made[..pass.value_planes()]).for_each(|(plane, made)| plane[o] = made[k]);
                if self.noise.is_some() {
                    tally.sums.add(o, [0, 1, 2, 3, 4, 5].map(|q| noise.summed[q][k]));
                }
                tally.good += 1;
            }
        }
    }

    fn alone(&self, i: usize) -> Result<Solved, MaskReason> {
        let r = self.r.map(|r| f64::from(r[i]));
        let c_r = self.noise.map(|noise| {
            let se = noise.se.map(|se| f64::from(se[i]));
            relative(r, se, noise.covariance.map_or(0.0, |c| f64::from(c[i])))
        });
        let solved = self.inverter.solve(r, c_r)?;
        Ok(self.correction.map_or(solved, |correction| correction.stretched(i, solved)))
    }
}

impl Default for Scratch {
    fn default() -> Self {
        let noise = Between {
            slope: [[0.0; CHUNK]; 4],
            bend: [[0.0; CHUNK]; 6],
            of_cell: [Eight([0.0; 8]); CHUNK],
            given: [[0.0; CHUNK]; 3],
            variances: [[0.0; CHUNK]; 2],
            wide: [[0.0; CHUNK]; 17],
            values: [[0.0; CHUNK]; 7],
            summed: [[0.0; CHUNK]; 6],
        };
        Self {
            masked: [0.0; CHUNK],
            r: [[0.0; CHUNK]; 2],
            cell: [0; CHUNK],
            along: [[0.0; CHUNK]; 2],
            corners: [Eight([0.0; 8]); CHUNK],
            p: [[0.0; CHUNK]; 2],
            shift: [0.0; CHUNK],
            noise,
            planes: [[0.0; CHUNK]; 7],
            kept: [0.0; CHUNK],
        }
    }
}

impl Scratch {
    #[inline(always)]
    fn read(&mut self, mask: Option<&[f32]>, r: [&[f32]; 2], noise: Option<Noise<'_>>, chunk: Range<usize>) {
        let count = chunk.len();
        let fill = |column: &mut Single, from: &[f32]| column[..count].copy_from_slice(&from[chunk.clone()]);
        match mask {
            Some(mask) => fill(&mut self.masked, mask),
            None => self.masked[..count].fill(0.0),
        }
        self.masked[count..].fill(1.0);
        (0..2).for_each(|k| fill(&mut self.r[k], r[k]));
        if let Some(Noise { se, covariance }) = noise {
            fill(&mut self.noise.given[0], se[0]);
            fill(&mut self.noise.given[2], se[1]);
            if let Some(covariance) = covariance {
                fill(&mut self.noise.given[1], covariance);
            }
        }
    }

    /// Where nothing is known of noise.
    #[inline(always)]
    fn values(&mut self, shifted: bool) {
        let Self { p, shift, planes, .. } = self;
        for (plane, p) in planes.iter_mut().zip(p) {
            if shifted {
                (0..CHUNK).for_each(|o| p[o] = (f64::from(p[o]) + shift[o]) as f32);
            }
            (0..CHUNK).for_each(|o| plane[o] = exp(p[o]));
        }
    }
}

impl Between {
    /// In the order of [`Sums::add`].
    #[inline(always)]
    fn add_to(&self, sums: &mut Sums) {
        for (sum, values) in sums.columns.iter_mut().zip(&self.summed) {
            for values in values.as_chunks::<COLUMNS>().0 {
                (0..COLUMNS).for_each(|c| sum[c] += values[c]);
            }
        }
    }
}

#[inline(always)]
fn widen(from: &Single, to: &mut Column) {
    (0..CHUNK).for_each(|o| to[o] = f64::from(from[o]));
}
