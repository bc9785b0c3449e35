//! A furnace: under an even sky of radiance 1 whatever absorbs nothing is as bright as the sky, whatever its walls.

use serde_json::json;
use turbid_contract::Cells;
use turbid_contract::payload::{Lamp, Medium, Object, Scene, Shape, Surface};

use crate::setup::*;

/// A slab of milk without absorption; all of the image is it.
fn furnace(n: f64, surface: Surface) -> Scene {
    let milk = Medium { n, ..medium(0.0, 2.0, 0.0) };
    let slab = Object { surface, ..object(Shape::Slab { top: 0.0, bottom: -3.0 }, "milk", 0) };
    let mut scene = scene(&[("milk", milk)], vec![slab], rig(1000.0, 0.0, 4.0, 4, 9.0));
    scene.projector = None;
    scene.lights = [("sky".to_owned(), Lamp::Ambient { radiance: vec![1.0] })].into();
    scene
}

/// Every path leaves and sees the sky with weight 1: what a slab loses shows whole. 1e-6: frames are f32.
fn assert_as_bright_as_the_sky(scene: &Scene, what: &str) {
    let frames = &run(scene, &json!({"f_x": [0], "samples": 64}), 1)["frames"];
    let layer = frames.find("radiance", None).unwrap();
    assert!(layer.data.iter().all(|&x| (x - 1.0).abs() < 1e-6), "{what}: {:?}", layer.data);
    assert!(layer.info.mean_se.is_some() && frames.se_unknown(&layer.info).is_none(), "{what}");
}

/// At walls of every roughness and index, which light crosses from both sides, and at smooth ones.
#[test]
fn walls_lose_no_light() {
    for n in [1.0, 1.1, 1.33, 1.4, 1.5, 2.0, 2.5] {
        assert_as_bright_as_the_sky(&furnace(n, Surface::Smooth), &format!("smooth, n {n}"));
        for alpha in [0.01, 0.1, 0.3, 0.6, 1.0] {
            assert_as_bright_as_the_sky(&furnace(n, Surface::Rough(alpha)), &format!("alpha {alpha}, n {n}"));
        }
    }
}

/// At rough walls within rough walls, from the denser side and from the thinner one, seen aslant.
#[test]
fn bodies_in_bodies_lose_no_light() {
    for (n, n_core) in [(1.33, 1.5), (1.5, 1.33), (2.5, 1.1)] {
        let mut scene = furnace(n, Surface::Rough(0.6));
        let core = Medium { n: n_core, ..medium(0.0, 1.0, 0.5) };
        scene.media.insert("core".to_owned(), core);
        let ball = object(Shape::Sphere { diameter: 2.5, center: [0.0, 0.0, -0.5] }, "core", 1);
        scene.objects.insert("ball".to_owned(), Object { surface: Surface::Rough(1.0), ..ball });
        let camera = scene.camera.as_mut().unwrap();
        (camera.position, camera.up) = ([900.0, 0.0, 100.0], [0.0, 0.0, 1.0]);
        assert_as_bright_as_the_sky(&scene, &format!("{n} around {n_core}"));
    }
}

/// Of a beam into the slab nothing is lost: it leaves upwards or downwards. A medium that absorbs nothing has absorbed nothing, with an interval in place of an
/// error of 0, and there is no other row.
#[test]
fn all_the_power_of_a_beam_leaves() {
    let photons = 20_000;
    let table = power_table(&beam_on(furnace(1.4, Surface::Rough(0.5))), photons, 4);
    let Cells::Text(names) = &table.columns[0].cells else { panic!("names") };
    assert_eq!(names[..], ["left upwards", "left downwards", "absorbed in a"]);
    let (share, se) = (table.f64s("share").unwrap(), table.maybe_f64s("share_se").unwrap());
    let [low, high] = ["share_low", "share_high"].map(|name| table.f64s(name).unwrap());
    assert!((share[0] + share[1] - 1.0).abs() < 1e-12 && share[0] > 0.5 && share[1] > 0.01, "{share:?}");
    assert_eq!((share[2], se[2], low[2]), (0.0, None, 0.0));
    // 1 - 0.025^(1 / n) of nothing.
    assert!((high[2] * f64::from(photons) / 3.689 - 1.0).abs() < 1e-3, "{}", high[2]);
}
