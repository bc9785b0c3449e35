//! Lamp reflections by closed forms: mirror images in planes, and against rays that look for a small ball of light.

use std::collections::BTreeMap;
use std::f64::consts::PI;

use glam::DVec3;
use serde_json::{Value, json};
use turbid_contract::ImageStack;
use turbid_contract::payload::{
    Aperture, Camera, Distortion, Lamp, Medium, Object, Payload, Projection, Scene, Shape, Specular, Surface,
};
use turbid_contract::{Known, Problems, StageRow};
use turbid_optics::fresnel;
use turbid_optics::philox::{philox4x32, unit};
use turbid_optics::refraction::refract;
use turbid_render::RenderStage;

use crate::setup::*;

pub const LAMP: [f64; 3] = [60.0, 20.0, 90.0];

fn glassy(top: f64, bottom: f64, medium: &str) -> Object {
    Object {
        shape: Shape::Slab { top, bottom },
        medium: Some(medium.to_owned()),
        priority: 0,
        surface: Surface::Smooth,
    }
}

pub fn glass(mu_a: f64, n: f64) -> Medium {
    Medium { n, ..medium(mu_a, 0.0, 0.0) }
}

/// A camera over slabs, a lamp of 1 W/sr, all reflexes seen.
pub fn shiny(media: &[(&str, Medium)], objects: Vec<Object>, camera: Camera) -> Scene {
    let (_, projector) = rig(100.0, 0.0, 40.0, 32, 40.0);
    let mut scene = scene(media, objects, (Camera { specular: Some(Specular::Include), ..camera }, projector));
    scene.projector = None;
    scene.lights = [("lamp".to_owned(), Lamp::Point { position: LAMP, power: vec![4.0 * PI] })].into();
    scene
}

pub fn camera() -> Camera {
    let (camera, _) = rig(100.0, 0.0, 90.0, 45, 40.0);
    Camera { position: [-10.0, 5.0, 120.0], look_at: [12.0, 8.0, 0.0], ..camera }
}

pub fn image(scene: &Scene) -> BTreeMap<(usize, usize), f64> {
    let ports = run(scene, &json!({"f_x": [0], "samples": 8}), 1);
    let layer = &ports["frames"].find("radiance", Some(0.0)).unwrap().data;
    layer.indexed_iter().filter(|(_, v)| **v != 0.0).map(|(at, &v)| (at, f64::from(v))).collect()
}

/// The only lit pixel.
pub fn only(scene: &Scene) -> ((usize, usize), f64) {
    let image = image(scene);
    assert_eq!(image.len(), 1, "{image:?}");
    image.into_iter().next().unwrap()
}

