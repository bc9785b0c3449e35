//! Faults of single frames, in words: frames without light, saturated, not finite, taken twice, brighter than the others of their fringe.

use std::f64::consts::PI;

use turbid_contract::payload::MaskReason;
use turbid_contract::{Ctx, ImageStack, Layer};
use turbid_optics::elementary::{atan2, sin_cos_turns};

use crate::doubts::light;
use crate::phase_shift::Weights;
use crate::set::{Channel, Fringe};

/// Range of the brightness of a fringe's frames, percent of their mean, above which it is told: a lamp that has warmed up stays within 1 %.
const LARGEST_DRIFT: f64 = 2.0;
/// Departure of M_DC of a fringe from that of f_x = 0, percent, above which it is told.
const LARGEST_STEP: f64 = 5.0;
/// Mean of a frame over that of the brightest of its fringe, below which it is dark.
const LEAST_LIGHT: f64 = 0.02;
/// Share of saturated pixels, or of those that are no number, in percent, above which a frame is named.
const LARGEST_LOSS: f64 = 1.0;
/// Difference of two shifted frames over the largest of all pairs, below which they are the same step: steps 5 degrees apart among those of a whole turn
/// differ by 0.05 of it.
const TWINS: f64 = 0.05;
/// Periods in the image below which a window does not tell brightness from fringe: the transform of a Hann window ends there.
const LEAST_PERIODS: f64 = 2.0;

impl Channel {
    /// Warns of frames that cannot be what they should be; `saturation` is the level of the frames that says so.
    pub fn check_frames(&self, stack: &ImageStack, saturation: Option<f64>, ctx: Ctx<'_>) {
        let mask = stack.mask(self.wavelength_nm).map(Layer::pixels);
        if let Some(mask) = &mask {
            let saturated = mask.iter().filter(|&&m| m == MaskReason::Saturated.code()).count();
            let share = percent(saturated, mask.len());
            if share > LARGEST_LOSS {
                let light = light(self.wavelength_nm);
                ctx.warn(format!("{share:.1} % of the pixels{light} are saturated in a frame: expose shorter"));
            }
        }
        let mut planar: Option<f64> = None;
        for fringe in &self.fringes {
            let pixels: Vec<_> = fringe.frames.iter().map(|&i| stack.layers[i].pixels()).collect();
            let planes: Vec<&[f32]> = pixels.iter().map(AsRef::as_ref).collect();
            let names: Vec<String> = (0..planes.len()).map(|k| name(self, fringe, stack, k)).collect();
            // A step of even light may be black.
            let least = if fringe.ambient.is_some() { f64::NEG_INFINITY } else { LEAST_LIGHT };
            let usable = check_single(&planes, &names, least, saturation, ctx);
            check_twins(&planes, fringe, &names, ctx);
            let Some(means) = means(&planes, mask.as_deref(), stack.columns()).filter(|_| usable) else { continue };
            let told = fringe.f_x_per_mm == 0.0 || periods(&planes, &fringe.weights, stack.columns()) >= LEAST_PERIODS;
            if !told {
                continue;
            }
            // With the ambient light, which is in M_DC of a fringe, too.
            let sum = |weights: &[f64]| means.iter().zip(weights).map(|(mean, weight)| mean * weight).sum::<f64>();
            let m_dc = sum(&fringe.weights.weights[0]) + fringe.ambient.as_deref().map_or(0.0, sum);
            if m_dc <= 0.0 {
                continue;
            }
            if fringe.f_x_per_mm > 0.0 || !fringe.is_shifted() {
                check_drift(&means, &names, ctx);
            }
            match planar {
                None if fringe.f_x_per_mm == 0.0 => planar = Some(m_dc),
                Some(planar) if 100.0 * (m_dc / planar - 1.0).abs() > LARGEST_STEP => ctx.warn(format!(
                    "M_DC at f_x = {} mm^-1{} is {:+.1} % off that at f_x = 0: the mean of a fringe is that of the full field; were lamp, exposure or room light the same, and is the full field the pattern value 1/2?",
                    fringe.f_x_per_mm,
                    light(self.wavelength_nm),
                    100.0 * (m_dc / planar - 1.0)
                )),
                _ => {}
            }
        }
    }
}

