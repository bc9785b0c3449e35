//! Meshes as solids: watertight, the same as the shapes that they stand for, and safe steps in them.

use std::sync::Arc;

use glam::{DVec2, DVec3};
use turbid_optics::philox::{philox4x32, unit};
use turbid_optics::solid::{Chord, Mesh, Solid, Start};

mod shapes;
use shapes::{Triangles, block, icosphere, ring};

fn solid((vertices, triangles): &Triangles) -> Solid {
    Solid::Mesh(Arc::new(Mesh::new(vertices, triangles)))
}

/// Four numbers in (0, 1).
fn draw(i: u32) -> [f64; 4] {
    philox4x32([i, 0, 0, 0], [42, 0]).map(unit)
}

fn direction(i: u32) -> DVec3 {
    let [u, v, ..] = draw(i);
    let (cos, phi) = (2.0 * u - 1.0, 2.0 * std::f64::consts::PI * v);
    let sin = (1.0 - cos * cos).sqrt();
    DVec3::new(sin * phi.cos(), sin * phi.sin(), cos)
}

fn cut(solid: &Solid, origin: DVec3, w: DVec3, start: Option<Start>) -> Vec<Chord> {
    let mut chords = Vec::new();
    solid.cut(origin, w, start, &mut chords);
    chords
}

/// Rays from outside through vertices, edges and along faces, 1e5 of them, from places and along directions of few digits, where
/// ties happen, and of many: none stays inside for ever, none sees a hole. A line through the middle of a sphere is inside of it on
/// its way from entry to exit, once.
#[test]
fn no_ray_slips_through_an_edge() {
    let shapes: [(&str, Triangles); 4] = [
        ("sphere", icosphere(3.0, DVec3::ZERO, 3)),
        ("sphere 1 m away", icosphere(3.0, DVec3::new(1000.0, -700.0, 3.0), 3)),
        ("block", block(DVec3::new(-1.0, -2.0, -3.0), DVec3::new(1.0, 2.0, 3.0))),
        ("ring", ring(1.0, 2.0, 0.5, 16)),
    ];
    for (name, mesh) in shapes {
        let solid = solid(&mesh);
        let (low, high) = solid.bounds();
        let center = 0.5 * (low + high);
        let mut met = 0;
        for i in 0..25_000_u32 {
            let [u, v, w, _] = draw(i);
            let triangle = mesh.1[(u * mesh.1.len() as f64) as usize].map(|k| DVec3::from(mesh.0[k as usize]));
            // A vertex, a point of an edge, its middle.
            let along = [0.0, v, 0.5][i as usize % 3];
            let target = triangle[0] + along * (triangle[1] - triangle[0]);
            let from = match i % 4 {
                0 => center + 10.0 * direction(i),
                // In the plane of the triangle, and in planes of axes.
                1 => target + 10.0 * (triangle[2] - triangle[1]),
                2 => {
                    target
                        + 10.0
                            * (target - center).to_array().map(f64::signum)[i as usize % 3]
                            * DVec3::AXES[i as usize % 3]
                }
                _ => center + (20.0 * direction(i)).round() + DVec3::splat(40.0) * w.round(),
            };
            let Some(w) = (target - from).try_normalize() else { continue };
            if solid.contains(from) {
                continue;
            }
            let chords = cut(&solid, from, w, None);
            met += usize::from(!chords.is_empty());
            for chord in &chords {
                assert!(
                    chord.enter > f64::NEG_INFINITY && chord.leave < f64::INFINITY,
                    "{name}: {from} {w} {chords:?}"
                );
                assert!(chord.leave < 1000.0 + 3000.0, "{name}: {chord:?}");
            }
            if name.starts_with("sphere") && i % 4 == 0 {
                let through = cut(&solid, from, (center - from).normalize(), None);
                assert_eq!(through.len(), 1, "{name}: {from}");
                assert!((through[0].leave - through[0].enter - 6.0).abs() < 0.1, "{name}: {through:?}");
            }
        }
        assert!(met > 5000, "{name}: {met} rays meet it");
    }
}

/// A block and a cylinder of triangles against the solids themselves: the same chords but for rounding (block), and for the
/// sagitta r (1 - cos(pi / n)) = 2e-5 of the cylinder's 512 sides (lines that stay for less than 0.1 mm left out).
#[test]
fn meshes_are_cut_as_the_solids_they_stand_for() {
    let (low, high) = (DVec3::new(-1.0, -2.0, -3.0), DVec3::new(1.5, 2.0, 0.5));
    let tube = Solid::tube(2.0, 4.0, DVec2::ZERO, -0.5, 0.5);
    for (mesh, exact, tolerance) in
        [(block(low, high), Solid::Box { low, high }, 1e-12), (ring(1.0, 2.0, 0.5, 512), tube, 5e-3)]
    {
        let mesh = solid(&mesh);
        let mut several = 0;
        for i in 0..4000 {
            let [x, y, z, _] = draw(i).map(|u| 8.0 * u - 4.0);
            let (from, w) = (DVec3::new(x, y, z), direction(i + 100_000));
            let mut expected = cut(&exact, from, w, None);
            expected.retain(|s| s.leave > 0.0);
            if expected.iter().any(|s| s.leave - s.enter < 0.1 || s.enter.abs().min(s.leave) < 0.01) {
                continue;
            }
            let found = cut(&mesh, from, w, None);
            // A gap narrower than the tolerance is seen by one and not by the other.
            if tolerance > 1e-9 && expected.windows(2).any(|s| s[1].enter - s[0].leave < 0.2) {
                continue;
            }
            assert_eq!(found.len(), expected.len(), "{from} {w}: {found:?} {expected:?}");
            several += usize::from(found.len() > 1);
            for (a, b) in found.iter().zip(&expected) {
                let inside = b.enter < 0.0;
                assert!(inside || (a.enter - b.enter).abs() < tolerance, "{from} {w}: {a:?} {b:?}");
                assert!(a.enter.is_infinite() == inside && (a.leave - b.leave).abs() < tolerance, "{a:?} {b:?}");
            }
            assert_eq!(mesh.contains(from), exact.contains(from));
        }
        assert!(several > 10 || tolerance < 1e-9, "{several}");
    }
}

