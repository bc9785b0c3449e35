//! Worlds that try to mislead estimators and lanes: bodies that overlap, touch, nest, turn light, or hide each other.

use glam::{DVec2, DVec3};
use turbid_optics::PhaseFunction;
use turbid_optics::solid::{self, Mesh, Solid};
use turbid_render::bsdf::Bsdf;
use turbid_render::lamp::{Lamp, Steady};
use turbid_render::world::{Body, Material, World};

use crate::shapes;

const VOID: usize = 0;
pub const TISSUE: usize = 1;
pub const CORE: usize = 2;
const DYE: usize = 3;
const WHITE: usize = 4;
/// Absorbs so weakly that deep paths are roulettes.
pub const PALE: usize = 5;
/// With narrow peaks, so that paths have weight windows: into the lobe of the second copies are sent, the third is pale.
const SHARP: usize = 6;
const SHARPEST: usize = 7;
const PALE_SHARP: usize = 8;
const WET: usize = 9;
const WET_CORE: usize = 10;
const GLASS: usize = 11;
const DENSE: usize = 12;
const FROSTED: usize = 13;
const FROSTED_CORE: usize = 14;
/// Dark, so that paths are short: a connection through curved walls costs as much as a hundred flights.
const MURKY: usize = 15;
const MURKY_CORE: usize = 16;
const WET_SHARP: usize = 17;

pub fn world(bodies: Vec<(Solid, usize)>) -> World {
    let of_g = |mu_a, mu_s, g, n| Material::medium(mu_a, mu_s, PhaseFunction::henyey_greenstein(g), n);
    let medium = |mu_a, mu_s, g| of_g(mu_a, mu_s, g, 1.0);
    // As in a render: what no body is made of is not there.
    let used = bodies.iter().map(|&(_, material)| material).max().unwrap_or(VOID);
    let mut world = World {
        bodies: bodies.into_iter().map(|(solid, material)| Body { solid, material }).collect(),
        materials: vec![
            Material::VOID,
            medium(0.05, 2.0, 0.7),
            medium(0.4, 4.0, 0.5),
            medium(0.3, 0.0, 0.0),
            Material::lambertian(0.8),
            medium(0.002, 5.0, 0.5),
            medium(0.05, 15.0, 0.92),
            medium(0.1, 30.0, 0.97),
            medium(0.002, 15.0, 0.9),
            of_g(0.05, 2.0, 0.7, 1.4),
            of_g(0.4, 4.0, 0.5, 1.4),
            of_g(0.01, 0.0, 0.0, 1.5),
            of_g(0.05, 1.0, -0.3, 2.5),
            Material { bsdf: Bsdf::Rough(0.4), ..of_g(0.02, 2.0, 0.7, 1.4) },
            Material { bsdf: Bsdf::Rough(0.7), ..of_g(0.1, 3.0, 0.5, 1.5) },
            of_g(0.6, 2.0, 0.7, 1.4),
            of_g(1.2, 4.0, 0.5, 1.4),
            of_g(0.1, 15.0, 0.92, 1.4),
        ],
        textures: Vec::new(),
    };
    world.materials.truncate(used + 1);
    world
}

pub fn ball(center: [f64; 3], radius: f64) -> Solid {
    Solid::Ellipsoid { center: center.into(), radii: DVec3::splat(radius) }
}

