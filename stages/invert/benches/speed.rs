//! Inversion: error over the default range and build time of the inverse table, pixels per second on one thread of every method.
//! `cargo bench -p turbid-invert` (`-- speed` for the last alone, `-- table` for that method
//! again and again, `-- table values` and `-- table errors` without and with standard errors alone, `-- errors` for the first alone).

use std::hint::black_box;
use std::time::Instant;

use turbid_contract::ndarray::Array2;
use turbid_contract::payload::Reflectance;
use turbid_contract::{Cells, Ctx, ImageStack, LayerInfo, LayerKind, MemoryHost, Stage, Table, serde_json::json};
use turbid_invert::forward::Forward;
use turbid_invert::inverse::{Found, InverseTable};
use turbid_invert::{In, Invert, Method, Params};
use turbid_optics::{LogGrid, Medium, PhaseFunction, diffusion};

const RANGE: [[f64; 2]; 2] = [[1e-4, 0.5], [0.1, 5.0]];
const SIDE: usize = 3072;

fn r_d(p: [f64; 2], n: f64, f_x: f64) -> f64 {
    let medium = Medium { mu_a: p[0], mu_s_prime: p[1], phase: PhaseFunction::henyey_greenstein(0.8), n };
    diffusion::reflectance(&medium, None, f_x).expect("an ordinary half-space").camera
}

fn nodes(range: [f64; 2], count: usize) -> Vec<f64> {
    (0..count).map(|i| range[0] * (range[1] / range[0]).powf(i as f64 / (count - 1) as f64)).collect()
}

/// The R2 sequence: off the nodes, evenly spread.
fn scattered(k: usize) -> [f64; 2] {
    let t = [0.754_877_666, 0.569_840_291].map(|step| (0.5 + step * k as f64).fract());
    [0, 1].map(|i| RANGE[i][0] * (RANGE[i][1] / RANGE[i][0]).powf(t[i]))
}

/// CPU seconds of this thread where the system tells (a busy machine shows less), else wall seconds.
fn seconds(work: impl FnOnce()) -> f64 {
    let on_cpu = || std::fs::read_to_string("/proc/thread-self/schedstat").ok()?.split(' ').next()?.parse::<f64>().ok();
    let (start, before) = (Instant::now(), on_cpu());
    work();
    match (before, on_cpu()) {
        (Some(before), Some(after)) => (after - before) * 1e-9,
        _ => start.elapsed().as_secs_f64(),
    }
}

fn errors(n: f64, f_x: f64, count: usize) {
    let (a, s) = (nodes(RANGE[0], count), nodes(RANGE[1], count));
    let grid = |f: f64| {
        let r: Vec<f64> = a.iter().flat_map(|&a| s.iter().map(move |&s| r_d([a, s], n, f))).collect();
        LogGrid::new(&a, &s, &r).expect("positive reflectances")
    };
    let forward = Forward::new([grid(0.0), grid(f_x)]);
    for size in [128, 256, 512] {
        let mut table = None;
        let seconds = seconds(|| table = Some(InverseTable::with_size(&forward, size)));
        let table = table.expect("just made");
        let (mut found, mut resampled, mut missed) = (Vec::new(), Vec::new(), 0);
        for k in 0..10_000 {
            let p = scattered(k);
            // As images hold them.
            let r = [r_d(p, n, 0.0), r_d(p, n, f_x)].map(|r| f64::from(r as f32));
            match table.find(r) {
                Found::Properties { p: q, .. } => {
                    found.push([0, 1].map(|i| (q[i].exp() / p[i] - 1.0).abs()));
                    let exact = table.exact(&forward, r, q).expect("Newton's method begins next to it");
                    resampled.push([0, 1].map(|i| (q[i] - exact[i]).abs()));
                }
                _ => missed += 1,
            }
        }
        let figures = |found: &[[f64; 2]]| {
            let of = |i: usize| {
                let mut e: Vec<f64> = found.iter().map(|e| 100.0 * e[i]).collect();
                e.sort_by(f64::total_cmp);
                format!("{:.5} / {:.4} %", e[e.len() / 2], e[e.len() - 1])
            };
            format!("mu_a {}, mu_s' {}", of(0), of(1))
        };
        println!(
            "n = {n}, f_x = {f_x}, {count} nodes, table {size}: {seconds:.2} s, median / worst against the medium {}; against the exact inverse of the surface {}; missed {missed}",
            figures(&found),
            figures(&resampled)
        );
    }
}

