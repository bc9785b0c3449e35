//! A few values of a table, for `turbid plan` to time.

use turbid_contract::{Ctx, Pilot};
use turbid_optics::philox;

use crate::monte_carlo::{self, PARTS};
use crate::params::{Model, Params, SAMPLES};
use crate::table::Recipe;

/// Measures of a run: values by a deterministic model, paths of the Monte Carlo run.
pub const VALUES: &str = "values";
pub const PATHS: &str = "paths";

/// Nodes of a pilot at each f_x, spread over both axes as queens on a board: k-th in mu_a, `NODES[k]`-th in mu_s'.
const NODES: [usize; 4] = [1, 3, 0, 2];
/// Paths of one: their lengths differ much.
const FEW: u64 = 1024;

/// `None` where phantoms have to be seen before.
pub fn pilot(params: &Params, ctx: Ctx<'_>) -> Option<Pilot> {
    let recipes = params.recipes();
    // The first stands for all: they differ in g and n alone.
    let recipe = recipes.first()?;
    let tables = recipes.len() as f64;
    match params.model {
        Model::Empirical => None,
        Model::MonteCarlo => {
            let white = monte_carlo::white(recipe);
            let each = params.samples.unwrap_or(SAMPLES).div_ceil(PARTS as u64);
            let count = FEW.min(each);
            let key = philox::key(ctx.seed());
            let walk = |_| white.trace(key, 0, count, &mut white.tally(turbid_optics::level::named(ctx.simd())));
            ctx.map_tiles(1, walk).ok()?;
            Some(Pilot { done: count as f64, whole: tables * (each * PARTS as u64) as f64, unit: PATHS, rest_s: 0.0 })
        }
        Model::Rte | Model::Diffusion => {
            let places = places(recipe);
            let of = |i: usize| recipe.value(places[i][1], places[i][2], places[i][0]);
            let values = ctx.map_tiles(places.len(), of).ok()?;
            let done = values.iter().filter(|value| value.is_ok()).count() as f64;
            let whole = tables * (recipe.rows() * recipe.mu_s_prime.len()) as f64;
            (done > 0.0).then_some(Pilot { done, whole, unit: VALUES, rest_s: 0.0 })
        }
    }
}

/// f_x, mu_a and mu_s' of the values: as many at each f_x.
fn places(recipe: &Recipe) -> Vec<[f64; 3]> {
    let count = NODES.len();
    let at = |axis: &[f64], k: usize| axis[(2 * k + 1) * axis.len() / (2 * count)];
    let of = |&f_x: &f64| {
        let nodes = NODES.iter().enumerate();
        nodes.map(move |(k, &l)| [f_x, at(&recipe.mu_a, k), at(&recipe.mu_s_prime, l)])
    };
    recipe.f_x.iter().flat_map(of).collect()
}
