//! Light connections: the straight or specular chains by which light reaches a point without being scattered.
//!
//! `docs/theory/render.md` derives the irradiance of a connection through refracting boundaries.

use glam::DVec3;
use turbid_optics::philox::unit;
use turbid_optics::refraction::{Crossing, Leg, refract};

use crate::connection::{Connection, SpecularChain, Stretch};
use crate::lamp::Source;
use crate::lengths::{Lengths, NO_LENGTHS, count, sum};
use crate::random::{Dice, NeeSite, Purpose, Stream};
use crate::setting::Setting;
use crate::strata::{Bending, Layer, Strata};
use crate::walker::Walker;
use crate::world::SurfacePoint;

/// Where light comes from, be it lit or not, and how far off it is.
pub(crate) struct Heading {
    pub towards: DVec3,
    /// Optical depth; opaque bodies do not count.
    pub tau: f64,
    /// As of a [`Connection`].
    pub exit: Option<DVec3>,
}

/// What a shadow ray meets.
pub(crate) struct Visibility {
    /// Optical depth; opaque bodies do not count.
    pub tau: f64,
    pub blocked: bool,
    /// Normal, along the ray, of the first boundary on it.
    pub exit: Option<DVec3>,
    /// mm in each medium that tells channels apart.
    pub lengths: Lengths,
}

/// Which random numbers a next-event estimate has.
pub(crate) struct Draws<'a> {
    pub stream: &'a Stream,
    /// Number of the flight beside which it is.
    pub flight: u64,
    pub site: NeeSite,
    /// With which probability connections other than the likeliest are tried, if that is known.
    pub others: f64,
}

impl Draws<'_> {
    /// For the point that is connected, and the direction to that.
    #[inline]
    pub fn point(&self, source: Source<'_>) -> [u32; 4] {
        self.stream.block(Purpose::NeeSite(self.flight, self.site, source.place()))
    }

    /// Whether connections other than the likeliest are tried.
    #[inline]
    pub fn whether(&self, source: Source<'_>) -> [f64; 4] {
        self.stream.block(Purpose::Whether(self.flight, self.site, source.place())).map(unit)
    }

    /// For which.
    pub fn which(&self, source: Source<'_>) -> Dice {
        self.stream.dice(Purpose::Which(self.flight, self.site, source.place()))
    }
}

