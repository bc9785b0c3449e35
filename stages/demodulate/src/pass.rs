//! The fused pass: one sweep over the frames of a channel, chunk by chunk, that writes every plane of the results.

use std::borrow::Cow;
use std::ops::Range;

use fearless_simd::{Level, Simd, dispatch};
use turbid_contract::ndarray::Array2;
use turbid_contract::payload::MaskReason;
use turbid_contract::{Ctx, Error, ImageStack};

use crate::errors::{Elements, Phasors, Toward};
use crate::fused::{Planes, amplitudes, phases};
use crate::given::Noise;
use crate::level::named;
use crate::noise::Block;
use crate::params::{NoiseBias, Params};
use crate::robust::Noisy;
use crate::set::{Channel, Fringe};
use crate::signal::weak_in_row;
use crate::unknown;

mod describe;
mod tally;

pub use tally::{Tally, of};

/// Pixels that are worked on at a time: their f64 intermediates stay in the first-level cache.
const CHUNK: usize = 512;

/// What a chunk needs in f64, made once for each tile.
#[derive(Default)]
struct Scratch {
    /// (dc, re, im) of each fringe.
    linear: Vec<[Vec<f64>; 3]>,
    phasors: Vec<Phasors>,
    /// Of each block.
    elements: Vec<Elements>,
    out: Vec<f64>,
}

/// One fused pass over the frames of a channel. Planes in order: m_dc, m_ac of each fringe; where noise is known
/// their standard errors in the same order and the covariance of each pair; phase (and its standard error) of
/// each fringe with f_x > 0 if wanted; mask.
pub struct Pass<'a> {
    channel: &'a Channel,
    frames: Vec<Vec<Cow<'a, [f32]>>>,
    /// Blocks of fringes (a, b) with a <= b, row by row of the upper triangle.
    blocks: Option<Vec<Block<'a>>>,
    /// Pairs of the quantities m_dc (2 k) and m_ac (2 k + 1) of fringe k whose covariance is stored.
    pairs: Vec<[usize; 2]>,
    /// Of each fringe the pixels of whose frames some do not know their standard error; and whether the frames know that of their mean.
    unknown: Vec<Option<Vec<bool>>>,
    mean_known: Vec<bool>,
    /// Reasons that the frames bring along.
    carried: Option<Cow<'a, [f32]>>,
    low_signal: f64,
    /// A frame that reaches it is saturated.
    saturation: f32,
    corrects: bool,
    wants_phase: bool,
    level: Level,
}

impl<'a> Pass<'a> {
    pub fn new(
        channel: &'a Channel,
        noise: Option<&'a Noise<'_>>,
        stack: &'a ImageStack,
        params: &Params,
        wants_phase: bool,
        simd: &str,
    ) -> Self {
        let count = channel.fringes.len();
        let blocks = noise.map(|n| upper(count).map(|(a, b)| n.block(channel, a, b)).collect());
        let frames = channel.fringes.iter().map(|f| f.frames.iter().map(|&i| stack.layers[i].pixels()).collect());
        let infos = |f: &Fringe| f.frames.iter().map(|&i| &stack.layers[i].info).collect::<Vec<_>>();
        let unknown = |f: &Fringe| if noise.is_some() { unknown::of_layers(stack, infos(f)) } else { None };
        Self {
            channel,
            frames: frames.collect(),
            pairs: if noise.is_some() { channel.pairs() } else { Vec::new() },
            blocks,
            unknown: channel.fringes.iter().map(unknown).collect(),
            mean_known: channel.fringes.iter().map(|f| infos(f).iter().all(|i| i.mean_se.is_some())).collect(),
            carried: stack.mask(channel.wavelength_nm).map(|mask| mask.pixels()),
            low_signal: params.low_signal,
            saturation: params.saturation.map_or(f32::INFINITY, |level| level as f32),
            corrects: params.noise_bias == NoiseBias::Correct,
            wants_phase,
            level: named(simd),
        }
    }

    fn quantity_count(&self) -> usize {
        2 * self.channel.fringes.len()
    }

