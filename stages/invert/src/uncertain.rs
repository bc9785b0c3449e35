//! Pixels that noise alone has pushed out of the table: they keep a value, so that the mean of a region does not depend on which they are.
//!
//! A pixel whose own reflectance lies outside the table may do so for its medium, or for its noise. To mask the second kind selects: it drops
//! those that noise has moved one way, and the mean of the others is off. Its neighbours know as much about the medium and nothing
//! about the pixel's noise, so they tell. Where their mean lies in the table and the pixel is no further from it than noise may be,
//!
//! mu = mu(R_mean) (1 + sum_k d ln mu / d R_k (R_k - R_mean,k)),
//!
//! which is linear in the pixel's noise, so that its mean is right, may be below 0, and has a standard error of first order
//! only: the pixel is flagged as one whose error is unknown.

use turbid_contract::payload::MaskReason;
use turbid_contract::{Ctx, Error};

use crate::least_squares::MOST;
use crate::pass::{Settled, Solved, settle};

/// Neighbours on each side of a pixel whose mean is taken.
const REACH: usize = 3;
/// The fewest of them that say anything.
const LEAST: usize = 3;
/// Standard errors that noise may take a pixel from its neighbours: a normal one goes further once in 1.7 million.
const WITHIN_NOISE: f64 = 5.0;
/// Relative change of R by which slopes are taken.
const STEP: f64 = 0.01;

/// The reflectance of one wavelength, as the pass over the pixels read it.
pub struct Image<'a> {
    pub columns: usize,
    /// At each f_x.
    pub r: Vec<&'a [f32]>,
    pub se: Vec<&'a [f32]>,
    /// Covariance of R_a and R_b at [a][b], where it is known.
    pub covariance: Vec<Option<&'a [f32]>>,
    /// Reasons from before, and those of the pass.
    pub before: Option<&'a [f32]>,
    pub after: &'a [f32],
}

/// A pixel that keeps a value.
pub struct Kept {
    pub pixel: usize,
    pub settled: Settled,
}

/// Reflectances at each f_x, and their covariance relative to them.
pub type Solve<'a> = dyn Fn(usize, &[f64], &dyn Fn(usize, usize) -> f64) -> Result<Solved, MaskReason> + Sync + 'a;

impl Image<'_> {
    /// All pixels that keep a value, in their order.
    ///
    /// Error: the run was cancelled.
    pub fn keep(&self, solve: &Solve<'_>, ctx: Ctx<'_>) -> Result<Vec<Kept>, Error> {
        let lost = |pixel: usize| self.before.is_none_or(|b| b[pixel] == 0.0) && is_of_the_table(self.after[pixel]);
        if !(0..self.after.len()).any(lost) {
            return Ok(Vec::new());
        }
        let rows = ctx.map_tiles(self.after.len() / self.columns, |row| {
            let pixels = (row * self.columns..(row + 1) * self.columns).filter(|&pixel| lost(pixel));
            pixels.filter_map(|pixel| self.kept(pixel, solve)).collect::<Vec<_>>()
        })?;
        Ok(rows.into_iter().flatten().collect())
    }

    fn kept(&self, pixel: usize, solve: &Solve<'_>) -> Option<Kept> {
        let count = self.r.len();
        let Around { mean, variance } = self.around(pixel)?;
        let mut off = [0.0; MOST];
        for k in 0..count {
            let (r, se) = (f64::from(self.r[k][pixel]), f64::from(self.se[k][pixel]));
            // A pixel that missed the rare bright paths knows nothing of them: it may have less noise than its neighbours by its own account.
            let noise = variance[k].max(se * se).sqrt();
            if !(mean[k] > 0.0 && (r - mean[k]).abs() <= WITHIN_NOISE * noise) {
                return None;
            }
            off[k] = r / mean[k] - 1.0;
        }
        let relative = |a: usize, b: usize| {
            let shared = match a == b {
                true => variance[a].max(f64::from(self.se[a][pixel]).powi(2)),
                false => self.covariance[a * count + b].map_or(0.0, |c| f64::from(c[pixel])),
            };
            shared / (mean[a] * mean[b])
        };
        let at = |share: f64| {
            let mut r = mean;
            r.iter_mut().zip(&off).for_each(|(r, off)| *r *= 1.0 + share * off);
            solve(pixel, &r[..count], &relative)
        };
        let middle = at(0.0).ok().filter(|solved| solved.outside.is_none())?;
        let largest = off[..count].iter().fold(0.0, |largest: f64, off| largest.max(off.abs()));
        let share = if largest > 0.0 { STEP / largest } else { return None };
        let slope = match (at(share), at(-share)) {
            (Ok(up), Ok(down)) => [0, 1].map(|k| 0.5 * (up.p[k] - down.p[k]) / share),
            (Ok(up), Err(_)) => [0, 1].map(|k| (up.p[k] - middle.p[k]) / share),
            (Err(_), Ok(down)) => [0, 1].map(|k| (middle.p[k] - down.p[k]) / share),
            (Err(_), Err(_)) => return None,
        };
        let mut settled = settle(middle.p, &middle.noise?, false);
        settled.mu = [0, 1].map(|k| settled.mu[k] * (1.0 + slope[k]));
        let numbers = settled.mu.iter().chain(&settled.covariance).chain(&settled.own).chain(&settled.common);
        let fits = |x: &f64| x.abs() <= f64::from(f32::MAX);
        numbers.copied().all(|x| fits(&x)).then_some(Kept { pixel, settled })
    }

    /// What the pixels around, the pixel itself among them, say together; `None` where there are too few.
    fn around(&self, pixel: usize) -> Option<Around> {
        let (row, column, rows) = (pixel / self.columns, pixel % self.columns, self.after.len() / self.columns);
        let mut found = Around { mean: [0.0; MOST], variance: [0.0; MOST] };
        let mut n = 0;
        for r in row.saturating_sub(REACH)..(row + REACH + 1).min(rows) {
            for c in column.saturating_sub(REACH)..(column + REACH + 1).min(self.columns) {
                let i = r * self.columns + c;
                // Those that the table does not hold count: without them the mean would be of a selection.
                if self.before.is_some_and(|b| b[i] != 0.0) || self.r.iter().any(|r| !r[i].is_finite()) {
                    continue;
                }
                n += 1;
                for (k, (r, se)) in self.r.iter().zip(&self.se).enumerate() {
                    found.mean[k] += f64::from(r[i]);
                    found.variance[k] += f64::from(se[i]) * f64::from(se[i]);
                }
            }
        }
        if n <= LEAST {
            return None;
        }
        found.mean.iter_mut().chain(&mut found.variance).for_each(|sum| *sum /= n as f64);
        Some(found)
    }
}

/// Means of R and of the squares of its standard errors, at each f_x.
struct Around {
    mean: [f64; MOST],
    variance: [f64; MOST],
}

/// Whether a reason is one that the reflectance of the pixel alone has: the table does not hold it.
fn is_of_the_table(code: f32) -> bool {
    matches!(
        MaskReason::of_code(code),
        Some(
            MaskReason::BelowTable
                | MaskReason::AboveTable
                | MaskReason::ModulationOutsideTable
                | MaskReason::Ambiguous
        )
    )
}
