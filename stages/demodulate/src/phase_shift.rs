//! N-phase demodulation: the least-squares sinusoid through N frames whose phase steps are known.
//!
//! frame_n = dc + re cos(d_n) - im sin(d_n), so that M_DC = dc, M_AC = |re + i im| and phi = arg(re + i im).

use turbid_optics::sinusoid;

/// Linear weights that turn the N frames of one spatial frequency into (dc, re, im).
#[derive(Clone, Debug, PartialEq)]
pub struct Weights {
    /// `weights[q][n]` for q = dc, re, im. dc sums to `level`, re and im to 0.
    pub weights: [Vec<f64>; 3],
    /// What of a constant in all frames is in dc: 1, and 0 where dc is an amplitude ([`Self::amplitude`]).
    level: f64,
}

impl Weights {
    /// Weights for the steps `phases_rad`: with N equal steps dc is the mean and re + i im = (2/N) sum I_n e^{-i d_n}.
    ///
    /// `None` where the steps do not fix a sinusoid: fewer than three phases that differ modulo 2 pi.
    pub fn least_squares(phases_rad: &[f64]) -> Option<Self> {
        let weights = sinusoid::weights(phases_rad)?;
        Some(Self { weights, level: 1.0 })
    }

    /// Weights for frames without a fringe (f_x = 0) whose light is stepped as (1 + cos(d_n + `turn_rad`)) / 2: dc is the amplitude of the
    /// steps, free of black level and room light; re and im stay 0. With them the weights of what is left of the mean: that light.
    pub fn amplitude(phases_rad: &[f64], turn_rad: f64) -> Option<(Self, Vec<f64>)> {
        let [mean, re, im] = sinusoid::weights(phases_rad)?;
        let (sin, cos) = (libm::sin(turn_rad), libm::cos(turn_rad));
        let amplitude: Vec<f64> = re.iter().zip(&im).map(|(re, im)| cos * re + sin * im).collect();
        let ambient = mean.iter().zip(&amplitude).map(|(mean, amplitude)| mean - amplitude).collect();
        let none = vec![0.0; phases_rad.len()];
        Some((Self { weights: [amplitude, none.clone(), none], level: 0.0 }, ambient))
    }

    /// Weights for `n` equal frames without a fringe (f_x = 0): their mean; re and im stay 0.
    pub fn mean(n: usize) -> Self {
        Self { weights: [vec![1.0 / n as f64; n], vec![0.0; n], vec![0.0; n]], level: 1.0 }
    }

    /// The dc of each pixel alone; same bits as [`Self::apply`].
    pub fn mean_of(&self, frames: &[&[f32]], out: &mut [f32]) {
        for (i, out) in out.iter_mut().enumerate() {
            let base = f64::from(frames[0][i]);
            let steps = frames.iter().zip(&self.weights[0]).skip(1);
            let first = self.level * base;
            *out = steps.fold(first, |sum, (frame, weight)| sum + weight * (f64::from(frame[i]) - base)) as f32;
        }
    }

