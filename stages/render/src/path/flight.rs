//! One free flight, and where it ends.

use glam::DVec3;

use crate::lengths::count;
use crate::setting::{Nee, Place, Setting};
use crate::walker::{Entry, Walker};
use crate::world::{Interface, SurfacePoint};

/// How a flight ended.
pub(super) enum End {
    Scattered {
        crossed: bool,
    },
    Surface {
        surface_point: SurfacePoint,
        normal: DVec3,
        rho: f64,
    },
    /// At a mirror in a material; `normal` towards the path.
    Mirror {
        surface_point: SurfacePoint,
        normal: DVec3,
        from: usize,
    },
    /// At an interface between materials of different refractive index; `surface_point` is on this side.
    Boundary {
        surface_point: SurfacePoint,
        normal: DVec3,
        from: usize,
        to: usize,
    },
    /// Nothing more comes of it.
    Gone,
    /// On its way to infinity.
    Left,
}

impl Walker<'_> {
    /// One free flight through whatever is in the way, over `tau` scattering mean free paths.
    #[inline]
    pub(super) fn fly(&mut self, at: &mut Place, tau: f64) -> End {
        let world = self.setting.world;
        let here = &world.materials[at.material];
        if at.clear > 0.0 {
            // A medium: the last flight ended in it by a scattering.
            let s = tau * self.free_paths[at.material];
            if s >= at.clear {
                at.clear = world.clearance(at.r);
            }
            if s < at.clear {
                at.absorption_depth -= here.mu_a * s;
                if at.absorption_depth < 0.0 {
                    at.r += (s + at.absorption_depth / here.mu_a) * at.w;
                    return End::Gone;
                }
                at.r += s * at.w;
                at.clear -= s;
                count(self.setting.shared, &mut at.lengths, at.material, s);
                return End::Scattered { crossed: false };
            }
        }
        self.fly_across(at, tau)
    }

    /// The same through boundaries.
    fn fly_across(&mut self, at: &mut Place, mut tau: f64) -> End {
        let Setting { world, shared, .. } = self.setting;
        let mut crossed = false;
        let foresees = self.setting.nee == Nee::Line && !at.wholly;
        let mut before: Option<Interface> = None;
        let mut from: Option<usize> = None;
        for segment in world.trace(at.r, at.w, at.surface_point, &mut self.chords) {
            let material = &world.materials[segment.material];
            if material.is_opaque() {
                let Some(interface) = before else {
                    // Rounding put the start of the ray into an opaque body: a set of measure zero.
                    return End::Gone;
                };
                let r = at.r + segment.start * at.w;
                let normal = world.normal(interface, r);
                // The surface faces the ray: the outside of the body if the ray comes from there.
                let inside = normal.dot(at.w) > 0.0;
                at.r = r;
                let normal = if inside { -normal } else { normal };
                let surface_point = SurfacePoint { interface, inside };
                return match world.albedo(material.bsdf, interface, r) {
                    Some(rho) => End::Surface { surface_point, normal, rho },
                    None => End::Mirror { surface_point, normal, from: from.unwrap_or(0) },
                };
            }
            if let (Some(interface), Some(from)) = (before, from)
                && world.materials[from].n != material.n
            {
                at.r += segment.start * at.w;
                let normal = world.normal(interface, at.r);
                let surface_point = SurfacePoint { interface, inside: normal.dot(at.w) > 0.0 };
                return End::Boundary { surface_point, normal, from, to: segment.material };
            }
            let length = segment.end - segment.start;
            if crossed && foresees && material.mu_s > 0.0 {
                let r = at.r + segment.start * at.w;
                let (material, lengths) = (segment.material, at.lengths);
                self.entries.push(Entry { r, length, material, interface: before, lengths });
            }
            let to_scattering = tau * self.free_paths[segment.material];
            let flown = length.min(to_scattering);
            if material.mu_a > 0.0 {
                at.absorption_depth -= material.mu_a * flown;
                if at.absorption_depth < 0.0 {
                    // The absorption depth is used up before its end.
                    at.r += (segment.start + flown + at.absorption_depth / material.mu_a) * at.w;
                    return End::Gone;
                }
            }
            count(shared, &mut at.lengths, segment.material, flown);
            if to_scattering < length {
                at.r += (segment.start + to_scattering) * at.w;
                at.material = segment.material;
                at.clear = world.clearance(at.r);
                return End::Scattered { crossed };
            }
            if material.mu_s > 0.0 {
                tau -= length * material.mu_s;
            }
            crossed = true;
            (before, from) = (segment.interface, Some(segment.material));
        }
        End::Left
    }
}
