//! Connections against light walked forward.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};
use turbid_optics::PhaseFunction;
use turbid_optics::elementary::sin_cos_turns;
use turbid_optics::henyey_greenstein::turn;
use turbid_optics::philox::{philox4x32, unit};
use turbid_optics::refraction::refract;
use turbid_optics::solid::{Frame, Mesh, Solid};
use turbid_optics::view::View;

use crate::ahead::OTHER_CONNECTIONS;
use crate::bsdf::Bsdf;
use crate::camera::Camera;
use crate::connect::Draws;
use crate::lamp::{Lamp, Source, Steady};
use crate::level::named;
use crate::light::Light;
use crate::projected_images::ProjectedImages;
use crate::random::{NeeSite, Purpose, Stream};
use crate::setting::{Nee, Setting};
use crate::strata::Bending;
use crate::walker::Walker;
use crate::world::{Body, Chords, Interface, Material, SurfacePoint, World};

mod lamp_reflections;
#[path = "../../../optics/tests/shapes/mod.rs"]
mod shapes;

/// mu_t in mm^-1, n. In clearer ones, light beyond foci comes by chains so rarely found that a few of them make the mean, and standard errors say too
/// little: `docs/theory/render.md` has what longer runs gave there.
const MEDIA: [(f64, f64); 4] = [(0.6, 1.4), (0.4, 1.5), (0.8, 1.33), (0.0, 1.0)];

struct Case {
    name: &'static str,
    world: World,
    lamp: Lamp,
    /// Balls in which the fluence is counted.
    balls: Vec<(DVec3, f64)>,
}

fn case(name: &'static str, bodies: Vec<(Solid, usize)>, lamp: Lamp, balls: &[([f64; 3], f64)]) -> Case {
    let mut materials = vec![Material::VOID];
    materials.extend(MEDIA.map(|(mu_t, n)| Material::medium(mu_t, 0.0, PhaseFunction::ISOTROPIC, n)));
    materials.push(Material::lambertian(0.0));
    materials.push(Material { bsdf: Bsdf::Mirror, ..Material::VOID });
    let bodies = bodies.into_iter().map(|(solid, material)| Body { solid, material }).collect();
    Case {
        name,
        world: World { bodies, materials, textures: Vec::new() },
        lamp,
        balls: balls.iter().map(|&(p, r)| (p.into(), r)).collect(),
    }
}