/// Over a black medium the mirror image of the lamp alone is seen: R(theta) / d^2 of its intensity at the pinhole, over the solid angle of the
/// pixel. For a pinhole that is A cos / D^2 of the ray to the field's plane. 2e-7 is the rounding to f32.
#[test]
fn a_plane_shows_the_mirror_image() {
    let black = [("ink", glass(1e3, 1.4))];
    let floor = vec![glassy(-3.0, -40.0, "ink")];
    let (lamp, top) = (DVec3::from(LAMP), -3.0);
    let mirrored = DVec3::new(lamp.x, lamp.y, 2.0 * top - lamp.z);
    let seen = |c: &Camera| {
        let d = mirrored - DVec3::from(c.position);
        let cos = -d.z / d.length();
        (d, fresnel::reflectance(1.0 / 1.4, cos) / d.length_squared(), cos)
    };
    let place = |x: f64, y: f64, c: &Camera| {
        let [columns, rows] = c.pixels.map(f64::from);
        (((0.5 - y / c.field[1]) * rows) as usize, ((x / c.field[0] + 0.5) * columns) as usize)
    };
    let c = camera();
    let scene = shiny(&black, floor.clone(), c.clone());
    let (d, irradiance, cos) = seen(&c);
    // Where the line to the mirror image meets the field's plane z = 0.
    let t = c.position[2] / -d.z;
    let on = DVec3::from(c.position) + t * d - DVec3::from(c.look_at);
    let pixel_area = 2.0 * 2.0;
    let expected = irradiance * (t * d).length_squared() / cos / pixel_area;
    let (pixel, found) = only(&scene);
    assert_eq!(pixel, place(on.x, on.y, &c));
    assert!((found / expected - 1.0).abs() < 2e-7, "{found} {expected}");
    // A fisheye sees angles: D^2 theta / sin(theta) of its field per solid angle.
    let fisheye = Camera { projection: Projection::Fisheye, ..c.clone() };
    let forward = DVec3::from(c.look_at) - DVec3::from(c.position);
    let angle = forward.angle_between(d);
    let (pixel_of_fisheye, found) = only(&shiny(&black, floor.clone(), fisheye));
    let expected = irradiance * forward.length_squared() * angle / angle.sin() / pixel_area;
    assert!((found / expected - 1.0).abs() < 2e-7, "fisheye {pixel_of_fisheye:?}: {found} {expected}");
    // Parallel rays: intensity R over the pixel's area across them, where the axis through the mirror image runs.
    let orthographic = Camera { projection: Projection::Orthographic, ..c.clone() };
    let axis = forward.normalize();
    let on = mirrored - mirrored.z / axis.z * axis - DVec3::from(c.look_at);
    let (pixel, found) = only(&shiny(&black, floor.clone(), orthographic.clone()));
    let expected = fresnel::reflectance(1.0 / 1.4, -axis.z) / (pixel_area * -axis.z);
    assert_eq!(pixel, place(on.x, on.y, &orthographic));
    assert!((found / expected - 1.0).abs() < 2e-7, "orthographic: {found} {expected}");
    // A distorted image: the sum over pixels around is that of two chains to one place; here the pixel and its area change.
    let (k1, p2) = (-0.12, 0.01);
    let distortion = Distortion { k1, p2, ..Distortion::default() };
    let (pixel, found) = only(&shiny(&black, floor.clone(), Camera { distortion: Some(distortion), ..c.clone() }));
    let distance = forward.length();
    let image_of = |x: f64, y: f64| {
        let (x, y) = (x / distance, -y / distance);
        let (r2, s) = (x * x + y * y, 1.0 + k1 * (x * x + y * y));
        (distance * (x * s + p2 * (r2 + 2.0 * x * x)), -distance * (y * s + 2.0 * p2 * x * y))
    };
    let on = DVec3::from(c.position) + t * d - DVec3::from(c.look_at);
    let h = 1e-4;
    let along = |dx: f64, dy: f64| {
        let (a, b) = (image_of(on.x + dx, on.y + dy), image_of(on.x - dx, on.y - dy));
        ((a.0 - b.0) / (2.0 * h), (a.1 - b.1) / (2.0 * h))
    };
    let (a, b) = (along(h, 0.0), along(0.0, h));
    let spread = a.0 * b.1 - a.1 * b.0;
    let expected = irradiance * (t * d).length_squared() / cos / pixel_area * spread;
    let (x, y) = image_of(on.x, on.y);
    assert_eq!(pixel, place(x, y, &c));
    assert!((found / expected - 1.0).abs() < 1e-6, "distorted: {found} {expected}");
    // Crossed polarisers take it away, and so does what stands in its way.
    let excluded = |mut scene: Scene| {
        scene.camera.as_mut().unwrap().specular = Some(Specular::Exclude);
        scene
    };
    assert!(image(&excluded(scene.clone())).is_empty());
    let mut shaded = scene;
    let reached = DVec3::from(c.position) + (c.position[2] - top) / -d.z * d;
    let block = Shape::Sphere { diameter: 4.0, center: (0.5 * (reached + lamp)).into() };
    shaded.objects.insert("z".to_owned(), lambertian(block, 0.0));
    assert!(image(&shaded).is_empty());
}

