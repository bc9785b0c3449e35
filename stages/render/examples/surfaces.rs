//! Fits on smooth surfaces beside paths: `cargo run --release -p turbid-render --example surfaces SCENE [pixels samples seeds reference]`.
//!
//! For each scene the pixels that are fitted, the error of M_DC and M_AC against a long run by paths, CPU seconds to 1 % per pixel, and z
//! scores: mean, standard deviation and worst over all fitted pixels and seeds (the reference's own error is in their standard errors).

use std::collections::BTreeMap;

use serde_json::json;
use turbid_contract::kit::Inputs;
use turbid_contract::payload::{
    Camera, Medium, Mesh, Object, Profile, Projection, Projector, Scene, Shape, Specular, Surface,
};
use turbid_contract::{Artifact, Ctx, ImageStack, LayerKind, MemoryHost, StageRow};
use turbid_render::RenderStage;

#[allow(dead_code, reason = "other tests use the rest")]
#[path = "../../optics/tests/shapes/mod.rs"]
mod shapes;

fn medium(a_rho: f64, s_rho: f64) -> Medium {
    Medium {
        mu_a: vec![a_rho / 1000.0],
        mu_s: vec![s_rho / 1000.0],
        phase: turbid_contract::payload::PhaseFunction::HenyeyGreenstein(0.8),
        n: 1.0,
    }
}

fn object(shape: Shape, medium: &str, priority: i32) -> Object {
    Object { shape, medium: Some(medium.to_owned()), priority, surface: Surface::Smooth }
}

fn scene(name: &str, pixels: u32) -> Scene {
    let tissue = || object(Shape::Slab { top: 0.0, bottom: -2000.0 }, "healthy", 0);
    let spheroid = |diameters: [f64; 3], center: [f64; 3]| object(Shape::Spheroid { diameters, center }, "scc", 1);
    let (objects, [camera_z, field], [aside, projector_z, lit]) = match name {
        "dome" => (vec![tissue(), spheroid([40.0; 3], [0.0; 3])], [500.0, 64.0], [35.0, 500.0, 256.0]),
        "polyp" => (vec![tissue(), spheroid([40.0, 40.0, 80.0], [0.0; 3])], [500.0, 64.0], [35.0, 500.0, 256.0]),
        "lesion" => {
            let air = Shape::Box { size: [200.0, 200.0, 30.0], center: [0.0, 0.0, 15.0] };
            let air = object(air, "air", 2);
            (vec![tissue(), spheroid([36.0, 36.0, 24.0], [0.0; 3]), air], [500.0, 64.0], [35.0, 500.0, 256.0])
        }
        "ball" => (vec![spheroid([40.0; 3], [0.0; 3])], [500.0, 48.0], [100.0, 400.0, 256.0]),
        "sunk" => (
            vec![
                spheroid([60.0; 3], [0.0; 3]),
                object(Shape::Sphere { diameter: 8.0, center: [4.0, 3.0, 23.0] }, "healthy", 2),
            ],
            [500.0, 72.0],
            [35.0, 500.0, 256.0],
        ),
        "tube" | "mouth" => (
            vec![object(
                Shape::Tube { inner_diameter: 20.0, outer_diameter: 80.0, center: [0.0; 2], bottom: -250.0, top: 0.0 },
                "scc",
                0,
            )],
            [110.0, 20.0],
            [0.0, 100.0, 20.0],
        ),
        "relief" => (vec![object(relief(80, 80.0), "scc", 0)], [500.0, 64.0], [35.0, 500.0, 256.0]),
        "facets" => (vec![object(facets(), "scc", 0)], [500.0, 48.0], [35.0, 500.0, 256.0]),
        "refracting" => (vec![spheroid([60.0; 3], [0.0; 3])], [500.0, 64.0], [35.0, 500.0, 256.0]),
        _ => panic!("dome, polyp, lesion, ball, sunk, relief, facets, refracting or tube"),
    };
    let camera = Camera {
        position: [0.0, 0.0, camera_z],
        look_at: [0.0; 3],
        up: [0.0, 1.0, 0.0],
        field: [field; 2],
        pixels: [pixels; 2],
        specular: Some(Specular::Exclude),
        projection: Projection::Pinhole,
        distortion: None,
        aperture: None,
    };
    let projector = Projector {
        position: [aside, 0.0, projector_z],
        look_at: [0.0; 3],
        up: [0.0, 1.0, 0.0],
        field: [lit; 2],
        power: vec![5.0],
        profile: Profile::UniformIntensity,
        pixels: None,
        distortion: None,
    };
    let air = Medium {
        mu_a: vec![0.0],
        mu_s: vec![0.0],
        phase: turbid_contract::payload::PhaseFunction::HenyeyGreenstein(0.0),
        n: 1.0,
    };
    let mut media = [("healthy", medium(25.0, 4236.0)), ("scc", medium(96.0, 3721.0)), ("air", air)];
    if name == "refracting" {
        media[1].1.n = 1.4;
    }
    Scene {
        wavelengths_nm: Vec::new(),
        media: media.into_iter().map(|(name, m)| (name.to_owned(), m)).collect(),
        objects: objects.into_iter().enumerate().map(|(i, o)| (format!("object{i}"), o)).collect(),
        camera: Some(camera),
        projector: Some(projector),
        lights: BTreeMap::new(),
        detectors: BTreeMap::new(),
    }
}

