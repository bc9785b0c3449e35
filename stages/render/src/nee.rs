//! Next-event estimation: what a path sees of the light at its turns, one scattering ahead where that is possible.

use std::f64::consts::FRAC_1_PI;

use glam::DVec3;
use turbid_optics::henyey_greenstein as hg;
use turbid_optics::philox::unit;

use crate::lamp::Source;
use crate::light::Arrival;
use crate::look;
use crate::path::{Place, Stream, Walker};
use crate::world::{Material, Skin};

/// Light is looked for with probability min(1, (TAU_SURE / tau)^4) at optical distance tau from it.
pub const TAU_SURE: f64 = 3.0;

/// Where the next scattering is looked for.
struct Line {
    r: DVec3,
    /// Unit vector along it.
    e: DVec3,
    /// mm within the material.
    length: f64,
    material: usize,
    /// Unit vector from r to the light.
    towards: DVec3,
    /// Normal of the boundary through which the light comes, towards it.
    exit: Option<DVec3>,
}

/// What lies between a point and the light.
struct Sight {
    /// Optical depth; opaque bodies do not count.
    tau: f64,
    blocked: bool,
    /// Normal, towards the light, of the first boundary on the way.
    exit: Option<DVec3>,
}

/// Random numbers of the first flight's look in its `piece`-th piece. Each lamp has its own (bits 33 to 45), apart from those of
/// flights and of the projector.
fn first_block(source: Source<'_>, piece: usize) -> u64 {
    match source {
        Source::Projector(_) => 1 + ((piece as u64) << 32),
        Source::Lamp(i, _) => (3 << 46) | ((i as u64) << 33) | piece as u64,
    }
}

/// Random numbers of the look ahead that stands beside the flight's block `number`.
fn line_block(source: Source<'_>, number: u64) -> u64 {
    match source {
        Source::Projector(_) => number,
        Source::Lamp(i, _) => (1 << 47) | ((i as u64) << 33) | number,
    }
}

impl<'a> Walker<'a> {
    /// All lights at a place or in a direction.
    fn sources(&self) -> impl Iterator<Item = Source<'a>> + use<'a> {
        let (light, lamps) = (self.setting.light, &self.setting.steady.lamps);
        let projector = light.shines().then_some(Source::Projector(light));
        projector.into_iter().chain(lamps.iter().enumerate().map(|(i, lamp)| Source::Lamp(i, lamp)))
    }

    /// Optical depth towards the light, `distance` away.
    fn sight(&mut self, r: DVec3, towards: DVec3, distance: f64, skin: Option<Skin>) -> Sight {
        let world = self.setting.world;
        let mut sight = Sight { tau: 0.0, blocked: false, exit: None };
        for piece in world.trace(r, towards, skin, &mut self.spans) {
            if piece.start >= distance {
                break;
            }
            if sight.exit.is_none()
                && let Some(wall) = piece.wall
            {
                let normal = world.normal(wall, r + piece.end * towards);
                sight.exit = Some(if normal.dot(towards) < 0.0 { -normal } else { normal });
            }
            let material = &world.materials[piece.material];
            if material.is_opaque() {
                sight.blocked = true;
            } else if piece.material != 0 {
                sight.tau += material.mu_t() * (piece.end.min(distance) - piece.start);
            }
        }
        sight
    }

    fn deposit(&mut self, path: usize, radiance: f64, arrival: &Arrival, source: Source<'_>) {
        let layout = self.setting.layout();
        let response = &mut self.responses[path * layout.width()..][..layout.width()];
        if let (Source::Lamp(..), Some(steady)) = (source, layout.steady()) {
            response[steady] += radiance;
            return;
        }
        response[0] += radiance;
        for (carrier, re_im) in self.setting.carriers.iter().zip(response[1..].chunks_exact_mut(2)) {
            let (sin, cos) = carrier.at(arrival.on_plane);
            re_im[0] += radiance * cos;
            re_im[1] += radiance * sin;
        }
    }

