//! One rig for sample and phantom: a change of it reaches both, and arms of two rigs are refused before anything runs.

use crate::metrics::metrics;
use crate::space::Space;

const QUICKSTART: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/pipelines/quickstart.yaml");

/// A lamp of 6 W instead of 5 W lights sample and phantom alike, so that maps stay what they are. Both runs see the same random numbers
/// (`seed` on the renders): what is left of the difference is rounding, f32 through ratio and table. With one arm lit more mu_a was 43 % low.
#[test]
fn power_of_the_rig_cancels() {
    let space = Space::new();
    let small = [
        "stages.rig.with.camera.pixels=[16, 16]",
        "vars.samples=64",
        "vars.reference_samples=64",
        "stages.frames.seed=1",
        "stages.phantom_frames.seed=2",
        "stages.reflectance.with.model=diffusion",
        "stages.table.with.model=diffusion",
    ];
    let read = |power: &str| {
        let settings: Vec<&str> = small.iter().copied().chain([power]).flat_map(|set| ["--set", set]).collect();
        space.turbid(&[&["run", QUICKSTART][..], &settings].concat()).ok();
        metrics(&space, QUICKSTART, "metrics", &settings)
    };
    let (five, six) = (read("stages.rig.with.projector.power=5"), read("stages.rig.with.projector.power=6"));
    assert_eq!((five.len(), six.len()), (4, 4));
    for (a, b) in five.iter().zip(&six) {
        assert_eq!((&a.region, &a.quantity), (&b.region, &b.quantity));
        assert!(
            a.n > 0.0 && (a.n - b.n).abs() <= 0.02 * a.n,
            "{} {}: {} and {} pixels",
            a.region,
            a.quantity,
            a.n,
            b.n
        );
        let off = (b.mean / a.mean - 1.0).abs();
        assert!(off < 1e-3, "{} {}: {} mm^-1 at 5 W, {} at 6 W", a.region, a.quantity, a.mean, b.mean);
    }
}

/// Two scenes with a projector of their own each, and what is made of them.
const TWO: &str = "\
pipeline: two
stages:
  tissue:
    use: scene
    with:
      media: {m: {mu_a: 0.03, mu_s_prime: 1, g: 0.8, n: 1.0}}
      objects: {block: {slab: {thickness: 2000, top: 0}, medium: m}}
      camera: {position: [0, 0, 500], look_at: [0, 0, 0], field: [12, 12], pixels: [4, 4]}
      projector: &projector {position: [0, 35, 500], look_at: [0, 0, 0], field: [320, 320], power: 5}
  phantom:
    use: scene
    with:
      media: {m: {mu_a: 0.1, mu_s_prime: 1, g: 0.8, n: 1.0}}
      objects: {block: {slab: {thickness: 2000, top: 0}, medium: m}}
      camera: {position: [0, 0, 500], look_at: [0, 0, 0], field: [12, 12], pixels: [4, 4]}
      projector: *projector
  frames: {use: render, in: {scene: tissue}, with: {f_x: [0, 0.1], phases: 3, samples: 64}}
  phantom_frames: {use: render, in: {scene: phantom}, with: {f_x: [0, 0.1], phases: 3, samples: 64}}
  seen: {use: sensor, in: {frames: frames, covariance: frames.covariance}, with: {bits: 16}}
  modulation: {use: demodulate, in: {frames: seen, covariance: seen.covariance}}
  phantom_modulation: {use: demodulate, in: {frames: phantom_frames, covariance: phantom_frames.covariance}}
  reflectance:
    use: calibrate
    in: {sample: modulation, reference: phantom_modulation}
    with: {reference: {mu_a: 0.1, mu_s_prime: 1, g: 0.8, n: 1.0}, model: diffusion, convention: camera}
";

/// An override that reaches one of two arms is told as a warning with both places of the alias, and as a mistake of the calibration at its input, with both
/// producers and both values, before anything runs; also where scenes and frames are in the store. Whoever means it says so.
#[test]
fn arms_of_two_rigs_are_refused_before_the_run() {
    let space = Space::with(TWO);
    space.turbid(&["check", "p.yaml"]).ok();
    let other = ["p.yaml", "--set", "stages.tissue.with.projector.power=6"];
    let text = space.turbid(&[&["check"][..], &other].concat()).fails(2);
    for words in [
        "p.yaml:24:41: error: stages.reflectance.in.reference: `modulation.modulation` and `phantom_modulation.modulation`",
        "different rigs: projector.power 6 W against 5 W",
        "`in: {rig: STAGE}`",
        "`rigs: may_differ`",
        "--set:1:1: warning: stages.tissue.with.projector.power: stages.phantom.with.projector.power stays as it is",
        "the alias at p.yaml:16:7 of the anchor at p.yaml:9:7",
    ] {
        assert!(text.contains(words), "`{words}` is not in {text}");
    }
    space.turbid(&[&["run"][..], &other, &["modulation", "phantom_modulation"]].concat()).ok();
    assert!(space.turbid(&[&["run"][..], &other].concat()).fails(2).contains("6 W against 5 W"));
    let meant = [&other[..], &["--set", "stages.reflectance.with.rigs=may_differ"]].concat();
    let shown = space.turbid(&[&["run"][..], &meant].concat()).ok();
    assert!(!shown.contains("different rigs"), "{shown}");
    let shown = space.turbid(&[&["check"][..], &meant].concat()).ok();
    assert!(shown.contains("stays as it is"), "{shown}");
}

/// A key that scene and rig both give is a mistake of the scene that names the rig; a rig by itself cannot be rendered; and what the
/// rig says has its place at the input.
#[test]
fn mistakes_of_rigs_have_their_places() {
    let rig = |scene: &str, render: &str| {
        format!(
            "stages:\n  bench:\n    use: scene\n    with:\n      camera: {{position: [0, 0, -5], look_at: [0, 0, -500], field: [12, 12], pixels: [4, 4]}}\n      projector: {{position: [0, 35, 500], look_at: [0, 0, 0], field: [320, 320], power: 5}}\n  tissue:\n    use: scene\n    in: {{rig: bench}}\n    with:\n      media: {{m: {{mu_a: 0.03, mu_s_prime: 1, g: 0.8, n: 1.0}}}}\n      objects: {{block: {{slab: {{thickness: 20, top: 0}}, medium: m}}}}\n{scene}  frames: {{use: render, in: {{scene: {render}}}, with: {{f_x: [0], samples: 4}}}}\n"
        )
    };
    let projector = "      projector: {position: [0, 0, 9], look_at: [0, 0, 0], field: [9, 9], power: 5}\n";
    for (text, place, words) in [
        (rig(projector, "tissue"), "p.yaml:13:", "`projector` stands here, and in the rig `bench"),
        (rig("", "tissue"), "p.yaml:9:15: ", "camera.position of the rig `bench"),
        (rig("", "bench"), "p.yaml:13:", "the scene has no object: it is a rig for other scenes"),
    ] {
        let said = Space::with(&text).turbid(&["check", "p.yaml"]).fails(2);
        let line = said.lines().find(|line| line.contains(words)).unwrap_or_else(|| panic!("{words}: {said}"));
        assert!(line.starts_with(place), "{said}");
    }
}
