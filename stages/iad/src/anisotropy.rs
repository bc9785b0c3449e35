//! mu_a, mu_s' and g from M_R, M_T and the unscattered transmittance M_U.

use turbid_optics::PhaseFunction;

use crate::{Error, Experiment, Fit, Instrument, Inverse, Measurement, Reading, Slab, Spheres, unscattered_depth};

/// The medium with its anisotropy.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FitWithG {
    pub g: f64,
    pub fit: Fit,
}

/// Also finds g of Henyey and Greenstein's function; the mean cosine of `slab.phase` is where the search starts. g below -0.98 or above 1 - 1e-9 is not looked for.
///
/// M_U fixes mu_t, hence the mu_s that is wanted; the mu_s found from M_R and M_T grows with the g assumed, about as
/// 1 / (1 - g), so that their log ratio over -ln(1 - g) is close to a line of slope 1: secant steps within a bracket.
pub fn invert_with_g<const N: usize>(slab: &Slab, reading: &Reading, m_u: f64) -> Result<FitWithG, Error> {
    search(slab, reading.m_t + reading.sigma, m_u, |slab| Inverse::<N>::new(slab)?.invert(reading))
}

/// [`invert_with_g`] behind an instrument; M_U is the transmittance of the sample itself.
pub fn solve_with_g<const N: usize>(
    slab: &Slab,
    instrument: &Instrument,
    measured: &Measurement,
    m_u: f64,
) -> Result<FitWithG, Error> {
    let at_most = if instrument.spheres == Spheres::None { measured.m_t + measured.m_t_se } else { 1.0 };
    search(slab, at_most, m_u, |slab| Ok(Experiment::<N>::new(slab, instrument)?.solve(measured)?.fit))
}

fn search(
    slab: &Slab,
    at_most: f64,
    m_u: f64,
    invert: impl Fn(&Slab) -> Result<Fit, Error>,
) -> Result<FitWithG, Error> {
    const STEPS: usize = 60;
    if !m_u.is_finite() {
        return Err(Error::NotFinite { name: "M_U" });
    }
    if m_u <= 0.0 {
        return Err(Error::Range { name: "M_U", value: m_u, must: "be > 0: without it g is not known" });
    }
    slab.check()?;
    let mu_t = unscattered_depth(slab, m_u)? / slab.thickness_mm;
    if m_u > at_most {
        return Err(Error::UnscatteredExceedsTotal { m_t: at_most, m_u });
    }
    let anisotropy = |v: f64| -libm::expm1(-v);
    let solve = |v: f64| -> Result<(f64, Fit), Error> {
        let g = anisotropy(v);
        let fit = invert(&Slab { phase: PhaseFunction::henyey_greenstein(g), ..*slab })?;
        let ratio = fit.mu_s_prime_per_mm / (1.0 - g) / (mu_t - fit.mu_a_per_mm);
        if ratio > 0.0 && ratio.is_finite() { Ok((libm::log(ratio), fit)) } else { Err(inconsistent(mu_t, &fit)) }
    };
    // -ln(1 - g) at the ends, with the log ratio once it is known there.
    let (mut low, mut high): ((f64, Option<f64>), (f64, Option<f64>)) =
        ((-libm::log(1.98), None), (-libm::log(1e-9), None));
    let mut v = -libm::log1p(-slab.phase.g());
    let mut last = None;
    for _ in 0..STEPS {
        let at_end = v <= low.0 || v >= high.0;
        v = v.clamp(low.0, high.0);
        let (off, fit) = solve(v)?;
        let stuck = last.is_some_and(|(before, _): (f64, f64)| (v - before).abs() <= 1e-14);
        if off.abs() <= 1e-12 || stuck && off.abs() <= 1e-8 {
            return Ok(FitWithG { g: anisotropy(v), fit });
        }
        if at_end && (off > 0.0) == (v <= low.0) {
            return Err(inconsistent(mu_t, &fit));
        }
        let slope = last.map_or(1.0, |(before, off_before)| (off - off_before) / (v - before));
        last = Some((v, off));
        *(if off > 0.0 { &mut high } else { &mut low }) = (v, Some(off));
        let step = v - off / slope;
        v = match (low.1, high.1) {
            (Some(_), Some(_)) if step <= low.0 || step >= high.0 || step.is_nan() => 0.5 * (low.0 + high.0),
            _ if slope > 0.0 => step,
            _ => v - off,
        };
    }
    let (_, fit) = solve(v)?;
    Err(Error::NotConverged { best: [fit.mu_a_per_mm, fit.mu_s_prime_per_mm], residual: fit.residual })
}

fn inconsistent(mu_t_per_mm: f64, fit: &Fit) -> Error {
    Error::Inconsistent { mu_t_per_mm, mu_a_per_mm: fit.mu_a_per_mm, mu_s_prime_per_mm: fit.mu_s_prime_per_mm }
}
