//! Phase steps that nobody knows exactly: found from the frames themselves, pixels and steps by least squares in turns.
//!
//! Source: Wang, Han, "Advanced iterative algorithm for phase extraction of randomly phase-shifted interferograms", Opt. Lett. 29,
//! 1671 (2004). There background and contrast are the same for all pixels; here each pixel is divided by its own mean first, so that only
//! changes of the contrast that go with the fringe's phase are mistaken for steps. They average out over many fringes.

use std::f64::consts::{PI, TAU};

use crate::phase_shift::Weights;

/// Pixels that are looked at: a lattice of at most so many.
const MOST_PIXELS: usize = 1 << 16;

/// Rounds that are tried; some 10 to 200 are needed.
const ROUNDS: usize = 2000;

/// The largest change of a step in the last round, rad.
const SETTLED: f64 = 1e-9;

/// The steps of `frames` (planes of one length), rad, near those of `start`. The first is that of `start`: a common
/// shift of all steps is a shift of the phase. Frames with all steps reversed would be the same with the phase reversed: `start` decides.
///
/// Errors: fewer than three frames, a start that fixes no sinusoid, pixels that show too little of a period, steps that do not settle.
pub fn find(frames: &[&[f32]], start: &[f64]) -> Result<Vec<f64>, String> {
    let pixels = frames.first().map_or(0, |f| f.len());
    let lattice = pixels.div_ceil(MOST_PIXELS).max(1);
    let good = |i: &usize| frames.iter().all(|f| f[*i].is_finite());
    let chosen: Vec<usize> = (0..pixels).step_by(lattice).filter(good).collect();
    let planes: Vec<Vec<f32>> = frames.iter().map(|f| chosen.iter().map(|&i| f[i]).collect()).collect();
    let planes: Vec<&[f32]> = planes.iter().map(Vec::as_slice).collect();
    let mut steps = start.to_vec();
    let mut linear = [vec![0.0; chosen.len()], vec![0.0; chosen.len()], vec![0.0; chosen.len()]];
    for _ in 0..ROUNDS {
        let weights = Weights::least_squares(&steps).ok_or_else(|| {
            format!("{} steps ({steps:?} rad) fix no sinusoid: three or more must differ", steps.len())
        })?;
        if chosen.is_empty() {
            return Err("the frames have no finite pixels".into());
        }
        weights.apply(&planes, &mut linear);
        let mut next = of_phases(&planes, &linear)?;
        let shift = start[0] - next[0];
        next.iter_mut().for_each(|d| *d += shift);
        let change = next.iter().zip(&steps).map(|(a, b)| wrap(a - b).abs()).fold(0.0, f64::max);
        steps = steps.iter().zip(&next).map(|(old, new)| old + wrap(new - old)).collect();
        if change < SETTLED {
            return Ok(steps);
        }
    }
    Err(format!("the steps do not settle in {ROUNDS} rounds; the last are {steps:?} rad"))
}

/// Each frame's step from the pixels' phases: frame / dc = 1 + c cos(phi) - s sin(phi) over all pixels, step = atan2(s, c).
fn of_phases(planes: &[&[f32]], [dc, re, im]: &[Vec<f64>; 3]) -> Result<Vec<f64>, String> {
    // Sums of (1, cos, sin) x (1, cos, sin), and of (1, cos, sin) x each frame.
    let (mut normal, mut right) = ([[0.0; 3]; 3], vec![[0.0; 3]; planes.len()]);
    for i in 0..dc.len() {
        let m_ac = (re[i] * re[i] + im[i] * im[i]).sqrt();
        if !(dc[i] > 0.0 && m_ac > f64::from(f32::EPSILON) * dc[i]) {
            continue;
        }
        let x = [1.0, re[i] / m_ac, im[i] / m_ac];
        for (row, a) in normal.iter_mut().zip(x) {
            row.iter_mut().zip(x).for_each(|(sum, b)| *sum += a * b);
        }
        for (right, plane) in right.iter_mut().zip(planes) {
            let value = f64::from(plane[i]) / dc[i];
            right.iter_mut().zip(x).for_each(|(sum, a)| *sum += a * value);
        }
    }
    let inverse =
        inverted(normal, 0.01).ok_or("the pixels show too little of a period of the fringe to tell steps from them")?;
    let of = |row: usize, right: &[f64; 3]| -> f64 { inverse[row].iter().zip(right).map(|(a, b)| a * b).sum() };
    Ok(right.iter().map(|right| turbid_optics::elementary::atan2(-of(2, right), of(1, right))).collect())
}

/// The inverse of a symmetric matrix of sums over (1, cos, sin); `None` where its determinant is not above `share` of what evenly spread phases
/// have, n^3 / 4.
pub fn inverted(m: [[f64; 3]; 3], share: f64) -> Option<[[f64; 3]; 3]> {
    let minor = |r: usize, c: usize| {
        let [a, b] = [(r + 1) % 3, (r + 2) % 3];
        let [d, e] = [(c + 1) % 3, (c + 2) % 3];
        m[a][d] * m[b][e] - m[a][e] * m[b][d]
    };
    let det: f64 = (0..3).map(|c| m[0][c] * minor(0, c)).sum();
    let even = m[0][0] * m[0][0] * m[0][0] / 4.0;
    (det > share * even && even > 0.0).then(|| [0, 1, 2].map(|r| [0, 1, 2].map(|c| minor(c, r) / det)))
}