/// `the frame of 120 deg at f_x = 0.1 mm^-1 and 650 nm`
fn name(channel: &Channel, fringe: &Fringe, stack: &ImageStack, k: usize) -> String {
    let phase = stack.layers[fringe.frames[k]].info.phase_rad.filter(|_| fringe.frames.len() > 1);
    let of = phase.map(|phase| format!(" of {:.0} deg", phase.to_degrees())).unwrap_or_default();
    format!("the frame{of} at f_x = {} mm^-1{}", fringe.f_x_per_mm, light(channel.wavelength_nm))
}

fn percent(part: usize, all: usize) -> f64 {
    100.0 * part as f64 / all.max(1) as f64
}

/// Names frames without light, saturated ones, and those that are no numbers; whether all of them can be used.
fn check_single(planes: &[&[f32]], names: &[String], least_light: f64, saturation: Option<f64>, ctx: Ctx<'_>) -> bool {
    let mean = |plane: &&[f32]| {
        let finite = || plane.iter().copied().filter(|value| value.is_finite()).map(f64::from);
        finite().sum::<f64>() / finite().count().max(1) as f64
    };
    let means: Vec<f64> = planes.iter().map(mean).collect();
    // Where all of them are dark the wavelength is, which is told elsewhere.
    let most = means.iter().copied().fold(0.0, f64::max);
    let mut usable = most > 0.0;
    for ((plane, name), mean) in planes.iter().zip(names).zip(&means) {
        if *mean < least_light * most {
            usable = false;
            ctx.warn(format!(
                "{name} is dark, {:.2} % as bright as the brightest of its fringe: was the lamp off? Take it again, or leave it out",
                100.0 * mean / most
            ));
        }
        let missing = percent(plane.iter().filter(|value| !value.is_finite()).count(), plane.len());
        if missing > LARGEST_LOSS {
            ctx.warn(format!("{missing:.1} % of {name} are not numbers: these pixels are masked; look at the file"));
        }
        let Some(level) = saturation else { continue };
        let saturated = percent(plane.iter().filter(|&&value| f64::from(value) >= level).count(), plane.len());
        if saturated > LARGEST_LOSS {
            ctx.warn(format!("{saturated:.1} % of {name} are saturated and masked: expose shorter"));
        }
    }
    usable
}

/// Names frames that are the same picture, byte by byte (noise never repeats) or but for their noise.
fn check_twins(planes: &[&[f32]], fringe: &Fringe, names: &[String], ctx: Ctx<'_>) {
    let pairs: Vec<[usize; 2]> = (1..planes.len()).flat_map(|k| (0..k).map(move |twin| [twin, k])).collect();
    let apart: Vec<f64> = pairs.iter().map(|&[twin, k]| difference(planes[twin], planes[k])).collect();
    let most = apart.iter().copied().fold(0.0, f64::max);
    for (&[twin, k], &apart) in pairs.iter().zip(&apart) {
        let varies = planes[k].iter().any(|&value| value != planes[k][0]);
        let why = if varies && planes[twin] == planes[k] {
            "are the same picture: a frame was read or saved twice"
        } else if fringe.is_shifted() && most > 0.0 && apart < TWINS * most {
            "differ by their noise only: the projector lost a step, or a frame was taken twice"
        } else {
            continue;
        };
        ctx.warn(format!("{} and {} {why}; take them again", names[twin], names[k]));
    }
}

