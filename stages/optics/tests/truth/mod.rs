//! The truth tables of `tests/reference` (sources in its README).

use turbid_optics::{Medium, PhaseFunction};

/// What a row states of the response.
#[derive(Clone, Copy, Debug)]
pub enum Quantity {
    HemisphericalIncident,
    Camera,
    Transmittance,
}

/// One value of a truth table.
#[derive(Clone, Debug)]
pub struct Truth {
    pub medium: Medium,
    pub thickness: Option<f64>,
    pub f_x: f64,
    pub quantity: Quantity,
    pub value: f64,
    /// The row's own uncertainty.
    pub error: f64,
}

impl Truth {
    /// The error that the project demands: 1e-5, or twice the row's own where that is more.
    pub fn bound(&self) -> f64 {
        (2.0 * self.error).max(1e-5)
    }
}

fn rows(text: &'static str) -> impl Iterator<Item = Vec<&'static str>> {
    text.lines().skip(1).map(|line| line.split(',').collect())
}

fn number(cell: &str) -> f64 {
    cell.parse().unwrap_or_else(|_| panic!("`{cell}` is not a number"))
}

/// 600 rows, two quantities each: half-spaces, g 0 and 0.8, n 1 and 1.4, f_x 0 to 0.5 mm^-1.
pub fn half_spaces() -> Vec<Truth> {
    rows(include_str!("../reference/rte_halfspace.csv"))
        .flat_map(|r| {
            let r: Vec<f64> = r.into_iter().map(number).collect();
            let medium =
                Medium { phase: PhaseFunction::henyey_greenstein(r[0]), n: r[1], mu_a: r[2], mu_s_prime: r[3] };
            let truth = |quantity, value, error| Truth { medium, thickness: None, f_x: r[4], quantity, value, error };
            [truth(Quantity::HemisphericalIncident, r[5], r[6]), truth(Quantity::Camera, r[7], r[8])]
        })
        .collect()
}

/// Half-spaces and slabs of extreme albedo, thickness and anisotropy, f_x = 0; pure absorbers left out.
pub fn extremes() -> Vec<Truth> {
    let mut truths = Vec::new();
    for row in rows(include_str!("../reference/slab_extreme.csv")) {
        let field =
            |name: &str| row[1].split(' ').find_map(|part| part.strip_prefix(name)?.strip_prefix('=')).map(number);
        let Some(albedo) = field("albedo") else { continue };
        let g = field("g").expect("every scattering row has g");
        let n = field("n").unwrap_or(1.0);
        let medium = Medium {
            mu_a: 1.0 - albedo,
            mu_s_prime: albedo * (1.0 - g),
            phase: PhaseFunction::henyey_greenstein(g),
            n,
        };
        let quantity = if row[2].starts_with('T') { Quantity::Transmittance } else { Quantity::HemisphericalIncident };
        let value = number(row[3]);
        let error = row[4].strip_prefix("relative ").map_or_else(|| number(row[4]), |e| number(e) * value);
        truths.push(Truth { medium, thickness: field("tau"), f_x: 0.0, quantity, value, error });
    }
    truths
}

/// Slabs and half-spaces without slides by adding-doubling, f_x = 0; the specular part taken off.
pub fn adding_doubling() -> Vec<Truth> {
    rows(include_str!("../reference/adding_doubling.csv"))
        .flat_map(|r| {
            let r: Vec<f64> = r.into_iter().map(number).collect();
            let (albedo, g, n) = (r[0], r[2], r[3]);
            let medium = Medium {
                mu_a: 1.0 - albedo,
                mu_s_prime: albedo * (1.0 - g),
                phase: PhaseFunction::henyey_greenstein(g),
                n,
            };
            let thickness = r[1].is_finite().then_some(r[1]);
            let specular = turbid_optics::fresnel::normal_reflectance(n);
            let truth = |quantity, value, error| Truth { medium, thickness, f_x: 0.0, quantity, value, error };
            [truth(Quantity::HemisphericalIncident, r[4] - specular, r[6]), truth(Quantity::Transmittance, r[5], r[6])]
        })
        .collect()
}

/// Isotropic matched half-spaces under normal incidence (mu0 = 1) by Chandrasekhar's H function.
pub fn chandrasekhar() -> Vec<Truth> {
    rows(include_str!("../reference/chandrasekhar_isotropic.csv"))
        .filter(|r| r[1] == "1")
        .map(|r| {
            let albedo = number(r[0]);
            let medium =
                Medium { mu_a: 1.0 - albedo, mu_s_prime: albedo, phase: PhaseFunction::henyey_greenstein(0.0), n: 1.0 };
            let quantity = Quantity::HemisphericalIncident;
            Truth { medium, thickness: None, f_x: 0.0, quantity, value: number(r[3]), error: 1e-14 }
        })
        .collect()
}