/// On the axis of a plate the images after k crossings and back lie one behind the other in one pixel: sum of
/// R_k exp(-2 k mu_a d) / (h_1 + h_2 + 2 k d / n)^2 with R_0 = R, R_k = (1 - R)^2 R^(2 k - 1), R of normal incidence.
#[test]
fn a_plate_shows_all_its_images() {
    let (n, mu_a, d) = (1.6, 0.05, 3.0);
    let c = Camera { position: [0.0, 0.0, 80.0], look_at: [0.0; 3], ..camera() };
    let mut scene = shiny(&[("plate", glass(mu_a, n))], vec![glassy(0.0, -d, "plate")], c);
    scene.lights = [("lamp".to_owned(), Lamp::Point { position: [0.0, 0.0, 50.0], power: vec![4.0 * PI] })].into();
    let r = fresnel::normal_reflectance(n);
    let order = |k: i32| {
        let amount = if k == 0 { r } else { (1.0 - r) * (1.0 - r) * r.powi(2 * k - 1) };
        let far = 130.0 + 2.0 * f64::from(k) * d / n;
        amount * (-2.0 * f64::from(k) * mu_a * d).exp() / (far * far)
    };
    let expected = (0..20).map(order).sum::<f64>() * 80.0 * 80.0 / 4.0;
    let (pixel, found) = only(&scene);
    assert_eq!(pixel, (22, 22));
    // f32, and chains of less than 1e-10 of the light.
    assert!((found / expected - 1.0).abs() < 1e-6, "{found} {expected}");
    assert!(order(1) > 0.5 * order(0), "its back shows");
}

/// The projector's lamp reflection carries its pattern, each f_x with the phase of the direction in which it left.
#[test]
fn lamp_reflections_show_the_pattern() {
    let (f_x, lit) = (0.07, 200.0);
    let c = camera();
    let mut scene = shiny(&[("ink", glass(1e3, 1.4))], vec![glassy(0.0, -40.0, "ink")], c.clone());
    let (_, mut projector) = rig(90.0, 0.0, 90.0, 45, lit);
    projector.position = LAMP;
    projector.look_at = [10.0, 10.0, 0.0];
    scene.projector = Some(projector);
    scene.lights.clear();
    // It leaves towards the camera's mirror image, through the plane z = 0.
    let (from, to) = (DVec3::from(LAMP), DVec3::from(c.position) * DVec3::new(1.0, 1.0, -1.0));
    let on = from + (to - from) * from.z / (from.z - to.z);
    let params = json!({"f_x": [0, f_x], "phases": 3, "samples": 8});
    let ports = run(&scene, &params, 1);
    let white = f64::from(*ports["white"].layers[0].data.iter().find(|v| **v != 0.0).unwrap());
    // Flat: E = P / A on the plane, I = E D^2 / cos.
    let (d, d1) = (to - from, (on - from).length());
    let cos = -d.z / d.length();
    let intensity = 5.0 / (lit * lit) * d1 * d1 / cos;
    let ray = DVec3::from(c.position) * DVec3::new(1.0, 1.0, -1.0) - on;
    let expected =
        intensity * fresnel::reflectance(1.0 / 1.4, cos) / d.length_squared() * ray.length_squared() / cos / 4.0;
    assert!((white / expected - 1.0).abs() < 3e-7, "{white} {expected}");
    let mut frames = 0;
    for layer in ports["frames"].layers.iter().filter(|l| l.info.name == "radiance") {
        let found = f64::from(*layer.data.iter().find(|v| **v != 0.0).unwrap());
        let f = layer.info.f_x_per_mm.unwrap();
        let pattern =
            if f == 0.0 { 0.5 } else { 0.5 * (1.0 + (2.0 * PI * f * on.x + layer.info.phase_rad.unwrap()).cos()) };
        assert!((found / white - pattern).abs() < 3e-7, "{:?}: {found}", layer.info);
        frames += 1;
    }
    assert_eq!(frames, 4);
}

