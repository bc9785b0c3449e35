//! Next-event estimation: what a path sees of the light at its turns, one scattering ahead where that is possible.

use std::f64::consts::FRAC_1_PI;

use glam::DVec3;
use turbid_optics::henyey_greenstein as hg;
use turbid_optics::philox::unit;
use turbid_optics::rough::Rough;

use crate::caustic::Best;
use crate::lamp::Source;
use crate::lengths::{Lengths, count, sum};
use crate::link::{Chance, Heading};
use crate::look::{self, depth, rarity};
use crate::random::{Look, SCOUT, Stream};
use crate::setting::Place;
use crate::single::Detour;
use crate::strata::Bending;
use crate::walker::{Entry, Walker};
use crate::world::{Material, Skin};

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

impl<'a> Walker<'a> {
    /// All lights at a place or in a direction.
    pub(crate) fn sources(&self) -> impl Iterator<Item = Source<'a>> + use<'a> {
        let (light, lamps) = (self.setting.light, &self.setting.steady.lamps);
        let projector = light.shines().then_some(Source::Projector(light));
        projector.into_iter().chain(lamps.iter().enumerate().map(|(i, lamp)| Source::Lamp(i, lamp)))
    }

    /// Adds what a path of these lengths, the link's among them, sees of a source, to every channel.
    fn deposit(&mut self, path: usize, radiance: f64, on_plane: DVec3, source: Source<'_>, lengths: &Lengths) {
        let Some(shared) = self.setting.shared else {
            return self.add(path, radiance, on_plane, source);
        };
        for (channel, share) in shared.channels.iter().enumerate() {
            let radiance = radiance * share.of(source) * share.weight(lengths);
            self.add(path * shared.channels.len() + channel, radiance, on_plane, source);
        }
    }

    /// The same for one response.
    pub(crate) fn add(&mut self, response: usize, radiance: f64, on_plane: DVec3, source: Source<'_>) {
        let layout = self.setting.layout();
        let response = &mut self.responses[response * layout.width()..][..layout.width()];
        if let (Source::Lamp(..), Some(steady)) = (source, layout.steady()) {
            response[steady] += radiance;
            return;
        }
        response[0] += radiance;
        let pictures = self.setting.pictures;
        if pictures.layers() > 0 {
            let (x, y) = self.setting.light.view.position_of(on_plane);
            let around = pictures.around(x, y);
            for (i, seen) in response[layout.picture(0)..][..layout.pictures].iter_mut().enumerate() {
                *seen += radiance * pictures.value(i, &around);
            }
        }
        for (carrier, re_im) in self.setting.carriers.iter().zip(response[1..].chunks_exact_mut(2)) {
            let (sin, cos) = carrier.at(on_plane);
            re_im[0] += radiance * cos;
            re_im[1] += radiance * sin;
        }
    }

    /// Steady light from infinity that a path on its way there sees.
    pub(crate) fn see_ambient(&mut self, at: &Place) {
        if at.glint && self.excludes_specular {
            return;
        }
        let (layout, radiance) = (self.setting.layout(), at.weight * self.setting.steady.ambient);
        if let (true, Some(steady)) = (radiance > 0.0, layout.steady()) {
            let start = at.response * self.stride();
            let response = &mut self.responses[start..];
            match self.setting.shared {
                None => response[steady] += radiance,
                Some(shared) => {
                    for (channel, share) in shared.channels.iter().enumerate() {
                        response[channel * layout.width() + steady] +=
                            radiance * share.ambient * share.weight(&at.lengths);
                    }
                }
            }
        }
    }

    /// Light that a Lambertian surface throws into the path.
    pub(crate) fn look_from_surface(&mut self, at: &Place, normal: DVec3, rho: f64) {
        for source in self.sources() {
            self.surface_lit(at, normal, rho, source);
        }
    }

