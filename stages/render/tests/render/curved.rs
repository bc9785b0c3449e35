//! Smooth refraction at curved and tilted walls, and at facets.

use std::collections::BTreeMap;

use serde_json::json;
use turbid_contract::payload::{Lamp, Medium, Mesh, Object, Payload, Scene, Shape, Specular, Surface};
use turbid_contract::{Known, Problems, StageRow};
use turbid_render::RenderStage;

use crate::setup::*;
use crate::shapes::{Triangles, block, icosphere, ring};

fn wet(mu_a: f64, mu_s: f64, g: f64) -> Medium {
    Medium { n: 1.4, ..medium(mu_a, mu_s, g) }
}

/// Pixel by pixel and layer by layer.
fn scores(a: &Scene, b: &Scene, samples: u32) -> Vec<f64> {
    let params = json!({"f_x": [0, 0.1], "samples": samples, "method": "path"});
    let (a, b) = (&run(a, &params, 1)["frames"], &run(b, &params, 2)["frames"]);
    let of = |stack: &turbid_contract::ImageStack, name: &str| -> Vec<f64> {
        let layers = stack.layers.iter().filter(|l| l.info.name == name);
        layers.flat_map(|l| l.data.iter().map(|&x| f64::from(x)).collect::<Vec<_>>()).collect()
    };
    let [av, bv] = [a, b].map(|s| of(s, "radiance"));
    let [ae, be] = [a, b].map(|s| of(s, "radiance_se"));
    let both = av.iter().zip(&bv).zip(ae.iter().zip(&be));
    both.map(|((a, b), (ea, eb))| (a - b) / f64::hypot(*ea, *eb)).collect()
}

/// From near by a ball of 200 m and the side of a box turned by 90 degrees are a half-space, whose light comes through planes by closed
/// forms: over the view of 8 mm the ball falls off by 0.2 um.
#[test]
fn large_balls_and_turned_boxes_look_like_slabs() {
    let (mut camera, mut projector) = rig(80.0, 9.0, 8.0, 6, 40.0);
    camera.specular = Some(Specular::Exclude);
    camera.position[0] = 40.0;
    projector.position[0] = -30.0;
    let with = |shape: Shape| {
        scene(&[("m", wet(0.05, 2.0, 0.7))], vec![object(shape, "m", 0)], (camera.clone(), projector.clone()))
    };
    let ball = Shape::Sphere { diameter: 2e5, center: [0.0, 0.0, -1e5] };
    let side = Shape::Box { size: [2000.0, 2e3, 2e3], center: [0.0, 0.0, -1000.0] };
    let turned = Shape::Turned { shape: Box::new(side), about: [0.0, 0.0, -1000.0], rotation_deg: [0.0, 90.0, 0.0] };
    for (name, shape) in [("ball", ball), ("box", turned)] {
        let z = scores(&with(shape), &with(FLOOR), 500);
        let n = z.len() as f64;
        let (mean, rms) = (z.iter().sum::<f64>() / n, (z.iter().map(|z| z * z).sum::<f64>() / n).sqrt());
        let worst = z.iter().fold(0.0, |worst: f64, z| worst.max(z.abs()));
        // Four frames of a pixel share its paths: 36 independent pixels of about two independent values.
        assert!(mean.abs() < 4.0 / 36f64.sqrt() && worst < 4.5, "{name}: mean z {mean}, worst {worst}");
        assert!((rms - 1.0).abs() < 3.0 / (2.0 * 72f64).sqrt(), "{name}: rms z {rms}");
    }
}

