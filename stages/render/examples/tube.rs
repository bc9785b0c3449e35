//! What a path down a tube costs and how much it varies: `cargo run --release -p turbid-render --example tube [paths per pixel] [estimator] [pictures]`.
//!
//! The tube of the paper (250 mm long, bore of 20 mm, wall of 30 mm), seen along its axis from 110 mm and lit from 100 mm above its mouth, 64 x 64
//! pixels, by depth below the mouth. relative variance = variance per path / mean^2 of M_DC, so 1e4 relative variance paths give 1 %; "within 2 se": how often the stated error of 64
//! paths holds the mean of all those of the eight pixels that are alike. With `projected_images` so many are shown in place of a sinusoid: phases of a fringe that is
//! uniform along the wall, and relative variance of M_AC (the part of its amplitude along the mean) stands behind that of M_DC; it takes
//! more than relative variance paths to be known.

use glam::{DVec2, DVec3};
use turbid_optics::solid::Solid;
use turbid_optics::view::View;
use turbid_render::batches::Batches;
use turbid_render::camera::Camera;
use turbid_render::lamp::Steady;
use turbid_render::level::named;
use turbid_render::light::{Carrier, Light};
use turbid_render::packet;
use turbid_render::path::{Nee, Setting, Walker};
use turbid_render::projected_images::ProjectedImages;
use turbid_render::single::{self, Frame};
use turbid_render::world::{Body, Material, World};

/// Pixels on a side, of 20.4 mm / 64 in the plane 100 mm before the camera.
const SIDE: usize = 64;
const PIXEL: f64 = 20.4 / SIDE as f64;
/// Paths of one interval.
const FEW: usize = 64;
const RADIUS: f64 = 10.0;
const LENGTH: f64 = 250.0;

fn main() {
    let paths: usize = std::env::args().nth(1).map_or(512, |n| n.parse().expect("a number of paths"));
    let only = std::env::args().nth(2);
    let shown: usize = std::env::args().nth(3).map_or(0, |n| n.parse().expect("a number of pictures"));
    let view = |z: f64, look_at: f64| {
        let (from, to) = (DVec3::new(0.0, 0.0, z), DVec3::new(0.0, 0.0, look_at));
        View::new(from, to, DVec3::Y, DVec2::splat(20.4)).expect("not along y")
    };
    let camera = Camera { view: view(110.0, 10.0), columns: SIDE, rows: SIDE };
    let light = Light::new(view(100.0, 0.0), 5.0, false);
    let carriers = [Carrier::new(0.05, 0.0)];
    let carriers = if shown > 0 { &[][..] } else { &carriers };
    let projected_images = if shown > 0 { along_the_wall(shown, 800) } else { ProjectedImages::NONE };
    let wall = Solid::tube(2.0 * RADIUS, 80.0, DVec2::ZERO, -LENGTH, 0.0);
    let world = World {
        bodies: vec![Body { solid: wall, material: 1 }],
        materials: vec![
            Material::VOID,
            Material::medium(0.06, 10.0, turbid_optics::PhaseFunction::henyey_greenstein(0.8), 1.0),
        ],
        textures: Vec::new(),
    };
    println!("estimator, depth mm (pixels): M_DC / its error, rv, excess kurtosis, within 2 se; us a path");
    let f32s = ["f32", "branches"];
    for (name, nee) in [("point", Nee::Point), ("scalar", Nee::Line), (f32s[0], Nee::Line), (f32s[1], Nee::Line)] {
        if only.as_ref().is_some_and(|only| only != name) {
            continue;
        }
        for (from, to) in [(0.0, 25.0), (25.0, 75.0), (75.0, 150.0), (150.0, 250.0)] {
            let depth = |pixel: usize| {
                let at = |i: usize| (i as f64 + 0.5 - 0.5 * SIDE as f64) * PIXEL;
                100.0 * RADIUS / at(pixel % SIDE).hypot(at(pixel / SIDE)) - 110.0
            };
            let pixels: Vec<u32> =
                (0..SIDE * SIDE).filter(|&p| (from..to).contains(&depth(p))).map(|p| p as u32).collect();
            let setting = Setting {
                world: &world,
                camera: &camera,
                light: &light,
                steady: &Steady::NONE,
                carriers,
                projected_images: &projected_images,
                key: [1, 2],
                channel: 0,
                nee,
                shared: None,
            };
            let mut walker = Walker::new(setting, named(&std::env::var("TURBID_SIMD").unwrap_or_default()));
            let mut frame = Frame::of(&walker);
            if let (false, Some(frame)) = (name == "branches", &mut frame) {
                frame.light_branches.clear();
            }
            let mut of_pixel = vec![Vec::with_capacity(paths); pixels.len()];
            let mut amplitude = vec![Amplitude::default(); pixels.len()];
            let began = cpu_seconds();
            for first in (0..paths).step_by(FEW) {
                let count = FEW.min(paths - first) as u32;
                for some in pixels.chunks(128) {
                    let of: Vec<(u32, u32)> = some.iter().map(|&pixel| (pixel, first as u32)).collect();
                    let batches = Batches { of: &of, count };
                    match &frame {
                        Some(frame) if f32s.contains(&name) => single::walk(&mut walker, frame, batches),
                        _ => packet::walk_singly(&mut walker, batches),
                    }
                    for path in 0..some.len() * count as usize {
                        let place = some[path / count as usize];
                        let i = pixels.binary_search(&place).expect("one of them");
                        let response = walker.response(path);
                        of_pixel[i].push(response[0]);
                        if shown > 2 {
                            amplitude[i].add(&response[1..]);
                        }
                    }
                }
            }
            let seconds = cpu_seconds() - began;
            let n = paths as f64;
            let (mut sum, mut square, mut fourth) = (0.0, 0.0, 0.0);
            let (mut held, mut intervals) = (0, 0);
            for values in &of_pixel {
                let mean = values.iter().sum::<f64>() / n;
                sum += mean;
                square += values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0);
                fourth += values.iter().map(|x| (x - mean).powi(4)).sum::<f64>() / n;
            }
            let m = sum / of_pixel.len() as f64;
            let variance = square / of_pixel.len() as f64;
            // The tube is the same in eight pixels (the picture of M_DC; its field is square).
            let alike = |pixel: u32| {
                let off = |i: usize| i.abs_diff(SIDE - 1 - i);
                let (x, y) = (off(pixel as usize % SIDE), off(pixel as usize / SIDE));
                (x.min(y), x.max(y))
            };
            let mut truths = std::collections::BTreeMap::<_, (f64, f64)>::new();
            for (&pixel, values) in pixels.iter().zip(&of_pixel) {
                let truth = truths.entry(alike(pixel)).or_default();
                *truth = (truth.0 + values.iter().sum::<f64>(), truth.1 + n);
            }
            let of_all = pixels.iter().zip(&of_pixel);
            for (pixel, values) in of_all.flat_map(|(&pixel, values)| values.chunks_exact(FEW).map(move |v| (pixel, v)))
            {
                let (k, truth) = (FEW as f64, truths[&alike(pixel)]);
                let m = truth.0 / truth.1;
                let mean = values.iter().sum::<f64>() / k;
                let v = values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (k - 1.0) / k;
                let se = v.sqrt() * (1.0 + 5.0 / k);
                held += usize::from((mean - m).abs() <= 2.0 * se);
                intervals += 1;
            }
            let se = (variance / n / of_pixel.len() as f64).sqrt();
            let ac = relative_variance(&amplitude)
                .map_or(String::new(), |relative_variance| format!(" and {relative_variance:.0}"));
            println!(
                "{name}, {from:.0} to {to:.0} ({}): {m:.4e} +- {:.2} %, {:.2}{ac}, {:.0}, {:.3}; {:.2}; {:.1} flights",
                pixels.len(),
                100.0 * se / m,
                variance / (m * m),
                fourth / of_pixel.len() as f64 / (variance * variance) - 3.0,
                held as f64 / intervals as f64,
                1e6 * seconds / n / pixels.len() as f64,
                walker.take_flights() as f64 / n / pixels.len() as f64,
            );
        }
    }
}

