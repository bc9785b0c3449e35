//! Questions to a mesh per second of one core: by its tree in f64, and by its forms in single precision for lanes.
//!
//! `cargo bench -p turbid-optics --bench mesh [-- LEVELS]`: a sphere of 40 mm of 20 * 4^LEVELS triangles (6: 81,920). Points within 2 mm of its
//! surface and 2 mm of a pole, as the paths of a pixel are; CPU time.

use std::hint::black_box;

use fearless_simd::prelude::*;
use fearless_simd::{Level, Simd, dispatch, f32x16};
use glam::DVec3;
use turbid_optics::philox::{philox4x32, unit};
use turbid_optics::solid::facets::{Cells, Crossings, ItemBuffer, LANES, Rays, V};
use turbid_optics::solid::{Ends, Far, Mesh, Solid};

#[allow(dead_code, reason = "not all of them are needed here")]
#[path = "../tests/shapes/mod.rs"]
mod shapes;

const RADIUS: f64 = 20.0;
const POINTS: u32 = 5000;
const ROUNDS: u32 = 40;

fn main() {
    let levels = std::env::args().filter_map(|a| a.parse().ok()).next().unwrap_or(6);
    let (vertices, triangles) = shapes::icosphere(RADIUS, DVec3::ZERO, levels);
    let began = cpu_seconds();
    let mesh = Mesh::new(&vertices, &triangles);
    println!("{} triangles: trees: {:.3} s to make", mesh.triangles(), cpu_seconds() - began);
    let solid = Solid::Mesh(mesh.clone().into());
    let began = cpu_seconds();
    let cells = mesh.cells().expect("there is room");
    println!("cells: {:.2} s to make, {:.1} MB", cpu_seconds() - began, 1e-6 * cells.bytes() as f64);
    let eye = DVec3::new(35.0, 0.0, 500.0);
    let began = cpu_seconds();
    let seen = mesh.item_buffer(eye).expect("there is room");
    println!("seen from 500 mm: {:.2} s to make, {:.1} MB", cpu_seconds() - began, 1e-6 * seen.bytes() as f64);
    let rays: Vec<(DVec3, DVec3)> = (0..POINTS)
        .map(|i| {
            let [a, b, c, d] = philox4x32([i, 0, 0, 0], [7, 0]).map(unit);
            let e = philox4x32([i, 1, 0, 0], [7, 0]).map(unit);
            let up = direction(0.003 * a, b);
            ((RADIUS * (1.0 - 1e-3) - 2.0 * c * c) * up, direction(d, e[0]))
        })
        .collect();
    let mut chords = Vec::new();
    rate("f64: clearance", &rays, |p, _| solid.clearance(p));
    rate("f64: whole line", &rays, |p, w| {
        chords.clear();
        solid.cut(p, w, None, &mut chords);
        chords.len() as f64
    });
    let outside: Vec<(DVec3, DVec3)> = (0..POINTS)
        .map(|i| {
            let [a, b, c, d] = philox4x32([i, 2, 0, 0], [7, 0]).map(unit);
            let from = 3.0 * RADIUS * direction(a, b);
            (from, (1.1 * RADIUS * direction(c, d) - from).normalize())
        })
        .collect();
    rate("f64: whole line from outside", &outside, |p, w| {
        chords.clear();
        solid.cut(p, w, None, &mut chords);
        chords.len() as f64
    });
    let refractions = |p: DVec3, _| {
        let mut count = 0.0;
        mesh.refractions(&Ends { far: Far::Point(eye), n_far: 1.0, near: p, n_near: 1.4 }, &mut |_| count += 1.0);
        count
    };
    let began = cpu_seconds();
    refractions(rays[0].0, DVec3::Z);
    println!("specular tree: {:.3} s to make", cpu_seconds() - began);
    rate("refractions to the eye", &rays, refractions);
    // Within 2 mm of the rim, as the eye sees it: where light is found last.
    let at_rim = |&(p, w): &(DVec3, DVec3)| (DVec3::new(p.y, p.z, p.x), w);
    let rim: Vec<(DVec3, DVec3)> = rays.iter().map(at_rim).collect();
    rate("refractions to the eye, rim", &rim, refractions);
    let anywhere = |i: u32| {
        let [x, y, z, _] = philox4x32([i, 3, 0, 0], [7, 0]).map(|u| RADIUS * (2.0 * unit(u) - 1.0));
        DVec3::new(x, y, z)
    };
    let all: Vec<(DVec3, DVec3)> = (0..POINTS).map(|i| (anywhere(i), DVec3::Z)).collect();
    rate("refractions to the eye, cube", &all, refractions);
    for (name, level) in [("baseline", Level::baseline()), ("best", Level::new())] {
        println!("{name}:");
        dispatch!(level, simd => single(simd, cells, &seen, &rays));
    }
}

