//! One sweep over the frames of a fringe in vector lanes: frames in; M_DC, M_AC and, if wanted, the phase out.
//!
//! The arithmetic is that of [`Weights::apply`], bit for bit: differences to the first frame, in f64.

use fearless_simd::{Level, Simd, dispatch};
use turbid_optics::elementary::atan2;

use crate::phase_shift::Weights;

/// What a sweep writes: planes of one length, that of the frames. `phase` may be empty: then nobody wants it.
pub struct Planes<'a> {
    pub m_dc: &'a mut [f32],
    pub m_ac: &'a mut [f32],
    pub phase: &'a mut [f32],
}

/// M_DC, M_AC (and phase) of one fringe; frames and planes have one length.
pub fn amplitudes(level: Level, frames: &[&[f32]], weights: &Weights, mut out: Planes<'_>) {
    match frames.len() {
        3 => steps::<3>(level, frames, weights, &mut out),
        4 => steps::<4>(level, frames, weights, &mut out),
        5 => steps::<5>(level, frames, weights, &mut out),
        6 => steps::<6>(level, frames, weights, &mut out),
        8 => steps::<8>(level, frames, weights, &mut out),
        _ => {
            let mut linear = [const { Vec::new() }; 3].map(|v: Vec<f64>| v);
            linear.iter_mut().for_each(|v| v.resize(out.m_dc.len(), 0.0));
            weights.apply(frames, &mut linear);
            let [dc, re, im] = &linear;
            dispatch!(level, simd => simd.vectorize(#[inline(always)] || {
                for i in 0..dc.len() {
                    out.m_dc[i] = dc[i] as f32;
                    out.m_ac[i] = (re[i] * re[i] + im[i] * im[i]).sqrt() as f32;
                }
            }));
            phases(level, re, im, out.phase);
        }
    }
}

/// The angle of each (re, im); an empty plane wants none.
pub fn phases(level: Level, re: &[f64], im: &[f64], phase: &mut [f32]) {
    dispatch!(level, simd => simd.vectorize(#[inline(always)] || {
        for ((phase, re), im) in phase.iter_mut().zip(re).zip(im) {
            *phase = atan2(*im, *re) as f32;
        }
    }));
}

/// Pixels worked on side by side.
const LANES: usize = 16;

fn steps<const N: usize>(level: Level, frames: &[&[f32]], weights: &Weights, out: &mut Planes<'_>) {
    let w: [[f64; N]; 3] = std::array::from_fn(|q| std::array::from_fn(|k| weights.weights[q][k]));
    let n = out.m_dc.len();
    let frames: [&[f32]; N] = std::array::from_fn(|k| &frames[k][..n]);
    let whole: [&[[f32; LANES]]; N] = frames.map(|f| f.as_chunks().0);
    let wanted = !out.phase.is_empty();
    let (dc_blocks, dc_rest) = out.m_dc.as_chunks_mut();
    let (ac_blocks, ac_rest) = out.m_ac.as_chunks_mut();
    let (phase_blocks, phase_rest) = out.phase.as_chunks_mut();
    if wanted {
        dispatch!(level, simd => simd.vectorize(#[inline(always)] || {
            for (b, (dc, ac)) in dc_blocks.iter_mut().zip(ac_blocks).enumerate() {
                block_with_phase(whole.map(|f| &f[b]), &w, dc, ac, &mut phase_blocks[b]);
            }
        }));
    } else {
        dispatch!(level, simd => simd.vectorize(#[inline(always)] || {
            for (b, (dc, ac)) in dc_blocks.iter_mut().zip(ac_blocks).enumerate() {
                block(whole.map(|f| &f[b]), &w, dc, ac);
            }
        }));
    }
    // What is left over fills one more block.
    let (rest, start) = (dc_rest.len(), n - dc_rest.len());
    if rest > 0 {
        let padded: [[f32; LANES]; N] = frames.map(|f| {
            let mut lanes = [0.0; LANES];
            lanes[..rest].copy_from_slice(&f[start..]);
            lanes
        });
        let (mut dc, mut ac, mut phase) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
        block_with_phase(std::array::from_fn(|k| &padded[k]), &w, &mut dc, &mut ac, &mut phase);
        dc_rest.copy_from_slice(&dc[..rest]);
        ac_rest.copy_from_slice(&ac[..rest]);
        phase_rest.copy_from_slice(&phase[..phase_rest.len()]);
    }
}

#[inline(always)]
fn block<const N: usize>(
    frames: [&[f32; LANES]; N],
    w: &[[f64; N]; 3],
    m_dc: &mut [f32; LANES],
    m_ac: &mut [f32; LANES],
) -> [[f64; LANES]; 2] {
    let base = frames[0].map(f64::from);
    let (mut dc, mut re, mut im) = (base, [0.0; LANES], [0.0; LANES]);
    for k in 1..N {
        for l in 0..LANES {
            let step = f64::from(frames[k][l]) - base[l];
            dc[l] += w[0][k] * step;
            re[l] += w[1][k] * step;
            im[l] += w[2][k] * step;
        }
    }
    for l in 0..LANES {
        m_dc[l] = dc[l] as f32;
        m_ac[l] = (re[l] * re[l] + im[l] * im[l]).sqrt() as f32;
    }
    [re, im]
}

#[inline(always)]
fn block_with_phase<const N: usize>(
    frames: [&[f32; LANES]; N],
    w: &[[f64; N]; 3],
    m_dc: &mut [f32; LANES],
    m_ac: &mut [f32; LANES],
    phase: &mut [f32; LANES],
) {
    let [re, im] = block(frames, w, m_dc, m_ac);
    for l in 0..LANES {
        phase[l] = atan2(im[l], re[l]) as f32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::level::named;

    /// Every level of vector instructions and every number of steps gives the bits of `Weights::apply`.
    #[test]
    fn lanes_compute_what_the_reference_does() {
        for steps in 3..10_usize {
            let phases: Vec<f64> = (0..steps).map(|k| 6.0 * k as f64 / steps as f64).collect();
            let weights = Weights::least_squares(&phases).unwrap();
            let length = 61;
            let frame = |k: usize| -> Vec<f32> {
                let value = |i: usize| 0.7 + 0.3_f64.powi(i as i32 % 19) * libm::cos(0.4 * i as f64 + phases[k]);
                (0..length).map(|i| value(i) as f32).collect()
            };
            let frames: Vec<Vec<f32>> = (0..steps).map(frame).collect();
            let frames: Vec<&[f32]> = frames.iter().map(Vec::as_slice).collect();
            let mut linear = [vec![0.0; length], vec![0.0; length], vec![0.0; length]];
            weights.apply(&frames, &mut linear);
            for level in ["baseline", "v3", ""].map(named) {
                let mut planes = [vec![0.0; length], vec![0.0; length], vec![0.0; length]];
                let [m_dc, m_ac, phase] = &mut planes;
                amplitudes(level, &frames, &weights, Planes { m_dc, m_ac, phase });
                for i in 0..length {
                    let [dc, re, im] = [0, 1, 2].map(|q| linear[q][i]);
                    let want = [dc, (re * re + im * im).sqrt(), atan2(im, re)].map(|v| v as f32);
                    assert_eq!([0, 1, 2].map(|q| planes[q][i]), want, "N = {steps}, pixel {i}");
                }
            }
        }
    }
}