impl Walker<'_> {
    /// What a shadow ray meets from r along `towards`.
    pub(crate) fn visibility(
        &mut self,
        r: DVec3,
        towards: DVec3,
        distance: f64,
        surface_point: Option<SurfacePoint>,
    ) -> Visibility {
        let Setting { world, shared, .. } = self.setting;
        let mut visibility = Visibility { tau: 0.0, blocked: false, exit: None, lengths: NO_LENGTHS };
        let mut n = None;
        for segment in world.trace(r, towards, surface_point, &mut self.chords) {
            if segment.start >= distance {
                break;
            }
            if visibility.exit.is_none()
                && let Some(interface) = segment.interface
            {
                let normal = world.normal(interface, r + segment.end * towards);
                visibility.exit = Some(if normal.dot(towards) < 0.0 { -normal } else { normal });
            }
            let material = &world.materials[segment.material];
            // Where light bends at planes a chain is made of stretches within one index.
            let bends = matches!(self.bending, Bending::AtRough | Bending::AtInterfaces);
            let crosses = bends && *n.get_or_insert(material.n) != material.n;
            if material.is_opaque() || crosses {
                visibility.blocked = true;
            } else if segment.material != 0 {
                let length = segment.end.min(distance) - segment.start;
                visibility.tau += material.mu_t() * length;
                count(shared, &mut visibility.lengths, segment.material, length);
            }
        }
        visibility
    }

    /// The connection by which most of the light of a source comes, if it is open: the straight one, or the one that only refraction bends.
    /// `lit`: only where it lies inside the source's field.
    #[inline]
    pub(crate) fn connect(
        &mut self,
        source: Source<'_>,
        r: DVec3,
        surface_point: Option<SurfacePoint>,
        lit: bool,
    ) -> Option<Connection> {
        if matches!(self.bending, Bending::Nowhere | Bending::AtRough) {
            return self.straight(source, r, surface_point, 1.0);
        }
        if self.bending == Bending::AtInterfaces {
            self.find_known(source, r, surface_point, true);
            return self.known.first().map(|known| known.connection).filter(|connection| connection.lit || !lit);
        }
        self.on_scratch(|walker, chain| {
            walker.without_reflections(source, r, surface_point, chain)?;
            match chain.stretches[..] {
                // Exact for horizontal beams, too.
                [only] => walker.straight(source, r, surface_point, only.leg.n),
                _ => walker.along(source, r, surface_point, chain, 1.0),
            }
        })
        .filter(|connection| connection.lit || !lit)
    }

    /// Adds the lit connections from r to a source that are tried every time: they bring most of its light.
    #[inline]
    pub(crate) fn reach(
        &mut self,
        source: Source<'_>,
        r: DVec3,
        surface_point: Option<SurfacePoint>,
        connections: &mut Vec<Connection>,
    ) {
        if self.bending == Bending::AtInterfaces {
            self.find_known(source, r, surface_point, false);
            connections.extend(self.known.iter().map(|known| known.connection).filter(|connection| connection.lit));
        } else {
            connections.extend(self.connect(source, r, surface_point, true));
        }
    }

    /// Adds those by mirrors, and one of the others at random; after [`Walker::reach`] for the same source and place.
    #[inline]
    pub(crate) fn reach_on(
        &mut self,
        source: Source<'_>,
        r: DVec3,
        surface_point: Option<SurfacePoint>,
        draws: &Draws<'_>,
        connections: &mut Vec<Connection>,
    ) {
        if self.bending == Bending::AtInterfaces {
            connections.extend(self.sample_manifold(source, r, surface_point, draws));
        } else {
            connections.extend(self.reflected_connection(source, r, surface_point, draws));
            self.by_mirrors(source, r, surface_point, draws, connections);
        }
    }

    /// Through index n all the way.
    #[inline]
    pub(crate) fn straight(
        &mut self,
        source: Source<'_>,
        r: DVec3,
        surface_point: Option<SurfacePoint>,
        n: f64,
    ) -> Option<Connection> {
        let arrival = source.arrival(r)?;
        let visibility = self.visibility(r, arrival.towards, arrival.distance, surface_point);
        (!visibility.blocked).then_some(Connection {
            towards: arrival.towards,
            irradiance: arrival.irradiance / (n * n),
            tau: visibility.tau,
            exit: visibility.exit,
            on_plane: arrival.on_plane,
            lit: true,
            lengths: visibility.lengths,
        })
    }

    /// The direction of a source from r, inside a medium and at least the optical depth `tau` away.
    #[inline]
    pub(crate) fn heading(&mut self, source: Source<'_>, r: DVec3, material: usize, tau: f64) -> Heading {
        if self.bending == Bending::AtInterfaces {
            return self.heading_past_interfaces(source, r, r, material, tau);
        }
        let (towards, distance) = source.towards(r);
        if matches!(self.bending, Bending::Nowhere | Bending::AtRough) {
            let visibility = self.visibility(r, towards, distance, None);
            return Heading { towards, tau: visibility.tau, exit: visibility.exit };
        }
        match self.connect(source, r, None, false) {
            Some(Connection { towards, tau, exit, .. }) => Heading { towards, tau, exit },
            None => Heading { towards, tau, exit: None },
        }
    }

    /// The same as the nearest interface bends light, as if its body were alone and the interface flat; `inside` is near r and in the material, `tau` the optical depth
    /// of the interface at least. Whether light gets there is not asked: what an estimate is aimed at decides how noisy it is, not what it means, and a search for
    /// connections takes most of the time of an estimate.
    fn heading_past_interfaces(
        &mut self,
        source: Source<'_>,
        r: DVec3,
        inside: DVec3,
        material: usize,
        tau: f64,
    ) -> Heading {
        let world = self.setting.world;
        let (n_far, medium) = (self.index_around(source.origin().0), &world.materials[material]);
        let (mu_t, (straight, reach)) = (medium.mu_t(), source.towards(r));
        // Towards light that comes from `against` through an interface of the unit normal `exit`, towards that.
        let bent = |against: DVec3, exit: DVec3| {
            let lit = against.dot(exit) > 0.0;
            lit.then(|| refract(-against, exit, n_far, medium.n).refracted).flatten().map(|inside| -inside)
        };
        let (mut nearest, mut heading) = (reach, Heading { towards: straight, tau: mu_t * reach, exit: None });
        for body in world.bodies.iter().filter(|body| !world.materials[body.material].is_opaque()) {
            let own = body.material == material;
            if !own && world.materials[body.material].n == medium.n {
                continue;
            }
            let facet = body.solid.facets_near(r).and_then(|(outwards, height)| {
                let (exit, height) = if own { (outwards, height) } else { (-outwards, -height) };
                let towards = bent(straight, exit)?;
                Some((height.max(tau / mu_t).max(0.0) / towards.dot(exit), towards, exit))
            });
            let found = facet.or_else(|| {
                let (distance, exit) = own.then(|| body.solid.way_out((r, inside), straight, &mut self.scratch))??;
                let foot = r + distance * straight;
                let towards = bent(source.towards(foot).0, exit).unwrap_or(straight);
                if !body.solid.is_convex() || distance >= reach {
                    return Some((distance, towards, exit));
                }
                // From where that leaves the body.
                let (distance, exit) = body.solid.way_out((r, inside), towards, &mut self.scratch)?;
                let foot = r + distance * towards;
                Some((distance, bent(source.towards(foot).0, exit).unwrap_or(towards), exit))
            });
            if let Some((distance, towards, exit)) = found.filter(|(distance, ..)| *distance < nearest) {
                nearest = distance;
                heading = Heading { towards, tau: mu_t * distance, exit: Some(exit) };
            }
        }
        heading
    }

    /// The same from where a ray comes into a material at `start`, by an interface of the unit normal `normal` against the ray; `inside` is a point of the ray
    /// behind that.
    pub(crate) fn heading_from_interface(
        &mut self,
        source: Source<'_>,
        (start, normal): (DVec3, Option<DVec3>),
        inside: DVec3,
        material: usize,
    ) -> Heading {
        let bent = match self.bending {
            Bending::Nowhere | Bending::AtRough => None,
            Bending::AtPlanes(_) | Bending::Anywhere => self.connect(source, inside, None, false),
            Bending::AtInterfaces => return self.heading_past_interfaces(source, start, inside, material, 0.0),
        };
        let towards = bent.map_or_else(|| source.towards(start).0, |connection| connection.towards);
        // Where the ray came in is where the light comes in, if it comes from that side.
        Heading { towards, tau: 0.0, exit: normal.filter(|n| n.dot(towards) > 0.0) }
    }

    pub(crate) fn on_scratch<T>(&mut self, work: impl FnOnce(&mut Self, &mut SpecularChain) -> Option<T>) -> Option<T> {
        let mut chain = std::mem::take(&mut self.chain);
        chain.clear();
        let result = work(self, &mut chain);
        self.chain = chain;
        result
    }

    /// Up or down through the layers to the light; `None` where something opaque fills one of them.
    fn without_reflections(
        &self,
        source: Source<'_>,
        r: DVec3,
        surface_point: Option<SurfacePoint>,
        chain: &mut SpecularChain,
    ) -> Option<()> {
        let Bending::AtPlanes(strata) = &self.bending else { return None };
        let target = Target::of(source);
        let up = target.is_above(r.z);
        let (mut layer, last) = (self.layer(strata, r, surface_point, up), strata.layer(target.origin.z, !up));
        let mut z = r.z;
        while layer != last {
            let (edge, next) = strata.onward(layer, up)?;
            if strata.layers[next].opaque {
                return None;
            }
            let (n, beyond) = (strata.layers[layer].n, strata.layers[next].n);
            chain.go(n, z, edge, up);
            chain.events.push((n, beyond, false));
            (layer, z) = (next, edge);
        }
        chain.go(strata.layers[last].n, z, target.origin.z, up);
        Some(())
    }

    /// The light that comes by a chain, over the probability with which the chain was chosen.
    pub(crate) fn along(
        &mut self,
        source: Source<'_>,
        r: DVec3,
        surface_point: Option<SurfacePoint>,
        chain: &SpecularChain,
        probability: f64,
    ) -> Option<Connection> {
        let target = Target::of(source);
        let legs = chain.stretches.iter().map(|stretch| stretch.leg);
        let (n, n_source) = (chain.stretches[0].leg.n, chain.stretches[chain.stretches.len() - 1].leg.n);
        let across = target.towards.unwrap_or(target.origin - r).truncate();
        let crossing = match target.towards {
            None => Crossing::new(legs, across.length())?,
            Some(towards) => Crossing::at_slope(legs, n_source, across.length() / towards.z.abs())?,
        };
        let sideways = across.try_normalize().map_or(DVec3::ZERO, |across| across.extend(0.0));
        let mut connection = Connection {
            towards: DVec3::ZERO,
            irradiance: 1.0 / probability,
            tau: 0.0,
            exit: None,
            on_plane: DVec3::ZERO,
            lit: false,
            lengths: NO_LENGTHS,
        };
        for &(n, beyond, reflected) in &chain.events {
            let reflectance = crossing.reflectance(n, beyond);
            connection.irradiance *= if reflected { reflectance } else { 1.0 - reflectance };
        }
        let (mut p, mut surface_point) = (r, surface_point);
        for (i, &Stretch { leg, up, until }) in chain.stretches.iter().enumerate() {
            let (sin, cos) = (crossing.sin(leg.n), crossing.cos(leg.n));
            let w = sin * sideways + (if up { cos } else { -cos }) * DVec3::Z;
            let last = i + 1 == chain.stretches.len();
            let distance = if last { source.towards(p).1 } else { leg.depth / cos };
            let visibility = self.visibility(p, w, distance, surface_point);
            if visibility.blocked {
                return None;
            }
            connection.tau += visibility.tau;
            connection.lengths = sum(&connection.lengths, &visibility.lengths);
            if i == 0 {
                (connection.towards, connection.exit) = (w, visibility.exit);
            }
            if !last {
                p += leg.depth * crossing.tan(leg.n) * sideways;
                p.z = until;
                surface_point = None;
            }
        }
        // From the last interface on it is the light's own cone: there are its intensity and the place on its pattern.
        if let Some(arrival) = source.arrival(p) {
            let spread = match target.towards {
                None => arrival.distance * arrival.distance * crossing.spread(n_source, n),
                Some(_) => crossing.cos(n_source) / crossing.cos(n),
            };
            connection.irradiance *= arrival.irradiance * spread / (n * n);
            (connection.on_plane, connection.lit) = (arrival.on_plane, true);
        }
        Some(connection)
    }

    /// The layer around a point; on a surface the one that the surface faces, else on an edge the one where light goes on.
    pub(crate) fn layer(&self, strata: &Strata, r: DVec3, surface_point: Option<SurfacePoint>, up: bool) -> usize {
        let faces = surface_point.map(|surface_point| {
            let z = self.setting.world.normal(surface_point.interface, r).z;
            if surface_point.inside { -z } else { z }
        });
        strata.layer(r.z, faces.map_or(up, |z| z > 0.0 || (z == 0.0 && up)))
    }
}