/// Sums of what paths bring to re and im of a fringe, and of their products.
#[derive(Clone, Default)]
struct Amplitude {
    n: f64,
    sums: [f64; 2],
    products: [f64; 3],
}

impl Amplitude {
    /// By the N-phase formula.
    fn add(&mut self, phases: &[f64]) {
        let n = phases.len() as f64;
        let turns = |k: usize| std::f64::consts::TAU * k as f64 / n;
        let re = 2.0 / n * phases.iter().enumerate().map(|(k, x)| x * turns(k).cos()).sum::<f64>();
        let im = -2.0 / n * phases.iter().enumerate().map(|(k, x)| x * turns(k).sin()).sum::<f64>();
        self.n += 1.0;
        self.sums = [self.sums[0] + re, self.sums[1] + im];
        self.products = [self.products[0] + re * re, self.products[1] + re * im, self.products[2] + im * im];
    }
}

/// Variance per path along the mean over its square, both summed over pixels; of the square what noise adds to it is taken away. `None` where that is
/// most of it.
fn relative_variance(of: &[Amplitude]) -> Option<f64> {
    let (mut variance, mut square, mut noise) = (0.0, 0.0, 0.0);
    for a in of.iter().filter(|a| a.n > 0.0) {
        let [x, y] = a.sums.map(|sum| sum / a.n);
        let [xx, xy, yy] = a.products.map(|product| product / a.n);
        let (xx, xy, yy) = (xx - x * x, xy - x * y, yy - y * y);
        let m2 = x * x + y * y;
        variance += (x * x * xx + 2.0 * x * y * xy + y * y * yy) / m2;
        square += m2;
        noise += (xx + yy) / a.n;
    }
    (noise < 0.5 * square).then(|| variance / (square - noise))
}

/// Phases of a fringe of 0.05 mm^-1 along the wall, of n x n pixels.
fn along_the_wall(phases: usize, n: usize) -> ProjectedImages {
    let at = |i: usize| 20.4 * ((i as f64 + 0.5) / n as f64 - 0.5);
    ProjectedImages::new(phases, n, n, |phase, row, column| {
        let depth = 100.0 * RADIUS / at(row).hypot(at(column)) - 100.0;
        let turns = 0.05 * depth + phase as f64 / phases as f64;
        (0.5 + 0.5 * (std::f64::consts::TAU * turns).cos()) as f32
    })
}

/// Seconds that this thread has had a core, so that other work on the machine does not count (Linux; 0 elsewhere).
fn cpu_seconds() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    text.split(' ').next().and_then(|ns| ns.parse::<f64>().ok()).unwrap_or(0.0) * 1e-9
}
