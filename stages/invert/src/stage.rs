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
use crate::nearest::Nodes;
use crate::pass::{Input, Inverter, Noise, Tally};

/// How a pair of reflectances becomes a pair of properties.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// Bilinear in a table that was resampled once to uniform coordinates of the reflectance.
    #[default]
    Table,
    /// The nearest node of the look-up table in whitened ln R.
    Nearest,
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
    /// The two spatial frequencies to use; the lowest and the highest of the reflectance if left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub f_x: Option<[PerLength; 2]>,
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
    const VERSION: u32 = 1;
    const ABOUT: &'static str =
        "maps of mu_a and mu_s' from calibrated reflectance by a look-up table, with standard errors";

    type Params = Params;
    type In = In<'static>;
    type Out = Out;

    fn check(params: &Params, known: &Known, problems: &mut Problems) {
        if let Some([PerLength(low), PerLength(high)]) = params.f_x {
            problems.require(low >= 0.0, "f_x.0", low, "mm^-1", "be >= 0");
            problems.require(high > low && high.is_finite(), "f_x.1", high, "mm^-1", "be above the first f_x");
        }
        if let (Some(reflectance), Some(lut)) = (known.get::<Reflectance>("reflectance"), known.get::<Lut>("lut"))
            && let Err(Error::Failed { what, .. }) = agree(&reflectance.0.attributes, &lut.0.attributes)
        {
            problems.push("", what);
        }
    }

    fn plan(params: &Params, _known: &Known) -> StagePlan {
        let method = match params.method {
            Method::Table => "table",
            Method::Nearest => "nearest",
        };
        StagePlan { method: Some(method.into()), ..StagePlan::default() }
    }

    fn run(params: &Params, inputs: In<'_>, ctx: Ctx<'_>) -> Result<Out, Error> {
        let (stack, lut) = (&inputs.reflectance.0, &inputs.lut);
        agree(&stack.attributes, &lut.0.attributes)?;
        let first = wavelengths(stack).into_iter().next();
        let first = first.ok_or_else(|| Error::failed("the reflectance holds no layer `r_d`"))?;
        let f_x = pair_layers(stack, first, params)?.map(|k| f_x_of(&stack.layers[k]));
        let forward = forward(lut, f_x)?;
        let table = InverseTable::new(&forward);
        ctx.checked()?;
        ctx.measure("table_error", 100.0 * table.worst_error, "%");
        if table.worst_error > TOLERANCE {
            let (worst, size) = (100.0 * table.worst_error, table.size());
            ctx.warn(format!("resampling the table adds up to {worst:.2} % even with {size} x {size} nodes"));
        }
        let nodes =
            (params.method == Method::Nearest || params.outside == Outside::Nearest).then(|| Nodes::new(&forward));
        let inverter = Inverter {
            table: &table,
            nodes_inside: nodes.as_ref().filter(|_| params.method == Method::Nearest),
            nodes_outside: nodes.as_ref().filter(|_| params.outside == Outside::Nearest),
            r_0_range: r_0_range(&forward),
            forward: &forward,
            corrects: params.noise_bias == NoiseBias::Correct,
            wants_covariance: ctx.wants("covariance"),
        };
        let mut maps = Layers::default();
        let mut covariance = Layers::default();
        for wavelength_nm in wavelengths(stack) {
            let layers = pair_layers(stack, wavelength_nm, params)?;
            if layers.map(|k| f_x_of(&stack.layers[k])) != f_x {
                return Err(Error::failed("the wavelengths of the reflectance have different f_x"));
            }
            invert(stack, layers, &inverter, ctx, &mut maps, &mut covariance)?;
        }
        let mut attributes = stack.attributes.clone();
        attributes.insert("f_x".into(), f_x.to_vec().into());
        attributes.insert("table_error".into(), table.worst_error.into());
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

fn invert(
    stack: &ImageStack,
    layers: [usize; 2],
    inverter: &Inverter<'_>,
    ctx: Ctx<'_>,
    maps: &mut Layers,
    covariances: &mut Layers,
) -> Result<(), Error> {
    let of = layers.map(|k| &stack.layers[k]);
    let wavelength_nm = of[0].info.wavelength_nm;
    let r = of.map(Layer::pixels);
    let se = of.map(|l| stack.standard_error(&l.info).map(Layer::pixels));
    let pair = stack.layers.iter().find(|l| {
        let wanted = layers.map(|k| k as u32);
        l.info.kind == LayerKind::Covariance && l.info.pair.is_some_and(|p| p == wanted || p == [wanted[1], wanted[0]])
    });
    let pair = pair.map(Layer::pixels);
    let mask = stack.mask(wavelength_nm).map(Layer::pixels);
    let noise = match &se {
        [Some(a), Some(b)] => Some(Noise { se: [a, b], covariance: pair.as_deref() }),
        _ => None,
    };
    let known = noise.is_some();
    let input = Input { r: [&r[0], &r[1]], noise, mask: mask.as_deref() };
    let mut planes = vec![Array2::zeros((stack.rows(), stack.columns())); inverter.plane_count(known)];
    let tiles = ctx.fill_planes(&mut planes, |pixels, planes| inverter.run(&input, pixels, planes))?;
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
        for pair in [[0, 0], [0, 1], [1, 1]].into_iter().filter(|_| inverter.wants_covariance) {
            let mut info = LayerInfo::new("cov", LayerKind::Covariance, "mm^-2");
            (info.pair, info.wavelength_nm) = (Some(pair), wavelength_nm);
            covariances.values.push((info, next()));
        }
    }
    if inverter.nodes_outside.is_some() {
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

/// The layers of the two f_x to use.
fn pair_layers(stack: &ImageStack, wavelength_nm: Option<f64>, params: &Params) -> Result<[usize; 2], Error> {
    let mut layers: Vec<(usize, f64)> = r_d_layers(stack)
        .filter(|(_, l)| l.info.wavelength_nm == wavelength_nm)
        .filter(|(_, l)| match (params.orientation_deg, l.info.orientation_deg) {
            (Some(AngleDeg(wanted)), Some(has)) => wanted == has,
            _ => true,
        })
        .map(|(k, l)| (k, f_x_of(l)))
        .collect();
    layers.sort_by(|a, b| a.1.total_cmp(&b.1));
    let has = || layers.iter().map(|(_, f)| f.to_string()).collect::<Vec<_>>().join(", ");
    let (low, high) = match params.f_x {
        Some([PerLength(low), PerLength(high)]) => (low, high),
        None => match (layers.first(), layers.last()) {
            (Some(&(_, low)), Some(&(_, high))) if low < high => (low, high),
            _ => {
                let what = format!("the reflectance has f_x = {} mm^-1; two that differ are needed", has());
                return Err(Error::failed_with_hint(what, "render at f_x: [0, 0.1], for example"));
            }
        },
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
    Ok([only(low)?, only(high)?])
}

/// Reflectance and table must mean the same: convention, g and n.
fn agree(reflectance: &Attributes, lut: &Attributes) -> Result<(), Error> {
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

/// The surface of the table at the two f_x.
fn forward(lut: &Lut, f_x: [f64; 2]) -> Result<Forward, Error> {
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
    let grid = |f_x: f64| {
        let k = all.iter().position(|&f| same_f_x(f, f_x)).ok_or_else(|| {
            let has: Vec<String> = all.iter().map(f64::to_string).collect();
            Error::failed_with_hint(
                format!("the table has f_x = {} mm^-1, the reflectance needs {f_x}", has.join(", ")),
                "build_lut must be given the f_x of the frames",
            )
        })?;
        LogGrid::new(&mu_a, &mu_s_prime, &r_d[k * nodes..(k + 1) * nodes])
            .map_err(|e| Error::failed(format!("the table at f_x = {f_x} mm^-1: {e}")))
    };
    Ok(Forward::new([grid(f_x[0])?, grid(f_x[1])?]))
}

/// Smallest and largest R_0 at the nodes.
fn r_0_range(forward: &Forward) -> [f64; 2] {
    let [a, s] = forward.nodes();
    let all = a.iter().flat_map(|&a| s.iter().map(move |&s| [a, s])).map(|p| libm::exp(forward.at(p).ln_r[0]));
    all.fold([f64::INFINITY, 0.0], |[low, high], r| [low.min(r), high.max(r)])
}
