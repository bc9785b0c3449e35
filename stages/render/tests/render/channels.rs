//! Channels that share paths see what each of them would see alone, in scenes that try to mislead them.

use glam::{DVec2, DVec3};
use turbid_optics::view::View;
use turbid_render::batches::{Batches, alike};
use turbid_render::camera::Camera;
use turbid_render::channels::{Channels, Group};
use turbid_render::lamp::{Lamp, Steady};
use turbid_render::level::named;
use turbid_render::light::{Carrier, Light};
use turbid_render::moments::Moments;
use turbid_render::packet;
use turbid_render::path::{Nee, Setting, Walker};
use turbid_render::projected_images::ProjectedImages;
use turbid_render::single::{self, Frame};
use turbid_render::world::{Material, World};

use crate::odd_worlds::{curved_scenes, lamps, mesh_scenes, scenes, shaped_scenes};

/// Factor and summand (mm^-1) of the absorption in the media of even and odd places: none is the least everywhere.
const ABSORPTION: [[(f64, f64); 2]; 3] =
    [[(1.0, 0.0), (1.0, 0.1)], [(1.5, 0.02), (2.0, 0.0)], [(0.3, 0.0), (1.0, 0.4)]];
static NO_PROJECTED_IMAGES: ProjectedImages = ProjectedImages::NONE;

const POWERS: [f64; 3] = [1.0, 0.25, 3.0];

fn channel(world: &World, channel: usize) -> World {
    let used = |m: usize| world.bodies.iter().any(|body| body.material == m);
    let material = |(i, m): (usize, &Material)| {
        let (factor, more) = ABSORPTION[channel][i % 2];
        let turbid = i > 0 && !m.is_opaque() && used(i);
        if turbid { Material { mu_a: factor * m.mu_a + more, ..*m } } else { *m }
    };
    World { materials: world.materials.iter().enumerate().map(material).collect(), ..world.clone() }
}

/// Lamps of other powers.
fn scaled(steady: &Steady, factor: f64) -> Steady {
    let lamp = |lamp: &Lamp| match *lamp {
        Lamp::Point { position, intensity } => Lamp::Point { position, intensity: factor * intensity },
        Lamp::Spot { position, axis, half, intensity } => {
            Lamp::Spot { position, axis, half, intensity: factor * intensity }
        }
        Lamp::Beam { center, along, radius, irradiance } => {
            Lamp::Beam { center, along, radius, irradiance: factor * irradiance }
        }
    };
    Steady { lamps: steady.lamps.iter().map(lamp).collect(), ambient: factor * steady.ambient }
}

struct Rig {
    camera: Camera,
    lights: Vec<Light>,
    carriers: [Carrier; 1],
}

fn rig() -> Rig {
    let view = |position: [f64; 3], field: f64| {
        View::new(position.into(), DVec3::ZERO, DVec3::Y, DVec2::splat(field)).unwrap()
    };
    let camera = Camera { view: view([4.0, -3.0, 25.0], 5.0), columns: 4, rows: 4 };
    let lights = POWERS.map(|power| Light::new(view([-9.0, 8.0, 20.0], 6.0), power, false)).to_vec();
    Rig { camera, lights, carriers: [Carrier::new(0.15, 20.0)] }
}

fn setting<'a>(rig: &'a Rig, group: &'a Group, steady: &'a [Steady], seed: u32) -> Setting<'a> {
    Setting {
        world: &group.world,
        camera: &rig.camera,
        light: &rig.lights[group.channels[0]],
        steady: &steady[group.channels[0]],
        carriers: &rig.carriers,
        projected_images: &NO_PROJECTED_IMAGES,
        key: [seed, 0],
        channel: 0,
        nee: Nee::Line,
        shared: group.shared.as_ref(),
    }
}

