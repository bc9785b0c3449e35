//! Mirrors: symmetry, images, what is refused.

use std::f64::consts::PI;

use glam::DVec3;
use serde_json::json;
use turbid_contract::payload::{Camera, Lamp, Object, Payload, Scene, Shape, Specular, Surface};
use turbid_contract::{Known, Problems, StageRow};
use turbid_render::RenderStage;

use crate::setup::*;

fn mirror(shape: Shape) -> Object {
    Object { shape, medium: None, priority: 5, surface: Surface::Mirror }
}

fn lamp(position: [f64; 3]) -> Lamp {
    Lamp::Point { position, power: vec![4.0 * PI] }
}

fn lit_by(mut scene: Scene, lamps: &[[f64; 3]], specular: Specular) -> Scene {
    scene.projector = None;
    scene.camera.as_mut().unwrap().specular = Some(specular);
    scene.lights = lamps.iter().enumerate().map(|(i, &at)| (format!("l{i}"), lamp(at))).collect();
    scene
}

/// Radiances and standard errors, pixel by pixel.
fn pixels(scene: &Scene, samples: u32, seed: u64) -> Vec<(f64, f64)> {
    let ports = run(scene, &json!({"f_x": [0], "samples": samples, "method": "path"}), seed);
    let layer = |name| &ports["frames"].find(name, Some(0.0)).unwrap().data;
    let pairs = layer("radiance").iter().zip(layer("radiance_se").iter());
    pairs.map(|(&v, &se)| (f64::from(v), f64::from(se))).collect()
}

/// z scores of two images of independent noise: sd 1 +- 0.15 and none above 4.5, for 256 pixels.
fn agree(name: &str, a: &[(f64, f64)], b: &[(f64, f64)]) {
    let z: Vec<f64> = a.iter().zip(b).map(|(a, b)| (a.0 - b.0) / (a.1 * a.1 + b.1 * b.1).sqrt()).collect();
    let n = z.len() as f64;
    let mean = z.iter().sum::<f64>() / n;
    let sd = (z.iter().map(|z| z * z).sum::<f64>() / n).sqrt();
    let worst = z.iter().fold(0.0f64, |most, z| most.max(z.abs()));
    assert!(
        mean.abs() < 0.25 && (sd - 1.0).abs() < 0.15 && worst < 4.5,
        "{name}: mean {mean}, rms {sd}, worst {worst}"
    );
}

/// Half of a slab of tissue beside a mirror looks like the whole of it under the lamp and its mirror image. The mirror cuts the tissue in
/// two, so light is thrown through it, into it, and walks are turned by it. Also under a small roof between two mirrors that face each other
/// at a right angle: then there are three images.
#[test]
fn tissue_beside_mirrors_is_tissue_doubled() {
    let tissue = [("tissue", medium(0.1, 4.0, 0.7))];
    let slab = || object(Shape::Slab { top: 0.0, bottom: -6.0 }, "tissue", 0);
    let (camera, projector) = rig(60.0, 0.0, 8.0, 16, 40.0);
    let camera = Camera { position: [7.0, 5.0, 60.0], look_at: [4.5, 4.5, 0.0], ..camera };
    let at = [9.0, 4.0, 30.0];
    let wall = |center: [f64; 3]| mirror(Shape::Box { size: [200.0, 200.0, 200.0], center });
    let scene = |objects: Vec<Object>| scene(&tissue, objects, (camera.clone(), projector.clone()));
    let beside = lit_by(scene(vec![slab(), wall([-100.0, 0.0, 0.0])]), &[at], Specular::Exclude);
    let whole = lit_by(scene(vec![slab()]), &[at, [-9.0, 4.0, 30.0]], Specular::Exclude);
    agree("one", &pixels(&beside, 96, 1), &pixels(&whole, 96, 2));
    let mut corner = scene(vec![slab(), wall([-100.0, 0.0, 0.0]), wall([100.0, -100.0, 0.0])]);
    corner.objects.get_mut("c").unwrap().priority = 6;
    let images = [at, [-9.0, 4.0, 30.0], [9.0, -4.0, 30.0], [-9.0, -4.0, 30.0]];
    let whole = lit_by(scene(vec![slab()]), &images, Specular::Exclude);
    agree("two", &pixels(&lit_by(corner, &[at], Specular::Exclude), 192, 3), &pixels(&whole, 96, 4));
}