/// A box of facets is a box, pixel by pixel: half in a slab, turned, and with another index than what it lies in.
#[test]
fn a_box_of_facets_is_a_box() {
    let (low, high) = ([-1.5, -1.5, -1.5], [1.5, 2.5, 0.5]);
    let (mut camera, mut projector) = rig(40.0, 9.0, 6.0, 6, 14.0);
    camera.specular = Some(Specular::Exclude);
    camera.position[0] = 6.0;
    projector.position[0] = -8.0;
    let media = [("m", wet(0.05, 2.0, 0.7)), ("core", Medium { n: 1.5, ..medium(0.3, 4.0, 0.5) })];
    let with = |shape: Shape| {
        let shape =
            Shape::Turned { shape: Box::new(shape), about: [0.0, 0.5, -0.5], rotation_deg: [10.0, -25.0, 40.0] };
        let objects = vec![object(shape, "core", 1), object(FLOOR, "m", 0)];
        scene(&media, objects, (camera.clone(), projector.clone()))
    };
    let cuboid = Shape::Box { size: [3.0, 4.0, 2.0], center: [0.0, 0.5, -0.5] };
    let z = scores(&with(mesh(block(low.into(), high.into()))), &with(cuboid), 300);
    let n = z.len() as f64;
    let (mean, rms) = (z.iter().sum::<f64>() / n, (z.iter().map(|z| z * z).sum::<f64>() / n).sqrt());
    let worst = z.iter().fold(0.0, |worst: f64, z| worst.max(z.abs()));
    println!("mean z {mean}, rms {rms}, worst {worst}");
    // Four frames of a pixel share its paths: 36 independent pixels of about two independent values.
    assert!(mean.abs() < 4.0 / 36f64.sqrt() && worst < 4.5, "mean z {mean}, worst {worst}");
    assert!((rms - 1.0).abs() < 3.0 / (2.0 * 72f64).sqrt(), "rms z {rms}");
}

/// Of clear meshes `check` warns, of turbid ones it has nothing to say; smooth walls that meet rough ones it refuses. The plan knows that facets cost.
#[test]
fn clear_meshes_are_warned_of() {
    let told = |mu_s: f64, shape: Shape, beside: Option<Object>| {
        let (mut camera, projector) = rig(40.0, 9.0, 6.0, 6, 14.0);
        camera.specular = Some(Specular::Exclude);
        let mut objects = vec![object(shape, "m", 1)];
        objects.extend(beside);
        let scene = scene(&[("m", wet(0.1, mu_s, 0.7)), ("n", wet(0.1, 2.0, 0.7))], objects, (camera, projector));
        let mut known = Known::default();
        known.insert("scene", scene.into_artifact());
        let params = json!({"f_x": [0], "samples": 64, "method": "path"});
        let (row, mut problems) = (StageRow::of::<RenderStage>(), Problems::default());
        row.check(&params, &known, &mut problems);
        let (errors, warnings) = problems.into_parts();
        (errors, warnings, (row.prepare)(&params).unwrap().plan(&known).seconds.unwrap())
    };
    // 2 mm across: 1.0 and 4.2 mean free paths.
    let lump = || mesh(icosphere(1.0, [0.0; 3].into(), 2));
    let ball = Shape::Sphere { diameter: 2.0, center: [0.0; 3] };
    let (errors, warnings, _) = told(0.4, lump(), None);
    assert!(errors.is_empty() && warnings.len() == 1, "{errors:?} {warnings:?}");
    assert!(warnings[0].message.contains("so clear"), "{warnings:?}");
    let ((errors, warnings, of_facets), (.., of_ball)) = (told(2.0, lump(), None), told(2.0, ball, None));
    assert!(errors.is_empty() && warnings.is_empty(), "{errors:?} {warnings:?}");
    assert!(of_facets > 2.0 * of_ball, "{of_facets} s, {of_ball} s");
    let rough = Object { surface: Surface::Rough(0.3), ..object(FLOOR, "n", 0) };
    let (errors, ..) = told(2.0, lump(), Some(rough));
    assert!(errors.len() == 1 && errors[0].message.contains("smooth and rough walls"), "{errors:?}");
}

