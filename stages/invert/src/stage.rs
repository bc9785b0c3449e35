//! The stage `invert`: checks that reflectance and table mean the same, and inverts each wavelength.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{Covariance, Lut, Maps, Reflectance};
use turbid_contract::planes::mean_se;
use turbid_contract::{
    AngleDeg, Attributes, Ctx, Error, ImageStack, Known, Layer, LayerInfo, LayerKind, PerLength, Problems, Stage,
    StagePlan, in_ports, out_ports, serde_json,
};
use turbid_optics::LogGrid;

use crate::forward::Forward;
use crate::inverse::{InverseTable, TOLERANCE};
use crate::least_squares::{LeastSquares, MOST};
use crate::linear::Triangles;
use crate::nearest::Nodes;
use crate::pair::{Inside, Inverter};
use crate::pass::{Pass, Tally};
use crate::surface::Surface;

/// How a pair of reflectances becomes a pair of properties.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// Bilinear in a table that was resampled once to uniform coordinates of the reflectance.
    #[default]
    Table,
    /// The nearest node of the look-up table in whitened ln R.
    Nearest,
    /// Linear in ln R over the two triangles of each cell of the nodes.
    Linear,
    /// The exact inverse of the bicubic surface through the nodes, pixel by pixel.
    Bicubic,
    /// The best fit to all f_x, by the surfaces of `bicubic`, weighted by the standard errors.
    LeastSquares,
}

impl Method {
    fn name(self) -> &'static str {
        match self {
            Self::Table => "table",
            Self::Nearest => "nearest",
            Self::Linear => "linear",
            Self::Bicubic => "bicubic",
            Self::LeastSquares => "least_squares",
        }
    }
}

/// What becomes of a pixel whose reflectance the table does not hold.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Outside {
    /// Masked, with the side on which the table ended.
    #[default]
    Mask,
    /// The nearest node; the layer `outside` names the side for each such pixel, since the mask calls it good.
    Nearest,
}

/// What becomes of the part of the mean that noise adds: p(R) is curved, so noise that is zero in the mean of R is not
/// zero in the mean of mu_a.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum NoiseBias {
    /// Taken off pixel by pixel, to second order in the standard errors; without these nothing changes.
    #[default]
    Correct,
    /// Left in: each pixel holds exactly the properties that have its reflectance.
    Keep,
}

/// Params of `invert`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Params {
    pub method: Method,
    pub outside: Outside,
    pub noise_bias: NoiseBias,
    /// The spatial frequencies to use, increasing: two; for `least_squares` two or more. If left out the lowest and the highest of the
    /// reflectance; for `least_squares` all.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub f_x: Option<Vec<PerLength>>,
    /// Which orientation to use, where the reflectance has several.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub orientation_deg: Option<AngleDeg>,
}

in_ports! {
    pub struct In {
        /// Calibrated reflectance.
        reflectance: one Reflectance,
        /// Table of the same convention, g and n, which holds both f_x.
        lut: one Lut,
    }
}

out_ports! {
    pub struct Out {
        /// mu_a and mu_s' with standard errors and mask.
        maps: one Maps,
        /// Covariance of mu_a and mu_s' of each pixel.
        covariance: optional Covariance,
    }
}

/// `use: invert`
pub struct Invert;

impl Stage for Invert {
    const NAME: &'static str = "invert";
    const VERSION: u32 = 2;
    const ABOUT: &'static str =
        "maps of mu_a and mu_s' from calibrated reflectance by a look-up table, with standard errors";

    type Params = Params;
    type In = In<'static>;
    type Out = Out;

