//! Links: the ways by which light from the projector reaches a point without being scattered.
//!
//! `docs/theory/render.md` derives the irradiance of a link through refracting boundaries.

use glam::DVec3;
use turbid_optics::philox::unit;
use turbid_optics::refraction::{Crossing, Leg};

use crate::lamp::Source;
use crate::lengths::{Lengths, NO_LENGTHS, count, sum};
use crate::random::{Dice, Look, Purpose, Stream};
use crate::setting::Setting;
use crate::strata::{Bending, Layer, Strata};
use crate::walker::Walker;
use crate::way::{Link, Stretch, Way};
use crate::world::Skin;

/// Where light comes from, be it lit or not, and how far off it is.
pub(crate) struct Heading {
    pub towards: DVec3,
    /// Optical depth; opaque bodies do not count.
    pub tau: f64,
    /// As of a [`Link`].
    pub exit: Option<DVec3>,
}

/// What lies on a straight way.
pub(crate) struct Sight {
    /// Optical depth; opaque bodies do not count.
    pub tau: f64,
    pub blocked: bool,
    /// Normal, along the way, of the first boundary on it.
    pub exit: Option<DVec3>,
    /// mm in each medium that tells channels apart.
    pub lengths: Lengths,
}

/// Which random numbers a look has.
pub(crate) struct Chance<'a> {
    pub stream: &'a Stream,
    /// Number of the flight beside which it is.
    pub flight: u64,
    pub look: Look,
}

impl Chance<'_> {
    /// For the point from which it looks, and the direction to that.
    #[inline]
    pub fn point(&self, source: Source<'_>) -> [u32; 4] {
        self.stream.block(Purpose::Look(self.flight, self.look, source.place()))
    }

    /// Whether it looks for ways beside the likeliest.
    #[inline]
    pub fn whether(&self, source: Source<'_>) -> [f64; 4] {
        self.stream.block(Purpose::Whether(self.flight, self.look, source.place())).map(unit)
    }

    /// For which.
    pub fn which(&self, source: Source<'_>) -> Dice {
        self.stream.dice(Purpose::Which(self.flight, self.look, source.place()))
    }
}

