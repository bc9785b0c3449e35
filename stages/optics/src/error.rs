//! Why a formula has no answer.

use std::fmt;

/// Why a formula has no answer.
#[derive(Clone, Debug, PartialEq)]
pub enum Error {
    /// `name = value unit` breaks the rule `must`.
    Range { name: &'static str, value: f64, unit: &'static str, must: &'static str },
    /// An iteration stopped short of its tolerance.
    NotConverged { what: &'static str, residual: f64, wanted: f64 },
}

impl Error {
    /// `Ok` if `holds`; written so that NaN never holds.
    pub(crate) fn unless(
        holds: bool,
        name: &'static str,
        value: f64,
        unit: &'static str,
        must: &'static str,
    ) -> Result<(), Self> {
        if holds { Ok(()) } else { Err(Self::Range { name, value, unit, must }) }
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Range { name, value, unit, must } => {
                write!(f, "{name} = {value}{}{unit} must {must}", if unit.is_empty() { "" } else { " " })
            }
            Self::NotConverged { what, residual, wanted } => {
                write!(f, "{what} stopped at a residual of {residual:.1e}; {wanted:.1e} is wanted")
            }
        }
    }
}

impl std::error::Error for Error {}