    fn check(params: &Params, known: &Known, problems: &mut Problems) {
        if let Some(f_x) = &params.f_x {
            let (many, count) = (params.method == Method::LeastSquares, f_x.len());
            if !(count == 2 || many && (2..=MOST).contains(&count)) {
                let rule = if many { format!("2 to {MOST}") } else { "2".to_owned() };
                let message = format!("{count} f_x are given; `method: {}` takes {rule}", params.method.name());
                problems.push_with_hint("f_x", message, "`method: least_squares` takes more than two");
            }
            for (k, f) in f_x.iter().enumerate() {
                let (at, low) = (format!("f_x.{k}"), if k == 0 { None } else { Some(f_x[k - 1].0) });
                match low {
                    None => problems.require(f.0 >= 0.0, at, f.0, "mm^-1", "be >= 0"),
                    Some(low) => problems.require(
                        f.0 > low && f.0.is_finite(),
                        at,
                        f.0,
                        "mm^-1",
                        if k == 1 { "be above the first f_x" } else { "be above the f_x before it" },
                    ),
                };
            }
        }
        if params.method == Method::LeastSquares && params.outside == Outside::Nearest {
            problems.push_with_hint(
                "outside",
                "`method: least_squares` masks what lies outside the table",
                "write `outside: mask`, or leave it out",
            );
        }
        if let (Some(reflectance), Some(lut)) = (known.get::<Reflectance>("reflectance"), known.get::<Lut>("lut"))
            && let Err(Error::Failed { what, .. }) = agree(&reflectance.0.attributes, &lut.0.attributes)
        {
            problems.push("", what);
        }
    }

    fn plan(params: &Params, _known: &Known) -> StagePlan {
        StagePlan { method: Some(params.method.name().into()), ..StagePlan::default() }
    }

    fn run(params: &Params, inputs: In<'_>, ctx: Ctx<'_>) -> Result<Out, Error> {
        let (stack, lut) = (&inputs.reflectance.0, &inputs.lut);
        agree(&stack.attributes, &lut.0.attributes)?;
        let first = wavelengths(stack).into_iter().next();
        let first = first.ok_or_else(|| Error::failed("the reflectance holds no layer `r_d`"))?;
        let f_x: Vec<f64> = layers_of(stack, first, params)?.iter().map(|&k| f_x_of(&stack.layers[k])).collect();
        let grids = f_x.iter().map(|&f| grid(lut, f)).collect::<Result<Vec<_>, _>>()?;
        let ends = [grids[0].clone(), grids[grids.len() - 1].clone()];
        let forward = Forward::new(ends);
        let pass = |noise: bool| Pass {
            noise,
            covariance: ctx.wants("covariance"),
            outside: params.outside == Outside::Nearest,
            corrects: params.noise_bias == NoiseBias::Correct,
        };
        let mut maps = Layers::default();
        let mut covariance = Layers::default();
        let mut table_error = 0.0;
        let mut each = |solver: &Solver<'_>| -> Result<(), Error> {
            for wavelength_nm in wavelengths(stack) {
                let layers = layers_of(stack, wavelength_nm, params)?;
                if !layers.iter().map(|&k| f_x_of(&stack.layers[k])).eq(f_x.iter().copied()) {
                    return Err(Error::failed("the wavelengths of the reflectance have different f_x"));
                }
                invert(stack, &layers, solver, &pass, ctx, &mut maps, &mut covariance)?;
            }
            Ok(())
        };
        let needs_nodes = matches!(params.method, Method::Nearest | Method::LeastSquares);
        let nodes = (needs_nodes || params.outside == Outside::Nearest).then(|| Nodes::new(&forward));
        if params.method == Method::LeastSquares {
            let surfaces: Vec<Surface> = grids.into_iter().map(Surface::new).collect();
            let nodes = nodes.as_ref().expect("made above");
            each(&Solver::Many(LeastSquares { surfaces: &surfaces, nodes, r_0_range: r_0_range(&forward) }))?;
        } else {
            let table = InverseTable::new(&forward);
            ctx.checked()?;
            table_error = table.worst_error;
            ctx.measure("table_error", 100.0 * table.worst_error, "%");
            if table.worst_error > TOLERANCE && params.method == Method::Table {
                let (worst, size) = (100.0 * table.worst_error, table.size());
                ctx.warn(format!("resampling the table adds up to {worst:.2} % even with {size} x {size} nodes"));
            }
            let triangles = Triangles::new(&forward);
            each(&Solver::Pair(Inverter {
                inside: match (params.method, &nodes) {
                    (Method::Nearest, Some(nodes)) => Inside::Nearest(nodes),
                    (Method::Linear, _) => Inside::Linear(&triangles),
                    (Method::Bicubic, _) => Inside::Bicubic,
                    _ => Inside::Table,
                },
                table: &table,
                nodes_outside: nodes.as_ref().filter(|_| params.outside == Outside::Nearest),
                r_0_range: r_0_range(&forward),
                forward: &forward,
            }))?;
        }
        let mut attributes = stack.attributes.clone();
        attributes.insert("f_x".into(), f_x.into());
        attributes.insert("table_error".into(), table_error.into());
        let quantities = serde_json::json!([{"part": "mu_a"}, {"part": "mu_s_prime"}]);
        let covariance = (!covariance.values.is_empty()).then(|| {
            let mut stack = covariance.into_stack(stack, attributes.clone());
            stack.attributes.insert("quantities".into(), quantities);
            Covariance(stack)
        });
        Ok(Out { maps: Maps(maps.into_stack(stack, attributes)), covariance })
    }
}