/// Where tissue lies below, the lamp reflection is what `include` adds to `exclude`, by every method; elsewhere the images are the same.
#[test]
fn include_adds_the_lamp_reflection_to_tissue() {
    let tissue = Medium { n: 1.4, ..medium(0.05, 5.0, 0.8) };
    for method in ["path", "fit"] {
        let (camera, mut projector) = rig(300.0, 40.0, 60.0, 16, 600.0);
        projector.position = [3.0, 20.0, 300.0];
        let seen = |specular| {
            let camera = Camera { specular: Some(specular), ..camera.clone() };
            let scene =
                scene(&[("tissue", tissue.clone())], vec![glassy(0.0, -2000.0, "tissue")], (camera, projector.clone()));
            run(&scene, &json!({"f_x": [0, 0.05], "samples": 8, "method": method}), 5)
        };
        let (with, without) = (seen(Specular::Include), seen(Specular::Exclude));
        let layers = |ports: &BTreeMap<&'static str, ImageStack>| ports["frames"].layers.clone();
        for (a, b) in layers(&with).iter().zip(&layers(&without)) {
            let more: Vec<_> = a.data.indexed_iter().filter(|(at, v)| **v != b.data[*at]).map(|(at, _)| at).collect();
            // Halfway between camera and projector: (1.5, 10), 3.75 mm a pixel.
            let expected = if a.info.name == "radiance" { vec![(5, 8)] } else { Vec::new() };
            assert_eq!(more, expected, "{method}: {:?}", a.info);
        }
        let first = layers(&with)[0].data[(5, 8)] / layers(&without)[0].data[(5, 8)];
        assert!(first > 100.0, "{method}: {first}");
    }
}

/// An open lens makes a disc of the lamp reflection: of the diameter a |1 - focus / z| x scale, with the mean of a pinhole's all over it. The place of the disc
/// takes 16384 points; sums over it are exact but for what the irradiance varies over the lens.
#[test]
fn an_open_lens_makes_a_disc() {
    let (aperture, focus) = (6.0, 60.0);
    let c = Camera { position: [0.0, 0.0, 120.0], look_at: [0.0; 3], ..camera() };
    let (_, closed) = only(&shiny(
        &[("ink", glass(1e3, 1.4))],
        vec![glassy(0.0, -40.0, "ink")],
        Camera { pixels: [1; 2], ..c.clone() },
    ));
    let open = Camera { aperture: Some(Aperture { diameter: aperture, focus }), ..c };
    let scene = shiny(&[("ink", glass(1e3, 1.4))], vec![glassy(0.0, -40.0, "ink")], open.clone());
    let disc = image(&scene);
    let mean = disc.values().sum::<f64>() / (45.0 * 45.0);
    // Relative changes over the lens, of second order in 3 mm of 210.
    assert!((mean / closed - 1.0).abs() < 2e-3, "{mean} {closed}");
    // Light from the height 210 below crosses the plane of focus over a (1 - 60 / 210), seen 120 / 60 times as large in the field's plane.
    let radius = 0.5 * aperture * (1.0 - focus / 210.0) * 120.0 / focus;
    let area = disc.len() as f64 * 4.0;
    let rim = 2.0 * PI * radius * 2.0;
    assert!((area - PI * radius * radius).abs() < rim, "{area} of {}", PI * radius * radius);
    // Pixels inside have the same within what 16384 points leave: a few of 16384 * 4 / 57 = 1100 a pixel.
    let most = disc.values().copied().fold(0.0, f64::max);
    let inner = disc.values().filter(|v| **v > 0.97 * most).count();
    assert!(inner >= 4, "{disc:?}");
}