fn cases() -> Vec<Case> {
    let ball = |center: [f64; 3], radii: [f64; 3]| Solid::Ellipsoid { center: center.into(), radii: radii.into() };
    let slab = |bottom: f64, top: f64| Solid::Slab { bottom, top };
    let point = |position: [f64; 3]| Lamp::point(position.into(), 4.0 * PI);
    let beam = |from: [f64; 3], to: [f64; 3], diameter: f64| {
        let (from, to) = (DVec3::from(from), DVec3::from(to));
        Lamp::beam(from, (to - from).normalize(), diameter, PI * diameter * diameter / 4.0)
    };
    let cuboid = |low: [f64; 3], high: [f64; 3]| Solid::Box { low: low.into(), high: high.into() };
    let tilt = Frame::turned(DVec3::new(0.1, 0.0, 0.2), [20.0, -35.0, 10.0]);
    let upright = Solid::Cylinder { axis: DVec2::ZERO, radius: 1.0, bottom: -2.0, top: 1.5 };
    vec![
        case(
            "sphere",
            vec![(ball([0.0; 3], [1.0; 3]), 1)],
            point([1.0, 0.5, 3.0]),
            &[([0.0, 0.0, 0.6], 0.15), ([0.3, -0.5, 0.0], 0.15), ([-0.5, 0.3, 0.1], 0.2), ([0.8, 0.0, 0.3], 0.08)],
        ),
        case(
            "spheroid in a beam",
            vec![(ball([0.0; 3], [0.8, 1.2, 1.6]).turned(tilt), 2)],
            beam([1.0, 3.0, 9.0], [0.0; 3], 8.0),
            &[([0.0, 0.0, 1.0], 0.15), ([0.3, -0.4, 0.0], 0.15), ([0.3, 0.5, 0.3], 0.2)],
        ),
        case(
            "dome on a slab",
            vec![(ball([0.0; 3], [1.0, 1.0, 1.2]), 1), (slab(-3.0, 0.0), 1)],
            point([3.0, 1.0, 6.0]),
            &[([1.3, 0.3, -0.2], 0.15), ([0.0, 0.0, 0.3], 0.15), ([-1.4, -0.3, -0.3], 0.15), ([0.5, 0.0, -0.7], 0.2)],
        ),
        case(
            "crater, and a ball over another index",
            vec![(ball([0.0, 0.0, 0.4], [1.0; 3]), 0), (ball([2.2, 0.0, 0.5], [0.5; 3]), 2), (slab(-3.0, 0.0), 1)],
            point([2.0, 1.0, 6.0]),
            &[([0.0, 0.0, -1.0], 0.2), ([1.2, 0.0, -0.4], 0.15), ([2.2, 0.0, 0.5], 0.2), ([2.2, 0.1, -0.7], 0.15)],
        ),
        case(
            "cylinder",
            vec![(upright.clone(), 1)],
            point([2.0, 0.5, 4.0]),
            &[([0.0, 0.0, 1.2], 0.15), ([0.5, 0.3, 0.0], 0.15), ([0.6, 0.2, 0.7], 0.15)],
        ),
        case(
            "tube lit through its bore",
            vec![(Solid::tube(2.0, 4.0, DVec2::ZERO, -4.0, 0.0), 1)],
            point([0.2, 0.1, 3.0]),
            &[([1.3, 0.0, -1.0], 0.15), ([0.0, -1.4, -2.5], 0.2), ([1.5, 0.3, -0.4], 0.15)],
        ),
        case(
            "box",
            vec![(cuboid([-1.0, -1.2, -1.0], [1.0, 1.2, 0.5]).turned(tilt), 1)],
            point([2.0, 1.0, 5.0]),
            &[([0.0, 0.0, 0.0], 0.2), ([0.8, 0.0, 0.3], 0.1), ([-0.3, 0.3, -0.7], 0.15)],
        ),
        case(
            "medium in a glass shell",
            vec![(ball([0.0; 3], [0.9; 3]), 3), (ball([0.0; 3], [1.0; 3]), 2)],
            point([1.0, 0.5, 3.0]),
            &[([0.0, 0.0, 0.6], 0.15), ([0.3, -0.5, 0.0], 0.15), ([0.0, 0.0, -0.5], 0.15)],
        ),
        case(
            "air beside a ball on a black floor",
            vec![(ball([0.0, 0.0, 1.0], [1.0; 3]), 1), (slab(-3.0, 0.0), 5)],
            point([3.0, 0.0, 4.0]),
            &[([1.2, 0.0, 0.3], 0.15), ([0.0, 0.0, 1.0], 0.2), ([1.6, 0.5, 0.6], 0.3)],
        ),
    ]
}

/// The same of facets: coarse and fine ones, convex and not, alone and with other bodies.
fn facetted_cases() -> Vec<Case> {
    let mesh = |(vertices, triangles): shapes::Triangles| Solid::Mesh(Mesh::new(&vertices, &triangles).into());
    let point = |position: [f64; 3]| Lamp::point(position.into(), 4.0 * PI);
    let slab = Solid::Slab { bottom: -3.0, top: 0.0 };
    let below = [([0.0, 0.0, 0.6], 0.15), ([0.3, -0.5, 0.0], 0.15), ([-0.5, 0.3, 0.1], 0.2), ([0.8, 0.0, 0.3], 0.08)];
    let beside = [([1.3, 0.3, -0.2], 0.15), ([0.0, 0.0, 0.3], 0.15), ([-1.4, -0.3, -0.3], 0.15)];
    let sphere = |levels| mesh(shapes::icosphere(1.0, DVec3::ZERO, levels));
    let glass = (sphere(2), 2);
    let inner = (Solid::Ellipsoid { center: DVec3::ZERO, radii: DVec3::splat(0.7) }, 3);
    let away = DVec3::new(1.0, 3.0, 9.0);
    vec![
        case("sphere of 320 facets", vec![(sphere(2), 1)], point([1.0, 0.5, 3.0]), &below),
        case("sphere of 5120 facets", vec![(sphere(4), 1)], point([1.0, 0.5, 3.0]), &below),
        case(
            "sphere of 1280 facets in a beam",
            vec![(sphere(3), 3)],
            Lamp::beam(away, -away.normalize(), 8.0, 16.0 * PI),
            &below,
        ),
        case(
            "block",
            vec![(mesh(shapes::block(DVec3::new(-1.0, -1.2, -1.0), DVec3::new(1.0, 1.2, 0.5))), 1)],
            point([2.0, 1.0, 5.0]),
            &[([0.0, 0.0, 0.0], 0.2), ([0.8, 0.0, 0.3], 0.1), ([-0.3, 0.3, -0.7], 0.15)],
        ),
        case("dome of facets on a slab", vec![(sphere(3), 1), (slab, 1)], point([3.0, 1.0, 6.0]), &beside),
        case(
            "ring",
            vec![(mesh(shapes::ring(0.6, 1.4, 0.8, 24)), 1)],
            point([0.2, 0.5, 4.0]),
            &[([1.0, 0.0, 0.5], 0.15), ([0.0, -1.1, 0.0], 0.15), ([0.0, 0.0, 0.0], 0.2)],
        ),
        case(
            "medium in a shell of facets",
            vec![inner, glass],
            point([1.0, 0.5, 3.0]),
            &[([0.0, 0.0, 0.4], 0.15), ([0.2, -0.3, 0.0], 0.15)],
        ),
    ]
}

