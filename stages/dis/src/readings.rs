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

/// What the instrument reports of a medium, with standard errors; all relative to the incident light. `None` is what the photons do not tell: an
/// error from less than two of them, or of what none of them showed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Measured {
    pub m_r: f64,
    pub m_r_se: Option<f64>,
    pub m_t: f64,
    pub m_t_se: Option<f64>,
    /// Of m_r and m_t: the same photons make both.
    pub m_rt_cov: Option<f64>,
    /// What a plate without sides behind a port without rim would reflect and transmit of the beam beyond what came into the spheres.
    pub lost_r: Loss,
    pub lost_t: Loss,
    /// The same of the light that the spheres throw onto the sample.
    pub lost_r_diffuse: Loss,
    pub lost_t_diffuse: Loss,
}

/// A share of light with its standard error; `None` where there was no such light.
pub type Loss = Option<(f64, Option<f64>)>;

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
        // A reading without photons is that of no light: exactly 0.
        let variance = |tally: &Tally, i| if tally.photons == 0 { Some(0.0) } else { tally.covariance(i, i) };
        let known = |i: usize| variance(sample, i).filter(|_| sample.counted(i));
        let variance_r = || {
            let (standard, open) = (variance(&self.standard, R)?, variance(&self.open, R)?);
            Some(known(R)? + share_r * share_r * standard + (1.0 - share_r) * (1.0 - share_r) * open)
        };
        let variance_t = || {
            let (straight, blocked) = (variance(&self.straight, T)?, variance(&self.blocked, T)?);
            Some(known(T)? + m_t * m_t * straight + (1.0 - m_t) * (1.0 - m_t) * blocked)
        };
        Some(Measured {
            m_r: self.r_standard * share_r,
            m_r_se: variance_r().map(|variance| scale * variance.sqrt()),
            m_t,
            m_t_se: variance_t().map(|variance| variance.sqrt() / span_t),
            m_rt_cov: sample.covariance(R, T).map(|covariance| scale * covariance / span_t),
            lost_r: sample.ratio(3, 2),
            lost_t: sample.ratio(4, 2),
            lost_r_diffuse: sample.ratio(6, 5),
            lost_t_diffuse: sample.ratio(7, 5),
        })
    }
}
