//! Several pixels at a time, each in a lane of its own: bit for bit what [`Mixture::unmix`] makes of each, where the noise is known and nothing is held at 0.

use fearless_simd::{Level, Simd, dispatch};

use crate::least_squares::MOST;

use super::{Mixture, Unmixed};

/// Pixels at a time.
pub const LANES: usize = 8;
/// A number of each pixel.
pub type Lanes = [f64; LANES];

/// What a sum begins with: nothing, whatever the sign of what follows.
const NOTHING: Lanes = [-0.0; LANES];

/// Memory that is used again.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    /// Columns and behind them the right-hand side, whitened; then what is left of them.
    columns: Vec<Lanes>,
}

/// A problem of each lane, solved: Q R, and what follows of it.
struct Solved {
    r: [[Lanes; MOST]; MOST],
    amounts: [Lanes; MOST],
    covariance: [[Lanes; MOST]; MOST],
    rest: Lanes,
    residual: Lanes,
    /// Which of them are solved.
    is_good: [bool; LANES],
}

impl Mixture {
    /// What [`unmix`](Self::unmix) makes of pixels with independent errors `se` of `mu_a` (mm^-1), wavelength by wavelength. `None`: for `unmix` to say, as of
    /// values that are not finite, errors that are not above 0, and where a free solution is negative that may not be.
    pub fn unmix_lanes(
        &self,
        level: Level,
        mu_a: &[Lanes],
        se: &[Lanes],
        non_negative: bool,
        scratch: &mut Scratch,
    ) -> [Option<Unmixed>; LANES] {
        let solved = dispatch!(level, simd => simd.vectorize(#[inline(always)] || self.solve(mu_a, se, scratch)));
        std::array::from_fn(|lane| {
            let finite =
                mu_a.iter().zip(se).all(|(v, se)| v[lane].is_finite() && se[lane].is_finite() && se[lane] > 0.0);
            let of = |row: &[Lanes; MOST]| -> [f64; MOST] { std::array::from_fn(|k| row[k][lane]) };
            let scaled = of(&solved.amounts);
            let negative = non_negative && scaled[..self.count].iter().any(|&x| x < 0.0);
            (finite && solved.is_good[lane] && !negative).then(|| Unmixed {
                amounts: std::array::from_fn(|k| if k < self.count { scaled[k] / self.norm[k] } else { 0.0 }),
                covariance: Some(std::array::from_fn(|i| of(&solved.covariance[i]))),
                chi2: Some(solved.rest[lane] + 0.0),
                residual: solved.residual[lane],
                held: 0,
            })
        })
    }

    #[inline(always)]
    fn solve(&self, mu_a: &[Lanes], se: &[Lanes], scratch: &mut Scratch) -> Solved {
        let Self { rows, count, .. } = *self;
        let columns = &mut scratch.columns;
        columns.clear();
        columns.resize((count + 1) * rows, [0.0; LANES]);
        for i in 0..rows {
            let per = each(|l| 1.0 / se[i][l]);
            for k in 0..count {
                let value = self.columns[k * rows + i];
                columns[k * rows + i] = each(|l| value * per[l]);
            }
            columns[count * rows + i] = each(|l| mu_a[i][l] * per[l]);
        }
        let mut solved = Solved {
            r: [[[0.0; LANES]; MOST]; MOST],
            amounts: [[0.0; LANES]; MOST],
            covariance: [[[0.0; LANES]; MOST]; MOST],
            rest: [0.0; LANES],
            residual: [0.0; LANES],
            is_good: [true; LANES],
        };
        let rhs = solved.factorise(columns, rows, count);
        solved.amounts = solved.backwards(count, &rhs);
        solved.covariance(count);
        for i in 0..count {
            for k in 0..count {
                let scale = self.norm[i] * self.norm[k];
                solved.covariance[i][k] = each(|l| solved.covariance[i][k][l] / scale);
            }
        }
        let mut squares = NOTHING;
        for (i, mu_a) in mu_a.iter().enumerate() {
            let mut explained = NOTHING;
            for k in 0..count {
                let column = self.columns[k * rows + i];
                explained = each(|l| explained[l] + column * solved.amounts[k][l]);
            }
            let residual = each(|l| mu_a[l] - explained[l]);
            squares = each(|l| squares[l] + residual[l] * residual[l]);
        }
        let rows = rows as f64;
        solved.residual = each(|l| (squares[l] / rows).sqrt());
        solved
    }
}

impl Solved {
    /// As [`factorise`](crate::least_squares::factorise); the right-hand side in Q's directions.
    #[inline(always)]
    fn factorise(&mut self, columns: &mut [Lanes], rows: usize, count: usize) -> [Lanes; MOST] {
        let mut rhs = [[0.0; LANES]; MOST];
        for j in 0..count {
            let (q, behind) = columns[j * rows..].split_at_mut(rows);
            let mut before = NOTHING;
            for i in 0..j {
                before = each(|l| before[l] + self.r[i][j][l] * self.r[i][j][l]);
            }
            let norm = dot(q, q);
            for l in 0..LANES {
                self.is_good[l] &= (norm[l] > 1e-24 * (before[l] + norm[l])) & norm[l].is_finite();
            }
            self.r[j][j] = each(|l| norm[l].sqrt());
            let per = each(|l| 1.0 / self.r[j][j][l]);
            q.iter_mut().for_each(|v| *v = each(|l| v[l] * per[l]));
            for (k, column) in (j + 1..=count).zip(behind.chunks_exact_mut(rows)) {
                let along = dot(q, column);
                column.iter_mut().zip(&*q).for_each(|(v, q)| *v = each(|l| v[l] - along[l] * q[l]));
                if k < count {
                    self.r[j][k] = along;
                } else {
                    rhs[j] = along;
                }
            }
        }
        let rest = &columns[count * rows..(count + 1) * rows];
        self.rest = dot(rest, rest);
        rhs
    }

    /// R^-1 x.
    #[inline(always)]
    fn backwards(&self, count: usize, x: &[Lanes; MOST]) -> [Lanes; MOST] {
        let mut x = *x;
        for i in (0..count).rev() {
            let mut behind = NOTHING;
            for (r, x) in self.r[i][i + 1..count].iter().zip(&x[i + 1..count]) {
                behind = each(|l| behind[l] + r[l] * x[l]);
            }
            x[i] = each(|l| (x[i][l] - behind[l]) / self.r[i][i][l]);
        }
        x
    }

    /// R^-1 R^-T: that of a right-hand side of noise 1.
    #[inline(always)]
    fn covariance(&mut self, count: usize) {
        let mut columns = [[[0.0; LANES]; MOST]; MOST];
        for (k, column) in columns.iter_mut().enumerate().take(count) {
            let mut unit = [[0.0; LANES]; MOST];
            unit[k] = [1.0; LANES];
            *column = self.backwards(count, &unit);
        }
        for k in 0..count {
            let mut row = [[0.0; LANES]; MOST];
            row.iter_mut().zip(&columns).take(count).for_each(|(to, column)| *to = column[k]);
            self.covariance[k] = self.backwards(count, &row);
        }
    }
}

#[inline(always)]
fn each(number: impl Fn(usize) -> f64) -> Lanes {
    let mut lanes = [0.0; LANES];
    for (l, lane) in lanes.iter_mut().enumerate() {
        *lane = number(l);
    }
    lanes
}

#[inline(always)]
fn dot(a: &[Lanes], b: &[Lanes]) -> Lanes {
    a.iter().zip(b).fold(NOTHING, |sum, (a, b)| each(|l| sum[l] + a[l] * b[l]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::least_squares::Noise;
    use crate::unmix;

    /// Every bit of every lane, of mixtures of 1 to 5, some of whose solutions are negative, and of values that no lane solves.
    #[test]
    fn lanes_are_pixels_to_the_bit() {
        let mut state = 7_u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64
        };
        let (mut solved, mut left) = (0, 0);
        for case in 0..400 {
            let (rows, count) = (5 + case % 4, 1 + case % 5);
            let columns: Vec<Vec<f64>> = (0..count).map(|_| (0..rows).map(|_| random()).collect()).collect();
            let mixture = Mixture::new(&columns);
            let lanes = |of: &mut dyn FnMut(usize) -> f64| -> Vec<Lanes> {
                (0..rows).map(|row| std::array::from_fn(|_| of(row))).collect()
            };
            let mut mu_a = lanes(&mut |row| columns.iter().map(|c| c[row]).sum::<f64>() + 0.8 * (random() - 0.5));
            let mut se = lanes(&mut |_| 0.01 + random());
            match case % 10 {
                3 => se[1][2] = 0.0,
                5 => mu_a[0][4] = f64::NAN,
                7 => mu_a.iter_mut().for_each(|row| row[1] = 0.0),
                _ => {}
            }
            let level = turbid_optics::level::named("");
            for non_negative in [false, true] {
                let found = mixture.unmix_lanes(level, &mu_a, &se, non_negative, &mut Scratch::default());
                for (lane, found) in found.into_iter().enumerate() {
                    let of = |planes: &[Lanes]| planes.iter().map(|row| row[lane]).collect::<Vec<f64>>();
                    let (mu_a, se) = (of(&mu_a), of(&se));
                    let alone =
                        mixture.unmix(&mu_a, Noise::Independent(&se), non_negative, &mut unmix::Scratch::default());
                    let Some(found) = found else {
                        left += 1;
                        let is_free = alone.is_some_and(|a| a.held == 0 && a.chi2.is_some_and(f64::is_finite));
                        assert!(!is_free, "case {case}, lane {lane}: a lane can solve it");
                        continue;
                    };
                    solved += 1;
                    // Texts of numbers tell 0 from -0.
                    assert_eq!(format!("{:?}", Some(found)), format!("{alone:?}"), "case {case}, lane {lane}");
                }
            }
        }
        assert!(solved > 3000 && left > 300, "{solved} {left}");
    }
}
