use super::*;

/// Convex ones.
fn solids() -> Vec<Solid> {
    let axis = DVec2::new(0.3, -0.4);
    let frame = Frame::turned(DVec3::new(0.5, -0.3, 0.2), [25.0, -40.0, 70.0]);
    vec![
        Solid::Slab { bottom: -3.0, top: 0.5 },
        Solid::Box { low: DVec3::new(-1.0, -2.0, -3.0), high: DVec3::new(2.0, 0.5, 1.0) },
        Solid::Ellipsoid { center: DVec3::new(0.3, -0.2, 0.1), radii: DVec3::splat(1.7) },
        Solid::Ellipsoid { center: DVec3::new(0.3, -0.2, 0.1), radii: DVec3::new(0.4, 1.7, 3.0) },
        Solid::Cylinder { axis, radius: 1.5, bottom: -2.0, top: 1.0 },
        Solid::Cylinder { axis, radius: 1.5, bottom: -f64::INFINITY, top: 1.0 },
        Solid::Box { low: DVec3::new(-1.0, -0.5, -2.0), high: DVec3::new(1.0, 1.5, 1.0) }.turned(frame),
        Solid::Ellipsoid { center: DVec3::ZERO, radii: DVec3::new(0.5, 1.7, 2.5) }.turned(frame),
        Solid::Cylinder { axis, radius: 0.8, bottom: -2.0, top: 1.0 }
            .turned(Frame::along(DVec3::ZERO, DVec3::new(0.6, 0.0, -0.8))),
    ]
}

/// A tube, a hollow sphere with a round and a square port, a block with a groove.
fn hollows() -> Vec<Solid> {
    let cylinder = |radius: f64, half: f64| Solid::Cylinder { axis: DVec2::ZERO, radius, bottom: -half, top: half };
    let ball = |radius| Solid::Ellipsoid { center: DVec3::ZERO, radii: DVec3::splat(radius) };
    let far = f64::INFINITY;
    let round = Solid::Cylinder { axis: DVec2::ZERO, radius: 0.6, bottom: 0.0, top: far };
    let square = Solid::Box { low: DVec3::new(-0.5, -0.5, 0.0), high: DVec3::new(0.5, 0.5, far) };
    let towards = |w: DVec3| Frame::along(DVec3::ZERO, w.normalize());
    let block = Solid::Box { low: DVec3::splat(-2.0), high: DVec3::splat(2.0) };
    let groove = Solid::Box { low: DVec3::new(-0.75, -9.0, 0.0), high: DVec3::new(0.75, 9.0, 9.0) };
    vec![
        cylinder(2.0, 1.5).carved(vec![cylinder(1.2, far)]),
        ball(2.5).carved(vec![
            ball(2.0),
            round.turned(towards(DVec3::new(1.0, 2.0, -2.0))),
            square.turned(towards(DVec3::X)),
        ]),
        block.carved(vec![groove]),
    ]
}

fn cut(solid: &Solid, origin: DVec3, direction: DVec3, start: Option<Start>) -> Vec<Chord> {
    let mut chords = Vec::new();
    solid.cut(origin, direction, start, &mut chords);
    chords
}

/// The i-th number of the Halton sequence in [0, 1).
fn halton(i: usize, base: usize) -> f64 {
    let (mut n, mut f, mut r) = (i + 1, 1.0, 0.0);
    while n > 0 {
        f /= base as f64;
        r += f * (n % base) as f64;
        n /= base;
    }
    r
}

/// A Halton point in (-4, 4)^3: evenly spread, no generator needed.
fn spread(i: usize) -> DVec3 {
    DVec3::new(halton(i, 2), halton(i, 3), halton(i, 5)) * 8.0 - 4.0
}

/// Ends of an interval lie on the surface, its middle inside, points beyond it outside; |p| < 30, so 1e-12 is
/// some 100 roundings.
#[test]
fn intervals_are_where_the_line_is_inside() {
    for solid in solids() {
        let mut hits = 0;
        for i in 0..1000 {
            let (origin, direction) = (1.5 * spread(i), (spread(i + 1000) - spread(i)).normalize());
            let Some((enter, leave)) = solid.interval(origin, direction) else {
                assert!((0..200).all(|k| !solid.contains(origin + (0.5 * f64::from(k) - 50.0) * direction)));
                continue;
            };
            hits += 1;
            let at = |t: f64| origin + t * direction;
            assert!(solid.contains(at(0.5 * (enter + leave))), "{solid:?} {origin} {direction}");
            for (end, beyond) in [(enter, enter - 1e-9), (leave, leave + 1e-9)] {
                assert!(solid.clearance(at(end)) <= 1e-12, "{solid:?}: {} off", solid.clearance(at(end)));
                assert!(!solid.contains(at(beyond)), "{solid:?} {origin} {direction}");
                let outward = solid.normal(0, at(end)).dot(direction) * (if end == leave { 1.0 } else { -1.0 });
                assert!(outward > 0.0, "{solid:?}: normal {}", solid.normal(0, at(end)));
            }
        }
        assert!(hits > 20, "{solid:?}: {hits} hits");
    }
}