/// Layers of a stack in the making; values first.
#[derive(Default)]
struct Layers {
    values: Vec<(LayerInfo, Array2<f32>)>,
    others: Vec<(LayerInfo, Array2<f32>)>,
}

impl Layers {
    fn into_stack(self, like: &ImageStack, attributes: Attributes) -> ImageStack {
        let mut stack = ImageStack::new(like.rows(), like.columns());
        stack.attributes = attributes;
        self.values.into_iter().chain(self.others).for_each(|(info, data)| stack.push(info, data));
        stack
    }
}

/// The two kinds of inversion.
enum Solver<'a> {
    Pair(Inverter<'a>),
    Many(LeastSquares<'a>),
}

fn invert(
    stack: &ImageStack,
    layers: &[usize],
    solver: &Solver<'_>,
    pass: &dyn Fn(bool) -> Pass,
    ctx: Ctx<'_>,
    maps: &mut Layers,
    covariances: &mut Layers,
) -> Result<(), Error> {
    let of: Vec<&Layer> = layers.iter().map(|&k| &stack.layers[k]).collect();
    let wavelength_nm = of[0].info.wavelength_nm;
    let r: Vec<_> = of.iter().map(|l| l.pixels()).collect();
    let se: Option<Vec<_>> = of.iter().map(|l| stack.standard_error(&l.info).map(Layer::pixels)).collect();
    let known = se.is_some();
    let se = se.unwrap_or_default();
    let between = |a: usize, b: usize| {
        let wanted = [layers[a] as u32, layers[b] as u32];
        let found = stack.layers.iter().find(|l| {
            let turned = [wanted[1], wanted[0]];
            l.info.kind == LayerKind::Covariance && l.info.pair.is_some_and(|p| p == wanted || p == turned)
        });
        found.map(Layer::pixels)
    };
    let count = of.len();
    // [a][b]; empty where they are independent, and on the diagonal.
    let covariance: Vec<Option<_>> = (0..count * count)
        .map(|ab| if ab / count == ab % count { None } else { between(ab / count, ab % count) })
        .collect();
    // Of R_a and R_b relative to both.
    let c_r = |i: usize, a: usize, b: usize| {
        let (r_a, r_b) = (f64::from(r[a][i]), f64::from(r[b][i]));
        let c = if a == b {
            let se = f64::from(se[a][i]);
            se * se
        } else {
            covariance[a * count + b].as_ref().map_or(0.0, |c| f64::from(c[i]))
        };
        c / (r_a * r_b)
    };
    let mask = stack.mask(wavelength_nm).map(Layer::pixels);
    let pass = pass(known);
    let mut planes = vec![Array2::zeros((stack.rows(), stack.columns())); pass.plane_count()];
    let tiles = ctx.fill_planes(&mut planes, |pixels, planes| match solver {
        Solver::Pair(inverter) => pass.run(mask.as_deref(), pixels, planes, |i| {
            let matrix = |i: usize| {
                let between = c_r(i, 0, 1);
                [[c_r(i, 0, 0), between], [between, c_r(i, 1, 1)]]
            };
            inverter.solve([0, 1].map(|k| f64::from(r[k][i])), known.then(|| matrix(i)))
        }),
        Solver::Many(fit) => pass.run(mask.as_deref(), pixels, planes, |i| {
            let mut values = [0.0; MOST];
            values.iter_mut().zip(&r).for_each(|(value, r)| *value = f64::from(r[i]));
            let noise = |a: usize, b: usize| c_r(i, a, b);
            fit.solve(&values[..count], if known { Some(&noise) } else { None })
        }),
    })?;
    let tally = tiles.iter().fold(Tally::default(), Tally::add);
    let all = (stack.rows() * stack.columns()) as f64;
    ctx.measure("masked", 100.0 * (1.0 - tally.good as f64 / all), "%");
    if tally.mu_a > 0.0 {
        ctx.measure("noise_bias_mu_a", 100.0 * tally.noise_bias / tally.mu_a, "%");
    }
    if tally.good == 0 {
        ctx.warn("all pixels are masked");
    }
    if tally.outside > 0 {
        ctx.warn(format!("{} pixels lie outside the table and hold the nearest node", tally.outside));
    }

    let sharing = of.iter().map(|l| stack.sharing(&l.info)).fold(1.0, f64::max);
    let infos = ["mu_a", "mu_s_prime"].map(|name| {
        let mut info = LayerInfo::value(name, "mm^-1");
        info.wavelength_nm = wavelength_nm;
        info
    });
    let mut planes = planes.into_iter();
    let mut next = || planes.next().expect("as many planes as plane_count says");
    for (k, info) in infos.iter().enumerate() {
        let mut info = info.clone();
        info.mean_se = if known { mean_se(tally.variances[k], tally.good, sharing) } else { None };
        maps.values.push((info, next()));
    }
    if known {
        infos.iter().for_each(|info| maps.others.push((info.standard_error(), next())));
        for pair in [[0, 0], [0, 1], [1, 1]].into_iter().filter(|_| pass.covariance) {
            let mut info = LayerInfo::new("cov", LayerKind::Covariance, "mm^-2");
            (info.pair, info.wavelength_nm) = (Some(pair), wavelength_nm);
            covariances.values.push((info, next()));
        }
    }
    if pass.outside {
        let mut info = LayerInfo::value("outside", "1");
        info.wavelength_nm = wavelength_nm;
        maps.others.push((info, next()));
    }
    let mut info = LayerInfo::new("mask", LayerKind::Mask, "1");
    info.wavelength_nm = wavelength_nm;
    let mask = next();
    if known {
        covariances.others.push((info.clone(), mask.clone()));
    }
    maps.others.push((info, mask));
    Ok(())
}

fn f_x_of(layer: &Layer) -> f64 {
    layer.info.f_x_per_mm.unwrap_or(0.0)
}

fn r_d_layers(stack: &ImageStack) -> impl Iterator<Item = (usize, &Layer)> {
    stack.layers.iter().enumerate().filter(|(_, l)| l.info.kind == LayerKind::Value && l.info.name == "r_d")
}

fn wavelengths(stack: &ImageStack) -> Vec<Option<f64>> {
    let mut found = Vec::new();
    for (_, layer) in r_d_layers(stack) {
        if !found.contains(&layer.info.wavelength_nm) {
            found.push(layer.info.wavelength_nm);
        }
    }
    found
}

/// Equal up to rounding: one f_x may have passed through a table and the other not.
fn same_f_x(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-9 * a.abs().max(b.abs())
}

/// The layers of the f_x to use, increasing.
fn layers_of(stack: &ImageStack, wavelength_nm: Option<f64>, params: &Params) -> Result<Vec<usize>, Error> {
    let mut layers: Vec<(usize, f64)> = r_d_layers(stack)
        .filter(|(_, l)| l.info.wavelength_nm == wavelength_nm)
        .filter(|(_, l)| match (params.orientation_deg, l.info.orientation_deg) {
            (Some(AngleDeg(wanted)), Some(has)) => wanted == has,
            _ => true,
        })
        .map(|(k, l)| (k, f_x_of(l)))
        .collect();
    layers.sort_by(|a, b| a.1.total_cmp(&b.1));
    let mut distinct: Vec<f64> = layers.iter().map(|l| l.1).collect();
    distinct.dedup_by(|a, b| same_f_x(*a, *b));
    let has = || distinct.iter().map(f64::to_string).collect::<Vec<_>>().join(", ");
    let wanted = match &params.f_x {
        Some(f_x) => f_x.iter().map(|f| f.0).collect(),
        None if distinct.len() < 2 => {
            let what = format!("the reflectance has f_x = {} mm^-1; two that differ are needed", has());
            return Err(Error::failed_with_hint(what, "render at f_x: [0, 0.1], for example"));
        }
        None if params.method != Method::LeastSquares => vec![distinct[0], distinct[distinct.len() - 1]],
        None if distinct.len() > MOST => {
            let what = format!("the reflectance has {} f_x, more than {MOST}", distinct.len());
            return Err(Error::failed_with_hint(what, "list those to use in `f_x`"));
        }
        None => distinct.clone(),
    };
    let only = |f_x: f64| {
        let found: Vec<usize> = layers.iter().filter(|(_, f)| same_f_x(*f, f_x)).map(|(k, _)| *k).collect();
        match found[..] {
            [k] => Ok(k),
            [] => Err(Error::invalid("f_x", format!("the reflectance has f_x = {}, not {f_x} mm^-1", has()))),
            _ => Err(Error::invalid(
                "orientation_deg",
                format!("the reflectance has {} orientations at f_x = {f_x} mm^-1; name one", found.len()),
            )),
        }
    };
    wanted.into_iter().map(only).collect()
}

/// Reflectance and table must mean the same: convention, g and n; where the table was made of phantoms also the reference.
fn agree(reflectance: &Attributes, lut: &Attributes) -> Result<(), Error> {
    let of = |attributes: &Attributes, name: &str| {
        attributes.get("reference").and_then(|r| r.get(name)).and_then(serde_json::Value::as_f64)
    };
    for name in ["mu_a", "mu_s_prime"] {
        if let (Some(a), Some(b)) = (of(reflectance, name), of(lut, name))
            && !same_f_x(a, b)
        {
            return Err(Error::failed_with_hint(
                format!(
                    "the reflectance is relative to a reference with {name} = {a} mm^-1, the table's phantoms to one with {b}"
                ),
                "both must have been seen beside the same reference phantom, said to be the same",
            ));
        }
    }
    for name in ["convention", "g", "n"] {
        let (Some(a), Some(b)) = (reflectance.get(name), lut.get(name)) else {
            let which = if reflectance.contains_key(name) { "table" } else { "reflectance" };
            return Err(Error::failed(format!("the {which} does not say its {name}")));
        };
        let same = match (a.as_f64(), b.as_f64()) {
            (Some(a), Some(b)) => same_f_x(a, b),
            _ => a == b,
        };
        if !same {
            return Err(Error::failed_with_hint(
                format!("the reflectance has {name} = {a}, the table {name} = {b}"),
                "calibrate and build_lut must be given the same convention, g and n",
            ));
        }
    }
    Ok(())
}

/// ln R of the table at one f_x.
fn grid(lut: &Lut, f_x: f64) -> Result<LogGrid, Error> {
    let axis = |name: &str| -> Result<Vec<f64>, Error> {
        let list = lut.0.attributes.get(name).and_then(|v| serde_json::from_value(v.clone()).ok());
        list.ok_or_else(|| Error::failed(format!("the table does not list its {name}")))
    };
    let (all, mu_a, mu_s_prime) = (axis("f_x")?, axis("mu_a")?, axis("mu_s_prime")?);
    let r_d = lut.0.f64s("r_d").ok_or_else(|| Error::failed("the table has no column r_d"))?;
    let nodes = mu_a.len() * mu_s_prime.len();
    if r_d.len() != all.len() * nodes {
        let what = format!("the table has {} rows for {} f_x and {nodes} nodes", r_d.len(), all.len());
        return Err(Error::failed(what));
    }
    let k = all.iter().position(|&f| same_f_x(f, f_x)).ok_or_else(|| {
        let has: Vec<String> = all.iter().map(f64::to_string).collect();
        Error::failed_with_hint(
            format!("the table has f_x = {} mm^-1, the reflectance needs {f_x}", has.join(", ")),
            "build_lut must be given the f_x of the frames",
        )
    })?;
    LogGrid::new(&mu_a, &mu_s_prime, &r_d[k * nodes..(k + 1) * nodes])
        .map_err(|e| Error::failed(format!("the table at f_x = {f_x} mm^-1: {e}")))
}

/// Smallest and largest R_0 at the nodes.
fn r_0_range(forward: &Forward) -> [f64; 2] {
    let [a, s] = forward.nodes();
    let all = a.iter().flat_map(|&a| s.iter().map(move |&s| [a, s])).map(|p| libm::exp(forward.at(p).ln_r[0]));
    all.fold([f64::INFINITY, 0.0], |[low, high], r| [low.min(r), high.max(r)])
}
