//! Responses of pixels divided by the light on what they look at and freed from the carriers' phases there, with their covariances.

use crate::guide::Guide;
use crate::moments::Moments;

pub struct Reduced {
    /// How many responses a pixel has: 1, then re, im of each carrier.
    pub q: usize,
    /// `[pixel][response]`.
    values: Vec<f64>,
    /// `[pixel][response][response]`.
    covariances: Vec<f64>,
}

impl Reduced {
    /// Of pixels by their places among the `moments`, their paths (at least 2) and what is known of them.
    pub fn of<'a>(q: usize, moments: &Moments, pixels: impl Iterator<Item = (usize, u32, Guide<'a>)>) -> Self {
        let (mut values, mut covariances) = (Vec::new(), Vec::new());
        for (place, n, guide) in pixels {
            let of = |a: usize| guide.reduced(a);
            values.extend((0..q).map(|a| of(a).iter().map(|&(i, w)| w * moments.mean(place, i, n)).sum::<f64>()));
            for (a, b) in (0..q).flat_map(|a| (0..q).map(move |b| (a, b))) {
                let (left, right) = (of(a), of(b));
                let pairs = left.iter().flat_map(|l| right.iter().map(move |r| (l, r)));
                covariances.push(pairs.map(|(l, r)| l.1 * r.1 * moments.covariance(place, l.0, r.0, n)).sum());
            }
        }
        Self { q, values, covariances }
    }

    /// As they are; `[pixel][response]` and `[pixel][response][response]`.
    #[cfg(test)]
    pub fn known(q: usize, values: Vec<f64>, covariances: Vec<f64>) -> Self {
        Self { q, values, covariances }
    }

    pub fn value(&self, i: usize, a: usize) -> f64 {
        self.values[i * self.q + a]
    }

    /// `[response][response]`.
    pub fn covariances(&self, i: usize) -> &[f64] {
        &self.covariances[i * self.q * self.q..][..self.q * self.q]
    }

    pub fn variance(&self, i: usize, a: usize) -> f64 {
        self.covariances[(i * self.q + a) * self.q + a]
    }
}

/// Responses that are alike: that to 1; re and im of each carrier.
pub fn groups(q: usize) -> impl Iterator<Item = std::ops::Range<usize>> {
    std::iter::once(0..1).chain((1..q).step_by(2).map(|a| a..a + 2))
}
