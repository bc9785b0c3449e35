//! Lamp reflections on curved walls, tilted ones and facets: closed forms of round mirrors, rays that look for a ball of light, and what is one by another chain.

use std::f64::consts::PI;

use glam::DVec3;
use serde_json::json;
use turbid_contract::payload::{
    Aperture, Camera, Lamp, Mesh, Object, Payload, Projection, Scene, Shape, Specular, Surface,
};
use turbid_contract::{Known, Problems, StageRow};
use turbid_optics::fresnel;
use turbid_optics::philox::{philox4x32, unit};
use turbid_render::RenderStage;

use crate::lamp_reflections::{LAMP, camera, glass, image, only, shiny};
use crate::setup::*;
use crate::shapes::{block, ring};

fn body(shape: Shape, medium: &str) -> Object {
    object(shape, medium, 0)
}

/// A reflection by a ball of radius R about `center`: where it is reflected, by bisection along the arc between both ends; the cosine there.
fn by_ball(center: DVec3, radius: f64, eye: DVec3, towards_light: impl Fn(DVec3) -> DVec3) -> (DVec3, f64) {
    let lamp = towards_light(center);
    let from = (eye - center).normalize();
    let across = (lamp - lamp.dot(from) * from).normalize();
    let at = |phi: f64| center + radius * (phi.cos() * from + phi.sin() * across);
    let (mut low, mut high) = (0.0, lamp.angle_between(from));
    for _ in 0..100 {
        let phi = 0.5 * (low + high);
        let p = at(phi);
        let n = (p - center).normalize();
        // The angle to the eye grows, that to the lamp falls.
        if (eye - p).normalize().dot(n) > towards_light(p).dot(n) { low = phi } else { high = phi }
    }
    let p = at(0.5 * (low + high));
    (p, (eye - p).normalize().dot((p - center).normalize()))
}