    /// Steady light from infinity that a path on its way there sees.
    pub(crate) fn see_ambient(&mut self, at: &Place) {
        let layout = self.setting.layout();
        if let (true, Some(steady)) = (self.setting.steady.ambient > 0.0, layout.steady()) {
            self.responses[at.response * layout.width() + steady] += at.weight * self.setting.steady.ambient;
        }
    }

    /// Light that a Lambertian surface throws into the path.
    pub(crate) fn look_from_surface(&mut self, at: &Place, normal: DVec3, rho: f64) {
        for source in self.sources() {
            self.surface_lit(at, normal, rho, source);
        }
    }

    fn surface_lit(&mut self, at: &Place, normal: DVec3, rho: f64, source: Source<'_>) {
        let Some(arrival) = source.arrival(at.r) else { return };
        let cos = normal.dot(arrival.towards);
        if cos <= 0.0 || rho == 0.0 {
            return;
        }
        let sight = self.sight(at.r, arrival.towards, arrival.distance, at.skin);
        if !sight.blocked {
            let radiance = rho * FRAC_1_PI * cos * arrival.irradiance * libm::exp(-sight.tau);
            self.deposit(at.response, at.weight * radiance, &arrival, source);
        }
    }

    /// Leaves a look ahead to the queue.
    #[inline]
    pub fn queue_look(&mut self, at: &Place, own: DVec3, roulette: f64, material: &Material, body: u64) {
        if !self.setting.light.shines() {
            return;
        }
        self.queue.push(at, own, roulette, material, body);
        if self.queue.is_full() {
            self.queue.flush(self.level, &self.setting, &mut self.queued);
        }
    }

    /// Light scattered into the path at a collision.
    pub(crate) fn look_from_collision(&mut self, at: &mut Place, roulette: f64) {
        for source in self.sources() {
            self.collision_lit(at, roulette, source);
        }
    }

    fn collision_lit(&mut self, at: &Place, roulette: f64, source: Source<'_>) {
        let Some(arrival) = source.arrival(at.r) else { return };
        let sight = self.sight(at.r, arrival.towards, arrival.distance, None);
        let rarity = rarity(sight.tau);
        if sight.blocked || roulette * rarity >= 1.0 {
            return;
        }
        let g = self.setting.world.materials[at.material].g;
        let p = hg::density(g, at.w.dot(arrival.towards));
        let radiance = at.weight * p * arrival.irradiance * libm::exp(-sight.tau) * rarity;
        self.deposit(at.response, radiance, &arrival, source);
    }

    /// Exact single scattering of the camera's ray: one point in each scattering piece that it crosses.
    pub(crate) fn first_flight(&mut self, at: &Place, stream: &Stream) {
        let world = self.setting.world;
        let mut pieces = std::mem::take(&mut self.pieces);
        pieces.clear();
        pieces.extend(world.trace(at.r, at.w, None, &mut self.spans));
        let (mut tau, mut entrance, mut scored) = (0.0, None, 0);
        for piece in &pieces {
            let material = &world.materials[piece.material];
            if material.is_opaque() {
                break;
            }
            let length = piece.end - piece.start;
            if material.mu_s > 0.0 {
                let start = at.r + piece.start * at.w;
                let normal = entrance.map(|wall| world.normal(wall, start));
                let normal = normal.map(|n| if n.dot(at.w) > 0.0 { -n } else { n });
                for source in self.sources() {
                    let (towards, _) = source.towards(start);
                    // Where the ray came in is where the light comes in, if it comes from that side.
                    let exit = normal.filter(|n| n.dot(towards) > 0.0);
                    let [.., u] = stream.block(first_block(source, scored));
                    let line = Line { r: start, e: at.w, length, material: piece.material, towards, exit };
                    self.score(at.response, &line, libm::exp(-tau), unit(u), source);
                }
                scored += 1;
            }
            if piece.material != 0 {
                tau += material.mu_t() * length;
            }
            entrance = piece.wall;
        }
        self.pieces = pieces;
    }

