//! What each thing saves that a scene does not need: `cargo bench --bench left_out [-- PART_OF_A_NAME]`.
//!
//! Each row renders one image twice: as the program does, and with a capability forced upon it that the image does not need, by a scene
//! that asks for it and looks the same (an index that differs by 1e-9, a lamp of 1e-12 W, a second body of the same medium, ..). 64 x 64 pixels of 1 mm, f_x = 0.1,
//! three phases, A_rho 100, S_rho 5000, g 0.8, camera at 500 mm, projector 35 mm beside it, 64 paths per pixel where
//! nothing else is said. CPU seconds of the render alone, the least of three runs, taken in turns; and how far the two image means are apart.

mod program;

use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::path::Path;

use program::{number, run, stage};

/// Runs of each side.
const RUNS: u64 = 3;

/// Parts of a pipeline.
#[derive(Clone)]
struct Scene {
    /// Before `media`.
    channels: &'static str,
    media: &'static str,
    /// One line each.
    objects: Vec<&'static str>,
    /// More keys of the camera, the projector and the scene.
    camera: &'static str,
    projector: &'static str,
    lights: &'static str,
    f_x: &'static str,
    /// More params of `render`, and its inputs.
    render: &'static str,
    input: &'static str,
    /// More stages.
    stages: &'static str,
}

const SLAB: &str = "tissue: {slab: {thickness: 2000, top: 0}, medium: m}";
const FLOOR: &str = "floor: {slab: {thickness: 9, top: 0}, surface: {lambertian: 0.5}}";
const BALL: &str = "ball: {sphere: {diameter: 30, center: [0, 0, -5]}, medium: other, priority: 1}";
const MEDIA: &str = "{m: {A_rho: 100, S_rho: 5000, g: 0.8, n: 1.0}, other: {A_rho: 25, S_rho: 4236, g: 0.8, n: 1.0}, same: {A_rho: 100, S_rho: 5000.00001, g: 0.8, n: 1.0}}";
const WET: &str =
    "{m: {A_rho: 100, S_rho: 5000, g: 0.8, n: 1.000000001}, other: {A_rho: 25, S_rho: 4236, g: 0.8, n: 1.000000001}}";
const SAMPLES: &str = "method: path, samples: 64";

fn half_space() -> Scene {
    Scene {
        channels: "",
        media: MEDIA,
        objects: vec![SLAB],
        camera: "",
        projector: "",
        lights: "{}",
        f_x: "[0.1]",
        render: SAMPLES,
        input: "scene: scene",
        stages: "",
    }
}

/// Scene, what is left out, without it, with it.
struct Row(&'static str, &'static str, Scene, Scene);

