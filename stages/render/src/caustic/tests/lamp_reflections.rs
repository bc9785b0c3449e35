//! Light that interfaces throw back to an eye: conservation, reciprocity, and light walked forward.

use super::*;
use crate::caustic::Beginning;
use crate::connection::Connection;
use crate::random::Dice;

/// Points of a unit sphere, evenly at random.
fn direction(i: u32) -> DVec3 {
    let [a, b, ..] = philox4x32([i, 0, 0, 0], [11, 12]).map(unit);
    let (sin, cos) = sin_cos_turns(b);
    let (z, across) = (2.0 * a - 1.0, 2.0 * (a * (1.0 - a)).sqrt());
    DVec3::new(cos * across, sin * across, z)
}

fn one_reflection(walker: &mut Walker<'_>, source: Source<'_>, r: DVec3) -> Vec<Connection> {
    let mut known = Vec::new();
    walker.by_one_reflection(source, (r, None), true, &mut known);
    known.into_iter().map(|known| known.connection).collect()
}

/// A convex mirror throws all the light that falls on it outwards, each ray once: over a large sphere around it the flux of what is reflected is the intensity
/// times the solid angle of the mirror from the lamp. The bodies are of the same width from there: a ball, and a spheroid along the line to the lamp,
/// sin(half angle) = R / D and tan(half angle)^2 = b^2 / (D^2 - c^2). Four standard errors over 40,000 eyes; of a ball seen from the lamp's side and from others.
#[test]
fn convex_mirrors_keep_the_light() {
    for (radii, half) in
        [(DVec3::ONE, libm::asin(1.0 / 4.0)), (DVec3::new(1.5, 1.5, 0.5), libm::atan2(1.5, (16.0f64 - 0.25).sqrt()))]
    {
        let solid = Solid::Ellipsoid { center: DVec3::ZERO, radii };
        let mirror = case("mirror", vec![(solid, 6)], Lamp::point(4.0 * DVec3::Z, 4.0 * PI), &[]);
        with_walker(&mirror, |walker| {
            let (n, far) = (40_000, 50.0);
            let (mut sum, mut square) = (0.0, 0.0);
            for i in 0..n {
                let w = direction(i);
                let connections = one_reflection(walker, Source::Lamp(0, &mirror.lamp), far * w);
                assert!(connections.len() <= 1, "{w}");
                let flux: f64 =
                    connections.iter().map(|l| l.irradiance * -l.towards.dot(w)).sum::<f64>() * 4.0 * PI * far * far;
                (sum, square) = (sum + flux, square + flux * flux);
            }
            let mean = sum / f64::from(n);
            let se = ((square / f64::from(n) - mean * mean) / f64::from(n)).sqrt();
            let expected = 2.0 * PI * (1.0 - libm::cos(half));
            assert!((mean - expected).abs() < 4.0 * se && se < 0.02 * expected, "{radii}: {mean} +- {se}, {expected}");
        });
    }
}

/// Light goes from a lamp to an eye as it would go back: chains and irradiances are the same with both exchanged, by mirrors and by glass, convex and hollow.
#[test]
fn reflections_go_either_way() {
    let ball = |radius: f64| Solid::Ellipsoid { center: DVec3::ZERO, radii: DVec3::splat(radius) };
    let spheroid = Solid::Ellipsoid { center: DVec3::ZERO, radii: DVec3::new(0.6, 1.0, 1.4) };
    let cuboid = Solid::Box { low: DVec3::splat(-1.2), high: DVec3::new(1.2, 1.2, 0.4) };
    let worlds = [
        vec![(ball(1.0), 6)],
        vec![(spheroid.clone(), 1)],
        vec![(spheroid, 0), (cuboid, 2)],
        vec![(Solid::tube(2.0, 2.4, DVec2::ZERO, -1.0, 1.0), 2)],
    ];
    for (k, bodies) in worlds.into_iter().enumerate() {
        let case = case("either way", bodies, Lamp::point(DVec3::ZERO, 4.0 * PI), &[]);
        let mut seen = 0;
        with_walker(&case, |walker| {
            for i in 0..2000 {
                let (a, b) = (3.0 * direction(2 * i), (1.5 + f64::from(i % 7)) * direction(2 * i + 1));
                if walker.index_around(a) != 1.0 || walker.index_around(b) != 1.0 {
                    continue;
                }
                let (from_a, from_b) = (Lamp::point(a, 4.0 * PI), Lamp::point(b, 4.0 * PI));
                let brightness = |connections: Vec<Connection>| {
                    let mut brightness: Vec<f64> = connections.iter().map(|connection| connection.irradiance).collect();
                    brightness.sort_by(f64::total_cmp);
                    brightness
                };
                let there = brightness(one_reflection(walker, Source::Lamp(0, &from_a), b));
                let back = brightness(one_reflection(walker, Source::Lamp(0, &from_b), a));
                let same =
                    there.len() == back.len() && there.iter().zip(&back).all(|(x, y)| (x / y - 1.0).abs() < 1e-6);
                assert!(same, "{k}: {a} {b}: {there:?} {back:?}");
                seen += there.len();
            }
        });
        assert!(seen > 200, "{k}: {seen}");
    }
}