    /// The light that the next scattering will see, from one point on a line (the one-sample light lobe).
    #[inline]
    pub(crate) fn look_ahead(&mut self, at: &mut Place, own: DVec3, roulette: f64) {
        let world = self.setting.world;
        let material = world.materials[at.material];
        // The light is at least `clear` away: most collisions are settled by that, without a ray.
        if roulette * rarity(material.mu_t() * at.clear) >= 1.0 {
            return;
        }
        at.clear = world.clearance(at.r);
        if roulette * rarity(material.mu_t() * at.clear) >= 1.0 {
            return;
        }
        if let Some(body_of) = &self.body_of {
            let body = body_of[at.material];
            self.queue_look(at, own, roulette, &material, body);
            self.look_at_lamps(at, own, roulette);
            return;
        }
        for source in self.sources() {
            self.line_lit(at, own, roulette, source);
        }
    }

    /// Looks one by one for the steady lights, from a collision from which the queue looks for the projector.
    pub fn look_at_lamps(&mut self, at: &Place, own: DVec3, roulette: f64) {
        for (i, lamp) in self.setting.steady.lamps.iter().enumerate() {
            self.line_lit(at, own, roulette, Source::Lamp(i, lamp));
        }
    }

    fn line_lit(&mut self, at: &Place, own: DVec3, roulette: f64, source: Source<'_>) {
        let world = self.setting.world;
        let material = world.materials[at.material];
        let (towards, distance) = source.towards(at.r);
        let sight = self.sight(at.r, towards, distance, None);
        let rarity = rarity(sight.tau);
        if roulette * rarity >= 1.0 {
            return;
        }
        let g = material.g;
        let [choice, b, c, u] = self.stream(at).block(line_block(source, at.number - 1));
        let e = if choice >> 31 == 0 { own } else { hg::sample(g, towards, unit(b), unit(c)) };
        // 2 p_A / (p_A + p_B): p_A would have sent the path along e, p_B is the lobe around the light.
        let (own_q, lobe_q) = (hg::denominator(g, at.w.dot(e)), hg::denominator(g, e.dot(towards)));
        let ratio = own_q / lobe_q;
        let balance = 2.0 / (1.0 + ratio * ratio.sqrt());
        let length = world
            .trace(at.r, e, None, &mut self.spans)
            .next()
            .map_or(f64::INFINITY, |piece| if piece.material == at.material { piece.end } else { 0.0 });
        if length > 0.0 {
            let line = Line { r: at.r, e, length, material: at.material, towards, exit: sight.exit };
            self.score(at.response, &line, at.weight * balance * rarity, unit(u), source);
        }
    }

    /// weight times the integral over s in (0, length) of exp(-mu_t s) mu_s p(e . L) (light at r + s e), from one s.
    #[inline]
    fn score(&mut self, path: usize, line: &Line, weight: f64, u: f64, source: Source<'_>) {
        let &Line { r, e, length, towards, .. } = line;
        let material = self.setting.world.materials[line.material];
        let mu_t = material.mu_t();
        let steepness = line.exit.map_or(0.0, |n| e.dot(n) / towards.dot(n));
        let (s, inverse_density) = look::ahead(steepness, length, mu_t, u);
        let at = r + s * e;
        let Some(arrival) = source.arrival(at) else { return };
        let sight = self.sight(at, arrival.towards, arrival.distance, None);
        if sight.blocked {
            return;
        }
        let p = hg::density(material.g, e.dot(arrival.towards));
        let attenuation = libm::exp(-(mu_t * s + sight.tau));
        let radiance = weight * material.mu_s * p * arrival.irradiance * attenuation * inverse_density;
        self.deposit(path, radiance, &arrival, source);
    }
}

/// One over the probability of looking for light at optical distance `tau`; that falls slower than the light does.
#[inline(always)]
pub fn rarity(tau: f64) -> f64 {
    let x = (tau * (1.0 / TAU_SURE)).max(1.0);
    x * x * x * x
}
