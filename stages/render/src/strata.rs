//! Strata: worlds whose refractive index changes at horizontal planes only.

use glam::DVec3;
use turbid_optics::solid::Solid;

use crate::bsdf::Bsdf;
use crate::mirrors::Mirrors;
use crate::single::limits::MOST_BODIES;
use crate::world::{Body, World};

/// The refractive index as a function of z.
#[derive(Clone, Debug, PartialEq)]
pub struct Strata {
    /// World z of the planes between the layers, from below upwards.
    pub edges: Vec<f64>,
    /// From below upwards: one more than there are edges.
    pub layers: Vec<Layer>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layer {
    pub n: f64,
    /// No light passes.
    pub opaque: bool,
}

/// Where light bends in a world.
#[derive(Clone, Debug, PartialEq)]
pub enum Bending {
    /// Nowhere: all that light can enter has one refractive index, and mirrors are flat.
    Nowhere,
    AtPlanes(Strata),
    /// At rough interfaces only: no light crosses them without being scattered by them.
    AtRough,
    /// At smooth interfaces of any shape, mirrors among them.
    AtInterfaces,
    /// At interfaces for which no connection to the light behind them is found.
    Anywhere,
}

impl Bending {
    pub fn of(world: &World) -> Self {
        let clear = |i: usize| !world.materials[i].is_opaque();
        let bends: Vec<_> =
            world.bodies.iter().filter(|b| clear(b.material) && world.materials[b.material].n != 1.0).collect();
        let mirrors = Mirrors::of(world);
        if bends.is_empty() {
            return if mirrors.curved { Self::AtInterfaces } else { Self::Nowhere };
        }
        let rough = |material: usize| matches!(world.materials[material].bsdf, Bsdf::Rough(_));
        if bends.iter().any(|b| rough(b.material)) {
            // A smooth body carved into a rough one has smooth interfaces.
            let carves = |i: usize, hole: &Body| {
                clear(hole.material)
                    && !rough(hole.material)
                    && world.bodies[i + 1..].iter().any(|b| rough(b.material) && meet(hole, b))
            };
            let all = bends.iter().all(|b| rough(b.material))
                && !world.bodies.iter().enumerate().any(|(i, body)| carves(i, body));
            return if all { Self::AtRough } else { Self::Anywhere };
        }
        match Strata::of(world) {
            Some(strata) if mirrors.is_empty() => Self::AtPlanes(strata),
            _ => Self::AtInterfaces,
        }
    }
}

/// Whether no interface is curved: then all connections by one refraction are known.
pub fn is_flat(world: &World) -> bool {
    fn flat(solid: &Solid) -> bool {
        match solid {
            Solid::Slab { .. } | Solid::Box { .. } | Solid::Mesh(_) => true,
            Solid::Turned(turned) => flat(&turned.solid),
            Solid::Ellipsoid { .. } | Solid::Cylinder { .. } | Solid::Carved(_) => false,
        }
    }
    world.bodies.iter().all(|body| world.materials[body.material].is_opaque() || flat(&body.solid))
}

/// Whether all that bends light is the interfaces of few whole bodies of one refractive index that bulge outwards, or facets: f32 lanes find the connections.
pub fn bulges(world: &World) -> bool {
    let n = |body: &Body| world.materials[body.material].n;
    let bends = world.bodies.iter().filter(|body| !world.materials[body.material].is_opaque());
    let first = bends.clone().next().map_or(1.0, n);
    let whole = |body: &Body| !matches!(body.solid, Solid::Turned(_) | Solid::Carved(_));
    first > 1.0
        && world.bodies.len() <= MOST_BODIES
        && bends.clone().all(|body| n(body) == first)
        && world.bodies.iter().all(whole)
}

/// Meshes at whose surface the refractive index may change.
pub fn facetted(world: &World) -> impl Iterator<Item = &Body> {
    let clear = |body: &Body| !world.materials[body.material].is_opaque();
    let n = |body: &Body| world.materials[body.material].n;
    let changes =
        move |mesh: &Body| n(mesh) != 1.0 || world.bodies.iter().any(|b| clear(b) && n(b) != n(mesh) && meet(mesh, b));
    world.bodies.iter().filter(move |body| is_mesh(&body.solid) && clear(body) && changes(body))
}

fn is_mesh(solid: &Solid) -> bool {
    match solid {
        Solid::Turned(turned) => is_mesh(&turned.solid),
        _ => matches!(solid, Solid::Mesh(_)),
    }
}

/// Whether facets turn light, by refraction or as mirrors.
pub fn turns_at_facets(world: &World) -> bool {
    facetted(world).next().is_some() || Mirrors::of(world).bodies.iter().any(|&i| is_mesh(&world.bodies[i].solid))
}

/// Bounds of what shows of a solid, less what boxes and slabs before it take off its top and bottom; upside down where nothing shows.
pub fn visible_bounds<'a>(before: impl Iterator<Item = &'a Solid>, solid: &Solid) -> (DVec3, DVec3) {
    let (mut low, mut high) = solid.bounds();
    for solid in before.filter(|solid| matches!(solid, Solid::Slab { .. } | Solid::Box { .. })) {
        let (from, to) = solid.bounds();
        let covers = from.truncate().cmple(low.truncate()).all() && to.truncate().cmpge(high.truncate()).all();
        if covers && (from.z..=to.z).contains(&high.z) {
            high.z = from.z;
        }
        if covers && (from.z..=to.z).contains(&low.z) {
            low.z = to.z;
        }
    }
    (low, high)
}

