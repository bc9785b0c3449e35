//! How often intervals of 1 and 2 standard errors hold the truth, per pixel over 200 seeds, from 64 paths per pixel on:
//! `cargo run --release -p turbid-render --example coverage [paths per pixel ..]`.

#[path = "../tests/render/coverage.rs"]
mod coverage;
#[path = "../tests/render/setup.rs"]
#[allow(dead_code, reason = "scenes and hosts that the tests share")]
mod setup;

const SEEDS: u64 = 200;

fn main() {
    let asked: Vec<u32> = std::env::args().skip(1).map(|n| n.parse().expect("a number of paths")).collect();
    let paths = if asked.is_empty() { vec![64, 256] } else { asked };
    println!(
        "scene, paths: M_DC within 1, 2 se; fringe within 1, 2 se (%); standard error of a share 0.8, 0.4 or less"
    );
    let small = coverage::scenes(4).map(|(name, scene)| (name, scene, SEEDS, 256));
    // 256 pixels say as much as many seeds.
    for (name, scene, seeds, longer) in small.into_iter().chain([("down a tube", coverage::tube(16), 30, 64)]) {
        for &n in &paths {
            let found = coverage::coverage(&scene, n, seeds, longer * n);
            let [dc, fringe] = found.shares.map(|of| of.map(|share| 100.0 * share));
            println!("{name}, {n}: {:.1}, {:.1}; {:.1}, {:.1} of {:?}", dc[0], dc[1], fringe[0], fringe[1], found.n);
        }
    }
}