/// Three channels by one walk against three walks with other random numbers, per pixel and response (1, re, im, steady): z has rms 1 and no
/// outlier, and the images agree.
#[test]
fn shared_paths_are_unbiased() {
    let rig = rig();
    let plain = [scenes(), shaped_scenes(), mesh_scenes()].into_iter().flatten().map(|scene| (scene, 300));
    // Light through curved walls is dear to find.
    let curved = curved_scenes().into_iter().map(|scene| (scene, 200));
    let mut all_scores = Vec::new();
    for (i, ((name, world), paths)) in plain.chain(curved).enumerate() {
        let worlds = [0, 1, 2].map(|c| channel(&world, c));
        // A few scenes will do.
        let lit = if i % 5 == 0 { lamps() } else { Steady::NONE };
        let steady = POWERS.map(|power| scaled(&lit, power));
        let all = Channels { worlds: &worlds, lights: &rig.lights, steady: &steady };
        let width = if lit.shines() { 4 } else { 3 };
        let render = |group: &Group, seed: u32| {
            let mut walker = Walker::new(setting(&rig, group, &steady, seed), named(""));
            let mut moments = vec![Moments::new(16, width); group.channels.len()];
            for sample in (0..paths).step_by(50) {
                packet::walk(&mut walker, 0..16, sample..sample + 50);
                for (path, place) in (0..800).flat_map(|path| (0..group.channels.len()).map(move |c| (path, c))) {
                    moments[place].add(path / 50, walker.response_in(path, place));
                }
            }
            moments
        };
        let shared = render(&Group::of(all, vec![0, 1, 2]), 1);
        let (mut scores, mut images) = (Vec::new(), Vec::new());
        for (c, shared) in shared.iter().enumerate() {
            let alone = &render(&Group::of(all, vec![c]), 2 + c as u32)[0];
            let (mut difference, mut variance) = (0.0, 0.0);
            for (pixel, i) in (0..16).flat_map(|pixel| (0..width).map(move |i| (pixel, i))) {
                let [a, b] = [shared, alone].map(|m| (m.mean(pixel, i, paths), m.covariance(pixel, i, i, paths)));
                if i == 0 {
                    (difference, variance) = (difference + a.0 - b.0, variance + a.1 + b.1);
                }
                if a.1 + b.1 > 0.0 {
                    scores.push((a.0 - b.0) / (a.1 + b.1).sqrt());
                }
            }
            images.push(difference / variance.sqrt());
        }
        let rms = (scores.iter().map(|z| z * z).sum::<f64>() / scores.len() as f64).sqrt();
        let worst = scores.iter().fold(0.0, |worst: f64, z| worst.max(z.abs()));
        assert!(images.iter().all(|z| z.abs() < 4.0), "{name}: images differ by {images:?} sigma");
        // 48 pixels of 4 correlated responses, a third of them by the same paths.
        assert!((0.6..1.4).contains(&rms) && worst < 4.5, "{name}: rms z {rms}, worst {worst}");
        all_scores.extend(scores);
    }
    let rms = (all_scores.iter().map(|z| z * z).sum::<f64>() / all_scores.len() as f64).sqrt();
    assert!((rms - 1.0).abs() < 0.15, "rms z over {} numbers is {rms}", all_scores.len());
}

/// The walk is that of the channel that absorbs least: where one does so everywhere it gets, path by path, what it sees
/// alone; and lanes give every channel what the scalar walker gives it, to rounding.
#[test]
fn lanes_count_the_lengths_of_the_scalar_walker() {
    let rig = rig();
    let all = scenes().into_iter().chain(mesh_scenes());
    for ((name, world), steady) in all.flat_map(|s| [(s.clone(), Steady::NONE), (s, lamps())]) {
        let worlds = [0, 1, 2].map(|c| channel(&world, c));
        let steady = POWERS.map(|power| scaled(&steady, power));
        let all = Channels { worlds: &worlds, lights: &rig.lights, steady: &steady };
        let group = Group::of(all, vec![0, 1, 2]);
        let setting = setting(&rig, &group, &steady, 7);
        let (mut alone, mut lanes) = (Walker::new(setting, named("")), Walker::new(setting, named("")));
        let frame = Frame::of(&lanes).expect("f32 holds these scenes");
        single::walk(&mut lanes, &frame, Batches { of: &alike(0..16, &(0..128)), count: 128 });
        let (mut sums, mut turned) = (vec![[0.0; 3]; alone.path(0, 0).len()], 0);
        for path in 0..16 * 128 {
            let expected = alone.path(path / 128, path as u32 % 128).to_vec();
            for ((sum, a), b) in sums.iter_mut().zip(&expected).zip(lanes.response(path)) {
                let d = b - a;
                *sum = [sum[0] + a.abs(), sum[1] + d, sum[2] + d * d];
            }
            turned += usize::from((expected[0] - lanes.response(path)[0]).abs() > 1e-3 * expected[0]);
        }
        // As in `lanes.rs`: the camera's ray may be sampled elsewhere.
        assert!(turned <= 16 * 128 / 6, "{name}: {turned} paths are others");
        for [sum, difference, square] in sums {
            let noise = 4.5 * f64::sqrt(square) + 1e-5 * sum;
            assert!(difference.abs() <= noise, "{name}: off by {} of {sum:e}", difference / sum);
        }
        // A walk of the first channel alone, and with one that absorbs more everywhere.
        let darker = World {
            materials: worlds[0].materials.iter().map(|m| Material { mu_a: 1.5 * m.mu_a, ..*m }).collect(),
            ..worlds[0].clone()
        };
        let two = [worlds[0].clone(), darker];
        let all = Channels { worlds: &two, ..all };
        let together = Group::of(all, vec![0, 1]);
        // The same world, in which only what is used is listed.
        let alone = Group { channels: vec![0], shared: None, ..together.clone() };
        let walked = |group: &Group| {
            let mut walker = Walker::new(self::setting(&rig, group, &steady, 7), named(""));
            packet::walk(&mut walker, 0..16, 0..16);
            (0..256).map(|path| walker.response_in(path, 0).to_vec()).collect::<Vec<_>>()
        };
        for (path, (a, b)) in walked(&together).iter().zip(walked(&alone)).enumerate() {
            // Estimates at divergent flights go one by one beside others, and by a queue alone: another order of sums.
            let same = a.iter().zip(&b).all(|(a, b)| (a - b).abs() <= 1e-12 * b.abs().max(1e-12));
            assert!(same, "{name}: path {path} brings {a:?}, alone {b:?}");
        }
    }
}
