//! Parts of an image in which every pixel looks at one smooth, lit surface, away from its rims, seams and shadows.

use std::sync::Arc;

use glam::DVec3;
use turbid_contract::payload::Scene;
use turbid_optics::solid::Solid;

use crate::bsdf::Bsdf;
use crate::chart::{Chart, Place, Places};
use crate::fringes::Fringes;
use crate::guide::Guide;
use crate::light::{Emission, Light};
use crate::projected::Projected;
use crate::rig::Rig;
use crate::truth::first_hit_at;
use crate::world::{Chords, Interface, Material, World};

/// Fewer pixels than this are left to their own paths.
pub const LEAST_PIXELS: usize = 64;
/// Normals of a pixel's corners and its centre turn by less than this (cosine): elsewhere is an edge, or a rim.
const LEAST_TURN: f64 = 0.9;
/// The least cosine between normal and light: below, what falls on a pixel's centre says little of what falls on it.
const LEAST_COSINE: f64 = 5e-3;
/// How deep something else is looked for below a surface: in 1 / mu_eff, and in mean free paths of transport at most.
const DEEP: f64 = 3.0;
const MOST_DEEP: f64 = 10.0;
/// A shadow ray starts this far off the surface (of its length): rounding.
const OFF: f64 = 1e-7;

/// Pixels that look at one surface.
pub struct Region {
    /// Of the object.
    pub name: String,
    pub chart: Chart,
    /// Ascending.
    pub pixels: Vec<u32>,
    /// Where each looks at, by the chart.
    pub places: Vec<[f64; 2]>,
    /// Column and row of each.
    pub cells: Vec<[usize; 2]>,
    /// Distance of each from the nearest pixel outside, but for the edges of the image: in mean free paths of transport of what is seen, or pixels where those are
    /// larger; whole steps.
    pub rings: Vec<u32>,
    gains: Vec<f64>,
    /// `[pixel][fringe]`.
    phases: Vec<(f64, f64)>,
    pub fringes: Arc<Fringes>,
}

impl Region {
    pub fn len(&self) -> usize {
        self.pixels.len()
    }

    /// With pixels of even light at `cells`, an edge on their left; fringes of 7 pixels.
    #[cfg(test)]
    pub fn known(chart: Chart, cells: Vec<[usize; 2]>, places: Vec<[f64; 2]>, carriers: usize) -> Self {
        let n = cells.len();
        Self {
            name: "known".to_owned(),
            chart,
            pixels: (0..n as u32).collect(),
            places,
            rings: cells.iter().map(|c| c[0] as u32).collect(),
            gains: vec![1.0; n],
            phases: cells.iter().flat_map(|c| (0..carriers).map(|_| (0.9 * c[0] as f64).sin_cos())).collect(),
            cells,
            fringes: Arc::new(Fringes::carriers(carriers)),
        }
    }

    /// Where pixel i looks at, for fits of a fringe, or of what has none.
    pub fn place(&self, i: usize, fringe: Option<usize>) -> Place {
        let carrier = fringe.map_or((0.0, 0.0), |fringe| {
            let (sin, cos) = self.phases[i * self.fringes.phases() + fringe];
            let contrast = sin * sin + cos * cos;
            (sin / contrast, cos / contrast)
        });
        Place { at: self.places[i], carrier }
    }

    pub fn guide(&self, i: usize) -> Guide<'_> {
        let count = self.fringes.phases();
        Guide { gain: self.gains[i], phases: &self.phases[i * count..][..count], fringes: &self.fringes }
    }
}

/// What a ray meets.
#[derive(Clone, Copy, Debug)]
struct Seen {
    key: Key,
    r: DVec3,
    normal: DVec3,
    interface: Interface,
}

/// Rays with one of these look at one surface: what fills it, whose boundary it is, which of its faces, and the material behind what fills it, where light from
/// there still shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Key {
    body: usize,
    boundary: usize,
    face: u32,
    /// Of all channels, as one number.
    below: usize,
}

/// All regions of an image under fringes, by their first pixels.
pub fn regions(scene: &Scene, rig: &Rig, projected: &Projected, fringes: &Arc<Fringes>) -> Vec<Region> {
    let (columns, rows) = (rig.camera.columns, rig.camera.rows);
    let mut seen = smooth_pixels(rig);
    // Where a fringe has no contrast its phase is not known.
    let has_phases = |s: &Seen| fringes.at(projected, &rig.lights[0], rig.lights[0].arrives(s.r).0.on_plane).is_some();
    seen.iter_mut().for_each(|s| *s = s.filter(has_phases));
    let distances = distances(&seen, columns, rows);
    // Those that touch the edge are left out: the light there varies within a pixel.
    let inside = |pixel: usize| seen[pixel].filter(|_| distances[pixel] > 1).map(|s| s.key);
    let mut taken = vec![false; seen.len()];
    let mut regions = Vec::new();
    for first in 0..seen.len() {
        let Some(key) = inside(first).filter(|_| !taken[first]) else { continue };
        let mut found = vec![first];
        taken[first] = true;
        let mut next = 0;
        while let Some(&pixel) = found.get(next) {
            next += 1;
            for other in beside(pixel, columns, rows) {
                if !taken[other] && inside(other) == Some(key) {
                    taken[other] = true;
                    found.push(other);
                }
            }
        }
        if found.len() >= LEAST_PIXELS {
            found.sort_unstable();
            regions.push(region(scene, rig, (projected, fringes), &found, &seen, &distances));
        }
    }
    regions
}