/// Priority falls from the first body to the last.
pub fn scenes() -> Vec<(&'static str, World)> {
    let slab = |top: f64, bottom: f64| Solid::Slab { bottom, top };
    let cuboid = |low: [f64; 3], high: [f64; 3]| Solid::Box { low: low.into(), high: high.into() };
    let dome = Solid::Ellipsoid { center: DVec3::ZERO, radii: DVec3::new(2.0, 2.0, 3.0) };
    vec![
        ("half-space", world(vec![(slab(0.0, -500.0), TISSUE)])),
        ("thin slab", world(vec![(slab(0.0, -0.4), TISSUE)])),
        ("dome", world(vec![(dome, CORE), (slab(0.0, -500.0), TISSUE)])),
        (
            "buried ball under a dye",
            world(vec![(slab(1.0, 0.0), DYE), (ball([0.5, 0.0, -1.5], 1.0), CORE), (slab(0.0, -500.0), TISSUE)]),
        ),
        ("air gap", world(vec![(slab(0.0, -0.5), TISSUE), (slab(-1.5, -500.0), CORE)])),
        ("hole", world(vec![(ball([0.0, 0.5, -1.0], 0.9), VOID), (slab(0.0, -500.0), TISSUE)])),
        ("thin layer on a white floor", world(vec![(slab(0.0, -0.5), TISSUE), (slab(-0.5, -9.0), WHITE)])),
        (
            "one medium around a layer, in a ball and boxes that touch",
            world(vec![
                (ball([0.6, 0.0, -0.3], 0.8), TISSUE),
                (cuboid([-3.0, -3.0, -4.0], [0.2, 3.0, 0.0]), TISSUE),
                (slab(0.0, -0.6), CORE),
                (slab(-0.6, -500.0), TISSUE),
            ]),
        ),
        (
            "tissue with a row of balls, two of them hollowed by another",
            world(
                std::iter::once((ball([0.2, 0.1, -0.7], 0.6), VOID))
                    .chain((0..9_u8).map(|k| {
                        let [x, y] = [k % 3, k / 3].map(|i| 1.1 * f64::from(i) - 1.1);
                        (ball([x, y, -0.8], 0.6), if k % 2 == 0 { CORE } else { DYE })
                    }))
                    .chain([(slab(0.0, -500.0), TISSUE)])
                    .collect(),
            ),
        ),
        ("pale half-space with a core", world(vec![(ball([0.5, 0.0, -4.0], 3.0), CORE), (slab(0.0, -500.0), PALE)])),
        ("pale half-space", world(vec![(slab(0.0, -500.0), PALE)])),
        (
            "white block and box corner",
            world(vec![
                (cuboid([-1.0, 0.5, 0.0], [1.0, 1.5, 2.0]), WHITE),
                (cuboid([-3.0, -3.0, -4.0], [0.3, 3.0, 0.0]), TISSUE),
            ]),
        ),
        ("wet half-space with a core", world(vec![(ball([0.5, 0.0, -1.5], 1.0), WET_CORE), (slab(0.0, -500.0), WET)])),
        (
            "wet core level with wet tissue",
            world(vec![
                (cuboid([-9.0, -9.0, 0.0], [9.0, 9.0, 3.0]), VOID),
                (ball([0.5, 0.0, -0.3], 1.0), WET_CORE),
                (slab(0.0, -500.0), WET),
            ]),
        ),
        (
            "thin dense slab between glass plates over a white floor",
            world(vec![
                (slab(0.5, 0.0), GLASS),
                (slab(0.0, -0.4), DENSE),
                (slab(-0.4, -0.8), GLASS),
                (slab(-2.0, -3.0), WHITE),
            ]),
        ),
        (
            "frosted ball half in a frosted slab",
            world(vec![(ball([0.5, 0.0, -0.2], 1.2), FROSTED_CORE), (slab(0.0, -3.0), FROSTED)]),
        ),
        (
            "white block beside glass over an air gap over wet tissue",
            world(vec![
                (cuboid([-1.0, 0.5, 0.3], [1.0, 1.5, 2.0]), WHITE),
                (slab(0.3, 0.0), GLASS),
                (slab(-0.5, -500.0), WET),
            ]),
        ),
    ]
}

/// Bodies of other shapes, most of them left by lanes to the scalar walker, or to be met twice.
pub fn shaped_scenes() -> Vec<(&'static str, World)> {
    let slab = |top: f64, bottom: f64| Solid::Slab { bottom, top };
    let cuboid = |low: [f64; 3], high: [f64; 3]| Solid::Box { low: low.into(), high: high.into() };
    let upright = |radius: f64, bottom: f64, top: f64| Solid::Cylinder { axis: DVec2::ZERO, radius, bottom, top };
    let tilt = solid::Frame::turned(DVec3::new(0.3, 0.0, -1.5), [20.0, -35.0, 10.0]);
    let port = |w: DVec3| Solid::round_port(2.4, DVec3::ZERO, w.normalize());
    let shell = Solid::sphere_shell(
        4.0,
        5.0,
        DVec3::ZERO,
        vec![port(DVec3::new(4.0, -3.0, 25.0)), port(DVec3::new(-9.0, 8.0, 20.0))],
    );
    vec![
        ("cylinder in a slab", world(vec![(upright(1.2, -2.0, 0.5), CORE), (slab(0.0, -500.0), TISSUE)])),
        (
            "tube on a floor, a ball in its bore",
            world(vec![
                (Solid::tube(4.0, 6.0, DVec2::ZERO, -1.5, 0.0), TISSUE),
                (ball([0.4, 0.0, -0.7], 0.8), CORE),
                (slab(-1.5, -20.0), TISSUE),
            ]),
        ),
        ("hollow sphere with two ports", world(vec![(shell.clone(), TISSUE)])),
        ("white hollow sphere with two ports", world(vec![(ball([0.0, 0.0, -1.0], 0.9), CORE), (shell, WHITE)])),
        (
            "turned box in a slab",
            world(vec![(cuboid([-1.0, -1.5, -0.5], [1.0, 1.5, 1.5]).turned(tilt), CORE), (slab(0.0, -500.0), TISSUE)]),
        ),
    ]
}

