//! The numbers of a table: one reflectance per node and spatial frequency.

use turbid_optics::{Error, LogGrid, Medium, PhaseFunction, Reflectance, diffusion, rte};

/// Which of the three reflectances a table holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Convention {
    Camera,
    HemisphericalIncident,
    HemisphericalEntered,
}

/// Everything a table of models depends on; units as in [`Medium`].
#[derive(Clone, Debug, PartialEq)]
pub struct Recipe {
    /// Radiative transport, or the diffusion approximation.
    pub transport: bool,
    pub f_x: Vec<f64>,
    pub mu_a: Vec<f64>,
    pub mu_s_prime: Vec<f64>,
    pub g: f64,
    pub n: f64,
    pub thickness: Option<f64>,
    pub convention: Convention,
}

impl Recipe {
    /// Number of rows of constant f_x and mu_a: the pieces that may be computed apart.
    pub fn rows(&self) -> usize {
        self.f_x.len() * self.mu_a.len()
    }

    /// The reflectances of one row, over mu_s'; rows run over mu_a within f_x.
    pub fn row(&self, row: usize) -> Result<Vec<f64>, Error> {
        let (f_x, mu_a) = (self.f_x[row / self.mu_a.len()], self.mu_a[row % self.mu_a.len()]);
        self.mu_s_prime.iter().map(|&mu_s_prime| self.value(mu_a, mu_s_prime, f_x)).collect()
    }

    /// The reflectance of one medium.
    pub fn value(&self, mu_a: f64, mu_s_prime: f64, f_x: f64) -> Result<f64, Error> {
        let medium = Medium { mu_a, mu_s_prime, phase: PhaseFunction::henyey_greenstein(self.g), n: self.n };
        let model = if self.transport { rte::reflectance } else { diffusion::reflectance };
        let Reflectance { camera, hemispherical_incident, hemispherical_entered } =
            model(&medium, self.thickness, f_x)?;
        Ok(match self.convention {
            Convention::Camera => camera,
            Convention::HemisphericalIncident => hemispherical_incident,
            Convention::HemisphericalEntered => hemispherical_entered,
        })
    }

    /// One interpolant per f_x of the values in table order (f_x outermost, then mu_a, then mu_s').
    pub fn grids(&self, values: &[f64]) -> Result<Vec<LogGrid>, Error> {
        let size = self.mu_a.len() * self.mu_s_prime.len();
        values.chunks(size).map(|values| LogGrid::new(&self.mu_a, &self.mu_s_prime, values)).collect()
    }
}
