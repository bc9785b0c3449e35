//! Paths in lanes are the paths of the scalar walker, bit for bit, whatever the vector instructions.

use glam::{DVec2, DVec3};
use turbid_optics::view::View;
use turbid_render::camera::Camera;
use turbid_render::flock;
use turbid_render::lamp::Steady;
use turbid_render::level::named;
use turbid_render::light::{Carrier, Light};
use turbid_render::path::{Nee, Setting, Walker};

use crate::unbiased::{lamps, scenes};

/// In every odd scene, for whole and partial bundles, from channels and samples beyond the first.
#[test]
fn lanes_and_levels_do_not_show() {
    let view = |position: [f64; 3], field: f64| {
        View::new(position.into(), DVec3::ZERO, DVec3::Y, DVec2::splat(field)).unwrap()
    };
    let camera = Camera { view: view([4.0, -3.0, 25.0], 5.0), columns: 4, rows: 4 };
    let light = Light::new(view([-9.0, 8.0, 20.0], 6.0), 1.0, false);
    let carriers = [Carrier::new(0.15, 20.0), Carrier::new(0.3, 110.0)];
    for ((name, world), steady) in scenes().into_iter().flat_map(|s| [(s.clone(), Steady::NONE), (s, lamps())]) {
        let setting = Setting {
            world: &world,
            camera: &camera,
            light: &light,
            steady: &steady,
            carriers: &carriers,
            key: [7, 0],
            channel: 3,
            nee: Nee::Line,
        };
        for (pixels, samples) in [(0..16, 8..16), (5..6, 0..3)] {
            let mut alone = Walker::new(setting, named(""));
            let (mut expected, mut seen) = (Vec::new(), false);
            for (pixel, sample) in pixels.clone().flat_map(|p| samples.clone().map(move |s| (p, s))) {
                expected.push(alone.path(pixel, sample).to_vec());
                seen |= expected.last().unwrap()[0] > 0.0;
            }
            assert!(seen || pixels.len() == 1, "{name} is dark");
            let flights = alone.take_flights();
            for level in ["baseline", "v3", "v4"] {
                let mut walker = Walker::new(setting, named(level));
                flock::walk(&mut walker, pixels.clone(), samples.clone());
                for (path, expected) in expected.iter().enumerate() {
                    assert_eq!(walker.response(path), expected, "{name}, {level}: path {path}");
                }
                assert_eq!(walker.take_flights(), flights, "{name}, {level}");
            }
        }
    }
}
