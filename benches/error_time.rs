//! Error against run time of renders, through the program as a user runs it: `cargo bench --bench error_time [-- quick] [-- --svg FILE]`, or
//! of scenes with these words in their names: `-- --only spheroid,tube`.
//!
//! 64 x 64 pixels of 1 mm, f_x = 0.1, three phases, g = 0.8, camera at 500 mm, projector 35 mm beside it. Seconds are CPU seconds of the
//! render alone: on two free cores a user waits half as long. The error of a pixel is measured against a render that is hundreds of times longer where
//! the scene is laterally uniform; elsewhere it is the standard error that the program states. Pixels of a region are pooled as root mean square.

mod program;

use std::fmt::Write as _;
use std::path::Path;

use program::{number, run, stage};
use turbid::store::decode;
use turbid_contract::{Artifact, ArtifactKind, ImageStack};

/// Pixels between two distances from the middle of the image, in pixels.
struct Region {
    name: &'static str,
    from: f64,
    to: f64,
    /// CPU seconds to 1 % of M_DC and M_AC in Blender's Cycles (bpy 5.0.1) on the machine of docs/validation.md, where measured: half-spaces by `blender.py`,
    /// the others once, times what half-spaces take on that machine over what they took then (0.86).
    cycles: Option<[f64; 2]>,
}

const fn region(name: &'static str, from: f64, to: f64) -> Region {
    Region { name, from, to, cycles: None }
}

fn measured(region: Region, cycles: [f64; 2]) -> Region {
    Region { cycles: Some(cycles), ..region }
}

struct Scene {
    name: &'static str,
    /// `media` and `objects` of the scene stage, and what is special about its rig.
    text: String,
    /// Laterally uniform: its truth is cheap.
    uniform: bool,
    /// The last one is drawn.
    regions: Vec<Region>,
    samples: &'static [u32],
}

const RIG: &str =
    "      camera: {position: [0, 0, 500], look_at: [0, 0, 0], field: [64, 64], pixels: [64, 64], specular: exclude}
      projector: {position: [35, 0, 500], look_at: [0, 0, 0], field: [256, 256], power: 5}
";

fn half_space(name: &'static str, a_rho: f64, s_rho: f64, n: f64, cycles: Option<[f64; 2]>) -> Scene {
    let text = format!(
        "      media: {{m: {{A_rho: {a_rho}, S_rho: {s_rho}, g: 0.8, n: {n}}}}}
      objects: {{tissue: {{slab: {{thickness: 2000, top: 0}}, medium: m}}}}
{RIG}"
    );
    let all = Region { cycles, ..region("", 0.0, f64::INFINITY) };
    Scene { name, text, uniform: true, regions: vec![all], samples: &[16, 64, 256, 1024] }
}

