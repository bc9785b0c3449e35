//! Pixels whose own noise is too large to invert them by themselves: they are read along the tangent at the mean of their neighbours.
//!
//! p(R) is curved, and it ends. Where noise is large, what is taken off for the curvature is a guess from a point that noise has chosen, and pixels that
//! noise pushes out of the table are lost: to leave them out selects, and the mean of the others is off. Neighbours know as much about the
//! medium and nothing about the pixel's noise. With R_m the mean of the 7 x 7 pixels around,
//!
//! mu = mu(R_m) (1 + sum_k d ln mu / d ln R_k (R_k / R_m,k - 1))
//!
//! is linear in the pixel's noise: its mean is right, wherever noise takes the pixel, and its standard error is what first order says. It may be
//! below 0. Which pixels are read so is decided by the neighbours, too, but for one kind: those that the table does not hold although it
//! holds their neighbours, and that are no further from these than noise may be. They are flagged: of a value outside the table no error is known.

use std::borrow::Cow;
use std::ops::Range;

use turbid_contract::ndarray::Array2;
use turbid_contract::payload::MaskReason;
use turbid_contract::sharing::Sharing;
use turbid_contract::{Ctx, Error, ImageStack};

use crate::lut::MOST;
use crate::pass::{Kept, Settled, Solved, settle};

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
    /// mu_a and mu_s' with their standard errors, of the pass.
    pub found: [&'a [f32]; 4],
    /// How the errors of pixels are common.
    pub sharing: &'a Sharing,
    /// Whether pixels that the table holds may be read along the tangent, too.
    pub corrects: bool,
}

/// Noise of ln mu above which a pixel is read along the tangent: up to here what is taken off for the curvature is right to 0.2 %.
const LARGE_NOISE: f64 = 0.2;
/// A pixel with less than this by its own account is not looked at: its neighbours hardly have more than the above.
const LEAST_NOISE: f32 = 0.12;

/// Reflectances at each f_x, and their covariance relative to them.
pub type Solve<'a> = dyn Fn(usize, &[f64], &dyn Fn(usize, usize) -> f64) -> Result<Solved, MaskReason> + Sync + 'a;

type Planes<'p, 'a> = &'p [Cow<'a, [f32]>];
type MaybePlanes<'p, 'a> = &'p [Option<Cow<'a, [f32]>>];

impl<'a> Image<'a> {
    /// Of R, its standard errors and covariances, the mask from before, and the planes of the pass.
    pub fn of(
        columns: usize,
        (r, se, covariance): (Planes<'a, '_>, Planes<'a, '_>, MaybePlanes<'a, '_>),
        before: Option<&'a [f32]>,
        planes: &'a [Array2<f32>],
        sharing: &'a Sharing,
        corrects: bool,
    ) -> Self {
        let plane = |k: usize| planes[k].as_slice().expect("planes are row-major");
        Self {
            columns,
            r: r.iter().map(AsRef::as_ref).collect(),
            se: se.iter().map(AsRef::as_ref).collect(),
            covariance: covariance.iter().map(Option::as_deref).collect(),
            before,
            after: plane(planes.len() - 1),
            found: [0, 1, 2, 3].map(plane),
            sharing,
            corrects,
        }
    }

    /// All pixels that are read along the tangent, in their order.
    ///
    /// Error: the run was cancelled.
    pub fn keep(&self, solve: &Solve<'_>, ctx: Ctx<'_>) -> Result<Vec<Kept>, Error> {
        let rows = ctx.map_tiles(self.after.len() / self.columns, |row| {
            let pixels = row * self.columns..(row + 1) * self.columns;
            if self.is_quiet(pixels.clone()) {
                return Vec::new();
            }
            let doubtful = pixels.filter(|&pixel| self.is_doubtful(pixel));
            doubtful.filter_map(|pixel| self.kept(pixel, solve)).collect()
        })?;
        Ok(rows.into_iter().flatten().collect())
    }

    /// Whether all pixels have a value and little noise: a sweep in vector lanes, which is all that most images need.
    fn is_quiet(&self, pixels: Range<usize>) -> bool {
        let [mu_a, mu_s_prime, mu_a_se, mu_s_prime_se] = self.found.map(|plane| &plane[pixels.clone()]);
        let noisy = |mu: &[f32], se: &[f32]| {
            mu.iter().zip(se).fold(0, |noisy, (&mu, &se)| noisy | u32::from(se > LEAST_NOISE * mu))
        };
        let lost = self.after[pixels].iter().fold(0, |lost, &code| lost | u32::from(code != 0.0));
        lost | noisy(mu_a, mu_a_se) | noisy(mu_s_prime, mu_s_prime_se) == 0
    }

