//! Rough walls, and specular light that is excluded.

use std::collections::BTreeMap;
use std::f64::consts::PI;

use glam::DVec3;
use turbid_contract::payload::{Lamp, Medium, Object, Scene, Shape, Specular, Surface};
use turbid_optics::rough::Rough;

use crate::setup::*;

fn dye() -> Medium {
    Medium { n: 1.4, ..medium(5.0, 0.0, 0.0) }
}

fn rough(object: Object, alpha: f64) -> Object {
    Object { surface: Surface::Rough(alpha), ..object }
}

/// One small pixel in the middle of an oblique view under oblique light, near the mirror's angle.
fn highlit(m: Medium, floor: Object, specular: Specular) -> Scene {
    let (mut camera, mut projector) = rig(100.0, 0.0, 0.001, 1, 60.0);
    camera.position = [40.0, 5.0, 100.0];
    camera.specular = Some(specular);
    projector.position = [-30.0, 10.0, 90.0];
    scene(&[("m", m)], vec![floor], (camera, projector))
}

/// Over a black medium the highlight is the response of the facets, here against a white Lambertian floor in the same light:
/// response * pi / cos. The pixel is 1e-5 of the distance wide, the facets' density changes by less than 10 per radian: 1e-4.
/// `exclude` leaves nothing of it.
#[test]
fn highlights_are_the_response_of_facets() {
    let white = dc(&highlit(dye(), lambertian(FLOOR, 1.0), Specular::Exclude), 16, 1).0;
    let (v, l) = (DVec3::new(40.0, 5.0, 100.0).normalize(), DVec3::new(-30.0, 10.0, 90.0).normalize());
    for alpha in [0.15, 0.4, 1.0] {
        let floor = || rough(object(FLOOR, "m", 0), alpha);
        let (seen, _) = dc(&highlit(dye(), floor(), Specular::Include), 16, 1);
        let facets = Rough { alpha, normal: DVec3::Z, n_from: 1.0, n_to: 1.4 };
        let expected = facets.response(-v, l) * PI / l.z * white;
        assert!((seen / expected - 1.0).abs() < 1e-4, "alpha {alpha}: {seen:e}, {expected:e}");
        assert_eq!(dc(&highlit(dye(), floor(), Specular::Exclude), 16, 1).0, 0.0);
    }
}

/// What `exclude` leaves out of a turbid half-space is the highlight of a black one, path by path: 1e-6, frames are f32.
#[test]
fn what_is_excluded_is_the_highlight() {
    let m = Medium { n: 1.4, ..medium(0.5, 2.0, 0.5) };
    let floor = || rough(object(FLOOR, "m", 0), 0.5);
    let seen = |m: &Medium, specular| dc(&highlit(m.clone(), floor(), specular), 2000, 3);
    let (all, _) = seen(&m, Specular::Include);
    let (scattered, se) = seen(&m, Specular::Exclude);
    let (highlight, _) = seen(&dye(), Specular::Include);
    assert!((all - scattered - highlight).abs() < 1e-6 * all, "{all:e} {scattered:e} {highlight:e}");
    assert!(scattered > 2.0 * se && highlight > 0.1 * all, "{scattered:e} +- {se:e} of {all:e}");
}

/// A smooth black half-space mirrors Fresnel's ((n - 1) / (n + 1))^2 of an even sky seen straight on: a coin per path. Excluded, it is black.
#[test]
fn the_mirrored_sky_is_excluded() {
    let seen = |specular| {
        let (mut camera, projector) = rig(1000.0, 0.0, 0.001, 1, 100.0);
        camera.specular = specular;
        let mut dark = scene(&[("m", dye())], vec![object(FLOOR, "m", 0)], (camera, projector));
        dark.projector = None;
        dark.lights = BTreeMap::from([("sky".to_owned(), Lamp::Ambient { radiance: vec![2.0] })]);
        dc(&dark, 40_000, 5).0
    };
    let share: f64 = (0.4_f64 / 2.4).powi(2);
    let coin = 2.0 * (share * (1.0 - share) / 40_000.0).sqrt();
    let mirrored = seen(None);
    assert!((mirrored - 2.0 * share).abs() < 4.5 * coin, "{mirrored} of {} +- {coin}", 2.0 * share);
    assert_eq!(seen(Some(Specular::Exclude)), 0.0);
}

/// Camera and projector may change places: bodies that are not slabs behind rough walls, in which no connection is specular. Pixels and
/// projector fields cover the same solid angles with as many paths, so both images have the same mean.
#[test]
fn places_may_change_across_rough_walls() {
    let media =
        [("m", Medium { n: 1.4, ..medium(0.02, 2.0, 0.8) }), ("core", Medium { n: 1.5, ..medium(0.1, 3.0, 0.5) })];
    let objects = || {
        vec![
            rough(object(Shape::Slab { top: 0.0, bottom: -6.0 }, "m", 0), 0.5),
            rough(object(Shape::Sphere { diameter: 5.0, center: [1.0, 1.0, 0.5] }, "core", 1), 0.3),
            lambertian(Shape::Box { size: [2.0, 2.0, 3.0], center: [0.0, -3.0, 1.5] }, 0.8),
        ]
    };
    let (mut camera, mut projector) = rig(40.0, 0.0, 8.0, 4, 5.0);
    camera.position = [20.0, 3.0, 30.0];
    camera.specular = Some(Specular::Include);
    projector.position = [-6.0, 24.0, 30.0];
    projector.look_at = [1.0, 0.5, 0.0];
    let (mut swapped_camera, mut swapped_projector) = (camera.clone(), projector.clone());
    (swapped_camera.position, swapped_camera.look_at) = (projector.position, projector.look_at);
    (swapped_projector.position, swapped_projector.look_at) = (camera.position, camera.look_at);
    (swapped_camera.field, swapped_projector.field) = (projector.field, camera.field);
    let (a, a_se) = dc(&scene(&media, objects(), (camera, projector)), 24_000, 7);
    let (b, b_se) = dc(&scene(&media, objects(), (swapped_camera, swapped_projector)), 24_000, 8);
    let z = (a - b) / f64::hypot(a_se, b_se);
    assert!(z.abs() < 4.0, "{a} +- {a_se}, swapped {b} +- {b_se}");
    assert!(a_se < 0.03 * a && b_se < 0.03 * b, "{a} +- {a_se}, {b} +- {b_se}");
}

/// Walls of little roughness are nearly smooth: the mean slope alpha changes the radiance of a half-space by some alpha^2, and the
/// light between facets that is lost is less than that.
#[test]
fn a_little_roughness_changes_little() {
    let alpha = 0.1;
    let seen = |surface, samples| {
        let m = Medium { n: 1.4, ..medium(0.1, 2.0, 0.5) };
        let slab = Object { surface, ..object(FLOOR, "m", 0) };
        let (mut camera, projector) = rig(300.0, 40.0, 4.0, 4, 60.0);
        camera.specular = Some(Specular::Exclude);
        dc(&scene(&[("m", m)], vec![slab], (camera, projector)), samples, 19)
    };
    let ((smooth, smooth_se), (rough, rough_se)) = (seen(Surface::Smooth, 6000), seen(Surface::Rough(alpha), 80_000));
    let se = f64::hypot(smooth_se, rough_se);
    assert!(
        (rough - smooth).abs() < 4.0 * se + 2.0 * alpha * alpha * smooth,
        "{rough} +- {rough_se}, {smooth} +- {smooth_se}"
    );
    assert!(se < 0.03 * smooth, "{se} of {smooth}");
}