/// Mirrors: alone, where places are known but for what goes on from one to the next, and beside what refracts.
fn mirrored_cases() -> Vec<Case> {
    const MIRROR: usize = 6;
    let ball = |center: [f64; 3], radii: [f64; 3]| Solid::Ellipsoid { center: center.into(), radii: radii.into() };
    let point = |position: [f64; 3]| Lamp::point(position.into(), 4.0 * PI);
    let tilt = Frame::turned(DVec3::new(0.1, 0.0, 0.2), [20.0, -35.0, 10.0]);
    let cuboid = |low: [f64; 3], high: [f64; 3]| Solid::Box { low: low.into(), high: high.into() };
    let beam = |from: [f64; 3], diameter: f64| {
        let from = DVec3::from(from);
        Lamp::beam(from, -from.normalize(), diameter, PI * diameter * diameter / 4.0)
    };
    let facets = |(vertices, triangles): shapes::Triangles| Solid::Mesh(Mesh::new(&vertices, &triangles).into());
    vec![
        case(
            "mirror ball",
            vec![(ball([0.0; 3], [1.0; 3]), MIRROR)],
            point([1.0, 0.5, 3.0]),
            &[([0.0, 0.0, 1.4], 0.15), ([1.3, -0.5, 0.5], 0.2), ([-1.0, 0.3, 1.1], 0.2)],
        ),
        case(
            "mirror spheroid in a beam",
            vec![(ball([0.0; 3], [0.8, 1.2, 1.6]).turned(tilt), MIRROR)],
            beam([1.0, 3.0, 9.0], 8.0),
            &[([0.0, 1.6, 1.0], 0.2), ([1.5, 0.0, 0.5], 0.2), ([-1.0, 0.3, 1.5], 0.2)],
        ),
        case(
            "bowl",
            vec![(ball([0.0, 0.0, 0.5], [1.0; 3]), 0), (cuboid([-3.0, -3.0, -2.0], [3.0, 3.0, 0.3]), MIRROR)],
            point([0.7, 0.4, 2.0]),
            &[([0.3, -0.4, 0.0], 0.15), ([-0.5, 0.2, 0.3], 0.15), ([0.2, 0.3, -0.25], 0.1), ([0.0, 0.6, 1.0], 0.2)],
        ),
        case(
            "bore of a mirror tube",
            vec![(Solid::tube(2.0, 4.0, DVec2::ZERO, -4.0, 0.0), MIRROR)],
            point([0.3, 0.2, 3.0]),
            &[([0.5, 0.0, -1.0], 0.15), ([0.0, -0.6, -2.0], 0.2), ([-0.4, 0.3, -0.4], 0.15)],
        ),
        case(
            "two mirrors, a ball and a wall",
            vec![(ball([0.0; 3], [1.0; 3]), MIRROR), (cuboid([1.6, -4.0, -4.0], [2.0, 4.0, 4.0]), MIRROR)],
            point([-1.0, 0.5, 3.0]),
            &[([1.3, 0.0, 0.4], 0.15), ([0.5, 0.3, 1.3], 0.15), ([1.0, 0.8, 0.0], 0.15)],
        ),
        case(
            "mirror ball over glass",
            vec![(ball([0.0, 0.0, 1.5], [0.8; 3]), MIRROR), (Solid::Slab { bottom: -3.0, top: 0.0 }, 1)],
            point([2.0, 0.5, 2.5]),
            &[([0.3, 0.0, -0.4], 0.2), ([1.2, 0.3, -0.3], 0.2), ([0.9, 0.2, 0.6], 0.2)],
        ),
        case(
            "glass ball beside a flat mirror",
            vec![(ball([0.0; 3], [1.0; 3]), 1), (cuboid([-3.0, -3.0, -2.0], [3.0, 3.0, -1.2]), MIRROR)],
            point([1.0, 0.5, 3.0]),
            &[([0.0, 0.0, 0.5], 0.2), ([0.4, 0.2, -0.6], 0.15), ([1.2, 0.3, -0.7], 0.2)],
        ),
        case(
            "mirror of 320 facets",
            vec![(facets(shapes::icosphere(1.0, DVec3::ZERO, 2)), MIRROR)],
            point([1.0, 0.5, 3.0]),
            &[([0.0, 0.0, 1.4], 0.3), ([1.3, -0.5, 0.5], 0.3), ([-1.0, 0.3, 1.1], 0.3)],
        ),
    ]
}