#[inline(always)]
fn single<S: Simd>(simd: S, cells: &Cells, seen: &ItemBuffer, rays: &[(DVec3, DVec3)]) {
    let flat = |v: DVec3| v.as_vec3().to_array();
    rate("f32: clearance", rays, |p, _| f64::from(cells.clearance(flat(p))));
    for (name, until) in [("flight of 0.24 mm", 0.24), ("way out up to 4 mm", 4.0), ("way out", f32::INFINITY)] {
        rate_of(&format!("f32: {name}"), &packs(rays), LANES, |&(p, w)| {
            simd.vectorize(
                #[inline(always)]
                || {
                    let rays = Rays { p: load(simd, p), w: load(simd, w) };
                    let ends = cells.first(simd, 0xFFFF, &rays, 0xFFFF, &f32x16::splat(simd, until));
                    ends.iter().flatten().map(|c| f64::from(c.t)).sum()
                },
            )
        });
    }
    let mut found = Crossings::default();
    rate_of("f32: one flight of 0.24 mm", &packs(rays), 1, |&(p, w)| {
        simd.vectorize(
            #[inline(always)]
            || {
                let rays = Rays { p: load(simd, p), w: load(simd, w) };
                let ends = cells.first(simd, 1, &rays, 1, &f32x16::splat(simd, 0.24));
                ends[0].map_or(0.0, |c| f64::from(c.t))
            },
        )
    });
    rate_of("f32: one whole line", &packs(rays), 1, |&(p, w)| {
        simd.vectorize(
            #[inline(always)]
            || {
                let rays = Rays { p: load(simd, p), w: load(simd, w) };
                cells.crossings(simd, 1, &rays, &f32x16::splat(simd, f32::INFINITY), &mut found);
                found.of(0).len() as f64
            },
        )
    });
    rate_of("f32: to the eye, as seen", &packs(rays), LANES, |&(p, _)| {
        simd.vectorize(
            #[inline(always)]
            || {
                seen.all_towards(simd, 0xFFFF, &load(simd, p), &mut found);
                (0..LANES).map(|lane| found.of(lane).len() as f64).sum()
            },
        )
    });
    let mut found = Vec::new();
    rate("f32: one to the eye, as seen", rays, |p, _| {
        simd.vectorize(
            #[inline(always)]
            || seen.towards(simd, flat(p), &mut found),
        );
        found.len() as f64
    });
}

type Columns = [[f32; LANES]; 3];

/// Origins and directions by sixteen.
fn packs(rays: &[(DVec3, DVec3)]) -> Vec<(Columns, Columns)> {
    let columns = |some: [DVec3; LANES]| [0, 1, 2].map(|axis| some.map(|v| v[axis] as f32));
    let whole = rays.as_chunks::<LANES>().0.iter();
    whole.map(|some| (columns(some.map(|ray| ray.0)), columns(some.map(|ray| ray.1)))).collect()
}

#[inline(always)]
fn load<S: Simd>(simd: S, [x, y, z]: Columns) -> V<S> {
    [f32x16::load_array(simd, x), f32x16::load_array(simd, y), f32x16::load_array(simd, z)]
}

fn direction(u: f64, v: f64) -> DVec3 {
    let (cos, phi) = (1.0 - 2.0 * u, 2.0 * std::f64::consts::PI * v);
    let sin = (1.0 - cos * cos).sqrt();
    DVec3::new(sin * phi.cos(), sin * phi.sin(), cos)
}

fn rate(name: &str, rays: &[(DVec3, DVec3)], mut ask: impl FnMut(DVec3, DVec3) -> f64) {
    rate_of(name, rays, 1, |&(p, w)| ask(p, w));
}

/// Of things that are `many` questions each.
fn rate_of<T>(name: &str, things: &[T], many: usize, mut ask: impl FnMut(&T) -> f64) {
    let (mut best, mut sum) = (f64::INFINITY, 0.0);
    let questions = things.len() * many;
    // Long enough for clocks that tick every few milliseconds.
    let rounds = ROUNDS * POINTS / questions as u32;
    for _ in 0..5 {
        let began = cpu_seconds();
        sum = (0..rounds).flat_map(|_| things).map(&mut ask).sum::<f64>() / f64::from(rounds);
        best = best.min((cpu_seconds() - began) / f64::from(rounds));
    }
    black_box(sum);
    println!("  {name:28} {:8.0} ns   (mean answer {:.4})", 1e9 * best / questions as f64, sum / questions as f64);
}

/// Seconds that this thread has had a core (Linux; 0 elsewhere).
fn cpu_seconds() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    text.split(' ').next().and_then(|ns| ns.parse::<f64>().ok()).unwrap_or(0.0) * 1e-9
}