    /// (dc, re, im) of each pixel; `frames` are N planes of one length, `out` three of that length.
    ///
    /// Works on differences to the first frame, which are exact in f64 for f32 frames: constants give re = im = 0
    /// exactly, and no digits are lost where M_AC << M_DC.
    pub fn apply(&self, frames: &[&[f32]], out: &mut [Vec<f64>; 3]) {
        let first = frames[0];
        let [dc, re, im] = out;
        for ((dc, (re, im)), &base) in dc.iter_mut().zip(re.iter_mut().zip(im.iter_mut())).zip(first) {
            (*dc, *re, *im) = (self.level * f64::from(base), 0.0, 0.0);
        }
        for (n, frame) in frames.iter().enumerate().skip(1) {
            let [a, b, c] = [self.weights[0][n], self.weights[1][n], self.weights[2][n]];
            for ((dc, (re, im)), (&base, &value)) in
                dc.iter_mut().zip(re.iter_mut().zip(im.iter_mut())).zip(first.iter().zip(*frame))
            {
                let step = f64::from(value) - f64::from(base);
                *dc += a * step;
                *re += b * step;
                *im += c * step;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    fn demodulate(phases: &[f64], frames: &[f32]) -> [f64; 3] {
        let weights = Weights::least_squares(phases).expect("the steps fix a sinusoid");
        let planes: Vec<&[f32]> = frames.chunks(1).collect();
        let mut out = [vec![0.0], vec![0.0], vec![0.0]];
        weights.apply(&planes, &mut out);
        out.map(|v| v[0])
    }

    fn equal_steps(n: usize) -> Vec<f64> {
        (0..n).map(|k| 2.0 * PI * k as f64 / n as f64).collect()
    }

    /// Equal and unequal steps give back the sinusoid; the tolerance is the rounding of the frames to f32,
    /// at most 2^-24 (dc + ac) each, times the 1-norm of the weights.
    #[test]
    fn a_sinusoid_comes_back() {
        let mut step_sets: Vec<Vec<f64>> = (3..13).map(equal_steps).collect();
        step_sets.push(vec![0.3, 1.9, 4.0]);
        step_sets.push(vec![-7.0, 0.1, 2.0, 2.1, 5.5]);
        for phases in &step_sets {
            for (dc, ac, phi) in [(0.5, 0.25, 0.4), (1.0, 1e-6, -2.0), (1e4, 1e-2, 3.0), (0.0, 1.0, 0.0)] {
                let frames: Vec<f32> = phases.iter().map(|d| (dc + ac * libm::cos(phi + d)) as f32).collect();
                let got = demodulate(phases, &frames);
                let want = [dc, ac * libm::cos(phi), ac * libm::sin(phi)];
                let weights = Weights::least_squares(phases).unwrap().weights;
                for q in 0..3 {
                    let norm: f64 = weights[q].iter().map(|w| w.abs()).sum();
                    let tolerance = (2.0_f64.powi(-24) + 1e-15) * (dc + ac) * norm;
                    assert!((got[q] - want[q]).abs() <= tolerance, "{phases:?} {dc} {ac}: {got:?} for {want:?}");
                }
            }
        }
    }

    /// The three-phase amplitude formula, (sqrt 2 / 3) sqrt((I1-I2)^2 + (I2-I3)^2 + (I3-I1)^2), to 8 ulp.
    #[test]
    fn three_equal_steps_are_the_known_formula() {
        for frames in [[0.2_f32, 0.7, 0.4], [1.0, 1.0 + f32::EPSILON, 1.0], [1e4, 1e4, 9999.5]] {
            let [a, b, c] = frames.map(f64::from);
            let known = 2.0_f64.sqrt() / 3.0 * ((a - b).powi(2) + (b - c).powi(2) + (c - a).powi(2)).sqrt();
            let [dc, re, im] = demodulate(&equal_steps(3), &frames);
            assert!(((re * re + im * im).sqrt() / known - 1.0).abs() < 2e-15, "{frames:?}");
            assert!((dc / ((a + b + c) / 3.0) - 1.0).abs() < 1e-15);
        }
    }

    /// Constants have no fringe, to the last bit.
    #[test]
    fn constant_frames_have_exactly_no_fringe() {
        for n in 3..9 {
            assert_eq!(demodulate(&equal_steps(n), &vec![0.1_f32; n]), [f64::from(0.1_f32), 0.0, 0.0]);
        }
    }

    /// N equal steps reject every harmonic m but m = jN +- 1.
    #[test]
    fn harmonics_are_rejected_as_the_theory_says() {
        for n in 3..9_usize {
            for m in 2..12_usize {
                let frames: Vec<f32> = equal_steps(n).iter().map(|d| libm::cos(m as f64 * d) as f32).collect();
                let [_, re, im] = demodulate(&equal_steps(n), &frames);
                let leaks = m % n == 1 || m % n == n - 1;
                let amplitude = (re * re + im * im).sqrt();
                assert!(if leaks { (amplitude - 1.0).abs() < 1e-6 } else { amplitude < 1e-6 }, "N = {n}, m = {m}");
            }
        }
    }

    /// Two phases, repeated phases, or steps a whole turn apart fix no sinusoid.
    #[test]
    fn steps_that_fix_no_sinusoid_are_refused() {
        for phases in [vec![], vec![0.0, 2.0], vec![0.0, 2.0, 2.0], vec![0.0, 1.0, 2.0 * PI], vec![0.0, 1e-4, 2e-4]] {
            assert_eq!(Weights::least_squares(&phases), None, "{phases:?}");
        }
    }
}