fn scenes() -> Vec<Scene> {
    const MEDIA: &str =
        "healthy: {A_rho: 25, S_rho: 4236, g: 0.8, n: 1.0}, scc: {A_rho: 96, S_rho: 3721, g: 0.8, n: 1.0}";
    let polyp = |shape: &str, n: &str| {
        let media = MEDIA.replace("n: 1.0", n);
        format!(
            "      media: {{{media}}}
      objects:
        tissue: {{slab: {{thickness: 2000, top: 0}}, medium: healthy}}
        polyp: {{{shape}, medium: scc, priority: 1}}
{RIG}"
        )
    };
    let flush = format!(
        "      media: {{{MEDIA}, air: {{mu_a: 0, mu_s: 0, g: 0, n: 1.0}}}}
      objects:
        tissue: {{slab: {{thickness: 2000, top: 0}}, medium: healthy}}
        lesion: {{spheroid: {{diameters: [36, 36, 24], center: [0, 0, 0]}}, medium: scc, priority: 1}}
        above: {{box: {{size: [200, 200, 30], center: [0, 0, 15]}}, medium: air, priority: 2}}
{RIG}"
    );
    let tube = "      media: {m: {A_rho: 100, S_rho: 5000, g: 0.8, n: 1.0}}
      objects: {tube: {tube: {inner_diameter: 20, outer_diameter: 80, length: 250, top: 0}, medium: m}}
      camera: {position: [0, 0, 110], look_at: [0, 0, 0], field: [20, 20], pixels: [64, 64], specular: exclude}
      projector: {position: [0, 0, 100], look_at: [0, 0, 0], field: [20, 20], power: 5}
"
    .to_owned();
    // 20 mm of radius are 20 pixels, two more on the dome 40 mm above the slab.
    let dome = |cycles: [Option<[f64; 2]>; 2]| {
        let [on, around] = cycles;
        vec![
            Region { cycles: on, ..region("dome", 0.0, 18.0) },
            region("rim", 18.0, 24.0),
            Region { cycles: around, ..region("surround", 24.0, f64::INFINITY) },
        ]
    };
    // A depth of t mm down the tube is 32 x 110 / (110 + t) pixels from the middle.
    let down = |t: f64| 32.0 * 110.0 / (110.0 + t);
    let lumen = vec![
        measured(region("200 to 250 mm down", down(250.0), down(200.0)), [306_000.0, 5_000_000.0]),
        region("90 to 110 mm down", down(110.0), down(90.0)),
        measured(region("first 10 mm", down(10.0), down(0.0)), [87_000.0, 768_000.0]),
    ];
    let mesh = format!(
        "mesh: {{file: \"{}/pipelines/checks/icosphere.stl\", scale: 40, position: [0, 0, 0]}}",
        env!("CARGO_MANIFEST_DIR")
    );
    let spheroid = "spheroid: {diameters: [40, 40, 80], center: [0, 0, 0]}";
    let scene = |name, text, regions| Scene { name, text, uniform: false, regions, samples: &[64, 256] };
    vec![
        half_space("(100, 5000)", 100.0, 5000.0, 1.0, Some([12_100.0, 51_600.0])),
        half_space("(25, 4236)", 25.0, 4236.0, 1.0, Some([17_800.0, 147_000.0])),
        half_space("(1, 20000)", 1.0, 20_000.0, 1.0, Some([35_200.0, 107_600.0])),
        half_space("(100, 5000), n = 1.4", 100.0, 5000.0, 1.4, None),
        scene("lesion level with the surface", flush, vec![region("", 0.0, f64::INFINITY)]),
        scene(
            "spheroid on a slab",
            polyp(spheroid, "n: 1.0"),
            dome([Some([48_000.0, 438_000.0]), Some([20_300.0, 175_000.0])]),
        ),
        scene("ball of 1280 facets on a slab", polyp(&mesh, "n: 1.0"), dome([Some([38_000.0, 244_000.0]), None])),
        scene("spheroid on a slab, n = 1.4", polyp(spheroid, "n: 1.4"), dome([None; 2])),
        scene("ball of 1280 facets on a slab, n = 1.4", polyp(&mesh, "n: 1.4"), dome([None; 2])),
        scene("tube", tube, lumen),
    ]
}

/// What one render gave.
struct Shot {
    cpu_seconds: f64,
    /// M_DC and M_AC with their standard errors, per pixel.
    value: [Vec<f64>; 2],
    se: [Vec<f64>; 2],
}

/// Renders and demodulates a scene in `space`.
fn shoot(space: &Path, scene: &Scene, method: &str, samples: u32, seed: u64) -> Result<Shot, String> {
    let shown = run(
        space,
        &format!(
            "pipeline: error_time\nseed: {seed}\nstages:\n  scene:\n    use: scene\n    with:\n{}  frames:\n    use: render\n    in: {{scene: scene}}\n    with: {{f_x: [0.1], phases: 3, samples: {samples}, method: {method}}}\n  modulation:\n    use: demodulate\n    in: {{frames: frames, covariance: frames.covariance}}\n    with: {{noise_bias: keep, low_signal: 0}}\n",
            scene.text
        ),
    )?;
    let path = stage(&shown, "modulation")?["ports"]["modulation"]["path"].as_str().ok_or("no path")?;
    let bytes = std::fs::read(path).map_err(|e| e.to_string())?;
    let Ok(Artifact::Images(stack)) = decode(ArtifactKind::Images, &bytes) else { return Err("no images".into()) };
    let pick = |name: &str| plane(&stack, name).ok_or(format!("no layer {name}"));
    Ok(Shot {
        cpu_seconds: number(&stage(&shown, "frames")?["cpu_seconds"]),
        value: [pick("m_dc")?, pick("m_ac")?],
        se: [pick("m_dc_se")?, pick("m_ac_se")?],
    })
}

fn plane(stack: &ImageStack, name: &str) -> Option<Vec<f64>> {
    let layer = stack.find(name, None)?;
    Some(layer.pixels().iter().map(|&v| f64::from(v)).collect())
}