/// Bodies askew: lying, leaning, flush with the surface, one of them below a wet surface.
pub fn turned_scenes() -> Vec<(&'static str, World)> {
    let slab = |top: f64, bottom: f64| Solid::Slab { bottom, top };
    let cuboid = |low: [f64; 3], high: [f64; 3]| Solid::Box { low: low.into(), high: high.into() };
    let turned =
        |solid: Solid, about: [f64; 3], deg: [f64; 3]| solid.turned(solid::Frame::turned_about(about.into(), deg));
    let egg = |top: f64| {
        let center = DVec3::new(0.2, -0.3, top);
        turned(Solid::Ellipsoid { center, radii: DVec3::new(0.8, 1.8, 1.2) }, center.into(), [0.0, 0.0, 35.0])
    };
    let vessel = |depth: f64| {
        Solid::Cylinder { axis: DVec2::ZERO, radius: 0.4, bottom: -30.0, top: 30.0 }
            .turned(solid::Frame::turned(DVec3::new(0.1, 0.0, depth), [90.0, 0.0, 20.0]))
    };
    let brick = turned(cuboid([-1.0, -1.5, -2.0], [1.0, 1.5, 0.0]), [0.3, 0.0, -1.5], [20.0, -35.0, 10.0]);
    let air = cuboid([-9.0, -9.0, 0.0], [9.0, 9.0, 3.0]);
    vec![
        ("vessel under the surface", world(vec![(vessel(-0.8), CORE), (slab(0.0, -500.0), TISSUE)])),
        ("leaning brick in a slab", world(vec![(brick, CORE), (slab(0.0, -500.0), TISSUE)])),
        (
            "egg askew, level with tissue",
            world(vec![(air.clone(), VOID), (egg(0.0), CORE), (slab(0.0, -500.0), TISSUE)]),
        ),
        ("groove", world(vec![(vessel(0.0), VOID), (slab(0.0, -500.0), TISSUE)])),
        ("slope", world(vec![(turned(slab(0.0, -500.0), [0.0; 3], [8.0, 5.0, 0.0]), TISSUE)])),
        (
            "wet egg askew, level with wet tissue",
            world(vec![(air, VOID), (egg(-0.2), WET_CORE), (slab(0.0, -500.0), WET)]),
        ),
        ("wet vessel in wet tissue", world(vec![(vessel(-0.8), WET_CORE), (slab(0.0, -500.0), WET)])),
    ]
}

/// Smooth walls of any shape that bend light.
pub fn curved_scenes() -> Vec<(&'static str, World)> {
    let slab = |top: f64, bottom: f64| Solid::Slab { bottom, top };
    let cuboid = |low: [f64; 3], high: [f64; 3]| Solid::Box { low: low.into(), high: high.into() };
    let tilt = solid::Frame::turned(DVec3::new(0.3, 0.0, -1.5), [20.0, -35.0, 10.0]);
    vec![
        (
            "wet dome on a wet slab, a wet ball in the air",
            world(vec![
                (ball([0.2, 0.0, 0.0], 1.0), MURKY_CORE),
                (ball([-1.3, -1.2, 1.2], 0.5), MURKY),
                (slab(0.0, -500.0), MURKY),
            ]),
        ),
        (
            "wet tube in a glass box, half over a white floor",
            world(vec![
                (Solid::tube(1.6, 3.0, DVec2::new(0.3, 0.0), -3.0, 0.6), MURKY),
                (cuboid([-2.0, -1.0, -2.0], [2.0, 2.0, 0.2]).turned(tilt), GLASS),
                (slab(-3.0, -9.0), WHITE),
            ]),
        ),
    ]
}

