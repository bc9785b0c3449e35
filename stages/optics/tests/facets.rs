//! The forms of a mesh in single precision say what the mesh itself says, to rounding.

use fearless_simd::prelude::*;
use fearless_simd::{Level, Simd, dispatch, f32x16};
use glam::DVec3;
use turbid_optics::philox::{philox4x32, unit};
use turbid_optics::solid::facets::{Cells, Crossing, Crossings, LANES, Rays, V};
use turbid_optics::solid::{Chord, Mesh, Solid};

mod shapes;
use shapes::{Triangles, block, icosphere, ring};

/// Size, f32 and all that is added: some ten roundings of 6e-8.
const ROUNDING: f64 = 1e-6;

fn draw(i: u32) -> [f64; 4] {
    philox4x32([i, 0, 0, 0], [43, 0]).map(unit)
}

fn direction(i: u32) -> DVec3 {
    let [u, v, ..] = draw(i);
    let (cos, phi) = (2.0 * u - 1.0, 2.0 * std::f64::consts::PI * v);
    let sin = (1.0 - cos * cos).sqrt();
    DVec3::new(sin * phi.cos(), sin * phi.sin(), cos)
}

/// Coarse and fine, convex and not, thin, and with triangles much longer than wide.
fn meshes() -> Vec<(&'static str, Triangles)> {
    let center = DVec3::new(30.0, -7.0, 3.0);
    vec![
        ("icosahedron", icosphere(3.0, center, 0)),
        ("sphere", icosphere(3.0, center, 5)),
        ("block", block(DVec3::new(-1.0, -2.0, -3.0), DVec3::new(1.0, 2.0, 3.0))),
        ("leaf", block(DVec3::new(-5.0, -5.0, -0.01), DVec3::new(5.0, 5.0, 0.01))),
        ("ring", ring(1.0, 2.0, 0.5, 500)),
    ]
}

fn cut(solid: &Solid, p: DVec3, w: DVec3) -> Vec<Chord> {
    let mut chords = Vec::new();
    solid.cut(p, w, None, &mut chords);
    chords
}

struct Case {
    name: &'static str,
    mesh: Mesh,
    solid: Solid,
    center: DVec3,
    size: f64,
}

fn cases() -> impl Iterator<Item = Case> {
    meshes().into_iter().map(|(name, (vertices, triangles))| {
        let mesh = Mesh::new(&vertices, &triangles);
        let solid = Solid::Mesh(std::sync::Arc::new(mesh.clone()));
        let (low, high) = solid.bounds();
        Case { name, center: mesh.center(), mesh, solid, size: (high - low).max_element() }
    })
}

impl Case {
    /// A point in a cube twice as large.
    fn point(&self, i: u32) -> DVec3 {
        let [x, y, z, _] = draw(i);
        self.center + (2.0 * DVec3::new(x, y, z) - 1.0) * self.size
    }

    fn local(&self, p: DVec3) -> [f32; 3] {
        (p - self.center).as_vec3().to_array()
    }

    /// t > 0 of all crossings, and whether they lead out.
    fn crossings(&self, p: DVec3, w: DVec3) -> Vec<(f64, bool)> {
        let chords = cut(&self.solid, p, w);
        chords.iter().flat_map(|s| [(s.enter, false), (s.leave, true)]).filter(|c| c.0 > 0.0).collect()
    }

    /// Whether two lists of crossings are the same but for what rounding may move: beside edges a line may touch or miss.
    fn same(&self, found: &[Crossing], expected: &[(f64, bool)]) -> bool {
        found.len() == expected.len()
            && found.iter().zip(expected).all(|(f, e)| {
                // Aslant, rounding across the line moves the crossing along it by more.
                f.leaves == e.1 && (f64::from(f.t) - e.0).abs() < 100.0 * ROUNDING * self.size
            })
    }
}

fn lanes<S: Simd>(simd: S, points: &[[f32; 3]; LANES]) -> V<S> {
    [0, 1, 2].map(|axis| f32x16::load_array(simd, points.map(|p| p[axis])))
}

/// All crossings of rays side by side, and the first out of the solid in odd lanes and into it in even ones, up to `until`.
type Answers = ([Vec<Crossing>; LANES], [Option<Crossing>; LANES]);

fn answers(
    level: Level,
    cells: &Cells,
    asked: u64,
    p: &[[f32; 3]; LANES],
    w: &[[f32; 3]; LANES],
    until: f32,
) -> Answers {
    let mut found = Crossings::default();
    let first = dispatch!(level, simd => {
        let rays = Rays { p: lanes(simd, p), w: lanes(simd, w) };
        cells.crossings(simd, asked, &rays, &f32x16::splat(simd, f32::INFINITY), &mut found);
        cells.first(simd, asked, &rays, 0xAAAA, &f32x16::splat(simd, until))
    });
    (std::array::from_fn(|lane| found.of(lane).to_vec()), first)
}

