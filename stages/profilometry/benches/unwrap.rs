//! Unwrapping of 2048 x 2048 noisy pixels: CPU seconds, and the share of pixels that get other turns than the truth, against noise.

use std::f64::consts::TAU;
use std::hint::black_box;
use std::time::Instant;

use turbid_optics::philox::{key, philox4x32, unit};
use turbid_profilometry::unwrap::unwrap;

const SIDE: usize = 2048;

/// CPU time of this thread in ns, where the system tells: a busy machine shows less.
fn on_cpu() -> Option<f64> {
    std::fs::read_to_string("/proc/thread-self/schedstat").ok()?.split(' ').next()?.parse().ok()
}

fn main() {
    println!("2048 x 2048 px, 30 turns high; noise (rad), CPU seconds (best of 5), wrong turns (%)");
    let folder = std::env::args().skip_while(|a| a != "--write").nth(1);
    for sigma in [0.0, 0.3, 0.6, 0.9, 1.2] {
        let truth = |i: usize| {
            let (x, y) = ((i % SIDE) as f64 / SIDE as f64 - 0.5, (i / SIDE) as f64 / SIDE as f64 - 0.5);
            TAU * 30.0 * libm::exp(-8.0 * (x * x + y * y)) + 40.0 * x
        };
        let noise = |i: usize| {
            let [a, b, ..] = philox4x32([i as u32, 0, 0, 0], key(1));
            sigma * (-2.0 * libm::log(unit(a))).sqrt() * libm::cos(TAU * unit(b))
        };
        let noisy: Vec<f64> = (0..SIDE * SIDE).map(|i| truth(i) + noise(i)).collect();
        let phase: Vec<f32> = noisy.iter().map(|p| (p - TAU * (p / TAU).round()) as f32).collect();
        let good = vec![true; phase.len()];
        let mut best = f64::INFINITY;
        let mut found = None;
        for _ in 0..5 {
            let (start, before) = (Instant::now(), on_cpu());
            found = Some(black_box(unwrap(&phase, &good, SIDE)));
            let spent = match (before, on_cpu()) {
                (Some(before), Some(after)) => (after - before) * 1e-9,
                _ => start.elapsed().as_secs_f64(),
            };
            best = best.min(spent);
        }
        let found = found.expect("five rounds");
        let off = |i: usize| ((f64::from(phase[i]) - noisy[i]) / TAU).round() as i64 + i64::from(found.turns[i]);
        let mut counts = std::collections::BTreeMap::new();
        (0..phase.len()).for_each(|i| *counts.entry(off(i)).or_insert(0_usize) += 1);
        let most = counts.values().max().expect("pixels");
        println!("{sigma:.1}  {best:.3} s  {:.4} %", 100.0 * (phase.len() - most) as f64 / phase.len() as f64);
        if let Some(folder) = &folder {
            let bytes = |v: Vec<f32>| v.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
            let turned = (0..phase.len()).map(|i| phase[i] + TAU as f32 * found.turns[i] as f32).collect();
            std::fs::write(format!("{folder}/wrapped_{sigma:.1}.f32"), bytes(phase.clone()))
                .expect("a folder to write to");
            std::fs::write(format!("{folder}/unwrapped_{sigma:.1}.f32"), bytes(turned)).expect("a folder to write to");
        }
    }
}
