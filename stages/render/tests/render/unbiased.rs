//! The line estimator, in lanes, against point next-event estimation at every collision, in scenes that try to mislead it.

use glam::{DVec2, DVec3};
use turbid_optics::view::View;
use turbid_render::camera::Camera;
use turbid_render::lamp::Steady;
use turbid_render::level::named;
use turbid_render::light::{Carrier, Light};
use turbid_render::moments::Moments;
use turbid_render::packet;
use turbid_render::path::{Nee, Setting, Walker};
use turbid_render::projected_images::ProjectedImages;
use turbid_render::single::Frame;
use turbid_render::world::World;

use crate::odd_worlds::*;

/// How far the line estimator's mean image is from the other's.
pub struct Difference {
    /// Relative, and its standard error.
    pub bias: f64,
    pub error: f64,
    /// Of the line estimator's alone.
    pub precision: f64,
    /// Pixel by pixel and response by response (1, re, im, steady), in standard errors.
    pub scores: Vec<f64>,
}

/// Differences over scenes, weighed by their errors.
#[derive(Default)]
pub struct Pool {
    sum: f64,
    weights: f64,
}

impl Pool {
    pub fn add(&mut self, found: &Difference) {
        let weight = found.error.powi(-2);
        (self.sum, self.weights) = (self.sum + weight * found.bias, self.weights + weight);
    }

    /// Bias and its standard error.
    pub fn bias(&self) -> (f64, f64) {
        (self.sum / self.weights, self.weights.sqrt().recip())
    }

    /// No bias to 4 standard errors, of which that many are `most`: so small a bias shows.
    fn is_unbiased(&self, most: f64) {
        let (bias, error) = self.bias();
        println!("all: {bias:+.5} +- {error:.5}");
        assert!(bias.abs() < 4.0 * error, "all scenes differ by {bias} +- {error}");
        assert!(4.0 * error < most, "too noisy to tell: {error}");
    }
}

#[test]
fn line_and_point_estimators_agree() {
    let mut pool = Pool::default();
    for (name, world) in scenes() {
        // Light at rough walls is found by a few paths only.
        let paths = if name.starts_with("frosted") { 4000 } else { 1000 };
        pool.add(&compare(&lamps(), name, &world, paths));
    }
    pool.is_unbiased(0.02);
}

#[test]
fn line_and_point_estimators_agree_in_shapes() {
    let mut pool = Pool::default();
    for (name, world) in shaped_scenes() {
        pool.add(&compare(&lamps(), name, &world, 1000));
    }
    pool.is_unbiased(0.05);
}

#[test]
fn line_and_point_estimators_agree_at_curved_walls() {
    let mut pool = Pool::default();
    for (name, world) in curved_scenes() {
        pool.add(&compare(&lamps(), name, &world, 2000));
    }
    // Connections that are found by manifold sampling have heavy tails.
    pool.is_unbiased(0.12);
}

/// Without lamps, which are connected one by one: flights go on across boundaries in lanes.
#[test]
fn line_and_point_estimators_agree_without_lamps() {
    let several = scenes().into_iter().filter(|(name, _)| CROSSED.contains(name));
    // The bore ends where the floor begins.
    let tube = turbid_optics::solid::Solid::tube(4.0, 6.0, DVec2::ZERO, -1.5, 0.0);
    let floor = turbid_optics::solid::Solid::Slab { bottom: -20.0, top: -1.5 };
    let bulb = ball([0.4, 0.0, -0.7], 0.8);
    let on_floor =
        ("tube on another floor, a ball in its bore", world(vec![(bulb, CORE), (tube, TISSUE), (floor, PALE)]));
    let mut pool = Pool::default();
    for (name, world) in hollow_scenes().into_iter().chain(several).chain([on_floor]) {
        pool.add(&compare(&Steady::NONE, name, &world, 2000));
    }
    pool.is_unbiased(0.05);
}

/// Weight windows split paths towards the projector, or the first lamp, whatever else shines.
#[test]
fn line_and_point_estimators_agree_under_narrow_peaks() {
    let mut pool = Pool::default();
    for (name, world) in peaked_scenes() {
        for steady in [Steady::NONE, lamps()] {
            pool.add(&compare(&steady, name, &world, 2000));
        }
    }
    pool.is_unbiased(0.05);
}

