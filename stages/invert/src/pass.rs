//! The pass over the pixels: what was found of each becomes maps, their errors and the mask.

use std::ops::Range;

use turbid_contract::payload::MaskReason;
use turbid_optics::elementary::exp;

/// Which planes a pass fills.
#[derive(Clone, Copy, Debug)]
pub struct Pass {
    /// Whether the noise of the reflectance is known.
    pub noise: bool,
    /// Whether the covariance of each pixel is written down.
    pub covariance: bool,
    /// Whether pixels outside the table have a value.
    pub outside: bool,
    /// Whether what noise adds to the mean is taken off.
    pub corrects: bool,
}

/// A pixel's properties.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solved {
    /// (ln mu_a, ln mu_s').
    pub p: [f64; 2],
    /// Where noise is known.
    pub noise: Option<Spread>,
    /// The reason, where the table ended.
    pub outside: Option<MaskReason>,
}

/// What noise does to p.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// Of p, from the noise of the pixel.
    pub covariance: [[f64; 2]; 2],
    /// Of p, from the errors of the look-up table, which pixels have in common.
    pub table: [[f64; 2]; 2],
    /// By how much it raises the mean of p, to second order; `None` where p is no smooth function of the reflectance.
    pub bias: Option<[f64; 2]>,
}

impl Solved {
    /// Between two sections: the share `weight` of this one, the rest of the other.
    ///
    /// The noise of the pixel is the same in both, so standard errors would add up by their shares; mixing variances is never less.
    pub fn blend(self, weight: f64, other: Self) -> Self {
        let mix = |a: f64, b: f64| weight * a + (1.0 - weight) * b;
        let mixed = |a: [[f64; 2]; 2], b: [[f64; 2]; 2]| [0, 1].map(|i| [0, 1].map(|j| mix(a[i][j], b[i][j])));
        let noise = self.noise.zip(other.noise).map(|(a, b)| Spread {
            covariance: mixed(a.covariance, b.covariance),
            table: mixed(a.table, b.table),
            bias: a.bias.zip(b.bias).map(|(a, b)| [mix(a[0], b[0]), mix(a[1], b[1])]),
        });
        let p = [mix(self.p[0], other.p[0]), mix(self.p[1], other.p[1])];
        Self { p, noise, outside: self.outside.or(other.outside) }
    }
}

impl Pass {
    /// Fills the planes mu_a, mu_s', where noise is known their standard errors and, if wanted, the covariances aa, as, ss of mu, the
    /// side of the table where pixels outside have a value, and the mask.
    ///
    /// `mask` holds reasons from before; `solve` gets the number of a pixel.
    pub fn run(
        &self,
        mask: Option<&[f32]>,
        pixels: Range<usize>,
        planes: &mut [&mut [f32]],
        solve: impl Fn(usize) -> Result<Solved, MaskReason>,
    ) -> Tally {
        let mut tally = Tally::default();
        let (reasons, planes) = planes.split_last_mut().expect("the mask is the last plane");
        for (o, i) in pixels.enumerate() {
            let carried = mask.map_or(0.0, |m| m[i]);
            if carried != 0.0 {
                reasons[o] = carried;
                continue;
            }
            let Solved { p, noise, outside } = match solve(i) {
                Ok(solved) => solved,
                Err(reason) => {
                    reasons[o] = reason.code();
                    continue;
                }
            };
            let mut mu = p.map(exp);
            if let Some(Spread { covariance: c_p, table, bias }) = noise {
                if let Some(bias) = bias {
                    // mu = exp(p): a scatter of p raises its mean as that of a lognormal.
                    let factor = [0, 1].map(|k| exp(bias[k] + 0.5 * c_p[k][k]));
                    let plain = mu[0];
                    if self.corrects {
                        mu = [mu[0] / factor[0], mu[1] / factor[1]];
                    }
                    if factor[0].is_finite() {
                        tally.noise_bias += plain - plain / factor[0];
                    }
                }
                let own = |a: usize, b: usize| c_p[a][b] * mu[a] * mu[b];
                let c = |a: usize, b: usize| own(a, b) + table[a][b] * mu[a] * mu[b];
                // A covariance rounded to f32 may leave a variance below 0 by a rounding error, that is 0.
                let variances = [c(0, 0).max(0.0), c(1, 1).max(0.0)];
                if !(variances[0].is_finite() && variances[1].is_finite()) {
                    reasons[o] = MaskReason::NotFinite.code();
                    continue;
                }
                planes[2][o] = variances[0].sqrt() as f32;
                planes[3][o] = variances[1].sqrt() as f32;
                if self.covariance {
                    planes[4][o] = variances[0] as f32;
                    planes[5][o] = c(0, 1) as f32;
                    planes[6][o] = variances[1] as f32;
                }
                tally.mu_a += mu[0];
                for k in [0, 1] {
                    tally.variances[k] += own(k, k).max(0.0);
                    tally.common[k] += table[k][k].sqrt() * mu[k];
                }
            }
            (planes[0][o], planes[1][o]) = (mu[0] as f32, mu[1] as f32);
            tally.good += 1;
            if let Some(reason) = outside {
                planes[planes.len() - 1][o] = reason.code();
                tally.outside += 1;
            }
        }
        tally
    }

    /// How many planes [`Self::run`] fills.
    pub fn plane_count(&self) -> usize {
        let noise = match (self.noise, self.covariance) {
            (false, _) => 0,
            (true, false) => 2,
            (true, true) => 5,
        };
        2 + noise + usize::from(self.outside) + 1
    }
}

/// Sums over pixels, added up in tile order.
#[derive(Default)]
pub struct Tally {
    pub good: u64,
    pub outside: u64,
    /// Of mu_a and mu_s' over good pixels, from their own noise.
    pub variances: [f64; 2],
    /// Standard errors that the table gives them: of pixels of one medium they are one error.
    pub common: [f64; 2],
    /// By how much noise raises mu_a in the mean, to second order, and the mu_a that it belongs to.
    pub noise_bias: f64,
    pub mu_a: f64,
}

impl Tally {
    pub fn add(mut self, tile: &Self) -> Self {
        self.good += tile.good;
        self.outside += tile.outside;
        self.noise_bias += tile.noise_bias;
        self.mu_a += tile.mu_a;
        for k in 0..2 {
            self.variances[k] += tile.variances[k];
            self.common[k] += tile.common[k];
        }
        self
    }
}