/// Root mean square difference of two frames, where both are finite.
fn difference(a: &[f32], b: &[f32]) -> f64 {
    let squares = a.iter().zip(b).map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2)).filter(|s| s.is_finite());
    let (sum, count) = squares.fold((0.0, 0_u64), |(sum, count), square| (sum + square, count + 1));
    if count > 0 { (sum / count as f64).sqrt() } else { 0.0 }
}

/// Names the frame that is furthest off, where the frames of a fringe are not equally bright.
fn check_drift(means: &[f64], names: &[String], ctx: Ctx<'_>) {
    let mean = means.iter().sum::<f64>() / means.len() as f64;
    let [least, most] = [f64::min, f64::max].map(|pick: fn(f64, f64) -> f64| means.iter().copied().reduce(pick));
    let (Some(least), Some(most)) = (least, most) else { return };
    let range = 100.0 * (most - least) / mean;
    if range > LARGEST_DRIFT {
        let off = |k: &usize| (means[*k] / mean - 1.0).abs();
        let furthest = (0..means.len()).max_by(|a, b| off(a).total_cmp(&off(b))).expect("there are frames");
        ctx.warn(format!(
            "the brightness of the frames differs by {range:.1} % between phases; {} is {:+.1} % off their mean: a lamp that drifts, room light that changes, or a lost step of the projector; let the lamp warm up, darken the room, take the frames again",
            names[furthest],
            100.0 * (means[furthest] / mean - 1.0)
        ));
    }
}

/// Means of the frames under a Hann window over the image, from which two periods and more of a fringe vanish; `None` without a good pixel.
fn means(planes: &[&[f32]], mask: Option<&[f32]>, columns: usize) -> Option<Vec<f64>> {
    let pixels = planes.first().map_or(0, |plane| plane.len());
    let hann = |n: usize| -> Vec<f64> {
        let sine = |i: usize| sin_cos_turns(0.5 * (i as f64 + 0.5) / n as f64).0;
        (0..n).map(|i| sine(i) * sine(i)).collect()
    };
    let (across, down) = (hann(columns), hann(pixels / columns));
    let (mut sums, mut weight) = (vec![0.0; planes.len()], 0.0);
    for i in 0..pixels {
        let good = mask.is_none_or(|mask| mask[i] == 0.0) && planes.iter().all(|plane| plane[i].is_finite());
        if good {
            let own = across[i % columns] * down[i / columns];
            weight += own;
            sums.iter_mut().zip(planes).for_each(|(sum, plane)| *sum += own * f64::from(plane[i]));
        }
    }
    (weight > 0.0).then(|| sums.iter().map(|sum| sum / weight).collect())
}

/// Periods of the fringe across the image or down it, whichever are more, from how the phase turns between neighbours.
fn periods(planes: &[&[f32]], weights: &Weights, columns: usize) -> f64 {
    let pixels = planes.first().map_or(0, |plane| plane.len());
    let phasor = |i: usize| {
        let of =
            |q: usize| planes.iter().zip(&weights.weights[q]).map(|(plane, w)| w * f64::from(plane[i])).sum::<f64>();
        [of(1), of(2)]
    };
    let turns = |step: usize, pairs: &mut dyn Iterator<Item = usize>| {
        let mut sum = [0.0; 2];
        for i in pairs {
            let ([a, b], [c, d]) = (phasor(i), phasor(i + step));
            let product = [a * c + b * d, a * d - b * c];
            if product.iter().all(|part| part.is_finite()) {
                sum = [sum[0] + product[0], sum[1] + product[1]];
            }
        }
        atan2(sum[1], sum[0]).abs() / (2.0 * PI)
    };
    // A few thousand pairs tell a frequency.
    let stride = (pixels / MOST_PAIRS).max(1) | 1;
    let along = turns(1, &mut (0..pixels).step_by(stride).filter(|i| i % columns + 1 < columns));
    let down = turns(columns, &mut (0..pixels.saturating_sub(columns)).step_by(stride));
    (along * columns as f64).max(down * (pixels / columns) as f64)
}

const MOST_PAIRS: usize = 1 << 14;