/// From every point where a line goes in or out, off by rounding either way, the rest of the line is seen, not the start.
#[test]
fn a_start_on_a_triangle_is_not_met_again() {
    for mesh in [ring(1.0, 2.0, 0.5, 24), icosphere(2.0, DVec3::new(500.0, 0.0, 0.0), 4)] {
        let solid = solid(&mesh);
        let (low, high) = solid.bounds();
        for i in 0..2000 {
            let w = direction(i);
            let [x, y, z, _] = draw(i + 50_000);
            let from = low + DVec3::new(x, y, z) * (high - low) - 10.0 * w;
            let chords = cut(&solid, from, w, None);
            for (n, chord) in chords.iter().enumerate() {
                for (t, face, into) in [(chord.enter, chord.into, true), (chord.leave, chord.out_of, false)] {
                    assert!(if into { -1.0 } else { 1.0 } * solid.normal(face, from).dot(w) > 0.0);
                    for off in [-2e-13, 0.0, 2e-13] {
                        let rest = cut(&solid, from + (t + off) * w, w, Some(Start { face, inside: into }));
                        let expected = &chords[if into { n } else { n + 1 }..];
                        assert_eq!(rest.len(), expected.len(), "{from} {w} {chords:?} {rest:?}");
                        let far = |s: &[Chord]| s.last().map_or(0.0, |s| s.leave);
                        assert!(expected.is_empty() || (far(&rest) + t - far(expected)).abs() < 1e-11);
                    }
                }
            }
        }
    }
}

/// The clearance is never more than the way to the surface, and mostly not much less.
#[test]
fn clearance_in_a_mesh_is_a_lower_bound() {
    let center = DVec3::new(300.0, -20.0, 1.0);
    let solid = solid(&icosphere(5.0, center, 5));
    let mut tight = 0;
    for i in 0..20_000 {
        let [x, y, z, u] = draw(i);
        let p = center + 14.0 * (DVec3::new(x, y, z) - 0.5) * if u < 0.2 { 10.0 } else { 1.0 };
        // The surface lies between the spheres through its vertices and through the middles of its triangles.
        let r = (p - center).length();
        let (least, most) = if r < 5.0 { (4.998 - r, 5.0 - r) } else { (r - 5.0, r - 4.998) };
        let clear = solid.clearance(p);
        assert!((0.0..=most).contains(&clear), "{p}: {clear} of {least}..{most}");
        tight += usize::from(clear > 0.3 * least - 1e-9);
    }
    assert!(tight > 18_000, "{tight} of 20000");
}

/// Crossing lengths of parallel lines add up to the volume of the mesh (divergence theorem), along each of 40 directions: one line anywhere in each cell of a
/// square across it. 4.5 standard errors of the mean over directions (Student's t of 39 degrees of freedom: one false alarm in 2 10^4), which are below
/// 0.15 % (0.12 % with 32 x 32 cells; it falls as their number to the power of 3/4).
#[test]
fn lines_measure_the_volume() {
    const DIRECTIONS: u32 = 40;
    const CELLS: u32 = 40;
    let mesh = ring(1.0, 2.0, 0.5, 40);
    let solid = solid(&mesh);
    let corner = |i: u32| DVec3::from(mesh.0[i as usize]);
    let volume: f64 = mesh.1.iter().map(|t| corner(t[0]).dot(corner(t[1]).cross(corner(t[2]))) / 6.0).sum();
    let (mut sum, mut squares) = (0.0, 0.0);
    for k in 0..DIRECTIONS {
        let w = direction(k);
        let (a, b) = w.any_orthonormal_pair();
        // Holds the ring.
        let (side, mut lengths) = (5.0, 0.0);
        for cell in 0..CELLS * CELLS {
            let [.., u, v] = draw(k * CELLS * CELLS + cell);
            let [x, y] =
                [(cell % CELLS, u), (cell / CELLS, v)].map(|(i, u)| (f64::from(i) + u) / f64::from(CELLS) - 0.5);
            let from = side * (x * a + y * b) - 10.0 * w;
            lengths += cut(&solid, from, w, None).iter().map(|s| s.leave - s.enter).sum::<f64>();
        }
        let found = lengths * side * side / f64::from(CELLS * CELLS);
        (sum, squares) = (sum + found, squares + found * found);
    }
    let n = f64::from(DIRECTIONS);
    let mean = sum / n;
    let sigma = ((squares / n - mean * mean) / (n - 1.0)).sqrt();
    println!("{mean} +- {sigma}, {volume}");
    assert!((mean - volume).abs() < 4.5 * sigma, "{mean} +- {sigma}, {volume}");
    assert!(sigma < 1.5e-3 * volume, "too noisy to tell: {sigma} of {volume}");
}