/// Ways other than the straight one are looked for with this probability: they carry a few per cent of the light.
pub(crate) const DETOURS: f64 = 0.125;
impl Walker<'_> {
    /// What lies on the straight way from r along `towards`.
    pub(crate) fn sight(&mut self, r: DVec3, towards: DVec3, distance: f64, skin: Option<Skin>) -> Sight {
        let Setting { world, shared, .. } = self.setting;
        let mut sight = Sight { tau: 0.0, blocked: false, exit: None, lengths: NO_LENGTHS };
        let mut n = None;
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
            // Where light bends at planes a way is made of stretches within one index.
            let bends = matches!(self.bending, Bending::AtRough | Bending::AtWalls);
            let crosses = bends && *n.get_or_insert(material.n) != material.n;
            if material.is_opaque() || crosses {
                sight.blocked = true;
            } else if piece.material != 0 {
                let length = piece.end.min(distance) - piece.start;
                sight.tau += material.mu_t() * length;
                count(shared, &mut sight.lengths, piece.material, length);
            }
        }
        sight
    }

    /// The way by which most of the light of a source comes, if it is open: the straight one, or the one that only refraction bends.
    /// `lit`: only where it lies inside the source's field.
    #[inline]
    pub(crate) fn link(&mut self, source: Source<'_>, r: DVec3, skin: Option<Skin>, lit: bool) -> Option<Link> {
        if matches!(self.bending, Bending::Nowhere | Bending::AtRough) {
            return self.straight(source, r, skin, 1.0);
        }
        if self.bending == Bending::AtWalls {
            self.know_ways(source, r, skin, true);
            return self.known.first().map(|known| known.link).filter(|link| link.lit || !lit);
        }
        self.on_scratch(|walker, way| {
            walker.without_reflections(source, r, skin, way)?;
            match way.stretches[..] {
                // Exact for horizontal beams, too.
                [only] => walker.straight(source, r, skin, only.leg.n),
                _ => walker.along(source, r, skin, way, 1.0),
            }
        })
        .filter(|link| link.lit || !lit)
    }

    /// Adds the lit ways from a source to r that are looked for every time: they bring most of its light.
    #[inline]
    pub(crate) fn reach(&mut self, source: Source<'_>, r: DVec3, skin: Option<Skin>, links: &mut Vec<Link>) {
        if self.bending == Bending::AtWalls {
            self.know_ways(source, r, skin, false);
            links.extend(self.known.iter().map(|known| known.link).filter(|link| link.lit));
        } else {
            links.extend(self.link(source, r, skin, true));
        }
    }

    /// Adds those by mirrors, and one of the others by chance; after [`Walker::reach`] for the same source and place.
    #[inline]
    pub(crate) fn reach_on(
        &mut self,
        source: Source<'_>,
        r: DVec3,
        skin: Option<Skin>,
        chance: &Chance<'_>,
        links: &mut Vec<Link>,
    ) {
        if self.bending == Bending::AtWalls {
            links.extend(self.by_chance(source, r, skin, chance));
        } else {
            links.extend(self.detour(source, r, skin, chance));
            self.by_mirrors(source, r, skin, chance, links);
        }
    }

    /// Through index n all the way.
    #[inline]
    pub(crate) fn straight(&mut self, source: Source<'_>, r: DVec3, skin: Option<Skin>, n: f64) -> Option<Link> {
        let arrival = source.arrival(r)?;
        let sight = self.sight(r, arrival.towards, arrival.distance, skin);
        (!sight.blocked).then_some(Link {
            towards: arrival.towards,
            irradiance: arrival.irradiance / (n * n),
            tau: sight.tau,
            exit: sight.exit,
            on_plane: arrival.on_plane,
            lit: true,
            lengths: sight.lengths,
        })
    }

    /// Where to look for a source from r, inside a medium and at least the optical depth `tau` away.
    #[inline]
    pub(crate) fn heading(&mut self, source: Source<'_>, r: DVec3, tau: f64) -> Heading {
        let (towards, distance) = source.towards(r);
        if matches!(self.bending, Bending::Nowhere | Bending::AtRough) {
            let sight = self.sight(r, towards, distance, None);
            return Heading { towards, tau: sight.tau, exit: sight.exit };
        }
        match self.link(source, r, None, false) {
            Some(Link { towards, tau, exit, .. }) => Heading { towards, tau, exit },
            None => Heading { towards, tau, exit: None },
        }
    }

    /// Towards a source from where a ray comes in at `start`; where light is bent, from a point on it inside.
    pub(crate) fn heading_from_wall(&mut self, source: Source<'_>, start: DVec3, inside: DVec3) -> DVec3 {
        let bent = if matches!(self.bending, Bending::Nowhere | Bending::AtRough) {
            None
        } else {
            self.link(source, inside, None, false)
        };
        bent.map_or_else(|| source.towards(start).0, |link| link.towards)
    }

    pub(crate) fn on_scratch<T>(&mut self, work: impl FnOnce(&mut Self, &mut Way) -> Option<T>) -> Option<T> {
        let mut way = std::mem::take(&mut self.way);
        way.clear();
        let result = work(self, &mut way);
        self.way = way;
        result
    }

    /// Up or down through the layers to the light; `None` where something opaque fills one of them.
    fn without_reflections(&self, source: Source<'_>, r: DVec3, skin: Option<Skin>, way: &mut Way) -> Option<()> {
        let Bending::AtPlanes(strata) = &self.bending else { return None };
        let target = Target::of(source);
        let up = target.is_above(r.z);
        let (mut layer, last) = (self.layer(strata, r, skin, up), strata.layer(target.origin.z, !up));
        let mut z = r.z;
        while layer != last {
            let (edge, next) = strata.onward(layer, up)?;
            if strata.layers[next].opaque {
                return None;
            }
            let (n, beyond) = (strata.layers[layer].n, strata.layers[next].n);
            way.go(n, z, edge, up);
            way.events.push((n, beyond, false));
            (layer, z) = (next, edge);
        }
        way.go(strata.layers[last].n, z, target.origin.z, up);
        Some(())
    }

    /// The light that comes by a way, over the probability with which the way was chosen.
    pub(crate) fn along(
        &mut self,
        source: Source<'_>,
        r: DVec3,
        skin: Option<Skin>,
        way: &Way,
        probability: f64,
    ) -> Option<Link> {
        let target = Target::of(source);
        let legs = way.stretches.iter().map(|stretch| stretch.leg);
        let (n, n_source) = (way.stretches[0].leg.n, way.stretches[way.stretches.len() - 1].leg.n);
        let across = target.towards.unwrap_or(target.origin - r).truncate();
        let crossing = match target.towards {
            None => Crossing::new(legs, across.length())?,
            Some(towards) => Crossing::at_slope(legs, n_source, across.length() / towards.z.abs())?,
        };
        let sideways = across.try_normalize().map_or(DVec3::ZERO, |across| across.extend(0.0));
        let mut link = Link {
            towards: DVec3::ZERO,
            irradiance: 1.0 / probability,
            tau: 0.0,
            exit: None,
            on_plane: DVec3::ZERO,
            lit: false,
            lengths: NO_LENGTHS,
        };
        for &(n, beyond, reflected) in &way.events {
            let reflectance = crossing.reflectance(n, beyond);
            link.irradiance *= if reflected { reflectance } else { 1.0 - reflectance };
        }
        let (mut p, mut skin) = (r, skin);
        for (i, &Stretch { leg, up, until }) in way.stretches.iter().enumerate() {
            let (sin, cos) = (crossing.sin(leg.n), crossing.cos(leg.n));
            let w = sin * sideways + (if up { cos } else { -cos }) * DVec3::Z;
            let last = i + 1 == way.stretches.len();
            let distance = if last { source.towards(p).1 } else { leg.depth / cos };
            let sight = self.sight(p, w, distance, skin);
            if sight.blocked {
                return None;
            }
            link.tau += sight.tau;
            link.lengths = sum(&link.lengths, &sight.lengths);
            if i == 0 {
                (link.towards, link.exit) = (w, sight.exit);
            }
            if !last {
                p += leg.depth * crossing.tan(leg.n) * sideways;
                p.z = until;
                skin = None;
            }
        }
        // From the last wall on it is the light's own cone: there are its intensity and the place on its pattern.
        if let Some(arrival) = source.arrival(p) {
            let spread = match target.towards {
                None => arrival.distance * arrival.distance * crossing.spread(n_source, n),
                Some(_) => crossing.cos(n_source) / crossing.cos(n),
            };
            link.irradiance *= arrival.irradiance * spread / (n * n);
            (link.on_plane, link.lit) = (arrival.on_plane, true);
        }
        Some(link)
    }

    /// The layer around a point; on a surface the one that the surface faces, else on an edge the one where light goes on.
    pub(crate) fn layer(&self, strata: &Strata, r: DVec3, skin: Option<Skin>, up: bool) -> usize {
        let faces = skin.map(|skin| {
            let z = self.setting.world.normal(skin.wall, r).z;
            if skin.inside { -z } else { z }
        });
        strata.layer(r.z, faces.map_or(up, |z| z > 0.0 || (z == 0.0 && up)))
    }
}

/// Where a way has to arrive.
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

    /// The least steep way to here from r that has `passed` so much of each layer and is at height z now, with `across` of a layer still to pass besides.
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
