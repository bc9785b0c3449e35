//! The pass over the pixels: what was found of each becomes maps, their errors and the mask.

use std::ops::Range;

use turbid_contract::ndarray::Array2;
use turbid_contract::payload::MaskReason;
use turbid_optics::elementary::exp;

use crate::single;

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
    /// Whether p has the digits of an f32, so that no more need be spent on its exponential where nothing but that is wanted.
    pub single: bool,
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
    /// Of p, from the errors of the look-up table and of the shape, which pixels have in common.
    pub table: [[f64; 2]; 2],
    /// d p / d ln of a factor that all R have in common.
    pub common: [f64; 2],
    /// By how much it raises the mean of p, to second order; `None` where p is no smooth function of the reflectance.
    pub bias: Option<[f64; 2]>,
}

/// What three independent errors of the shape, each of one standard error, do to ln(irradiance) and ln(stretch).
pub type Shake = [[f64; 2]; 3];

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
            common: [0, 1].map(|k| mix(a.common[k], b.common[k])),
            bias: a.bias.zip(b.bias).map(|(a, b)| [mix(a[0], b[0]), mix(a[1], b[1])]),
        });
        let p = [mix(self.p[0], other.p[0]), mix(self.p[1], other.p[1])];
        Self { p, noise, outside: self.outside.or(other.outside) }
    }
}

impl Spread {
    /// Adds what errors of the shape do: a change of ln(irradiance) is one of all R, a change of ln(stretch) one of p. Neighbours share them, so that they
    /// count with the errors of the table.
    pub fn shaken(mut self, shake: &Shake) -> Self {
        for [irradiance, stretch] in shake {
            let d = self.common.map(|g| stretch - g * irradiance);
            (0..4).for_each(|ab| self.table[ab / 2][ab % 2] += d[ab / 2] * d[ab % 2]);
        }
        self
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
        for (o, i) in pixels.enumerate() {
            match mask.map_or(0.0, |m| m[i]) {
                0.0 => self.write(o, solve(i), planes, &mut tally),
                carried => planes[planes.len() - 1][o] = carried,
            }
        }
        tally
    }

    /// Writes down one pixel.
    pub fn write(&self, o: usize, solved: Result<Solved, MaskReason>, planes: &mut [&mut [f32]], tally: &mut Tally) {
        let (reasons, planes) = planes.split_last_mut().expect("the mask is the last plane");
        match solved {
            Err(reason) => reasons[o] = reason.code(),
            Ok(Solved { p, noise: None, outside }) => {
                let mu = if self.single { p.map(|p| single::exp(p as f32)) } else { p.map(|p| exp(p) as f32) };
                (planes[0][o], planes[1][o]) = (mu[0], mu[1]);
                tally.good += 1;
                self.mark(o, outside, planes, tally);
            }
            Ok(Solved { p, noise: Some(spread), outside }) => {
                let settled = settle(p, &spread, self.corrects);
                match self.write_settled(o, &settled, planes, tally) {
                    Ok(()) => self.mark(o, outside, planes, tally),
                    Err(reason) => reasons[o] = reason.code(),
                }
            }
        }
    }

    /// A pixel outside the table that has a value all the same.
    fn mark(&self, o: usize, outside: Option<MaskReason>, planes: &mut [&mut [f32]], tally: &mut Tally) {
        if let Some(reason) = outside {
            planes[planes.len() - 1][o] = reason.code();
            tally.outside += 1;
        }
    }

    /// All planes of a pixel with known noise but the mask, which an error means.
    fn write_settled(
        &self,
        o: usize,
        settled: &Settled,
        planes: &mut [&mut [f32]],
        tally: &mut Tally,
    ) -> Result<(), MaskReason> {
        let Settled { mu, covariance, own, common, excess } = *settled;
        let se = [covariance[0].sqrt() as f32, covariance[2].sqrt() as f32];
        if !(se[0].is_finite() && se[1].is_finite()) {
            return Err(MaskReason::NotFinite);
        }
        (planes[0][o], planes[1][o]) = (mu[0] as f32, mu[1] as f32);
        (planes[2][o], planes[3][o]) = (se[0], se[1]);
        if self.covariance {
            (0..3).for_each(|k| planes[4 + k][o] = covariance[k] as f32);
        }
        tally.good += 1;
        tally.sums.add(o, [own[0], own[1], common[0].sqrt(), common[1].sqrt(), excess, mu[0]]);
        Ok(())
    }

    /// Writes down pixels that were read along the tangent, in place of what they were by themselves.
    pub fn write_kept(&self, kept: &[Kept], planes: &mut [Array2<f32>], tally: &mut Tally) {
        let last = planes.len() - 1;
        let columns = planes[last].ncols();
        for Kept { pixel, settled, alone } in kept {
            let at = (pixel / columns, pixel % columns);
            let Settled { mu, covariance, .. } = *settled;
            let se = [covariance[0].sqrt(), covariance[2].sqrt()];
            mu.into_iter().chain(se).enumerate().for_each(|(plane, value)| planes[plane][at] = value as f32);
            if self.covariance {
                (0..3).for_each(|k| planes[4 + k][at] = covariance[k] as f32);
            }
            planes[last][at] = MaskReason::Good.code();
            let sums = |s: &Settled| [s.own[0], s.own[1], s.common[0].sqrt(), s.common[1].sqrt(), 0.0, s.mu[0]];
            tally.sums.add(*pixel, sums(settled));
            match alone {
                Some(alone) => tally.sums.add(*pixel, sums(alone).map(|x| -x)),
                None => tally.good += 1,
            }
        }
    }

