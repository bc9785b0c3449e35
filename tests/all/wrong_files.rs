//! A table of wrong pipeline files and the one message that each gets; nothing else is said, nothing is written.

use crate::space::Space;

/// Without a mistake; each row of [`WRONG`] replaces one thing in it.
const RIGHT: &str = "\
pipeline: base
seed: 7
vars: {samples: 64}
stages:
  tissue:
    use: scene
    with:
      media: {m: {mu_a: 0.05, mu_s_prime: 1, g: 0.8, n: 1.0}}
      objects: {block: {slab: {thickness: 30, top: 0}, medium: m}}
      camera: {position: [0, 0, 500], look_at: [0, 0, 0], field: [12, 12], pixels: [12, 12]}
      projector: {position: [0, 35, 500], look_at: [0, 0, 0], field: [48, 48], power: 5}
  frames:
    use: render
    in: {scene: tissue}
    with: {f_x: [0, 0.1], phases: 3, samples: \"${samples}\"}
  modulation:
    use: demodulate
    in: {frames: frames}
    with: {method: phase_shift}
";

/// What is replaced, by what, the message (`line:column: path: rule`), the way out.
#[rustfmt::skip]
const WRONG: &[(&str, &str, &str, &str)] = &[
    ("pipeline: base", "pipeline: a/b", "1:11: pipeline: the name of a pipeline must be made of letters, digits, `_` and `-`, at most 80 of them", ""),
    ("seed: 7", "seed: abc", "2:7: seed: `seed` is the text \"abc\", but must be a whole number from 0 to 18446744073709551615", ""),
    ("seed: 7", "seed: -1", "2:7: seed: `seed` is -1, but must be a whole number from 0 to 18446744073709551615", ""),
    ("seed: 7", "seed: 18446744073709551616", "2:7: seed: `seed` is 1.8446744073709552e+19, but must be a whole number from 0 to 18446744073709551615", ""),
    ("seed: 7", "seed: 1_000", "2:7: seed: `seed` is the text \"1_000\", but must be a whole number from 0 to 18446744073709551615", "YAML reads `1_000` as text; write `1000`"),
    ("seed: 7", "seed: 7\nsedd: 8", "3:1: sedd: a pipeline has no key `sedd`", "did you mean `seed`?"),
    ("seed: 7", "seed: 7\nseed: 8", "3:1: seed: the key `seed` stands twice in this map", "it is first in line 2"),
    ("seed: 7", "	seed: 7", "2:1: this is not YAML: while scanning a plain scalar, found a tab", "indent with spaces: YAML allows no tabs there"),
    ("seed: 7", "seed: 7\ninclude: nowhere.yaml", "3:10: include: `nowhere.yaml`: the file does not exist", ""),
    ("vars: {samples: 64}", "vars: {samples: \"${count}\", count: \"${samples}\"}", "3:8: vars.samples: vars refer to each other in a circle: samples -> count -> samples", ""),
    ("vars: {samples: 64}", "vars: {smaples: 4}", "15:47: stages.frames.with.samples: `${samples}` is not a var", "did you mean `smaples`?"),
    ("vars: {samples: 64}", "vars: {samples: .nan}", "3:17: vars.samples: `.nan` is not a finite number", ""),
    ("vars: {samples: 64}", "vars: {samples: [1, 2}", "3:17: this is not YAML: mismatched bracket '[' closed by '}'", "check brackets, quotes and indentation here and in the lines above"),
    ("samples: 64", "samples: 64, x: &x [*x]", "3:28: vars.x.0: this alias stands inside the value that it names", ""),
    ("use: scene", "use: scence", "6:10: stages.tissue.use: there is no stage kind `scence`", "did you mean `scene`?"),
    ("use: scene", "ues: scene", "6:5: stages.tissue.ues: a stage has no key `ues`", "did you mean `use`?"),
    ("  tissue:\n    use: scene\n", "  tissue:\n    use: scene\n    foreach: {a: {linspace: [0, 1, 2000000]}}\n", "7:29: stages.tissue.foreach.a.linspace: 2000000 values are more than 1000000 instances", ""),
    ("    use: scene\n", "    use: scene\n    foreach: {a: [1, 2], b: [1, 2], zip: [a, b, c]}\n", "7:42: stages.tissue.foreach.zip: `zip` is a list of names, but must be a list of lists of axes that go together", "write `zip: [[a, b, c]]`"),
    ("    use: scene\n", "    use: scene\n    foreach: {a: {range: [0, 1001]}, b: {range: [0, 1000]}}\n", "7:5: stages.tissue.foreach: 1001000 instances (1001 a x 1000 b) are more than 1000000", "pair axes by `zip`, or give them fewer values"),
    ("    use: scene\n", "    use: scene\n    foreach: {a: [1, 2], b: [1, 2, 3], zip: [[a, b]]}\n", "7:46: stages.tissue.foreach.zip.0: `a` has 2 values and `b` has 3; paired axes need equally many", ""),
    ("    use: scene\n", "    use: scene\n    foreach: {a: [1, 2, 1], b: [3, 4, 3], zip: [[a, b]]}\n", "7:49: stages.tissue.foreach.zip.0: a = 1, b = 3 stands twice among the pairs", ""),
    ("    use: scene\n", "    use: scene\n    foreach: {a: [1, 2, 1]}\n", "7:18: stages.tissue.foreach.a: the value 1 stands twice on this axis", ""),
    ("    use: scene\n", "    use: scene\n    foreach: {csv: table.csv}\n", "7:20: stages.tissue.foreach.csv: `table.csv`: the file does not exist", ""),
    ("    use: scene\n", "    use: scene\n    foreach: {draw: {n: 10, mu_a: {loguniform: [0, 1]}}}\n", "7:48: stages.tissue.foreach.draw.mu_a.loguniform: loguniform takes [first, last] with first < last, both above 0", ""),
    ("mu_a: 0.05", "mu_a: -0.05", "8:25: stages.tissue.with.media.m.mu_a: mu_a = -0.05 mm^-1 must be >= 0", ""),
    ("mu_a: 0.05", "mu_a: \"0.05 mm\"", "8:25: stages.tissue.with.media.m.mu_a: `0.05 mm` has the dimension length; inverse length in mm^-1 is wanted", ""),
    ("mu_a: 0.05", "mu_a: 1e999", "8:25: stages.tissue.with.media.m.mu_a: `1e999` is not a finite number", ""),
    ("mu_a: 0.05, ", "", "8:18: stages.tissue.with.media.m: m must have exactly one pair of absorption and scattering", "write `mu_a` with `mu_s`, or `mu_a` with `mu_s_prime` (mm^-1), or `A_rho` with `S_rho` (m^-1); `HbO2`, `Hb`, `water`, `lipid`, `melanin` may stand in the place of `mu_a`, `scattering: {a, b}` in that of `mu_s`"),
    ("mu_a: 0.05", "mu_a: \"${mu}\"", "8:25: stages.tissue.with.media.m.mu_a: `${mu}` is not a var", "known: `samples`"),
    ("g: 0.8", "g: 1", "8:49: stages.tissue.with.media.m.g: g = 1 must lie in (-1, 1)", ""),
    ("g: 0.8, ", "", "8:15: stages.tissue.with.media.m.g: `g` is missing", "write either `g: 0.8`, Henyey and Greenstein's function, or `phase: {two_term: {g_forward: 0.9, g_backward: -0.3, forward: 0.95}}`"),
    ("g: 0.8", "phase: {two_term: {g_forward: 0.9, g_backward: -0.3, forward: 1}}", "8:108: stages.tissue.with.media.m.phase.two_term.forward: forward = 1 must lie in (0, 1), the share of the forward term", "one term alone is written as `g`; if per cent are meant, write `95 %`"),
    ("n: 1.0", "n: 0.9", "8:57: stages.tissue.with.media.m.n: n = 0.9 must lie in [1, 10]", ""),
    ("medium: m", "medium: n", "9:64: stages.tissue.with.objects.block.medium: there is no medium `n`", "known: `m`"),
    ("slab: {thickness: 30, top: 0}", "slab: {thickness: 30, top: 0}, box: {size: [1, 1, 1], center: [0, 0, 0]}", "9:24: stages.tissue.with.objects.block: block has more than one shape", "give exactly one of slab, box, sphere, spheroid, cylinder, tube, sphere_shell, mesh, relief, path, scatter"),
    ("slab: {", "slap: {", "9:25: stages.tissue.with.objects.block.slap: there is no key `slap` here", "did you mean `slab`?"),
    ("thickness: 30", "thickness: 30 deg", "9:43: stages.tissue.with.objects.block.slab.thickness: `30 deg` has the dimension angle; length in mm is wanted", ""),
    ("thickness: 30", "thickness: 0", "9:43: stages.tissue.with.objects.block.slab.thickness: thickness = 0 mm must be > 0", ""),
    ("position: [0, 0, 500]", "position: [0, 0]", "10:26: stages.tissue.with.camera.position: `position` has 2 values, but must have 3", ""),
    ("position: [0, 0, 500]", "position: [0, 0, -10]", "10:26: stages.tissue.with.camera.position: the camera at [0.0, 0.0, -10.0] mm is inside the solid block", "move it out, or carve a hole with an object of higher priority whose medium has mu_a = mu_s = 0"),
    ("pixels: [12, 12]", "pixels: [0, 12]", "10:85: stages.tissue.with.camera.pixels.0: pixels = 0 must be >= 1: the image would have no pixel", ""),
    ("pixels: [12, 12]", "pixels: [1.5, 12]", "10:85: stages.tissue.with.camera.pixels.0: `pixels` is 1.5, but must be a whole number, 0 or more", ""),
    ("pixels: [12, 12]", "pixels: 12", "10:84: stages.tissue.with.camera.pixels: `pixels` is 12, but must be a list of 2 values", "write `[12, 12]`"),
    ("field: [12, 12]", "field: 12", "10:66: stages.tissue.with.camera.field: `field` is 12, but must be a list of 2 values", "write `[12, 12]`"),
    ("      projector: {position: [0, 35, 500], look_at: [0, 0, 0], field: [48, 48], power: 5}\n", "", "13:17: stages.frames.in.scene: the scene has no projector, so all would be dark", "add `projector` to the scene, or to its rig"),
    ("power: 5", "power: five", "11:87: stages.tissue.with.projector.power: `power` is the text \"five\", but must be a number in W, or text with a unit such as `2 W`", ""),
    ("n: 1.0", "n: abc", "8:57: stages.tissue.with.media.m.n: `n` is the text \"abc\", but must be a number without a unit", ""),
    ("n: 1.0", "n: 1.4 mm", "8:57: stages.tissue.with.media.m.n: `1.4 mm` has the dimension length; a number without one is wanted", ""),
    ("g: 0.8", "g: 80", "8:49: stages.tissue.with.media.m.g: g = 80 must lie in (-1, 1)", "if per cent are meant, write `80 %`"),
    ("    in: {scene: tissue}\n", "", "12:3: stages.frames.in: render needs the input `scene` (scene)", "add `in: {scene: STAGE}`"),
    ("in: {scene: tissue}", "in: {scene: tisue}", "14:17: stages.frames.in.scene: there is no stage `tisue`", "did you mean `tissue`?"),
    ("in: {scene: tissue}", "in: {scen: tissue}", "14:16: stages.frames.in.scen: render has no input `scen`; it has scene, pattern", "did you mean `scene`?"),
    ("in: {scene: tissue}", "in: {scene: tissue.scenes}", "14:17: stages.frames.in.scene: stage `tissue` (scene) has no output `scenes`; it has scene, preview", "did you mean `tissue.scene`?"),
    ("in: {scene: tissue}", "in: {scene: modulation}", "14:17: stages.frames.in.scene: the stages feed each other in a circle: frames -> modulation -> frames", "stage `frames`: input `scene` wants scene, but modulation.modulation is modulation"),
    ("seed: 7", "seed: 7\ninclude: nowhere.yaml", "3:10: include: `nowhere.yaml`: the file does not exist", ""),
    ("use: scene\n    with:\n      media: {m: {mu_a: 0.05", "use: scene\n    foreach: {csv: nowhere.csv}\n    with:\n      media: {m: {mu_a: \"${absorption}\"", "7:20: stages.tissue.foreach.csv: `nowhere.csv`: the file does not exist", ""),
    ("use: scene\n    with:\n      media: {m: {mu_a: 0.05", "use: scene\n    foreach: {draw: {n: 0, method: sobol, absorption: {uniform: [0, 1]}}}\n    with:\n      media: {m: {mu_a: \"${absorption}\"", "7:25: stages.tissue.foreach.draw.n: n must lie in 1..1000000", ""),
    ("in: {scene: tissue}", "in: {scene: {form: tissue}}", "14:18: stages.frames.in.scene.form: an input has no key `form`", "did you mean `from`?"),
    ("in: {frames: frames}", "in: {frames: tissue}", "18:18: stages.modulation.in.frames: stage `modulation`: input `frames` wants frames, but tissue.scene is scene", ""),
    ("f_x: [0, 0.1]", "f_x: [0, 50]", "15:21: stages.frames.with.f_x.1: f_x = 50 mm^-1 is beyond what the camera's pixels of 1 x 1 mm resolve (0.5000 mm^-1)", "if another unit is meant, write it: `50 m^-1`"),
    ("f_x: [0, 0.1]", "f_x: [0, 0.6]", "15:21: stages.frames.with.f_x.1: f_x = 0.6 mm^-1 is beyond what the camera's pixels of 1 x 1 mm resolve (0.5000 mm^-1)", "give the camera more pixels or a smaller field, or lower f_x"),
    ("f_x: [0, 0.1]", "f_x: []", "15:17: stages.frames.with.f_x: f_x is empty: nothing would be projected", "list at least one, such as [0, 0.1]"),
    ("f_x: [0, 0.1]", "f_x: 0.1", "15:17: stages.frames.with.f_x: `f_x` is 0.1, but must be a list", "write `[0.1]`"),
    ("phases: 3", "phases: 3, orientation_deg: 90", "15:55: stages.frames.with.orientation_deg: `orientation_deg` is 90, but must be a list", "write `[90]`"),
    ("vars: {samples: 64}", "vars: {samples: 1e12}", "3:17: stages.frames.with.samples: `samples` is 1000000000000, but must be a whole number from 0 to 4294967295", ""),
    ("mu_a: 0.05", "mu_a: \"0,05\"", "8:25: stages.tissue.with.media.m.mu_a: `mu_a` is the text \"0,05\", but must be a number in mm^-1, or text with a unit such as `2 mm^-1`", "YAML reads `0,05` as text; write `0.05`"),
    ("mu_a: 0.05", "mu_a: 0,05", "8:25: stages.tissue.with.media.m.mu_a: `0,05` is no number: the comma ends the first", "write `0.05`, or a blank behind the comma of a list"),
    ("vars: {samples: 64}", "vars: {samples: 0,64}", "3:17: vars.samples: `0,64` is no number: the comma ends the first", "write `0.64`, or a blank behind the comma of a list"),
    ("vars: {samples: 64}", "vars: {samples: \"64\"}", "3:17: stages.frames.with.samples: `samples` is the text \"64\", but must be a whole number, 0 or more", "write `64` without quotes"),
    ("    use: scene\n", "    use: scene\n    foreach: {zip: {a: [1, 2], b: [3, 4]}}\n", "7:20: stages.tissue.foreach.zip: `zip` is a map, but must be a list of lists of axes, such as [[a, b]]", "write the axes beside it: `a: [..], b: [..], zip: [[a, b]]`"),
    ("samples: \"${samples}\"", "samples: ${samples}", "15:48: this is not YAML: while parsing a flow mapping, did not find expected ',' or '}'", "inside { } and [ ] a var needs quotes: \"${samples}\""),
    ("phases: 3", "phases: 2", "15:35: stages.frames.with.phases: phases = 2 must be >= 3: fewer do not fix mean, amplitude and phase", ""),
    ("phases: 3", "phases: 1e", "15:35: stages.frames.with.phases: `phases` is the text \"1e\", but must be a whole number, 0 or more", "YAML reads `1e` as text; write `1`"),
    ("phases: 3", "phases: yes", "15:35: stages.frames.with.phases: `phases` is the text \"yes\", but must be a whole number, 0 or more", ""),
    ("method: phase_shift", "method: phase_shfit", "19:20: stages.modulation.with.method: there is no choice `phase_shfit` here", "did you mean `phase_shift`?"),
    ("method: phase_shift", "methods: phase_shift", "19:12: stages.modulation.with.methods: there is no key `methods` here", "did you mean `method`?"),
    ("    with: {method: phase_shift}", "    with: {method: phase_shift}\nstudies: {s: {vary: {stages.frmes.with.samples: [1, 2]}, estimate: modulation, error: rmse_percent}}", "20:22: studies.s.vary.stages.frmes.with.samples: there is no stage `frmes`", "did you mean `frames`?"),
    ("    in: {frames: frames}", "    in: {frames: {from: frames, where: {mu_a: 1}}}", "18:18: stages.modulation.in.frames: `frames` has no axis `mu_a`", ""),
    ("seed: 7", "seed: 7\n---\nmore: 1", "3:1: a second YAML document begins here", "a pipeline file is one document: take out the line `---`, or make two files"),
    ("vars: {samples: 64}", "vars: {samples: !vec [1]}", "3:22: vars.samples: the tag `!vec` means nothing in a pipeline file", "quote a text that begins with `!`"),
    ("vars: {samples: 64}", "vars: {samples: 64}\nwithout a colon", "4:1: this is not YAML: simple key expected ':'", "check brackets, quotes and indentation here and in the lines above"),
    ("phases: 3, samples: \"${samples}\"", "phases: 3, samples: \"${samples\"", "15:47: stages.frames.with.samples: `${` is not closed by `}` (write `$${` for a literal `${`)", ""),
    ("  modulation:", "  modulation: scene\n  other:", "16:15: stages.modulation: `modulation` is the text \"scene\", but must be a map with `use`, and with `in` and `with` where needed", ""),
    ("in: {scene: tissue}", "in: [tissue]", "14:9: stages.frames.in: `in` is a list, but must be a map of ports and stages, such as {scene: tissue}", ""),
    ("in: {scene: tissue}", "in: {scene: [tissue, tissue]}", "14:17: stages.frames.in.scene: input `scene` takes one source, not 2", ""),
    ("in: {scene: tissue}", "in: {scene: tissue}\n    product: maybe", "15:14: stages.frames.product: `product` is the text \"maybe\", but must be true or false", ""),
    ("in: {scene: tissue}", "in: {scene: tissue}\n    seed: 1.5", "15:11: stages.frames.seed: `seed` is 1.5, but must be a whole number from 0 to 18446744073709551615, or {common: NUMBER}", ""),
    ("in: {scene: tissue}", "in: {scene: tissue}\n    seed: {comon: 7}", "15:12: stages.frames.seed.comon: a seed has no key `comon`", "did you mean `common`?"),
    ("in: {scene: tissue}", "in: {scene: tissue}\n    seed: {common: -7}", "15:20: stages.frames.seed.common: `common` is -7, but must be a whole number from 0 to 18446744073709551615", ""),
    ("in: {scene: tissue}", "in: {scene: tissue}\n    seed: {}", "15:11: stages.frames.seed: `seed` is a map, but must be a whole number or {common: NUMBER}", ""),
    ("in: {scene: tissue}", "in: {scene: tissue}\n    seed: {common: }", "15:12: stages.frames.seed.common: `common` is empty, but must be a whole number from 0 to 18446744073709551615", ""),
    ("use: demodulate\n    in: {frames: frames}", "use: demodulate\n    in: {frames: frames}\n    foreach: {k: [1, {a: 2}]}", "19:22: stages.modulation.foreach.k.1: `k` is a map, but must be a number, a text, true or false (to sweep lists, pair axes of their numbers by `zip`)", ""),
    ("    in: {frames: frames}", "    in: {frames: f1, covariance: f2.covariance}\n  f1: {use: render, in: {scene: tissue}, foreach: {a: [64, 65]}, with: {f_x: [0.1], phases: 3, samples: \"${a}\"}}\n  f2: {use: render, in: {scene: tissue}, foreach: {b: [64, 65]}, with: {f_x: [0.1], phases: 3, samples: \"${b}\"}}\n  m2:\n    use: demodulate\n    in: {frames: f1}", "18:9: stages.modulation.in: input `frames` (f1.frames) has the axes a, input `covariance` (f2.covariance) has the axes b: neither contains the other", "say `product: true` to take every combination"),
    ("    in: {frames: frames}", "    in: {frames: f1}\n    foreach: {a: [1]}\n  f1: {use: render, in: {scene: tissue}, foreach: {a: [64, 65]}, with: {f_x: [0.1], phases: 3, samples: \"${a}\"}}\n  m2:\n    use: demodulate\n    in: {frames: f1}", "19:18: stages.modulation.foreach.a: an input of `modulation` carries the axis `a` already", "give the new axis another name"),
    ("mu_a: 0.05", "mu_a: \"${depth}\"", "8:25: stages.tissue.with.media.m.mu_a: `${depth}` is not a var", "known: `samples`"),
    ("pixels: [12, 12]", "pixels: [1e9, 1e9]", "10:84: stages.tissue.with.camera.pixels: 1000000000000000000 pixels are more than 268435456", ""),
    ("vars: {samples: 64}", "vars: {samples: 64, 'a b': 1}", "3:21: vars.a b: the name of a var must be made of letters, digits, `_` and `-`, at most 80 of them", ""),
    ("with: {method: phase_shift}", "with: phase_shift", "19:11: stages.modulation.with: `with` is the text \"phase_shift\", but must be a map of parameters", ""),
];

/// The messages in what `turbid check` printed, each with the way out below it.
pub fn messages(shown: &str) -> Vec<(String, String)> {
    let mut found: Vec<(String, String)> = Vec::new();
    for line in shown.lines() {
        if let Some((place, message)) = line.strip_prefix("p.yaml:").and_then(|l| l.split_once(" error: ")) {
            found.push((format!("{place} {message}"), String::new()));
        } else if let (Some(hint), Some(last)) = (line.trim_start().strip_prefix("= help: "), found.last_mut()) {
            last.1 = hint.to_owned();
        }
    }
    found
}

#[test]
fn each_wrong_file_gets_its_one_message() {
    let space = Space::with(RIGHT);
    space.turbid(&["check", "p.yaml"]).ok();
    assert!(WRONG.len() >= 35);
    let mut failures = String::new();
    for (from, to, message, way_out) in WRONG {
        assert!(RIGHT.contains(from), "{from}");
        space.write("p.yaml", &RIGHT.replacen(from, to, 1));
        let shown = space.turbid(&["check", "p.yaml"]).fails(2);
        if messages(&shown) != [((*message).to_owned(), (*way_out).to_owned())] {
            failures += &format!("{from}  ->  {to}\nexpected: {message}\n        = {way_out}\n{shown}\n");
        }
    }
    assert_eq!(failures, "");
    assert!(!space.outputs().exists(), "check writes nothing");
}

/// All rows that can be in one file together: one report, every mistake in it, in the order of the file.
#[test]
fn all_mistakes_of_a_file_come_in_one_report() {
    let edits = [
        ("seed: 7", "seed: abc"),
        ("use: scene", "use: scene\n    wiht: {}"),
        ("mu_a: 0.05", "mu_a: -1"),
        ("g: 0.8", "g: 2"),
        ("thickness: 30", "thickness: 30 deg"),
        ("phases: 3", "phasse: 3"),
        ("in: {frames: frames}", "in: {frames: frame}"),
        ("method: phase_shift", "method: phase_shfit"),
    ];
    let text = edits.iter().fold(RIGHT.to_owned(), |text, (from, to)| text.replacen(from, to, 1));
    let shown = Space::with(&text).turbid(&["check", "p.yaml"]).fails(2);
    let paths: Vec<String> =
        messages(&shown).into_iter().map(|(m, _)| m.split(": ").nth(1).unwrap_or_default().to_owned()).collect();
    for path in [
        "seed",
        "stages.tissue.wiht",
        "stages.tissue.with.objects.block.slab.thickness",
        "stages.frames.with.phasse",
        "stages.modulation.in.frames",
        "stages.modulation.with.method",
    ] {
        assert!(paths.iter().any(|p| p == path), "{path} is missing in\n{shown}");
    }
}

/// A wrong var is marked where it stands, and shown where it is used; whoever reads JSON is told the kind.
#[test]
fn a_wrong_var_is_shown_with_the_place_that_uses_it() {
    let space = Space::with(&RIGHT.replacen("vars: {samples: 64}", "vars: {samples: 1e12}", 1));
    let shown = space.turbid(&["check", "p.yaml"]).fails(2);
    let expected = "   |
 3 | vars: {samples: 1e12}
   |                 ^^^^
   |
  ::: p.yaml:15:47
   |
15 |     with: {f_x: [0, 0.1], phases: 3, samples: \"${samples}\"}
   |                                               ------------ used here
";
    assert!(
        shown.starts_with("p.yaml:3:17: error: stages.frames.with.samples: ") && shown.ends_with(expected),
        "{shown}"
    );
    for (from, to, kind) in [
        ("samples: 64", "samples: abc", "wrong_type"),
        ("phases: 3", "phasse: 3", "unknown_key"),
        ("thickness: 30", "thickness: 30 deg", "wrong_unit"),
        (", n: 1.0", "", "missing"),
        ("mu_a: 0.05", "mu_a: -1", "wrong_value"),
        ("in: {scene: tissue}", "in: {scene: tisue}", "graph"),
        ("seed: 7", "seed: 7\ninclude: nowhere.yaml", "file"),
        ("pipeline: base", "pipeline: [base", "syntax"),
    ] {
        space.write("p.yaml", &RIGHT.replacen(from, to, 1));
        let run = space.turbid(&["check", "p.yaml", "--json"]);
        let found: serde_json::Value = serde_json::from_str(&run.out).expect("it is JSON");
        assert_eq!((run.code, &found[0]["kind"]), (Some(2), &serde_json::json!(kind)), "{found}");
    }
}

#[test]
fn what_is_no_pipeline_file_is_refused_in_one_sentence() {
    let space = Space::new();
    let bytes = |name: &str, bytes: &[u8]| std::fs::write(space.path().join(name), bytes).expect("the folder is ours");
    bytes("utf16.yaml", b"\xff\xfep\x00i\x00");
    bytes("latin1.yaml", b"pipeline: x\nabout: \xe4\n");
    bytes("nul.yaml", b"pipeline: x\0");
    bytes("empty.yaml", b"");
    bytes("list.yaml", b"- 1\n- 2\n");
    bytes("large.yaml", &vec![b'#'; 9 << 20]);
    bytes("deep.yaml", "[".repeat(100_000).as_bytes());
    bytes("bomb.yaml", &bomb());
    std::fs::create_dir(space.path().join("folder.yaml")).expect("the folder is ours");
    for (name, says) in [
        ("nowhere.yaml", "the file does not exist"),
        ("folder.yaml", "this is a directory, not a pipeline file"),
        ("utf16.yaml", "the file is UTF-16; save it as UTF-8"),
        ("latin1.yaml", "the file is not UTF-8 text (byte 19, line 2); save it as UTF-8"),
        ("nul.yaml", "NUL bytes"),
        ("empty.yaml", "the file is empty"),
        ("list.yaml", "a pipeline file is a map"),
        ("large.yaml", "larger than 8 MiB"),
        ("deep.yaml", "nested more than 64 deep"),
        ("bomb.yaml", "more than 500000 values"),
    ] {
        for command in ["check", "run", "plan"] {
            let shown = space.turbid(&[command, name]).fails(2);
            assert!(shown.contains(says) && shown.matches("error").count() == 1, "{command} {name}: {shown}");
        }
    }
}

/// Ten aliases to ten aliases ...: 10^11 values in 1 kB.
fn bomb() -> Vec<u8> {
    let level = |i: usize| format!("a{i}: &a{i} [{}]\n", vec![format!("*a{}", i - 1); 10].join(", "));
    let text: String = std::iter::once("a0: &a0 [x]\n".to_owned()).chain((1..12).map(level)).collect();
    text.into_bytes()
}

#[test]
fn wrong_overrides_are_shown_as_they_were_typed() {
    let space = Space::with(RIGHT);
    for (given, says, way_out) in [
        ("samples", "--set samples: there is no `=`", "write --set PATH=VALUE"),
        ("vars.sample=3", "--set:1:1: error: vars.sample: there is no var `sample`", "did you mean `samples`?"),
        ("stages.frame.with.phases=3", "there is no stage `frame`", "did you mean `frames`?"),
        ("stages.frames.wiht.phases=3", "a stage has no key `wiht`", "did you mean `with`?"),
        ("stages.frames=3", "a stage is set part by part", ""),
        ("stages.frames.with.phases=", "no value follows `=`", "write `null`"),
        ("stages.frames.with.phases=[3", "--set:1:27: error: this is not YAML", ""),
        ("stages.frames.with.f_x.7=0.2", "`7` is no place in a list of 2", ""),
        ("stages.frames.with.phases.x=1", "`x` cannot be set inside 3", ""),
        ("stages.frames.with.phases=many", "--set:1:27: error: stages.frames.with.phases: `phases` is the text", ""),
        ("stages.frames.with.phasse=4", "there is no key `phasse` here", "did you mean `phases`?"),
        ("samples=4", "a pipeline has no section `samples`", "did you mean `vars.samples`?"),
        ("frames.with.phases=4", "a pipeline has no section `frames`", "did you mean `stages.frames.with.phases`?"),
        ("sedd=4", "a pipeline has no section `sedd`", "did you mean `seed`?"),
    ] {
        let shown = space.turbid(&["check", "p.yaml", "--set", given]).fails(2);
        assert!(shown.contains(says) && shown.contains(way_out) && shown.contains(given), "{given}:\n{shown}");
        assert_eq!(shown.matches("error:").count(), 1, "{given}:\n{shown}");
    }
}