/// A black ball is a convex mirror: the image of a lamp d_1 from the place of reflection and d_2 from the eye, at the angle theta, is
/// R(theta) / ((d_1 + d_2 + 2 d_1 d_2 / (R cos theta)) (d_1 + d_2 + 2 d_1 d_2 cos theta / R)) of its intensity (Coddington's equations), for
/// parallel rays of the camera R(theta) / ((1 + 2 d_1 / (R cos theta)) (1 + 2 d_1 cos theta / R)). 2e-7 is the rounding to f32.
#[test]
fn a_ball_is_a_convex_mirror() {
    let (radius, center, n) = (18.0, DVec3::new(6.0, 4.0, -10.0), 1.4);
    let ball = || vec![body(Shape::Sphere { diameter: 2.0 * radius, center: center.into() }, "ink")];
    let black = [("ink", glass(1e3, n))];
    let lamp = DVec3::from(LAMP);
    let c = camera();
    let eye = DVec3::from(c.position);
    let (p, cos) = by_ball(center, radius, eye, |p| (lamp - p).normalize());
    let (d_1, d_2) = ((lamp - p).length(), (eye - p).length());
    let mean = d_1 + d_2;
    let reflectance = fresnel::reflectance(1.0 / n, cos);
    let irradiance = reflectance / (mean + 2.0 * d_1 * d_2 / (radius * cos)) / (mean + 2.0 * d_1 * d_2 * cos / radius);
    let place = |on: DVec3| {
        let cell = |x: f64| (x / 2.0 + 22.5) as usize;
        (cell(c.look_at[1] - on.y), cell(on.x - c.look_at[0]))
    };
    // Where the ray meets the field's plane z = 0.
    let w = (p - eye).normalize();
    let t = -eye.z / w.z;
    let (pixel, found) = only(&shiny(&black, ball(), c.clone()));
    let expected = irradiance * t * t / -w.z / 4.0;
    assert_eq!(pixel, place(eye + t * w));
    assert!((found / expected - 1.0).abs() < 2e-7, "{found} {expected}");
    let forward = DVec3::from(c.look_at) - eye;
    let angle = forward.angle_between(w);
    let (_, found) = only(&shiny(&black, ball(), Camera { projection: Projection::Fisheye, ..c.clone() }));
    let expected = irradiance * forward.length_squared() * angle / angle.sin() / 4.0;
    assert!((found / expected - 1.0).abs() < 2e-7, "fisheye: {found} {expected}");
    let axis = forward.normalize();
    let normal = |p: DVec3| (p - center).normalize();
    let (p, cos) = by_ball(center, radius, center - 1e12 * axis, |p| (lamp - p).normalize());
    assert!(((lamp - p).normalize() - axis).cross(normal(p)).length() < 1e-9);
    let d_1 = (lamp - p).length();
    let spread = (1.0 + 2.0 * d_1 / (radius * cos)) * (1.0 + 2.0 * d_1 * cos / radius);
    let orthographic = Camera { projection: Projection::Orthographic, ..c.clone() };
    let (pixel, found) = only(&shiny(&black, ball(), orthographic));
    let expected = fresnel::reflectance(1.0 / n, cos) / spread / (4.0 * -axis.z);
    assert_eq!(pixel, place(p - p.z / axis.z * axis));
    assert!((found / expected - 1.0).abs() < 2e-7, "orthographic: {found} {expected}");
    // Of a mirror the same without R, of a beam I / d_1^2 is its irradiance.
    let silver = Object { surface: Surface::Mirror, medium: None, ..ball().remove(0) };
    let (_, found) = only(&shiny(&[], vec![silver], c.clone()));
    let expected = irradiance / reflectance * t * t / -w.z / 4.0;
    assert!((found / expected - 1.0).abs() < 2e-7, "mirror: {found} {expected}");
    let mut scene = shiny(&black, ball(), c.clone());
    let beam = Lamp::Collimated { position: LAMP, look_at: center.into(), diameter: 60.0, power: vec![900.0 * PI] };
    scene.lights = [("beam".to_owned(), beam)].into();
    let towards = (lamp - center).normalize();
    let (p, cos) = by_ball(center, radius, eye, |_| towards);
    let (d_2, w) = ((eye - p).length(), (p - eye).normalize());
    let spread = (1.0 + 2.0 * d_2 / (radius * cos)) * (1.0 + 2.0 * d_2 * cos / radius);
    let (_, found) = only(&scene);
    let expected = fresnel::reflectance(1.0 / n, cos) / spread * (eye.z / w.z).powi(2) / -w.z / 4.0;
    assert!((found / expected - 1.0).abs() < 2e-7, "beam: {found} {expected}");
    // Crossed polarisers take it away, and so does what stands in its way.
    let mut excluded = shiny(&black, ball(), c.clone());
    excluded.camera.as_mut().unwrap().specular = Some(Specular::Exclude);
    assert!(image(&excluded).is_empty());
    let (p, _) = by_ball(center, radius, eye, |p| (lamp - p).normalize());
    for shaded in [0.5 * (p + lamp), 0.5 * (p + eye)] {
        let mut objects = ball();
        objects.push(lambertian(Shape::Sphere { diameter: 4.0, center: shaded.into() }, 0.0));
        assert!(image(&shiny(&black, objects, c.clone())).is_empty());
    }
}

/// Where a ray meets a wall: how far off, and its normal.
type Meets<'a> = &'a dyn Fn(DVec3, DVec3) -> Option<(f64, DVec3)>;