fn speed(method: Method, noise: bool, side: usize) {
    // A few media again and again: the model costs more than the inversion.
    let r: Vec<[f64; 2]> = (0..1000).map(|k| [0.0, 0.1].map(|f| r_d(scattered(k), 1.4, f))).collect();
    let mut stack = ImageStack::new(side, side);
    let infos = [0.0, 0.1].map(|f| LayerInfo::value("r_d", "1").with_f_x(f));
    let plane = |f: &dyn Fn(usize) -> f64| Array2::from_shape_fn((side, side), |(r, c)| f(r * side + c) as f32);
    for (k, info) in infos.iter().enumerate() {
        stack.push(info.clone(), plane(&|i| r[i % 1000][k]));
    }
    if noise {
        infos.iter().for_each(|info| stack.push(info.standard_error(), plane(&|_| 1e-3)));
        let mut info = LayerInfo::new("cov", LayerKind::Covariance, "1");
        info.pair = Some([0, 1]);
        stack.push(info, plane(&|_| 1e-7));
    }
    let (a, s) = (nodes(RANGE[0], 41), nodes(RANGE[1], 41));
    let mut table = Table::default();
    let rows = |f: f64| a.iter().flat_map(|&a| s.iter().map(move |&s| r_d([a, s], 1.4, f))).collect::<Vec<_>>();
    table.push("r_d", "1", Cells::F64([rows(0.0), rows(0.1)].concat()));
    let same = [("g", json!(0.8)), ("n", json!(1.4)), ("convention", json!("camera"))].map(|(k, v)| (k.to_owned(), v));
    stack.attributes = same.clone().into_iter().collect();
    table.attributes = same.into_iter().collect();
    for (name, axis) in [("f_x", json!([0.0, 0.1])), ("mu_a", json!(a)), ("mu_s_prime", json!(s))] {
        table.attributes.insert(name.into(), axis);
    }
    let run = |stack: &ImageStack| {
        let inputs = In {
            reflectance: Reflectance(stack.clone()).into(),
            lut: table.clone().into(),
            sections: None,
            height: None,
            normals: None,
            scene: None,
            source: std::marker::PhantomData,
        };
        let host = MemoryHost::default();
        let params = Params { method, ..Params::default() };
        seconds(|| drop(black_box(Invert::run(&params, inputs, Ctx::new(&host)).expect("inputs agree"))))
    };
    // The table costs the same whatever the image: taken off by an image of one row.
    let mut row = ImageStack::new(1, side);
    row.attributes = stack.attributes.clone();
    for layer in &stack.layers {
        row.push(layer.info.clone(), layer.data.slice(turbid_contract::ndarray::s![..1, ..]).to_owned());
    }
    let best = |stack: &ImageStack| (0..5).map(|_| run(stack)).fold(f64::INFINITY, f64::min);
    let seconds = best(&stack) - best(&row);
    println!("{method:?}, errors {noise}: {:.1} Mpx/s", (side * (side - 1)) as f64 / seconds * 1e-6);
}

fn main() {
    let asked = |what: &str| std::env::args().any(|a| a == what);
    if asked("table") {
        let kinds: Vec<bool> =
            [false, true].into_iter().filter(|&noise| !asked(if noise { "values" } else { "errors" })).collect();
        (0..8).for_each(|_| kinds.iter().for_each(|&noise| speed(Method::Table, noise, SIDE)));
        return;
    }
    if !asked("speed") {
        for n in [1.0, 1.4] {
            for f_x in [0.05, 0.1, 0.2] {
                errors(n, f_x, 41);
            }
        }
        errors(1.4, 0.1, 25);
    }
    if asked("errors") {
        return;
    }
    for (method, side) in [
        (Method::Table, SIDE),
        (Method::Nearest, 256),
        (Method::Linear, 512),
        (Method::Bicubic, 512),
        (Method::LeastSquares, 256),
    ] {
        speed(method, false, side);
        speed(method, true, side);
    }
}
