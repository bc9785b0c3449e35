//! One path from the camera: free flights, analog absorption, and what follows from each.
//!
//! A path is walked backward from a random point of its pixel; what it sees of the light at its turns stands in `next_event.rs`.
//! `docs/theory/render.md` derives the weights.

mod flight;
mod responses;

use glam::DVec3;
use turbid_optics::elementary::{ln, sin_cos_turns};
use turbid_optics::henyey_greenstein as hg;
use turbid_optics::philox::{spare, unit, unit_fine};
use turbid_optics::refraction::refract;
use turbid_optics::rough::Rough;

use self::flight::End;
use crate::bsdf::Bsdf;
use crate::lengths::NO_LENGTHS;
use crate::random::{MOST_NUMBERS, Purpose, Stream, after};
pub use crate::setting::{Nee, Place, Setting};
pub use crate::walker::{Ending, Walker};
use crate::world::SurfacePoint;

impl Walker<'_> {
    /// One path of a pixel: its radiances (W mm^-2 sr^-1) as [`crate::response::Layout`] says. The same numbers whenever and wherever it is called.
    pub fn path(&mut self, pixel: usize, sample: u32) -> &[f64] {
        self.clear_responses(1);
        let at = self.begin(pixel, sample, 0);
        self.finish(at);
        while let Some(mut light_branch) = self.sent.pop_front() {
            self.step(&mut light_branch);
        }
        self.gather();
        &self.responses
    }

    /// A path at the camera, its single scattering seen to.
    pub fn begin(&mut self, pixel: usize, sample: u32, response: usize) -> Place {
        let s = self.setting;
        let stream = Stream::new(s.key, pixel as u32, sample, s.channel);
        let [jx, jy, ja, jb] = stream.block(Purpose::Begin);
        let line = s.nee == Nee::Line;
        let (r, w) = if s.camera.has_aperture() {
            let [u, v, ..] = stream.block(Purpose::Lens);
            s.camera.ray_through(pixel, unit(jx), unit(jy), unit(u), unit(v))
        } else {
            s.camera.ray(pixel, unit(jx), unit(jy))
        };
        let at = Place {
            r,
            w,
            material: 0,
            surface_point: None,
            clear: 0.0,
            // Absorption at a rate mu_a along the way ends the path: drawn once, exact for any albedo and sequence of media.
            absorption_depth: -ln(unit_fine(ja, jb)),
            weight: 1.0,
            pixel: pixel as u32,
            sample,
            number: 2,
            ahead: line,
            wholly: line,
            scattered: false,
            specular: false,
            mis_weight: 1.0,
            light_branch: false,
            response,
            lengths: NO_LENGTHS,
        };
        if line {
            self.next_event_along(&at, &stream);
        }
        at
    }

    /// One flight and what follows from it; false where the path has ended.
    pub fn step(&mut self, at: &mut Place) -> bool {
        let stream = self.stream(at);
        let flight = at.number;
        let [a, b, c, d] = stream.block(Purpose::Flight(flight));
        at.number = after(flight, at.light_branch);
        self.flights += 1;
        // In a closed white cavity light has nowhere to go.
        if at.number > MOST_NUMBERS {
            self.endless = true;
            self.ending = Ending::Endless;
            return false;
        }
        let roulette = unit(d);
        let end = self.fly(at, -ln(unit_fine(a, d)));
        if !self.entries.is_empty() {
            self.next_event_in_entries(at, roulette);
        }
        match end {
            // The path itself sees to the light there.
            End::Left | End::Surface { .. } if at.light_branch => false,
            End::Gone => {
                // The first, in order of priority, that holds the place.
                let body = self.setting.world.bodies.iter().position(|body| body.solid.contains(at.r));
                self.ending = body.map_or(Ending::Left, Ending::Absorbed);
                false
            }
            End::Left => {
                self.ending = Ending::Left;
                self.see_ambient(at);
                false
            }
            End::Surface { surface_point, normal, rho } => {
                at.surface_point = Some(surface_point);
                self.meet_surface(at, normal, rho, roulette, [b, c])
            }
            End::Mirror { surface_point, normal, from } => {
                let w = (at.w - 2.0 * at.w.dot(normal) * normal).normalize();
                self.turn(at, (surface_point, from), w, &stream);
                true
            }
            End::Boundary { surface_point, normal, from, to } => {
                let [n_from, n_to] = [from, to].map(|m| self.setting.world.materials[m].n);
                let owner = self.setting.world.bodies[surface_point.interface.body].material;
                let on = if let Bsdf::Rough(alpha) = self.setting.world.materials[owner].bsdf {
                    let normal = if surface_point.inside { -normal } else { normal };
                    let rough = Rough { alpha, normal, n_from, n_to };
                    let mut dice = stream.dice(Purpose::Facets(flight));
                    let on = rough.walk(at.w, || dice.throw(), &mut self.facet_flights);
                    if at.scattered || !self.excludes_specular {
                        self.next_event_at_rough(at, &rough, surface_point);
                    }
                    on
                } else {
                    let refraction = refract(at.w, normal, n_from, n_to);
                    refraction.refracted.filter(|_| roulette >= refraction.reflectance).unwrap_or(refraction.reflected)
                };
                let through = (on.dot(normal) > 0.0) == surface_point.inside;
                let behind = SurfacePoint { inside: !surface_point.inside, ..surface_point };
                self.turn(at, if through { (behind, to) } else { (surface_point, from) }, on, &stream);
                true
            }
            End::Scattered { crossed } => self.scatter(at, crossed, roulette, [b, c, d], &stream),
        }
    }

    /// A Lambertian surface of reflectance `rho`, in its normal; false where the path ends there.
    fn meet_surface(&mut self, at: &mut Place, normal: DVec3, rho: f64, roulette: f64, [b, c]: [u32; 2]) -> bool {
        at.clear = 0.0;
        (at.scattered, at.specular, at.mis_weight) = (true, false, 1.0);
        self.next_event_at_surface(at, normal, rho);
        if roulette >= rho {
            let body = at.surface_point.expect("it stands on one").interface.body;
            self.ending = Ending::Absorbed(body);
            return false;
        }
        at.w = cosine_direction(normal, unit(b), unit(c));
        (at.ahead, at.wholly) = (false, false);
        true
    }

    /// From a specular interface the path goes on along `w`, on this side of it and in this material.
    fn turn(&mut self, at: &mut Place, (surface_point, material): (SurfacePoint, usize), w: DVec3, stream: &Stream) {
        at.specular |= !at.scattered;
        (at.surface_point, at.material) = (Some(surface_point), material);
        (at.w, at.clear) = (w, 0.0);
        let line = self.setting.nee == Nee::Line;
        (at.ahead, at.wholly) = (line, line && !at.scattered);
        if line {
            self.next_event_along(at, stream);
        }
    }

    /// A collision: next-event estimation, roulette, a new direction, weight windows. False where the path ends.
    fn scatter(&mut self, at: &mut Place, crossed: bool, roulette: f64, [b, c, d]: [u32; 3], stream: &Stream) -> bool {
        at.surface_point = None;
        (at.scattered, at.specular) = (true, false);
        let line = self.setting.nee == Nee::Line;
        if !(at.ahead || (crossed && line)) {
            self.next_event_at_collision(at, roulette);
        }
        at.wholly = false;
        if !at.light_branch
            && self.peaked_index.is_none()
            && self.windows[at.material] > 0.0
            && self.ends_deep(at, spare(b, c, d))
        {
            return false;
        }
        let next = self.setting.world.materials[at.material].phase.sample(at.w, unit(b), unit(c));
        if line {
            self.next_event_ahead(at, next, roulette);
            (at.ahead, at.mis_weight) = (true, 1.0);
            if self.light_branches.get(at.material) == Some(&true) && !at.light_branch {
                self.send_light_branch(at, next);
            }
        }
        let came = std::mem::replace(&mut at.w, next);
        !at.light_branch && (self.peaked_index.is_none() || self.keep_in_window(at, came, stream))
    }

    /// Roulette of deep paths where absorption is weak.
    #[inline]
    fn ends_deep(&mut self, at: &mut Place, random: f64) -> bool {
        at.clear = self.setting.world.clearance(at.r);
        let window = deep_weight(self.windows[at.material], at.clear);
        if at.weight >= 0.5 * window {
            return false;
        }
        let survives = random * window < at.weight;
        at.weight = window;
        !survives
    }
}

/// Weight below half of which a path at distance `clear` from every boundary plays roulette for it; `window` is WINDOW mu_eff.
#[inline(always)]
pub fn deep_weight(window: f64, clear: f64) -> f64 {
    let x = 1.0 + window * clear;
    x * x * x * x
}

/// A direction off a surface with a density proportional to the cosine.
fn cosine_direction(normal: DVec3, u: f64, turns: f64) -> DVec3 {
    let (sin_phi, cos_phi) = sin_cos_turns(turns);
    hg::turn(normal, u.sqrt(), (1.0 - u).sqrt(), sin_phi, cos_phi)
}