/// Mean radiance of an image of one pixel by rays that are reflected up to twenty times, weighted by Fresnel's reflectance, and look for a ball of light of
/// radius `ball` in place of the lamp of 1 W/sr; its standard error.
fn by_rays(c: &Camera, (lamp, ball): (DVec3, f64), n: f64, meets: Meets<'_>) -> (f64, f64) {
    let rays = 300_000;
    let radiance = 1.0 / (PI * ball * ball);
    let (mut sum, mut squares) = (0.0, 0.0);
    for ray in 0..rays {
        let [x, y, ..] = philox4x32([ray, 0, 0, 0], [17, 18]).map(unit);
        let mut r = DVec3::from(c.position);
        let on = DVec3::from(c.look_at) + DVec3::new(c.field[0] * (x - 0.5), c.field[1] * (y - 0.5), 0.0);
        let mut w = (on - r).normalize();
        let (mut value, mut weight) = (0.0, radiance);
        for _ in 0..20 {
            let Some((t, normal)) = meets(r, w) else { break };
            weight *= fresnel::reflectance(1.0 / n, w.dot(normal).abs());
            (r, w) = (r + t * w, w - 2.0 * w.dot(normal) * normal);
            let off = lamp - r;
            let aimed = off.dot(w) > 0.0 && (off - off.dot(w) * w).length() < ball;
            r += 1e-9 * w;
            if aimed && meets(r, w).is_none_or(|(t, _)| t > off.length()) {
                value += weight;
            }
        }
        sum += value;
        squares += value * value;
    }
    let n = f64::from(rays);
    (sum / n, ((squares / n - (sum / n).powi(2)) / n).sqrt())
}

/// Radiances and standard errors of an image, brightest first, with row and column.
fn brightest(scene: &Scene, camera: &Camera) -> Vec<(f64, f64, [usize; 2])> {
    let scene = Scene { camera: Some(camera.clone()), ..scene.clone() };
    let ports = run(&scene, &json!({"f_x": [0], "samples": 8}), 1);
    let layer = |name| &ports["frames"].find(name, Some(0.0)).unwrap().data;
    let pixels = layer("radiance").indexed_iter().zip(layer("radiance_se").iter());
    let mut all: Vec<_> =
        pixels.map(|(((row, column), &v), &se)| (f64::from(v), f64::from(se), [row, column])).collect();
    all.sort_by(|a, b| b.0.total_cmp(&a.0));
    all
}

/// The `images` brightest images of the lamp against rays in a field of so many mm around each: four standard errors.
fn agree_with_rays(name: &str, scene: &Scene, images: usize, (field, ball): (f64, f64), n: f64, meets: Meets<'_>) {
    let wide = Camera { pixels: [150; 2], ..scene.camera.clone().unwrap() };
    let Lamp::Point { position, .. } = scene.lights["lamp"] else { panic!("a point") };
    // What a pixel of a camera sees, and somewhat more.
    let zoom = |c: &Camera, [row, column]: [usize; 2]| {
        let pitch = c.field[0] / 150.0;
        let [x, y, z] = c.look_at;
        let look_at = [x + (column as f64 - 74.5) * pitch, y + (74.5 - row as f64) * pitch, z];
        Camera { look_at, field: [2.0 * pitch; 2], ..c.clone() }
    };
    for &(radiance, _, place) in &brightest(scene, &wide)[..images] {
        assert!(radiance > 0.0, "{name}");
        let near = zoom(&wide, place);
        let nearer = zoom(&near, brightest(scene, &near)[0].2);
        let c = Camera { field: [field; 2], pixels: [1; 2], ..nearer };
        let (found, found_se, _) = brightest(scene, &c)[0];
        let (mean, se) = by_rays(&c, (position.into(), ball), n, meets);
        println!("{name}: {found} +- {found_se}, {mean} +- {se}");
        // What the size of the ball of light changes is of the order (0.5 / 90)^2, (0.1 / 20)^2.
        assert!((found - mean).abs() < 4.0 * se.hypot(found_se) + 1e-3 * mean, "{name}: {found}, {mean} +- {se}");
        assert!(se.hypot(found_se) < 0.04 * mean, "{name}: {mean} +- {se}, {found_se}");
    }
}