fn rows() -> Vec<Row> {
    let plain = half_space();
    let ball = Scene { objects: vec![SLAB, BALL], ..plain.clone() };
    let floor = Scene { objects: vec![FLOOR], f_x: "[0]", render: "method: path, samples: 512", ..plain.clone() };
    let three = |mu_s: &'static str| Scene { channels: "wavelength_nm: [620, 540, 460]", media: mu_s, ..plain.clone() };
    let shared = three("{m: {mu_a: [0.05, 0.1, 0.2], mu_s: 5, g: 0.8, n: 1.0}}");
    let apart = three("{m: {mu_a: [0.05, 0.1, 0.2], mu_s: [5, 5.000000001, 5.000000002], g: 0.8, n: 1.0}}");
    let seen = |stages: &'static str| Scene { stages, ..plain.clone() };
    let to_target =
        |objects: Vec<&'static str>, method: &'static str| Scene { objects, render: method, ..plain.clone() };
    vec![
        Row(
            "half-space",
            "shadow rays through several objects",
            plain.clone(),
            Scene {
                objects: vec![SLAB, "core: {sphere: {diameter: 30, center: [0, 0, -20]}, medium: same, priority: 1}"],
                ..plain.clone()
            },
        ),
        Row("half-space", "Fresnel boundaries", plain.clone(), Scene { media: WET, ..plain.clone() }),
        Row("half-space", "carriers (1 f_x)", Scene { f_x: "[0]", ..plain.clone() }, plain.clone()),
        Row("half-space", "3 more f_x", plain.clone(), Scene { f_x: "[0.1, 0.05, 0.15, 0.2]", ..plain.clone() }),
        Row(
            "half-space",
            "pattern images",
            Scene { projector: ", pixels: [1024, 1024]", ..plain.clone() },
            Scene {
                projector: ", pixels: [1024, 1024]",
                f_x: "[]",
                input: "scene: scene, pattern: shown",
                stages: "  shown:\n    use: pattern\n    in: {scene: scene}\n    with: {f_x: [0.1], phases: 3}\n",
                ..plain.clone()
            },
        ),
        Row(
            "half-space",
            "lens distortion (projector)",
            plain.clone(),
            Scene { projector: ", distortion: {k1: 1e-12}", ..plain.clone() },
        ),
        Row("half-space", "depth of field", plain.clone(), Scene { camera: ", aperture: 1e-9", ..plain.clone() }),
        Row(
            "half-space",
            "steady lights",
            plain.clone(),
            Scene { lights: "{lamp: {point: {position: [0, 40, 400], power: 1e-12}}}", ..plain.clone() },
        ),
        Row(
            "half-space",
            "ambient light",
            plain.clone(),
            Scene { lights: "{sky: {ambient: {radiance: 1e-15}}}", ..plain.clone() },
        ),
        Row("half-space, 3 channels", "paths of its own for each channel", shared, apart),
        Row(
            "half-space",
            "port `covariance`",
            seen(""),
            seen("  modulation:\n    use: demodulate\n    in: {frames: frames, covariance: frames.covariance}\n"),
        ),
        Row(
            "half-space to 4 %",
            "paths for every pixel (`fit` instead)",
            to_target(vec![SLAB], "method: fit, target_error: 0.04"),
            to_target(vec![SLAB], "method: path, target_error: 0.04"),
        ),
        Row(
            "ball in a slab to 4 %",
            "control variates (`auto` against `path`)",
            to_target(vec![SLAB, BALL], "method: path, target_error: 0.04"),
            to_target(vec![SLAB, BALL], "method: auto, target_error: 0.04"),
        ),
        Row(
            "ball in a slab",
            "paths to where the error is",
            ball.clone(),
            Scene { render: "method: path, samples: 64, allocate: adaptive", ..ball.clone() },
        ),
        Row(
            "ball in a slab",
            "BVH",
            ball.clone(),
            Scene {
                objects: vec![SLAB, "ball: {mesh: {file: ball.obj, position: [0, 0, -5]}, medium: other, priority: 1}"],
                ..ball.clone()
            },
        ),
        Row(
            "ball in a slab",
            "refraction at curved walls",
            ball.clone(),
            Scene { media: WET, render: "method: path, samples: 4", ..ball.clone() },
        ),
        Row(
            "Lambertian floor",
            "textures",
            floor.clone(),
            Scene {
                objects: vec![
                    "floor: {slab: {thickness: 9, top: 0}, surface: {lambertian: {checker: {side: 1, low: 0.5, high: 0.5}}}}",
                ],
                ..floor.clone()
            },
        ),
        Row(
            "Lambertian floor",
            "volume scattering",
            floor.clone(),
            Scene {
                objects: vec![FLOOR, "fog: {slab: {thickness: 1, top: 1}, medium: fog}"],
                media: "{fog: {mu_a: 0, mu_s: 1e-9, g: 0, n: 1.0}}",
                ..floor
            },
        ),
    ]
}

impl Scene {
    fn pipeline(&self, seed: u64) -> String {
        let Self { channels, media, camera, projector, lights, f_x, render, input, stages, .. } = self;
        let objects: String = self.objects.iter().fold(String::new(), |mut text, line| {
            let _ = writeln!(text, "        {line}");
            text
        });
        let shown = if *f_x == "[]" { String::new() } else { format!("f_x: {f_x}, phases: 3, ") };
        format!(
            "pipeline: left_out\nseed: {seed}\nstages:\n  scene:\n    use: scene\n    with:\n      {channels}\n      media: {media}\n      objects:\n{objects}      camera: {{position: [0, 0, 500], look_at: [0, 0, 0], field: [64, 64], pixels: [64, 64], specular: exclude{camera}}}\n      projector: {{position: [35, 0, 500], look_at: [0, 0, 0], field: [256, 256], power: 5{projector}}}\n      lights: {lights}\n{stages}  frames:\n    use: render\n    in: {{{input}}}\n    with: {{{shown}{render}}}\n"
        )
    }
}

/// What the render of a run cost and gave.
struct Ran {
    cpu_seconds: f64,
    /// Mean over the image of each frame, and its standard error.
    means: Vec<[f64; 2]>,
}

