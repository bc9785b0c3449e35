//! One free flight, and where it ends.

use glam::DVec3;

use crate::lengths::count;
use crate::setting::{Nee, Place, Setting};
use crate::walker::{Entry, Walker};
use crate::world::{Skin, Wall};

/// How a flight ended.
pub(super) enum End {
    Scattered {
        crossed: bool,
    },
    Surface {
        skin: Skin,
        normal: DVec3,
        rho: f64,
    },
    /// At a mirror in a material; `normal` towards the path.
    Mirror {
        skin: Skin,
        normal: DVec3,
        from: usize,
    },
    /// At a smooth wall between materials of different refractive index; `skin` is on this side.
    Boundary {
        skin: Skin,
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
                at.life -= here.mu_a * s;
                if at.life < 0.0 {
                    at.r += (s + at.life / here.mu_a) * at.w;
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
        let mut before: Option<Wall> = None;
        let mut from: Option<usize> = None;
        for piece in world.trace(at.r, at.w, at.skin, &mut self.spans) {
            let material = &world.materials[piece.material];
            if material.is_opaque() {
                let Some(wall) = before else {
                    // Rounding put the start of the ray into an opaque body: a set of measure zero.
                    return End::Gone;
                };
                let r = at.r + piece.start * at.w;
                let normal = world.normal(wall, r);
                // The surface faces the ray: the outside of the body if the ray comes from there.
                let inside = normal.dot(at.w) > 0.0;
                at.r = r;
                let normal = if inside { -normal } else { normal };
                let skin = Skin { wall, inside };
                return match world.albedo(material.finish, wall, r) {
                    Some(rho) => End::Surface { skin, normal, rho },
                    None => End::Mirror { skin, normal, from: from.unwrap_or(0) },
                };
            }
            if let (Some(wall), Some(from)) = (before, from)
                && world.materials[from].n != material.n
            {
                at.r += piece.start * at.w;
                let normal = world.normal(wall, at.r);
                let skin = Skin { wall, inside: normal.dot(at.w) > 0.0 };
                return End::Boundary { skin, normal, from, to: piece.material };
            }
            let length = piece.end - piece.start;
            if crossed && foresees && material.mu_s > 0.0 {
                let r = at.r + piece.start * at.w;
                let (material, lengths) = (piece.material, at.lengths);
                self.entries.push(Entry { r, length, material, wall: before, lengths });
            }
            let to_scattering = tau * self.free_paths[piece.material];
            let flown = length.min(to_scattering);
            if material.mu_a > 0.0 {
                at.life -= material.mu_a * flown;
                if at.life < 0.0 {
                    // The life went out before its end.
                    at.r += (piece.start + flown + at.life / material.mu_a) * at.w;
                    return End::Gone;
                }
            }
            count(shared, &mut at.lengths, piece.material, flown);
            if to_scattering < length {
                at.r += (piece.start + to_scattering) * at.w;
                at.material = piece.material;
                at.clear = world.clearance(at.r);
                return End::Scattered { crossed };
            }
            if material.mu_s > 0.0 {
                tau -= length * material.mu_s;
            }
            crossed = true;
            (before, from) = (piece.wall, Some(piece.material));
        }
        End::Left
    }
}