/// Whether the bodies' bounding boxes share volume.
fn meet(a: &Body, b: &Body) -> bool {
    let ((a_low, a_high), (b_low, b_high)) = (a.solid.bounds(), b.solid.bounds());
    a_low.cmplt(b_high).all() && b_low.cmplt(a_high).all()
}

impl Strata {
    /// `None` where something that is not a slab has an index other than its surroundings, where it shows.
    pub fn of(world: &World) -> Option<Self> {
        let mut edges: Vec<f64> = Vec::new();
        for body in &world.bodies {
            if let Solid::Slab { bottom, top } = body.solid {
                edges.extend([bottom, top]);
            }
        }
        edges.sort_by(f64::total_cmp);
        edges.dedup();
        let void = Layer { n: 1.0, opaque: false };
        let mut strata = Self { edges: Vec::new(), layers: vec![void] };
        // Between all edges, with the slab there by its place among the bodies.
        let mut between = vec![(void, usize::MAX)];
        for (i, &edge) in edges.iter().enumerate() {
            let middle = edges.get(i + 1).map_or(edge + 1.0, |next| 0.5 * (edge + next));
            let holds =
                |body: &Body| matches!(body.solid, Solid::Slab { bottom, top } if bottom < middle && middle < top);
            let slab = world.bodies.iter().position(holds);
            let material = &world.materials[slab.map_or(0, |slab| world.bodies[slab].material)];
            let layer = Layer { n: material.n, opaque: material.is_opaque() };
            between.push((layer, slab.unwrap_or(usize::MAX)));
            if strata.layers.last() != Some(&layer) {
                strata.edges.push(edge);
                strata.layers.push(layer);
            }
        }
        let in_its_layer = |(i, body): (usize, &Body)| {
            let material = &world.materials[body.material];
            if matches!(body.solid, Solid::Slab { .. }) || material.is_opaque() {
                return true;
            }
            let (low, high) = visible_bounds(world.bodies[..i].iter().map(|body| &body.solid), &body.solid);
            if low.z >= high.z {
                return true;
            }
            let (first, last) = (edges.partition_point(|&e| e <= low.z), edges.partition_point(|&e| e < high.z));
            // Slabs of higher priority hide it.
            between[first..=last].iter().all(|&(layer, slab)| slab < i || layer.opaque || layer.n == material.n)
        };
        world.bodies.iter().enumerate().all(in_its_layer).then_some(strata)
    }

    /// The layer around a point at height z; on an edge the upper one if `up`.
    #[inline]
    pub fn layer(&self, z: f64, up: bool) -> usize {
        if up { self.edges.partition_point(|&e| e <= z) } else { self.edges.partition_point(|&e| e < z) }
    }

    /// The next plane from within a layer, its z and the layer behind it; `None` on the way out.
    #[inline]
    pub fn onward(&self, layer: usize, up: bool) -> Option<(f64, usize)> {
        let (edge, next) = if up { (layer, layer + 1) } else { (layer.wrapping_sub(1), layer.wrapping_sub(1)) };
        self.edges.get(edge).map(|&z| (z, next))
    }
}

