//! The pass over the pixels: reflectance pairs in; maps, their errors and the mask out.

use std::ops::Range;

use turbid_contract::payload::MaskReason;
use turbid_optics::elementary::exp;

use crate::forward::{Forward, noise_bias, sandwich};
use crate::inverse::{Found, InverseTable};
use crate::nearest::Nodes;

/// How a pixel is inverted.
pub struct Inverter<'a> {
    /// Always there: it knows what lies inside.
    pub table: &'a InverseTable,
    /// Takes the place of the table's interpolation inside (`method: nearest`).
    pub nodes_inside: Option<&'a Nodes>,
    /// Gives pixels outside the value of the nearest node (`outside: nearest`).
    pub nodes_outside: Option<&'a Nodes>,
    /// Smallest and largest R_0 of the look-up table.
    pub r_0_range: [f64; 2],
    /// The surface that the table was made of, to find what noise adds to the mean.
    pub forward: &'a Forward,
    /// Whether that is taken off again.
    pub corrects: bool,
    /// Whether the covariance of each pixel is written down.
    pub wants_covariance: bool,
}

/// What is known of the pixels, row by row.
pub struct Input<'a> {
    pub r: [&'a [f32]; 2],
    /// Standard errors of both and their covariance.
    pub noise: Option<Noise<'a>>,
    /// Reasons from before.
    pub mask: Option<&'a [f32]>,
}

pub struct Noise<'a> {
    pub se: [&'a [f32]; 2],
    /// None: independent.
    pub covariance: Option<&'a [f32]>,
}

/// A pixel's properties, or why there are none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pixel {
    /// p = (ln mu_a, ln mu_s') and d p / d (ln R_0, ln R_1); `outside` holds the reason where the table ended.
    Known {
        p: [f64; 2],
        gain: [[f64; 2]; 2],
        outside: Option<MaskReason>,
    },
    Masked(MaskReason),
}

impl Inverter<'_> {
    pub fn invert(&self, r: [f64; 2]) -> Pixel {
        if !(r[0].is_finite() && r[1].is_finite()) {
            return Pixel::Masked(MaskReason::NotFinite);
        }
        match (self.table.find(r), self.nodes_inside, self.nodes_outside) {
            (Found::Properties { p, gain }, None, _) => Pixel::Known { p, gain, outside: None },
            (Found::Properties { .. }, Some(nodes), _) => nearest(nodes, r, None),
            (Found::Outside, _, Some(nodes)) if r[0] > 0.0 && r[1] > 0.0 => nearest(nodes, r, Some(self.reason(r))),
            (Found::Outside, ..) => Pixel::Masked(self.reason(r)),
            (Found::Folded, ..) => Pixel::Masked(MaskReason::Ambiguous),
        }
    }

    /// On which side of the table a pair lies.
    fn reason(&self, r: [f64; 2]) -> MaskReason {
        let [darkest, brightest] = self.r_0_range;
        if r[0] < darkest {
            MaskReason::BelowTable
        } else if r[0] > brightest {
            MaskReason::AboveTable
        } else {
            MaskReason::ModulationOutsideTable
        }
    }

    /// Inverts `pixels` into the planes mu_a, mu_s', where noise is known their standard errors and, if
    /// wanted, the covariances aa, as, ss of mu, the side of the table where `nodes_outside` is given, and the mask.
    pub fn run(&self, input: &Input<'_>, pixels: Range<usize>, planes: &mut [&mut [f32]]) -> Tally {
        let mut tally = Tally::default();
        let (mask, planes) = planes.split_last_mut().expect("the mask is the last plane");
        for (o, i) in pixels.enumerate() {
            let carried = input.mask.map_or(0.0, |m| m[i]);
            if carried != 0.0 {
                mask[o] = carried;
                continue;
            }
            let r = input.r.map(|r| f64::from(r[i]));
            let (p, gain, outside) = match self.invert(r) {
                Pixel::Known { p, gain, outside } => (p, gain, outside),
                Pixel::Masked(reason) => {
                    mask[o] = reason.code();
                    continue;
                }
            };
            let mut mu = p.map(exp);
            planes[0][o] = mu[0] as f32;
            planes[1][o] = mu[1] as f32;
            tally.good += 1;
            if let Some(noise) = &input.noise {
                let relative = [0, 1].map(|k| f64::from(noise.se[k][i]) / r[k]);
                let covariance = noise.covariance.map_or(0.0, |c| f64::from(c[i]) / (r[0] * r[1]));
                let c_r = [[relative[0] * relative[0], covariance], [covariance, relative[1] * relative[1]]];
                let c_p = sandwich(&gain, &c_r);
                // A node is no function of the noise that could be bent back.
                if outside.is_none() && self.nodes_inside.is_none() {
                    let bias = noise_bias(&self.forward.curvature(p), &gain, &c_r, &c_p);
                    // mu = exp(p): a scatter of p raises its mean as that of a lognormal.
                    let factor = [0, 1].map(|k| exp(bias[k] + 0.5 * c_p[k][k]));
                    let plain = mu[0];
                    if self.corrects {
                        mu = [mu[0] / factor[0], mu[1] / factor[1]];
                    }
                    if factor[0].is_finite() {
                        tally.noise_bias += plain - plain / factor[0];
                    }
                    (planes[0][o], planes[1][o]) = (mu[0] as f32, mu[1] as f32);
                }
                let c = |a: usize, b: usize| c_p[a][b] * mu[a] * mu[b];
                // A covariance rounded to f32 may leave a variance below 0 by a rounding error, that is 0.
                let variances = [c(0, 0).max(0.0), c(1, 1).max(0.0)];
                if !(variances[0].is_finite() && variances[1].is_finite()) {
                    tally.good -= 1;
                    (planes[0][o], planes[1][o], mask[o]) = (0.0, 0.0, MaskReason::NotFinite.code());
                    continue;
                }
                planes[2][o] = variances[0].sqrt() as f32;
                planes[3][o] = variances[1].sqrt() as f32;
                if self.wants_covariance {
                    planes[4][o] = variances[0] as f32;
                    planes[5][o] = c(0, 1) as f32;
                    planes[6][o] = variances[1] as f32;
                }
                tally.mu_a += mu[0];
                tally.variances[0] += variances[0];
                tally.variances[1] += variances[1];
            }
            if let Some(reason) = outside {
                planes[planes.len() - 1][o] = reason.code();
                tally.outside += 1;
            }
        }
        tally
    }

    /// How many planes [`Self::run`] fills.
    pub fn plane_count(&self, noise: bool) -> usize {
        2 + if !noise {
            0
        } else if self.wants_covariance {
            5
        } else {
            2
        } + usize::from(self.nodes_outside.is_some())
            + 1
    }
}

fn nearest(nodes: &Nodes, r: [f64; 2], outside: Option<MaskReason>) -> Pixel {
    let node = nodes.nearest(r);
    match node.gain {
        Some(gain) => Pixel::Known { p: node.p, gain, outside },
        None => Pixel::Masked(MaskReason::Ambiguous),
    }
}

/// Sums over pixels, added up in tile order.
#[derive(Default)]
pub struct Tally {
    pub good: u64,
    pub outside: u64,
    /// Of mu_a and mu_s' over good pixels.
    pub variances: [f64; 2],
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
        (0..2).for_each(|k| self.variances[k] += tile.variances[k]);
        self
    }
}
