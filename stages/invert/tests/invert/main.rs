//! The stage as the engine calls it: round trips, error propagation, every reason to mask, every refusal.

use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{Convention, Lut, MaskReason, Reflectance, Section, Sections};
use turbid_contract::{
    Cells, Ctx, Error, ImageStack, Known, Layer, LayerInfo, LayerKind, MemoryHost, PerLength, Problems, Stage, Table,
    serde_json,
};
use turbid_invert::forward::Forward;
use turbid_invert::inverse::{Found, InverseTable};
use turbid_invert::{In, Invert, Method, NoiseBias, Out, Outside, Params};
use turbid_optics::{LogGrid, Medium, PhaseFunction, diffusion};

mod noise;
mod profile;
mod refusals;
mod round_trips;
mod sections;
mod wavelengths;

const F_X: [f64; 2] = [0.0, 0.1];
/// mu_a and mu_s' of the default table.
const RANGE: [[f64; 2]; 2] = [[1e-4, 0.5], [0.1, 5.0]];

fn r_d(mu_a: f64, mu_s_prime: f64, f_x: f64) -> f64 {
    let medium = Medium { mu_a, mu_s_prime, phase: PhaseFunction::henyey_greenstein(0.8), n: 1.4 };
    diffusion::reflectance(&medium, None, f_x).expect("an ordinary half-space").camera
}

fn nodes(range: [f64; 2], count: usize) -> Vec<f64> {
    (0..count).map(|i| range[0] * libm::pow(range[1] / range[0], i as f64 / (count - 1) as f64)).collect()
}

/// Points off the nodes, evenly spread over the range (the R2 sequence).
fn scattered(count: usize) -> impl Iterator<Item = [f64; 2]> {
    (0..count).map(|k| {
        let t = [0.754_877_666, 0.569_840_291].map(|step| (0.5 + step * k as f64).fract());
        [0, 1].map(|i| RANGE[i][0] * libm::pow(RANGE[i][1] / RANGE[i][0], t[i]))
    })
}

fn lut(f_x: &[f64], model: impl Fn(f64, f64, f64) -> f64) -> Lut {
    let (a, s) = (nodes(RANGE[0], 41), nodes(RANGE[1], 41));
    let mut r = Vec::new();
    for &f in f_x {
        a.iter().for_each(|&a| s.iter().for_each(|&s| r.push(model(a, s, f))));
    }
    let mut table = Table::default();
    table.push("r_d", "1", Cells::F64(r));
    let facts = [
        ("f_x", serde_json::json!(f_x)),
        ("mu_a", serde_json::json!(a)),
        ("mu_s_prime", serde_json::json!(s)),
        ("g", 0.8.into()),
        ("n", 1.4.into()),
        ("convention", serde_json::to_value(Convention::Camera).unwrap()),
    ];
    table.attributes = facts.into_iter().map(|(k, v)| (k.to_owned(), v)).collect();
    table.into()
}

/// One row of pixels with these reflectances; noise is (relative standard errors, correlation).
fn reflectance(r: &[[f64; 2]], noise: Option<([f64; 2], f64)>) -> Reflectance {
    let mut stack = ImageStack::new(1, r.len());
    let plane = |f: &dyn Fn(&[f64; 2]) -> f64| Array2::from_shape_fn((1, r.len()), |(_, c)| f(&r[c]) as f32);
    let infos = F_X.map(|f| LayerInfo::value("r_d", "1").with_f_x(f));
    infos.iter().enumerate().for_each(|(k, info)| stack.push(info.clone(), plane(&|r| r[k])));
    if let Some((se, rho)) = noise {
        infos.iter().enumerate().for_each(|(k, info)| stack.push(info.standard_error(), plane(&|r| se[k] * r[k])));
        let mut info = LayerInfo::new("cov", LayerKind::Covariance, "1");
        info.pair = Some([0, 1]);
        stack.push(info, plane(&|r| rho * se[0] * se[1] * r[0] * r[1]));
    }
    let facts = [("g", 0.8.into()), ("n", 1.4.into()), ("convention", "camera".into())];
    stack.attributes = facts.into_iter().map(|(k, v): (&str, serde_json::Value)| (k.to_owned(), v)).collect();
    Reflectance(stack)
}

/// Of a flat sample, and a table without sections.
fn inputs(reflectance: Reflectance, lut: Lut) -> In<'static> {
    In {
        reflectance: reflectance.into(),
        lut,
        sections: None,
        height: None,
        normals: None,
        scene: None,
        source: std::marker::PhantomData,
    }
}

fn invert(reflectance: Reflectance, lut: Lut, params: &Params, wanted: &[&str]) -> Result<(Out, MemoryHost), Error> {
    let host = MemoryHost { wanted: wanted.iter().map(|w| w.to_string()).collect(), ..MemoryHost::default() };
    let out = Invert::run(params, inputs(reflectance, lut), Ctx::new(&host))?;
    Ok((out, host))
}

fn layer(stack: &ImageStack, name: &str) -> Vec<f64> {
    let layer = stack.find(name, None).unwrap_or_else(|| panic!("no layer {name}"));
    layer.data.iter().map(|&v| f64::from(v)).collect()
}

/// Pairs with correlated relative noise around those of one medium.
fn noisy(medium: [f64; 2], se: [f64; 2], rho: f64, count: usize) -> Vec<[f64; 2]> {
    noisy_of(medium, se, rho, count, 5)
}

fn noisy_of(medium: [f64; 2], se: [f64; 2], rho: f64, count: usize, seed: u64) -> Vec<[f64; 2]> {
    let mut state = seed;
    let mut uniform = || {
        state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = (state ^ (state >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    };
    // Box and Muller: intervals are counted, so the tails must be right.
    let mut normal = || (-2.0 * libm::log(1.0 - uniform())).sqrt() * libm::cos(2.0 * std::f64::consts::PI * uniform());
    let truth = F_X.map(|f| r_d(medium[0], medium[1], f));
    let one = |_| {
        let (a, b) = (normal(), normal());
        let e = [a, rho * a + (1.0_f64 - rho * rho).sqrt() * b];
        [0, 1].map(|k| truth[k] * (1.0 + se[k] * e[k]))
    };
    (0..count).map(one).collect()
}
