//! What is rendered of random bodies, a tube along a spline and a random skin: `pipelines/checks/random_scenes.yaml`.

use std::f64::consts::PI;

use serde_json::Value;

use crate::space::Space;

/// mm^-1, once down and once up through half a chord each.
const MU_A: f64 = 0.1;
const K: f64 = 4.0 * MU_A;
/// mm^2.
const AREA: f64 = 1600.0;

/// Mean radiance of the frame of a stage over that of the bare floor, with its standard error.
fn share(space: &Space, file: &str, stage: &str) -> (f64, f64) {
    let shown = space.turbid(&["show", file, &format!("{stage}.frames"), "--json"]).json();
    let ports = shown["instances"][0]["ports"].as_object().expect("ports").clone();
    let layers = ports.values().next().expect("one port")["layers"].as_array().expect("layers").clone();
    let layer = layers.into_iter().find(|l| l["name"] == "radiance").expect("a frame");
    let bare = 0.6 * 5.0 / (100.0 * 100.0) / (2.0 * PI);
    let of = |name: &str| layer[name].as_f64().unwrap_or_else(|| panic!("{name}: {layer}")) / bare;
    (of("mean"), of("mean_se"))
}

/// Length of the centripetal Catmull-Rom spline of the file, by the pyramid of Barry and Goldman and chords.
fn length() -> f64 {
    type P = [f64; 3];
    let points: [P; 6] = [
        // The ends go on straight.
        [-27.0, -7.0, 4.0],
        [-16.0, -2.0, 4.0],
        [-5.0, 3.0, 4.0],
        [6.0, -3.0, 4.0],
        [16.0, 2.0, 4.0],
        [26.0, 7.0, 4.0],
    ];
    let apart = |a: P, b: P| (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt();
    let mut total = 0.0;
    for four in points.windows(4) {
        let mut t = [0.0; 4];
        for i in 1..4 {
            t[i] = t[i - 1] + apart(four[i], four[i - 1]).sqrt();
        }
        let mix = |a: P, b: P, from: f64, to: f64, at: f64| -> P {
            [0, 1, 2].map(|k| ((to - at) * a[k] + (at - from) * b[k]) / (to - from))
        };
        let place = |at: f64| {
            let a: Vec<P> = (0..3).map(|i| mix(four[i], four[i + 1], t[i], t[i + 1], at)).collect();
            let b: Vec<P> = (0..2).map(|i| mix(a[i], a[i + 1], t[i], t[i + 2], at)).collect();
            mix(b[0], b[1], t[1], t[2], at)
        };
        let steps = 1000;
        let at = |i: i32| t[1] + (t[2] - t[1]) * f64::from(i) / f64::from(steps);
        total += (0..steps).map(|i| apart(place(at(i)), place(at(i + 1)))).sum::<f64>();
    }
    total
}

/// Closed forms of the head comment, within 4 standard errors.
#[test]
fn random_scenes_follow_beer_lambert() {
    let file = format!("{}/pipelines/checks/random_scenes.yaml", env!("CARGO_MANIFEST_DIR"));
    let space = Space::new();
    // What nobody asks for is not computed: the truth first, then the rest.
    space.turbid(&["run", &file, "skin_frames.truth"]).ok();
    space.turbid(&["run", &file]).ok();

    let radius = 2.5;
    let taken = PI * radius * radius - 2.0 * PI * (1.0 - (1.0 + K * radius) * (-K * radius).exp()) / (K * K);
    let expected = 1.0 - 12.0 * taken / AREA;
    for draw in 0..3 {
        let (found, se) = share(&space, &file, &format!("ball_frames[draw={draw}]"));
        assert!((found - expected).abs() < 4.0 * se, "balls {draw}: {found} +- {se}, not {expected}");
        assert!(se < 0.1 * (1.0 - expected), "a missing ball would not be seen: {se}");
    }

    let n = 10_000;
    let across = (0..n).map(|i| 2.0 * (f64::from(i) + 0.5) / f64::from(n) - 1.0);
    let section =
        across.map(|x| 1.0 - (-K * radius * (1.0 - x * x).sqrt()).exp()).sum::<f64>() * 2.0 * radius / f64::from(n);
    let taken = length() * section / AREA;
    let (found, se) = share(&space, &file, "vessel_frames");
    assert!((found - 1.0 + taken).abs() < 4.0 * se + 0.002 * taken, "vessel: {found} +- {se}, not {}", 1.0 - taken);

    let csv = space.path().join("truth.csv");
    space.turbid(&["export", &file, "skin_frames.truth", "--to", csv.to_str().expect("UTF-8")]).ok();
    let text = std::fs::read_to_string(&csv).expect("the export");
    let heights: Vec<f64> = text
        .lines()
        .map(|line| line.split(',').collect::<Vec<_>>())
        .filter(|cells| cells[1] == "height")
        .map(|cells| cells[cells.len() - 1].parse().expect("a number"))
        .collect();
    assert_eq!(heights.len(), 1024);
    let mean = |of: &dyn Fn(f64) -> f64| heights.iter().map(|&h| of(h)).sum::<f64>() / 1024.0;
    let (found, se) = share(&space, &file, "skin_frames");
    let expected = mean(&|h| (-2.0 * MU_A * h).exp());
    assert!((found - expected).abs() < 4.0 * se + 3e-4 * expected, "skin: {found} +- {se}, not {expected}");
    // 1600 mm^2 hold 8 independent hills (area / (pi 8^2)): the mean height is 8 mm to 0.35 mm, the variance 1 mm^2 to some
    // sqrt(2 / 16) = 0.35: the square's correlation is half as wide. Both within 3.
    let height = mean(&|h| h);
    let variance = mean(&|h| (h - 8.0) * (h - 8.0));
    assert!((height - 8.0).abs() < 3.0 * 0.36 && (variance - 1.0).abs() < 3.0 * 0.36, "{height} mm, {variance} mm^2");
}

/// A seed that a sample draws gives it bodies of its own; the same seed the same ones, whatever else is drawn.
#[test]
fn samples_have_bodies_of_their_own() {
    let file = format!("{}/pipelines/checks/random_scenes.yaml", env!("CARGO_MANIFEST_DIR"));
    let space = Space::new();
    let digests = |more: &[&str]| -> Vec<String> {
        let mut run = vec!["run", file.as_str(), "balls"];
        run.extend_from_slice(more);
        space.turbid(&run).ok();
        let mut show = vec!["show", file.as_str(), "balls.scene", "--json"];
        show.extend_from_slice(more);
        let shown = space.turbid(&show).json();
        let digest =
            |i: &Value| i["ports"].as_object().expect("ports").values().next().expect("one")["digest"].to_string();
        shown["instances"].as_array().expect("instances").iter().map(digest).collect()
    };
    let three = digests(&[]);
    assert!(three.len() == 3 && three[0] != three[1] && three[1] != three[2], "{three:?}");
    let four = digests(&["--set", "stages.balls.foreach.draw.n=4"]);
    assert_eq!(four[..3], three[..]);
}