    fn surface_lit(&mut self, at: &Place, normal: DVec3, rho: f64, source: Source<'_>) {
        if rho == 0.0 {
            return;
        }
        let stream = self.stream(at);
        let mut links = std::mem::take(&mut self.links);
        self.reach(source, at.r, at.skin, &mut links);
        let chance = Chance { stream: &stream, flight: at.flight(), look: Look::Here };
        self.reach_on(source, at.r, at.skin, &chance, &mut links);
        for link in links.drain(..) {
            let cos = normal.dot(link.towards);
            if cos > 0.0 {
                let radiance = rho * FRAC_1_PI * cos * link.irradiance * libm::exp(-link.tau);
                self.deposit(
                    at.response,
                    at.weight * radiance,
                    link.on_plane,
                    source,
                    &sum(&at.lengths, &link.lengths),
                );
            }
        }
        self.links = links;
    }

    /// Whether a medium lies behind rough walls, through which its light comes: all lights are outside.
    fn hidden(&self, material: &Material) -> bool {
        self.bending == Bending::AtRough && material.n != 1.0
    }

    /// Light that a rough wall throws into the path; `skin` is on the side from which the path comes.
    pub(crate) fn look_from_rough(&mut self, at: &Place, rough: &Rough, skin: Skin) {
        let stream = self.stream(at);
        for source in self.sources() {
            let behind = source.towards(at.r).0.dot(rough.normal) < 0.0;
            let link = self.link(source, at.r, Some(Skin { inside: skin.inside != behind, ..skin }), true);
            let mut mirrored = std::mem::take(&mut self.mirrored);
            let chance = Chance { stream: &stream, flight: at.flight(), look: Look::Here };
            for behind in [false, true] {
                let first = mirrored.len();
                let skin = Skin { inside: skin.inside != behind, ..skin };
                self.by_mirrors(source, at.r, Some(skin), &chance, &mut mirrored);
                let others = mirrored.split_off(first);
                mirrored.extend(others.into_iter().filter(|l| (l.towards.dot(rough.normal) < 0.0) == behind));
            }
            for link in link.into_iter().chain(mirrored.drain(..)) {
                let n = if link.towards.dot(rough.normal) < 0.0 { rough.n_to } else { rough.n_from };
                let response = rough.response(at.w, link.towards);
                let radiance = response * link.irradiance / (n * n) * libm::exp(-link.tau);
                let lengths = sum(&at.lengths, &link.lengths);
                self.deposit(at.response, at.weight * radiance, link.on_plane, source, &lengths);
            }
            self.mirrored = mirrored;
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
        if self.hidden(&self.setting.world.materials[at.material]) {
            return;
        }
        for source in self.sources() {
            self.collision_lit(at, roulette, source);
        }
    }

    /// Light that the next scattering will see, in every piece of a medium that the flight, now over, came into from elsewhere.
    pub(crate) fn look_into_entries(&mut self, at: &Place, roulette: f64) {
        let (mut entries, stream) = (std::mem::take(&mut self.entries), self.stream(at));
        for (place, entry) in entries.drain(..).enumerate() {
            if !self.hidden(&self.setting.world.materials[entry.material]) {
                for source in self.sources() {
                    self.entry_lit(at, roulette, (place, &entry), source, &stream);
                }
            }
        }
        self.entries = entries;
    }

    fn entry_lit(
        &mut self,
        at: &Place,
        roulette: f64,
        (place, entry): (usize, &Entry),
        source: Source<'_>,
        stream: &Stream,
    ) {
        let normal = entry.wall.map(|wall| self.setting.world.normal(wall, entry.r));
        let normal = normal.map(|n| if n.dot(at.w) > 0.0 { -n } else { n });
        let Heading { towards, tau, exit } = self.heading(source, entry.r, 0.0);
        // Where the flight came in is where the light comes in, if it comes from that side.
        let exit = normal.filter(|n| n.dot(towards) > 0.0).or(exit);
        let rarity = rarity(depth(tau, exit.map_or(1.0, |n| n.dot(towards)), 0.0));
        if roulette * rarity >= 1.0 {
            return;
        }
        let chance = Chance { stream, flight: at.flight(), look: Look::Entered(place) };
        let [.., u] = chance.point(source);
        let line = Line { r: entry.r, e: at.w, length: entry.length, material: entry.material, towards, exit };
        self.score(at.response, &line, at.weight * at.share * rarity, unit(u), source, &chance, &entry.lengths);
    }

    fn collision_lit(&mut self, at: &Place, roulette: f64, source: Source<'_>) {
        let stream = self.stream(at);
        let mut links = std::mem::take(&mut self.links);
        self.reach(source, at.r, None, &mut links);
        let rarity = rarity(links.first().map_or(0.0, |link| link.tau));
        if roulette * rarity >= 1.0 {
            links.clear();
        } else {
            let chance = Chance { stream: &stream, flight: at.flight(), look: Look::Here };
            self.reach_on(source, at.r, None, &chance, &mut links);
        }
        let g = self.setting.world.materials[at.material].g;
        for link in links.drain(..) {
            let p = hg::density(g, at.w.dot(link.towards));
            let radiance = at.weight * p * link.irradiance * libm::exp(-link.tau) * rarity;
            self.deposit(at.response, radiance, link.on_plane, source, &sum(&at.lengths, &link.lengths));
        }
        self.links = links;
    }

    /// Exact single scattering of a ray that starts outside or at a wall: one point in each scattering piece that it crosses, up to
    /// where it is bent or ends; or in its first piece alone, where the others are looked into when the path gets there.
    pub(crate) fn look_along(&mut self, at: &Place, stream: &Stream) {
        let world = self.setting.world;
        let mut pieces = std::mem::take(&mut self.pieces);
        pieces.clear();
        pieces.extend(world.trace(at.r, at.w, at.skin, &mut self.spans));
        let (mut tau, mut entrance, mut scored) = (0.0, at.skin.map(|skin| skin.wall), 0);
        let mut lengths = at.lengths;
        let n = pieces.first().map_or(1.0, |piece| world.materials[piece.material].n);
        for piece in &pieces {
            let material = &world.materials[piece.material];
            if material.is_opaque() || material.n != n {
                break;
            }
            let length = piece.end - piece.start;
            if material.mu_s > 0.0 && !self.hidden(material) {
                let start = at.r + piece.start * at.w;
                let normal = entrance.map(|wall| world.normal(wall, start));
                let normal = normal.map(|n| if n.dot(at.w) > 0.0 { -n } else { n });
                let inside = start + 0.5 * length.min(1.0 / material.mu_t()) * at.w;
                for source in self.sources() {
                    let towards = self.heading_from_wall(source, start, inside);
                    // Where the ray came in is where the light comes in, if it comes from that side.
                    let exit = normal.filter(|n| n.dot(towards) > 0.0);
                    let chance = Chance { stream, flight: at.flight(), look: Look::Next(scored) };
                    let [.., u] = chance.point(source);
                    let line = Line { r: start, e: at.w, length, material: piece.material, towards, exit };
                    let weight = at.weight * libm::exp(-tau);
                    self.score(at.response, &line, weight, unit(u), source, &chance, &lengths);
                }
                scored += 1;
            }
            if piece.material != 0 {
                tau += material.mu_t() * length;
                count(self.setting.shared, &mut lengths, piece.material, length);
            }
            entrance = piece.wall;
            if !at.wholly {
                break;
            }
        }
        self.pieces = pieces;
    }

    /// The light that the next scattering will see, from one point on a line (the one-sample light lobe).
    #[inline]
    pub(crate) fn look_ahead(&mut self, at: &mut Place, own: DVec3, roulette: f64) {
        let world = self.setting.world;
        let material = world.materials[at.material];
        if self.hidden(&material) {
            return;
        }
        // The light is at least `clear` away: most collisions are settled by that, without a ray.
        if roulette * rarity(material.mu_t() * at.clear) >= 1.0 {
            return;
        }
        // Lanes may know better: surfaces that do not show are none to them.
        at.clear = at.clear.max(world.clearance(at.r));
        if roulette * rarity(material.mu_t() * at.clear) >= 1.0 {
            return;
        }
        if let Some(body_of) = self.body_of.as_ref().filter(|_| at.scout || at.number < u64::from(SCOUT)) {
            let body = body_of[at.material];
            self.queue_look(at, own, roulette, &material, body);
            self.look_at_lamps(at, own, roulette);
            return;
        }
        for source in self.sources() {
            self.line_lit(at, own, roulette, source);
        }
    }

    /// Looks one by one for the steady lights, from a collision from which the queue looks for the projector; `at.clear` is what
    /// decided that.
    pub fn look_at_lamps(&mut self, at: &Place, own: DVec3, roulette: f64) {
        for (i, lamp) in self.setting.steady.lamps.iter().enumerate() {
            self.line_lit(at, own, roulette, Source::Lamp(i, lamp));
        }
    }

    /// The ways from the projector to r that lanes, which have looked ahead, do not know; apart from what is not queued. `unit`: W mm^-2.
    pub(crate) fn try_detour(&mut self, detour: &Detour, r: DVec3, e: DVec3, unit: f64) {
        let s = self.setting;
        let (source, stream) = (Source::Projector(s.light), Stream::new(s.key, detour.pixel, detour.sample, s.channel));
        let (flight, look) = Look::of(detour.number, detour.place as usize);
        let chance = Chance { stream: &stream, flight, look };
        let mut links = std::mem::take(&mut self.links);
        if self.bending == Bending::AtWalls {
            if let Some(known) = detour.known {
                let [towards, normal] = [known.towards, known.normal].map(|v| DVec3::from(v.map(f64::from)));
                let strength = unit * f64::from(known.strength);
                let best = Best { strength, exit: Some(normal), turns: 1, about: Some(towards) };
                links.extend(self.one_by_chance(source, (r, None), &chance, Some(best)));
            } else {
                self.reach(source, r, None, &mut links);
                links.extend(self.by_chance(source, r, None, &chance));
            }
        } else {
            links.extend(self.detour(source, r, None, &chance));
        }
        std::mem::swap(&mut self.responses, &mut self.queued);
        for link in links.drain(..) {
            let p = hg::density(f64::from(detour.g), e.dot(link.towards));
            let radiance = f64::from(detour.fraction) * p * link.irradiance * libm::exp(-link.tau);
            let lengths = sum(&detour.lengths.map(f64::from), &link.lengths);
            self.deposit(detour.path as usize, radiance, link.on_plane, source, &lengths);
        }
        std::mem::swap(&mut self.responses, &mut self.queued);
        self.links = links;
    }

    fn line_lit(&mut self, at: &Place, own: DVec3, roulette: f64, source: Source<'_>) {
        let world = self.setting.world;
        let material = world.materials[at.material];
        let least = material.mu_t() * at.clear;
        let Heading { towards, tau, exit } = self.heading(source, at.r, least);
        let rarity = rarity(depth(tau, exit.map_or(1.0, |n| n.dot(towards)), least));
        if roulette * rarity >= 1.0 {
            return;
        }
        let g = material.g;
        let stream = self.stream(at);
        let chance = Chance { stream: &stream, flight: at.flight(), look: Look::Next(0) };
        let [choice, b, c, u] = chance.point(source);
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
            let line = Line { r: at.r, e, length, material: at.material, towards, exit };
            let weight = at.weight * at.share * balance * rarity;
            self.score(at.response, &line, weight, unit(u), source, &chance, &at.lengths);
        }
    }