/// The ray meets the surface where `interval` says, from within, from outside, and not behind.
#[test]
fn reach_is_the_first_end_ahead() {
    for solid in solids() {
        let mut met = 0;
        for i in 0..1000 {
            let (p, w) = (1.5 * spread(i), (spread(i + 1000) - spread(i)).normalize());
            let ends = solid.interval(p, w).map_or([f64::INFINITY; 2], |(enter, leave)| [enter, leave]);
            let expected = ends.into_iter().find(|&t| t >= 0.0).unwrap_or(f64::INFINITY);
            assert_eq!(solid.reach(p, w), expected, "{solid:?} {p} {w}");
            met += usize::from(expected < f64::INFINITY);
        }
        assert!((20..1000).contains(&met), "{solid:?}: {met} rays meet it");
    }
}

/// No line through p meets the surface nearer than the clearance, and on a dense fan of lines it is not far from it.
#[test]
fn clearance_is_a_lower_bound_of_the_distance() {
    for solid in solids() {
        for i in 0..40 {
            let p = spread(i);
            let mut nearest = f64::INFINITY;
            for k in 0..2000 {
                let direction = spread(k).normalize();
                if let Some((enter, leave)) = solid.interval(p, direction) {
                    nearest = nearest.min(enter.abs()).min(leave.abs());
                }
            }
            let clearance = solid.clearance(p);
            assert!(clearance <= nearest * (1.0 + 1e-12), "{solid:?} {p}: {clearance} > {nearest}");
            assert!(clearance >= 0.0);
        }
    }
}

/// Along a line, a solid with holes is where `contains` says, its ends lie on the face that they name, and a ray that starts
/// there, off by rounding either way, sees the rest of the same line. |p| < 30, so 1e-12 is some 100 roundings.
#[test]
fn hollow_solids_are_cut_where_they_are() {
    for solid in hollows() {
        let mut several = 0;
        for i in 0..1000 {
            let direction = DVec3::new(halton(i, 7) - 0.5, halton(i, 11) - 0.5, halton(i, 13) - 0.5).normalize();
            let origin = 0.7 * spread(i) - 8.0 * direction;
            let chords = cut(&solid, origin, direction, None);
            let at = |t: f64| origin + t * direction;
            several += usize::from(chords.len() > 1);
            for k in 0..400 {
                let t = 0.07 * f64::from(k) - 14.0;
                let inside = chords.iter().any(|s| s.enter <= t && t <= s.leave);
                assert_eq!(solid.contains(at(t)), inside, "{solid:?} {origin} {direction} {t}");
            }
            for (n, chord) in chords.iter().enumerate() {
                assert!(chord.enter < chord.leave && (n == 0 || chords[n - 1].leave < chord.enter));
                for (t, face, into) in [(chord.enter, chord.into, true), (chord.leave, chord.out_of, false)] {
                    assert!(solid.clearance(at(t)) <= 1e-12, "{solid:?}: {} off", solid.clearance(at(t)));
                    let along = solid.normal(face, at(t)).dot(direction);
                    assert!(if into { along < 0.0 } else { along > 0.0 }, "{solid:?}: {along}");
                    for off in [-1e-13, 0.0, 1e-13] {
                        let rest = cut(&solid, at(t + off), direction, Some(Start { face, inside: into }));
                        let ahead: Vec<_> = rest.iter().filter(|s| s.leave > 0.0).collect();
                        let expected = &chords[if into { n } else { n + 1 }..];
                        assert_eq!(ahead.len(), expected.len(), "{solid:?} {origin} {direction}");
                        for (a, b) in ahead.iter().zip(expected) {
                            assert!((a.leave - (b.leave - t)).abs() < 1e-11);
                        }
                    }
                }
            }
        }
        assert!(several > 50, "{several} lines enter twice");
    }
}

/// The part of a box that lines spend in a solid is its part of the volume: 3 x 96^2 lines through the middles of a lattice,
/// against pi (R^2 - r^2) L, and the block less its groove, whose
/// edges lie on the lattice. On the round outline the midpoint rule errs by less than a cell over the diameter: 1 %.
#[test]
fn chords_add_up_to_the_volume() {
    use std::f64::consts::PI;
    let n = 96;
    for (solid, volume) in hollows().iter().zip([PI * (4.0 - 1.44) * 3.0, f64::NAN, 64.0 - 12.0]) {
        for axis in 0..3 {
            let mut sum = 0.0;
            for i in 0..n * n {
                let at = |i: usize| 6.0 * (i as f64 + 0.5) / n as f64 - 3.0;
                let (mut origin, mut direction) = (DVec3::splat(-9.0), DVec3::ZERO);
                (origin[(axis + 1) % 3], origin[(axis + 2) % 3]) = (at(i % n), at(i / n));
                direction[axis] = 1.0;
                sum += cut(solid, origin, direction, None).iter().map(|s| s.leave - s.enter).sum::<f64>();
            }
            let found = sum * (6.0 / n as f64).powi(2);
            assert!(volume.is_nan() || (found / volume - 1.0).abs() < 0.01, "{solid:?}: {found}, {volume}");
        }
    }
}

