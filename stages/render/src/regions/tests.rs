use std::collections::BTreeMap;
use std::sync::Arc;

use turbid_contract::payload::{Camera, Medium, Object, Profile, Projection, Projector, Shape, Surface};

use super::*;

const SIDE: u32 = 40;

fn object(shape: Shape, medium: &str, priority: i32) -> Object {
    Object { shape, medium: Some(medium.to_owned()), priority, surface: Surface::Smooth }
}

/// Seen from straight above in pixels of 1 mm at z = 0, in parallel; lit from `light`.
fn scene(objects: Vec<(&str, Object)>, light: [f64; 3]) -> Scene {
    let medium = |mu_a: f64| Medium {
        mu_a: vec![mu_a],
        mu_s: vec![5.0],
        phase: turbid_contract::payload::PhaseFunction::HenyeyGreenstein(0.8),
        n: 1.0,
    };
    let camera = Camera {
        position: [0.0, 0.0, 300.0],
        look_at: [0.0; 3],
        up: [0.0, 1.0, 0.0],
        field: [f64::from(SIDE); 2],
        pixels: [SIDE; 2],
        specular: None,
        projection: Projection::Orthographic,
        distortion: None,
        aperture: None,
    };
    let projector = Projector {
        position: light,
        look_at: [0.0; 3],
        up: [0.0, 1.0, 0.0],
        field: [400.0; 2],
        power: vec![5.0],
        profile: Profile::Flat,
        pixels: None,
        distortion: None,
    };
    Scene {
        wavelengths_nm: Vec::new(),
        media: [("m".to_owned(), medium(0.05)), ("dark".to_owned(), medium(0.3))].into(),
        objects: objects.into_iter().map(|(name, o)| (name.to_owned(), o)).collect(),
        camera: Some(camera),
        projector: Some(projector),
        lights: BTreeMap::new(),
        detectors: BTreeMap::new(),
    }
}

fn found(scene: &Scene) -> Vec<Region> {
    let params = serde_json::from_value(serde_json::json!({"f_x": [0.1]})).expect("all others have defaults");
    let projected = Projected::sinusoids(&params, false);
    regions(scene, &Rig::of(scene).expect("it has a camera"), &projected, &Arc::new(Fringes::carriers(1)))
}

/// Of a pixel's middle, mm.
fn place(pixel: u32) -> (f64, f64) {
    let half = 0.5 * (f64::from(SIDE) - 1.0);
    (f64::from(pixel % SIDE) - half, half - f64::from(pixel / SIDE))
}

fn slab() -> Object {
    object(Shape::Slab { top: 0.0, bottom: -500.0 }, "m", 0)
}

/// Half a ball of radius 12 on a slab: two regions, the ball's well within its outline, the slab's outside of it, none with a pixel that the outline touches, and both
/// nearly up to it. Guides are those of the place: E cos, and the phase of the plane below.
#[test]
fn a_dome_and_what_is_around_are_two() {
    let ball = Shape::Sphere { diameter: 24.0, center: [0.0; 3] };
    let regions = found(&scene(vec![("slab", slab()), ("tip", object(ball, "dark", 1))], [0.0, 0.0, 300.0]));
    let names: Vec<&str> = regions.iter().map(|r| r.name.as_str()).collect();
    assert_eq!(names, ["slab", "tip"]);
    let radii =
        |region: &Region| -> Vec<f64> { region.pixels.iter().map(|&p| place(p)).map(|(x, y)| x.hypot(y)).collect() };
    let (outside, inside) = (radii(&regions[0]), radii(&regions[1]));
    let least = outside.iter().copied().fold(f64::INFINITY, f64::min);
    let most = inside.iter().copied().fold(0.0, f64::max);
    assert!((12.7..15.0).contains(&least) && (8.0..11.3).contains(&most), "{least} {most}");
    for (i, &pixel) in regions[1].pixels.iter().enumerate() {
        let (x, y) = place(pixel);
        let r = DVec3::new(x, y, (144.0 - x * x - y * y).sqrt());
        let to_light = DVec3::new(0.0, 0.0, 300.0) - r;
        // Flat on the plane: 300^2 / cos^3 / distance^2, per unit of irradiance.
        let (distance, cos) = (to_light.length(), to_light.normalize().z);
        let expected = 300.0 * 300.0 / cos.powi(3) / (distance * distance) * to_light.normalize().dot(r / 12.0);
        let guide = regions[1].guide(i);
        assert!((guide.gain / expected - 1.0).abs() < 1e-9, "{} {expected}", guide.gain);
        let on_plane = 300.0 * x / (300.0 - r.z);
        let phase = std::f64::consts::TAU * 0.1 * on_plane;
        assert!((guide.phases[0].0 - phase.sin()).abs() < 1e-9 && (guide.phases[0].1 - phase.cos()).abs() < 1e-9);
    }
}

