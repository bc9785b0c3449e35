use glam::{DVec2, DVec3};

use super::*;
use crate::philox::{philox4x32, unit};
use crate::solid::Frame;

/// Random numbers in (-1, 1).
fn cube(i: u32) -> DVec3 {
    let [a, b, c, _] = philox4x32([i, 0, 0, 0], [5, 6]);
    2.0 * DVec3::new(unit(a), unit(b), unit(c)) - 1.0
}

fn ends(i: u32, scale: f64) -> Ends {
    let (near, place) = (scale * cube(2 * i), cube(2 * i + 1));
    let far = match i % 4 {
        0 => Far::Direction(place.normalize()),
        1 => Far::Point(30.0 * place),
        _ => Far::Point(scale * place),
    };
    Ends::alike(far, near)
}

fn found(solid: &Solid, ends: &Ends) -> Vec<DVec3> {
    let mut found = Vec::new();
    solid.reflections(ends, &mut |p| found.push(p));
    found
}

/// The law of reflection in vectors at every point found, to 1e-11; both ends on one side; and a point of the surface. On either side.
#[test]
fn light_obeys_the_law_of_reflection() {
    let frame = Frame::turned(DVec3::new(0.5, -0.3, 0.2), [25.0, -40.0, 70.0]);
    let axis = DVec2::new(0.3, -0.4);
    let solids = [
        Solid::Slab { bottom: -3.0, top: 0.5 },
        Solid::Box { low: DVec3::new(-1.0, -2.0, -3.0), high: DVec3::new(2.0, 0.5, 1.0) },
        Solid::Ellipsoid { center: DVec3::new(0.3, -0.2, 0.1), radii: DVec3::splat(1.7) },
        Solid::Ellipsoid { center: DVec3::new(0.3, -0.2, 0.1), radii: DVec3::new(1.0, 1.7, 2.5) },
        Solid::Cylinder { axis, radius: 1.5, bottom: -2.0, top: 1.0 },
        Solid::Box { low: DVec3::new(-1.0, -0.5, -2.0), high: DVec3::new(1.0, 1.5, 1.0) }.turned(frame),
        Solid::Ellipsoid { center: DVec3::ZERO, radii: DVec3::new(0.8, 0.8, 2.5) }.turned(frame),
        Solid::tube(2.0, 4.0, axis, -2.0, 2.0),
        Solid::sphere_shell(2.0, 3.0, DVec3::ZERO, Vec::new()),
    ];
    for solid in solids {
        let [mut outside, mut inside] = [0; 2];
        for i in 0..2000 {
            let ends = ends(i, 2.0);
            for p in found(&solid, &ends) {
                // Of carved solids the face that holds it; of its walls what other walls cut off does not count.
                let carved = matches!(solid, Solid::Carved(_));
                let face = match &solid {
                    Solid::Carved(carved) => u32::from(carved.holes[0].clearance(p) < 1e-12),
                    _ => 0,
                };
                assert!(carved || solid.clearance(p) < 1e-12 * (1.0 + p.length()), "{solid:?} {p}");
                if carved && solid.clearance(p) > 1e-12 * (1.0 + p.length()) {
                    continue;
                }
                let n = solid.normal(face, p);
                let (a, b) = (ends.far.from(p).0, (ends.near - p).normalize());
                let off = (a + b).cross(n).length();
                // A direction from p has as many digits as the distance.
                assert!(off < 1e-11 + 1e-14 / (ends.near - p).length(), "{off} {p} {ends:?} {solid:?}");
                assert!(a.dot(n) * b.dot(n) > 0.0);
                *(if a.dot(n) > 0.0 { &mut outside } else { &mut inside }) += 1;
            }
        }
        assert!(outside > 200 && inside > 200, "{solid:?}: {outside} outside, {inside} inside");
    }
}

/// In a plane through the middle of a sphere, and across a cylinder, all places are found that a scan of 20,000 points of the circle sees, where its
/// residual changes its sign; and no others.
#[test]
fn a_circle_reflects_where_a_dense_scan_says() {
    let flat = DVec3::new(1.0, 1.0, 0.0);
    let solids = [
        Solid::Ellipsoid { center: DVec3::ZERO, radii: DVec3::ONE },
        Solid::Cylinder { axis: DVec2::ZERO, radius: 1.0, bottom: -1e3, top: 1e3 },
    ];
    let mut several = [0; 5];
    for i in 0..300 {
        let ends = ends(i, 1.1).moved(|p| p * flat, |w| (w * flat).normalize());
        let residual = |k: i32| {
            let phi = 2.0 * std::f64::consts::PI * f64::from(k) / 20_000.0;
            let (p, along) = (DVec3::new(phi.cos(), phi.sin(), 0.0), DVec3::new(-phi.sin(), phi.cos(), 0.0));
            let (a, b) = (ends.far.from(p).0, (ends.near - p).normalize());
            ((a + b).dot(along), a.dot(p) * b.dot(p) > 0.0)
        };
        let seen = |k: &i32| {
            let ((r0, side0), (r1, side1)) = (residual(*k), residual(k + 1));
            side0 && side1 && r0 * r1 < 0.0
        };
        let places: Vec<f64> = (0..20_000).filter(seen).map(|k| (f64::from(k) + 0.5) / 20_000.0).collect();
        for solid in &solids {
            let round = found(solid, &ends).into_iter().filter(|p| p.z.abs() < 500.0);
            let turns = |p: DVec3| libm::atan2(p.y, p.x).rem_euclid(TAU) / TAU;
            let mut at: Vec<f64> = round.map(turns).collect();
            at.sort_by(f64::total_cmp);
            let same = at.len() == places.len() && at.iter().zip(&places).all(|(a, b)| (a - b).abs() < 2e-4);
            assert!(same, "{solid:?} {ends:?}: {at:?}, scan {places:?}");
        }
        several[places.len()] += 1;
    }
    assert!(several[1] > 20 && several[2] > 50 && several[4] > 10, "{several:?}");
}