    fn phase_count(&self) -> usize {
        if self.wants_phase { self.channel.fringes.iter().filter(|f| f.f_x_per_mm > 0.0).count() } else { 0 }
    }

    pub fn plane_count(&self) -> usize {
        let layers_per_value = if self.blocks.is_some() { 2 } else { 1 };
        (self.quantity_count() + self.phase_count()) * layers_per_value + self.pairs.len() + 1
    }

    pub fn run(&self, pixels: Range<usize>, planes: &mut [&mut [f32]]) -> Tally {
        let mut tally = Tally::new(self.channel);
        let mut scratch = Scratch::default();
        let mut start = pixels.start;
        while start < pixels.end {
            let chunk = start..(start + CHUNK).min(pixels.end);
            let mut parts: Vec<&mut [f32]> =
                planes.iter_mut().map(|p| &mut p[chunk.start - pixels.start..chunk.end - pixels.start]).collect();
            if let Some(blocks) = &self.blocks {
                self.linear(chunk.clone(), &mut scratch.linear);
                self.values(&scratch.linear, &mut parts);
                self.errors(blocks, chunk.start, &mut scratch, &mut parts, &mut tally);
            } else {
                self.amplitudes(chunk.clone(), &mut parts);
            }
            self.mask(chunk.clone(), &mut parts, &mut tally);
            start = chunk.end;
        }
        tally
    }

    /// Without noise to propagate nothing but the amplitudes and phases has to be kept.
    fn amplitudes(&self, chunk: Range<usize>, planes: &mut [&mut [f32]]) {
        let (values, phases) = planes.split_at_mut(self.quantity_count());
        let mut phases = phases.iter_mut();
        for ((fringe, frames), out) in self.channel.fringes.iter().zip(&self.frames).zip(values.chunks_mut(2)) {
            let parts: Vec<&[f32]> = frames.iter().map(|f| &f[chunk.clone()]).collect();
            let [m_dc, m_ac] = out else { unreachable!("two planes for each fringe") };
            if fringe.f_x_per_mm == 0.0 {
                fringe.weights.mean_of(&parts, m_dc);
                m_ac.copy_from_slice(m_dc);
            } else {
                let phase: &mut [f32] = match self.wants_phase {
                    true => phases.next().expect("a plane for the phase of each fringe"),
                    false => &mut [],
                };
                amplitudes(self.level, &parts, &fringe.weights, Planes { m_dc, m_ac, phase });
            }
        }
    }

    fn linear(&self, chunk: Range<usize>, linear: &mut Vec<[Vec<f64>; 3]>) {
        linear.resize_with(self.frames.len(), || [const { Vec::new() }; 3]);
        for (k, (out, frames)) in linear.iter_mut().zip(&self.frames).enumerate() {
            let parts: Vec<&[f32]> = frames.iter().map(|f| &f[chunk.clone()]).collect();
            out.iter_mut().for_each(|v| v.resize(chunk.len(), 0.0));
            self.channel.fringes[k].weights.apply(&parts, out);
        }
    }

    fn values(&self, linear: &[[Vec<f64>; 3]], planes: &mut [&mut [f32]]) {
        let first = 2 * self.quantity_count() + self.pairs.len();
        let (values, others) = planes.split_at_mut(first);
        let mut planes = others.iter_mut();
        for ((out, [dc, re, im]), fringe) in values.chunks_mut(2).zip(linear).zip(&self.channel.fringes) {
            let [m_dc, m_ac] = out else { unreachable!("two planes for each fringe") };
            m_dc.iter_mut().zip(dc).for_each(|(out, dc)| *out = *dc as f32);
            if fringe.f_x_per_mm == 0.0 {
                m_ac.copy_from_slice(m_dc);
                continue;
            }
            m_ac.iter_mut().zip(re.iter().zip(im)).for_each(|(out, (re, im))| {
                *out = (re * re + im * im).sqrt() as f32;
            });
            if self.wants_phase {
                phases(self.level, re, im, planes.next().expect("a plane for the phase of each fringe"));
            }
        }
    }