/// What a camera sees by interfaces alone, by one reflection for sure and by several interfaces by manifold sampling, and of the lamp itself is the light that walks forward to its pinhole:
/// behind glass, and over a bowl of mirrors in which light goes to and fro. Four standard errors.
#[test]
fn lamp_reflections_are_the_light_that_walks_forward() {
    let ball = |center: [f64; 3], radius: f64| Solid::Ellipsoid { center: center.into(), radii: DVec3::splat(radius) };
    let cuboid = Solid::Box { low: DVec3::new(-3.0, -3.0, -2.0), high: DVec3::new(3.0, 3.0, 0.3) };
    let eye = [([0.0, 0.0, EYE], 0.3)];
    let lamp = |x: f64, y: f64, z: f64| Lamp::point(DVec3::new(x, y, z), 4.0 * PI);
    // Through glass the lamp is seen, over the bowl it is beside the camera.
    let cases = [
        (case("glass", vec![(ball([0.0; 3], 1.0), 3)], lamp(0.3, 0.2, -1.3), &eye), 0.0),
        (case("bowl", vec![(ball([0.0, 0.0, 0.5], 1.0), 0), (cuboid, 6)], lamp(1.6, 0.6, 2.4), &eye), 1.0),
    ];
    for (k, (case, direct)) in cases.into_iter().enumerate() {
        let (walked, walked_se) = forward(&case, 20 + k as u32, 2_000_000)[0];
        let n = 40_000;
        let (mut sum, mut square, mut sampled_sum) = (0.0, 0.0, 0.0);
        with_walker(&case, |walker| {
            for i in 0..n {
                let [u, ..] = philox4x32([i, 0, 0, 1], [13, 14]).map(unit);
                let r = DVec3::from(eye[0].0) + eye[0].1 * libm::cbrt(u) * direction(i);
                let source = Source::Lamp(0, &case.lamp);
                let strength = |connection: &Connection| connection.irradiance * libm::exp(-connection.tau);
                let known: f64 = one_reflection(walker, source, r).iter().map(strength).sum();
                let mut dice = Dice::of([15, 16, i, 0]);
                let connection =
                    walker.sample_manifold_of_lamp_reflection(source, r, Beginning::Image, &mut dice, |_| true);
                let sampled = connection.as_ref().map_or(0.0, strength);
                let all = known + sampled + direct * case.lamp.arrival(r).unwrap().irradiance;
                (sum, square, sampled_sum) = (sum + all, square + all * all, sampled_sum + sampled);
            }
            assert_eq!(walker.given_up, 0, "{}", case.name);
        });
        let (mean, sampled) = (sum / f64::from(n), sampled_sum / f64::from(n));
        let se = f64::hypot(walked_se, ((square / f64::from(n) - mean * mean) / f64::from(n)).sqrt());
        println!("{}: {walked} +- {walked_se}, {mean}, {sampled} of it by manifold sampling, both +- {se}", case.name);
        assert!((mean - walked).abs() < 4.0 * se, "{}: {walked}, {mean} +- {se}", case.name);
        // Behind glass all of it is; over the bowl a part that light walked forward hardly resolves.
        assert!(sampled > 4.0 * (1.0 - direct) * se, "{}: {sampled} +- {se}", case.name);
    }
}