    /// weight times the integral over s in (0, length) of exp(-mu_t s) mu_s p(e . L) (light at r + s e), from one s; `lengths`
    /// up to r.
    #[inline]
    #[allow(clippy::too_many_arguments, reason = "one formula")]
    fn score(
        &mut self,
        path: usize,
        line: &Line,
        weight: f64,
        u: f64,
        source: Source<'_>,
        chance: &Chance<'_>,
        lengths: &Lengths,
    ) {
        let &Line { r, e, length, towards, .. } = line;
        let material = self.setting.world.materials[line.material];
        let mu_t = material.mu_t();
        let steepness = line.exit.map_or(0.0, |n| e.dot(n) / towards.dot(n));
        let (s, inverse_density) = look::ahead(steepness, length, mu_t, u);
        let at = r + s * e;
        let mut lengths = *lengths;
        count(self.setting.shared, &mut lengths, line.material, s);
        let mut links = std::mem::take(&mut self.links);
        self.reach(source, at, None, &mut links);
        self.reach_on(source, at, None, chance, &mut links);
        for link in links.drain(..) {
            let p = hg::density(material.g, e.dot(link.towards));
            let attenuation = libm::exp(-(mu_t * s + link.tau));
            let radiance = weight * material.mu_s * p * link.irradiance * attenuation * inverse_density;
            self.deposit(path, radiance, link.on_plane, source, &sum(&lengths, &link.lengths));
        }
        self.links = links;
    }
}
