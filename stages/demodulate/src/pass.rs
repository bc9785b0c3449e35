//! The fused pass: one sweep over the frames of a channel, chunk by chunk, that writes every plane of the results.

use std::borrow::Cow;
use std::ops::Range;

use fearless_simd::{Level, Simd, dispatch};
use turbid_contract::ndarray::Array2;
use turbid_contract::payload::MaskReason;
use turbid_contract::planes::mean_se;
use turbid_contract::{Ctx, Error, ImageStack, LayerInfo, LayerKind};

use crate::errors::{Elements, Phasors, Toward};
use crate::fused::{Planes, amplitudes, phases};
use crate::level::named;
use crate::noise::Block;
use crate::set::{Channel, Fringe, Noise};
use crate::signal::{Noisy, weak_in_row};
use crate::stage::{NoiseBias, Params};
use crate::unknown;

type Described = (LayerInfo, Array2<f32>);

/// Layers of a stack by kind; values come first, so that `pair` counts layers and value layers alike.
#[derive(Default)]
pub struct Group {
    values: Vec<Described>,
    errors: Vec<Described>,
    covariances: Vec<Described>,
    masks: Vec<Described>,
    unknown: Vec<Described>,
}

impl Group {
    pub fn into_iter_ordered(self) -> impl Iterator<Item = Described> {
        self.values.into_iter().chain(self.errors).chain(self.covariances).chain(self.masks).chain(self.unknown)
    }
}

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
        // At f_x = 0 both quantities are M_DC; its covariances stand once, under m_ac.
        let stored = |&q: &usize| q % 2 == 1 || channel.fringes[q / 2].f_x_per_mm > 0.0;
        let quantities: Vec<usize> = (0..2 * count).filter(stored).collect();
        let pairs = upper(quantities.len()).filter(|(i, j)| i < j).map(|(i, j)| [quantities[i], quantities[j]]);
        let frames = channel.fringes.iter().map(|f| f.frames.iter().map(|&i| stack.layers[i].pixels()).collect());
        let infos = |f: &Fringe| f.frames.iter().map(|&i| &stack.layers[i].info).collect::<Vec<_>>();
        let unknown = |f: &Fringe| if noise.is_some() { unknown::of_layers(stack, infos(f)) } else { None };
        Self {
            channel,
            frames: frames.collect(),
            pairs: if noise.is_some() { pairs.collect() } else { Vec::new() },
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
        if self.blocks.is_some() {
            // Masked pixels hold 0 by now.
            let quantities = self.quantity_count();
            for q in 0..quantities {
                let se = planes[quantities + q].iter().map(|&se| f64::from(se));
                tally.variances[q] += se.map(|se| se * se).sum::<f64>();
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
                for q in 0..count {
                    dropped.variances[q] += f64::from(planes[count + q][o]).powi(2);
                }
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

    /// Gives the planes their descriptions and sorts them into the two stacks.
    pub fn describe(
        &self,
        planes: Vec<Array2<f32>>,
        tally: &Tally,
        sharing: f64,
        values: &mut Group,
        phases: &mut Group,
    ) {
        let Channel { wavelength_nm, unit, fringes } = self.channel;
        let known = self.blocks.is_some();
        let first_value = values.values.len() as u32;
        let info = |name: &str, unit: &str, k: usize| {
            let mut info = LayerInfo::value(name, unit).with_f_x(fringes[k].f_x_per_mm);
            (info.orientation_deg, info.wavelength_nm) = (fringes[k].orientation_deg, *wavelength_nm);
            info
        };
        let mut infos: Vec<LayerInfo> =
            (0..self.quantity_count()).map(|q| info(if q % 2 == 0 { "m_dc" } else { "m_ac" }, unit, q / 2)).collect();
        let phase_infos: Vec<LayerInfo> = (0..fringes.len())
            .filter(|&k| self.wants_phase && fringes[k].f_x_per_mm > 0.0)
            .map(|k| info("phase", "rad", k))
            .collect();
        let uncertain = self.uncertain(&planes, tally);
        let flags: Vec<Option<Vec<bool>>> =
            self.unknown.iter().map(|of_frames| either(of_frames.as_deref(), uncertain.as_deref())).collect();
        let flagged = |info: &LayerInfo, k: usize, mask: &Array2<f32>| {
            flags[k].as_ref().filter(|_| known).and_then(|flags| unknown::layer(info, flags, mask))
        };
        // The direction of a phasor that noise has turned over is nobody's phase.
        let turned = |i: usize| uncertain.as_ref().is_some_and(|flags| flags[i]);
        let last = planes.last().expect("the mask is the last plane");
        values.unknown.extend(infos.iter().enumerate().filter_map(|(q, info)| flagged(info, q / 2, last)));
        if self.wants_phase {
            let mut data = last.clone();
            if uncertain.is_some() {
                let weak = data.iter_mut().enumerate().filter(|(i, _)| turned(*i));
                weak.for_each(|(_, mask)| *mask = MaskReason::LowSignal.code());
            }
            let fringed = (0..fringes.len()).filter(|&k| fringes[k].f_x_per_mm > 0.0);
            let own = phase_infos.iter().zip(fringed).filter_map(|(info, k)| flagged(info, k, &data));
            phases.unknown.extend(own);
            phases.masks.push((mask_info(*wavelength_nm), data));
        }
        let mut planes = planes.into_iter();
        let mut next = || planes.next().expect("as many planes as plane_count says");
        for (q, info) in infos.iter_mut().enumerate() {
            // What frames do not know of a pixel they may still know of their mean.
            let known = known && (self.unknown[q / 2].is_none() || self.mean_known[q / 2]);
            info.mean_se = if known { mean_se(tally.variances[q], tally.good, sharing) } else { None };
            values.values.push((info.clone(), next()));
        }
        if known {
            infos.iter().for_each(|info| values.errors.push((info.standard_error(), next())));
        }
        for pair in &self.pairs {
            let mut info = LayerInfo::new("cov", LayerKind::Covariance, format!("({unit})^2"));
            info.pair = Some(pair.map(|q| first_value + q as u32));
            info.wavelength_nm = *wavelength_nm;
            values.covariances.push((info, next()));
        }
        let phase_plane = |mut plane: Array2<f32>| {
            if uncertain.is_some() {
                plane.iter_mut().enumerate().filter(|(i, _)| turned(*i)).for_each(|(_, value)| *value = 0.0);
            }
            plane
        };
        phase_infos.iter().for_each(|info| phases.values.push((info.clone(), phase_plane(next()))));
        if known {
            phase_infos.iter().for_each(|info| phases.errors.push((info.standard_error(), phase_plane(next()))));
        }
        values.masks.push((mask_info(*wavelength_nm), next()));
    }

    /// The good pixels of which noise has left no signal, but whose neighbours have one; `None` where there are none.
    fn uncertain(&self, planes: &[Array2<f32>], tally: &Tally) -> Option<Vec<bool>> {
        if tally.uncertain == 0 {
            return None;
        }
        let mask = planes.last().expect("the mask is the last plane");
        let mut flags = vec![false; mask.len()];
        for plane in &planes[..self.quantity_count()] {
            let pixels = flags.iter_mut().zip(plane.iter().zip(mask));
            pixels.for_each(|(flag, (&value, &mask))| *flag |= mask == 0.0 && value <= 0.0);
        }
        flags.contains(&true).then_some(flags)
    }
}

fn mask_info(wavelength_nm: Option<f64>) -> LayerInfo {
    LayerInfo { wavelength_nm, ..LayerInfo::new("mask", LayerKind::Mask, "1") }
}

/// Where either is set; `None` where neither is there.
fn either(a: Option<&[bool]>, b: Option<&[bool]>) -> Option<Vec<bool>> {
    match (a, b) {
        (Some(a), Some(b)) => Some(a.iter().zip(b).map(|(a, b)| *a || *b).collect()),
        (one, other) => one.or(other).map(<[bool]>::to_vec),
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

/// Sums over pixels, added up in tile order.
pub struct Tally {
    good: u64,
    pixels: u64,
    /// Good pixels with a value that is not above 0.
    uncertain: u64,
    /// Of each quantity, over good pixels.
    variances: Vec<f64>,
    /// Of each fringe: Rician bias, and M_AC that it belongs to.
    rician: Vec<f64>,
    m_ac: Vec<f64>,
}

impl Tally {
    pub fn new(channel: &Channel) -> Self {
        let n = channel.fringes.len();
        Self { good: 0, pixels: 0, uncertain: 0, variances: vec![0.0; 2 * n], rician: vec![0.0; n], m_ac: vec![0.0; n] }
    }

    pub fn add(&mut self, tile: &Self) {
        self.good += tile.good;
        self.pixels += tile.pixels;
        self.uncertain += tile.uncertain;
        let pairs =
            [(&mut self.variances, &tile.variances), (&mut self.rician, &tile.rician), (&mut self.m_ac, &tile.m_ac)];
        for (sum, part) in pairs {
            sum.iter_mut().zip(part).for_each(|(sum, part)| *sum += part);
        }
    }

    /// Takes away what [`Pass::drop_weak`] dropped.
    pub fn less(&mut self, dropped: &Self) {
        self.good -= dropped.good;
        self.variances.iter_mut().zip(&dropped.variances).for_each(|(sum, part)| *sum -= part);
    }

    /// Measures the Rician bias of the mean M_AC at the highest f_x and the shares that `mask` leaves out, and warns where nothing is left.
    pub fn report(&self, channel: &Channel, known: bool, mask: &Array2<f32>, ctx: Ctx<'_>) {
        let last = channel.fringes.len() - 1;
        if known && self.m_ac[last] > 0.0 {
            ctx.measure("rician_bias", 100.0 * self.rician[last] / self.m_ac[last], "%");
        }
        let reasons = ctx.measure_masked(mask.iter().copied());
        if self.good == 0 {
            ctx.warn(format!("all pixels are masked: {reasons}"));
        }
    }
}