fn wrap(angle: f64) -> f64 {
    let rest = angle - TAU * (angle / TAU).round();
    if rest <= -PI { rest + TAU } else { rest }
}

#[cfg(test)]
mod tests {
    use super::*;
    use turbid_optics::philox::{key, philox4x32, unit};

    const N: usize = 4000;

    /// Frames with these steps over `periods` fringes; background and contrast vary by `varies`, noise is of the background's unit.
    fn frames(steps: &[f64], periods: f64, varies: f64, noise: f64) -> Vec<Vec<f32>> {
        let of = |(k, d): (usize, &f64)| -> Vec<f32> {
            let value = |i: usize| {
                let x = i as f64 / N as f64;
                let dc = 1.0 + varies * libm::sin(7.0 * x);
                let m_ac = 0.4 * dc * (1.0 + varies * libm::cos(5.0 * x));
                let [a, b, ..] = philox4x32([i as u32, k as u32, 0, 0], key(3));
                let normal = (-2.0 * libm::log(unit(a))).sqrt() * libm::cos(TAU * unit(b));
                (dc + m_ac * libm::cos(TAU * periods * x + 0.3 + d) + noise * normal) as f32
            };
            (0..N).map(value).collect()
        };
        steps.iter().enumerate().map(of).collect()
    }

    fn worst(found: &[f64], steps: &[f64]) -> f64 {
        found.iter().zip(steps).map(|(a, b)| wrap(a - b).abs()).fold(0.0, f64::max)
    }

    fn look(frames: &[Vec<f32>], start: &[f64]) -> Result<Vec<f64>, String> {
        find(&frames.iter().map(Vec::as_slice).collect::<Vec<_>>(), start)
    }

    fn equal(n: usize) -> Vec<f64> {
        (0..n).map(|k| TAU * k as f64 / n as f64).collect()
    }

    /// Steps that are up to 0.5 rad off come back: exactly (f32 frames) where background and contrast are even, within some 0.01 rad where both
    /// vary by 30 % over 20 fringes, and more than twice as near over 20 fringes as over 6.
    #[test]
    fn steps_come_back() {
        for off in [vec![0.0, 0.3, -0.4], vec![0.0, 0.5, -0.2, 0.1], vec![0.0, -0.1, 0.05, 0.4, -0.3]] {
            let start = equal(off.len());
            let steps: Vec<f64> = start.iter().zip(&off).map(|(a, b)| a + b).collect();
            let error = |periods: f64, varies: f64| {
                worst(&look(&frames(&steps, periods, varies, 0.0), &start).unwrap(), &steps)
            };
            assert!(error(6.0, 0.0) < 1e-6, "{steps:?}: {}", error(6.0, 0.0));
            let (few, many) = (error(6.0, 0.3), error(20.0, 0.3));
            assert!(many < 0.01 && many < 0.5 * few, "{steps:?}: {few} over 6 fringes, {many} over 20");
        }
    }

    /// White noise sigma: a step is known to sqrt(2 / pixels) sigma / M_AC from its own frame; what the pixels' phases do not know makes it some times that.
    #[test]
    fn noise_averages_out() {
        let (start, steps) = (equal(4), [0.0, 1.9, 3.0, 4.9]);
        let found = look(&frames(&steps, 8.0, 0.0, 0.02), &start).unwrap();
        let alone = (2.0 / N as f64).sqrt() * 0.02 / 0.4;
        assert!(worst(&found, &steps) < 10.0 * alone, "{} for {alone}", worst(&found, &steps));
    }

    /// The start decides the sign: from reversed steps the reversed ones are found. What tells no steps says so.
    #[test]
    fn signs_are_the_starts_and_nothing_is_guessed() {
        let steps = [0.0, 2.2, 4.0];
        let reversed = look(&frames(&steps, 9.0, 0.0, 0.0), &[0.0, -2.0, -4.1]).unwrap();
        assert!(worst(&reversed, &steps.map(|d| -d)) < 1e-6, "{reversed:?}");
        let fails = |frames: &[Vec<f32>], start: &[f64]| look(frames, start).unwrap_err();
        assert!(fails(&frames(&steps, 0.05, 0.0, 0.0), &equal(3)).contains("too little of a period"));
        assert!(fails(&frames(&steps[..2], 9.0, 0.0, 0.0), &[0.0, 2.0]).contains("fix no sinusoid"));
        assert!(fails(&vec![vec![f32::NAN; 9]; 3], &equal(3)).contains("no finite pixels"));
        assert!(fails(&vec![vec![1.0; 9]; 3], &equal(3)).contains("too little of a period"));
    }
}