fn frames(space: &Path, pipeline: &str) -> Result<Ran, String> {
    let shown = run(space, pipeline)?;
    let frames = stage(&shown, "frames")?;
    let layers = frames["ports"]["frames"]["layers"].as_array().into_iter().flatten();
    let values = layers.filter(|layer| layer["kind"] == "value");
    Ok(Ran {
        cpu_seconds: number(&frames["cpu_seconds"]),
        means: values.map(|layer| [number(&layer["mean"]), number(&layer["mean_se"])]).collect(),
    })
}

/// The least CPU seconds.
fn best(runs: &[Ran]) -> f64 {
    runs.iter().map(|r| r.cpu_seconds).fold(f64::INFINITY, f64::min)
}

/// Paths per pixel that a row asks for, to compare seconds of rows that ask for fewer.
fn samples(scene: &Scene) -> Option<f64> {
    let (_, rest) = scene.render.split_once("samples: ")?;
    rest.split(',').next()?.parse().ok()
}

fn main() {
    let wanted = std::env::args().nth(1).filter(|a| !a.starts_with("--")).unwrap_or_default();
    let space = tempfile::tempdir().expect("a temporary folder");
    std::fs::write(space.path().join("ball.obj"), ball(15.0, 128, 64)).expect("a file can be written");
    println!(
        "| scene | left out | CPU s without | with | ratio | image means apart |\n| --- | --- | --- | --- | --- | --- |"
    );
    for Row(scene, what, without, with) in rows().iter().filter(|row| row.1.contains(&wanted)) {
        match compare(space.path(), without, with) {
            Ok(line) => println!("| {scene} | {what} | {line} |"),
            Err(e) => println!("| {scene} | {what} | {} |", e.lines().next().unwrap_or_default()),
        }
    }
}

fn compare(space: &Path, without: &Scene, with: &Scene) -> Result<String, String> {
    let (mut plain, mut forced) = (Vec::new(), Vec::new());
    for seed in 0..RUNS {
        plain.push(frames(space, &without.pipeline(2 * seed))?);
        forced.push(frames(space, &with.pipeline(2 * seed + 1))?);
    }
    // To the same number of paths.
    let per_path = samples(without).zip(samples(with)).map_or(1.0, |(a, b)| a / b);
    let seconds = [best(&plain), best(&forced) * per_path];
    // Of all frames of a run, which share paths: the mean of their errors is not too small.
    let image = |run: &Ran| {
        let n = run.means.len() as f64;
        run.means.iter().fold([0.0; 2], |s, [m, se]| [s[0] + m / n, s[1] + se / n])
    };
    let mean = |runs: &[Ran]| {
        let n = runs.len() as f64;
        let sum = runs.iter().map(image).fold([0.0; 2], |s, [m, se]| [s[0] + m, s[1] + se * se]);
        [sum[0] / n, sum[1] / (n * n)]
    };
    let ([a, va], [b, vb]) = (mean(&plain), mean(&forced));
    Ok(format!(
        "{:.2} | {:.2} | {:.2} | {:+.2} +- {:.2} % |",
        seconds[0],
        seconds[1],
        seconds[1] / seconds[0],
        100.0 * (b / a - 1.0),
        100.0 * (va + vb).sqrt() / a
    )
    .trim_end_matches([' ', '|'])
    .to_owned())
}

/// A sphere as a closed mesh of 2 `around` (`down` - 1) triangles.
fn ball(radius: f64, around: usize, down: usize) -> String {
    let mut text = format!("v 0 0 {radius}\nv 0 0 {}\n", -radius);
    for (i, j) in (1..down).flat_map(|i| (0..around).map(move |j| (i, j))) {
        let (polar, azimuth) = (0.5 * TAU * i as f64 / down as f64, TAU * j as f64 / around as f64);
        let (sin, cos) = polar.sin_cos();
        let _ = writeln!(text, "v {} {} {}", radius * sin * azimuth.cos(), radius * sin * azimuth.sin(), radius * cos);
    }
    // Vertices count from 1.
    let at = |i: usize, j: usize| 3 + (i - 1) * around + j % around;
    for j in 0..around {
        let _ = writeln!(text, "f 1 {} {}\nf 2 {} {}", at(1, j), at(1, j + 1), at(down - 1, j + 1), at(down - 1, j));
        for i in 1..down - 1 {
            let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
            let _ = writeln!(text, "f {a} {b} {c}\nf {a} {c} {d}");
        }
    }
    text
}
