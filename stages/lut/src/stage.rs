//! The stage `build_lut`.

use std::sync::atomic::{AtomicUsize, Ordering};

use serde_json::{Value, json};
use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{Lut, Validity};
use turbid_contract::{
    Attributes, Cells, Ctx, Error, ImageStack, Known, LayerInfo, Problems, Stage, StagePlan, Table, in_ports, out_ports,
};
use turbid_optics::level::named;
use turbid_optics::philox;

use crate::monte_carlo::{self, Estimate, PARTS};
use crate::params::{Model, Params, SAMPLES};
use crate::table::Recipe;
use crate::validity::{Report, examine};

in_ports! {
    pub struct In {}
}

out_ports! {
    pub struct Out {
        /// Reflectance at each node and spatial frequency.
        lut: one Lut,
        /// Over the nodes: noise gains of mu_a and mu_s', sign of the Jacobian.
        validity: optional Validity,
    }
}

/// Of one core, over the default range (examples/monte_carlo.rs).
const SECONDS_PER_PATH: f64 = 1.2e-5;
/// Paths between looks at whether the run was cancelled.
const CHUNK: u64 = 1024;

/// `use: build_lut`
pub struct BuildLut;

impl Stage for BuildLut {
    const NAME: &'static str = "build_lut";
    const VERSION: u32 = 1;
    const ABOUT: &'static str =
        "Look-up table of reflectance over mu_a and mu_s' from transport, Monte Carlo or diffusion";

    type Params = Params;
    type In = In<'static>;
    type Out = Out;

    fn draws(params: &Params) -> bool {
        params.model == Model::MonteCarlo
    }

    fn check(params: &Params, _known: &Known, problems: &mut Problems) {
        params.check(problems);
    }

    fn plan(params: &Params, _known: &Known) -> StagePlan {
        let recipe = params.recipe();
        let nodes = recipe.mu_a.len() * recipe.mu_s_prime.len();
        let modulated = recipe.f_x.iter().filter(|&&f_x| f_x > 0.0).count();
        // Seconds per value on one core, measured over the default range (benches/build_lut.rs).
        let (uniform, patterned) = match (params.model, params.thickness) {
            (Model::Diffusion | Model::MonteCarlo, _) => (1e-6, 1e-6),
            (Model::Rte, None) => (5e-4, 3e-3),
            (Model::Rte, Some(_)) => (4e-3, 6e-2),
        };
        let seconds = if params.model == Model::MonteCarlo {
            params.samples.unwrap_or(SAMPLES) as f64 * SECONDS_PER_PATH
        } else {
            nodes as f64 * (modulated as f64 * patterned + (recipe.f_x.len() - modulated) as f64 * uniform)
        };
        let mut left_out = Vec::new();
        if params.thickness.is_none() {
            left_out.push("slab (no thickness)".to_owned());
        }
        if recipe.n == 1.0 {
            left_out.push("Fresnel reflection (n = 1)".to_owned());
        }
        if modulated == 0 {
            left_out.push("azimuthal modes (f_x = 0)".to_owned());
        }
        let method = match params.model {
            Model::Rte => "rte: Galerkin in depth, discrete rays, GMRES",
            Model::Diffusion => "diffusion: closed form, exact Fresnel moments",
            Model::MonteCarlo => "monte_carlo: one white run, rescaled to every node",
        };
        let bytes = (recipe.f_x.len() * nodes * 5 * 8) as u64;
        StagePlan {
            method: Some(method.into()),
            needs: Vec::new(),
            left_out,
            seconds: Some(seconds),
            bytes: Some(bytes),
        }
    }

    fn run(params: &Params, _inputs: In<'_>, ctx: Ctx<'_>) -> Result<Out, Error> {
        let recipe = params.recipe();
        let Estimate { r_d: values, se } = match params.model {
            Model::MonteCarlo => simulate(params, &recipe, ctx)?,
            _ => solve(&recipe, ctx)?,
        };
        let grids = recipe.grids(&values).map_err(|error| {
            Error::failed_with_hint(
                format!("the table cannot be interpolated: {error}"),
                "narrow mu_s_prime or lower f_x: there is no modulation left to tabulate",
            )
        })?;
        let report = (grids.len() > 1).then(|| examine(&grids));
        if let Some(report) = &report {
            tell(report, ctx);
        }
        let wanted = report.filter(|_| ctx.wants("validity"));
        Ok(Out { lut: lut(params, &recipe, values, se), validity: wanted.map(|report| image(&recipe, &report)) })
    }
}

/// Values of a deterministic model: no random error.
fn solve(recipe: &Recipe, ctx: Ctx<'_>) -> Result<Estimate, Error> {
    let done = AtomicUsize::new(0);
    let rows = ctx.map_tiles(recipe.rows(), |row| {
        let values = recipe.row(row);
        let done = done.fetch_add(1, Ordering::Relaxed) + 1;
        ctx.progress(done as f64, Some(recipe.rows() as f64), "rows");
        values
    })?;
    let mut r_d = Vec::new();
    for row in rows {
        r_d.extend(row.map_err(|error| Error::failed(error.to_string()))?);
    }
    let se = vec![0.0; r_d.len()];
    Ok(Estimate { r_d, se })
}

