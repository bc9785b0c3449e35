//! What the reference reflects: a phantom according to a forward model, a plate as its supplier says.

use std::sync::{Mutex, PoisonError};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use turbid_contract::Error;
use turbid_contract::payload::Convention;
use turbid_optics::{Medium, PhaseFunction, Reflectance};

/// The forward model of the reference.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Model {
    /// Radiative transfer by discrete ordinates: exact to 1e-5.
    #[default]
    Rte,
    /// Diffusion with exact Fresnel moments: fast, 1 to 40 % off in tissue.
    Diffusion,
}

/// The reference at one wavelength.
#[derive(Clone, Debug, PartialEq)]
pub enum Standard {
    Medium(Phantom),
    Plate(Plate),
}

/// A half-space: coefficients in mm^-1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Phantom {
    pub mu_a: f64,
    pub mu_s_prime: f64,
    pub g: f64,
    pub n: f64,
}

/// A plate of known reflectance.
#[derive(Clone, Debug, PartialEq)]
pub struct Plate {
    /// f_x (mm^-1; `None`: any), R_d.
    pub r_d: Vec<(Option<f64>, f64)>,
}

impl Standard {
    /// Reflectance at `f_x_per_mm` in the given convention. Errors: a model that knows no such phantom, a plate whose R_d is not known at this f_x.
    pub fn reflectance(&self, model: Model, convention: Convention, f_x_per_mm: f64) -> Result<f64, Error> {
        match self {
            _ if convention == Convention::Relative => Ok(1.0),
            Self::Medium(phantom) => phantom.reflectance(model, convention, f_x_per_mm),
            Self::Plate(plate) => plate.reflectance(f_x_per_mm),
        }
    }
}

impl Plate {
    fn reflectance(&self, f_x_per_mm: f64) -> Result<f64, Error> {
        let same = |f_x: f64| (f_x - f_x_per_mm).abs() <= 1e-9 * f_x_per_mm.abs();
        let found = self.r_d.iter().find(|(f_x, _)| f_x.is_some_and(same));
        let found = found.or_else(|| self.r_d.iter().find(|(f_x, _)| f_x.is_none()));
        found.map(|(_, r_d)| *r_d).ok_or_else(|| {
            let has: Vec<String> = self.r_d.iter().filter_map(|(f_x, _)| Some(f_x.as_ref()?.to_string())).collect();
            let what =
                format!("R_d of the reference is given at f_x = {} mm^-1, the sample has {f_x_per_mm}", has.join(", "));
            let way_out =
                "nothing is interpolated over f_x: add the column `reflectance@F_X`, or `reflectance` for all f_x";
            Error::failed_with_hint(what, way_out)
        })
    }
}

impl Phantom {
    fn reflectance(&self, model: Model, convention: Convention, f_x_per_mm: f64) -> Result<f64, Error> {
        let Self { mu_a, mu_s_prime, g, n } = *self;
        let medium = Medium { mu_a, mu_s_prime, phase: PhaseFunction::henyey_greenstein(g), n };
        let reflectance = match model {
            Model::Rte => transport(&medium, f_x_per_mm),
            Model::Diffusion => turbid_optics::diffusion::reflectance(&medium, None, f_x_per_mm),
        };
        let reflectance = reflectance.map_err(|e| Error::invalid("reference", e.to_string()))?;
        Ok(match convention {
            Convention::Camera => reflectance.camera,
            Convention::HemisphericalIncident => reflectance.hemispherical_incident,
            Convention::HemisphericalEntered => reflectance.hemispherical_entered,
            Convention::Relative => 1.0,
        })
    }
}

/// Half-spaces that are remembered.
const MOST_KNOWN: usize = 256;

/// R_d of a half-space by transport, up to a second of work. What was asked for once is remembered: the instances of a sweep and the samples of a data set
/// ask for the same phantom by the thousand. A pure function, so that nothing shows but the time.
fn transport(medium: &Medium, f_x_per_mm: f64) -> Result<Reflectance, turbid_optics::Error> {
    type Known = Vec<((Medium, f64), Reflectance)>;
    static KNOWN: Mutex<Known> = Mutex::new(Vec::new());
    let key = (*medium, f_x_per_mm);
    let known = || KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((_, found)) = known().iter().find(|(of, _)| *of == key) {
        return Ok(*found);
    }
    let found = turbid_optics::rte::reflectance(medium, None, f_x_per_mm)?;
    let mut known = known();
    if known.len() == MOST_KNOWN {
        known.remove(0);
    }
    known.push((key, found));
    Ok(found)
}
