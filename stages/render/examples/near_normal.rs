//! Calibrated camera reflectance of six materials against the transport solver, as z scores:
//! `cargo run --release -p turbid-render --example near_normal [paths per pixel [apart_mm [distance_mm]]]`.
//!
//! Camera and projector `distance` above the surface (2 m), `apart` from each other across the fringes (30 mm: 0.9 degrees), 20 x 20
//! pixels of 1 mm, f_x 0, 0.1, 0.2, lit 10 / mu_eff beyond the view; reference (1, 20000). Image means.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};
use turbid_optics::Medium;
use turbid_optics::rte::reflectance;
use turbid_optics::solid::Solid;
use turbid_optics::view::View;
use turbid_render::camera::Camera;
use turbid_render::lamp::Steady;
use turbid_render::level::named;
use turbid_render::light::{Carrier, Light};
use turbid_render::moments::Moments;
use turbid_render::path::{Nee, Setting, Walker};
use turbid_render::projected_images::ProjectedImages;
use turbid_render::world::{Body, Material, World};

const MATERIALS: [(f64, f64); 6] =
    [(1.0, 20000.0), (25.0, 4236.0), (96.0, 3721.0), (22.0, 3215.0), (100.0, 5000.0), (50.0, 20000.0)];
const F_X: [f64; 3] = [0.0, 0.1, 0.2];
const SIDE: usize = 20;

fn main() {
    let argument = |i: usize, or: f64| std::env::args().nth(i).map_or(or, |n| n.parse().expect("a number"));
    let (paths, apart, distance) = (argument(1, 1024.0) as u32, argument(2, 30.0), argument(3, 2000.0));
    // Not the same paths as the sample of that material.
    let reference = render(MATERIALS[0], 99, paths, apart, distance);
    let truth = |(a, s): (f64, f64), f: f64| {
        let medium = Medium {
            mu_a: a / 1000.0,
            mu_s_prime: s / 1000.0 * 0.2,
            phase: turbid_optics::PhaseFunction::henyey_greenstein(0.8),
            n: 1.0,
        };
        reflectance(&medium, None, f).expect("an ordinary medium").camera
    };
    let mut z = Vec::new();
    println!("material, f_x: measured +- se, transport solver, z; uncalibrated / solver - 1");
    for (k, material) in MATERIALS.into_iter().enumerate() {
        let sample = render(material, k as u32, paths, apart, distance);
        for (i, &f) in F_X.iter().enumerate() {
            let expected = truth(material, f);
            let measured = sample[i].0 / reference[i].0 * truth(MATERIALS[0], f);
            let se = measured * f64::hypot(sample[i].1 / sample[i].0, reference[i].1 / reference[i].0);
            z.push((measured - expected) / se);
            println!(
                "{material:?}, {f}: {measured:.5} +- {se:.5}, {expected:.5}, {:+.2}; {:+.4} +- {:.4}",
                z.last().expect("just pushed"),
                sample[i].0 / expected - 1.0,
                sample[i].1 / expected
            );
        }
    }
    let n = z.len() as f64;
    let mean = z.iter().sum::<f64>() / n;
    let rms = (z.iter().map(|z| z * z).sum::<f64>() / n).sqrt();
    println!(
        "{n} values: mean z {mean:+.2}, rms {rms:.2}, worst {:.2}",
        z.iter().fold(0.0, |w: f64, z| w.max(z.abs()))
    );
}

/// pi x radiance / irradiance per f_x, averaged over the image, with the standard error.
fn render((a_rho, s_rho): (f64, f64), seed: u32, paths: u32, apart: f64, distance: f64) -> [(f64, f64); 3] {
    let (mu_a, mu_s) = (a_rho / 1000.0, s_rho / 1000.0);
    let mu_eff = (3.0 * mu_a * (mu_a + 0.2 * mu_s)).sqrt();
    let lit = SIDE as f64 + 20.0 / mu_eff;
    let view = |y: f64, field: f64| {
        View::new(DVec3::new(0.0, y, distance), DVec3::ZERO, DVec3::Y, DVec2::splat(field)).expect("not along y")
    };
    let camera = Camera { view: view(0.0, SIDE as f64), columns: SIDE, rows: SIDE };
    let light = Light::new(view(apart, lit), 1.0, true);
    let carriers = [Carrier::new(F_X[1], 0.0), Carrier::new(F_X[2], 0.0)];
    let medium = Material::medium(mu_a, mu_s, turbid_optics::PhaseFunction::henyey_greenstein(0.8), 1.0);
    let bodies = vec![Body { solid: Solid::Slab { bottom: -1000.0, top: 0.0 }, material: 1 }];
    let world = World { bodies, materials: vec![Material::VOID, medium], textures: Vec::new() };
    let setting = Setting {
        world: &world,
        camera: &camera,
        light: &light,
        steady: &Steady::NONE,
        carriers: &carriers,
        projected_images: &ProjectedImages::NONE,
        key: [seed, 0],
        channel: 0,
        nee: Nee::Line,
        shared: None,
    };
    let n = camera.pixels();
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let moments: Vec<Moments> = std::thread::scope(|scope| {
        let workers: Vec<_> = (0..threads)
            .map(|t| {
                scope.spawn(move || {
                    let mut walker = Walker::new(setting, named(""));
                    let mut moments = Moments::new(n, 5);
                    for pixel in (t..n).step_by(threads) {
                        (0..paths).for_each(|sample| moments.add(pixel, walker.path(pixel, sample)));
                    }
                    moments
                })
            })
            .collect();
        workers.into_iter().map(|w| w.join().expect("no worker panics")).collect()
    });
    let mut total = Moments::new(n, 5);
    moments.iter().for_each(|m| total.fold(0, m));
    let irradiance = 1.0 / (lit * lit);
    let mut result = [(0.0, 0.0); 3];
    for pixel in 0..n {
        let mut add = |i: usize, value: f64, variance: f64| {
            result[i].0 += value;
            result[i].1 += variance;
        };
        add(0, total.mean(pixel, 0, paths), total.covariance(pixel, 0, 0, paths));
        let x = (pixel % SIDE) as f64 + 0.5 - SIDE as f64 / 2.0;
        for (i, carrier) in carriers.iter().enumerate() {
            // Along the known phase of the fringe: linear, so that averages have no bias. The blur of 1 mm pixels is taken out.
            let (sin, cos) = carrier.at(DVec3::new(x, 0.0, 0.0));
            let (re, im) = (1 + 2 * i, 2 + 2 * i);
            let blur = (PI * carrier.f_x()).sin() / (PI * carrier.f_x());
            let cov = |i, j| total.covariance(pixel, i, j, paths);
            let variance = cos * cos * cov(re, re) + 2.0 * sin * cos * cov(re, im) + sin * sin * cov(im, im);
            let value = cos * total.mean(pixel, re, paths) + sin * total.mean(pixel, im, paths);
            add(i + 1, value / blur, variance / (blur * blur));
        }
    }
    let scale = PI / irradiance / n as f64;
    result.map(|(sum, variance)| (scale * sum, scale * variance.sqrt()))
}
