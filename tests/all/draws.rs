//! Drawn points: samples keep their results, values are known by name, mistakes have places.

use serde_json::Value;

use crate::space::{Space, counts};

const DRAWN: &str = "\
pipeline: drawn
seed: 7
vars: {n: 6}
stages:
  tissue:
    use: scene
    foreach:
      draw:
        n: \"${n}\"
        mu_a: {loguniform: [0.01, 0.1]}
        shape: {choice: {ball: 1, none: 1}}
        width: {uniform: [4, 8]}
    with:
      media:
        healthy: {mu_a: \"${mu_a}\", mu_s_prime: 1, g: 0.8, n: 1.0}
        lesion: {mu_a: 0.1, mu_s_prime: 1, g: 0.8, n: 1.0}
      objects:
        block: {slab: {thickness: 30, top: 0}, medium: healthy}
        ball: {when: {shape: ball}, spheroid: {diameters: [\"${width}\", \"${width}\", 4], center: [0, 0, -3]}, medium: lesion, priority: 1}
      camera: {position: [0, 0, 500], look_at: [0, 0, 0], field: [12, 12], pixels: [6, 6]}
      projector: {position: [0, 35, 500], look_at: [0, 0, 0], field: [48, 48], power: 5}
  frames: {use: render, in: {scene: tissue}, with: {f_x: [0, 0.1], samples: 16}}
";

/// More points, a condition, a further quantity: what was drawn before is up to date.
#[test]
fn samples_keep_their_results() {
    let space = Space::with(DRAWN);
    assert_eq!(counts(&space, &[]), (0, 12));
    assert_eq!(counts(&space, &[]), (12, 0));
    assert_eq!(counts(&space, &["--set", "vars.n=8"]), (12, 4));
    space.write(
        "p.yaml",
        &DRAWN.replace("n: 6", "n: 8").replace(
            "width: {uniform: [4, 8]}\n",
            "width: {uniform: [4, 8]}\n        depth: {uniform: [1, \"width\"]}\n        only: [[mu_a, above, 0.03]]\n",
        ),
    );
    let (hits, ran) = counts(&space, &[]);
    assert!((4..16).contains(&hits) && ran == 0, "{hits} up to date, {ran} ran");
    // Without a seed of their own the renders of another pipeline seed are others, and so are the points.
    space.write("p.yaml", &DRAWN.replace("seed: 7", "seed: 8"));
    assert_eq!(counts(&space, &[]).1, 12);
}

/// An instance is named by its index; its values are shown, listed and reach the stages.
#[test]
fn drawn_values_are_known_by_name() {
    let space = Space::with(DRAWN);
    space.turbid(&["run", "p.yaml", "tissue"]).ok();
    let mut shapes = Vec::new();
    for index in 0..6 {
        let selector = format!("tissue[draw={index}].scene");
        let shown = space.turbid(&["show", "p.yaml", &selector, "--json"]).json();
        let instance = &shown["instances"][0];
        let values = &instance["axes"];
        assert_eq!(values["draw"], index);
        let mu_a = values["mu_a"].as_f64().expect("a number");
        assert!((0.01..0.1).contains(&mu_a), "{mu_a}");
        let text = instance.to_string();
        let shape = values["shape"].as_str().expect("a text").to_owned();
        assert_eq!(text.contains("spheroid"), shape == "ball", "{text}");
        assert!(text.contains(&format!("{mu_a}")[..6]), "{mu_a} is in {text}");
        shapes.push(shape);
    }
    assert!(shapes.contains(&"ball".to_owned()) && shapes.contains(&"none".to_owned()), "{shapes:?}");

    let text = space.turbid(&["plan", "p.yaml", "--set", "stages.tissue.foreach.draw.only=[[shape, is, ball]]"]).ok();
    let line = text.lines().find(|line| line.starts_with("draw tissue")).expect("a line for the draw");
    let balls = shapes.iter().filter(|shape| *shape == "ball").count();
    assert_eq!(line, format!("draw tissue: {balls} of 6 points (sobol); {} left out by [shape, is, ball]", 6 - balls));
    assert!(text.contains("frames[draw="), "{text}");
}

/// Two renders of one scene join by its points; a stage may take one of them alone.
#[test]
fn chains_of_one_draw_join() {
    let more = "  dark: {use: render, in: {scene: tissue}, with: {f_x: [0, 0.2], samples: 16}}\n\
                \x20 one: {use: demodulate, in: {frames: {from: frames, where: {draw: 3}}}}\n";
    let space = Space::with(&format!("{DRAWN}{more}"));
    let plan = space.turbid(&["plan", "p.yaml", "--json"]).json();
    let of = |stage: &str| {
        let instances = plan["instances"].as_array().expect("a list").iter();
        instances.filter(|instance| instance["stage"] == stage).cloned().collect::<Vec<Value>>()
    };
    assert_eq!((of("dark").len(), of("one").len()), (6, 1));
    assert_eq!(plan["draws"][0]["points"], 6);
    assert!(of("dark")[5]["axes"]["mu_a"].is_f64() && of("one")[0]["axes"].get("mu_a").is_none());
}

/// What is replaced, with what, and what `check` says of it (line:column, path, message), and its hint.
const WRONG: [(&str, &str, &str, &str); 13] = [
    ("n: \"${n}\"", "n: 0", "9:12: error: stages.tissue.foreach.draw.n: n must lie in 1..1000000", ""),
    (
        "{uniform: [4, 8]}",
        "{uniform: [8, 4]}",
        "12:26: error: stages.tissue.foreach.draw.width.uniform: uniform takes [first, last] with first < last",
        "",
    ),
    (
        "{uniform: [4, 8]}",
        "{uniform: [4, depth]}",
        "12:16: error: stages.tissue.foreach.draw.width: `depth` is not drawn here",
        "drawn are mu_a, shape, width",
    ),
    (
        "{uniform: [4, 8]}",
        "{unifrom: [4, 8]}",
        "12:17: error: stages.tissue.foreach.draw.width.unifrom: a draw has no key `unifrom`",
        "did you mean `uniform`?",
    ),
    (
        "{uniform: [4, 8]}",
        "{sum: [width, 1]}",
        "12:16: error: stages.tissue.foreach.draw.width: these are made of each other in a circle: width",
        "",
    ),
    (
        "{uniform: [4, 8]}",
        "{uniform: [4, 8], per: patient}",
        "12:39: error: stages.tissue.foreach.draw.width.per: `patient` is no group of this draw",
        "add `patient: {group: 100}`",
    ),
    (
        "        width: {",
        "        only: [[mu_a, above, 1]]\n        width: {",
        "of 6 points 0 meet the conditions: 6 by [mu_a, above, 1]",
        "draw from narrower distributions",
    ),
    (
        "        width: {",
        "        only: [[mua, above, 1]]\n        width: {",
        "12:17: error: stages.tissue.foreach.draw.only.0.0: `mua` is not drawn here",
        "drawn are mu_a, shape, width",
    ),
    (
        "        width: {",
        "        method: lhc\n        width: {",
        "12:17: error: stages.tissue.foreach.draw.method: method is \"lhc\", but must be one of sobol, lhs, random",
        "",
    ),
    (
        "when: {shape: ball}",
        "when: {form: ball}",
        "stages.tissue.with.objects.ball.when.form: `${form}` is not a var or an axis",
        "",
    ),
    ("when: {shape: ball}", "when: {shape: {near: ball}}", "`near` must be one of above, below, is, in", ""),
    ("when: {shape: ball}", "when: ball", "`when` is the text \"ball\", but must be a map of conditions", ""),
    (
        "frames: {use: render",
        "frames: {foreach: {mu_a: [1, 2]}, use: render",
        "`mu_a` is both drawn and an axis",
        "give one of them another name",
    ),
];

#[test]
fn wrong_draws_are_named_at_their_place() {
    let space = Space::with(DRAWN);
    space.turbid(&["check", "p.yaml"]).ok();
    for (part, other, message, hint) in WRONG {
        assert!(DRAWN.contains(part), "{part}");
        space.write("p.yaml", &DRAWN.replacen(part, other, 1));
        let said = space.turbid(&["check", "p.yaml"]).fails(2);
        assert!(said.contains(message) && said.contains(hint), "{other}: {said}");
    }
}

/// Indices of two draws have nothing to do with each other.
#[test]
fn two_draws_do_not_join() {
    let other = DRAWN.split_once("  tissue:").expect("the scene").1.split_once("  frames:").expect("the render").0;
    let joined = "  others: {use: render, in: {scene: other}, with: {f_x: [0, 0.1], samples: 16}}\n\
                  \x20 both: {use: demodulate, in: {frames: frames, covariance: others.covariance}}\n";
    let space = Space::with(&format!("{DRAWN}  other:{other}{joined}"));
    let said = space.turbid(&["check", "p.yaml"]).fails(2);
    let message = "`others` is drawn by `other`, and not by `tissue` (by `frames`)";
    assert!(
        said.contains("stages.both.in.covariance") && said.contains(message) && said.contains("one `draw` per chain"),
        "{said}"
    );
}

/// A Latin hypercube of another n has other points: `check` says so.
#[test]
fn hypercubes_are_warned_of() {
    let space = Space::with(
        &DRAWN
            .replace("n: \"${n}\"", "n: 6, method: lhs")
            .replace("\n        n: 6, method: lhs", "\n        n: 6\n        method: lhs"),
    );
    let said = space.turbid(&["check", "p.yaml"]);
    let all = format!("{}{}", said.out, said.err);
    assert_eq!(said.code, Some(0), "{all}");
    assert!(all.contains("warning") && all.contains("another n moves every point of a Latin hypercube"), "{all}");
}