/// (mean, standard error).
type Measured = (f64, f64);

/// Fluence rate in the balls, light walked forward: reflection or refraction by chance, attenuation as a weight.
fn forward(case: &Case, key: u32, photons: u32) -> Vec<Measured> {
    let world = &case.world;
    // A cone around all that turns light and the balls.
    let (center, radius) = (DVec3::ZERO, 5.0);
    let mut sums = vec![[0.0; 2]; case.balls.len()];
    let mut chords = Chords::default();
    for i in 0..photons {
        let mut throws = (0..).map(|k| philox4x32([i, k, 0, 0], [7, key]).map(unit));
        let [u, turns, ..] = throws.next().unwrap();
        let (sin, cos) = sin_cos_turns(turns);
        let (mut r, mut w, mut weight) = match case.lamp {
            Lamp::Beam { center, along, radius, irradiance } => {
                let (x, y) = along.any_orthonormal_pair();
                (center + radius * u.sqrt() * (cos * x + sin * y), along, irradiance * PI * radius * radius)
            }
            Lamp::Point { position, intensity } => {
                let to = center - position;
                let least = (1.0 - (radius / to.length()).min(1.0).powi(2)).sqrt();
                let c = 1.0 - u * (1.0 - least);
                let w = turn(to.normalize(), c, (1.0 - c * c).sqrt(), sin, cos);
                (position, w, intensity * 2.0 * PI * (1.0 - least))
            }
            Lamp::Spot { .. } => unreachable!("no case has one"),
        };
        let mut scores = vec![0.0; case.balls.len()];
        let mut surface_point: Option<SurfacePoint> = None;
        // 1e-6 of the light may remain.
        'flights: while weight > 1e-6 {
            let mut before: Option<(Interface, usize)> = None;
            for segment in world.trace(r, w, surface_point, &mut chords) {
                let m = &world.materials[segment.material];
                if let (Bsdf::Mirror, Some((interface, _))) = (m.bsdf, before) {
                    r += segment.start * w;
                    let normal = world.normal(interface, r);
                    surface_point = Some(SurfacePoint { interface, inside: normal.dot(w) > 0.0 });
                    w = (w - 2.0 * w.dot(normal) * normal).normalize();
                    continue 'flights;
                }
                if m.is_opaque() {
                    break 'flights;
                }
                if let Some((interface, from)) = before
                    && world.materials[from].n != m.n
                {
                    r += segment.start * w;
                    let normal = world.normal(interface, r);
                    let met = refract(w, normal, world.materials[from].n, m.n);
                    let inside = normal.dot(w) > 0.0;
                    let [u, ..] = throws.next().unwrap();
                    let on = met.refracted.filter(|_| u >= met.reflectance);
                    surface_point = Some(SurfacePoint { interface, inside: inside == on.is_none() });
                    w = on.unwrap_or(met.reflected);
                    continue 'flights;
                }
                for (score, &(center, radius)) in scores.iter_mut().zip(&case.balls) {
                    let near = (center - r).dot(w);
                    let half2 = radius * radius - (r + near * w - center).length_squared();
                    if half2 > 0.0 {
                        let (from, to) =
                            ((near - half2.sqrt()).max(segment.start), (near + half2.sqrt()).min(segment.end));
                        if from < to {
                            let mu = m.mu_t();
                            let mean = if mu > 0.0 { (1.0 - (-mu * (to - from)).exp()) / mu } else { to - from };
                            *score += weight * (-mu * (from - segment.start)).exp() * mean;
                        }
                    }
                }
                let Some(interface) = segment.interface else { break 'flights };
                weight *= (-m.mu_t() * (segment.end - segment.start)).exp();
                before = Some((interface, segment.material));
            }
            break;
        }
        for (sum, score) in sums.iter_mut().zip(&scores) {
            *sum = [sum[0] + score, sum[1] + score * score];
        }
    }
    let n = f64::from(photons);
    let volume = |k: usize| 4.0 / 3.0 * PI * case.balls[k].1.powi(3);
    let measured = |(k, [sum, square]): (usize, [f64; 2])| {
        (sum / n / volume(k), ((square / n - (sum / n).powi(2)) / n).sqrt() / volume(k))
    };
    sums.into_iter().enumerate().map(measured).collect()
}

