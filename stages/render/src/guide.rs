//! What is known of a pixel beforehand: the light on what it looks at, and where in the fringes that lies. Responses without both are
//! *reduced*.

use crate::fringes::Fringes;
use crate::projected::Terms;

/// What is known of a pixel beforehand.
#[derive(Clone, Copy, Debug)]
pub struct Guide<'a> {
    /// Irradiance at the centre of what is seen, but for the power of the light.
    pub gain: f64,
    /// (sin, cos) of each fringe there, times its contrast.
    pub phases: &'a [(f64, f64)],
    pub fringes: &'a Fringes,
}

impl Guide<'_> {
    /// Response i as a sum of weight x reduced response.
    pub fn in_reduced(&self, i: usize) -> Terms {
        self.fringes.in_reduced(i, self.gain, self.phases)
    }

    /// Reduced response a as a sum of weight x response: undoes [`in_reduced`](Self::in_reduced).
    pub fn reduced(&self, a: usize) -> Terms {
        self.fringes.reduced(a, self.gain, self.phases)
    }

    /// The sum of weight x response over `terms` by reduced responses, each once.
    pub fn collect(&self, terms: &[(usize, f64)]) -> Terms {
        let mut sums: Terms = Vec::with_capacity(2 * terms.len());
        for &(i, weight) in terms {
            for (a, w) in self.in_reduced(i) {
                match sums.iter_mut().find(|s| s.0 == a) {
                    Some(sum) => sum.1 += weight * w,
                    None => sums.push((a, weight * w)),
                }
            }
        }
        sums
    }
}