/// Convex bodies of one refractive index in the air, through whose walls lanes find the light.
pub fn bent_scenes() -> Vec<(&'static str, World)> {
    let slab = |top: f64, bottom: f64| Solid::Slab { bottom, top };
    let cuboid = |low: [f64; 3], high: [f64; 3]| Solid::Box { low: low.into(), high: high.into() };
    let egg = Solid::Ellipsoid { center: DVec3::new(0.2, -0.3, -0.5), radii: DVec3::new(1.6, 2.1, 1.2) };
    let post = Solid::Cylinder { axis: DVec2::new(-0.2, 0.3), radius: 1.2, bottom: -1.0, top: 0.8 };
    vec![
        curved_scenes().swap_remove(0),
        ("wet egg", world(vec![(egg.clone(), WET)])),
        ("wet egg on a white floor", world(vec![(egg, MURKY), (slab(-1.7, -9.0), WHITE)])),
        ("wet post in a wet slab", world(vec![(post, WET_CORE), (slab(0.0, -500.0), WET)])),
        (
            "wet block on a wet slab",
            world(vec![(cuboid([-1.2, -0.8, 0.0], [0.9, 1.1, 0.7]), WET_CORE), (slab(0.0, -500.0), WET)]),
        ),
    ]
}

/// Media with narrow peaks of scattering, also beside others.
pub fn peaked_scenes() -> Vec<(&'static str, World)> {
    let slab = |bottom: f64, top: f64| Solid::Slab { bottom, top };
    vec![
        ("sharp slab", world(vec![(slab(-50.0, 0.0), SHARP)])),
        ("wet sharp slab", world(vec![(slab(-50.0, 0.0), WET_SHARP)])),
        ("pale sharp slab", world(vec![(slab(-50.0, 0.0), PALE_SHARP)])),
        ("sharp slab under glass", world(vec![(slab(2.0, 3.0), GLASS), (slab(-50.0, 0.0), SHARP)])),
        ("sharpest slab", world(vec![(slab(-50.0, 0.0), SHARPEST)])),
        (
            "tissue with a sharpest ball on a sharp floor",
            world(vec![(ball([0.0, 0.0, -1.0], 1.0), SHARPEST), (slab(-2.0, 0.0), TISSUE), (slab(-20.0, -2.0), SHARP)]),
        ),
    ]
}

/// Media that scatter by two terms of Henyey and Greenstein: alone and beside one of one term, where light refracts, with peaks that ask for weight windows and
/// for copies towards the light, and in a tube whose walls send light-directed branches.
pub fn two_term_scenes() -> Vec<(&'static str, World)> {
    let slab = |bottom: f64, top: f64| Solid::Slab { bottom, top };
    let of = |mu_a, mu_s, (g_forward, g_backward, forward), n| {
        let phase = PhaseFunction::TwoTermHenyeyGreenstein { g_forward, g_backward, forward };
        Material::medium(mu_a, mu_s, phase, n)
    };
    let tissue = of(0.05, 4.0, (0.8, -0.4, 0.9), 1.0);
    let core = Material::medium(0.4, 4.0, PhaseFunction::henyey_greenstein(0.5), 1.0);
    let world = |bodies: Vec<(Solid, Material)>| {
        let materials = std::iter::once(Material::VOID).chain(bodies.iter().map(|(_, material)| *material)).collect();
        let bodies = bodies.into_iter().enumerate().map(|(i, (solid, _))| Body { solid, material: i + 1 }).collect();
        World { bodies, materials, textures: Vec::new() }
    };
    vec![
        ("two-term slab", world(vec![(slab(-50.0, 0.0), tissue)])),
        ("dome on a two-term slab", world(vec![(ball([0.0; 3], 1.5), core), (slab(-50.0, 0.0), tissue)])),
        ("wet two-term slab", world(vec![(slab(-50.0, 0.0), of(0.05, 4.0, (0.8, -0.4, 0.9), 1.4))])),
        ("two-term slab with windows", world(vec![(slab(-50.0, 0.0), of(0.05, 10.0, (0.92, -0.3, 0.9), 1.0))])),
        ("two-term slab with copies", world(vec![(slab(-50.0, 0.0), of(0.1, 20.0, (0.97, 0.2, 0.8), 1.0))])),
        (
            "two-term tube",
            world(vec![(Solid::tube(4.0, 6.0, DVec2::ZERO, -1.5, 0.0), of(0.05, 3.0, (0.7, -0.3, 0.9), 1.0))]),
        ),
    ]
}