/// What bounds leave of a sphere are the roots of its polynomial.
#[test]
fn patches_of_a_sphere_hold_its_places() {
    let mut seen = 0;
    for i in 0..500 {
        let ends = ends(i, 1.2);
        let solid = Solid::Ellipsoid { center: DVec3::ZERO, radii: DVec3::ONE };
        let mut by_patches = Vec::new();
        ellipsoid::reflections(&ends, DVec3::ONE, &mut |p| by_patches.push(p));
        let by_roots = found(&solid, &ends);
        assert_eq!(by_patches.len(), by_roots.len(), "{ends:?}: {by_patches:?} {by_roots:?}");
        for p in &by_roots {
            // Near a focus a place is worth few digits.
            assert!(by_patches.iter().any(|q| (*p - *q).length() < 1e-6), "{ends:?}: {by_patches:?} {p}");
        }
        seen += by_roots.len();
    }
    assert!(seen > 600, "{seen}");
}

/// On a closed surface like a sphere the minima and maxima of a function outnumber its saddles by two (Poincare and Hopf). Of the optical length |far - p| +
/// |near - p| the places of reflection are all there are, but for minima where the straight line between the ends meets the surface. So none is missing and
/// none is false, or as many of either kind.
#[test]
fn places_on_an_ellipsoid_add_up() {
    let mut counts = [0; 9];
    for (k, radii) in
        [DVec3::new(1.0, 1.7, 2.5), DVec3::new(1.0, 1.0, 2.0), DVec3::new(4.0, 4.0, 0.8)].into_iter().enumerate()
    {
        let solid = Solid::Ellipsoid { center: DVec3::ZERO, radii };
        let mut unclear = 0;
        for i in 0..400 {
            let ends = ends(1000 * k as u32 + i, 2.0);
            let length = |p: DVec3| {
                let far = match ends.far {
                    Far::Point(a) => (a - p).length(),
                    Far::Direction(towards) => -towards.dot(p),
                };
                far + (ends.near - p).length()
            };
            let places = found(&solid, &ends);
            let mut sum = 0.0;
            let mut clear = true;
            for p in &places {
                let s = *p / radii;
                let (x, y) = s.any_orthonormal_pair();
                let h = 1e-4;
                let at = |i: f64, j: f64| length(radii * (s + h * i * x + h * j * y).normalize());
                let middle = at(0.0, 0.0);
                let xx = at(1.0, 0.0) + at(-1.0, 0.0) - 2.0 * middle;
                let yy = at(0.0, 1.0) + at(0.0, -1.0) - 2.0 * middle;
                let xy = 0.25 * (at(1.0, 1.0) + at(-1.0, -1.0) - at(1.0, -1.0) - at(-1.0, 1.0));
                let det = (xx * yy - xy * xy) / (h * h * h * h);
                sum += det.signum();
                // What differences of 1e-16 and steps of h leave.
                clear &= det.abs() > 1e-5;
            }
            let (towards, inverse) = ends.far.from(ends.near);
            let (enter, leave) = solid.chord(ends.near, towards);
            let crossed =
                [enter, leave].into_iter().filter(|t| enter < leave && *t > 0.0 && *t * inverse < 1.0).count();
            counts[places.len()] += 1;
            unclear += usize::from(!clear);
            assert!(!clear || sum + crossed as f64 == 2.0, "{radii} {ends:?}: {places:?}, crossed {crossed}");
        }
        assert!(unclear < 20, "{radii}: {unclear}");
    }
    assert!(counts[1] > 100 && counts[2] > 100 && counts[4] + counts[5] + counts[6] > 50, "{counts:?}");
}

/// Where light is in focus, on the axis of a cylinder or of a spheroid or in line with the middle of a sphere, the search comes to an end, and finds some of the ring.
#[test]
fn rings_of_places_are_met() {
    let far = |z: f64| Ends::alike(Far::Point(z * DVec3::Z), 0.1 * DVec3::Z);
    let cylinder = Solid::Cylinder { axis: DVec2::ZERO, radius: 1.0, bottom: -5.0, top: 5.0 };
    assert!(found(&cylinder, &far(3.0)).iter().any(|p| (p.truncate().length() - 1.0).abs() < 1e-12));
    let off_axis = |p: &DVec3| p.truncate().length() > 0.1;
    let ball = Solid::Ellipsoid { center: DVec3::ZERO, radii: DVec3::ONE };
    assert!(found(&ball, &far(-0.3)).len() <= 4);
    let bowl = Solid::Ellipsoid { center: DVec3::ZERO, radii: DVec3::new(1.0, 1.0, 1.3) };
    let ring = found(&bowl, &far(-0.3));
    assert!(ring.iter().any(off_axis), "{}", ring.len());
}