/// From everywhere, the surface is nowhere nearer than the clearance, and from most places it is not much farther.
#[test]
fn clearance_of_hollow_solids_is_a_lower_bound() {
    for solid in hollows() {
        let (mut tight, n) = (0, 60);
        for i in 0..n {
            let p = 0.9 * spread(i);
            let mut nearest = f64::INFINITY;
            for k in 0..4000 {
                for s in cut(&solid, p, spread(k).normalize(), None) {
                    nearest = nearest.min(s.enter.abs()).min(s.leave.abs());
                }
            }
            let clearance = solid.clearance(p);
            assert!((0.0..=nearest * (1.0 + 1e-12)).contains(&clearance), "{solid:?} {p}: {clearance} > {nearest}");
            tight += usize::from(clearance > 0.9 * nearest - 0.02);
        }
        assert!(3 * tight > 2 * n, "{solid:?}: {tight} of {n}");
    }
}

/// The mean chord of a convex body is 4 V / S for lines of an isotropic, uniform field (Cauchy): 80,000 lines of a Halton
/// sequence, of which 0.5 % is what independent ones would leave (1.5 sigma; a sequence leaves less).
#[test]
fn the_mean_chord_of_a_cylinder_is_four_v_over_s() {
    use std::f64::consts::PI;
    let solid = Solid::Cylinder { axis: DVec2::ZERO, radius: 1.0, bottom: -1.5, top: 1.5 };
    let (mut sum, mut hits) = (0.0, 0);
    for i in 0..80_000 {
        let (cos, phi) = (2.0 * halton(i, 2) - 1.0, 2.0 * PI * halton(i, 3));
        let sin = (1.0 - cos * cos).sqrt();
        let w = DVec3::new(sin * phi.cos(), sin * phi.sin(), cos);
        // A point in the square of 4 mm across it.
        let (u, v) = w.any_orthonormal_pair();
        let origin = (4.0 * halton(i, 5) - 2.0) * u + (4.0 * halton(i, 7) - 2.0) * v;
        if let Some((enter, leave)) = solid.interval(origin, w) {
            sum += leave - enter;
            hits += 1;
        }
    }
    let (volume, area) = (PI * 3.0, 2.0 * PI * 3.0 + 2.0 * PI);
    let mean = sum / f64::from(hits);
    assert!((mean / (4.0 * volume / area) - 1.0).abs() < 0.01, "{mean}, {}", 4.0 * volume / area);
}

#[test]
fn touching_and_parallel_lines_are_outside() {
    let slab = Solid::Slab { bottom: -1.0, top: 0.0 };
    assert_eq!(slab.interval(DVec3::ZERO, DVec3::X), None);
    assert_eq!(slab.interval(DVec3::new(0.0, 0.0, -0.5), DVec3::X), Some((f64::NEG_INFINITY, f64::INFINITY)));
    let sphere = Solid::Ellipsoid { center: DVec3::ZERO, radii: DVec3::ONE };
    assert_eq!(sphere.interval(DVec3::new(-5.0, 1.0, 0.0), DVec3::X), None);
}

/// From points inside, in any direction, the way out ends on the surface, everything before it is inside, and the normal there points along it; from points
/// outside there is none.
#[test]
fn the_way_out_ends_where_the_solid_does() {
    let (mut chords, mut ways) = (Vec::new(), 0);
    for (solid, i) in solids().iter().chain(&hollows()).flat_map(|solid| (0..400).map(move |i| (solid, i))) {
        let (p, w) = (spread(i), spread(i + 7).normalize());
        // On the surface a point is on either side.
        if solid.clearance(p) < 1e-9 {
            continue;
        }
        let found = solid.way_out((p, p), w, &mut chords);
        assert_eq!(found.is_some(), solid.contains(p), "{solid:?} {p}");
        let Some((distance, normal)) = found.filter(|(distance, _)| distance.is_finite()) else { continue };
        ways += 1;
        assert!(solid.contains(p + (distance * (1.0 - 1e-9)) * w), "{solid:?} {p} {w}");
        assert!(!solid.contains(p + (distance * (1.0 + 1e-9) + 1e-9) * w), "{solid:?} {p} {w}");
        assert!(normal.dot(w) > 0.0 && (normal.length() - 1.0).abs() < 1e-12, "{solid:?} {p} {w}: {normal}");
    }
    assert!(ways > 300, "{ways}");
}
