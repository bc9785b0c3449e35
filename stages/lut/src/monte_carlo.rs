//! A table from one white Monte Carlo run: which (alpha, kappa) it scores, and how nodes and standard errors come of them.

use turbid_optics::{Error, LogGrid, PhaseFunction};

use crate::nodes::Nodes;
use crate::table::Recipe;
use crate::white::White;

/// Nodes of the run per decade of alpha and of kappa: the spline between them adds less than 0.01 %.
const PER_DECADE: [f64; 2] = [5.0, 7.0];
/// Independent parts of a run, from whose spread the standard errors come: they are known to 6 %.
pub const PARTS: usize = 128;

/// Reflectances in table order with their standard errors.
pub struct Estimate {
    pub r_d: Vec<f64>,
    pub se: Vec<f64>,
}

/// The run that a table needs.
pub fn white(recipe: &Recipe) -> White {
    let ends = |nodes: &[f64]| [nodes[0], nodes[nodes.len() - 1]];
    let (mu_a, mu_s_prime) = (ends(&recipe.mu_a), ends(&recipe.mu_s_prime));
    // A hair more, so that the ends lie inside after rounding.
    let span = |numerator: [f64; 2], per_decade: f64| {
        let [low, high] = [numerator[0] / mu_s_prime[1] * (1.0 - 1e-9), numerator[1] / mu_s_prime[0] * (1.0 + 1e-9)];
        Nodes::logspace(low, high, 2 + (per_decade * libm::log10(high / low)).ceil() as usize).0
    };
    let patterned: Vec<f64> = recipe.f_x.iter().copied().filter(|&f| f > 0.0).collect();
    let mut kappa = Vec::new();
    if patterned.len() < recipe.f_x.len() {
        kappa.push(0.0);
    }
    if !patterned.is_empty() {
        kappa.extend(span(ends(&patterned), PER_DECADE[1]));
    }
    White {
        phase: PhaseFunction::henyey_greenstein(recipe.g),
        n: recipe.n,
        convention: recipe.convention,
        alpha: span(mu_a, PER_DECADE[0]),
        kappa,
    }
}

/// The table, from the mean T of each part, of equal numbers of paths.
///
/// Error: a mean that is not positive, where the paths are too few to see anything.
pub fn estimate(recipe: &Recipe, white: &White, parts: &[Vec<f64>]) -> Result<Estimate, Error> {
    let count = parts.len() as f64;
    let (r_d, deviations) = deviations(recipe, white, parts)?;
    let se = r_d.iter().enumerate().map(|(i, r)| {
        let squares: f64 = deviations.iter().map(|part| part[i] * part[i]).sum();
        r * (squares / (count - 1.0) / count).sqrt()
    });
    Ok(Estimate { se: se.collect(), r_d })
}

/// Reflectances in table order, and by how much each part's lie above them, relative.
///
/// Error: as [`estimate`].
pub fn deviations(recipe: &Recipe, white: &White, parts: &[Vec<f64>]) -> Result<(Vec<f64>, Vec<Vec<f64>>), Error> {
    let size = white.alpha.len() * white.kappa.len();
    let count = parts.len() as f64;
    let mean: Vec<f64> = (0..size).map(|i| parts.iter().map(|part| part[i]).sum::<f64>() / count).collect();
    let r_d = nodes(recipe, white, &mean)?;
    let mut all = Vec::with_capacity(parts.len());
    for part in parts {
        // The interpolation is linear in ln T: so are small deviations. T itself may be negative in one part.
        let moved: Vec<f64> = part.iter().zip(&mean).map(|(p, m)| m * libm::exp((p / m - 1.0) / count)).collect();
        all.push(nodes(recipe, white, &moved)?.iter().zip(&r_d).map(|(r, base)| count * libm::log(r / base)).collect());
    }
    Ok((r_d, all))
}

/// T at (mu_a / mu_s', f_x / mu_s') of every node.
fn nodes(recipe: &Recipe, white: &White, t: &[f64]) -> Result<Vec<f64>, Error> {
    let n_a = white.alpha.len();
    let uniform = match white.kappa[0] {
        // A surface that is the same at two places: a curve.
        0.0 => Some(LogGrid::new(&[1.0, 2.0], &white.alpha, &[&t[..n_a], &t[..n_a]].concat())?),
        _ => None,
    };
    let skip = usize::from(uniform.is_some());
    let patterned = match &white.kappa[skip..] {
        [] => None,
        kappa => Some(LogGrid::new(kappa, &white.alpha, &t[skip * n_a..])?),
    };
    let mut values = Vec::with_capacity(recipe.rows() * recipe.mu_s_prime.len());
    for &f_x in &recipe.f_x {
        for &mu_a in &recipe.mu_a {
            for &mu_s_prime in &recipe.mu_s_prime {
                let alpha = mu_a / mu_s_prime;
                let value = if f_x > 0.0 {
                    patterned.as_ref().and_then(|grid| grid.value(f_x / mu_s_prime, alpha))
                } else {
                    uniform.as_ref().and_then(|grid| grid.value(1.0, alpha))
                };
                values.push(value.expect("the run spans the table"));
            }
        }
    }
    Ok(values)
}