/// Facets spread light over single pixels otherwise than the ball that they stand for, but bring as much of it: 20,480 triangles lie within
/// (facet / radius)^2 / 8 = 4e-5 of its radius. Means over a disc of its image, beside which it mirrors light onto a slab, and over that.
#[test]
fn a_ball_of_facets_is_as_bright_as_a_ball() {
    let (mut camera, mut projector) = rig(40.0, 9.0, 9.0, 6, 14.0);
    camera.specular = Some(Specular::Exclude);
    projector.position[0] = -8.0;
    let media = [("m", wet(0.05, 2.0, 0.7)), ("core", wet(0.3, 4.0, 0.5))];
    let of = |shape: Shape, seed: u64| {
        let objects = vec![object(shape, "core", 1), object(FLOOR, "m", 0)];
        let scene = scene(&media, objects, (camera.clone(), projector.clone()));
        let frames = &run(&scene, &json!({"f_x": [0], "samples": 300, "method": "path"}), seed)["frames"];
        let [value, se] = ["radiance", "radiance_se"].map(|name| frames.find(name, Some(0.0)).unwrap().data.clone());
        // On the ball, and beside it.
        [true, false].map(|on| {
            let inside = |i: usize| {
                let (x, y) = ((i % 6) as f64 - 2.5, (i / 6) as f64 - 2.5);
                (x.hypot(y) < 1.8) == on
            };
            let chosen: Vec<usize> = (0..36).filter(|&i| inside(i)).collect();
            let n = chosen.len() as f64;
            let mean = chosen.iter().map(|&i| f64::from(value[[i / 6, i % 6]])).sum::<f64>() / n;
            let square = chosen.iter().map(|&i| f64::from(se[[i / 6, i % 6]]).powi(2)).sum::<f64>();
            (mean, square.sqrt() / n)
        })
    };
    let facets = of(mesh(icosphere(3.0, [0.0; 3].into(), 5)), 1);
    let ball = of(Shape::Sphere { diameter: 6.0, center: [0.0; 3] }, 2);
    for ((a, a_se), (b, b_se)) in facets.into_iter().zip(ball) {
        let z = (a - b) / f64::hypot(a_se, b_se);
        println!("facets {a} +- {a_se}, ball {b} +- {b_se}: z {z:.2}");
        assert!(z.abs() < 4.0, "facets {a} +- {a_se}, ball {b} +- {b_se}");
        assert!(a_se < 0.04 * a && b_se < 0.04 * b, "{a} +- {a_se}, {b} +- {b_se}");
    }
}

fn odd_objects() -> Vec<Object> {
    vec![
        object(Shape::Slab { top: 0.0, bottom: -4.0 }, "m", 0),
        object(Shape::Spheroid { diameters: [4.0, 4.0, 6.0], center: [1.0, 1.0, 0.3] }, "core", 1),
        object(Shape::Box { size: [1.5, 1.5, 1.5], center: [-2.2, 0.5, 0.75] }, "m", 2),
        object(
            Shape::Tube { inner_diameter: 2.0, outer_diameter: 3.4, top: 1.0, bottom: -1.0, center: [-1.0, -3.0] },
            "glass",
            3,
        ),
        lambertian(Shape::Slab { top: -5.0, bottom: -9.0 }, 0.8),
    ]
}

fn mesh((vertices, triangles): Triangles) -> Shape {
    Shape::Mesh(Mesh { vertices, triangles }.into())
}

/// Meshes in, on and over a slab, one in another.
fn facetted_objects() -> Vec<Object> {
    vec![
        object(Shape::Slab { top: 0.0, bottom: -4.0 }, "m", 0),
        object(mesh(icosphere(2.0, [1.0, 1.0, 0.3].into(), 3)), "core", 1),
        object(mesh(block([-3.0, -0.3, -0.1].into(), [-1.4, 1.3, 1.5].into())), "m", 2),
        object(mesh(ring(0.8, 1.5, 0.9, 24)), "glass", 3),
        lambertian(Shape::Slab { top: -5.0, bottom: -9.0 }, 0.8),
    ]
}

/// All that enters a scene without absorption leaves it with its weight: an even sky is seen as itself, in all pixels, whatever walls
/// bend, reflect or trap the light.
#[test]
fn a_furnace_shows_no_walls() {
    let media = [
        ("m", wet(0.0, 2.0, 0.7)),
        ("core", wet(0.0, 1.0, -0.3)),
        ("glass", Medium { n: 1.5, ..medium(0.0, 0.1, 0.5) }),
    ];
    for objects in [odd_objects(), facetted_objects()] {
        let objects = objects.into_iter().filter(|o| o.medium.is_some()).collect();
        let mut sky = scene(&media, objects, rig(40.0, 0.0, 10.0, 4, 9.0));
        sky.projector = None;
        sky.lights = BTreeMap::from([("sky".to_owned(), Lamp::Ambient { radiance: vec![1.0] })]);
        let frames = &run(&sky, &json!({"f_x": [0], "samples": 200}), 3)["frames"];
        assert!(frames.find("radiance", Some(0.0)).unwrap().data.iter().all(|&x| x == 1.0));
    }
}

