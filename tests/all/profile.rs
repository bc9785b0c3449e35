//! Profile correction as a user runs it: the light that it expects on shapes is what the renderer puts there, and tilted tissue comes back.

use std::collections::BTreeMap;

use crate::metrics::metrics;
use crate::space::Space;

const TILTED: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/pipelines/checks/tilted_plane.yaml");

/// Black bodies (1 % white, so that they hardly light each other) that show what falls on them; the floor is the reference.
const LIT: &str = "\
pipeline: lit
vars: {profile: uniform_intensity, k1: 0}
stages:
  shapes:
    use: scene
    with:
      media: {}
      objects:
        floor: {slab: {thickness: 10, top: 0}, surface: {lambertian: 0.01}}
        ball: {sphere: {diameter: 40, center: [-16, 8, 0]}, surface: {lambertian: 0.01}, priority: 1}
        ramp: {box: {size: [24, 24, 24], center: [20, -8, 0], rotation_deg: [30, 20, 0]}, surface: {lambertian: 0.01}, priority: 2}
      camera: &camera {position: [0, 0, 200], look_at: [0, 0, 0], field: [80, 80], pixels: [40, 40]}
      projector: &projector
        {position: [10, 50, 160], look_at: [0, 0, 0], field: [200, 200], power: 5, profile: \"${profile}\", distortion: {k1: \"${k1}\"}}
  flat:
    use: scene
    with:
      media: {}
      objects: {floor: {slab: {thickness: 10, top: 0}, surface: {lambertian: 0.01}}}
      camera: *camera
      projector: *projector
  frames: {use: render, in: {scene: shapes}, with: &shots {f_x: [0, 0.05], phases: 3, samples: 64}}
  flat_frames: {use: render, in: {scene: flat}, with: *shots}
  modulation: {use: demodulate, in: {frames: frames, covariance: frames.covariance}}
  flat_modulation: {use: demodulate, in: {frames: flat_frames, covariance: flat_frames.covariance}}
  ratio:
    use: calibrate
    in: {sample: modulation, reference: flat_modulation}
    with: {reference: {mu_a: 0.01, mu_s_prime: 1, g: 0.8, n: 1.0}, model: diffusion}
  table: {use: build_lut, with: {model: diffusion, f_x: [0, 0.05], g: 0.8, n: 1.0}}
  maps: {use: invert, in: {reflectance: ratio, lut: table, height: frames.truth, scene: shapes}}
";

/// The layers of an exported port by name, pixel by pixel; of several f_x the first.
fn layers(space: &Space, file: &str, port: &str, settings: &[&str]) -> BTreeMap<String, Vec<f64>> {
    space.turbid(&[&["export", file, port, "--to", "x.csv"], settings].concat()).ok();
    let text = std::fs::read_to_string(space.path().join("x.csv")).expect("it was just written");
    let mut lines = text.lines();
    let head: Vec<&str> = lines.next().expect("a head").split(',').collect();
    let at = |name: &str| head.iter().position(|h| *h == name).unwrap_or_else(|| panic!("{name}: {head:?}"));
    let (name, row, column, value) = (at("name"), at("row"), at("column"), at("value"));
    let mut found: BTreeMap<String, Vec<f64>> = BTreeMap::new();
    for line in lines {
        let cells: Vec<&str> = line.split(',').collect();
        let number = |at: usize| cells[at].parse::<f64>().unwrap_or_else(|e| panic!("{line}: {e}"));
        let pixels = found.entry(cells[name].to_owned()).or_default();
        // Layers come one after another: what is already there is that of the first f_x.
        if number(row) as usize * 40 + number(column) as usize == pixels.len() {
            pixels.push(number(value));
        }
    }
    found
}

/// What the renderer puts on floor, ball and ramp over what it puts on the floor alone is E / E_reference of the correction, for both profiles and
/// through a lens that distorts. Of pixels whose neighbours show the same face of a body. A pixel holds the mean over its 2 mm, the
/// correction its middle: on the ball (20 mm) they differ by (2 / 20)^2 / 24 x some 5 below 60 degrees, 0.2 %; bodies light each other by less
/// than 1 %: limits 4.5 standard errors and 1 %, in the mean 0.5 %.
#[test]
fn the_light_on_shapes_is_that_of_the_renderer() {
    let space = Space::new();
    let file = "lit.yaml";
    space.write(file, LIT);
    for settings in [&[][..], &["--set", "vars.profile=flat", "--set", "vars.k1=-0.15"]] {
        let wanted = ["maps.exposure", "ratio", "frames.truth"];
        space.turbid(&[&["run", file], &wanted[..], settings].concat()).ok();
        let ratio = layers(&space, file, "ratio.reflectance", settings);
        let exposure = layers(&space, file, "maps.exposure", settings);
        let truth = layers(&space, file, "frames.truth", settings);
        let (object, mask) = (&truth["object"], &exposure["mask"]);
        let normals = ["normal_x", "normal_y", "normal_z"].map(|name| &truth[name]);
        let inside = |i: usize| {
            let (row, column) = (i / 40, i % 40);
            (2..38).contains(&row)
                && (2..38).contains(&column)
                && (0..25).all(|k| {
                    let near = (row + k / 5 - 2) * 40 + column + k % 5 - 2;
                    let turned: f64 = normals.iter().map(|n| n[i] * n[near]).sum();
                    object[near] == object[i] && turned > 0.9
                })
        };
        let floor = |i: usize| object[i] == 1.0 && truth["height"][i].abs() < 1e-3;
        let share = |i: usize| ratio["r_d"][i] / exposure["irradiance"][i];
        let all: Vec<usize> = (0..1600).filter(|&i| inside(i) && mask[i] == 0.0 && ratio["mask"][i] == 0.0).collect();
        // Far from the shades: the rows towards the lamp.
        let bare: Vec<f64> = all.iter().copied().filter(|&i| floor(i) && i / 40 < 8).map(share).collect();
        let base = bare.iter().sum::<f64>() / bare.len() as f64;
        let (mut sum, mut count) = ([0.0; 3], [0.0; 3]);
        for &i in all.iter().filter(|&&i| object[i] != 1.0) {
            let off = share(i) / base - 1.0;
            let se = ratio["r_d_se"][i] / ratio["r_d"][i];
            assert!(off.abs() < 4.5 * se + 0.01, "object {}, pixel {i}: {off} +- {se}", object[i]);
            sum[object[i] as usize] += off;
            count[object[i] as usize] += 1.0;
        }
        for body in [0, 2] {
            assert!(count[body] > 20.0 && (sum[body] / count[body]).abs() < 5e-3, "{body}: {sum:?} / {count:?}");
        }
    }
}

/// Carcinoma tilted by 30 degrees: mu_a is a fifth to a third too high for a flat reference and within 10 % of the truth with the correction (what is left
/// is oblique light, docs/theory/invert.md), each to 4.5 standard errors; untilted both are right and the same.
#[test]
fn tilted_tissue_comes_back() {
    let space = Space::new();
    let settings = ["vars.tilts=[0, 30]", "vars.pixels=12", "vars.samples=512", "vars.reference_samples=256"];
    let settings: Vec<&str> = settings.iter().flat_map(|set| ["--set", set]).collect();
    let wanted = ["along_metrics", "along_corrected_metrics", "across_metrics", "across_corrected_metrics"];
    space.turbid(&[&["run", TILTED], &wanted[..], &settings].concat()).ok();
    let off = |stage: &str, tilt: u32| {
        let rows = metrics(&space, TILTED, &format!("{stage}[tilt={tilt}]"), &settings);
        let row = rows.iter().find(|row| row.quantity == "mu_a").expect("mu_a");
        assert!(row.n > 130.0, "{stage}: {} pixels", row.n);
        (row.mean / row.truth - 1.0, row.se / row.truth)
    };
    for way in ["along", "across"] {
        let [plain, corrected] = ["metrics", "corrected_metrics"].map(|kind| format!("{way}_{kind}"));
        let ((flat, se), (same, _)) = (off(&plain, 0), off(&corrected, 0));
        assert!(flat.abs() < 4.5 * se && (flat - same).abs() < 1e-4, "{way}: {flat} +- {se}, {same}");
        let ((high, se), (right, right_se)) = (off(&plain, 30), off(&corrected, 30));
        assert!(high > 0.2 - 4.5 * se, "{way}: {high} +- {se}");
        assert!(right.abs() < 0.1 + 4.5 * right_se && right_se < 0.03, "{way}: {right} +- {right_se}");
    }
}

/// A shape without a rig, and a rig without a shape, are found by `check`, with their places.
#[test]
fn a_shape_without_a_rig_is_a_mistake_in_the_file() {
    let space = Space::new();
    for (wrong, message) in [
        (LIT.replace(", scene: shapes}}\n", "}}\n"), "the input `height` is connected, but not `scene`"),
        (LIT.replace(", height: frames.truth", ""), "`scene` is given, but the input `height` is not"),
    ] {
        space.write("wrong.yaml", &wrong);
        let line = wrong.lines().position(|line| line.starts_with("  maps:")).expect("the stage") + 1;
        let said = space.turbid(&["check", "wrong.yaml"]).fails(2);
        assert!(said.contains(&format!("wrong.yaml:{line}:3: error: stages.maps.with: {message}")), "{said}");
    }
}
