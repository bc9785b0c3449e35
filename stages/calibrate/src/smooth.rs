//! One arm of the ratio: M_AC, smoothed where wanted, with its noise, and what a mean over pixels owes to it.

use std::borrow::Cow;

use turbid_contract::Error;
use turbid_contract::sharing::Sharing;

use crate::gauss::Gauss;
use crate::plane::{Plane, Room};

/// What an arm holds at each pixel.
pub enum Values<'a, 'r> {
    Smoothed(Plane<'r>),
    /// As a layer has it.
    Layer {
        pixels: Cow<'a, [f32]>,
        /// 0 at good pixels.
        mask: Option<&'a [f32]>,
        /// A variance, of a layer of standard errors.
        squared: bool,
    },
}

impl Values<'_, '_> {
    /// 0 where there is nothing near.
    #[inline(always)]
    pub fn at(&self, i: usize) -> f64 {
        match self {
            Self::Smoothed(plane) => plane.pixels[i],
            Self::Layer { mask: Some(mask), .. } if mask[i] != 0.0 => 0.0,
            Self::Layer { pixels, squared, .. } => {
                let value = f64::from(pixels[i]);
                if *squared { value * value } else { value }
            }
        }
    }
}

/// One quantity of an arm at one f_x, smoothed.
pub struct Smooth<'a, 'r> {
    pub value: Values<'a, 'r>,
    /// Variance of `value`; `None` where the noise is not known.
    pub variance: Option<Values<'a, 'r>>,
}

/// The smoothing of an arm's images over its good pixels.
pub struct Smoothing<'a, 'r> {
    room: &'r Room<'r>,
    gauss: &'a Gauss,
    mask: Option<&'a [f32]>,
    sharing: Sharing,
    /// sum_j w_ij over good pixels; `None` where nothing is smoothed.
    weight: Option<Plane<'r>>,
}

impl<'a, 'r> Smoothing<'a, 'r> {
    /// `mask` is 0 at good pixels; without one all are. `sharing`: how the errors of pixels are common.
    pub fn new(room: &'r Room<'r>, gauss: &'a Gauss, mask: Option<&'a [f32]>, sharing: Sharing) -> Result<Self, Error> {
        let weight = if gauss.is_none() { None } else { Some(gauss.sum(room, |i| good(mask, i), |_, sum| sum)?) };
        Ok(Self { room, gauss, mask, sharing, weight })
    }

    /// 1 at good pixels, 0 at masked ones.
    pub fn good(&self, i: usize) -> f64 {
        good(self.mask, i)
    }

    fn layer(&self, pixels: Cow<'a, [f32]>, squared: bool) -> Values<'a, 'r> {
        Values::Layer { pixels, mask: self.mask, squared }
    }

    /// The mean of x over the good pixels around.
    fn mean(&self, x: Cow<'a, [f32]>) -> Result<Values<'a, 'r>, Error> {
        let Some(weight) = &self.weight else { return Ok(self.layer(x, false)) };
        let mean =
            self.gauss.sum(self.room, |i| self.good(i) * f64::from(x[i]), |i, sum| quotient(sum, weight.pixels[i]));
        mean.map(Values::Smoothed)
    }

    /// Smooths a value and its standard error.
    pub fn smooth(&self, value: Cow<'a, [f32]>, se: Option<Cow<'a, [f32]>>) -> Result<Smooth<'a, 'r>, Error> {
        let square = |se: f32| f64::from(se) * f64::from(se);
        let variance = match (se, &self.weight) {
            (None, _) => None,
            (Some(se), None) => Some(self.layer(se, true)),
            (Some(se), Some(weight)) => Some(Values::Smoothed(self.covariance_of(weight, |i| square(se[i]))?)),
        };
        Ok(Smooth { value: self.mean(value)?, variance })
    }

    /// Smooths the covariance of two quantities of one pixel.
    pub fn covariance(&self, covariance: Cow<'a, [f32]>) -> Result<Values<'a, 'r>, Error> {
        match &self.weight {
            None => Ok(self.layer(covariance, false)),
            Some(weight) => self.covariance_of(weight, |i| f64::from(covariance[i])).map(Values::Smoothed),
        }
    }

