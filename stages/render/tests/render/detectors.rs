//! Integrating detectors against closed forms, the transport solver, and each other.

use turbid_contract::payload::{Detector, Lamp, Outline, Scene, Shape};
use turbid_optics::{Medium, rte};

use crate::setup::*;

fn disc(z: f64, diameter: f64, facing_z: f64, half_angle_deg: f64) -> Detector {
    let outline = Outline::Disc { diameter };
    Detector { outline, position: [0.0, 0.0, z], facing: [0.0, 0.0, facing_z], half_angle_deg, absorbs: false }
}

fn with_detectors(mut scene: Scene, lamp: Lamp, detectors: Vec<(&str, Detector)>) -> Scene {
    scene.projector = None;
    scene.lights = [("lamp".to_owned(), lamp)].into();
    scene.detectors = detectors.into_iter().map(|(name, d)| (name.to_owned(), d)).collect();
    scene
}

fn share(found: &[(String, f64, f64, f64)], name: &str) -> (f64, f64) {
    let row = found.iter().find(|row| row.0 == name).unwrap_or_else(|| panic!("{name} is not in {found:?}"));
    (row.2, row.3)
}

/// Above a Lambertian floor lit by a thin beam: through a coaxial disc of radius a at height h comes rho a^2 / (a^2 + h^2), under a
/// half angle alpha rho sin^2(alpha) at most; through a square the view factor of a point below its middle. The beam itself comes down
/// through all of them, which face the floor. Beside that, the solid angle of a disc seen by a point light.
#[test]
fn closed_forms() {
    let (rho, h): (f64, f64) = (0.7, 5.0);
    let floor = || lambertian(Shape::Slab { top: 0.0, bottom: -9.0 }, rho);
    let view = || rig(60.0, 0.0, 4.0, 1, 9.0);
    let thin = Lamp::Collimated { position: [0.0, 0.0, 50.0], look_at: [0.0; 3], diameter: 1e-6, power: vec![2.0] };
    let side: f64 = 8.0;
    let square = Detector {
        outline: Outline::Rectangle { up: [1.0, 0.0, 0.0], size: [side, side] },
        ..disc(h, 1.0, -1.0, 90.0)
    };
    let detectors = vec![
        ("wide", disc(h, 6.0, -1.0, 90.0)),
        ("narrow", disc(h, 60.0, -1.0, 30.0)),
        ("square", square),
        ("down", disc(2.0, 1.0, 1.0, 90.0)),
    ];
    let found = power(&with_detectors(scene(&[], vec![floor()], view()), thin, detectors), 100_000, 1);
    // Of a square above the point: four corners of a = b = side / 2.
    let x = 0.5 * side / h;
    let corner = 2.0 * x / (1.0 + x * x).sqrt() * (x / (1.0 + x * x).sqrt()).atan() / std::f64::consts::TAU;
    let expected = [
        ("through wide", rho * 9.0 / (9.0 + h * h)),
        ("through narrow", rho * 0.25),
        ("through square", rho * 4.0 * corner),
    ];
    let mut squares = 0.0;
    for (name, expected) in expected {
        let (share, se) = share(&found, name);
        let z = (share - expected) / se;
        assert!(z.abs() < 4.5, "{name}: {share} +- {se}, {expected}");
        squares += z * z;
    }
    // Three scores (of shared photons): 99.9 % of chi^2.
    assert!(squares < 16.3, "{squares}");
    assert_eq!(share(&found, "through down"), (1.0, 0.0));
    let lamp = Lamp::Point { position: [0.0, 0.0, 20.0], power: vec![3.0] };
    let far = scene(&[], vec![lambertian(Shape::Slab { top: -90.0, bottom: -99.0 }, 0.0)], view());
    let found = power(&with_detectors(far, lamp, vec![("disc", disc(14.0, 6.0, 1.0, 90.0))]), 100_000, 2);
    let (share, se) = share(&found, "through disc");
    let expected = 0.5 * (1.0 - 6.0 / (36.0f64 + 9.0).sqrt());
    assert!((share - expected).abs() < 4.5 * se, "{share} +- {se}, {expected}");
}