    fn errors(
        &self,
        blocks: &[Block<'_>],
        first: usize,
        scratch: &mut Scratch,
        planes: &mut [&mut [f32]],
        tally: &mut Tally,
    ) {
        let (count, level) = (self.channel.fringes.len(), self.level);
        let Scratch { linear, phasors, elements, out } = scratch;
        let n = linear[0][0].len();
        let at = |a: usize, b: usize| a * count - a * (a + 1) / 2 + b;
        let fringed = |k: usize| self.channel.fringes[k].f_x_per_mm > 0.0;
        phasors.resize_with(count, Phasors::default);
        elements.resize_with(blocks.len(), Elements::default);
        out.resize(n, 0.0);
        for (k, [_, re, im]) in linear.iter().enumerate().filter(|&(k, _)| fringed(k)) {
            phasors[k].set(level, re, im);
        }
        for (a, b) in upper(count) {
            elements[at(a, b)].read(level, &blocks[at(a, b)], first, n, [fringed(a), fringed(b)]);
        }
        // At f_x = 0 both quantities are M_DC.
        let toward = |q: usize| if q % 2 == 1 && fringed(q / 2) { phasors[q / 2].along() } else { Toward::Mean };
        let (se, pairs) = (self.quantity_count(), 2 * self.quantity_count());
        let mut phase = pairs + self.pairs.len() + self.phase_count();
        for k in 0..count {
            let own = &elements[at(k, k)];
            if fringed(k) {
                own.variance(level, phasors[k].across(), out);
                if self.wants_phase {
                    let (se, m_ac, variance) = (&mut *planes[phase], &phasors[k].m_ac, &*out);
                    dispatch!(level, simd => simd.vectorize(#[inline(always)] || {
                        for ((se, variance), &m_ac) in se.iter_mut().zip(variance).zip(m_ac) {
                            *se = if m_ac > 0.0 { (variance.sqrt() / m_ac) as f32 } else { 0.0 };
                        }
                    }));
                    phase += 1;
                }
                self.correct(k, &phasors[k].m_ac, out, planes, tally);
            }
            for q in [2 * k, 2 * k + 1] {
                own.variance(level, toward(q), out);
                let (se, variance) = (&mut *planes[se + q], &*out);
                dispatch!(level, simd => simd.vectorize(#[inline(always)] || {
                    se.iter_mut().zip(variance).for_each(|(se, variance)| *se = variance.sqrt() as f32);
                }));
            }
        }
        for (p, &[a, b]) in self.pairs.iter().enumerate() {
            elements[at(a / 2, b / 2)].covariance(level, toward(a), toward(b), out);
            planes[pairs + p].iter_mut().zip(out.iter()).for_each(|(plane, covariance)| *plane = *covariance as f32);
        }
    }

    /// Takes the Rician bias off M_AC of fringe `k`, where it is to be taken off, and sums it up. `across` goes in as the variance across the
    /// phasor and is used up.
    fn correct(&self, k: usize, m_ac: &[f64], across: &mut [f64], planes: &mut [&mut [f32]], tally: &mut Tally) {
        let plane = &mut *planes[2 * k + 1];
        dispatch!(self.level, simd => simd.vectorize(#[inline(always)] || {
            for ((plane, &m_ac), bias) in plane.iter_mut().zip(m_ac).zip(across.iter_mut()) {
                let known = (m_ac > 0.0) & bias.is_finite();
                *bias = if known { *bias / (2.0 * m_ac) } else { UNKNOWN };
                *plane = if known & self.corrects { (m_ac - *bias) as f32 } else { *plane };
            }
        }));
        let [mut rician, mut sum] = [tally.rician[k], tally.m_ac[k]];
        for (&bias, &m_ac) in across.iter().zip(m_ac).filter(|(bias, _)| **bias != UNKNOWN) {
            (rician, sum) = (rician + bias, sum + m_ac);
        }
        (tally.rician[k], tally.m_ac[k]) = (rician, sum);
    }

    /// Finds the pixels that carry no measurement, and sets all their planes to 0.
    fn mask(&self, chunk: Range<usize>, planes: &mut [&mut [f32]], tally: &mut Tally) {
        let (mask, planes) = planes.split_last_mut().expect("the mask is the last plane");
        let n = mask.len();
        tally.pixels += n as u64;
        let mut flags = [0_u32; CHUNK];
        let flags = &mut flags[..n];
        self.flags(planes, flags);
        self.frame_flags(chunk.clone(), flags);
        if flags.iter().any(|flags| flags & LOW != 0) {
            self.judge_low(planes, flags);
        }
        for (mask, &flags) in mask.iter_mut().zip(flags.iter()) {
            *mask = reason(flags).code();
        }
        if let Some(carried) = &self.carried {
            let carried = carried[chunk].iter();
            mask.iter_mut().zip(carried).filter(|(_, c)| **c != 0.0).for_each(|(mask, &carried)| *mask = carried);
        }
        let good = mask.iter().filter(|&&m| m == 0.0).count();
        tally.good += good as u64;
        let uncertain = mask.iter().zip(flags.iter()).filter(|&(mask, flags)| *mask == 0.0 && flags & UNCERTAIN != 0);
        tally.uncertain += uncertain.count() as u64;
        if good < n {
            for (i, _) in mask.iter().enumerate().filter(|(_, m)| **m != 0.0) {
                planes.iter_mut().for_each(|p| p[i] = 0.0);
            }
        }
    }

    /// The second pass: masks the pixels around which a signal does not stand above `low_signal` standard errors. The tally
    /// of what they take away.
    pub fn drop_weak(&self, planes: &mut [Array2<f32>], ctx: Ctx<'_>) -> Result<Tally, Error> {
        let mut dropped = Tally::new(self.channel);
        if self.blocks.is_none() || self.low_signal == 0.0 {
            return Ok(dropped);
        }
        let (count, columns) = (self.quantity_count(), planes[0].ncols());
        let mut weak = vec![Array2::zeros(planes[0].dim())];
        let pixels: Vec<&[f32]> = planes.iter().map(|p| p.as_slice().expect("planes are row-major")).collect();
        // At f_x = 0 both quantities are M_DC.
        let stored = |&q: &usize| q % 2 == 1 || self.channel.fringes[q / 2].f_x_per_mm > 0.0;
        let quantities: Vec<Noisy<'_>> = (0..count).filter(stored).map(|q| [pixels[q], pixels[count + q]]).collect();
        let mask = pixels[pixels.len() - 1];
        ctx.fill_planes(&mut weak, |range, out| {
            for (row, out) in (range.start / columns..range.end / columns).zip(out[0].chunks_mut(columns)) {
                let found = weak_in_row(self.level, &quantities, mask, columns, row, self.low_signal);
                out.iter_mut().zip(found).for_each(|(out, weak)| *out = f32::from(u8::from(weak)));
            }
        })?;
        let weak = weak[0].as_slice().expect("planes are row-major");
        let tiles = ctx.fill_planes(planes, |range, planes| {
            let mut dropped = Tally::new(self.channel);
            let (mask, planes) = planes.split_last_mut().expect("the mask is the last plane");
            for (o, _) in weak[range].iter().enumerate().filter(|&(_, &weak)| weak != 0.0) {
                if mask[o] != 0.0 {
                    continue;
                }
                mask[o] = MaskReason::LowSignal.code();
                dropped.good += 1;
                planes.iter_mut().for_each(|p| p[o] = 0.0);
            }
            dropped
        })?;
        tiles.iter().for_each(|tile| dropped.add(tile));
        Ok(dropped)
    }

    /// What the planes say for and against each pixel of a chunk, fringe by fringe.
    fn flags(&self, planes: &[&mut [f32]], flags: &mut [u32]) {
        let n = flags.len();
        let count = self.quantity_count();
        let low = if self.neighbours_judge() { LOW } else { WEAK };
        for k in 0..self.channel.fringes.len() {
            let (m_dc, m_ac) = (&planes[2 * k][..n], &planes[2 * k + 1][..n]);
            dispatch!(self.level, simd => simd.vectorize(#[inline(always)] || {
                for i in 0..n {
                    // Frames are f32: an amplitude of their rounding is no signal, whatever their standard errors.
                    let weak = (m_dc[i] <= 0.0) | (m_ac[i] <= 0.0) | (m_ac[i] <= f32::EPSILON * m_dc[i]);
                    // An infinite frame leaves infinities or differences of them.
                    let finite = (m_dc[i] + m_ac[i]).is_finite();
                    let lit = m_dc[i] != 0.0;
                    flags[i] |=
                        (u32::from(!finite) * NOT_FINITE) | (u32::from(lit) * LIT) | (u32::from(weak) * low);
                }
            }));
            if self.blocks.is_some() {
                let dc_se = &planes[count + 2 * k][..n];
                flags.iter_mut().zip(dc_se).for_each(|(flags, &se)| *flags |= u32::from(se != 0.0) * LIT);
            }
        }
        // Their noise must be finite too: errors and covariances.
        for plane in planes.iter().skip(count) {
            for (flags, value) in flags.iter_mut().zip(plane.iter()) {
                *flags |= u32::from(!value.is_finite()) * NOT_FINITE;
            }
        }
    }

    /// Whether neighbours tell a weak signal from noise: where it is known, and a limit is given.
    fn neighbours_judge(&self) -> bool {
        self.blocks.is_some() && self.low_signal > 0.0
    }

    /// Tells the pixels that noise may have brought to 0 or below from those that have no signal. The first keep their values, for a mean without them
    /// would be too high; whether there is a signal at all is what their neighbours show.
    fn judge_low(&self, planes: &[&mut [f32]], flags: &mut [u32]) {
        let count = self.quantity_count();
        for (i, flags) in flags.iter_mut().enumerate().filter(|(_, flags)| **flags & LOW != 0) {
            for k in 0..self.channel.fringes.len() {
                let [m_dc, m_ac, dc_se, ac_se] =
                    [2 * k, 2 * k + 1, count + 2 * k, count + 2 * k + 1].map(|plane| planes[plane][i]);
                let rounding = f32::EPSILON * m_dc.abs();
                let mean_is_noisy = m_dc > 0.0 || -m_dc < WITHIN_NOISE * dc_se;
                // M_AC is below 0 only where more was taken off for noise than there was.
                let fringe_is_noisy = m_ac > rounding || (m_ac < -rounding && ac_se > 0.0);
                let low = m_dc <= 0.0 || m_ac <= rounding;
                *flags |= match (low, mean_is_noisy && fringe_is_noisy) {
                    (false, _) => 0,
                    (true, true) => UNCERTAIN,
                    (true, false) => WEAK,
                };
            }
        }
    }

    fn frame_flags(&self, chunk: Range<usize>, flags: &mut [u32]) {
        if self.saturation == f32::INFINITY {
            return;
        }
        for frame in self.frames.iter().flatten() {
            for (flags, &value) in flags.iter_mut().zip(&frame[chunk.clone()]) {
                *flags |= u32::from(value >= self.saturation) * SATURATED;
            }
        }
    }
}

/// Standard errors below 0 that noise may take a mean which is not: a normal one is there once in 3.5 million pixels.
const WITHIN_NOISE: f32 = 5.0;

/// Where no bias is known: no bias is below 0.
const UNKNOWN: f64 = -1.0;

const NOT_FINITE: u32 = 1;
/// Some fringe has a mean or a variance.
const LIT: u32 = 2;
const WEAK: u32 = 4;
const SATURATED: u32 = 8;
/// Not above 0, for whatever reason.
const LOW: u32 = 16;
/// Not above 0, which may be for its noise.
const UNCERTAIN: u32 = 32;

fn reason(flags: u32) -> MaskReason {
    if flags & NOT_FINITE != 0 {
        MaskReason::NotFinite
    } else if flags & SATURATED != 0 {
        MaskReason::Saturated
    } else if flags & LIT == 0 {
        MaskReason::Background
    } else if flags & WEAK != 0 {
        MaskReason::LowSignal
    } else {
        MaskReason::Good
    }
}

/// The upper triangle (i <= j) of an n x n matrix, row by row.
fn upper(n: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..n).flat_map(move |i| (i..n).map(move |j| (i, j)))
}