/// A block whose upper side waves by +-1.5 mm over 30 mm, of n x n squares.
fn relief(n: usize, side: f64) -> Shape {
    let at = |i: usize| side * (i as f64 / n as f64 - 0.5);
    let wave = std::f64::consts::TAU / 30.0;
    let mut vertices = Vec::new();
    for level in [0, 1] {
        for (j, i) in (0..=n).flat_map(|j| (0..=n).map(move |i| (j, i))) {
            let top = 1.5 * (wave * at(i)).sin() * (wave * at(j)).cos();
            vertices.push([at(i), at(j), if level == 0 { top } else { -40.0 }]);
        }
    }
    let vertex = |level: usize, i: usize, j: usize| (level * (n + 1) * (n + 1) + j * (n + 1) + i) as u32;
    let mut triangles = Vec::new();
    let mut square = |[a, b, c, d]: [u32; 4]| triangles.extend([[a, b, c], [a, c, d]]);
    for (j, i) in (0..n).flat_map(|j| (0..n).map(move |i| (j, i))) {
        let of = |level| {
            [vertex(level, i, j), vertex(level, i + 1, j), vertex(level, i + 1, j + 1), vertex(level, i, j + 1)]
        };
        square(of(0));
        let [a, b, c, d] = of(1);
        square([d, c, b, a]);
    }
    for i in 0..n {
        square([vertex(1, i, 0), vertex(1, i + 1, 0), vertex(0, i + 1, 0), vertex(0, i, 0)]);
        square([vertex(0, i, n), vertex(0, i + 1, n), vertex(1, i + 1, n), vertex(1, i, n)]);
        square([vertex(0, 0, i), vertex(0, 0, i + 1), vertex(1, 0, i + 1), vertex(1, 0, i)]);
        square([vertex(1, n, i), vertex(1, n, i + 1), vertex(0, n, i + 1), vertex(0, n, i)]);
    }
    Shape::Mesh(Mesh { vertices, triangles }.into())
}

/// A ball of 40 mm of 5120 facets.
fn facets() -> Shape {
    let (vertices, triangles) = shapes::icosphere(20.0, [0.0; 3].into(), 4);
    Shape::Mesh(Mesh { vertices, triangles }.into())
}

/// M_DC and M_AC of every pixel with their variances.
struct Image {
    values: [Vec<f64>; 2],
    variances: [Vec<f64>; 2],
    measures: BTreeMap<String, f64>,
    seconds: f64,
}

fn render(scene: &Scene, method: &str, samples: u32, seed: u64) -> Image {
    let host = MemoryHost::new(seed, &["covariance"], 1);
    let params = json!({"f_x": [0.1], "phases": 3, "method": method, "samples": samples});
    let began = cpu_seconds();
    let ports =
        StageRow::of::<RenderStage>().run(&params, &Inputs::none().with("scene", scene.clone()), Ctx::new(&host));
    let seconds = cpu_seconds() - began;
    let mut stacks = ports.expect("it renders").into_iter().map(|(name, artifact)| match artifact {
        Artifact::Images(stack) => (name, stack),
        _ => panic!("images were expected"),
    });
    let frames = stacks.next().expect("frames come first").1;
    let covariance = stacks.next().expect("it was asked for").1;
    let (values, variances) = amplitudes(&frames, &covariance);
    Image { values, variances, measures: host.measures.into_inner().expect("no holder panics"), seconds }
}

fn amplitudes(frames: &ImageStack, covariance: &ImageStack) -> ([Vec<f64>; 2], [Vec<f64>; 2]) {
    let shots: Vec<_> = frames.layers.iter().filter(|l| l.info.kind == LayerKind::Value).map(|l| l.pixels()).collect();
    let cov = |i: u32, j: u32| {
        covariance.layers.iter().find(|l| l.info.pair == Some([i, j])).expect("of dc, re, im").pixels()
    };
    let (dd, rr, ri, ii) = (cov(0, 0), cov(1, 1), cov(1, 2), cov(2, 2));
    let (mut values, mut variances): ([Vec<f64>; 2], [Vec<f64>; 2]) = Default::default();
    for p in 0..shots[0].len() {
        let [a, b, c] = [0, 1, 2].map(|k| f64::from(shots[k][p]));
        let (re, im) = ((2.0 * a - b - c) / 3.0, (c - b) / 3f64.sqrt());
        let m2 = re * re + im * im;
        let [rr, ri, ii] = [&rr, &ri, &ii].map(|l| f64::from(l[p]));
        values[0].push((a + b + c) / 3.0);
        variances[0].push(f64::from(dd[p]));
        values[1].push(m2.sqrt());
        variances[1].push((re * re * rr + 2.0 * re * im * ri + im * im * ii) / m2);
    }
    (values, variances)
}

