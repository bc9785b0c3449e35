//! The fused pass: one sweep over the frames of a channel, chunk by chunk, that writes every plane of the results.

use std::borrow::Cow;
use std::ops::Range;

use turbid_contract::ndarray::Array2;
use turbid_contract::payload::MaskReason;
use turbid_contract::planes::mean_se;
use turbid_contract::{Ctx, Error, ImageStack, LayerInfo, LayerKind};

use crate::noise::{Block, Gradient, OF_M_DC, along_and_across};
use crate::set::{Channel, Noise};
use crate::signal::{Noisy, weak_in_row};
use crate::stage::{NoiseBias, Params};

type Described = (LayerInfo, Array2<f32>);

/// Layers of a stack by kind; values come first, so that `pair` counts layers and value layers alike.
#[derive(Default)]
pub struct Group {
    values: Vec<Described>,
    errors: Vec<Described>,
    covariances: Vec<Described>,
    masks: Vec<Described>,
}

impl Group {
    pub fn into_iter_ordered(self) -> impl Iterator<Item = Described> {
        self.values.into_iter().chain(self.errors).chain(self.covariances).chain(self.masks)
    }
}

/// Pixels that are worked on at a time: their f64 intermediates stay in the first-level cache.
const CHUNK: usize = 256;

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
    low_signal: f64,
    corrects: bool,
    wants_phase: bool,
}

