//! What the transport solver's own discretisation leaves uncertain of a table: its answer against that of finer orders.

use turbid_optics::rte::{self, Orders};
use turbid_optics::{Medium, PhaseFunction, Reflectance};

use crate::table::{Convention, Recipe};

/// Directions, moments, modes and azimuths are raised by this for the comparison.
const FINER: f64 = 1.5;
/// Error over change: with sharp peaks at n > 1 errors fall as slowly as 1 / orders^2 (`docs/theory/rte.md`), so half of it is left at
/// the finer orders, 1 / (1 - 1.5^-2) = 1.8; rounded up to 3 because errors change sign with the orders.
const SAFETY: f64 = 3.0;
/// What the basis over depth adds, absolute: orders do not show it.
const DEPTH: f64 = 1e-6;

/// A node of a table: indices of f_x, mu_a and mu_s'.
pub type Node = [usize; 3];

/// Where the bound is measured: the corners and the middle of each f_x.
pub fn samples(recipe: &Recipe) -> Vec<Node> {
    let (n_a, n_s) = (recipe.mu_a.len(), recipe.mu_s_prime.len());
    let places = [[0, 0], [0, n_s - 1], [n_a - 1, 0], [n_a - 1, n_s - 1], [n_a / 2, n_s / 2]];
    (0..recipe.f_x.len()).flat_map(|f| places.map(|[a, s]| [f, a, s])).collect()
}

/// |R - R of finer orders| / R at a node; `None` where the finer solver has no answer.
pub fn change(recipe: &Recipe, [f, a, s]: Node) -> Option<f64> {
    let (mu_a, mu_s_prime, f_x) = (recipe.mu_a[a], recipe.mu_s_prime[s], recipe.f_x[f]);
    let phase = PhaseFunction::henyey_greenstein(recipe.g);
    let raise = |count: usize| (count as f64 * FINER).ceil() as usize;
    let orders = |kappa: f64| {
        let own = Orders::new(&phase, recipe.n, kappa);
        Orders {
            degree: raise(own.degree),
            cosines: raise(own.cosines),
            modes: if kappa == 0.0 { 1 } else { raise(own.modes) },
            azimuths: if kappa == 0.0 { 1 } else { raise(own.azimuths) },
            tolerance: 0.1 * own.tolerance,
        }
    };
    let medium = Medium { mu_a, mu_s_prime, phase, n: recipe.n };
    let finer = rte::respond_with(&medium, recipe.thickness, f_x, orders).ok()?.reflectance;
    let Reflectance { camera, hemispherical_incident, hemispherical_entered } = finer;
    let finer = match recipe.convention {
        Convention::Camera => camera,
        Convention::HemisphericalIncident => hemispherical_incident,
        Convention::HemisphericalEntered => hemispherical_entered,
    };
    let own = recipe.value(mu_a, mu_s_prime, f_x).ok()?;
    let change = ((own - finer) / own).abs();
    change.is_finite().then_some(change)
}

/// The bound of each row's `r_d`, absolute, from the changes at the samples; `None` where one of its f_x could not be measured.
///
/// Between samples the logarithm of the relative change is bilinear in the indices, which are logarithms of the coefficients, with
/// a tent over the middle.
pub fn bounds(recipe: &Recipe, changes: &[Option<f64>], r_d: &[f64]) -> Vec<Option<f64>> {
    let (n_a, n_s) = (recipe.mu_a.len(), recipe.mu_s_prime.len());
    // Rounding of the solver's iteration: a change below it says nothing.
    let logs: Vec<Option<f64>> = changes.iter().map(|c| c.map(|c| libm::log(c.max(1e-9)))).collect();
    let share = |i: usize, n: usize| if n > 1 { i as f64 / (n - 1) as f64 } else { 0.0 };
    let of = |row: usize| -> Option<f64> {
        let (f, a, s) = (row / (n_a * n_s), row / n_s % n_a, row % n_s);
        let of = &logs[5 * f..5 * f + 5];
        let [low, right, up, far] = [of[0]?, of[1]?, of[2]?, of[3]?];
        let (u, v) = (share(a, n_a), share(s, n_s));
        let plane = |u: f64, v: f64| (1.0 - u) * ((1.0 - v) * low + v * right) + u * ((1.0 - v) * up + v * far);
        let tent = (1.0 - (2.0 * u - 1.0).abs()) * (1.0 - (2.0 * v - 1.0).abs());
        let middle = of[4]? - plane(share(n_a / 2, n_a), share(n_s / 2, n_s));
        Some(SAFETY * libm::exp(plane(u, v) + tent * middle) * r_d[row].abs() + DEPTH)
    };
    (0..r_d.len()).map(of).collect()
}