    fn is_doubtful(&self, pixel: usize) -> bool {
        let [mu_a, mu_s_prime, mu_a_se, mu_s_prime_se] = self.found.map(|plane| plane[pixel]);
        let noisy = mu_a_se > LEAST_NOISE * mu_a || mu_s_prime_se > LEAST_NOISE * mu_s_prime;
        let usable = self.before.is_none_or(|b| b[pixel] == 0.0);
        usable && (is_of_the_table(self.after[pixel]) || self.corrects && self.after[pixel] == 0.0 && noisy)
    }

    fn kept(&self, pixel: usize, solve: &Solve<'_>) -> Option<Kept> {
        let count = self.r.len();
        let Around { mean, variance, pixels } = self.around(pixel)?;
        let lost = self.after[pixel] != 0.0;
        let mut off = [0.0; MOST];
        for k in 0..count {
            let (r, se) = (f64::from(self.r[k][pixel]), f64::from(self.se[k][pixel]));
            // A pixel that missed the rare bright paths knows nothing of them: it may have less noise than its neighbours by its own account.
            let noise = variance[k].max(se * se).sqrt();
            if !(mean[k] > 0.0 && (!lost || (r - mean[k]).abs() <= WITHIN_NOISE * noise)) {
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
        let spread = middle.noise?;
        if !lost && spread.covariance[0][0].max(spread.covariance[1][1]) <= LARGE_NOISE * LARGE_NOISE {
            return None;
        }
        let largest = off[..count].iter().fold(0.0, |largest: f64, off| largest.max(off.abs()));
        let share = if largest > 0.0 { STEP / largest } else { return None };
        let slope = match (at(share), at(-share)) {
            (Ok(up), Ok(down)) => [0, 1].map(|k| 0.5 * (up.p[k] - down.p[k]) / share),
            (Ok(up), Err(_)) => [0, 1].map(|k| (up.p[k] - middle.p[k]) / share),
            (Err(_), Ok(down)) => [0, 1].map(|k| (middle.p[k] - down.p[k]) / share),
            (Err(_), Err(_)) => return None,
        };
        let mut settled = settle(middle.p, &spread, false);
        // The mean of the neighbours is itself a noisy point of a curve.
        let of_mean = self.sharing.at(pixel).min(pixels) / pixels;
        let mut quiet = spread;
        quiet.covariance = quiet.covariance.map(|row| row.map(|c| c * of_mean));
        quiet.bias = quiet.bias.map(|bias| bias.map(|b| b * of_mean));
        let mu = settle(middle.p, &quiet, self.corrects).mu;
        settled.mu = [0, 1].map(|k| mu[k] * (1.0 + slope[k]));
        let numbers = settled.mu.iter().chain(&settled.covariance).chain(&settled.own).chain(&settled.common);
        let fits = |x: &f64| x.abs() <= f64::from(f32::MAX);
        if !numbers.copied().all(|x| fits(&x)) {
            return None;
        }
        let alone = if lost { None } else { Some(self.alone(pixel, solve)?) };
        Some(Kept { pixel, settled, alone })
    }

    /// What the pixel is by itself, as the pass found it.
    fn alone(&self, pixel: usize, solve: &Solve<'_>) -> Option<Settled> {
        let count = self.r.len();
        let mut r = [0.0; MOST];
        r.iter_mut().zip(&self.r).for_each(|(r, plane)| *r = f64::from(plane[pixel]));
        let relative = |a: usize, b: usize| {
            let shared = match a == b {
                true => f64::from(self.se[a][pixel]).powi(2),
                false => self.covariance[a * count + b].map_or(0.0, |c| f64::from(c[pixel])),
            };
            shared / (r[a] * r[b])
        };
        let solved = solve(pixel, &r[..count], &relative).ok()?;
        Some(settle(solved.p, &solved.noise?, self.corrects))
    }

    /// What the pixels around, the pixel itself among them, say together; `None` where there are too few.
    fn around(&self, pixel: usize) -> Option<Around> {
        let (row, column, rows) = (pixel / self.columns, pixel % self.columns, self.after.len() / self.columns);
        let mut found = Around { mean: [0.0; MOST], variance: [0.0; MOST], pixels: 0.0 };
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
        found.pixels = n as f64;
        Some(found)
    }
}

/// Measures how many pixels were read along the tangent, and gives those that the table does not hold by themselves.
pub fn told<'k>(kept: &'k [Kept], stack: &ImageStack, ctx: Ctx<'_>) -> impl Iterator<Item = usize> + 'k {
    let outside = || kept.iter().filter(|kept| kept.alone.is_none()).map(|kept| kept.pixel);
    let percent = |n: usize| 100.0 * n as f64 / (stack.rows() * stack.columns()) as f64;
    if !kept.is_empty() {
        ctx.measure("read_along_tangent", percent(kept.len()), "%");
        ctx.measure("kept_outside_table", percent(outside().count()), "%");
    }
    outside()
}

/// Means of R and of the squares of its standard errors, at each f_x, and of how many pixels.
struct Around {
    mean: [f64; MOST],
    variance: [f64; MOST],
    pixels: f64,
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