#[test]
fn line_and_point_estimators_agree_for_two_terms() {
    let mut pool = Pool::default();
    for (name, world) in two_term_scenes() {
        for steady in [Steady::NONE, lamps()] {
            pool.add(&compare(&steady, name, &world, 1000));
        }
    }
    pool.is_unbiased(0.05);
}

/// Light-directed branches go towards the projector, and are connected to lamps too.
#[test]
fn line_and_point_estimators_agree_with_light_branches_and_lamps() {
    let mut pool = Pool::default();
    for (name, world) in hollow_scenes() {
        pool.add(&compare(&lamps(), name, &world, 4000));
    }
    pool.is_unbiased(0.05);
}

/// Scenes in which many flights cross boundaries.
const CROSSED: [&str; 4] = ["dome", "buried ball under a dye", "air gap", "hole"];

/// The two differ by nothing but noise: z over all scores has rms 1 and no outlier.
fn compare(steady: &Steady, name: &str, world: &World, paths: u32) -> Difference {
    let found = difference(steady, name, world, paths, 0);
    let Difference { bias, error, precision, ref scores } = found;
    let rms = (scores.iter().map(|z| z * z).sum::<f64>() / scores.len() as f64).sqrt();
    let worst = scores.iter().fold(0.0, |worst: f64, z| worst.max(z.abs()));
    println!("{name}: {bias:+.4} +- {error:.4}, of pixels rms {rms:.2}, worst {worst:.2}; one image to {precision:.4}");
    // 16 independent pixels of 3 or 4 correlated responses: rms of z has a spread of about 0.15.
    assert!(bias.abs() < 4.0 * error, "{name}: images differ by {bias} +- {error}");
    assert!((0.5..1.5).contains(&rms) && worst < 4.5, "{name}: rms z {rms}, worst {worst}");
    found
}

/// Of `paths` paths by the line estimator, and by the other, for each of 4 x 4 pixels: tilted camera and light, a lit field that ends within the view. Each series has random numbers
/// of its own.
pub fn difference(steady: &Steady, name: &str, world: &World, paths: u32, series: u32) -> Difference {
    let view = |position: [f64; 3], field: f64| {
        View::new(position.into(), DVec3::ZERO, DVec3::Y, DVec2::splat(field)).unwrap()
    };
    let camera = Camera { view: view([4.0, -3.0, 25.0], 5.0), columns: 4, rows: 4 };
    let light = Light::new(view([-9.0, 8.0, 20.0], 6.0), 1.0, false);
    let carriers = [Carrier::new(0.15, 20.0)];
    let numbers = if steady.shines() { 4 } else { 3 };
    let render = |nee: Nee| {
        let seed = if nee == Nee::Line { 1 } else { 2 };
        let setting = Setting {
            world,
            camera: &camera,
            light: &light,
            steady,
            carriers: &carriers,
            projected_images: &ProjectedImages::NONE,
            key: [seed, series],
            channel: 0,
            nee,
            shared: None,
        };
        let mut walker = Walker::new(setting, named(""));
        let light_branches = Frame::of(&walker).is_some_and(|frame| !frame.light_branches.is_empty());
        let hollow = ["hollow sphere with two ports", "two-term tube"].contains(&name)
            || hollow_scenes().iter().any(|(hollow, _)| *hollow == name);
        assert_eq!(light_branches, nee == Nee::Line && hollow, "{name}");
        let mut moments = Moments::new(16, numbers);
        for sample in (0..paths).step_by(100) {
            packet::walk(&mut walker, 0..16, sample..sample + 100);
            for path in 0..1600 {
                moments.add(path / 100, walker.response(path));
            }
        }
        moments
    };
    let (line, point) = (render(Nee::Line), render(Nee::Point));
    let mut scores = Vec::new();
    let (mut sums, mut variances) = ([0.0; 2], [0.0; 2]);
    for (pixel, i) in (0..16).flat_map(|pixel| (0..numbers).map(move |i| (pixel, i))) {
        let [a, b] = [&line, &point].map(|m| (m.mean(pixel, i, paths), m.covariance(pixel, i, i, paths)));
        if i == 0 {
            sums = [sums[0] + a.0, sums[1] + b.0];
            variances = [variances[0] + a.1, variances[1] + b.1];
        }
        if a.1 + b.1 > 0.0 {
            scores.push((a.0 - b.0) / (a.1 + b.1).sqrt());
        }
    }
    let error = (variances[0] + variances[1]).sqrt() / sums[1];
    Difference { bias: sums[0] / sums[1] - 1.0, error, precision: variances[0].sqrt() / sums[0], scores }
}