/// Pixels of a region, of 64 x 64.
fn inside(region: &Region, pixel: usize) -> bool {
    let [x, y] = [pixel % 64, pixel / 64].map(|i| i as f64 - 31.5);
    (region.from..region.to).contains(&x.hypot(y))
}

/// Root mean square over the lit pixels of a region of error / value, for M_DC and M_AC.
fn error(shot: &Shot, truth: Option<&Shot>, region: &Region) -> [f64; 2] {
    [0, 1].map(|i| {
        let expected = &truth.unwrap_or(shot).value[i];
        let brightest = expected.iter().fold(0.0, |a: f64, &b| a.max(b));
        let lit = expected.iter().enumerate().filter(|(pixel, e)| **e > 1e-4 * brightest && inside(region, *pixel));
        let (mut sum, mut n) = (0.0, 0.0);
        for (pixel, &e) in lit {
            let off = if truth.is_some() { shot.value[i][pixel] - e } else { shot.se[i][pixel] };
            sum += (off / e).powi(2);
            n += 1.0;
        }
        (sum / f64::max(n, 1.0)).sqrt()
    })
}

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let quick = arguments.iter().any(|a| a == "quick");
    let said = |word: &str| arguments.iter().position(|a| a == word).and_then(|i| arguments.get(i + 1));
    let (svg, only) = (said("--svg"), said("--only"));
    let is_asked = |scene: &Scene| only.is_none_or(|words| words.split(',').any(|word| scene.name.contains(word)));
    let space = tempfile::tempdir().expect("a temporary folder");
    let mut curves: Vec<Curve> = Vec::new();
    println!(
        "| scene | region | method | paths per pixel | CPU s | error of M_DC, M_AC | CPU s to 1 % of M_DC, M_AC | Cycles / turbid |\n| --- | --- | --- | --- | --- | --- | --- | --- |"
    );
    for (k, scene) in scenes().iter().enumerate().filter(|(_, scene)| is_asked(scene)) {
        let truth = if scene.uniform {
            shoot(space.path(), scene, "fit", if quick { 256 } else { 2048 }, 1000)
                .map_err(|e| println!("{}: {e}", scene.name))
                .ok()
        } else {
            None
        };
        let auto: &[u32] = if scene.uniform { &[16, 64, 256] } else { scene.samples };
        // In laterally uniform scenes that is `auto`.
        let fit: &[u32] = if scene.uniform { &[] } else { scene.samples };
        for (method, samples) in [("path", scene.samples), ("auto", auto), ("fit", fit)] {
            let mut points = Vec::new();
            for &n in samples.iter().take(if quick { 2 } else { usize::MAX }) {
                // Several seeds: a smooth error is one number per image.
                let seeds = if method == "auto" && scene.uniform { 4 } else { 1 };
                let shots = (0..seeds).map(|seed| shoot(space.path(), scene, method, n, 10 * k as u64 + seed));
                let shots: Vec<Shot> = match shots.collect() {
                    Ok(shots) => shots,
                    Err(e) => {
                        println!("{}, {method}, {n}: {}", scene.name, e.lines().next().unwrap_or_default());
                        continue;
                    }
                };
                let seconds = shots.iter().map(|s| s.cpu_seconds).sum::<f64>() / seeds as f64;
                for region in &scene.regions {
                    let squares = shots.iter().map(|s| error(s, truth.as_ref(), region).map(|e| e * e));
                    let e = squares.fold([0.0; 2], |a, b| [a[0] + b[0], a[1] + b[1]]);
                    let e = e.map(|sum| (sum / seeds as f64).sqrt());
                    let to_one = e.map(|e| seconds * (e / 0.01).powi(2));
                    let ratio = |i: usize| region.cycles.map(|c| c[i] / to_one[i]);
                    let gain = [0, 1].map(|i| ratio(i).map_or(String::new(), |r| format!("{r:.0}"))).join(", ");
                    println!(
                        "| {} | {} | {method} | {n} | {seconds:.2} | {:.3} %, {:.3} % | {:.2}, {:.2} | {} |",
                        scene.name,
                        region.name,
                        100.0 * e[0],
                        100.0 * e[1],
                        to_one[0],
                        to_one[1],
                        gain.trim_matches([' ', ','])
                    );
                    if std::ptr::eq(region, scene.regions.last().expect("a region")) {
                        points.push((seconds, e[1]));
                    }
                }
            }
            curves.push(Curve {
                name: format!("{}, {method}", scene.name),
                dashed: method == "path",
                color: k,
                points,
            });
        }
        if let Some([_, ac]) = scene.regions.last().and_then(|r| r.cycles) {
            // Errors fall like one over the root of time, from 100 % on.
            let points = [f64::max(10.0, 1e-4 * ac), 1e5].map(|s| (s, 0.01 * (ac / s).sqrt())).to_vec();
            curves.push(Curve { name: format!("{}, Cycles", scene.name), dashed: true, color: k, points });
        }
    }
    if let Some(file) = svg {
        std::fs::write(file, plot(&curves)).expect("the figure can be written");
    }
}

