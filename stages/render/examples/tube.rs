//! What a path down a tube costs and how much it varies: `cargo run --release -p turbid-render --example tube [paths per pixel] [estimator]`.
//!
//! The tube of the paper (250 mm long, bore of 20 mm, wall of 30 mm), seen along its axis from 110 mm and lit from 100 mm above its mouth, 64 x 64
//! pixels, by depth below the mouth. rv = variance per path / mean^2 of M_DC, so 1e4 rv paths give 1 %; "within 2 se": how often the stated error of 64
//! paths holds the mean of all those of the eight pixels that are alike.

use glam::{DVec2, DVec3};
use turbid_optics::solid::Solid;
use turbid_optics::view::View;
use turbid_render::batches::Batches;
use turbid_render::camera::Camera;
use turbid_render::flock;
use turbid_render::lamp::Steady;
use turbid_render::level::named;
use turbid_render::light::{Carrier, Light};
use turbid_render::path::{Nee, Setting, Walker};
use turbid_render::pictures::Pictures;
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
    let view = |z: f64, look_at: f64| {
        let (from, to) = (DVec3::new(0.0, 0.0, z), DVec3::new(0.0, 0.0, look_at));
        View::new(from, to, DVec3::Y, DVec2::splat(20.4)).expect("not along y")
    };
    let camera = Camera { view: view(110.0, 10.0), columns: SIDE, rows: SIDE };
    let light = Light::new(view(100.0, 0.0), 5.0, false);
    let carriers = [Carrier::new(0.05, 0.0)];
    let wall = Solid::tube(2.0 * RADIUS, 80.0, DVec2::ZERO, -LENGTH, 0.0);
    let world = World {
        bodies: vec![Body { solid: wall, material: 1 }],
        materials: vec![Material::VOID, Material::medium(0.06, 10.0, 0.8, 1.0)],
        textures: Vec::new(),
    };
    println!("estimator, depth mm (pixels): M_DC / its error, rv, excess kurtosis, within 2 se; us a path");
    for (name, nee, f32s) in [("point", Nee::Point, false), ("f64", Nee::Line, false), ("f32", Nee::Line, true)] {
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
                carriers: &carriers,
                pictures: &Pictures::NONE,
                key: [1, 2],
                channel: 0,
                nee,
                shared: None,
            };
            let mut walker = Walker::new(setting, named(&std::env::var("TURBID_SIMD").unwrap_or_default()));
            let frame = Frame::of(&walker);
            let mut of_pixel = vec![Vec::with_capacity(paths); pixels.len()];
            let began = cpu_seconds();
            for first in (0..paths).step_by(FEW) {
                let count = FEW.min(paths - first) as u32;
                for some in pixels.chunks(128) {
                    let of: Vec<(u32, u32)> = some.iter().map(|&pixel| (pixel, first as u32)).collect();
                    let batches = Batches { of: &of, count };
                    match &frame {
                        Some(frame) if f32s => single::walk(&mut walker, frame, batches),
                        _ => flock::walk_double_among(&mut walker, batches),
                    }
                    for path in 0..some.len() * count as usize {
                        let place = some[path / count as usize];
                        let i = pixels.binary_search(&place).expect("one of them");
                        of_pixel[i].push(walker.response(path)[0]);
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
            println!(
                "{name}, {from:.0} to {to:.0} ({}): {m:.4e} +- {:.2} %, {:.2}, {:.0}, {:.3}; {:.2}; {:.1} flights",
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

/// Seconds that this thread has had a core, so that other work on the machine does not count (Linux; 0 elsewhere).
fn cpu_seconds() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    text.split(' ').next().and_then(|ns| ns.parse::<f64>().ok()).unwrap_or(0.0) * 1e-9
}