fn simulate(params: &Params, recipe: &Recipe, ctx: Ctx<'_>) -> Result<Estimate, Error> {
    let white = monte_carlo::white(recipe);
    let each = params.samples.unwrap_or(SAMPLES).div_ceil(PARTS as u64);
    let key = philox::key(ctx.seed());
    let done = AtomicUsize::new(0);
    let parts = ctx.map_tiles(PARTS, |part| {
        let mut tally = white.tally(named(ctx.simd()));
        let mut first = part as u64 * each;
        let end = first + each;
        while first < end && !ctx.cancelled() {
            let count = CHUNK.min(end - first);
            white.trace(key, first, count, &mut tally);
            first += count;
        }
        let done = done.fetch_add(1, Ordering::Relaxed) + 1;
        ctx.progress(done as f64, Some(PARTS as f64), "parts");
        tally.mean(&white)
    })?;
    // A part that was cut short must not enter.
    ctx.checked()?;
    let estimate = monte_carlo::estimate(recipe, &white, &parts).map_err(|error| {
        Error::failed_with_hint(format!("the paths are too few: {error}"), "raise `samples`, or narrow the axes")
    })?;
    let mut errors: Vec<f64> = estimate.se.iter().zip(&estimate.r_d).map(|(se, r)| 100.0 * se / r).collect();
    errors.sort_by(f64::total_cmp);
    ctx.measure("error: r_d per node", errors[errors.len() / 2], "%");
    ctx.measure("largest_error", errors[errors.len() - 1], "%");
    Ok(estimate)
}

fn tell(report: &Report, ctx: Ctx<'_>) {
    ctx.measure("invertible", if report.invertible() { 1.0 } else { 0.0 }, "1");
    let largest = |k: usize| report.noise_gain.iter().map(|gain| gain[k]).fold(0.0, f64::max);
    ctx.measure("largest_noise_gain_mu_a", largest(0), "1");
    ctx.measure("largest_noise_gain_mu_s_prime", largest(1), "1");
    if report.folded > 0 {
        ctx.warn(format!(
            "the table folds: at {} nodes or cell centres the Jacobian has another sign than elsewhere, so some \
             reflectances belong to two media; narrow mu_a or mu_s_prime",
            report.folded
        ));
    } else if report.hull_crosses {
        ctx.warn("the boundary of the table crosses itself: some reflectances belong to two media far apart");
    }
}

fn attributes(params: &Params, recipe: &Recipe) -> Attributes {
    let mut attributes = Attributes::new();
    let mut set = |name: &str, value: Value| attributes.insert(name.to_owned(), value);
    set("model", json!(params.model));
    set("convention", json!(params.convention));
    set("f_x", json!(recipe.f_x));
    set("mu_a", json!(recipe.mu_a));
    set("mu_s_prime", json!(recipe.mu_s_prime));
    set("g", json!(recipe.g));
    set("n", json!(recipe.n));
    set("thickness", json!(recipe.thickness));
    attributes
}

fn lut(params: &Params, recipe: &Recipe, r_d: Vec<f64>, r_d_se: Vec<f64>) -> Lut {
    let (n_a, n_s, size) = (recipe.mu_a.len(), recipe.mu_s_prime.len(), r_d.len());
    let column = |f: &dyn Fn(usize) -> f64| Cells::F64((0..size).map(f).collect());
    let mut table = Table { columns: Vec::new(), attributes: attributes(params, recipe) };
    table.push("mu_a", "mm^-1", column(&|i| recipe.mu_a[i / n_s % n_a]));
    table.push("mu_s_prime", "mm^-1", column(&|i| recipe.mu_s_prime[i % n_s]));
    table.push("f_x", "mm^-1", column(&|i| recipe.f_x[i / (n_a * n_s)]));
    table.push("r_d", "1", Cells::F64(r_d));
    // Random errors only; systematic ones are in the docs.
    table.push("r_d_se", "1", Cells::F64(r_d_se));
    Lut(table)
}

/// Rows are mu_a (the largest on top), columns mu_s', as a plot would show them.
fn image(recipe: &Recipe, report: &Report) -> Validity {
    let (n_a, n_s) = (recipe.mu_a.len(), recipe.mu_s_prime.len());
    let mut stack = ImageStack::new(n_a, n_s);
    let layer = |value: &dyn Fn(usize) -> f64| {
        Array2::from_shape_fn((n_a, n_s), |(row, column)| value((n_a - 1 - row) * n_s + column) as f32)
    };
    stack.push(LayerInfo::value("noise_gain_mu_a", "1"), layer(&|i| report.noise_gain[i][0]));
    stack.push(LayerInfo::value("noise_gain_mu_s_prime", "1"), layer(&|i| report.noise_gain[i][1]));
    stack.push(LayerInfo::value("jacobian_sign", "1"), layer(&|i| report.sign[i]));
    stack.attributes.insert("mu_a".to_owned(), json!(recipe.mu_a));
    stack.attributes.insert("mu_s_prime".to_owned(), json!(recipe.mu_s_prime));
    stack.attributes.insert("f_x".to_owned(), json!(recipe.f_x));
    Validity(stack)
}