/// A turned spheroid, and the bore of a tube in which camera and lamp stand, so that it has several images, against rays.
#[test]
fn round_walls_against_a_ball_of_light() {
    let n = 1.6;
    let ink = [("ink", glass(1e3, n))];
    let (diameters, center) = ([16.0, 30.0, 50.0], DVec3::new(8.0, 6.0, -15.0));
    let radii = 0.5 * DVec3::from(diameters);
    let spheroid = Shape::Spheroid { diameters, center: center.into() };
    let turned = Shape::Turned { shape: Box::new(spheroid), about: center.into(), rotation_deg: [30.0, 20.0, 0.0] };
    // About x, then about y.
    let ((sin_x, cos_x), (sin_y, cos_y)) = (30f64.to_radians().sin_cos(), 20f64.to_radians().sin_cos());
    let out = |p: DVec3| {
        let p = DVec3::new(p.x, cos_x * p.y - sin_x * p.z, sin_x * p.y + cos_x * p.z);
        DVec3::new(cos_y * p.x + sin_y * p.z, p.y, cos_y * p.z - sin_y * p.x)
    };
    let into = |p: DVec3| {
        let p = DVec3::new(cos_y * p.x - sin_y * p.z, p.y, cos_y * p.z + sin_y * p.x);
        DVec3::new(p.x, cos_x * p.y + sin_x * p.z, cos_x * p.z - sin_x * p.y)
    };
    let outside = |r: DVec3, w: DVec3| {
        let (o, d) = (into(r - center) / radii, into(w) / radii);
        let (a, b, c) = (d.length_squared(), o.dot(d), o.length_squared() - 1.0);
        let t = (-b - (b * b - a * c).sqrt()) / a;
        (t > 1e-6).then(|| (t, out((o + t * d) / radii).normalize()))
    };
    let scene = shiny(&ink, vec![body(turned, "ink")], camera());
    agree_with_rays("spheroid", &scene, 1, (0.2, 0.5), n, &outside);
    let (radius, length) = (10.0, 40.0);
    let c = Camera { position: [2.0, 1.0, 5.0], look_at: [0.0, 0.0, -30.0], field: [80.0; 2], ..camera() };
    let (inner_diameter, outer_diameter) = (2.0 * radius, 30.0);
    let tube = Shape::Tube { inner_diameter, outer_diameter, center: [0.0; 2], top: 0.0, bottom: -length };
    let bore = |r: DVec3, w: DVec3| {
        let mouth = r - r.z / w.z * w;
        if r.z > 0.0 && (w.z >= 0.0 || mouth.truncate().length() > radius) {
            // The rim, which throws nothing down into the bore.
            return None;
        }
        let (o, d) = (r.truncate(), w.truncate());
        let (a, b, c) = (d.length_squared(), o.dot(d), o.length_squared() - radius * radius);
        let t = (-b + (b * b - a * c).sqrt()) / a;
        let p = r + t * w;
        (t > 1e-6 && p.z < 0.0 && p.z > -length).then(|| (t, -p.truncate().extend(0.0) / radius))
    };
    let mut scene = shiny(&ink, vec![body(tube, "ink")], c);
    let position = [-3.0, 4.0, -20.0];
    scene.lights = [("lamp".to_owned(), Lamp::Point { position, power: vec![4.0 * PI] })].into();
    agree_with_rays("bore", &scene, 2, (1.0, 0.1), n, &bore);
}

