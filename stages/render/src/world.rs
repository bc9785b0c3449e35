//! The scene as a ray sees it: bodies in order of priority, and the segments that they cut a ray into.

use glam::DVec3;
use turbid_optics::PhaseFunction;
use turbid_optics::solid::{Chord, Solid, Start};

use crate::bsdf::Bsdf;
use crate::texture::Texture;

/// What fills a segment of a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// mm^-1.
    pub mu_a: f64,
    /// mm^-1.
    pub mu_s: f64,
    pub phase: PhaseFunction,
    /// Refractive index.
    pub n: f64,
    /// What light meets at the interface of a body of it.
    pub bsdf: Bsdf,
}

impl Material {
    pub const VOID: Self = Self::medium(0.0, 0.0, PhaseFunction::ISOTROPIC, 1.0);

    /// One that light can enter, with smooth interfaces.
    pub const fn medium(mu_a: f64, mu_s: f64, phase: PhaseFunction, n: f64) -> Self {
        Self { mu_a, mu_s, phase, n, bsdf: Bsdf::Smooth }
    }

    pub fn lambertian(rho: f64) -> Self {
        Self { bsdf: Bsdf::Lambertian(rho), ..Self::VOID }
    }

    /// Whether light cannot enter.
    #[inline(always)]
    pub fn is_opaque(&self) -> bool {
        self.bsdf.is_opaque()
    }

    pub fn mu_t(&self) -> f64 {
        self.mu_a + self.mu_s
    }

    /// Reduced scattering coefficient mu_s (1 - g), mm^-1.
    pub fn mu_s_prime(&self) -> f64 {
        self.mu_s * (1.0 - self.phase.g())
    }
}

/// A solid and what fills it, as an index into [`World::materials`].
#[derive(Clone, Debug, PartialEq)]
pub struct Body {
    pub solid: Solid,
    pub material: usize,
}

/// Bodies, highest priority first; material 0 is void.
#[derive(Clone, Debug)]
pub struct World {
    pub bodies: Vec<Body>,
    pub materials: Vec<Material>,
    pub textures: Vec<Texture>,
}

/// Part of a body's surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Interface {
    /// Index into [`World::bodies`].
    pub body: usize,
    /// Which of its faces; 0 for bodies with one smooth face.
    pub face: u32,
}

/// A point on an interface from which a ray starts, and on which side of the body: with it, no rounding of the point can put the
/// ray on the wrong side.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SurfacePoint {
    pub interface: Interface,
    pub inside: bool,
}

/// Part of a ray within one material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RaySegment {
    pub start: f64,
    /// Infinite on the way out.
    pub end: f64,
    pub material: usize,
    /// What lies at `end`; `None` where `end` is infinite.
    pub interface: Option<Interface>,
}

/// Segments shorter than this (mm) are rounding of touching faces.
const NOTHING: f64 = 1e-10;

/// Scratch of [`World::trace`]: where the ray stays in each body.
#[derive(Clone, Debug, Default)]
pub struct Chords {
    chords: Vec<Chord>,
    /// Of each body, where its chords end in that list.
    ends: Vec<usize>,
}

impl World {
    /// Whether a body that light enters has a bore or a hollow.
    pub fn is_hollow(&self) -> bool {
        self.bodies
            .iter()
            .any(|body| self.materials[body.material].mu_s > 0.0 && matches!(body.solid, Solid::Carved(_)))
    }

    /// Cuts the ray origin + t direction, t > 0, at the bodies.
    pub fn trace<'a>(
        &'a self,
        origin: DVec3,
        direction: DVec3,
        surface_point: Option<SurfacePoint>,
        scratch: &'a mut Chords,
    ) -> RaySegments<'a> {
        self.trace_by(scratch, |i, solid, chords| {
            let surface_point = surface_point.filter(|surface_point| surface_point.interface.body == i);
            let start = surface_point
                .map(|surface_point| Start { face: surface_point.interface.face, inside: surface_point.inside });
            solid.cut(origin, direction, start, chords);
        })
    }

    /// The same, with `cut` to say where the ray stays in each body.
    #[inline(always)]
    pub fn trace_by<'a>(
        &'a self,
        scratch: &'a mut Chords,
        mut cut: impl FnMut(usize, &Solid, &mut Vec<Chord>),
    ) -> RaySegments<'a> {
        scratch.chords.clear();
        scratch.ends.clear();
        for (i, body) in self.bodies.iter().enumerate() {
            cut(i, &body.solid, &mut scratch.chords);
            scratch.ends.push(scratch.chords.len());
        }
        RaySegments { world: self, scratch, t: 0.0 }
    }

    /// Unit normal, out of the body, at a point of an interface.
    pub fn normal(&self, interface: Interface, p: DVec3) -> DVec3 {
        self.bodies[interface.body].solid.normal(interface.face, p)
    }

    /// Fraction of the light that a BSDF reflects diffusely at a point of an interface; `None` where it goes on as a ray.
    #[inline]
    pub fn albedo(&self, bsdf: Bsdf, interface: Interface, p: DVec3) -> Option<f64> {
        match bsdf {
            Bsdf::Lambertian(rho) => Some(rho),
            Bsdf::Textured(texture) => {
                let place = self.bodies[interface.body].solid.patch(interface.face, p);
                // Meshes are refused; a hole of such a shape in a textured body is black.
                Some(place.map_or(0.0, |place| self.textures[texture].albedo(&place)))
            }
            Bsdf::Smooth | Bsdf::Rough(_) | Bsdf::Mirror => None,
        }
    }

    /// No boundary lies within this distance (mm) of `p`.
    #[inline]
    pub fn clearance(&self, p: DVec3) -> f64 {
        self.bodies.iter().fold(f64::INFINITY, |least, body| least.min(body.solid.clearance(p)))
    }
}

