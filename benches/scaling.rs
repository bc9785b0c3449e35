//! What a render costs as it grows: `cargo bench --bench scaling`.
//!
//! A half-space (A_rho 100, S_rho 5000, g 0.8, n 1), f_x 0.1 and 0.2 in three phases each; in the last rows a sphere on it, where stand-ins double the sums. CPU seconds of the render
//! alone, and the peak of the resident memory of the whole process while it ran (Linux; 0 elsewhere).

mod program;

use program::{number, run, stage};

struct Row {
    side: u32,
    samples: u32,
    params: &'static str,
    ball: bool,
}

fn pipeline(row: &Row) -> String {
    let Row { side, samples, params, ball } = row;
    let ball = if *ball {
        "        ball: {sphere: {diameter: 30, center: [0, 0, 0]}, medium: other, priority: 1}\n"
    } else {
        ""
    };
    format!(
        "pipeline: scaling\nseed: 1\nstages:\n  scene:\n    use: scene\n    with:\n      media: {{m: {{A_rho: 100, S_rho: 5000, g: 0.8, n: 1.0}}, other: {{A_rho: 25, S_rho: 4236, g: 0.8, n: 1.0}}}}\n      objects:\n        tissue: {{slab: {{thickness: 2000, top: 0}}, medium: m}}\n{ball}      camera: {{position: [0, 0, 500], look_at: [0, 0, 0], field: [64, 64], pixels: [{side}, {side}]}}\n      projector: {{position: [35, 0, 500], look_at: [0, 0, 0], field: [256, 256], power: 5}}\n  frames:\n    use: render\n    in: {{scene: scene}}\n    with: {{f_x: [0.1, 0.2], phases: 3, samples: {samples}, {params}}}\n"
    )
}

fn main() {
    let space = tempfile::tempdir().expect("a temporary folder");
    let row = |side, samples| Row { side, samples, params: "method: path", ball: false };
    let rows = [
        row(50, 16),
        row(158, 16),
        row(500, 16),
        row(50, 160),
        row(50, 1600),
        Row { params: "method: path, allocate: adaptive", ..row(500, 16) },
        Row { params: "method: auto", ball: true, ..row(500, 16) },
        Row { params: "method: auto, allocate: adaptive", ball: true, ..row(500, 64) },
    ];
    println!("| pixels | paths per pixel | | CPU s | us per path | peak MB |\n| --- | --- | --- | --- | --- | --- |");
    for row in &rows {
        let Row { side, samples, params, ball } = row;
        let what = format!("{params}{}", if *ball { ", sphere on the slab" } else { "" });
        let ran = run(space.path(), &pipeline(row));
        match ran.as_ref().map_err(String::clone).and_then(|shown| stage(shown, "frames")) {
            Ok(frames) => println!(
                "| {side} x {side} | {samples} | {what} | {:.2} | {:.2} | {:.0} |",
                number(&frames["cpu_seconds"]),
                1e6 * number(&frames["cpu_seconds"]) / f64::from(side * side * samples),
                1e-6 * number(&frames["peak_bytes"])
            ),
            Err(e) => println!("| {side} x {side} | {samples} | {what} | {}", e.lines().next().unwrap_or_default()),
        }
    }
}