/// Crossings of 4000 rays of each, all and the first of either kind, at every vector width; also of those along axes.
#[test]
fn rays_cross_cells_as_they_cross_the_mesh() {
    for case in cases() {
        let cells = case.mesh.cells().expect("they are small");
        assert!(cells.bytes() <= 40 << 20, "{}: {} bytes", case.name, cells.bytes());
        let (mut met, mut others) = (0, 0);
        for start in (0..4000).step_by(LANES) {
            let rays: [(DVec3, DVec3); LANES] = std::array::from_fn(|lane| {
                let i = start + lane as u32;
                let along = if i % 100 < 16 { DVec3::AXES[i as usize % 3] } else { direction(i) };
                (case.point(i), if i.is_multiple_of(7) { -along } else { along })
            });
            let (p, w) = (rays.map(|ray| case.local(ray.0)), rays.map(|ray| ray.1.as_vec3().to_array()));
            let until = if start % 64 == 0 { f32::INFINITY } else { (0.5 * case.size) as f32 };
            let (all, first) = answers(Level::new(), cells, 0xFFFF, &p, &w, until);
            for level in [Level::baseline(), Level::new()] {
                // What is not asked, and what else is, does not show.
                let (some, its_first) = answers(level, cells, 0x5F0A, &p, &w, until);
                for lane in 0..LANES {
                    let asked = 0x5F0A >> lane & 1 == 1;
                    assert_eq!(some[lane], if asked { all[lane].clone() } else { Vec::new() }, "{} {start}", case.name);
                    assert_eq!(its_first[lane], first[lane].filter(|_| asked), "{} {start}", case.name);
                }
            }
            for (lane, (&(p, w), all)) in rays.iter().zip(&all).enumerate() {
                met += usize::from(!all.is_empty());
                others += usize::from(!case.same(all, &case.crossings(p, w)));
                let nearest = all.iter().copied().find(|c| c.leaves == (lane % 2 == 1));
                assert_eq!(first[lane], nearest.filter(|c| c.t <= until), "{} {start} {lane}", case.name);
            }
        }
        assert!(met > 100, "{}: {met} rays meet it", case.name);
        // Of 1e6 roundings of the size, those that pass an edge: some 1e-6 of the size times its length over the area.
        assert!(others <= 2, "{}: {others} rays differ", case.name);
    }
}

/// What lies between 4000 points, within the mesh and around it, and an eye near it and far away; an eye inside has no such view.
#[test]
fn looks_towards_a_point_meet_what_rays_meet() {
    for case in cases() {
        for (k, far) in [2.0, 30.0].into_iter().enumerate() {
            let eye = case.center + far * case.size * DVec3::new(0.3, -0.2, 0.9).normalize();
            let seen = case.mesh.item_buffer(eye).expect("from outside");
            assert!(seen.bytes() <= 12 << 20, "{}: {} bytes", case.name, seen.bytes());
            let (mut met, mut others, mut found) = (0, 0, Vec::new());
            for start in (0..4000).step_by(LANES) {
                let points: [DVec3; LANES] = std::array::from_fn(|lane| case.point(start + (4000 * k + lane) as u32));
                let locals = points.map(|p| case.local(p));
                let [mut best, mut baseline, mut some] = std::array::from_fn(|_| Crossings::default());
                dispatch!(Level::new(), simd => seen.all_towards(simd, 0xFFFF, &lanes(simd, &locals), &mut best));
                dispatch!(Level::baseline(), simd => seen.all_towards(simd, 0xFFFF, &lanes(simd, &locals), &mut baseline));
                dispatch!(Level::new(), simd => seen.all_towards(simd, 0x5F0A, &lanes(simd, &locals), &mut some));
                for (lane, p) in points.into_iter().enumerate() {
                    let distance = eye.distance(p);
                    let mut expected = case.crossings(p, (eye - p) / distance);
                    expected.retain(|c| c.0 < distance);
                    dispatch!(Level::new(), simd => seen.towards(simd, locals[lane], &mut found));
                    met += usize::from(!found.is_empty());
                    others += usize::from(!case.same(&found, &expected));
                    assert_eq!(best.of(lane), found, "{} {start} {lane}", case.name);
                    assert_eq!(baseline.of(lane), found, "{} {start} {lane}", case.name);
                    let asked = if 0x5F0A >> lane & 1 == 1 { &found[..] } else { &[] };
                    assert_eq!(some.of(lane), asked, "{} {start} {lane}", case.name);
                }
            }
            assert!(met > 100, "{}: {met} looks meet it", case.name);
            assert!(others <= 2, "{}, from {far}: {others} looks differ", case.name);
        }
        assert!(case.mesh.item_buffer(case.center).is_none(), "{}", case.name);
    }
}

