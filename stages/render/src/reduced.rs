//! Responses of pixels divided by the light on what they look at and freed from the carriers' phases there, with their covariances.

use std::ops::Range;

use crate::fringes::{Fringes, groups};
use crate::guide::Guide;
use crate::moments::Moments;
use crate::projected::Terms;

pub struct Reduced {
    /// How many responses a pixel has.
    pub q: usize,
    /// Those before the pairs of re and im.
    singles: usize,
    /// `[pixel][response]`.
    values: Vec<f64>,
    /// `[pixel][response][response]`.
    covariances: Vec<f64>,
}

impl Reduced {
    /// Of pixels by their places among the `moments`, their paths (at least 2) and what is known of them.
    pub fn of<'a>(fringes: &Fringes, moments: &Moments, pixels: impl Iterator<Item = (usize, u32, Guide<'a>)>) -> Self {
        let (q, mut values, mut covariances) = (fringes.count(), Vec::new(), Vec::new());
        for (place, n, guide) in pixels {
            let of: Vec<Terms> = (0..q).map(|a| guide.reduced(a)).collect();
            values.extend(of.iter().map(|a| a.iter().map(|&(i, w)| w * moments.mean(place, i, n)).sum::<f64>()));
            for (left, right) in of.iter().flat_map(|a| of.iter().map(move |b| (a, b))) {
                let pairs = left.iter().flat_map(|l| right.iter().map(move |r| (l, r)));
                covariances.push(pairs.map(|(l, r)| l.1 * r.1 * moments.covariance(place, l.0, r.0, n)).sum());
            }
        }
        Self { q, singles: fringes.singles(), values, covariances }
    }

    /// As they are, only the first one single; `[pixel][response]` and `[pixel][response][response]`.
    #[cfg(test)]
    pub fn known(q: usize, values: Vec<f64>, covariances: Vec<f64>) -> Self {
        Self { q, singles: 1, values, covariances }
    }

    pub fn value(&self, i: usize, a: usize) -> f64 {
        self.values[i * self.q + a]
    }

    /// Responses that are alike: each single one; re and im of each fringe.
    pub fn groups(&self) -> impl Iterator<Item = Range<usize>> + Clone + use<> {
        groups(self.singles, self.q)
    }

    /// The fringe whose re and im a group is, if it is one.
    pub fn fringe(&self, group: &Range<usize>) -> Option<usize> {
        group.start.checked_sub(self.singles).map(|place| place / 2)
    }

    /// `[response][response]`.
    pub fn covariances(&self, i: usize) -> &[f64] {
        &self.covariances[i * self.q * self.q..][..self.q * self.q]
    }

    pub fn variance(&self, i: usize, a: usize) -> f64 {
        self.covariances[(i * self.q + a) * self.q + a]
    }
}
