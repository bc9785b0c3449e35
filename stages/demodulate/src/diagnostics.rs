//! What frames say about themselves: ripple of M_AC along the fringe, and drift of the brightness.

use turbid_contract::Ctx;

use crate::fourier::product;
use crate::phase_shift::Weights;

/// Pixels that are looked at: a lattice of at most so many.
const MOST_PIXELS: usize = 1 << 16;

/// In percent, over the image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Diagnosis {
    /// Amplitude of M_AC once, twice and thrice a period of the fringe, of its mean: brightness that drifts from frame to frame
    /// makes the first two, a second harmonic (gamma) under three steps the third.
    pub ripple: [f64; 3],
    /// Largest departure of a frame's mean from that of all: drift where the image holds whole periods.
    pub drift: f64,
}

/// The worst of what the fringes of all spatial frequencies and wavelengths say.
#[derive(Clone, Copy, Debug, Default)]
pub struct Worst {
    told: Option<Diagnosis>,
    /// Fringes that do not tell.
    untold: u32,
    /// By how much steps that were estimated depart from what the frames say, rad.
    departure: Option<f64>,
}

impl Worst {
    pub fn add(&mut self, fringe: Option<Diagnosis>) {
        let Some(found) = fringe else {
            self.untold += 1;
            return;
        };
        let known = self.told.unwrap_or(found);
        let ripple = std::array::from_fn(|k| known.ripple[k].max(found.ripple[k]));
        self.told = Some(Diagnosis { ripple, drift: known.drift.max(found.drift) });
    }

    pub fn departs(&mut self, by: f64) {
        self.departure = Some(self.departure.map_or(by, |known| known.max(by)));
    }

    /// What is not known is not measured.
    pub fn measure(&self, ctx: Ctx<'_>) {
        if let Some(told) = self.told {
            for (k, ripple) in told.ripple.into_iter().enumerate() {
                ctx.measure(&format!("ripple_{}f", k + 1), ripple, "%");
            }
            ctx.measure("brightness_drift", told.drift, "%");
        }
        if self.untold > 0 {
            ctx.measure("steps_untold", f64::from(self.untold), "1");
        }
        if let Some(departure) = self.departure {
            ctx.measure("step_departure", departure.to_degrees(), "deg");
        }
    }
}

/// `None` where the pixels do not show fringes of all phases.
pub fn diagnose(frames: &[&[f32]], weights: &Weights) -> Option<Diagnosis> {
    let step = frames[0].len().div_ceil(MOST_PIXELS).max(1);
    let planes: Vec<Vec<f32>> = frames.iter().map(|f| f.iter().copied().step_by(step).collect()).collect();
    let planes: Vec<&[f32]> = planes.iter().map(Vec::as_slice).collect();
    let n = planes[0].len();
    let mut linear = [vec![0.0; n], vec![0.0; n], vec![0.0; n]];
    weights.apply(&planes, &mut linear);
    let [_, re, im] = &linear;
    // M_AC = c_0 + sum_k (c_k cos k phi + s_k sin k phi) by least squares: what makes the ripple also crowds the phases.
    let (mut normal, mut right, mut count) = ([[0.0; TERMS]; TERMS], [0.0; TERMS], 0_u64);
    for (&re, &im) in re.iter().zip(im) {
        let m_ac = (re * re + im * im).sqrt();
        if !(m_ac > 0.0 && m_ac.is_finite()) {
            continue;
        }
        count += 1;
        let turn = [re / m_ac, im / m_ac];
        let mut x = [1.0; TERMS];
        let mut wave = turn;
        for k in 0..3 {
            (x[2 * k + 1], x[2 * k + 2]) = (wave[0], wave[1]);
            wave = product(wave, turn);
        }
        for a in 0..TERMS {
            for b in 0..TERMS {
                normal[a][b] += x[a] * x[b];
            }
            right[a] += x[a] * m_ac;
        }
    }
    let means: Vec<f64> = planes
        .iter()
        .map(|p| p.iter().map(|&v| f64::from(v)).filter(|v| v.is_finite()).sum::<f64>() / n as f64)
        .collect();
    let mean = means.iter().sum::<f64>() / means.len() as f64;
    let wave = solve(normal, right, 1e-6 * count as f64)?;
    if wave[0] <= 0.0 || mean <= 0.0 {
        return None;
    }
    let of =
        |k: usize| 100.0 * (wave[2 * k + 1] * wave[2 * k + 1] + wave[2 * k + 2] * wave[2 * k + 2]).sqrt() / wave[0];
    let ripple = [of(0), of(1), of(2)];
    let drift = means.iter().map(|m| 100.0 * (m / mean - 1.0).abs()).fold(0.0, f64::max);
    Some(Diagnosis { ripple, drift })
}

/// The mean and three waves.
const TERMS: usize = 7;

/// Gauss-Jordan without a choice of pivots, for a symmetric positive matrix; `None` where a pivot is not above `least`.
fn solve(mut a: [[f64; TERMS]; TERMS], mut b: [f64; TERMS], least: f64) -> Option<[f64; TERMS]> {
    for k in 0..TERMS {
        let pivot = a[k][k];
        if pivot.is_nan() || pivot <= least {
            return None;
        }
        for i in (0..TERMS).filter(|&i| i != k) {
            let (factor, row) = (a[i][k] / pivot, a[k]);
            a[i].iter_mut().zip(row).for_each(|(a, row)| *a -= factor * row);
            b[i] -= factor * b[k];
        }
    }
    Some(std::array::from_fn(|k| b[k] / a[k][k]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    fn of(steps: usize, value: impl Fn(f64, usize) -> f64) -> Diagnosis {
        let phases: Vec<f64> = (0..steps).map(|k| TAU * k as f64 / steps as f64).collect();
        let frame =
            |k: usize| -> Vec<f32> { (0..5000).map(|i| value(TAU * i as f64 / 50.0 + phases[k], k) as f32).collect() };
        let frames: Vec<Vec<f32>> = (0..steps).map(frame).collect();
        let frames: Vec<&[f32]> = frames.iter().map(Vec::as_slice).collect();
        diagnose(&frames, &Weights::least_squares(&phases).unwrap()).unwrap()
    }

    /// Clean fringes have no ripple; a frame that is 2 % brighter shows as drift and as ripple once and twice a period; a second harmonic
    /// of amplitude h turns up thrice a period with h / M_AC under three steps, and not at all under four.
    #[test]
    fn each_fault_has_its_ripple() {
        let clean = of(3, |a, _| 0.5 + 0.3 * libm::cos(a));
        assert!(clean.ripple.iter().all(|&r| r < 1e-4) && clean.drift < 1e-4, "{clean:?}");
        let drifting = of(3, |a, k| (0.5 + 0.3 * libm::cos(a)) * if k == 1 { 1.02 } else { 1.0 });
        // A gain of 1 + e in one frame: (2/3) e M_DC in the phasor, so 200/3 e M_DC / M_AC percent, and drift 2/3 e.
        assert!((drifting.ripple[0] / (200.0 / 3.0 * 0.02 * 0.5 / 0.3) - 1.0).abs() < 0.02, "{drifting:?}");
        assert!((drifting.drift / (100.0 * 0.02 * 2.0 / 3.0) - 1.0).abs() < 0.02);
        let harmonic = |steps| of(steps, |a, _| 0.5 + 0.3 * libm::cos(a) + 0.006 * libm::cos(2.0 * a));
        assert!((harmonic(3).ripple[2] - 2.0).abs() < 0.02, "{:?}", harmonic(3));
        assert!(harmonic(4).ripple.iter().all(|&r| r < 1e-4));
    }
}