/// Rays from an eye cross what the mesh says they cross, to f64.
#[test]
fn rays_from_a_point_are_cut_by_its_item_buffer() {
    for case in cases() {
        let eye = case.center + 20.0 * case.size * DVec3::new(-0.3, 0.4, 0.8).normalize();
        let seen = case.mesh.item_buffer(eye).expect("from outside");
        let (mut met, mut others, mut chords) = (0, 0, Vec::new());
        for i in 0..4000 {
            let w = (case.center + 0.5 * (case.point(i) - case.center) - eye).normalize();
            let expected = cut(&case.solid, eye, w);
            chords.clear();
            dispatch!(Level::new(), simd => case.mesh.cut_by_item_buffer(simd, (eye, &seen), w, &mut chords));
            met += usize::from(!chords.is_empty());
            // The plane of a triangle is met to some roundings of the distance over the cosine.
            let near = |a: f64, b: f64| (a - b).abs() < 1e-9 * case.size;
            let same = |(a, b): (&Chord, &Chord)| near(a.enter, b.enter) && near(a.leave, b.leave);
            others += usize::from(chords.len() != expected.len() || !chords.iter().zip(&expected).all(same));
        }
        assert!(met > 100, "{}: {met} rays meet it", case.name);
        // Those that pass an edge within the rounding of single precision.
        assert!(others <= 2, "{}: {others} rays differ", case.name);
    }
}

/// Where a line grazes the mesh or hits vertices and edges, crossings still come in pairs.
#[test]
fn crossings_alternate_wherever_a_ray_is_aimed() {
    for case in cases() {
        let (vertices, _) = meshes().into_iter().find(|m| m.0 == case.name).unwrap().1;
        let cells = case.mesh.cells().unwrap();
        for i in 0..4000 {
            let [u, v, ..] = draw(i);
            let pick = |u: f64| DVec3::from(vertices[(u * vertices.len() as f64) as usize]);
            // Through one vertex, or along the chord of two.
            let target = pick(u);
            let from =
                if i % 2 == 0 { case.center + 3.0 * case.size * direction(i) } else { 3.0 * pick(v) - 2.0 * target };
            let Some(w) = (target - from).try_normalize() else { continue };
            if case.solid.contains(from) || case.solid.clearance(from) < 1e-3 * case.size {
                continue;
            }
            let (p, w) = ([case.local(from); LANES], [w.as_vec3().to_array(); LANES]);
            let ([found, ..], _) = answers(Level::new(), cells, 1, &p, &w, f32::INFINITY);
            let balance: i32 = found.iter().map(|c| if c.leaves { -1 } else { 1 }).sum();
            assert_eq!(balance, 0, "{} {i}: {found:?}", case.name);
        }
    }
}

/// Clearances are lower bounds; within a cell of a flat face, 3 cells from its edges, they are the distance. Between points that
/// are said to see each other nothing lies.
#[test]
fn clearances_are_below_the_distance_and_near_it() {
    for case in cases() {
        let cells = case.mesh.cells().unwrap();
        let (mut near, mut free) = (0, 0);
        // A 48th of its longest side.
        let cell = 0.125;
        for i in 0..20_000 {
            let p = if i % 2 == 0 { case.point(i) } else { case.center + 0.5 * (case.point(i) - case.center) };
            let exact = case.solid.clearance(p);
            let clear = f64::from(cells.clearance(case.local(p)));
            // The mesh's own is a lower bound too, exact near the surface.
            let distance = exact.max(0.0);
            let bound = if distance < case.size / 50.0 { distance } else { f64::INFINITY };
            assert!(clear >= 0.0 && clear <= bound + ROUNDING * case.size, "{} {i}: {clear}, {exact}", case.name);
            let inner = p.abs().cmplt(DVec3::new(1.0, 2.0, 3.0) - 3.0 * cell);
            if case.name == "block" && distance < cell && inner.bitmask().count_ones() == 2 {
                near += 1;
                // Less the slack that is left for rounding.
                assert!((clear - distance).abs() < 2.0 * ROUNDING * case.size, "{i}: {clear} of {distance}");
            }
            let q = p + 0.02 * case.size * direction(i);
            if cells.is_free(case.local(p), case.local(q)) {
                free += 1;
                let met = case.crossings(p, (q - p).normalize());
                assert!(met.iter().all(|c| c.0 > p.distance(q)), "{} {i}: {met:?}", case.name);
            }
        }
        assert!(free > 20, "{}: {free} pairs", case.name);
        assert!(case.name != "block" || near > 20, "{near} points near a face");
    }
}
