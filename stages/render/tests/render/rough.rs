//! Rough walls, and specular light that is excluded.

use std::collections::BTreeMap;
use std::f64::consts::PI;

use glam::DVec3;
use turbid_contract::payload::{
    Aperture, Detector, Lamp, Medium, Object, Outline, Projection, Scene, Shape, Specular, Surface,
};
use turbid_optics::philox::{philox4x32, unit};
use turbid_optics::rough::Rough;

use crate::peaked;
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

/// Mean of the response over walks among the facets, and its standard error.
fn response(facets: &Rough, w: DVec3, l: DVec3) -> (f64, f64) {
    let (walks, mut flights) = (200_000, Vec::new());
    let (mut sum, mut squares) = (0.0, 0.0);
    for walk in 0..walks {
        let mut throw = 0;
        let draw = || {
            throw += 1;
            philox4x32([walk, throw, 0, 0], [17, 0]).map(unit)
        };
        facets.walk(w, draw, &mut flights);
        let seen = facets.response(&flights, l);
        (sum, squares) = (sum + seen, squares + seen * seen);
    }
    let n = f64::from(walks);
    (sum / n, ((squares / n - (sum / n) * (sum / n)) / n).sqrt())
}

/// Over a black medium the highlight is the response of the facets, here against a white Lambertian floor in the same light:
/// response * pi / cos, to 5 standard errors. The pixel is 1e-5 of the distance wide, the facets' density changes by less than 10 per radian: 1e-4.
/// `exclude` leaves nothing of it.
#[test]
fn highlights_are_the_response_of_facets() {
    let white = dc(&highlit(dye(), lambertian(FLOOR, 1.0), Specular::Exclude), 16, 1).0;
    let (v, l) = (DVec3::new(40.0, 5.0, 100.0).normalize(), DVec3::new(-30.0, 10.0, 90.0).normalize());
    for alpha in [0.15, 0.4, 1.0] {
        let floor = || rough(object(FLOOR, "m", 0), alpha);
        let (seen, seen_se) = dc(&highlit(dye(), floor(), Specular::Include), 20_000, 1);
        let facets = Rough { alpha, normal: DVec3::Z, n_from: 1.0, n_to: 1.4 };
        let (expected, se) = response(&facets, -v, l);
        let (seen, seen_se) = (seen * l.z / (PI * white), seen_se * l.z / (PI * white));
        let error = f64::hypot(se, seen_se);
        println!("alpha {alpha}: {seen:e} +- {seen_se:e}, {expected:e} +- {se:e}");
        assert!(
            (seen - expected).abs() < 5.0 * error + 1e-4 * expected && error < 0.01 * expected,
            "alpha {alpha}: {seen:e} +- {seen_se:e}, {expected:e} +- {se:e}"
        );
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

/// Walls of little roughness are nearly smooth: the mean slope alpha changes the radiance of a half-space by some alpha^2.
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

/// The power of a beam that photons bring through a disc is what a camera with that disc as its lens sees: its mean radiance over a field that holds
/// all the light, times both areas over distance^2, times cos^4 over the lens, 1 / (1 + (radius / distance)^2). The field is 16 mm, of which light
/// comes from 3 mm around the axis: 5e-4. From above and from below; off the facets alone, and through a slab.
#[test]
fn a_lens_sees_what_photons_bring_there() {
    const DISTANCE: f64 = 200.0;
    const RADIUS: f64 = 25.0;
    const FIELD: f64 = 16.0;
    let murky = Medium { n: 1.4, ..medium(0.5, 2.0, 0.5) };
    let black = Medium { n: 2.5, ..medium(5.0, 0.0, 0.0) };
    let clear = Medium { n: 1.5, ..medium(1.0, 0.5, 0.8) };
    for (name, m, alpha, thickness, above) in [
        ("murky", murky, 0.5, 20.0, 1.0),
        ("black", black, 0.7, 20.0, 1.0),
        ("clear, from above", clear.clone(), 1.0, 0.5, 1.0),
        ("clear, from below", clear, 1.0, 0.5, -1.0),
    ] {
        let slab = rough(object(Shape::Slab { top: 0.0, bottom: -thickness }, "m", 0), alpha);
        let mut scene = beam_on(scene(&[("m", m)], vec![slab], rig(DISTANCE, 0.0, FIELD, 1, 9.0)));
        let at = [0.0, 0.0, above * DISTANCE];
        let camera = scene.camera.as_mut().expect("a camera");
        camera.position = at;
        camera.specular = Some(Specular::Include);
        camera.projection = Projection::Pinhole;
        camera.aperture = Some(Aperture { diameter: 2.0 * RADIUS, focus: DISTANCE });
        let lamp =
            Lamp::Collimated { position: [30.0, 10.0, 60.0], look_at: [0.0; 3], diameter: 6.0, power: vec![1.0] };
        scene.lights = [("beam".to_owned(), lamp)].into();
        let outline = Outline::Disc { diameter: 2.0 * RADIUS };
        let disc = Detector { outline, position: at, facing: [0.0, 0.0, -above], half_angle_deg: 90.0, absorbs: false };
        scene.detectors = [("disc".to_owned(), disc)].into();
        let photons = power(&scene, 1_000_000, 3);
        let (_, counted, _, counted_se) = photons.iter().find(|row| row.0 == "through disc").expect("a disc");
        let (radiance, se) = dc(&scene, 500_000, 4);
        let areas = FIELD * FIELD * PI * RADIUS * RADIUS / (DISTANCE * DISTANCE);
        let of_lens = areas / (1.0 + (RADIUS / DISTANCE).powi(2));
        let (seen, seen_se) = (radiance * of_lens, se * of_lens);
        let error = f64::hypot(seen_se, *counted_se);
        println!("{name}: photons {counted} +- {counted_se}, lens {seen} +- {seen_se}");
        assert!(
            (seen - counted).abs() < 4.0 * error + 1e-3 * seen,
            "{name}: {counted} +- {counted_se}, {seen} +- {seen_se}"
        );
        assert!(error < 0.05 * seen, "{name}: {error} of {seen}");
    }
}

/// A half-space of mu_a = 0.02, mu_s' = 1 mm^-1 and n = 1.4 behind a rough wall, of which 16 x 16 pixels alike are seen.
fn half_space(alpha: f64) -> Scene {
    let mut scene = peaked::half_space(0.8, 16);
    scene.media.get_mut("tissue").expect("it is there").n = 1.4;
    scene.objects.get_mut("a").expect("it is there").surface = Surface::Rough(alpha);
    scene.camera.as_mut().expect("a camera").specular = Some(Specular::Exclude);
    scene
}

/// Light comes out through facets in a lobe that few paths find, as under a narrow phase function: after 64 paths of 16 x 16 pixels two standard errors hold the truth as
/// often as they say, or nothing is known of them: the image of alpha = 0.05 has 16,384 of the 100,000 paths that it takes.
#[test]
fn errors_hold_the_truth_behind_rough_walls() {
    for (alpha, seeds) in [(1.0, 8), (0.3, 12)] {
        let found = peaked::found(&half_space(alpha), 64, seeds);
        println!("alpha = {alpha}: {found:?}");
        assert!(found.unknown == 0.0 && peaked::holds(&found, seeds as f64), "alpha = {alpha}: {found:?}");
    }
    let found = peaked::found(&half_space(0.05), 64, 1);
    assert_eq!(found.unknown, 1.0, "{found:?}");
}

/// `check` and `plan` say what a rough wall costs.
#[test]
fn check_and_plan_say_what_facets_cost() {
    let (warnings, needs) = peaked::said(&half_space(0.1), 64);
    assert!(warnings.len() == 1 && warnings[0].path == "samples", "{warnings:?}");
    assert!(warnings[0].message.contains("rough = 0.1 of a at n = 1.4") && needs.contains("rough = 0.1"), "{needs}");
    assert!(warnings[0].message.contains("unknown"), "{warnings:?}");
    let (warnings, needs) = peaked::said(&half_space(1.0), 64);
    assert!(warnings.is_empty() && needs.contains("rough = 1 "), "{warnings:?} {needs}");
}