/// A Lambertian floor between two mirrors that face each other, 20 mm apart: lamp and floor have images at every 40 mm, whose light sums to that of
/// the row of lamps over an endless floor. In one small pixel, 4 standard errors; the row is cut where what is left, 1 / (3 (40 k)^3) per mm of row, is 1e-5 of it.
#[test]
fn facing_mirrors_make_a_row_of_lamps() {
    let rho = 1e-4;
    let (camera, projector) = rig(30.0, 0.0, 0.01, 1, 40.0);
    let camera = Camera { position: [1.0, 0.0, 30.0], look_at: [3.0, 2.0, 0.0], ..camera };
    let wall = |x: f64| mirror(Shape::Box { size: [100.0, 4e3, 400.0], center: [x, 0.0, 0.0] });
    let objects = vec![lambertian(FLOOR, rho), wall(-60.0), wall(60.0)];
    let scene = lit_by(scene(&[], objects, (camera, projector)), &[[4.0, -5.0, 12.0]], Specular::Exclude);
    let p = DVec3::new(3.0, 2.0, 0.0);
    let one = |x: f64| {
        let d = DVec3::new(x, -5.0, 12.0) - p;
        d.z / d.length().powi(3)
    };
    let row: f64 = (-3000..=3000).map(|k| one(4.0 + 40.0 * f64::from(k)) + one(16.0 + 40.0 * f64::from(k))).sum();
    let [(found, se)] = pixels(&scene, 30_000, 1)[..] else { panic!("one pixel") };
    let expected = rho / PI * row;
    assert!((found - expected).abs() < 4.0 * se + 1e-3 * expected, "{found} +- {se}, {expected}");
    assert!(se < 0.02 * expected, "{se}");
    // Without those by several mirrors it would be another figure.
    let by_one = rho / PI * (one(4.0) + one(16.0) + one(-24.0));
    assert!(expected - by_one > 10.0 * se, "{by_one}");
}

/// With albedo 1 everywhere and the same light from all sides the image is that light, exactly, whatever mirrors turn it.
#[test]
fn a_furnace_with_mirrors() {
    let white = [("white", medium(0.0, 0.8, 0.3))];
    let (camera, projector) = rig(80.0, 0.0, 30.0, 6, 40.0);
    let objects = vec![
        object(Shape::Sphere { diameter: 6.0, center: [0.0, 0.0, 6.0] }, "white", 0),
        mirror(Shape::Slab { top: 0.0, bottom: -5.0 }),
        mirror(Shape::Box { size: [4.0, 30.0, 30.0], center: [12.0, 0.0, 15.0] }),
        mirror(Shape::Sphere { diameter: 8.0, center: [-10.0, 2.0, 8.0] }),
    ];
    let mut scene = scene(&white, objects, (Camera { specular: Some(Specular::Include), ..camera }, projector));
    (scene.projector, scene.objects.get_mut("b").unwrap().priority) = (None, 1);
    scene.lights = [("sky".to_owned(), Lamp::Ambient { radiance: vec![3.0] })].into();
    for (radiance, se) in pixels(&scene, 16, 1) {
        assert!((radiance - 3.0).abs() < 1e-6 && se < 1e-6, "{radiance} +- {se}");
    }
    // Of light that mirrors alone have turned crossed polarisers let nothing pass; beside them the sky is seen.
    scene.camera.as_mut().unwrap().specular = Some(Specular::Exclude);
    let excluded = pixels(&scene, 16, 1);
    assert!(excluded.iter().any(|(radiance, _)| *radiance == 0.0), "{excluded:?}");
}

