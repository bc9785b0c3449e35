//! The slab between its slides, and what their surfaces reflect and let through.

use turbid_optics::{PhaseFunction, fresnel};

use crate::Error;

/// A plane plate between air and slab.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slide {
    /// Refractive index, >= 1; 1 without a slide.
    pub n: f64,
    /// Optical thickness of its absorption along the normal, >= 0.
    pub tau: f64,
}

impl Slide {
    /// No slide.
    pub const NONE: Self = Self { n: 1.0, tau: 0.0 };

    /// A clear slide of index `n`.
    pub const fn clear(n: f64) -> Self {
        Self { n, tau: 0.0 }
    }
}

/// A homogeneous slab in air.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slab {
    /// Refractive index, >= 1.
    pub n: f64,
    /// How it scatters; mu_s' = mu_s (1 - g) with its mean cosine g.
    pub phase: PhaseFunction,
    /// Thickness, mm, > 0; infinity for a half-space.
    pub thickness_mm: f64,
    /// The side where the light comes in.
    pub top: Slide,
    pub bottom: Slide,
}

impl Slab {
    /// A slab of index `n` without slides, which scatters by Henyey and Greenstein's function of `g`.
    pub const fn bare(n: f64, g: f64, thickness_mm: f64) -> Self {
        let phase = PhaseFunction::henyey_greenstein(g);
        Self { n, phase, thickness_mm, top: Slide::NONE, bottom: Slide::NONE }
    }

    pub(crate) fn check(&self) -> Result<(), Error> {
        for (name, n) in [("n", self.n), ("top.n", self.top.n), ("bottom.n", self.bottom.n)] {
            if !(n >= 1.0 && n.is_finite()) {
                return Err(Error::InvalidIndex { name, value: n });
            }
        }
        match (self.phase, self.phase.check()) {
            (PhaseFunction::HenyeyGreenstein { g }, Err(_)) => return Err(Error::InvalidG { value: g }),
            (_, Err(turbid_optics::Error::Range { name, value, must, .. })) => {
                return Err(Error::Range { name, value, must });
            }
            _ => {}
        }
        if self.thickness_mm <= 0.0 || self.thickness_mm.is_nan() {
            return Err(Error::InvalidThickness { value_mm: self.thickness_mm });
        }
        for tau in [self.top.tau, self.bottom.tau] {
            if tau < 0.0 || tau.is_nan() {
                return Err(Error::Range { name: "slide tau", value: tau, must: "be >= 0" });
            }
        }
        Ok(())
    }
}

/// Fractions of the flux that falls on a surface (slide included) in one direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// Reflected back into the slab.
    pub inside: f64,
    /// Reflected back into the air.
    pub outside: f64,
    /// Let through; the same from either side.
    pub through: f64,
}

impl Surface {
    /// The surface of a slab of index `n`, met at the cosine `cos` inside the slab.
    pub fn new(n: f64, slide: Slide, cos: f64) -> Self {
        let dark = |inside| Self { inside, outside: 1.0, through: 0.0 };
        let Some(cos_slide) = fresnel::refracted_cos(n / slide.n, cos) else { return dark(1.0) };
        let inner = fresnel::reflectance(n / slide.n, cos);
        let pass = libm::exp(-slide.tau / cos_slide);
        if fresnel::refracted_cos(n, cos).is_none() {
            // Total reflection at the air; without absorption nothing is lost, whatever the slide.
            let lost = (1.0 - inner) * (1.0 - pass * pass) / (1.0 - inner * pass * pass);
            return dark(if slide.tau == 0.0 { 1.0 } else { 1.0 - lost });
        }
        let outer = fresnel::reflectance(slide.n, cos_slide);
        let rounds = 1.0 / (1.0 - inner * outer * pass * pass);
        let once = (1.0 - inner) * (1.0 - outer) * pass;
        Self {
            inside: inner + (1.0 - inner) * (1.0 - inner) * outer * pass * pass * rounds,
            outside: outer + (1.0 - outer) * (1.0 - outer) * inner * pass * pass * rounds,
            through: once * rounds,
        }
    }
}

/// (reflected, transmitted) fractions of a beam along the cosine `cos` in the slab that is never scattered.
pub fn unscattered(slab: &Slab, cos: f64, tau: f64) -> (f64, f64) {
    let (top, bottom) = (Surface::new(slab.n, slab.top, cos), Surface::new(slab.n, slab.bottom, cos));
    let pass = libm::exp(-tau / cos);
    let rounds = 1.0 / (1.0 - top.inside * bottom.inside * pass * pass);
    let reflected = top.outside + top.through * top.through * bottom.inside * pass * pass * rounds;
    (reflected, top.through * bottom.through * pass * rounds)
}

/// Derivatives of [`unscattered`] by `tau`.
pub(crate) fn unscattered_slope(slab: &Slab, cos: f64, tau: f64) -> (f64, f64) {
    let (top, bottom) = (Surface::new(slab.n, slab.top, cos), Surface::new(slab.n, slab.bottom, cos));
    let pass = libm::exp(-tau / cos);
    let echo = top.inside * bottom.inside;
    let rounds = 1.0 / (1.0 - echo * pass * pass);
    let by_pass_r = 2.0 * top.through * top.through * bottom.inside * pass * rounds * rounds;
    let by_pass_t = top.through * bottom.through * (1.0 + echo * pass * pass) * rounds * rounds;
    (-pass / cos * by_pass_r, -pass / cos * by_pass_t)
}

/// The optical thickness that leaves this unscattered transmittance of a beam along the normal, in (0, what an empty slab
/// lets through].
pub fn unscattered_depth(slab: &Slab, transmittance: f64) -> Result<f64, Error> {
    slab.check()?;
    let (top, bottom) = (Surface::new(slab.n, slab.top, 1.0), Surface::new(slab.n, slab.bottom, 1.0));
    let (through, echo) = (top.through * bottom.through, top.inside * bottom.inside);
    // Its square may be too large for a number; nothing lets through more than all.
    if transmittance > 1.0 {
        return Err(Error::Range { name: "M_U", value: transmittance, must: "not exceed 1, all the light there is" });
    }
    let pass =
        2.0 * transmittance / (through + (through * through + 4.0 * echo * transmittance * transmittance).sqrt());
    if pass > 1.0 {
        return Err(Error::AboveMax { max: through / (1.0 - echo) });
    }
    Ok(-libm::log(pass))
}