/// The segments of a ray in order; the last one ends at infinity.
pub struct RaySegments<'a> {
    world: &'a World,
    scratch: &'a Chords,
    t: f64,
}

impl RaySegments<'_> {
    /// Material at t, and where and at which body it ends.
    #[inline]
    fn at(&self, t: f64) -> RaySegment {
        let (mut end, mut interface) = (f64::INFINITY, None);
        let mut first = 0;
        for (i, &last) in self.scratch.ends.iter().enumerate() {
            // The first chord that is not over: the others begin behind it.
            let chord = self.scratch.chords[first..last].iter().find(|chord| chord.leave > t);
            first = last;
            let Some(&Chord { enter, leave, into, out_of }) = chord else { continue };
            let (next, face) = if enter > t { (enter, into) } else { (leave, out_of) };
            if next < end {
                (end, interface) = (next, Some(Interface { body: i, face }));
            }
            if enter <= t {
                // The first that holds t has the highest priority; those after it do not show.
                return RaySegment { start: t, end, material: self.world.bodies[i].material, interface };
            }
        }
        RaySegment { start: t, end, material: 0, interface }
    }
}

impl Iterator for RaySegments<'_> {
    type Item = RaySegment;

    #[inline]
    fn next(&mut self) -> Option<RaySegment> {
        if self.t == f64::INFINITY {
            return None;
        }
        let mut segment = self.at(self.t);
        while segment.end - segment.start < NOTHING {
            segment = self.at(segment.end);
        }
        // Neighbours of one material are one segment: no boundary lies between them.
        while segment.end < f64::INFINITY {
            let next = self.at(segment.end);
            if next.material != segment.material && next.end - next.start >= NOTHING {
                break;
            }
            (segment.end, segment.interface) = (next.end, next.interface);
        }
        self.t = segment.end;
        Some(segment)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn world() -> World {
        let medium = |mu_s| Material::medium(0.1, mu_s, PhaseFunction::ISOTROPIC, 1.0);
        World {
            // Highest priority first: void ball in a ball in a slab, beside a block that touches the slab.
            bodies: vec![
                Body { solid: Solid::Ellipsoid { center: DVec3::ZERO, radii: DVec3::splat(1.0) }, material: 0 },
                Body { solid: Solid::Ellipsoid { center: DVec3::ZERO, radii: DVec3::splat(2.0) }, material: 2 },
                Body { solid: Solid::Slab { bottom: -10.0, top: 0.0 }, material: 1 },
                Body { solid: Solid::Slab { bottom: -20.0, top: -10.0 }, material: 1 },
            ],
            materials: vec![Material::VOID, medium(1.0), medium(2.0)],
            textures: Vec::new(),
        }
    }

    fn cut(origin: DVec3, direction: DVec3, surface_point: Option<SurfacePoint>) -> Vec<(f64, f64, usize)> {
        let (world, mut scratch) = (world(), Chords::default());
        world.trace(origin, direction, surface_point, &mut scratch).map(|p| (p.start, p.end, p.material)).collect()
    }

    #[test]
    fn priorities_carve_and_touching_slabs_of_one_medium_are_one() {
        let inf = f64::INFINITY;
        assert_eq!(
            cut(DVec3::new(0.0, 0.0, 5.0), DVec3::NEG_Z, None),
            [(0.0, 3.0, 0), (3.0, 4.0, 2), (4.0, 6.0, 0), (6.0, 7.0, 2), (7.0, 25.0, 1), (25.0, inf, 0)]
        );
        assert_eq!(cut(DVec3::new(5.0, 0.0, -3.0), DVec3::Z, None), [(0.0, 3.0, 1), (3.0, inf, 0)]);
        assert_eq!(cut(DVec3::new(5.0, 0.0, 1.0), DVec3::X, None), [(0.0, inf, 0)]);
    }

    /// From the surface point of the outer ball, slightly off by rounding, the side is the one that was said.
    #[test]
    fn a_surface_point_settles_the_side() {
        for off in [-1e-15, 0.0, 1e-15] {
            let p = DVec3::new(0.0, 0.0, 2.0 + off);
            let interface = Interface { body: 1, face: 0 };
            let outside = cut(p, DVec3::Z, Some(SurfacePoint { interface, inside: false }));
            assert_eq!(outside, [(0.0, f64::INFINITY, 0)]);
            let inside = cut(p, DVec3::NEG_Z, Some(SurfacePoint { interface, inside: true }));
            assert_eq!(inside[0].2, 2);
            assert!((inside[0].1 - 1.0).abs() < 1e-14);
        }
    }
}
