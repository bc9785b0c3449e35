//! Two reflectances to mu_a and mu_s'.

use turbid_contract::payload::MaskReason;

use crate::forward::{Bend, Forward, bend, inverse, noise_bias, sandwich};
use crate::inverse::{Found, InverseTable};
use crate::linear::Triangles;
use crate::lut::Errors;
use crate::nearest::Nodes;
use crate::pass::{Solved, Spread};

/// How a pair that the table holds becomes a pair of properties.
pub enum Inside<'a> {
    /// Bilinear in the inverse table.
    Table,
    /// The nearest node of the look-up table.
    Nearest(&'a Nodes),
    /// Linear in ln R over triangles of the nodes.
    Linear(Triangles<'a>),
    /// The exact inverse of the bicubic surface.
    Bicubic,
}

/// How a pixel is inverted.
pub struct Inverter<'a> {
    pub inside: Inside<'a>,
    /// Always there: it knows what lies inside, and where to begin.
    pub table: &'a InverseTable,
    /// Gives pixels outside the value of the nearest node (`outside: nearest`).
    pub nodes_outside: Option<&'a Nodes>,
    /// Smallest and largest R_0 of the look-up table.
    pub r_0_range: [f64; 2],
    /// The surface that the table was made of.
    pub forward: &'a Forward,
    /// Its own errors, where it has any.
    pub errors: Option<&'a Errors>,
}

/// Properties with d p / d (ln R_0, ln R_1).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Known {
    pub p: [f64; 2],
    pub gain: [[f64; 2]; 2],
    pub outside: Option<MaskReason>,
    /// How p bends with ln R; `None` where it is no smooth function of it.
    pub bend: Option<Bend>,
}

impl Inverter<'_> {
    /// `c_r`: covariance of R relative to R, where it is known.
    pub fn solve(&self, r: [f64; 2], c_r: Option<[[f64; 2]; 2]>) -> Result<Solved, MaskReason> {
        let Known { p, gain, outside, bend } = self.invert(r)?;
        let noise = c_r.map(|c_r| spread(&gain, &c_r, bend, self.variances(p)));
        Ok(Solved { p, noise, outside })
    }

    /// Whether p is what the inverse table says, and nothing else.
    pub fn reads_the_table(&self) -> bool {
        matches!(self.inside, Inside::Table)
    }

    /// Relative variances of the table's R at `p`.
    pub fn variances(&self, p: [f64; 2]) -> [f64; 2] {
        self.errors.map_or([0.0; 2], |errors| {
            let [low, high, ..] = errors.at(p);
            [low, high]
        })
    }

    pub fn invert(&self, r: [f64; 2]) -> Result<Known, MaskReason> {
        if !(r[0].is_finite() && r[1].is_finite()) {
            return Err(MaskReason::NotFinite);
        }
        match (self.table.find(r), self.nodes_outside) {
            (Found::Properties { p, gain, bend }, _) => self.within(r, p, gain, bend),
            (Found::Outside, Some(nodes)) if r[0] > 0.0 && r[1] > 0.0 => nearest(nodes, r, Some(self.reason(r))),
            (Found::Outside, _) => Err(self.reason(r)),
            (Found::Folded, _) => Err(MaskReason::Ambiguous),
        }
    }

    /// By the chosen method, from what the table says.
    fn within(&self, r: [f64; 2], p: [f64; 2], gain: [[f64; 2]; 2], of_cell: Bend) -> Result<Known, MaskReason> {
        match &self.inside {
            Inside::Table => Ok(Known { p, gain, outside: None, bend: Some(of_cell) }),
            Inside::Nearest(nodes) => nearest(nodes, r, None),
            Inside::Linear(triangles) => {
                let (p, gain) = triangles.find(r, p).ok_or_else(|| self.reason(r))?;
                Ok(Known { p, gain, outside: None, bend: None })
            }
            Inside::Bicubic => {
                let p = self.table.exact(self.forward, r, p).ok_or(MaskReason::Ambiguous)?;
                let gain = inverse(&self.forward.at(p).jacobian).ok_or(MaskReason::Ambiguous)?;
                Ok(Known { p, gain, outside: None, bend: Some(bend(&self.forward.curvature(p), &gain)) })
            }
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
}

/// Covariance of R relative to R, from standard errors and covariance.
#[inline(always)]
pub fn relative(r: [f64; 2], se: [f64; 2], between: f64) -> [[f64; 2]; 2] {
    let per = [1.0 / r[0], 1.0 / r[1]];
    let relative = [se[0] * per[0], se[1] * per[1]];
    let between = between * per[0] * per[1];
    [[relative[0] * relative[0], between], [between, relative[1] * relative[1]]]
}

/// What noise `c_r` (relative to R) and the table's own variances do to p.
#[inline(always)]
pub fn spread(gain: &[[f64; 2]; 2], c_r: &[[f64; 2]; 2], bend: Option<Bend>, variances: [f64; 2]) -> Spread {
    let covariance = sandwich(gain, c_r);
    let bias = bend.map(|bend| noise_bias(&bend, gain, c_r, &covariance));
    let table = sandwich(gain, &[[variances[0], 0.0], [0.0, variances[1]]]);
    let common = [gain[0][0] + gain[0][1], gain[1][0] + gain[1][1]];
    Spread { covariance, table, common, bias }
}

fn nearest(nodes: &Nodes, r: [f64; 2], outside: Option<MaskReason>) -> Result<Known, MaskReason> {
    let node = nodes.nearest(r);
    let gain = node.gain.ok_or(MaskReason::Ambiguous)?;
    Ok(Known { p: node.p, gain, outside, bend: None })
}