/// From near by a ball of 200 m is a half-space; a box of facets is a box, turned or not; a mesh of flat pieces is what planes say.
#[test]
fn what_looks_alike_reflects_lamps_alike() {
    let black = [("ink", glass(1e3, 1.4))];
    let lamp_reflection = |shape: Shape| only(&shiny(&black, vec![body(shape, "ink")], camera()));
    let (pixel, plane) = lamp_reflection(Shape::Slab { top: 0.0, bottom: -40.0 });
    let (of_ball, ball) = lamp_reflection(Shape::Sphere { diameter: 2e8, center: [0.0, 0.0, -1e8] });
    assert!(of_ball == pixel && (ball / plane - 1.0).abs() < 1e-5, "{ball} {plane}");
    let (low, high) = ([-100.0, -100.0, -30.0], [100.0, 100.0, 0.0]);
    let size = [200.0, 200.0, 30.0];
    let cuboid = || Shape::Box { size, center: [0.0, 0.0, -15.0] };
    let facets = || {
        let (vertices, triangles) = block(low.into(), high.into());
        Shape::Mesh(Mesh { vertices, triangles }.into())
    };
    for shape in [cuboid(), facets()] {
        let (at, one) = lamp_reflection(shape);
        assert!(at == pixel && (one / plane - 1.0).abs() < 2e-7, "{one} {plane}");
    }
    let turned =
        |shape: Shape| Shape::Turned { shape: Box::new(shape), about: [0.0; 3], rotation_deg: [5.0, -8.0, 20.0] };
    let ((at, one), (other_at, other)) = (lamp_reflection(turned(cuboid())), lamp_reflection(turned(facets())));
    assert!(at == other_at && at != pixel && (one / other - 1.0).abs() < 2e-7, "{one} {other}");
    let quarter =
        |shape: Shape| Shape::Turned { shape: Box::new(shape), about: [0.0; 3], rotation_deg: [0.0, 0.0, 90.0] };
    let (at, one) = lamp_reflection(quarter(facets()));
    assert!(at == pixel && (one / plane - 1.0).abs() < 2e-7, "{one} {plane}");
    // A ring of facets has a flat top.
    let (vertices, triangles) = ring(5.0, 100.0, 3.0, 60);
    let lowered = vertices.into_iter().map(|[x, y, z]| [x, y, z - 3.0]).collect();
    let (at, one) = lamp_reflection(Shape::Mesh(Mesh { vertices: lowered, triangles }.into()));
    assert!(at == pixel && (one / plane - 1.0).abs() < 2e-7, "{one} {plane}");
}

/// An open lens makes a disc of a ball's lamp reflection, too, with the light of a pinhole's up to what it varies over the lens.
#[test]
fn an_open_lens_blurs_the_lamp_reflection_of_a_ball() {
    let ball = || vec![body(Shape::Sphere { diameter: 40.0, center: [6.0, 4.0, -20.0] }, "ink")];
    let black = [("ink", glass(1e3, 1.4))];
    let (_, closed) = only(&shiny(&black, ball(), Camera { pixels: [1; 2], ..camera() }));
    let open = Camera { aperture: Some(Aperture { diameter: 3.0, focus: 60.0 }), ..camera() };
    let disc = image(&shiny(&black, ball(), open));
    let mean = disc.values().sum::<f64>() / (45.0 * 45.0);
    assert!(disc.len() > 3 && (mean / closed - 1.0).abs() < 2e-3, "{mean} {closed} {}", disc.len());
}

/// On the axis of a round bore the light of a lamp there is in focus: named before anything runs. Beside it, or with crossed polarisers, all is well.
#[test]
fn light_in_focus_is_named() {
    let tube = Shape::Tube { inner_diameter: 20.0, outer_diameter: 30.0, center: [0.0; 2], top: 0.0, bottom: -40.0 };
    let told = |x: f64, specular| {
        let c = Camera { position: [x, 0.0, 5.0], look_at: [0.0, 0.0, -30.0], ..camera() };
        let mut scene = shiny(&[("ink", glass(1e3, 1.4))], vec![body(tube.clone(), "ink")], c);
        scene.camera.as_mut().unwrap().specular = Some(specular);
        scene.lights = [("lamp".to_owned(), Lamp::Point { position: [0.0, 0.0, -20.0], power: vec![1.0] })].into();
        let mut known = Known::default();
        known.insert("scene", scene.into_artifact());
        let mut problems = Problems::default();
        StageRow::of::<RenderStage>().check(&json!({"f_x": [0], "samples": 64}), &known, &mut problems);
        problems.into_parts().0
    };
    let problems = told(0.0, Specular::Include);
    assert!(problems.len() == 1 && problems[0].message.contains("focus"), "{problems:?}");
    assert_eq!(problems[0].path, "camera.position");
    assert!(told(0.5, Specular::Include).is_empty() && told(0.0, Specular::Exclude).is_empty());
}
