//! The stage `build_lut`.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};

use serde_json::json;
use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{CONDITIONS, Convention, Fit, Lut, Modulation, Sections, Truth, Validity};
use turbid_contract::{
    Cells, Ctx, Error, Extent, Extents, Forms, ImageStack, Known, Pilot, Problems, Stage, StagePlan, Table, in_ports,
    out_ports,
};
use turbid_optics::level::named;
use turbid_optics::philox;

use crate::bound;
use crate::design::{Design, design};
use crate::empirical::{self, Between};
use crate::form::{self, MEDIUM, attributes};
use crate::monte_carlo::{self, Estimate, PARTS};
use crate::params::{Interpolation, Model, Params, ReferenceMedium, SAMPLES};
use crate::phantoms::{self, Part, Sources};
use crate::pilot;
use crate::table::Recipe;
use crate::validity::{self, Report, examine};

in_ports! {
    pub struct In {
        /// What was seen of phantoms of known properties, gathered over their axes (`model: empirical`).
        phantoms: many Modulation,
        /// The reference seen the same way: one for all, or one for each value of an axis that it shares with the phantoms.
        references: many Modulation,
        /// Properties of the phantoms as they were measured: one fit for each, or one whose media an axis of the phantoms names.
        properties: many Fit,
        /// Properties of the phantoms as the camera truly saw them, where there is no fit.
        truths: many Truth,
        /// Sections of the surface that the camera sees: the table gets one part for each.
        sections: optional Sections,
    }
}

