//! From the five readings of each detector to M_R and M_T.

use crate::tally::Tally;

/// The readings that normalise: one set serves all media.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Normals {
    /// The standard at the sample port.
    pub standard: Tally,
    /// No sample, and the second sphere taken away.
    pub open: Tally,
    /// No sample: the beam goes straight through into the second sphere.
    pub straight: Tally,
    /// The beam blocked.
    pub blocked: Tally,
    /// What the standard is taken to reflect.
    pub r_standard: f64,
}

/// What the instrument reports of a medium, with standard errors; all relative to the incident light.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Measured {
    pub m_r: f64,
    pub m_r_se: f64,
    pub m_t: f64,
    pub m_t_se: f64,
    /// Of m_r and m_t: the same photons make both.
    pub m_rt_cov: f64,
    /// What a plate without sides behind a port without rim would reflect and transmit of the beam beyond what came into the spheres:
    /// value and standard error.
    pub lost_r: (f64, f64),
    pub lost_t: (f64, f64),
    /// The same of the light that the spheres throw onto the sample.
    pub lost_r_diffuse: (f64, f64),
    pub lost_t_diffuse: (f64, f64),
}

const R: usize = 0;
const T: usize = 1;

impl Normals {
    /// M_R = r_standard (sample - open) / (standard - open), M_T = (sample - blocked) / (straight - blocked).
    ///
    /// `None` where a normaliser is no brighter than its background.
    pub fn measure(&self, sample: &Tally) -> Option<Measured> {
        let open = self.open.mean(R);
        let blocked = self.blocked.mean(T);
        let span_r = self.standard.mean(R) - open;
        let span_t = self.straight.mean(T) - blocked;
        if !(span_r > 0.0 && span_t > 0.0) {
            return None;
        }
        let share_r = (sample.mean(R) - open) / span_r;
        let m_t = (sample.mean(T) - blocked) / span_t;
        let scale = self.r_standard / span_r;
        let variance = |tally: &Tally, i| tally.covariance(i, i);
        let variance_r = variance(sample, R)
            + share_r * share_r * variance(&self.standard, R)
            + (1.0 - share_r) * (1.0 - share_r) * variance(&self.open, R);
        let variance_t = variance(sample, T)
            + m_t * m_t * variance(&self.straight, T)
            + (1.0 - m_t) * (1.0 - m_t) * variance(&self.blocked, T);
        Some(Measured {
            m_r: self.r_standard * share_r,
            m_r_se: scale * variance_r.sqrt(),
            m_t,
            m_t_se: variance_t.sqrt() / span_t,
            m_rt_cov: scale * sample.covariance(R, T) / span_t,
            lost_r: sample.ratio(3, 2),
            lost_t: sample.ratio(4, 2),
            lost_r_diffuse: sample.ratio(6, 5),
            lost_t_diffuse: sample.ratio(7, 5),
        })
    }
}