fn main() {
    let mut args = std::env::args().skip(1);
    let name = args.next().unwrap_or_else(|| "dome".to_owned());
    let mut number = |default: u64| args.next().map_or(default, |n| n.parse().expect("a number"));
    let (pixels, samples, seeds, long) = (number(32) as u32, number(64) as u32, number(8), number(4096) as u32);
    let scene = scene(&name, pixels);
    let truth = render(&scene, "path", long, 9999);
    let fits: Vec<Image> = (0..seeds).map(|seed| render(&scene, "fit", samples, seed)).collect();
    let paths: Vec<Image> = (0..seeds).map(|seed| render(&scene, "path", samples, seed)).collect();
    println!("{name}: {pixels} x {pixels}, {samples} paths, {seeds} seeds, reference {long}; {:?}", fits[0].measures);
    let mut orders = BTreeMap::<String, Vec<f64>>::new();
    for fit in &fits {
        for (name, value) in fit.measures.iter().filter(|(name, _)| name.contains("fit")) {
            orders.entry(name.clone()).or_default().push((value * 100.0).round() / 100.0);
        }
    }
    orders.iter().for_each(|(name, values)| println!("  {name}: {values:?}"));
    let seconds = |images: &[Image]| images.iter().map(|i| i.seconds).sum::<f64>() / images.len() as f64;
    println!("  CPU s: fit {:.2}, path {:.2}", seconds(&fits), seconds(&paths));
    for (k, what) in ["M_DC", "M_AC"].into_iter().enumerate() {
        // A pixel that is fitted has another value than by paths.
        let fitted = |seed: usize, p: usize| fits[seed].values[k][p] != paths[seed].values[k][p];
        let places: Vec<(usize, usize)> = (0..fits.len())
            .flat_map(|seed| (0..truth.values[k].len()).map(move |p| (seed, p)))
            .filter(|&(seed, p)| fitted(seed, p))
            .collect();
        let count = places.len() as f64;
        let rms = |images: &[Image]| {
            let squares = places.iter().map(|&(seed, p)| {
                let off = images[seed].values[k][p] - truth.values[k][p];
                (off * off - truth.variances[k][p]) / truth.values[k][p].powi(2)
            });
            (squares.sum::<f64>() / count).max(0.0).sqrt()
        };
        let (by_fit, by_path) = (rms(&fits), rms(&paths));
        let (mut sum, mut squares, mut worst, mut stated, mut own) = (0.0, 0.0, 0.0_f64, 0.0, 0.0);
        for &(seed, p) in &places {
            let (off, variance) = (fits[seed].values[k][p] - truth.values[k][p], fits[seed].variances[k][p]);
            let z = off / (variance + truth.variances[k][p]).sqrt();
            (sum, squares, worst) = (sum + z, squares + z * z, worst.max(z.abs()));
            own += (off * off - truth.variances[k][p]) / variance;
            stated += variance / truth.values[k][p].powi(2);
        }
        // Of the mean over seeds, for pixels that all of them fit: what does not average out.
        let n = fits.len() as f64;
        let always: Vec<usize> =
            (0..truth.values[k].len()).filter(|&p| (0..fits.len()).all(|seed| fitted(seed, p))).collect();
        let bias = always.iter().map(|&p| {
            let mean = fits.iter().map(|f| f.values[k][p]).sum::<f64>() / n;
            let off = mean - truth.values[k][p];
            let variance = fits.iter().map(|f| f.variances[k][p]).sum::<f64>() / n;
            (off * off - truth.variances[k][p]) / variance - 1.0 / n
        });
        let bias = bias.sum::<f64>() / always.len() as f64;
        println!(
            "  {what}: {:.0} px; error % fit {:.2} (stated {:.2}), path {:.2}; s to 1 %: fit {:.2}, path {:.1}; z mean {:+.2} sd {:.2} worst {:.1}; squares over stated {:.2}, bias^2 {:+.2}",
            count / n,
            100.0 * by_fit,
            100.0 * (stated / count).sqrt(),
            100.0 * by_path,
            1e4 * by_fit * by_fit * seconds(&fits),
            1e4 * by_path * by_path * seconds(&paths),
            sum / count,
            (squares / count - (sum / count).powi(2)).sqrt(),
            worst,
            own / count,
            bias,
        );
    }
}

/// Seconds that this thread has had a core, so that other work on the machine does not count (Linux; 0 elsewhere).
fn cpu_seconds() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    text.split(' ').next().and_then(|ns| ns.parse::<f64>().ok()).unwrap_or(0.0) * 1e-9
}