/// Of each layer, the most that straight light can keep from one of its planes to the other; 1 in the outer ones.
pub fn clear(world: &World, strata: &Strata) -> Vec<f64> {
    let mut cuts: Vec<f64> = Vec::new();
    for body in &world.bodies {
        if let Solid::Slab { bottom, top } = body.solid {
            cuts.extend([bottom, top]);
        }
    }
    cuts.sort_by(f64::total_cmp);
    let within = |low: f64, high: f64| {
        let middle = 0.5 * (low + high);
        let slab =
            world.bodies.iter().find(|b| matches!(b.solid, Solid::Slab { .. }) && b.solid.contains(DVec3::Z * middle));
        let around = slab.map_or(0.0, |b| world.materials[b.material].mu_t());
        // Others may lie in its place.
        let others = world.bodies.iter().filter(|b| {
            let (from, to) = b.solid.bounds();
            !matches!(b.solid, Solid::Slab { .. }) && from.z < high && to.z > low
        });
        others.map(|b| world.materials[b.material].mu_t()).fold(around, f64::min) * (high - low)
    };
    let layers = 0..strata.layers.len();
    let tau = layers.map(|i| {
        let (Some(&low), Some(&high)) = (i.checked_sub(1).and_then(|i| strata.edges.get(i)), strata.edges.get(i))
        else {
            return 0.0;
        };
        let inner = cuts.iter().copied().filter(|&z| z >= low && z <= high);
        let inner: Vec<f64> = inner.collect();
        inner.windows(2).map(|pair| within(pair[0], pair[1])).sum::<f64>()
    });
    tau.map(|tau| libm::exp(-tau)).collect()
}

#[cfg(test)]
mod tests {
    use turbid_optics::PhaseFunction;

    use super::*;
    use crate::world::Material;

    #[test]
    fn slabs_become_layers_by_priority_and_other_bodies_must_match() {
        let slab = |bottom, top, material| Body { solid: Solid::Slab { bottom, top }, material };
        let ball =
            |z: f64, material| Body { solid: Solid::Ellipsoid { center: z * DVec3::Z, radii: DVec3::ONE }, material };
        let world = |bodies| World {
            bodies,
            materials: vec![
                Material::VOID,
                Material::medium(0.1, 1.0, PhaseFunction::henyey_greenstein(0.8), 1.4),
                Material::medium(0.2, 2.0, PhaseFunction::henyey_greenstein(0.8), 1.4),
                Material::lambertian(0.5),
            ],
            textures: Vec::new(),
        };
        // A hole in glass over a floor; two slabs of one index are one layer.
        let strata = Strata::of(&world(vec![
            slab(-3.0, -2.0, 0),
            slab(-10.0, 0.0, 1),
            slab(0.0, 1.0, 2),
            slab(-20.0, -10.0, 3),
        ]));
        let strata = strata.unwrap();
        assert_eq!(strata.edges, [-20.0, -10.0, -3.0, -2.0, 1.0]);
        let kinds: Vec<_> = strata.layers.iter().map(|l| (l.n, l.opaque)).collect();
        assert_eq!(kinds, [(1.0, false), (1.0, true), (1.4, false), (1.0, false), (1.4, false), (1.0, false)]);
        assert_eq!([strata.layer(-2.0, true), strata.layer(-2.0, false), strata.layer(0.0, true)], [4, 3, 4]);
        assert_eq!([strata.onward(0, false), strata.onward(5, true)], [None, None]);
        assert_eq!([strata.onward(3, false), strata.onward(3, true)], [Some((-3.0, 2)), Some((-2.0, 4))]);
        for (z, planes) in [(-5.0, true), (-1.0, true), (0.0, true), (0.5, false), (5.0, false)] {
            let bending = Bending::of(&world(vec![ball(z, 2), slab(-10.0, 1.0, 1)]));
            assert_eq!(matches!(bending, Bending::AtPlanes(_)), planes, "ball at {z}");
        }
        assert_eq!(Bending::of(&world(vec![ball(0.0, 0), slab(-10.0, 1.0, 1)])), Bending::AtInterfaces);
        // Cut level with the slab by something as wide, it does not stand out of it.
        let cut = |side: f64, material| Body {
            solid: Solid::Box { low: DVec3::new(-side, -side, 1.0), high: DVec3::new(side, side, 3.0) },
            material,
        };
        for (side, material, planes) in [(2.0, 0, true), (0.5, 0, false), (2.0, 1, false)] {
            let bending = Bending::of(&world(vec![cut(side, material), ball(0.5, 2), slab(-10.0, 1.0, 1)]));
            assert_eq!(matches!(bending, Bending::AtPlanes(_)), planes, "cut by {side}, {material}");
        }
        // What a slab hides does not bend.
        assert!(matches!(Bending::of(&world(vec![slab(-10.0, 1.0, 1), ball(0.0, 0)])), Bending::AtPlanes(_)));
        assert_eq!(Bending::of(&world(vec![slab(-10.0, 0.5, 1), ball(0.0, 1)])), Bending::AtInterfaces);
        assert_eq!(Bending::of(&world(vec![ball(0.0, 0), slab(-10.0, 1.0, 3)])), Bending::Nowhere);
    }
}
