//! The light that falls on a slab.

use std::f64::consts::FRAC_PI_2;

use crate::Error;

/// The light that falls on a slab from the air; angles in rad from the normal.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Incidence {
    /// A beam along the normal.
    #[default]
    Normal,
    /// A beam at this angle in the air, in [0, pi/2).
    Oblique(f64),
    /// The same radiance from all directions within this half angle about the normal, in (0, pi/2].
    Cone(f64),
    /// The same radiance from all directions.
    Diffuse,
}

/// A cone narrower than this is a beam: reflectance differs by the square of it.
const NARROW: f64 = 1e-5;

impl Incidence {
    /// The same light with the limiting angles named as what they are.
    pub(crate) fn checked(self) -> Result<Self, Error> {
        let refuse = |value, must| Err(Error::Range { name: "angle of incidence", value, must });
        match self {
            Self::Oblique(angle) if !(0.0..FRAC_PI_2).contains(&angle) => refuse(angle, "lie in [0, pi/2) rad"),
            Self::Cone(angle) if !(angle > 0.0 && angle <= FRAC_PI_2) => refuse(angle, "lie in (0, pi/2] rad"),
            Self::Oblique(0.0) => Ok(Self::Normal),
            Self::Cone(FRAC_PI_2) => Ok(Self::Diffuse),
            Self::Cone(angle) if angle < NARROW => Ok(Self::Normal),
            other => Ok(other),
        }
    }
}