    /// That of independent pixels falls to sum w^2 / (sum w)^2; each counts as often as it shares its error, all of them at most as one that is the same in all.
    fn covariance_of(&self, weight: &Plane<'_>, covariance: impl Fn(usize) -> f64 + Sync) -> Result<Plane<'r>, Error> {
        let (room, weight) = (self.room, &weight.pixels);
        let squared = |i: usize| weight[i] * weight[i];
        let independent = |i, sum| quotient(sum, squared(i));
        let x = |i| self.good(i) * covariance(i);
        let alone = self.gauss.sum_of_squares(room, x, independent)?;
        if self.sharing == Sharing::NONE {
            return Ok(alone);
        }
        let pixels = self.gauss.sum_of_squares(room, |i| self.good(i), |i, sum| quotient(squared(i), sum))?;
        let pixels = &pixels.pixels;
        self.gauss.sum_of_squares(
            room,
            |i| self.sharing.at(i) * x(i),
            |i, sum| {
                let (shared, most) = (independent(i, sum), pixels[i] * alone.pixels[i]);
                if shared.abs() > most.abs() { most } else { shared }
            },
        )
    }

    /// The share of what a smoothed pixel is made of that `flags` (0 or 1) marks.
    pub fn share(&self, flags: Cow<'a, [f32]>) -> Result<Values<'a, 'r>, Error> {
        self.mean(flags)
    }

    /// Variance of sum_i s_i v_i over a smoothed image v by the arm's own noise: smoothing makes neighbours share it, so their
    /// errors add up instead of averaging out. `sharing`: of v before it was smoothed.
    pub fn variance_of_sum(
        &self,
        sensitivity: impl Fn(usize) -> f64 + Sync,
        se: &[f32],
        sharing: &Sharing,
    ) -> Result<f64, Error> {
        let n = (0..se.len()).map(|i| self.good(i)).sum();
        let term = |i: usize, back: f64| (self.good(i) * back * f64::from(se[i])).powi(2);
        let Some(weight) = &self.weight else {
            let terms = (0..se.len()).map(|i| (i, term(i, quotient(sensitivity(i), self.good(i)))));
            return Ok(sharing.variance_of_sum(terms, n));
        };
        let terms = self.gauss.sum(self.room, |i| quotient(sensitivity(i), weight.pixels[i]), term)?;
        Ok(sharing.variance_of_sum(terms.pixels.iter().copied().enumerate(), n))
    }
}

fn good(mask: Option<&[f32]>, i: usize) -> f64 {
    if mask.is_none_or(|mask| mask[i] == 0.0) { 1.0 } else { 0.0 }
}

/// a / b, and 0 where b is 0: there is nothing near that pixel.
fn quotient(a: f64, b: f64) -> f64 {
    if b > 0.0 { a / b } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use turbid_contract::Ctx;
    use turbid_contract::kit::MemoryHost;

    use super::*;

    /// What `test` finds on an image of so many rows and columns.
    fn in_room<T>([rows, columns]: [usize; 2], test: impl Fn(&Room<'_>) -> Result<T, Error>) -> T {
        test(&Room::new(rows, columns, Ctx::new(&MemoryHost::default()))).expect("nobody cancels")
    }

    fn of(pixels: &[f32]) -> Cow<'_, [f32]> {
        Cow::Borrowed(pixels)
    }

    fn pixels<const N: usize>(pixel: impl Fn(usize) -> f32) -> [f32; N] {
        std::array::from_fn(pixel)
    }

    /// A constant stays constant whatever the holes; a masked pixel, whatever it holds, has no say.
    #[test]
    fn constants_survive_holes() {
        let mask: [f32; 108] = pixels(|i| if i % 7 == 3 { 1.0 } else { 0.0 });
        let value: [f32; 108] = pixels(|i| if i % 7 == 3 { 1e30 } else { 0.25 });
        let gauss = Gauss::new(1.5);
        in_room([9, 12], |room| {
            let smooth = Smoothing::new(room, &gauss, Some(&mask), Sharing::NONE)?.smooth(of(&value), None)?;
            assert!((0..108).all(|i| (smooth.value.at(i) - 0.25).abs() < 1e-14));
            Ok(())
        });
    }

    /// Without smoothing a flag is its pixel's; smoothed it is shared out, by weights that add up to 1, and a masked pixel's has no say.
    #[test]
    fn flags_are_shared_out() {
        let mask: [f32; 108] = pixels(|i| if i == 40 { 1.0 } else { 0.0 });
        let flags: [f32; 108] = pixels(|i| if i == 40 || i == 52 { 1.0 } else { 0.0 });
        let good = mask.map(|m| 1.0 - m);
        let (none, gauss) = (Gauss::new(0.0), Gauss::new(1.0));
        in_room([9, 12], |room| {
            let plain = Smoothing::new(room, &none, Some(&mask), Sharing::NONE)?.share(of(&flags))?;
            assert!((0..108).all(|i| plain.at(i) == if i == 52 { 1.0 } else { 0.0 }));
            let smoothing = Smoothing::new(room, &gauss, Some(&mask), Sharing::NONE)?;
            let own = smoothing.share(of(&flags))?.at(52);
            // 1 / (2 pi sigma^2), and a little more for the hole and the border.
            assert!((own - 0.159).abs() < 0.03, "{own}");
            let all = smoothing.share(of(&good))?;
            assert!((0..108).all(|i| (all.at(i) - 1.0).abs() < 1e-12));
            Ok(())
        });
    }

    /// Far from the border the variance falls to 1 / (4 pi sigma^2) (a Gaussian cut at 4 sigma: to 0.1 %); without
    /// smoothing it stays.
    #[test]
    fn smoothing_averages_noise_as_the_closed_form() {
        let (value, se): ([f32; 61 * 61], [f32; 61 * 61]) = (pixels(|_| 1.0), pixels(|_| 0.25));
        let variance = |sigma: f64, at: usize| {
            let gauss = Gauss::new(sigma);
            in_room([61, 61], |room| {
                let smooth = Smoothing::new(room, &gauss, None, Sharing::NONE)?.smooth(of(&value), Some(of(&se)))?;
                Ok(smooth.variance.map(|variance| variance.at(at)))
            })
        };
        for sigma in [1.0_f64, 3.0] {
            let variance = variance(sigma, 61 * 61 / 2).unwrap();
            let want = 0.0625 / (4.0 * std::f64::consts::PI * sigma * sigma);
            assert!((variance / want - 1.0).abs() < 1e-3, "sigma {sigma}: {variance} for {want}");
        }
        assert_eq!(variance(0.0, 0), Some(0.0625));
    }

    /// An error that all pixels share stays what it is, whatever the smoothing and the border.
    #[test]
    fn smoothing_leaves_common_noise() {
        let mask: [f32; 108] = pixels(|i| if i == 40 { 1.0 } else { 0.0 });
        let (value, se): ([f32; 108], [f32; 108]) = (pixels(|_| 1.0), pixels(|_| 0.25));
        let gauss = Gauss::new(2.0);
        in_room([9, 12], |room| {
            let smooth =
                Smoothing::new(room, &gauss, Some(&mask), Sharing::even(108.0))?.smooth(of(&value), Some(of(&se)))?;
            let variance = smooth.variance.unwrap();
            assert!((0..108).all(|i| (variance.at(i) - 0.0625).abs() < 1e-15));
            Ok(())
        });
    }

    /// var sum_i s_i v_i = s^T W V W^T s, against the matrix written out.
    #[test]
    fn the_variance_of_a_sum_is_the_matrix_product() {
        const N: usize = 20;
        let mask: [f32; N] = pixels(|i| if i == 7 { 1.0 } else { 0.0 });
        let se: [f32; N] = pixels(|i| 0.1 + 0.01 * i as f32);
        let s = |i: usize| if i == 7 { 0.0 } else { (i as f64).cos() };
        let gauss = Gauss::new(1.2);
        let [got, want] = in_room([4, 5], |room| {
            let smoothing = Smoothing::new(room, &gauss, Some(&mask), Sharing::NONE)?;
            let mut want = 0.0;
            for (j, se) in se.iter().enumerate() {
                let unit: [f32; N] = pixels(|i| if i == j { 1.0 } else { 0.0 });
                let response = smoothing.smooth(of(&unit), None)?.value;
                let total: f64 = (0..N).map(|i| response.at(i) * s(i)).sum();
                want += (total * f64::from(*se)).powi(2);
            }
            Ok([smoothing.variance_of_sum(s, &se, &Sharing::NONE)?, want])
        });
        assert!((got / want - 1.0).abs() < 1e-12, "{got} for {want}");
    }
}