/// A wall 10 mm high, lit at 45 degrees, throws a shadow as long: no pixel of a region is in it or touches it.
#[test]
fn shadows_belong_to_no_region() {
    let wall = Shape::Box { size: [2.0, 20.0, 10.0], center: [8.0, 0.0, 5.0] };
    let objects = vec![("slab", slab()), ("wall", object(wall, "m", 1))];
    let regions = found(&scene(objects, [150.0, 0.0, 150.0]));
    assert_eq!(regions.len(), 1);
    for (x, y) in regions[0].pixels.iter().map(|&p| place(p)) {
        // The edge's top at x = 9 and 7 is seen from the light on z = 0 at 9 - 10 (150 - 9) / 140 = -1.07 and -3.21; along y it is wider by 150 / 140.
        assert!(!((-3.7..9.5).contains(&x) && y.abs() < 10.9), "({x}, {y})");
    }
    let near = regions[0].pixels.iter().map(|&p| place(p)).filter(|(x, y)| y.abs() < 5.0 && *x < 0.0);
    let nearest = near.map(|(x, _)| x).fold(f64::NEG_INFINITY, f64::max);
    assert!(nearest > -6.0, "the shadow ends at -3.21, the region at {nearest}");
}

/// A ball of 6 mm, 2 mm below the surface, parts what is above it from what is not.
#[test]
fn what_is_below_parts_regions() {
    let ball = |z: f64| object(Shape::Sphere { diameter: 6.0, center: [0.0, 0.0, z] }, "dark", 1);
    let near = |z: f64| {
        let regions = found(&scene(vec![("slab", slab()), ("ball", ball(z))], [0.0, 0.0, 300.0]));
        assert_eq!(regions.len(), 1);
        let radii = regions[0].pixels.iter().map(|&p| place(p)).map(|(x, y)| x.hypot(y));
        radii.fold(f64::INFINITY, f64::min)
    };
    // Above the ball are too few pixels for a region of their own; 30 mm below it does not show.
    assert!((3.7..5.5).contains(&near(-5.0)), "{}", near(-5.0));
    assert!(near(-33.0) < 1.0);
}

/// A bore has a region with an axis; a facet beyond its light, none.
#[test]
fn a_bore_has_an_axis() {
    let tube = Shape::Tube { inner_diameter: 30.0, outer_diameter: 60.0, center: [0.0; 2], bottom: -60.0, top: 0.0 };
    let mut scene = scene(vec![("tube", object(tube, "m", 0))], [0.0, 0.0, 100.0]);
    let camera = scene.camera.as_mut().expect("it has one");
    (camera.projection, camera.position) = (Projection::Pinhole, [0.0, 0.0, 60.0]);
    let regions = found(&scene);
    let bore: Vec<&Region> = regions.iter().filter(|r| r.chart == Chart::Axis).collect();
    assert_eq!(bore.len(), 1);
    assert!(bore[0].len() > 200, "{}", bore[0].len());
    let mut dark = scene.clone();
    dark.projector.as_mut().expect("it has one").field = [1.0; 2];
    assert!(found(&dark).is_empty());
}
