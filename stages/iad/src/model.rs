//! A slab in an instrument, from its coefficients to the readings.

use std::sync::Arc;

use crate::forward::Plan;
use crate::spheres::{Instrument, Lost};
use crate::state::{State, state};
use crate::{Error, Incidence, Slab};

/// The forward half of [`crate::Experiment`], without the table of starts that its inverse needs. Cheap to copy for other instruments.
#[derive(Clone)]
pub struct Model<const N: usize> {
    slab: Arc<Both<N>>,
    instrument: Instrument,
}

struct Both<const N: usize> {
    plan: Plan<N>,
    /// The slab seen from below, where its sides differ.
    flipped: Option<Plan<N>>,
}

impl<const N: usize> Model<N> {
    /// As [`Plan::lit`]; slides may absorb; also fails on an instrument that cannot be.
    pub fn new(slab: &Slab, instrument: &Instrument, light: Incidence) -> Result<Self, Error> {
        instrument.check()?;
        let plan = Plan::lit(slab, light)?;
        let turned = Slab { top: slab.bottom, bottom: slab.top, ..*slab };
        let flipped = (slab.top != slab.bottom).then(|| Plan::new(&turned)).transpose()?;
        Ok(Self { slab: Arc::new(Both { plan, flipped }), instrument: *instrument })
    }

    /// The same slab in another instrument.
    pub fn within(&self, instrument: &Instrument) -> Result<Self, Error> {
        instrument.check()?;
        Ok(Self { slab: Arc::clone(&self.slab), instrument: *instrument })
    }

    pub fn plan(&self) -> &Plan<N> {
        &self.slab.plan
    }

    /// M_R and M_T of the medium (mu_a, mu_s' in mm^-1), or why there are none.
    pub fn readings(&self, mu_a: f64, mu_s_prime: f64, lost: &Lost) -> Result<[f64; 2], Error> {
        crate::forward::check_coefficients(mu_a, mu_s_prime)?;
        let state = self.state(mu_a, mu_s_prime).ok_or(Error::Unresolved { points: N })?;
        Ok(self.instrument.readings(&state.seen, lost))
    }

    fn state(&self, mu_a: f64, mu_s_prime: f64) -> Option<State> {
        let d = self.slab.plan.slab().thickness_mm;
        state(&self.slab.plan, self.slab.flipped.as_ref(), [mu_a * d, mu_s_prime * d])
    }

    /// d(M_R, M_T) / d(lost R, lost T of the beam, lost R, lost T of diffuse light); rows are the readings.
    #[allow(clippy::needless_range_loop, reason = "columns of one matrix")]
    pub fn slopes_by_loss(&self, mu_a: f64, mu_s_prime: f64, lost: &Lost) -> Option<[[f64; 4]; 2]> {
        // The balance is plain algebra: its own differences are exact to the square of this.
        const H: f64 = 1e-6;
        let seen = self.state(mu_a, mu_s_prime)?.seen;
        let mut slopes = [[0.0; 4]; 2];
        for part in 0..4 {
            let moved = |by: f64| {
                let mut lost = *lost;
                *if part < 2 { &mut lost.beam[part] } else { &mut lost.diffuse[part - 2] } += by;
                self.instrument.readings(&seen, &lost)
            };
            let (low, high) = (moved(-H), moved(H));
            for i in 0..2 {
                slopes[i][part] = (high[i] - low[i]) / (2.0 * H);
            }
        }
        Some(slopes)
    }
}