/// Bodies of triangles: in a slab, with a bore and another body in it, and white.
pub fn mesh_scenes() -> Vec<(&'static str, World)> {
    let mesh = |(vertices, triangles): shapes::Triangles| Solid::Mesh(Mesh::new(&vertices, &triangles).into());
    let slab = |top: f64, bottom: f64| Solid::Slab { bottom, top };
    let sphere = mesh(shapes::icosphere(1.2, DVec3::new(0.2, 0.0, 0.1), 3));
    let ring = mesh(shapes::ring(0.8, 2.0, 0.7, 64));
    let block = mesh(shapes::block(DVec3::new(-1.0, -1.5, -0.5), DVec3::new(1.0, 1.5, 0.8)));
    vec![
        ("mesh in a slab", world(vec![(sphere.clone(), CORE), (slab(0.0, -500.0), TISSUE)])),
        ("ring on a floor, a ball in its bore", world(vec![(ball([0.3, 0.0, -0.2], 0.4), CORE), (ring, TISSUE)])),
        ("mesh alone", world(vec![(sphere, TISSUE)])),
        ("white mesh on a slab", world(vec![(block, WHITE), (slab(0.0, -500.0), TISSUE)])),
    ]
}

/// Meshes at whose facets light bends: in a slab of the same n, alone, and a lump with hollows, where several facets refract light to a point and some is lost.
pub fn bent_mesh_scenes() -> Vec<(&'static str, World)> {
    let mesh = |(vertices, triangles): shapes::Triangles| Solid::Mesh(Mesh::new(&vertices, &triangles).into());
    let center = DVec3::new(0.2, 0.0, 0.1);
    let lump = || {
        let (mut vertices, triangles) = shapes::icosphere(1.3, center, 3);
        for p in &mut vertices {
            let d = DVec3::from(*p) - center;
            let q = 5.0 * d;
            *p = (center + (1.0 + 0.1 * libm::sin(q.x + 0.3) * libm::sin(q.y) * libm::cos(q.z)) * d).into();
        }
        mesh((vertices, triangles))
    };
    let slab = Solid::Slab { bottom: -500.0, top: 0.0 };
    vec![
        (
            "wet facets in a wet slab",
            world(vec![(mesh(shapes::icosphere(1.2, center, 3)), WET_CORE), (slab.clone(), WET)]),
        ),
        ("wet lump", world(vec![(lump(), WET)])),
        (
            "wet lump in a wet slab beside a wet ball",
            world(vec![(lump(), WET_CORE), (ball([-1.9, 0.4, 0.2], 0.6), MURKY), (slab, WET)]),
        ),
    ]
}

/// Tubes whose walls send light-directed branches: with a ball in the bore, alone, and a longer one.
pub fn hollow_scenes() -> Vec<(&'static str, World)> {
    let tube = |length: f64| Solid::tube(4.0, 6.0, DVec2::ZERO, -length, 0.0);
    vec![
        ("tube with a ball in its bore", world(vec![(ball([0.4, 0.0, -0.7], 0.8), CORE), (tube(1.5), TISSUE)])),
        ("tube", world(vec![(tube(1.5), TISSUE)])),
        ("long tube", world(vec![(tube(8.0), TISSUE)])),
    ]
}

/// A point, a cone whose edge crosses the view, a slanted beam, and light from all sides.
pub fn lamps() -> Steady {
    let (from, to) = (DVec3::new(5.0, -6.0, 12.0), DVec3::new(0.5, -0.5, 0.0));
    let lamps = vec![
        Lamp::point(DVec3::new(-4.0, 1.0, 9.0), 2.0),
        Lamp::spot(from, (to - from).normalize(), 14.0, 0.5),
        Lamp::beam(DVec3::new(0.0, 9.0, 20.0), DVec3::new(0.0, -0.4, -0.916_515_138_991_168), 3.0, 0.05),
    ];
    Steady { lamps, ambient: 1e-4 }
}