impl<'a> Pass<'a> {
    pub fn new(
        channel: &'a Channel,
        noise: Option<&'a Noise<'_>>,
        stack: &'a ImageStack,
        params: &Params,
        wants_phase: bool,
    ) -> Self {
        let count = channel.fringes.len();
        let blocks = noise.map(|n| upper(count).map(|(a, b)| n.block(channel, a, b)).collect());
        // At f_x = 0 both quantities are M_DC; its covariances stand once, under m_ac.
        let stored = |&q: &usize| q % 2 == 1 || channel.fringes[q / 2].f_x_per_mm > 0.0;
        let quantities: Vec<usize> = (0..2 * count).filter(stored).collect();
        let pairs = upper(quantities.len()).filter(|(i, j)| i < j).map(|(i, j)| [quantities[i], quantities[j]]);
        let frames = channel.fringes.iter().map(|f| f.frames.iter().map(|&i| stack.layers[i].pixels()).collect());
        Self {
            channel,
            frames: frames.collect(),
            pairs: if noise.is_some() { pairs.collect() } else { Vec::new() },
            blocks,
            low_signal: params.low_signal,
            corrects: params.noise_bias == NoiseBias::Correct,
            wants_phase,
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
        let mut linear: Vec<[Vec<f64>; 3]> = Vec::new();
        let mut start = pixels.start;
        while start < pixels.end {
            let chunk = start..(start + CHUNK).min(pixels.end);
            linear.resize_with(self.frames.len(), || [const { Vec::new() }; 3]);
            for (k, (out, frames)) in linear.iter_mut().zip(&self.frames).enumerate() {
                let parts: Vec<&[f32]> = frames.iter().map(|f| &f[chunk.clone()]).collect();
                out.iter_mut().for_each(|v| v.resize(chunk.len(), 0.0));
                self.channel.fringes[k].weights.apply(&parts, out);
            }
            let mut parts: Vec<&mut [f32]> =
                planes.iter_mut().map(|p| &mut p[chunk.start - pixels.start..chunk.end - pixels.start]).collect();
            self.values(&linear, &mut parts);
            if let Some(blocks) = &self.blocks {
                self.errors(blocks, chunk.start, &linear, &mut parts, &mut tally);
            }
            self.phases(&linear, &mut parts);
            self.mask(&linear, &mut parts, &mut tally);
            start = chunk.end;
        }
        tally
    }

    fn values(&self, linear: &[[Vec<f64>; 3]], planes: &mut [&mut [f32]]) {
        for (k, [dc, re, im]) in linear.iter().enumerate() {
            let [m_dc, m_ac] = &mut planes[2 * k..2 * k + 2] else { unreachable!("two planes for each fringe") };
            m_dc.iter_mut().zip(dc).for_each(|(out, dc)| *out = *dc as f32);
            if self.channel.fringes[k].f_x_per_mm == 0.0 {
                m_ac.copy_from_slice(m_dc);
            } else {
                m_ac.iter_mut().zip(re.iter().zip(im)).for_each(|(out, (re, im))| {
                    *out = (re * re + im * im).sqrt() as f32;
                });
            }
        }
    }

    fn errors(
        &self,
        blocks: &[Block<'_>],
        first: usize,
        linear: &[[Vec<f64>; 3]],
        planes: &mut [&mut [f32]],
        tally: &mut Tally,
    ) {
        let fringes = self.channel.fringes.len();
        let block = |a: usize, b: usize| &blocks[a * fringes - a * (a + 1) / 2 + b];
        let (se, pairs) = (self.quantity_count(), 2 * self.quantity_count());
        let phases = pairs + self.pairs.len() + self.phase_count();
        let mut gradients: Vec<Gradient> = vec![OF_M_DC; self.quantity_count()];
        for i in 0..linear[0][0].len() {
            let mut phase = phases;
            for (k, [_, re, im]) in linear.iter().enumerate() {
                if self.channel.fringes[k].f_x_per_mm > 0.0 {
                    let [along, across] = along_and_across(re[i], im[i]);
                    gradients[2 * k + 1] = along;
                    let variance = block(k, k).variance(&across, first + i);
                    let m_ac = (re[i] * re[i] + im[i] * im[i]).sqrt();
                    if m_ac > 0.0 && variance.is_finite() {
                        let bias = variance / (2.0 * m_ac);
                        tally.rician[k] += bias;
                        tally.m_ac[k] += m_ac;
                        if self.corrects {
                            planes[2 * k + 1][i] = (m_ac - bias) as f32;
                        }
                    }
                    if self.wants_phase {
                        planes[phase][i] = if m_ac > 0.0 { (variance.sqrt() / m_ac) as f32 } else { 0.0 };
                        phase += 1;
                    }
                }
                for q in [2 * k, 2 * k + 1] {
                    planes[se + q][i] = block(k, k).variance(&gradients[q], first + i).sqrt() as f32;
                }
            }
            for (p, &[a, b]) in self.pairs.iter().enumerate() {
                let covariance = block(a / 2, b / 2).covariance(&gradients[a], &gradients[b], first + i);
                planes[pairs + p][i] = covariance as f32;
            }
        }
    }

    fn phases(&self, linear: &[[Vec<f64>; 3]], planes: &mut [&mut [f32]]) {
        if !self.wants_phase {
            return;
        }
        let errors = if self.blocks.is_some() { self.quantity_count() } else { 0 };
        let first = self.quantity_count() + errors + self.pairs.len();
        let fringes = linear.iter().zip(&self.channel.fringes).filter(|(_, f)| f.f_x_per_mm > 0.0);
        for (plane, ([_, re, im], _)) in planes[first..].iter_mut().zip(fringes) {
            plane.iter_mut().zip(re.iter().zip(im)).for_each(|(out, (re, im))| *out = libm::atan2(*im, *re) as f32);
        }
    }

    /// Finds the pixels that carry no measurement, and sets all their planes to 0.
    fn mask(&self, linear: &[[Vec<f64>; 3]], planes: &mut [&mut [f32]], tally: &mut Tally) {
        let quantities = self.quantity_count();
        let (mask, planes) = planes.split_last_mut().expect("the mask is the last plane");
        let n = mask.len();
        tally.pixels += n as u64;
        let flags = self.flags(linear, planes);
        let flags = &flags[..n];
        for (mask, &flags) in mask.iter_mut().zip(flags) {
            *mask = reason(flags).code();
        }
        for (i, _) in flags.iter().enumerate().filter(|&(_, &flags)| reason(flags) != MaskReason::Good) {
            planes.iter_mut().for_each(|p| p[i] = 0.0);
        }
        tally.good += flags.iter().filter(|&&flags| reason(flags) == MaskReason::Good).count() as u64;
        if self.blocks.is_some() {
            // Masked pixels hold 0 by now.
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
                let found = weak_in_row(&quantities, mask, columns, row, self.low_signal);
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

    /// What speaks for and against each pixel of a chunk, fringe by fringe.
    fn flags(&self, linear: &[[Vec<f64>; 3]], planes: &[&mut [f32]]) -> [u8; CHUNK] {
        let mut flags = [0; CHUNK];
        let zeros = [0.0_f32; CHUNK];
        for (k, [dc, re, im]) in linear.iter().enumerate() {
            let n = dc.len();
            let se =
                |q: usize| if self.blocks.is_some() { &planes[self.quantity_count() + q][..n] } else { &zeros[..n] };
            let (m_ac, dc_se) = (&planes[2 * k + 1][..n], se(2 * k));
            let (re, im) = (&re[..n], &im[..n]);
            for i in 0..n {
                let (m_ac, dc_se) = (f64::from(m_ac[i]), f64::from(dc_se[i]));
                let finite = (dc[i] + re[i] + im[i] + m_ac).is_finite();
                let lit = (dc[i] != 0.0) | (dc_se != 0.0);
                // Frames are f32: an amplitude of their rounding is no signal, whatever their standard errors.
                let weak = (dc[i] <= 0.0) | (m_ac <= 0.0) | (m_ac <= f64::from(f32::EPSILON) * dc[i]);
                flags[i] |= (u8::from(!finite) * NOT_FINITE) | (u8::from(lit) * LIT) | (u8::from(weak) * WEAK);
            }
        }
        // Their noise must be finite too: errors and covariances.
        for plane in planes.iter().skip(self.quantity_count()) {
            for (flags, value) in flags.iter_mut().zip(plane.iter()) {
                *flags |= u8::from(!value.is_finite()) * NOT_FINITE;
            }
        }
        flags
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
        let mut planes = planes.into_iter();
        let mut next = || planes.next().expect("as many planes as plane_count says");
        for (q, info) in infos.iter_mut().enumerate() {
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
        phase_infos.iter().for_each(|info| phases.values.push((info.clone(), next())));
        if known {
            phase_infos.iter().for_each(|info| phases.errors.push((info.standard_error(), next())));
        }
        let mut mask = LayerInfo::new("mask", LayerKind::Mask, "1");
        mask.wavelength_nm = *wavelength_nm;
        let data = next();
        if self.wants_phase {
            phases.masks.push((mask.clone(), data.clone()));
        }
        values.masks.push((mask, data));
    }
}

const NOT_FINITE: u8 = 1;
/// Some fringe has a mean or a variance.
const LIT: u8 = 2;
const WEAK: u8 = 4;

fn reason(flags: u8) -> MaskReason {
    if flags & NOT_FINITE != 0 {
        MaskReason::NotFinite
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
    /// Of each quantity, over good pixels.
    variances: Vec<f64>,
    /// Of each fringe: Rician bias, and M_AC that it belongs to.
    rician: Vec<f64>,
    m_ac: Vec<f64>,
}

impl Tally {
    pub fn new(channel: &Channel) -> Self {
        let n = channel.fringes.len();
        Self { good: 0, pixels: 0, variances: vec![0.0; 2 * n], rician: vec![0.0; n], m_ac: vec![0.0; n] }
    }

    pub fn add(&mut self, tile: &Self) {
        self.good += tile.good;
        self.pixels += tile.pixels;
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

    /// Measures the Rician bias of the mean M_AC at the highest f_x, and warns where nothing is left.
    pub fn report(&self, channel: &Channel, known: bool, ctx: Ctx<'_>) {
        let last = channel.fringes.len() - 1;
        if known && self.m_ac[last] > 0.0 {
            ctx.measure("rician_bias", 100.0 * self.rician[last] / self.m_ac[last], "%");
        }
        ctx.measure("masked", 100.0 * (self.pixels - self.good) as f64 / self.pixels as f64, "%");
        if self.good == 0 {
            ctx.warn("all pixels are masked: no fringe rises above the noise");
        }
    }
}