struct Curve {
    name: String,
    dashed: bool,
    color: usize,
    points: Vec<(f64, f64)>,
}

/// Error against seconds, both logarithmic.
fn plot(curves: &[Curve]) -> String {
    const COLORS: [&str; 10] =
        ["#1f77b4", "#d62728", "#2ca02c", "#9467bd", "#ff7f0e", "#17becf", "#e377c2", "#7f7f7f", "#bcbd22", "#8c564b"];
    let (left, top, width, height) = (70.0, 20.0, 520.0, 400.0);
    // 0.01 to 1e5 s, 0.1 to 100 %.
    let x = |s: f64| left + width * (s.log10() + 2.0) / 7.0;
    let y = |e: f64| top + height * (-e.log10()) / 3.0;
    // As high as the list of curves.
    let high = (2.0 * top + 18.0 * curves.len() as f64).max(470.0);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 920 {high}\" font-family=\"sans-serif\" font-size=\"12\">\n<rect width=\"920\" height=\"{high}\" fill=\"white\"/>\n",
    );
    for decade in -2..=5 {
        let at = x(10f64.powi(decade));
        let _ = writeln!(
            svg,
            "<path d=\"M{at:.1} {top}V{}\" stroke=\"#ddd\"/><text x=\"{at:.1}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
            top + height,
            top + height + 18.0,
            10f64.powi(decade)
        );
    }
    for (decade, label) in [(0, "100 %"), (-1, "10 %"), (-2, "1 %"), (-3, "0.1 %")] {
        let at = y(10f64.powi(decade));
        let _ = writeln!(
            svg,
            "<path d=\"M{left} {at:.1}H{}\" stroke=\"#ddd\"/><text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{label}</text>",
            left + width,
            left - 6.0,
            at + 4.0
        );
    }
    let _ = writeln!(svg, "<text x=\"{}\" y=\"460\" text-anchor=\"middle\">CPU seconds</text>", left + 0.5 * width);
    let _ = writeln!(
        svg,
        "<text x=\"16\" y=\"{}\" transform=\"rotate(-90 16 {0})\" text-anchor=\"middle\">error of M_AC per pixel (rms)</text>",
        top + 0.5 * height
    );
    for (i, curve) in curves.iter().filter(|c| !c.points.is_empty()).enumerate() {
        let color = COLORS[curve.color % COLORS.len()];
        let dash = match (curve.dashed, curve.name.ends_with("Cycles")) {
            (_, true) => "2 4",
            (true, _) => "7 3",
            _ => "none",
        };
        let inside = curve.points.iter().filter(|(s, e)| *s > 0.0 && (1e-3..=1.0).contains(e));
        let line: Vec<String> = inside.clone().map(|&(s, e)| format!("{:.1},{:.1}", x(s), y(e))).collect();
        let _ = writeln!(
            svg,
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"1.6\" stroke-dasharray=\"{dash}\"/>",
            line.join(" ")
        );
        if !curve.name.ends_with("Cycles") {
            for &(s, e) in inside {
                let _ = writeln!(svg, "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"3\" fill=\"{color}\"/>", x(s), y(e));
            }
        }
        let row = top + 10.0 + 18.0 * i as f64;
        let _ = writeln!(
            svg,
            "<path d=\"M605 {row}h28\" stroke=\"{color}\" stroke-width=\"1.6\" stroke-dasharray=\"{dash}\"/><text x=\"640\" y=\"{}\">{}</text>",
            row + 4.0,
            curve.name
        );
    }
    svg.push_str("</svg>\n");
    svg
}
