//! Next-event estimation: what a path sees of the light at its turns, one scattering ahead where that is possible.

use std::f64::consts::FRAC_1_PI;

use glam::DVec3;
use turbid_optics::philox::unit;
use turbid_optics::rough::Rough;

use crate::ahead::{self, OTHER_CONNECTIONS, ahead, depth, expected, inverse_chance, others};
use crate::caustic::Best;
use crate::connect::{Draws, Heading};
use crate::lamp::Source;
use crate::lengths::{Lengths, count, sum};
use crate::random::{NeeSite, Stream};
use crate::setting::Place;
use crate::single::{FoundInLanes, ScalarConnection};
use crate::strata::Bending;
use crate::walker::{Entry, Walker};
use crate::world::{Material, SurfacePoint};

/// The probability with which facets are searched where lanes have found none that refracts light to a place.
const SEARCHED: f64 = 0.25;

/// The line on which the next scattering is sampled.
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

    /// Adds what a path of these lengths, the connection's among them, sees of a source, to every channel.
    fn deposit(&mut self, path: usize, radiance: f64, on_plane: DVec3, source: Source<'_>, lengths: &Lengths) {
        let Some(shared) = self.setting.shared else {
            return self.add(path, radiance, on_plane, source);
        };
        for (channel, scale) in shared.channels.iter().enumerate() {
            let radiance = radiance * scale.of(source) * scale.weight(lengths);
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
        let projected_images = self.setting.projected_images;
        if projected_images.layers() > 0 {
            let (x, y) = self.setting.light.view.position_of(on_plane);
            let around = projected_images.around(x, y);
            for (i, seen) in response[layout.projected_image(0)..][..layout.projected_images].iter_mut().enumerate() {
                *seen += radiance * projected_images.value(i, &around);
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
        if at.specular && self.excludes_specular {
            return;
        }
        let (layout, radiance) = (self.setting.layout(), at.weight * self.setting.steady.ambient);
        if let (true, Some(steady)) = (radiance > 0.0, layout.steady()) {
            let start = at.response * self.stride();
            let response = &mut self.responses[start..];
            match self.setting.shared {
                None => response[steady] += radiance,
                Some(shared) => {
                    for (channel, scale) in shared.channels.iter().enumerate() {
                        response[channel * layout.width() + steady] +=
                            radiance * scale.ambient * scale.weight(&at.lengths);
                    }
                }
            }
        }
    }

    /// Light that a Lambertian surface throws into the path.
    pub(crate) fn next_event_at_surface(&mut self, at: &Place, normal: DVec3, rho: f64) {
        for source in self.sources() {
            self.surface_lit(at, normal, rho, source);
        }
    }

    fn surface_lit(&mut self, at: &Place, normal: DVec3, rho: f64, source: Source<'_>) {
        if rho == 0.0 {
            return;
        }
        let stream = self.stream(at);
        let mut connections = std::mem::take(&mut self.connections);
        self.reach(source, at.r, at.surface_point, &mut connections);
        let draws = Draws { stream: &stream, flight: at.flight(), site: NeeSite::Here, others: OTHER_CONNECTIONS };
        self.reach_on(source, at.r, at.surface_point, &draws, &mut connections);
        for connection in connections.drain(..) {
            let cos = normal.dot(connection.towards);
            if cos > 0.0 {
                let radiance = rho * FRAC_1_PI * cos * connection.irradiance * libm::exp(-connection.tau);
                self.deposit(
                    at.response,
                    at.weight * radiance,
                    connection.on_plane,
                    source,
                    &sum(&at.lengths, &connection.lengths),
                );
            }
        }
        self.connections = connections;
    }

    /// Whether a medium lies behind rough interfaces, through which its light comes: all lights are outside.
    fn hidden(&self, material: &Material) -> bool {
        self.bending == Bending::AtRough && material.n != 1.0
    }

    /// Light that a rough interface throws into the path by the facets of its last walk; `surface_point` is on the side from which the path comes.
    pub(crate) fn next_event_at_rough(&mut self, at: &Place, rough: &Rough, surface_point: SurfacePoint) {
        let stream = self.stream(at);
        for source in self.sources() {
            let behind = source.towards(at.r).0.dot(rough.normal) < 0.0;
            let connection = self.connect(
                source,
                at.r,
                Some(SurfacePoint { inside: surface_point.inside != behind, ..surface_point }),
                true,
            );
            let mut mirrored = std::mem::take(&mut self.mirrored);
            let draws = Draws { stream: &stream, flight: at.flight(), site: NeeSite::Here, others: OTHER_CONNECTIONS };
            for behind in [false, true] {
                let first = mirrored.len();
                let surface_point = SurfacePoint { inside: surface_point.inside != behind, ..surface_point };
                self.by_mirrors(source, at.r, Some(surface_point), &draws, &mut mirrored);
                let others = mirrored.split_off(first);
                mirrored.extend(others.into_iter().filter(|l| (l.towards.dot(rough.normal) < 0.0) == behind));
            }
            for connection in connection.into_iter().chain(mirrored.drain(..)) {
                let n = if connection.towards.dot(rough.normal) < 0.0 { rough.n_to } else { rough.n_from };
                let response = rough.response(&self.facet_flights, connection.towards);
                let radiance = response * connection.irradiance / (n * n) * libm::exp(-connection.tau);
                let lengths = sum(&at.lengths, &connection.lengths);
                self.deposit(at.response, at.weight * radiance, connection.on_plane, source, &lengths);
            }
            self.mirrored = mirrored;
        }
    }

    /// Light scattered into the path at a collision.
    pub(crate) fn next_event_at_collision(&mut self, at: &mut Place, roulette: f64) {
        if self.hidden(&self.setting.world.materials[at.material]) {
            return;
        }
        for source in self.sources() {
            self.collision_lit(at, roulette, source);
        }
    }

    /// Light that the next scattering will see, in every segment of a medium that the flight, now over, came into from elsewhere.
    pub(crate) fn next_event_in_entries(&mut self, at: &Place, roulette: f64) {
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
        let normal = entry.interface.map(|interface| self.setting.world.normal(interface, entry.r));
        let normal = normal.map(|n| if n.dot(at.w) > 0.0 { -n } else { n });
        let heading = if self.bending == Bending::AtInterfaces {
            let inside = self.within(entry.r, at.w, entry.length, entry.material);
            self.heading_from_interface(source, (entry.r, normal), inside, entry.material)
        } else {
            let mut heading = self.heading(source, entry.r, entry.material, 0.0);
            // Where the flight came in is where the light comes in, if it comes from that side.
            heading.exit = normal.filter(|n| n.dot(heading.towards) > 0.0).or(heading.exit);
            heading
        };
        let Heading { towards, tau, exit } = heading;
        let weight = at.weight * at.mis_weight;
        let inverse_survival = self.inverse_survival(depth(tau, exit.map_or(1.0, |n| n.dot(towards)), 0.0));
        let inverse_chance = self.inverse_chance(weight, at.w, &heading, entry.material);
        let inverse_survival = inverse_survival.max(inverse_chance);
        if roulette * inverse_survival >= 1.0 {
            return;
        }
        let others = others(inverse_chance);
        let draws = Draws { stream, flight: at.flight(), site: NeeSite::Entered(place), others };
        let [.., u] = draws.point(source);
        let line = Line { r: entry.r, e: at.w, length: entry.length, material: entry.material, towards, exit };
        self.score(at.response, &line, weight * inverse_survival, unit(u), source, &draws, &entry.lengths);
    }

    fn collision_lit(&mut self, at: &Place, roulette: f64, source: Source<'_>) {
        let stream = self.stream(at);
        let mut connections = std::mem::take(&mut self.connections);
        self.reach(source, at.r, None, &mut connections);
        let inverse_survival = self.inverse_survival(connections.first().map_or(0.0, |connection| connection.tau));
        if roulette * inverse_survival >= 1.0 {
            connections.clear();
        } else {
            let draws = Draws { stream: &stream, flight: at.flight(), site: NeeSite::Here, others: OTHER_CONNECTIONS };
            self.reach_on(source, at.r, None, &draws, &mut connections);
        }
        let phase = self.setting.world.materials[at.material].phase;
        for connection in connections.drain(..) {
            let p = phase.density(at.w.dot(connection.towards));
            let radiance = at.weight * p * connection.irradiance * libm::exp(-connection.tau) * inverse_survival;
            self.deposit(at.response, radiance, connection.on_plane, source, &sum(&at.lengths, &connection.lengths));
        }
        self.connections = connections;
    }

    /// Exact single scattering of a ray that starts outside or at an interface: one point in each scattering segment that it crosses, up to
    /// where it is bent or ends; or in its first segment alone, where the others are sampled when the path gets there.
    pub(crate) fn next_event_along(&mut self, at: &Place, stream: &Stream) {
        let world = self.setting.world;
        let mut segments = std::mem::take(&mut self.segments);
        segments.clear();
        segments.extend(world.trace(at.r, at.w, at.surface_point, &mut self.chords));
        let (mut tau, mut entrance, mut scored) =
            (0.0, at.surface_point.map(|surface_point| surface_point.interface), 0);
        let mut lengths = at.lengths;
        let n = segments.first().map_or(1.0, |segment| world.materials[segment.material].n);
        for segment in &segments {
            let material = &world.materials[segment.material];
            if material.is_opaque() || material.n != n {
                break;
            }
            let length = segment.end - segment.start;
            if material.mu_s > 0.0 && !self.hidden(material) {
                let start = at.r + segment.start * at.w;
                let normal = entrance.map(|interface| world.normal(interface, start));
                let normal = normal.map(|n| if n.dot(at.w) > 0.0 { -n } else { n });
                let inside = self.within(start, at.w, length, segment.material);
                for source in self.sources() {
                    let heading = self.heading_from_interface(source, (start, normal), inside, segment.material);
                    let Heading { towards, exit, .. } = heading;
                    let mut draws =
                        Draws { stream, flight: at.flight(), site: NeeSite::Next(scored), others: OTHER_CONNECTIONS };
                    let [roulette, .., u] = draws.point(source);
                    let weight = at.weight * libm::exp(-tau);
                    let inverse_chance = self.inverse_chance(weight, at.w, &heading, segment.material);
                    if unit(roulette) * inverse_chance < 1.0 {
                        draws.others = others(inverse_chance);
                        let line = Line { r: start, e: at.w, length, material: segment.material, towards, exit };
                        self.score(at.response, &line, weight * inverse_chance, unit(u), source, &draws, &lengths);
                    }
                }
                scored += 1;
            }
            if segment.material != 0 {
                tau += material.mu_t() * length;
                count(self.setting.shared, &mut lengths, segment.material, length);
            }
            entrance = segment.interface;
            if !at.wholly {
                break;
            }
        }
        self.segments = segments;
    }

    /// The light that the next scattering will see, from one point on a line (the one-sample light lobe).
    #[inline]
    pub(crate) fn next_event_ahead(&mut self, at: &mut Place, own: DVec3, roulette: f64) {
        let world = self.setting.world;
        let material = world.materials[at.material];
        if self.hidden(&material) {
            return;
        }
        // The light is at least `clear` away: most collisions are settled by that, without a ray.
        if roulette * self.inverse_survival(material.mu_t() * at.clear) >= 1.0 {
            return;
        }
        // Among facets that turn light what is aimed at costs less than a distance.
        if !(self.facetted && self.bending == Bending::AtInterfaces) {
            // Lanes may know better: surfaces that do not show are none to them.
            at.clear = at.clear.max(world.clearance(at.r));
            if roulette * self.inverse_survival(material.mu_t() * at.clear) >= 1.0 {
                return;
            }
        }
        for source in self.sources() {
            self.line_lit(at, own, roulette, source);
        }
    }

    /// Connects a collision to the steady lights one by one, where lanes connect it to the projector; `at.clear` is what
    /// decided that.
    pub fn next_event_to_lamps(&mut self, at: &Place, own: DVec3, roulette: f64) {
        for (i, lamp) in self.setting.steady.lamps.iter().enumerate() {
            self.line_lit(at, own, roulette, Source::Lamp(i, lamp));
        }
    }

    /// The connections from r to the projector that lanes, which have estimated ahead, do not know; apart from what the path itself sees. `unit`: W mm^-2.
    pub(crate) fn scalar_connection(&mut self, scalar: &ScalarConnection, r: DVec3, e: DVec3, unit: f64) {
        let s = self.setting;
        let (source, stream) = (Source::Projector(s.light), Stream::new(s.key, scalar.pixel, scalar.sample, s.channel));
        let (flight, site) = NeeSite::of(scalar.number, scalar.place as usize);
        let draws = Draws { stream: &stream, flight, site, others: scalar.others.into() };
        let mut connections = std::mem::take(&mut self.connections);
        if self.bending == Bending::AtInterfaces {
            match scalar.found {
                FoundInLanes::Known(known) => {
                    let [towards, normal] = [known.towards, known.normal].map(|v| DVec3::from(v.map(f64::from)));
                    let strength = unit * f64::from(known.strength);
                    let best = Best { strength, exit: Some(normal), turns: 1, about: Some(towards) };
                    if self.facetted {
                        let about = known.by_facet.then_some(towards);
                        self.reach_beside(source, r, (about, strength), &draws, &mut connections);
                    }
                    connections.extend(self.sample_manifold_once(source, (r, None), &draws, Some(best)));
                }
                // Hardly any light comes there, and to know that takes long.
                FoundInLanes::Nothing if self.facetted => {
                    let [.., searches] = draws.whether(source);
                    if searches < SEARCHED {
                        self.reach(source, r, None, &mut connections);
                        connections.extend(self.sample_manifold(source, r, None, &draws));
                        connections.iter_mut().for_each(|connection| connection.irradiance /= SEARCHED);
                    }
                }
                FoundInLanes::Nothing => {
                    self.find_known_by_several(source, r);
                    let lit = self.known.iter().map(|known| known.connection).filter(|connection| connection.lit);
                    connections.extend(lit);
                    connections.extend(self.sample_manifold(source, r, None, &draws));
                }
                FoundInLanes::Unsure => {
                    self.reach(source, r, None, &mut connections);
                    connections.extend(self.sample_manifold(source, r, None, &draws));
                }
            }
        } else {
            connections.extend(self.reflected_connection(source, r, None, &draws));
        }
        std::mem::swap(&mut self.responses, &mut self.connected);
        for connection in connections.drain(..) {
            let p = scalar.phase.density(e.dot(connection.towards));
            let radiance = f64::from(scalar.fraction) * p * connection.irradiance * libm::exp(-connection.tau);
            let lengths = sum(&scalar.lengths.map(f64::from), &connection.lengths);
            self.deposit(scalar.path as usize, radiance, connection.on_plane, source, &lengths);
        }
        std::mem::swap(&mut self.responses, &mut self.connected);
        self.connections = connections;
    }

    fn line_lit(&mut self, at: &Place, own: DVec3, roulette: f64, source: Source<'_>) {
        let world = self.setting.world;
        let material = world.materials[at.material];
        let least = material.mu_t() * at.clear;
        let heading = self.heading(source, at.r, at.material, least);
        let Heading { towards, tau, exit } = heading;
        let inverse_survival = self.inverse_survival(depth(tau, exit.map_or(1.0, |n| n.dot(towards)), least));
        if roulette * inverse_survival >= 1.0 {
            return;
        }
        let phase = material.phase;
        let stream = self.stream(at);
        let mut draws =
            Draws { stream: &stream, flight: at.flight(), site: NeeSite::Next(0), others: OTHER_CONNECTIONS };
        let [choice, b, c, u] = draws.point(source);
        let e = if choice >> 31 == 0 { own } else { phase.sample(towards, unit(b), unit(c)) };
        // 2 p_A / (p_A + p_B): p_A would have sent the path along e, p_B is the lobe around the light.
        let weight = at.weight * at.mis_weight * (2.0 * phase.balance(at.w.dot(e), e.dot(towards)));
        let inverse_chance = self.inverse_chance(weight, e, &heading, at.material);
        draws.others = others(inverse_chance);
        let inverse_survival = inverse_survival.max(inverse_chance);
        if roulette * inverse_survival >= 1.0 {
            return;
        }
        let length = world
            .trace(at.r, e, None, &mut self.chords)
            .next()
            .map_or(f64::INFINITY, |segment| if segment.material == at.material { segment.end } else { 0.0 });
        if length > 0.0 {
            let line = Line { r: at.r, e, length, material: at.material, towards, exit };
            self.score(at.response, &line, weight * inverse_survival, unit(u), source, &draws, &at.lengths);
        }
    }

    /// A point on a ray that comes into a material and stays in it for `length`, mm.
    fn within(&self, start: DVec3, w: DVec3, length: f64, material: usize) -> DVec3 {
        start + 0.5 * length.min(1.0 / self.setting.world.materials[material].mu_t()) * w
    }

    /// One over the probability of connecting a vertex at optical distance `tau`.
    #[inline]
    fn inverse_survival(&self, tau: f64) -> f64 {
        ahead::inverse_survival(tau, self.tau_sure)
    }

    /// One over the probability with which light is looked for from a line along e, `weight` what comes along that: through curved interfaces it costs far more
    /// than flights.
    #[inline]
    fn inverse_chance(&self, weight: f64, e: DVec3, heading: &Heading, material: usize) -> f64 {
        if self.bending != Bending::AtInterfaces {
            return 1.0;
        }
        let medium = &self.setting.world.materials[material];
        let steepness = heading.exit.map_or(0.0, |n| e.dot(n) / heading.towards.dot(n));
        let scattered = weight * medium.phase.density(e.dot(heading.towards)) * medium.mu_s / medium.mu_t();
        inverse_chance(scattered * expected(steepness, heading.tau), self.worth[material])
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
        draws: &Draws<'_>,
        lengths: &Lengths,
    ) {
        let &Line { r, e, length, towards, .. } = line;
        let material = self.setting.world.materials[line.material];
        let mu_t = material.mu_t();
        let steepness = line.exit.map_or(0.0, |n| e.dot(n) / towards.dot(n));
        let (s, inverse_density) = ahead(steepness, length, mu_t, u);
        let weight = weight * (material.mu_s * libm::exp(-mu_t * s) * inverse_density);
        let at = r + s * e;
        let mut lengths = *lengths;
        count(self.setting.shared, &mut lengths, line.material, s);
        let mut connections = std::mem::take(&mut self.connections);
        self.reach(source, at, None, &mut connections);
        self.reach_on(source, at, None, draws, &mut connections);
        for connection in connections.drain(..) {
            let p = material.phase.density(e.dot(connection.towards));
            let radiance = weight * p * connection.irradiance * libm::exp(-connection.tau);
            self.deposit(path, radiance, connection.on_plane, source, &sum(&lengths, &connection.lengths));
        }
        self.connections = connections;
    }
}