/// What the centre of each pixel meets, where its corners meet the same and light falls on all of them.
fn smooth_pixels(rig: &Rig) -> Vec<Option<Seen>> {
    let (camera, mut chords) = (&rig.camera, Chords::default());
    let (columns, rows) = (camera.columns, camera.rows);
    let mut corner = |column: usize, row: usize| {
        // The last ones are the right and lower corners of the last pixels.
        let (c, r) = (column.min(columns - 1), row.min(rows - 1));
        seen_at(rig, (r * columns + c, (column - c) as f64, (row - r) as f64), &mut chords)
    };
    let mut above: Vec<Option<Seen>> = (0..=columns).map(|column| corner(column, 0)).collect();
    let mut corners = Vec::with_capacity(columns * rows);
    for row in 0..rows {
        let below: Vec<Option<Seen>> = (0..=columns).map(|column| corner(column, row + 1)).collect();
        corners.extend((0..columns).map(|c| [above[c], above[c + 1], below[c], below[c + 1]]));
        above = below;
    }
    let agree = |(pixel, corners): (usize, &[Option<Seen>; 4])| {
        let middle = seen_at(rig, (pixel, 0.5, 0.5), &mut chords)?;
        let same = |corner: &Option<Seen>| {
            corner.is_some_and(|c| c.key == middle.key && c.normal.dot(middle.normal) > LEAST_TURN)
        };
        corners.iter().all(same).then_some(middle)
    };
    corners.iter().enumerate().map(agree).collect()
}

/// What a ray meets first, if that is diffuse in all channels, and lit.
fn seen_at(rig: &Rig, place: (usize, f64, f64), chords: &mut Chords) -> Option<Seen> {
    let world = &rig.worlds[0];
    let hit = first_hit_at(world, &rig.camera, place, chords)?;
    let of = |world: &World| world.materials[world.bodies[hit.body].material];
    if !rig.worlds.iter().all(|world| is_diffuse(&of(world))) || !is_lit(rig, hit.r, hit.normal, chords) {
        return None;
    }
    let face = if is_mesh(&world.bodies[hit.interface.body].solid) { 0 } else { hit.interface.face };
    let below = rig.worlds.iter().fold(0_usize, |all, world| {
        let next = below(world, &of(world), hit.r, hit.normal, chords).map_or(0, |material| material + 1);
        all.wrapping_mul(world.materials.len() + 1).wrapping_add(next)
    });
    let key = Key { body: hit.body, boundary: hit.interface.body, face, below };
    Some(Seen { key, r: hit.r, normal: hit.normal, interface: hit.interface })
}

/// Whether its radiance varies slowly with the place and the angle.
fn is_diffuse(material: &Material) -> bool {
    match material.bsdf {
        Bsdf::Lambertian(_) => true,
        Bsdf::Smooth => material.mu_s > 0.0,
        Bsdf::Rough(_) => material.mu_s > 0.0 && material.n == 1.0,
        Bsdf::Textured(_) | Bsdf::Mirror => false,
    }
}

/// The material behind the one at a surface, down its normal, as deep as light comes back from.
fn below(world: &World, material: &Material, r: DVec3, normal: DVec3, chords: &mut Chords) -> Option<usize> {
    if material.is_opaque() {
        return None;
    }
    let reduced = material.mu_a + material.mu_s_prime();
    // Light from a depth d comes back like exp(-2 mu_eff d).
    let mu_eff = (3.0 * material.mu_a * reduced).sqrt();
    let deep = (DEEP / mu_eff).min(MOST_DEEP / reduced);
    let own = world.materials.iter().position(|m| m == material);
    let mut segments = world.trace(r - OFF * deep * normal, -normal, None, chords);
    segments.find(|segment| Some(segment.material) != own).filter(|s| s.start < deep).map(|s| s.material)
}

fn is_mesh(solid: &Solid) -> bool {
    match solid {
        Solid::Turned(turned) => is_mesh(&turned.solid),
        Solid::Mesh(_) => true,
        _ => false,
    }
}

