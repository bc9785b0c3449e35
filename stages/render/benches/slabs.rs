//! Power that slabs and half-spaces give back and let through, against all rows of the table of extremes, as z scores:
//! `cargo bench -p turbid-render --bench slabs [-- photons]`.
//!
//! Albedo 0 to 1 - 1e-9, g -0.99 to 0.99, n 1 to 2.5, 1e-6 to 1e4 mean free paths thick (half-spaces: 1e6), under a normal beam. A row is left out where fewer than
//! 100 photons would, or would not, come out: there z is not normal. Where light stays long, a slab gets fewer photons: about `FLIGHTS` flights in all.

#[path = "../tests/render/setup.rs"]
#[allow(dead_code, reason = "not all of it is needed here")]
mod setup;

use std::time::Instant;

use turbid_contract::payload::{Medium, Shape};

use setup::{beam_on, object, power, rig, scene};

/// What a slab may cost.
const FLIGHTS: f64 = 5e7;

const TABLE: &str = include_str!("../../optics/tests/reference/slab_extreme.csv");

/// A row of the table: with a mean free path (or an absorber's own unit) of 1 mm.
#[derive(Clone, Debug)]
struct Row {
    kind: &'static str,
    medium: Medium,
    /// `None`: a half-space.
    thickness: Option<f64>,
    transmitted: bool,
    value: f64,
    error: f64,
}

fn main() {
    let photons: u32 = std::env::args().skip(1).find_map(|a| a.parse().ok()).unwrap_or(40_000);
    let rows: Vec<Row> = TABLE.lines().skip(1).map(row).collect();
    let started = Instant::now();
    let (mut scores, mut unseen) = (Vec::new(), 0);
    let same = |a: &Row, b: &Row| a.medium == b.medium && a.thickness == b.thickness;
    for (seed, rows) in rows.chunk_by(same).enumerate() {
        let photons = f64::from(photons).min(FLIGHTS / rows[0].flights()).ceil();
        let (rows, few): (Vec<&Row>, Vec<&Row>) =
            rows.iter().partition(|row| row.value.min(1.0 - row.value) * photons >= 100.0);
        unseen += few.len();
        let Some(first) = rows.first() else { continue };
        let slab = object(Shape::Slab { top: 0.0, bottom: -first.thickness.unwrap_or(1e6) }, "m", 0);
        let scene = scene(&[("m", first.medium.clone())], vec![slab], rig(60.0, 0.0, 4.0, 1, 9.0));
        let found = power(&beam_on(scene), photons as u32, seed as u64);
        for row in rows {
            let (_, _, share, se) = found[usize::from(row.transmitted)];
            let z = (share - row.value) / se.hypot(row.error);
            if z.abs() > 3.5 {
                println!("z = {z:+.2}: {share} +- {se} in {row:?}");
            }
            scores.push((row.kind, z));
        }
    }
    println!(
        "at most {photons} photons for each slab, {:.0} s; {unseen} values are of too few photons",
        started.elapsed().as_secs_f64()
    );
    println!("| rows | values | mean z | sd | worst |\n| --- | --- | --- | --- | --- |");
    report("all", &scores, |_| true);
    for kind in ["slab", "half-space", "no scattering slab"] {
        report(kind, &scores, |k| k == kind);
    }
}

impl Row {
    /// About how often light is scattered: to the end of its absorption, or of its way across.
    fn flights(&self) -> f64 {
        let across = 4.0 * self.medium.n.powi(2) * self.thickness.unwrap_or(f64::INFINITY);
        let absorbed = if self.transmitted { 1.0 } else { 1.0 - self.value };
        (absorbed / self.medium.mu_a[0]).min(across).max(1.0)
    }
}

fn report(name: &str, scores: &[(&str, f64)], wanted: impl Fn(&str) -> bool) {
    let z: Vec<f64> = scores.iter().filter(|s| wanted(s.0)).map(|s| s.1).collect();
    let n = z.len() as f64;
    let mean = z.iter().sum::<f64>() / n;
    let sd = (z.iter().map(|z| (z - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
    let worst = z.iter().fold(0.0, |w: f64, z| w.max(z.abs()));
    println!("| {name} | {n} | {mean:+.3} | {sd:.3} | {worst:.2} |");
}

/// case, inputs `name=value ..`, quantity, value, tolerance, source. Rows of R without the beam's own reflex get it added.
fn row(line: &'static str) -> Row {
    let cells: Vec<&'static str> = line.split(',').collect();
    let number = |cell: &str| cell.parse::<f64>().unwrap_or_else(|_| panic!("`{cell}` is no number"));
    let field =
        |name: &str| cells[1].split(' ').find_map(|part| part.strip_prefix(name)?.strip_prefix('=')).map(number);
    let n = field("n").unwrap_or(1.0);
    let medium = match field("albedo") {
        Some(albedo) => Medium {
            mu_a: vec![1.0 - albedo],
            mu_s: vec![albedo],
            phase: turbid_contract::payload::PhaseFunction::HenyeyGreenstein(field("g").expect("of a scatterer")),
            n,
        },
        None => Medium {
            mu_a: vec![field("mua").expect("of an absorber")],
            mu_s: vec![0.0],
            phase: turbid_contract::payload::PhaseFunction::HenyeyGreenstein(0.0),
            n,
        },
    };
    let reflex = if cells[2].contains("no specular") { ((n - 1.0) / (n + 1.0)).powi(2) } else { 0.0 };
    let value = number(cells[3]) + reflex;
    let error = cells[4].strip_prefix("relative ").map_or_else(|| number(cells[4]), |e| number(e) * value);
    let thickness = field("tau").or(field("d"));
    Row { kind: cells[0], medium, thickness, transmitted: cells[2].starts_with('T'), value, error }
}