/// Where a chain has to arrive.
pub(crate) struct Target {
    pub origin: DVec3,
    /// Towards the source, where that is the same direction everywhere.
    pub towards: Option<DVec3>,
}

impl Target {
    pub fn of(source: Source<'_>) -> Self {
        let (origin, along) = source.origin();
        Self { origin, towards: along.map(|along| -along) }
    }

    pub fn is_above(&self, z: f64) -> bool {
        self.towards.map_or(self.origin.z > z, |towards| towards.z > 0.0)
    }

    /// The least steep chain to here from r that has `passed` so much of each layer and is at height z now, with `across` of a layer still to pass besides.
    pub(crate) fn least_steep(
        &self,
        strata: &Strata,
        passed: &[f64],
        (z, layer, across): (f64, usize, f64),
        (r, last): (DVec3, usize),
    ) -> Option<Crossing> {
        let leg = |(i, (at, &passed)): (usize, (&Layer, &f64))| {
            let bottom = if i == 0 { f64::NEG_INFINITY } else { strata.edges[i - 1] };
            let top = strata.edges.get(i).copied().unwrap_or(f64::INFINITY);
            let (low, high) = (z.min(self.origin.z), z.max(self.origin.z));
            let left = (high.min(top) - low.max(bottom)).max(0.0);
            Leg { n: at.n, depth: passed + left + if i == layer { across } else { 0.0 } }
        };
        let legs = strata.layers.iter().zip(passed).enumerate().map(leg).filter(|leg| leg.depth > 0.0);
        match self.towards {
            None => Crossing::new(legs, (self.origin - r).truncate().length()),
            Some(towards) => {
                Crossing::at_slope(legs, strata.layers[last].n, towards.truncate().length() / towards.z.abs())
            }
        }
    }
}