/// Two closed boxes of detectors that look inwards, one in the other, around a light and a scattering ball: every photon that
/// leaves goes out through each of them once. Taken by the inner box, none is left to leave.
#[test]
fn nested_shells_count_the_same_photons() {
    let ink = medium(0.2, 3.0, 0.6);
    let faces = |half: f64, absorbs: bool| {
        let face = move |axis: usize, sign: f64| {
            let (mut position, mut facing, mut up) = ([0.0; 3], [0.0; 3], [0.0; 3]);
            (position[axis], facing[axis], up[(axis + 1) % 3]) = (sign * half, -sign, 1.0);
            let outline = Outline::Rectangle { up, size: [2.0 * half; 2] };
            Detector { outline, position, facing, half_angle_deg: 90.0, absorbs }
        };
        (0..3).flat_map(move |axis| [-1.0, 1.0].map(|sign| (axis, sign))).map(move |(axis, sign)| face(axis, sign))
    };
    let names: Vec<String> = (0..12).map(|i| format!("{}{i}", if i < 6 { "in" } else { "out" })).collect();
    let ball = object(Shape::Sphere { diameter: 4.0, center: [0.0; 3] }, "ink", 0);
    let of = |absorbs: bool| {
        let lamp = Lamp::Point { position: [0.0, 0.5, 4.0], power: vec![1.0] };
        let detectors = names.iter().map(String::as_str).zip(faces(6.0, absorbs).chain(faces(9.0, false))).collect();
        let scene = with_detectors(
            scene(&[("ink", ink.clone())], vec![ball.clone()], rig(60.0, 0.0, 4.0, 1, 9.0)),
            lamp,
            detectors,
        );
        let found = power(&scene, 20_000, 3);
        let sum = |start: &str| found.iter().filter(|row| row.0.starts_with(start)).map(|row| row.2).sum::<f64>();
        (sum("left"), sum("absorbed"), [sum("through in"), sum("taken by in"), sum("through out")])
    };
    let (left, absorbed, [inner, _, outer]) = of(false);
    assert!(left > 0.5 && absorbed > 0.01, "{left} {absorbed}");
    assert!((inner - left).abs() < 1e-12 && (outer - left).abs() < 1e-12, "{left}, in {inner}, out {outer}");
    let (none, again, [_, taken, beyond]) = of(true);
    assert!(none == 0.0 && beyond == 0.0 && again == absorbed, "{none} {beyond} {again}");
    assert!((taken - left).abs() < 1e-12, "{taken}, left {left}");
}

/// Total transmittance of slabs by a wide detector in the plane of their far face (where light at n = 1.4 is turned back) and below it, against
/// the transport solver, and the light that comes up through a detector on top, in two channels.
#[test]
fn slabs_transmit_what_the_solver_says() {
    let wide = |z: f64, facing_z: f64| disc(z, 2e3, facing_z, 90.0);
    for (seed, n) in [(5, 1.0), (6, 1.4)] {
        let mut m = medium(0.05, 4.0, 0.75);
        m.n = n;
        (m.mu_a, m.mu_s) = (vec![0.05, 0.2], vec![4.0, 2.0]);
        let slab = object(Shape::Slab { top: 0.0, bottom: -1.5 }, "m", 0);
        let mut s = scene(&[("m", m.clone())], vec![slab], rig(60.0, 0.0, 4.0, 1, 9.0));
        s.wavelengths_nm = vec![530.0, 635.0];
        s.camera.as_mut().unwrap().specular = Some(turbid_contract::payload::Specular::Exclude);
        let beam =
            Lamp::Collimated { position: [0.0, 0.0, 50.0], look_at: [0.0; 3], diameter: 2.0, power: vec![2.0, 1.0] };
        let detectors = vec![("below", wide(-2.0, 1.0)), ("face", wide(-1.5, 1.0)), ("up", wide(0.0, -1.0))];
        let found = power(&with_detectors(s, beam, detectors), 60_000, seed);
        let channels: Vec<_> = found.chunks(found.len() / 2).collect();
        for (channel, rows) in channels.into_iter().enumerate() {
            let (mu_a, mu_s_prime) = (m.mu_a[channel], 0.25 * m.mu_s[channel]);
            let truth = rte::respond(
                &Medium { mu_a, mu_s_prime, phase: turbid_optics::PhaseFunction::henyey_greenstein(0.75), n },
                Some(1.5),
                0.0,
            )
            .unwrap();
            // What the surface turns back before it enters does not come through its plane.
            let reflected = truth.reflectance.hemispherical_incident;
            for (name, expected) in [
                ("through below", truth.transmittance),
                ("through face", truth.transmittance),
                ("through up", reflected),
            ] {
                let (share, se) = share(rows, name);
                assert!((share - expected).abs() < 4.5 * se, "n {n}, {name}: {share} +- {se}, {expected}");
            }
            assert_eq!(share(rows, "through below"), share(rows, "through face"));
            assert_eq!(share(rows, "through below").0, share(rows, "left downwards").0);
        }
    }
}