    /// How many planes hold values and their errors; they come first.
    pub fn value_planes(&self) -> usize {
        match (self.noise, self.covariance) {
            (false, _) => 2,
            (true, false) => 4,
            (true, true) => 7,
        }
    }

    /// How many planes [`Self::run`] fills.
    pub fn plane_count(&self) -> usize {
        self.value_planes() + usize::from(self.outside) + 1
    }
}

/// A pixel with known noise, as it is written down.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settled {
    /// mu_a and mu_s', free from what noise adds if that is wanted.
    pub mu: [f64; 2],
    /// aa, as, ss of mu, from noise and table.
    pub covariance: [f64; 3],
    /// Variances of mu by the pixel's own noise, and by the table.
    pub own: [f64; 2],
    pub common: [f64; 2],
    /// What noise adds to mu_a; 0 where nobody knows.
    pub excess: f64,
}

/// A pixel that was read along the tangent.
pub struct Kept {
    pub pixel: usize,
    pub settled: Settled,
    /// What it was by itself; `None` where the table does not hold it.
    pub alone: Option<Settled>,
}

/// mu = exp(p) with its errors: a scatter of p raises the mean of mu as that of a lognormal.
#[inline(always)]
pub fn settle(p: [f64; 2], spread: &Spread, corrects: bool) -> Settled {
    let Spread { covariance: c_p, table, bias, .. } = spread;
    let mut mu = [exp(p[0]), exp(p[1])];
    let mut excess = 0.0;
    if let Some(bias) = bias {
        // Beyond what `exp` can do there is no such factor, and no value.
        let lower = |x: f64| {
            let lowered = exp(-x);
            if x.abs() <= 700.0 { lowered } else { f64::NAN }
        };
        let freed = [mu[0] * lower(bias[0] + 0.5 * c_p[0][0]), mu[1] * lower(bias[1] + 0.5 * c_p[1][1])];
        let raised = mu[0] - freed[0];
        excess = if raised.abs() < f64::INFINITY { raised } else { 0.0 };
        mu = [if corrects { freed[0] } else { mu[0] }, if corrects { freed[1] } else { mu[1] }];
    }
    let own = |a: usize, b: usize| c_p[a][b] * mu[a] * mu[b];
    let all = |a: usize, b: usize| own(a, b) + table[a][b] * mu[a] * mu[b];
    // A covariance rounded to f32 may leave a variance below 0 by a rounding error, that is 0.
    let positive = |x: f64| if x < 0.0 { 0.0 } else { x };
    Settled {
        mu,
        covariance: [positive(all(0, 0)), all(0, 1), positive(all(1, 1))],
        own: [positive(own(0, 0)), positive(own(1, 1))],
        common: [table[0][0] * (mu[0] * mu[0]), table[1][1] * (mu[1] * mu[1])],
        excess,
    }
}

/// What the pixels of a tile are together.
#[derive(Default)]
pub struct Tally {
    pub good: u64,
    pub outside: u64,
    pub sums: Sums,
}

impl Tally {
    pub fn add(mut self, tile: &Self) -> Self {
        self.good += tile.good;
        self.outside += tile.outside;
        for (all, tile) in self.sums.columns.iter_mut().zip(&tile.sums.columns) {
            (0..COLUMNS).for_each(|c| all[c] += tile[c]);
        }
        self
    }
}

/// Sums that run side by side: pixel o of a tile adds to column o % COLUMNS, so that lanes and single pixels add up in one order.
pub const COLUMNS: usize = 8;

/// Sums over good pixels with known noise.
#[derive(Clone, Copy, Debug, Default)]
pub struct Sums {
    /// Variances of mu_a and mu_s' from their own noise; the standard errors that the table gives them, which for pixels of one medium are one error; by how
    /// much noise raises mu_a in the mean, to second order, and the mu_a that it belongs to.
    pub columns: [[f64; COLUMNS]; 6],
}

impl Sums {
    /// What good pixel `o` of a tile adds.
    pub fn add(&mut self, o: usize, values: [f64; 6]) {
        self.columns.iter_mut().zip(values).for_each(|(sum, value)| sum[o % COLUMNS] += value);
    }

    fn total(&self, quantity: usize) -> f64 {
        self.columns[quantity].iter().sum()
    }

    /// Variances of mu_a and mu_s' from their own noise.
    pub fn variances(&self) -> [f64; 2] {
        [self.total(0), self.total(1)]
    }

    /// Standard errors of mu_a and mu_s' by the table.
    pub fn common(&self) -> [f64; 2] {
        [self.total(2), self.total(3)]
    }

    pub fn noise_bias(&self) -> f64 {
        self.total(4)
    }

    pub fn mu_a(&self) -> f64 {
        self.total(5)
    }
}
