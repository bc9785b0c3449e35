//! Why a slab, or a measurement of one, has no answer.

use std::fmt;

/// Why a slab, or a measurement of one, has no answer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Error {
    /// The named input is NaN or infinite.
    NotFinite { name: &'static str },
    /// A refractive index below 1 (or not a number).
    InvalidIndex { name: &'static str, value: f64 },
    /// An anisotropy outside (-1, 1).
    InvalidG { value: f64 },
    /// A thickness that is not above 0 mm.
    InvalidThickness { value_mm: f64 },
    /// Another input outside its range.
    Range { name: &'static str, value: f64, must: &'static str },
    /// The inverse takes clear slides only: what the slide absorbs cannot be told from what the slab absorbs.
    AbsorbingSlide { tau: f64 },
    /// The quadrature is too coarse for this index and phase function.
    Unresolved { points: usize },
    /// M_R + M_T exceeds 1 by more than the stated standard error.
    TooMuchLight { excess: f64 },
    /// M_R lies below what the surfaces alone reflect at this M_T.
    BelowSpecular { min: f64 },
    /// M_T exceeds what this M_R leaves to any absorbing slab.
    AboveMax { max: f64 },
    /// No value of the one unknown gives this reading.
    OutOfReach { name: &'static str, value: f64, min: f64, max: f64 },
    /// More light came straight through than came through at all.
    UnscatteredExceedsTotal { m_t: f64, m_u: f64 },
    /// M_U gives a total attenuation that no g in (-1, 1) joins to the mu_a and mu_s' of M_R and M_T.
    Inconsistent { mu_t_per_mm: f64, mu_a_per_mm: f64, mu_s_prime_per_mm: f64 },
    /// No light comes through: only mu_a / mu_s' = `ratio` can be told (that of a half-space).
    Underdetermined { ratio: f64 },
    /// The search ended at mu_a, mu_s' = `best` (mm^-1) with the readings missed by `residual`.
    NotConverged { best: [f64; 2], residual: f64 },
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::NotFinite { name } => write!(f, "{name} must be a finite number"),
            Self::InvalidIndex { name, value } => write!(f, "{name} = {value} must be a refractive index >= 1"),
            Self::InvalidG { value } => write!(f, "g = {value} must lie in (-1, 1)"),
            Self::InvalidThickness { value_mm } => write!(f, "thickness = {value_mm} mm must be > 0"),
            Self::Range { name, value, must } => write!(f, "{name} = {value} must {must}"),
            Self::AbsorbingSlide { tau } => {
                write!(f, "a slide of optical thickness {tau} absorbs; the inverse takes clear slides (0)")
            }
            Self::Unresolved { points } => {
                write!(f, "{points} quadrature points are too few for this index and phase function; take more")
            }
            Self::TooMuchLight { excess } => {
                write!(f, "M_R + M_T exceeds 1 by {excess:.3e}; check the standards, or state the standard error")
            }
            Self::BelowSpecular { min } => write!(f, "M_R must be at least {min:.6}, what the surfaces alone reflect"),
            Self::AboveMax { max } => write!(f, "M_T must be at most {max:.6}, what an empty slab lets through"),
            Self::OutOfReach { name, value, min, max } => {
                write!(f, "{name} = {value} must lie in {min:.6} to {max:.6}, what the known coefficient leaves")
            }
            Self::UnscatteredExceedsTotal { m_t, m_u } => write!(f, "M_U = {m_u} must not exceed M_T = {m_t}"),
            Self::Inconsistent { mu_t_per_mm, mu_a_per_mm, mu_s_prime_per_mm } => write!(
                f,
                "M_U means mu_t = {mu_t_per_mm:.4e} mm^-1; no g in (-1, 1) joins it to mu_a = {mu_a_per_mm:.4e} and mu_s' = {mu_s_prime_per_mm:.4e} mm^-1"
            ),
            Self::Underdetermined { ratio } => {
                write!(f, "no light comes through: only mu_a / mu_s' = {ratio:.6e} can be told; a thinner sample helps")
            }
            Self::NotConverged { best: [mu_a, mu_s_prime], residual } => write!(
                f,
                "no medium gives these readings: mu_a = {mu_a:.4e}, mu_s' = {mu_s_prime:.4e} mm^-1 misses them by {residual:.1e}"
            ),
        }
    }
}

impl std::error::Error for Error {}