out_ports! {
    pub struct Out {
        /// Reflectance at each node and spatial frequency.
        lut: one Lut,
        /// Over the nodes: noise gains of mu_a and mu_s', sign of the Jacobian.
        validity: optional Validity,
        /// What to put into phantoms so that they become the media `wanted`.
        design: optional Design,
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
    const VERSION: u32 = 7;
    const ABOUT: &'static str =
        "Look-up table of reflectance over mu_a and mu_s' from transport, Monte Carlo or diffusion";

    type Params = Params;
    type In = In<'static>;
    type Out = Out;

    fn draws(params: &Params) -> bool {
        params.model == Model::MonteCarlo
    }

    fn check(params: &Params, known: &Known, problems: &mut Problems) {
        params.check(problems);
        check_ports(params, known, problems);
        form::check(params, known, problems);
    }

    fn describe(params: &Params, known: &Known) -> Forms {
        form::describe(params, known)
    }

    fn plan(params: &Params, _known: &Known) -> StagePlan {
        let recipes = params.recipes();
        let Some(recipe) = recipes.first() else { return StagePlan::default() };
        let tables = recipes.len();
        // An empirical table may not know its axes yet.
        let count = |axis: &[f64]| if axis.is_empty() { empirical::NODES } else { axis.len() };
        let nodes = count(&recipe.mu_a) * count(&recipe.mu_s_prime);
        let guides = params.interpolation() == Interpolation::Guided;
        let modulated = recipe.f_x.iter().filter(|&&f_x| f_x > 0.0).count();
        // Seconds per value on one core, measured over the default range (benches/build_lut.rs).
        let (uniform, patterned) = match (params.model, params.thickness) {
            (Model::Diffusion | Model::MonteCarlo, _) => (1e-6, 1e-6),
            (Model::Empirical, _) if !guides => (1e-6, 1e-6),
            (_, None) => (2e-4, 1.3e-3),
            (_, Some(_)) => (4e-3, 6e-2),
        };
        let seconds = tables as f64
            * if params.model == Model::MonteCarlo {
                params.samples.unwrap_or(SAMPLES) as f64 * SECONDS_PER_PATH
            } else {
                nodes as f64 * (modulated as f64 * patterned + (recipe.f_x.len() - modulated) as f64 * uniform)
            };
        let mut left_out = Vec::new();
        if params.thickness.is_none() {
            left_out.push("slab (no thickness)".to_owned());
        }
        if recipes.iter().all(|recipe| recipe.n == 1.0) {
            left_out.push("Fresnel reflection (n = 1)".to_owned());
        }
        if modulated == 0 {
            left_out.push("azimuthal modes (f_x = 0)".to_owned());
        }
        let method = match params.model {
            Model::Rte => "rte: Galerkin in depth, discrete rays, GMRES",
            Model::Diffusion => "diffusion: closed form, exact Fresnel moments",
            Model::MonteCarlo => "monte_carlo: one white run, rescaled to every node",
            Model::Empirical => match params.interpolation() {
                Interpolation::Guided => "empirical: phantoms over transport, a polynomial in log-log",
                Interpolation::LogLog => "empirical: a polynomial in log-log",
                Interpolation::Paper => {
                    "empirical: linear between phantoms on 100 x 100 nodes (the paper's first step)"
                }
            },
        };
        let columns = if tables > 1 { 7 } else { 5 };
        let rows = tables * recipe.f_x.len() * nodes;
        let bytes = (rows * columns * 8) as u64;
        StagePlan {
            method: Some(method.into()),
            left_out,
            seconds: Some(seconds),
            bytes: Some(bytes),
            memory: Some(2 * bytes),
            makes: Extents::from([("lut", Extent::Table { rows: rows as u64, columns: columns as u64 })]),
            ..StagePlan::default()
        }
    }

    fn pilot(params: &Params, _: &Known, ctx: Ctx<'_>) -> Option<Pilot> {
        pilot::pilot(params, ctx)
    }

    fn run(params: &Params, inputs: In<'_>, ctx: Ctx<'_>) -> Result<Out, Error> {
        let recipes = params.recipes();
        let first = || recipes.first().cloned().ok_or_else(|| Error::invalid("g", "no value of g and n is given"));
        let sections = inputs.sections.as_ref();
        let (recipe, Estimate { r_d: values, se }, design, known) = match params.model {
            Model::MonteCarlo => (first()?, simulate(params, &recipes, ctx)?, None, true),
            Model::Empirical => measure(params, first()?, &inputs, ctx)?,
            _ => (first()?, solve(&recipes, ctx)?, None, true),
        };
        let se: Vec<Option<f64>> = se.into_iter().map(|se| known.then_some(se)).collect();
        let parts = sections.map_or(Ok(recipes.len()), |s| s.list().map(|list| list.len()))?;
        let named = |part: usize| match sections {
            _ if parts == 1 => String::new(),
            Some(_) => format!(" of section {part}"),
            None => format!(" of g = {}, n = {}", recipes[part].g, recipes[part].n),
        };
        let mut reports = Vec::new();
        for (section, values) in values.chunks(values.len() / parts).enumerate() {
            let grids = recipe.grids(values).map_err(|error| {
                Error::failed_with_hint(
                    format!("the table{} cannot be interpolated: {error}", named(section)),
                    "narrow mu_s_prime or lower f_x: there is no modulation left to tabulate",
                )
            })?;
            reports.extend((grids.len() > 1).then(|| examine(&grids)));
        }
        if !reports.is_empty() {
            tell(&reports, &named, ctx);
        }
        let wanted = ctx.wants("validity") && !reports.is_empty();
        let validity = wanted.then(|| image(&recipe, &reports));
        let bounds = match params.model {
            Model::Rte => bounds(&recipes, &values, ctx)?,
            // The spline between the nodes of the white run (`interpolation_of_the_white_run_is_below_its_noise`).
            Model::MonteCarlo => values.iter().map(|r| Some(2e-5 * r)).collect(),
            // What a model or an instrument leaves out is not known from within.
            Model::Diffusion | Model::Empirical => vec![None; values.len()],
        };
        let mut table = lut(params, (&recipe, &recipes), values, se, bounds, sections)?;
        if !inputs.phantoms.axes().is_empty() {
            // As the first phantom was seen, so were all: they share camera, light and geometry.
            table.attributes.extend(inputs.phantoms.load(0)?.0.attributes.remove_entry(CONDITIONS));
        }
        Ok(Out { lut: table.into(), validity, design })
    }
}

/// Values of a deterministic model: no random error.
fn solve(recipes: &[Recipe], ctx: Ctx<'_>) -> Result<Estimate, Error> {
    let done = AtomicUsize::new(0);
    // All tables have the same axes.
    let each = recipes.first().map_or(0, Recipe::rows);
    let count = recipes.len() * each;
    let rows = ctx.map_tiles(count, |row| {
        let values = recipes[row / each].row(row % each);
        let done = done.fetch_add(1, Ordering::Relaxed) + 1;
        ctx.progress(done as f64, Some(count as f64), "rows");
        values
    })?;
    let mut r_d = Vec::new();
    for row in rows {
        r_d.extend(row.map_err(|error| Error::failed(error.to_string()))?);
    }
    ctx.measure(pilot::VALUES, r_d.len() as f64, "1");
    let se = vec![0.0; r_d.len()];
    Ok(Estimate { r_d, se })
}

/// What the solver's discretisation leaves uncertain of each row.
fn bounds(recipes: &[Recipe], values: &[f64], ctx: Ctx<'_>) -> Result<Vec<Option<f64>>, Error> {
    let mut bounds = Vec::new();
    for (recipe, values) in recipes.iter().zip(values.chunks(values.len() / recipes.len())) {
        let samples = bound::samples(recipe);
        let changes = ctx.map_tiles(samples.len(), |i| bound::change(recipe, samples[i]))?;
        bounds.extend(bound::bounds(recipe, &changes, values));
    }
    if let Some(largest) = bounds.iter().copied().collect::<Option<Vec<f64>>>() {
        ctx.measure("largest_bound", largest.into_iter().fold(0.0, f64::max), "1");
    }
    Ok(bounds)
}

/// Ports that `model: empirical` must have, and that no other model reads.
fn check_ports(params: &Params, known: &Known, problems: &mut Problems) {
    let connected = |port: &str| known.connected.iter().any(|c| c == port);
    if params.model != Model::Empirical {
        for port in ["phantoms", "references", "properties", "truths", "sections"].into_iter().filter(|p| connected(p))
        {
            let message = format!("`{port}` is connected, but only `model: empirical` reads it");
            problems.push_with_hint("model", message, "take `model: empirical` or leave the input out");
        }
        return;
    }
    for port in ["phantoms", "references"].into_iter().filter(|p| !connected(p)) {
        let way_out = format!("in: {{{port}: the modulation of a demodulate stage}}");
        problems.push_with_hint("model", format!("`model: empirical` needs the input `{port}`"), way_out);
    }
    if connected("properties") == connected("truths") {
        let message = "the phantoms' properties come from `properties` (a fit of calibrate_iad) or from `truths` (of render): connect one of them";
        problems.push("model", message);
    }
}

/// The table of phantoms; its axes may have been filled from what they span. And whether its standard errors are known.
fn measure(
    params: &Params,
    recipe: Recipe,
    inputs: &In<'_>,
    ctx: Ctx<'_>,
) -> Result<(Recipe, Estimate, Option<Design>, bool), Error> {
    let sources = Sources {
        phantoms: &inputs.phantoms,
        references: &inputs.references,
        properties: &inputs.properties,
        truths: &inputs.truths,
    };
    let parts = phantoms::gather(&sources, &recipe.f_x, &Part::of(inputs.sections.as_ref())?)?;
    let knowing = parts.iter().flatten().all(|phantom| phantom.ratio_known);
    if !knowing {
        ctx.warn(
            "no standard errors: the phantoms or their reference do not know their own, and so the table does not",
        );
    }
    let reference = reference(params, &recipe)?;
    // Sections ask for the same media again and again.
    let known: RefCell<BTreeMap<[u64; 3], f64>> = RefCell::default();
    let guide = |f_x: f64, places: &[[f64; 2]]| -> Result<Vec<f64>, Error> {
        let name = |place: &[f64; 2]| [f_x, place[0], place[1]].map(f64::to_bits);
        let new: Vec<[f64; 2]> = places.iter().filter(|p| !known.borrow().contains_key(&name(p))).copied().collect();
        let values = ctx.map_tiles(new.len(), |i| recipe.value(new[i][0], new[i][1], f_x))?;
        for (place, value) in new.iter().zip(values) {
            let value = value.map_err(|e| Error::failed(e.to_string()))?;
            known.borrow_mut().insert(name(place), libm::log(value));
        }
        Ok(places.iter().map(|p| known.borrow()[&name(p)]).collect())
    };
    let between = match params.interpolation() {
        Interpolation::Guided => Between::Guided(&guide),
        Interpolation::LogLog => Between::Smooth,
        Interpolation::Paper => Between::Linear(phantoms::grid(inputs.phantoms.axes()).ok_or_else(|| {
            Error::failed_with_hint(
                format!("the {} phantoms are not the full grid of two axes", inputs.phantoms.axes().len()),
                "the paper's linear step needs one; take `interpolation: log_log` or `guided`",
            )
        })?),
    };
    let mut all = Estimate { r_d: Vec::new(), se: Vec::new() };
    let mut filled = recipe.clone();
    for phantoms in &parts {
        let table = empirical::table(phantoms, recipe.clone(), &reference, &between)?;
        if all.r_d.is_empty() {
            ctx.measure("phantoms", phantoms.len() as f64, "1");
            if let Some([a, s]) = table.degrees {
                ctx.measure("degree_mu_a", a as f64, "1");
                ctx.measure("degree_mu_s_prime", s as f64, "1");
                ctx.measure("gain", table.gain, "1");
            }
        }
        all.r_d.extend(table.r_d);
        all.se.extend(table.se);
        filled = table.recipe;
    }
    // An error of 0 % would be made up.
    if knowing {
        tell_errors(&all.r_d, &all.se, ctx);
    }
    let design = match &params.wanted {
        Some(wanted) if ctx.wants("design") => {
            let media: Vec<[f64; 2]> = wanted.iter().map(|w| [w.mu_a.0, w.mu_s_prime.0]).collect();
            Some(design(inputs.phantoms.axes(), &parts[0], &media)?)
        }
        _ => None,
    };
    Ok((filled, all, design, knowing))
}

/// Reflectance of the reference phantom at each f_x; 1 in the relative convention.
fn reference(params: &Params, recipe: &Recipe) -> Result<Vec<f64>, Error> {
    let Some(ReferenceMedium { mu_a, mu_s_prime }) =
        params.reference.filter(|_| params.convention != Convention::Relative)
    else {
        return Ok(vec![1.0; recipe.f_x.len()]);
    };
    let half_space = Recipe { thickness: None, ..recipe.clone() };
    let value = |&f_x: &f64| half_space.value(mu_a.0, mu_s_prime.0, f_x);
    recipe.f_x.iter().map(value).collect::<Result<_, _>>().map_err(|e| Error::invalid("reference", e.to_string()))
}

/// The tables one after the other, each of paths of its own: their errors are independent.
fn simulate(params: &Params, recipes: &[Recipe], ctx: Ctx<'_>) -> Result<Estimate, Error> {
    let mut all = Estimate { r_d: Vec::new(), se: Vec::new() };
    let each = params.samples.unwrap_or(SAMPLES).div_ceil(PARTS as u64);
    let done = AtomicUsize::new(0);
    for (table, recipe) in recipes.iter().enumerate() {
        let before = table as u64 * each * PARTS as u64;
        let Estimate { r_d, se } = trace(recipe, (before, each), (&done, recipes.len() * PARTS), ctx)?;
        all.r_d.extend(r_d);
        all.se.extend(se);
    }
    ctx.measure(pilot::PATHS, (recipes.len() as u64 * each * PARTS as u64) as f64, "1");
    tell_errors(&all.r_d, &all.se, ctx);
    Ok(all)
}

/// One table: `each` paths of each part, the first of all having the number `before`. `done` of `count` parts are done.
fn trace(
    recipe: &Recipe,
    (before, each): (u64, u64),
    (done, count): (&AtomicUsize, usize),
    ctx: Ctx<'_>,
) -> Result<Estimate, Error> {
    let white = monte_carlo::white(recipe);
    let key = philox::key(ctx.seed());
    let parts = ctx.map_tiles(PARTS, |part| {
        let mut tally = white.tally(named(ctx.simd()));
        let mut first = before + part as u64 * each;
        let end = first + each;
        while first < end && !ctx.cancelled() {
            let count = CHUNK.min(end - first);
            white.trace(key, first, count, &mut tally);
            first += count;
        }
        let done = done.fetch_add(1, Ordering::Relaxed) + 1;
        ctx.progress(done as f64, Some(count as f64), "parts");
        tally.mean(&white)
    })?;
    // A part that was cut short must not enter.
    ctx.checked()?;
    monte_carlo::estimate(recipe, &white, &parts).map_err(|error| {
        Error::failed_with_hint(format!("the paths are too few: {error}"), "raise `samples`, or narrow the axes")
    })
}

fn tell_errors(r_d: &[f64], se: &[f64], ctx: Ctx<'_>) {
    let mut errors: Vec<f64> = se.iter().zip(r_d).map(|(se, r)| 100.0 * se / r).collect();
    errors.sort_by(f64::total_cmp);
    ctx.measure("error: r_d per node", errors[errors.len() / 2], "%");
    ctx.measure("largest_error", errors[errors.len() - 1], "%");
}

/// What holds for all sections, if there are several: the worst of each figure.
fn tell(reports: &[Report], named: &dyn Fn(usize) -> String, ctx: Ctx<'_>) {
    ctx.measure("invertible", if reports.iter().all(Report::invertible) { 1.0 } else { 0.0 }, "1");
    let largest = |k: usize| reports.iter().flat_map(|r| &r.noise_gain).map(|gain| gain[k]).fold(0.0, f64::max);
    ctx.measure("largest_noise_gain_mu_a", largest(0), "1");
    ctx.measure("largest_noise_gain_mu_s_prime", largest(1), "1");
    for (section, report) in reports.iter().enumerate() {
        let of = named(section);
        if report.folded > 0 {
            ctx.warn(format!(
                "the table{of} folds: at {} nodes or cell centres the Jacobian has another sign than elsewhere, so some \
                 reflectances belong to two media; narrow mu_a or mu_s_prime",
                report.folded
            ));
        } else if report.hull_crosses {
            ctx.warn(format!(
                "the boundary of the table{of} crosses itself: some reflectances belong to two media far apart"
            ));
        }
    }
}

fn lut(
    params: &Params,
    (recipe, recipes): (&Recipe, &[Recipe]),
    r_d: Vec<f64>,
    r_d_se: Vec<Option<f64>>,
    r_d_bound: Vec<Option<f64>>,
    sections: Option<&Sections>,
) -> Result<Table, Error> {
    let (n_a, n_s, size) = (recipe.mu_a.len(), recipe.mu_s_prime.len(), r_d.len());
    let n_f = recipe.f_x.len();
    let column = |f: &dyn Fn(usize) -> f64| Cells::F64((0..size).map(f).collect());
    let mut table = Table { columns: Vec::new(), attributes: attributes(params, recipe) };
    if let Some(sections) = sections {
        table.push("section", "", Cells::I64((0..size).map(|i| (i / (n_a * n_s * n_f)) as i64).collect()));
        table.attributes.insert("sections".to_owned(), json!(sections.list()?));
    }
    if recipes.len() > 1 {
        let of = |i: usize| &recipes[i / (n_a * n_s * n_f)];
        for ((name, unit), column) in MEDIUM.into_iter().zip([column(&|i| of(i).g), column(&|i| of(i).n)]) {
            table.push(name, unit, column);
        }
    }
    table.push("mu_a", "mm^-1", column(&|i| recipe.mu_a[i / n_s % n_a]));
    table.push("mu_s_prime", "mm^-1", column(&|i| recipe.mu_s_prime[i % n_s]));
    table.push("f_x", "mm^-1", column(&|i| recipe.f_x[i / (n_a * n_s) % n_f]));
    table.push("r_d", "1", Cells::F64(r_d));
    // Random errors, and what is systematic.
    table.push("r_d_se", "1", Cells::MaybeF64(r_d_se));
    table.push("r_d_bound", "1", Cells::MaybeF64(r_d_bound));
    Ok(table)
}

/// Rows are mu_a (the largest on top), columns mu_s', as a plot would show them; sections one after the other.
fn image(recipe: &Recipe, reports: &[Report]) -> Validity {
    let (n_a, n_s) = (recipe.mu_a.len(), recipe.mu_s_prime.len());
    let mut stack = ImageStack::new(n_a, n_s);
    let layer = |value: &dyn Fn(usize) -> f64| {
        Array2::from_shape_fn((n_a, n_s), |(row, column)| value((n_a - 1 - row) * n_s + column) as f32)
    };
    for (section, report) in reports.iter().enumerate() {
        let infos = validity::layers((reports.len() > 1).then_some(section));
        let data =
            [layer(&|i| report.noise_gain[i][0]), layer(&|i| report.noise_gain[i][1]), layer(&|i| report.sign[i])];
        infos.into_iter().zip(data).for_each(|(info, data)| stack.push(info, data));
    }
    stack.attributes.insert("mu_a".to_owned(), json!(recipe.mu_a));
    stack.attributes.insert("mu_s_prime".to_owned(), json!(recipe.mu_s_prime));
    stack.attributes.insert("f_x".to_owned(), json!(recipe.f_x));
    Validity(stack)
}
