//! Whether what the projector shows in N phases is a sinusoid of a smooth phase.

use glam::DVec2;

/// Where a fringe has less contrast than this it says little of its phase.
pub const LEAST_CONTRAST: f64 = 0.1;
/// What is a sinusoid but for the rounding of its values to eight bits ripples by less.
const MOST_RIPPLE: f64 = 0.01;
/// What is dithered is off by more, down to the end of a tube a fringe that is uniform there by less.
const MOST_UNEVEN: f64 = 0.25;

/// How far the images of a fringe are from sinusoids.
#[derive(Clone, Copy, Debug)]
pub struct FringeShape {
    /// Part by which mean and contrast go up and down with N times the phase: in N phases the harmonics N - 1, N and N + 1 look like the mean and the first one.
    ripple: f64,
    /// Mean of |z^2 - z_before z_after| / |z|^2 over rows and columns: a phase that goes on evenly from pixel to pixel gives 0, one that leaps by an angle as much in rad.
    unevenness: f64,
}

impl FringeShape {
    /// Of images of so many rows and columns in `phases` phases. `at` (row, column): contrast x e^{i phase} of the fringe, and its mean over 1/2. Pixels without contrast
    /// count for nothing.
    pub fn of([rows, columns]: [usize; 2], phases: usize, at: impl Fn(usize, usize) -> (DVec2, f64)) -> Self {
        let power = |z: DVec2| {
            let unit = z / z.length();
            (1..phases).fold(unit, |power, _| power.rotate(unit))
        };
        let has_contrast = |z: DVec2| z.length() >= LEAST_CONTRAST;
        // Of mean and contrast: steps from pixel to pixel times those of e^{i N phase}, which a slow change has no part in, and the values.
        let (mut modulated, mut values, mut count) = ([DVec2::ZERO; 2], [0.0; 2], 0.0);
        let (mut of_powers, mut off, mut threes) = (0.0, 0.0, 0.0);
        for (row, column) in (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column))) {
            let (here, mean) = at(row, column);
            if !has_contrast(here) {
                continue;
            }
            values = [values[0] + mean, values[1] + here.length()];
            count += 1.0;
            let next = [(row, column + 1), (row + 1, column)].into_iter().filter(|&(r, c)| r < rows && c < columns);
            for (r, c) in next {
                let (after, mean_after) = at(r, c);
                if has_contrast(after) {
                    let step = power(after) - power(here);
                    of_powers += step.length_squared();
                    modulated[0] += (mean_after - mean) * step;
                    modulated[1] += (after.length() - here.length()) * step;
                }
                // The pixel as far on the other side.
                if let (Some(r), Some(c)) = ((2 * row).checked_sub(r), (2 * column).checked_sub(c)) {
                    off += (here.rotate(here) - at(r, c).0.rotate(after)).length() / here.length_squared();
                    threes += 1.0;
                }
            }
        }
        let part = |sum: f64, of: f64| if of > 0.0 { sum / of } else { 0.0 };
        // By 1 + a cos(N phase): steps times those of the cosine are half of what they are times e^{i N phase}.
        let ripple = |k: usize| 2.0 * part(part(modulated[k].length(), of_powers), part(values[k], count));
        Self { ripple: ripple(0).max(ripple(1)), unevenness: part(off, threes) }
    }

    /// Why they are no sinusoids, if they are none.
    pub fn refusal(self) -> Option<String> {
        if self.ripple > MOST_RIPPLE {
            return Some(format!("mean or contrast ripples by {:.1} % with the phase", 100.0 * self.ripple));
        }
        (self.unevenness > MOST_UNEVEN)
            .then(|| format!("from pixel to pixel the phase leaps by {:.2} rad", self.unevenness))
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;

    const SIDE: usize = 96;

    /// Of images of `value`(row, column, phase) in N even phases, by the N-phase formulas.
    fn shape(phases: usize, value: impl Fn(usize, usize, f64) -> f64) -> FringeShape {
        FringeShape::of([SIDE, SIDE], phases, |row, column| {
            let (mut z, mut mean) = (DVec2::ZERO, 0.0);
            for k in 0..phases {
                let phase = TAU * k as f64 / phases as f64;
                let v = value(row, column, phase);
                z += 4.0 / phases as f64 * v * DVec2::new(phase.cos(), -phase.sin());
                mean += 2.0 / phases as f64 * v;
            }
            (z, mean)
        })
    }

    /// A chirp whose period falls from 20 to 5 pixels, darker to one side.
    fn chirp(column: usize, phase: f64) -> f64 {
        let x = column as f64 / SIDE as f64;
        (1.0 - 0.3 * x) * 0.5 * (1.0 + 0.9 * (TAU * SIDE as f64 * (x / 20.0 + 0.075 * x * x) + phase).cos())
    }

    /// Sinusoids are taken, in eight bits and with a period that changes; square waves of 3 and 4 phases, a screen of gamma 1.2 and dithered ones are not, though
    /// each pixel for itself is a sinusoid of its phases.
    #[test]
    fn only_sinusoids_are_taken() {
        for phases in [3, 4, 5] {
            assert_eq!(shape(phases, |_, column, phase| chirp(column, phase)).refusal(), None, "{phases}");
            let rounded = |_, column, phase| (255.0 * chirp(column, phase)).round() / 255.0;
            assert_eq!(shape(phases, rounded).refusal(), None, "{phases}, eight bits");
        }
        let square = |_: usize, column: usize, phase: f64| {
            f64::from(u8::from((TAU * column as f64 / 16.0 + phase + 0.1).sin() > 0.0))
        };
        for phases in [3, 4] {
            let refused = shape(phases, square).refusal().expect("it has harmonics");
            assert!(refused.contains("ripples"), "{phases}: {refused}");
        }
        let screen = shape(3, |_, column, phase| chirp(column, phase).powf(1.2)).refusal();
        assert!(screen.expect("it has a second harmonic").contains("ripples"));
        // Bayer's order of thresholds.
        let order = [[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]];
        let threshold = |row: usize, column: usize| (f64::from(order[row % 4][column % 4]) + 0.5) / 16.0;
        let dithered = |row, column, phase| f64::from(u8::from(chirp(column, phase) > threshold(row, column)));
        assert!(shape(3, dithered).refusal().is_some());
    }
}