/// A camera of one pixel against rays of its own that are split by chance at two plates and look for a ball of light of 1.5 mm in place of
/// the lamp: four standard errors. What the ball's size changes is of the order (1.5 / 150)^2.
#[test]
fn plates_against_a_ball_of_light() {
    let (n_1, n_2, mu_a) = (2.4, 1.5, 0.02);
    let plates = [(0.0, -4.0, n_1), (-4.0, -6.0, n_2)];
    let c = Camera { field: [10.0, 10.0], look_at: [29.5, 13.4, 0.0], pixels: [1; 2], ..camera() };
    let media = [("one", glass(mu_a, n_1)), ("two", glass(0.0, n_2))];
    let objects = vec![glassy(0.0, -4.0, "one"), glassy(-4.0, -6.0, "two")];
    let (_, found) = only(&shiny(&media, objects, c.clone()));
    let (ball, lamp) = (1.5, DVec3::from(LAMP));
    let radiance = 1.0 / (PI * ball * ball);
    let index = |z: f64| plates.iter().find(|(top, bottom, _)| *bottom < z && z < *top).map_or(1.0, |plate| plate.2);
    let edges = [0.0, -4.0, -6.0];
    let rays = 500_000u32;
    let (mut sum, mut squares) = (0.0, 0.0);
    for ray in 0..rays {
        let mut draws = (0..).flat_map(|block| philox4x32([block, ray, 0, 0], [7, 9]).map(unit));
        let mut draw = || draws.next().unwrap();
        let (x, y) = (draw() - 0.5, draw() - 0.5);
        let mut r = DVec3::from(c.position);
        let mut w = (DVec3::from(c.look_at) + DVec3::new(10.0 * x, 10.0 * y, 0.0) - r).normalize();
        let mut seen = 1.0;
        let mut turned = false;
        let value = loop {
            let ahead = edges.iter().filter(|z| (**z - r.z) * w.z > 1e-9);
            let next = ahead.min_by(|a, b| (**a - r.z).abs().total_cmp(&(**b - r.z).abs())).copied();
            let off = lamp - r;
            let nearest = off - off.dot(w) * w;
            let meets = turned && off.dot(w) > 0.0 && nearest.length() < ball && index(r.z + 1e-9 * w.z) == 1.0;
            let Some(z) = next else { break if meets { seen * radiance } else { 0.0 } };
            let t = (z - r.z) / w.z;
            let inside = index(r.z + 0.5 * t * w.z);
            if inside == n_1 {
                seen *= (-mu_a * t).exp();
            }
            let beyond = index(z + 1e-6 * w.z.signum());
            r += t * w;
            r.z = z;
            turned = true;
            let met = refract(w, DVec3::Z, inside, beyond);
            w = met.refracted.filter(|_| draw() >= met.reflectance).unwrap_or(met.reflected);
        };
        sum += value;
        squares += value * value;
    }
    let n = f64::from(rays);
    let mean = sum / n;
    let se = ((squares / n - mean * mean) / n).sqrt();
    assert!((found - mean).abs() < 4.0 * se + 2e-4 * mean, "{found}, {mean} +- {se}");
    assert!(se < 0.04 * mean, "{mean} +- {se}");
}

/// What has no image is refused by name, and the plan says what is needed.
#[test]
fn parallel_light_in_a_parallel_view_is_refused() {
    let ortho = Camera { projection: Projection::Orthographic, ..camera() };
    let mut scene = shiny(&[("ink", glass(1e3, 1.4))], vec![glassy(0.0, -40.0, "ink")], ortho);
    let beam = Lamp::Collimated { position: LAMP, look_at: [0.0; 3], diameter: 5.0, power: vec![1.0] };
    scene.lights = [("beam".to_owned(), beam)].into();
    let params: Value = json!({"f_x": [0], "samples": 64, "method": "path"});
    let row = StageRow::of::<RenderStage>();
    let told = |scene: &Scene| {
        let mut known = Known::default();
        known.insert("scene", scene.clone().into_artifact());
        let mut problems = Problems::default();
        row.check(&params, &known, &mut problems);
        (problems.into_parts().0, (row.prepare)(&params).unwrap().plan(&known))
    };
    let (problems, plan) = told(&scene);
    assert!(problems.len() == 1 && problems[0].message.contains("one direction only"), "{problems:?}");
    assert!(plan.needs.iter().any(|n| n == "glints"), "{plan:?}");
    scene.camera.as_mut().unwrap().projection = Projection::Pinhole;
    assert!(told(&scene).0.is_empty());
    scene.camera.as_mut().unwrap().specular = Some(Specular::Exclude);
    let plan = told(&scene).1;
    assert!(plan.left_out.iter().any(|n| n == "glints"), "{plan:?}");
}