/// Camera and projector may change places, among bodies of every shape between which light is bent and mirrored. Pixels and projector
/// fields cover the same solid angles with as many paths, so both images have the same mean.
#[test]
fn places_may_change_across_curved_walls() {
    let media = [
        ("m", wet(0.3, 2.0, 0.8)),
        ("core", wet(0.5, 3.0, 0.5)),
        ("glass", Medium { n: 1.5, ..medium(0.3, 3.0, 0.0) }),
    ];
    let (mut camera, mut projector) = rig(40.0, 0.0, 9.0, 4, 7.0);
    camera.position = [20.0, 3.0, 30.0];
    camera.specular = Some(Specular::Exclude);
    projector.position = [-6.0, 24.0, 30.0];
    projector.look_at = [0.0, 0.5, 0.0];
    let (mut swapped_camera, mut swapped_projector) = (camera.clone(), projector.clone());
    (swapped_camera.position, swapped_camera.look_at) = (projector.position, projector.look_at);
    (swapped_projector.position, swapped_projector.look_at) = (camera.position, camera.look_at);
    (swapped_camera.field, swapped_projector.field) = (projector.field, camera.field);
    for view in [&mut projector, &mut swapped_projector] {
        view.profile = turbid_contract::payload::Profile::UniformIntensity;
    }
    for objects in [odd_objects(), facetted_objects()] {
        let there = scene(&media, objects.clone(), (camera.clone(), projector.clone()));
        let (a, a_se) = dc(&there, 2400, 7);
        let (b, b_se) = dc(&scene(&media, objects, (swapped_camera.clone(), swapped_projector.clone())), 2400, 8);
        let z = (a - b) / f64::hypot(a_se, b_se);
        println!("{a:e} +- {a_se:e}, swapped {b:e} +- {b_se:e}: z {z:.2}");
        assert!(z.abs() < 4.0, "{a} +- {a_se}, swapped {b} +- {b_se}");
        assert!(a_se < 0.05 * a && b_se < 0.05 * b, "{a} +- {a_se}, {b} +- {b_se}");
    }
}

/// `pipelines/checks/curved_wall.yaml`: single scattering along the axis of a spheroid whose pole, of radius of curvature 10 mm, narrows a bundle
/// of light at depth z by 1 - z (n - 1) / (n R). Simpson's rule; the finite distance of 100 m changes it by 3e-5.
#[test]
fn a_pole_focuses_by_its_curvature() {
    let (mut camera, projector) = rig(1e5, 0.0, 0.02, 4, 200.0);
    camera.specular = Some(Specular::Exclude);
    let polyp = Shape::Spheroid { diameters: [40.0, 40.0, 80.0], center: [0.0, 0.0, -40.0] };
    let dark = scene(&[("dye", wet(0.5, 5e-7, 0.0))], vec![object(polyp, "dye", 0)], (camera, projector));
    let (mean, se) = dc(&dark, 1000, 1);
    let (n, depth) = (20_000, 20.0);
    let focused = |i: u32| {
        let z = depth * f64::from(i) / f64::from(n);
        let weight = if i == 0 || i == n { 1.0 } else { f64::from(2 + 2 * (i % 2)) };
        weight * (-z).exp() / (1.0 - z * 0.4 / 14.0).powi(2) * depth / f64::from(3 * n)
    };
    let passes = 1.0 - (0.4f64 / 2.4).powi(2);
    let emission = 0.5 * 5.0 / (200.0 * 200.0) * 5e-7 / (4.0 * std::f64::consts::PI);
    let expected = emission * (passes / 1.4).powi(2) * (0..=n).map(focused).sum::<f64>();
    assert!((mean - expected).abs() < 4.5 * se + 1e-4 * expected, "{mean:e} +- {se:e}, {expected:e}");
    assert!(se < 3e-3 * expected, "{se:e} of {expected:e}");
}