/// Whether the projector's light falls on a point of a surface, with nothing in its way.
fn is_lit(rig: &Rig, r: DVec3, normal: DVec3, chords: &mut Chords) -> bool {
    let Some(arrival) = rig.lights[0].arrival(r) else { return false };
    if normal.dot(arrival.towards) < LEAST_COSINE {
        return false;
    }
    let start = r + OFF * arrival.distance * normal;
    let first = rig.worlds[0].trace(start, arrival.towards, None, chords).next();
    first.is_none_or(|segment| segment.material == 0 && segment.end >= arrival.distance)
}

/// How many steps each pixel is from the nearest one that has no smooth surface, or another; 0 for these, and the most there is where there is none.
fn distances(seen: &[Option<Seen>], columns: usize, rows: usize) -> Vec<u32> {
    let mut distances = vec![u32::MAX; seen.len()];
    let mut front: Vec<usize> = Vec::new();
    for pixel in 0..seen.len() {
        let own = seen[pixel].map(|s| s.key);
        let differs = || beside(pixel, columns, rows).any(|other| seen[other].is_some_and(|s| Some(s.key) != own));
        if own.is_none() {
            distances[pixel] = 0;
        } else if differs() {
            distances[pixel] = 1;
        } else {
            continue;
        }
        front.push(pixel);
    }
    // Those at 0 first: then each has its least.
    front.sort_by_key(|&pixel| (distances[pixel], pixel));
    let mut next = 0;
    while let Some(&pixel) = front.get(next) {
        next += 1;
        for other in beside(pixel, columns, rows) {
            if distances[other] == u32::MAX {
                distances[other] = distances[pixel] + 1;
                front.push(other);
            }
        }
    }
    distances
}

/// The up to eight pixels around.
fn beside(pixel: usize, columns: usize, rows: usize) -> impl Iterator<Item = usize> {
    crate::neighbours::within(1, pixel, columns, columns * rows).filter(move |&other| other != pixel)
}

fn region(
    scene: &Scene,
    rig: &Rig,
    (projected, fringes): (&Projected, &Arc<Fringes>),
    pixels: &[usize],
    seen: &[Option<Seen>],
    distances: &[u32],
) -> Region {
    let (world, camera) = (&rig.worlds[0], &rig.camera);
    let seen: Vec<Seen> = pixels.iter().map(|&p| seen[p].expect("pixels of a region look at something")).collect();
    let cells: Vec<[usize; 2]> = pixels.iter().map(|&p| [p % camera.columns, p / camera.columns]).collect();
    let in_image: Vec<[f64; 2]> = cells.iter().map(|c| c.map(|i| i as f64)).collect();
    let (points, normals): (Vec<DVec3>, Vec<DVec3>) = seen.iter().map(|s| (s.r, s.normal)).unzip();
    let Interface { body, face } = seen[0].interface;
    let solid = &world.bodies[body].solid;
    let places = Places::of(solid, face, &points, &normals, camera.view.position, &in_image);
    let step = step_of(world, seen[0].key.body);
    let rings = pixels.iter().zip(&seen).map(|(&pixel, s)| {
        let corner = camera.ray(pixel, 0.0, 0.0);
        let (origin, w) = camera.ray(pixel, 1.0, 0.0);
        // The width of a pixel square to the ray, as far away as what is seen.
        let distance = (s.r - origin).length();
        let width = (origin + distance * w - (corner.0 + distance * corner.1)).length();
        (f64::from(distances[pixel] - 1) * width / step.max(width)).min(1e6) as u32
    });
    // Channels differ in their power, which the coefficients hold.
    let emission = match rig.lights[0].emission {
        Emission::Intensity(_) => Emission::Intensity(1.0),
        Emission::Irradiance(_) => Emission::Irradiance(1.0),
    };
    let light = Light { emission, ..rig.lights[0] };
    let arrivals: Vec<_> = seen.iter().map(|s| (light.arrives(s.r).0, s.normal)).collect();
    let phases = |on_plane| fringes.at(projected, &light, on_plane).expect("pixels of a region see contrast");
    Region {
        name: scene.objects.keys().nth(rig.object_of[seen[0].key.body]).cloned().unwrap_or_default(),
        chart: places.chart,
        places: places.at,
        rings: rings.collect(),
        gains: arrivals.iter().map(|(a, normal)| a.irradiance * normal.dot(a.towards)).collect(),
        phases: arrivals.iter().flat_map(|(a, _)| phases(a.on_plane)).collect(),
        fringes: fringes.clone(),
        pixels: pixels.iter().map(|&p| p as u32).collect(),
        cells,
    }
}

/// Over such a distance (mm) light at an edge shows: the mean free path of transport; 0 for opaque surfaces.
fn step_of(world: &World, body: usize) -> f64 {
    let material = &world.materials[world.bodies[body].material];
    if material.is_opaque() { 0.0 } else { 1.0 / (material.mu_a + material.mu_s_prime()) }
}

#[cfg(test)]
mod tests;