fn with_walker<T>(case: &Case, work: impl FnOnce(&mut Walker<'_>) -> T) -> T {
    // What balls of radius 1 and more about the origin fill in the image.
    let view = View::new(EYE * DVec3::Z, DVec3::ZERO, DVec3::Y, DVec2::splat(3.0 * EYE)).unwrap();
    let (camera, light) = (Camera { view, columns: 1, rows: 1 }, Light::none());
    let steady = Steady { lamps: vec![case.lamp], ambient: 0.0 };
    let setting = Setting {
        world: &case.world,
        camera: &camera,
        light: &light,
        steady: &steady,
        carriers: &[],
        projected_images: &ProjectedImages::NONE,
        key: [1, 2],
        channel: 0,
        nee: Nee::Point,
        shared: None,
    };
    work(&mut Walker::new(setting, named("")))
}

/// Height of the camera.
const EYE: f64 = 2.8;

/// Irradiances of all connections to points of the balls, times n^2; how many points lie on known connections, and how many trials were given up.
fn by_connections(case: &Case, points: u32) -> (Vec<Measured>, u64) {
    with_walker(case, |walker| {
        assert_eq!(walker.bending, Bending::AtInterfaces, "{}", case.name);
        let mut measured = Vec::new();
        for (k, &(center, radius)) in case.balls.iter().enumerate() {
            let (mut sum, mut square) = (0.0, 0.0);
            for i in 0..points {
                let stream = Stream::new([5, k as u32], 0, i, 0);
                let [a, b, c, _] = stream.block(Purpose::Begin).map(unit);
                let (sin, cos) = sin_cos_turns(b);
                let z = 2.0 * a - 1.0;
                let direction = DVec3::new(cos * (1.0 - z * z).sqrt(), sin * (1.0 - z * z).sqrt(), z);
                let r = center + radius * libm::cbrt(c) * direction;
                let n = walker.index_around(r);
                let mut connections = Vec::new();
                let draws = Draws { stream: &stream, flight: 2, site: NeeSite::Entered(0), others: OTHER_CONNECTIONS };
                let source = Source::Lamp(0, &case.lamp);
                walker.reach(source, r, None, &mut connections);
                walker.reach_on(source, r, None, &draws, &mut connections);
                let fluence: f64 =
                    connections.iter().map(|connection| connection.irradiance * n * n * (-connection.tau).exp()).sum();
                (sum, square) = (sum + fluence, square + fluence * fluence);
            }
            let n = f64::from(points);
            measured.push((sum / n, ((square / n - (sum / n).powi(2)) / n).sqrt()));
        }
        (measured, walker.given_up)
    })
}

/// The fluence rate that all connections together bring to small balls is that of light walked forward through the same interfaces: all
/// refractions, reflections and foci are in it, and their Jacobians. As z scores over all balls of all cases.
fn check(cases: Vec<Case>, photons: u32, points: u32) {
    let (mut scores, mut imprecise) = (Vec::new(), false);
    for (i, case) in cases.into_iter().enumerate() {
        let (walked, (connected, given_up)) = (forward(&case, i as u32, photons), by_connections(&case, points));
        for (k, ((a, a_se), (b, b_se))) in walked.into_iter().zip(connected).enumerate() {
            let z = (a - b) / f64::hypot(a_se, b_se);
            println!("{}, ball {k}: {a:.5} +- {a_se:.5}, {b:.5} +- {b_se:.5}, z {z:.2}", case.name);
            imprecise |= a_se > 0.35 * a || b_se > 0.35 * b;
            scores.push(z);
        }
        assert_eq!(given_up, 0, "{}", case.name);
    }
    assert!(!imprecise, "too noisy to tell");
    let n = scores.len() as f64;
    let rms = (scores.iter().map(|z| z * z).sum::<f64>() / n).sqrt();
    let worst = scores.iter().fold(0.0, |worst: f64, z| worst.max(z.abs()));
    assert!((rms - 1.0).abs() < 3.0 / (2.0 * n).sqrt() && worst < 4.5, "rms {rms}, worst {worst}: {scores:?}");
}

#[test]
fn connections_bring_the_light_that_walks_forward() {
    check(cases(), 400_000, 15_000);
}

#[test]
fn connections_through_facets_bring_the_light_that_walks_forward() {
    check(facetted_cases(), 400_000, 4_000);
}

#[test]
fn mirrors_throw_the_light_that_walks_forward() {
    check(mirrored_cases(), 400_000, 8_000);
}