/// In a flat mirror the lamp is seen where its image is, with all of its light; a camera sees through it what it would see from its own image.
#[test]
fn a_mirror_shows_images() {
    let (camera, projector) = rig(100.0, 0.0, 90.0, 45, 40.0);
    let camera = Camera { position: [-10.0, 5.0, 120.0], look_at: [12.0, 8.0, 0.0], ..camera };
    let at = [60.0, 20.0, 90.0];
    let floor = mirror(Shape::Slab { top: 0.0, bottom: -9.0 });
    let bare = lit_by(scene(&[], vec![floor.clone()], (camera.clone(), projector.clone())), &[at], Specular::Include);
    let lit: Vec<f64> = pixels(&bare, 8, 1).into_iter().map(|p| p.0).filter(|v| *v > 0.0).collect();
    let d = DVec3::new(at[0], at[1], -at[2]) - DVec3::from(camera.position);
    let cos = -d.z / d.length();
    let t = camera.position[2] / -d.z;
    let expected = t * t / cos / 4.0;
    assert!(lit.len() == 1 && (lit[0] / expected - 1.0).abs() < 2e-7, "{lit:?} {expected}");
    // A white wall above, seen in the mirror: from below its image is the same, with rows upside down.
    let wall = |z: f64| lambertian(Shape::Box { size: [40.0, 30.0, 2.0], center: [20.0, 10.0, z] }, 0.5);
    let camera =
        Camera { field: [16.0, 16.0], pixels: [12; 2], position: [0.0, 0.0, 10.0], look_at: [5.0, 2.5, 0.0], ..camera };
    let lamp = [20.0, 10.0, 5.0];
    let by_mirror = scene(&[], vec![wall(30.0), floor], (camera.clone(), projector.clone()));
    let by_mirror = lit_by(by_mirror, &[lamp], Specular::Exclude);
    // Straight up through the plane z = 0 from the camera's image; lamp and its image light the wall.
    let below = Camera { position: [0.0, 0.0, -10.0], ..camera };
    let direct = scene(&[], vec![wall(30.0)], (below, projector));
    let direct = lit_by(direct, &[lamp, [20.0, 10.0, -5.0]], Specular::Exclude);
    let (a, b) = (pixels(&by_mirror, 64, 1), pixels(&direct, 64, 2));
    let mut lit = 0;
    for (i, (radiance, se)) in a.iter().enumerate() {
        let (row, column) = (i / 12, i % 12);
        // Seen from below left and right change places.
        let (other, other_se) = b[row * 12 + 11 - column];
        let off = (radiance - other).abs();
        assert!(off <= 5.0 * se.hypot(other_se) + 1e-6 * other, "row {row}, column {column}: {radiance} {other}");
        lit += usize::from(*radiance > 0.0);
    }
    assert!(lit > 20, "{lit}");
}

/// What is not found is refused by name; the plan says that there are mirrors.
#[test]
fn what_mirrors_would_need_is_named() {
    let told = |objects: Vec<Object>, specular| {
        let (camera, projector) = rig(60.0, 0.0, 8.0, 16, 40.0);
        let media = [
            ("tissue", medium(0.1, 4.0, 0.7)),
            ("wet", turbid_contract::payload::Medium { n: 1.4, ..medium(0.1, 4.0, 0.7) }),
        ];
        let scene = scene(&media, objects, (Camera { specular: Some(specular), ..camera }, projector));
        let mut known = Known::default();
        known.insert("scene", scene.into_artifact());
        let (row, params) = (StageRow::of::<RenderStage>(), json!({"f_x": [0], "samples": 64, "method": "path"}));
        let mut problems = Problems::default();
        row.check(&params, &known, &mut problems);
        let plan = (row.prepare)(&params).unwrap().plan(&known);
        assert!(plan.needs.iter().any(|n| n == "mirrors"), "{plan:?}");
        problems.into_parts().0.into_iter().map(|p| p.message).collect::<Vec<_>>()
    };
    let slab = |medium: &str| object(Shape::Slab { top: 0.0, bottom: -6.0 }, medium, 0);
    let wall = |x: f64| mirror(Shape::Box { size: [2.0, 20.0, 20.0], center: [x, 0.0, 11.0] });
    let ball = mirror(Shape::Sphere { diameter: 4.0, center: [0.0, 0.0, 9.0] });
    let cases = [
        (vec![slab("tissue"), wall(9.0)], Specular::Include, ""),
        (vec![slab("tissue"), ball.clone()], Specular::Exclude, ""),
        (vec![slab("tissue"), ball.clone()], Specular::Include, ""),
        (vec![ball, wall(9.0)], Specular::Include, ""),
        (vec![slab("tissue"), wall(9.0), wall(-9.0)], Specular::Exclude, ""),
        (vec![slab("tissue"), wall(9.0), wall(-9.0)], Specular::Include, "face each other"),
        (vec![slab("wet"), wall(9.0)], Specular::Exclude, ""),
    ];
    for (objects, specular, expected) in cases {
        let found = told(objects, specular);
        let right =
            if expected.is_empty() { found.is_empty() } else { found.len() == 1 && found[0].contains(expected) };
        assert!(right, "{expected}: {found:?}");
    }
}
