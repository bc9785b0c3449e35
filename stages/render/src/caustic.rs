//! Specular connections through smooth interfaces of any shape, and by mirrors: some known for sure, all others by manifold sampling.
//!
//! A connection is found by a manifold walk (Newton's method): a ray from the point is refracted and reflected as its events say, its neighbours tell how to turn it so that it
//! meets the light. `docs/theory/render.md` says why nothing is counted twice and nothing is left out.

use glam::DVec3;
use turbid_optics::ray_differential::NewtonStep;
use turbid_optics::solid::{Ends, Far, Solid};

use crate::bsdf::Bsdf;
use crate::connection::{Connection, Known};
use crate::lamp::Source;
use crate::lengths::{Lengths, NO_LENGTHS, count, sum};
use crate::setting::Setting;
use crate::walker::Walker;
use crate::world::{Interface, SurfacePoint};

mod manifold_sampling;
mod other_facets;
mod reflection;
mod shot;

pub(crate) use manifold_sampling::{Beginning, Best};
use shot::{Shot, SurfaceNormals};

/// Where the refractive index changes next on a ray, or there is a mirror.
struct Edge {
    distance: f64,
    interface: Interface,
    n: f64,
    /// Behind it; at a mirror the same as before it.
    beyond: f64,
    /// As of a [`Shot`].
    tau: f64,
    lengths: Lengths,
    /// Normal, along the ray, of the first boundary on it, be the index the same or not.
    exit: DVec3,
}

/// What a ray comes to.
enum Next {
    Edge(Edge),
    Opaque,
    /// Nothing any more; the index around it.
    Free(f64),
}

/// A place where light may cross one interface is a connection if what is left to turn is less than this, rad: else another interface comes first.
const NEAR: f64 = 1e-4;
impl Walker<'_> {
    /// Fills `self.known` with connections found from fixed beginnings: the straight line, or refraction at one interface, or the straight line's interfaces one
    /// after the other; and reflection at one mirror. With the first of them if `one` will do.
    pub(crate) fn find_known(&mut self, source: Source<'_>, r: DVec3, surface_point: Option<SurfacePoint>, one: bool) {
        let mut known = std::mem::take(&mut self.known);
        known.clear();
        self.search_known(source, r, surface_point, one, &mut known);
        if (known.is_empty() || !one) && !self.mirrors.is_empty() {
            self.by_one_reflection(source, (r, surface_point), false, &mut known);
            // In a focus there is no telling how bright it is; hardly any place is in one.
            known.retain(|known| known.connection.irradiance.is_finite());
        }
        self.known = known;
    }

    fn search_known(
        &mut self,
        source: Source<'_>,
        r: DVec3,
        surface_point: Option<SurfacePoint>,
        one: bool,
        known: &mut Vec<Known>,
    ) {
        let (towards, distance) = source.towards(r);
        let (n, edges) = self.edges(r, towards, surface_point, distance);
        if edges == Some(0) {
            known.extend(self.unbent(source, r, surface_point, n).map(|connection| Known { connection, events: 0 }));
            return;
        }
        self.by_one_refraction(source, (r, surface_point), n, |_| true, one, known);
        if known.is_empty()
            && let Some(edges @ 1..) = edges
        {
            self.by_straight_line(source, (r, surface_point), edges, known);
        }
    }

    /// Adds connections by one refraction at solids for which `through` holds, from a point where the index is n; the first of them if `one` will do.
    fn by_one_refraction(
        &mut self,
        source: Source<'_>,
        begin: (DVec3, Option<SurfacePoint>),
        n: f64,
        through: impl Fn(&Solid) -> bool,
        one: bool,
        known: &mut Vec<Known>,
    ) {
        let (r, world) = (begin.0, self.setting.world);
        let far = match source.origin() {
            (_, Some(along)) => Far::Direction(-along),
            (origin, None) => Far::Point(origin),
        };
        let n_far = self.index_around(source.origin().0);
        if n == n_far {
            return;
        }
        let ends = Ends { far, n_far, near: r, n_near: n };
        let mut places = std::mem::take(&mut self.places);
        places.clear();
        let clear = world.bodies.iter().filter(|body| !world.materials[body.material].is_opaque());
        for body in clear.filter(|body| through(&body.solid)) {
            body.solid.crossings(&ends, &mut |p| places.push(p));
        }
        for p in &places {
            let shot = self.shoot(begin, (p - r).normalize(), &[false], SurfaceNormals::AsTheyAre);
            let shot = shot.and_then(|shot| shot.newton(source).map(|newton| (shot, newton)));
            if let Some((shot, newton)) = shot.filter(|(_, newton)| newton.turn.length() < NEAR) {
                self.keep(source, begin, (shot, newton), &[false], known);
            }
            if one && !known.is_empty() {
                break;
            }
        }
        self.places = places;
    }

    /// Adds the connection through the interfaces of the straight line, one after the other.
    fn by_straight_line(
        &mut self,
        source: Source<'_>,
        begin: (DVec3, Option<SurfacePoint>),
        edges: usize,
        known: &mut Vec<Known>,
    ) {
        let events = vec![false; edges];
        let shot = self.shoot(begin, source.towards(begin.0).0, &events, SurfaceNormals::AsTheyAre);
        if let Some(shot) = shot.and_then(|shot| shot.newton(source).map(|newton| (shot, newton))) {
            self.keep(source, begin, shot, &events, known);
        }
    }

    /// Fills `self.known` where lanes have found that no single refraction leads there: with the connection through the bodies that stand in the way.
    pub(crate) fn find_known_by_several(&mut self, source: Source<'_>, r: DVec3) {
        let mut known = std::mem::take(&mut self.known);
        known.clear();
        let (towards, distance) = source.towards(r);
        if let Some(edges @ 2..) = self.edges(r, towards, None, distance).1 {
            self.by_straight_line(source, (r, None), edges, &mut known);
        }
        self.known = known;
    }

    /// Adds the connection that a ray leads to, if it is not known yet.
    fn keep(
        &mut self,
        source: Source<'_>,
        begin: (DVec3, Option<SurfacePoint>),
        shot: (Shot, NewtonStep),
        events: &[bool],
        known: &mut Vec<Known>,
    ) {
        let Some((shot, newton)) = self.manifold_walk(source, begin, shot, events, SurfaceNormals::AsTheyAre) else {
            return;
        };
        let chain = shot.differential.start();
        if known.iter().any(|known| known.is(chain, events.len())) {
            return;
        }
        let connection = self.arrive(source, &shot, &newton);
        known.extend(connection.map(|connection| Known { connection, events: events.len() }));
    }

    /// The light that comes by a chain that has been found, if nothing stands in its last part.
    fn arrive(&mut self, source: Source<'_>, shot: &Shot, newton: &NewtonStep) -> Option<Connection> {
        let Shot { differential, surface_point, n, passed, tau, lengths, exit } = shot;
        let visibility =
            self.visibility(differential.r, differential.w, source.towards(differential.r).1, *surface_point);
        if visibility.blocked {
            return None;
        }
        let mut connection = Connection {
            towards: differential.start(),
            irradiance: 0.0,
            tau: tau + visibility.tau,
            exit: *exit,
            on_plane: DVec3::ZERO,
            lit: false,
            lengths: sum(lengths, &visibility.lengths),
        };
        // From the last interface on it is the light's own cone: there are its intensity and the place on its pattern.
        if let Some(arrival) = source.arrival(differential.r) {
            let strength = match source.origin().1 {
                None => arrival.irradiance * arrival.distance * arrival.distance,
                Some(_) => arrival.irradiance,
            };
            connection.irradiance = strength * passed * newton.spread / (n * n);
            (connection.on_plane, connection.lit) = (arrival.on_plane, true);
        }
        Some(connection)
    }

    /// The straight connection through one index.
    fn unbent(
        &mut self,
        source: Source<'_>,
        r: DVec3,
        surface_point: Option<SurfacePoint>,
        n: f64,
    ) -> Option<Connection> {
        let (towards, distance) = source.towards(r);
        let visibility = self.visibility(r, towards, distance, surface_point);
        if visibility.blocked {
            return None;
        }
        let arrival = source.arrival(r);
        Some(Connection {
            towards,
            irradiance: arrival.map_or(0.0, |arrival| arrival.irradiance / (n * n)),
            tau: visibility.tau,
            exit: visibility.exit,
            on_plane: arrival.map_or(DVec3::ZERO, |arrival| arrival.on_plane),
            lit: arrival.is_some(),
            lengths: visibility.lengths,
        })
    }

    /// Where the index changes first along a ray, or a mirror is.
    fn next_edge(&mut self, r: DVec3, w: DVec3, surface_point: Option<SurfacePoint>) -> Next {
        let Setting { world, shared, .. } = self.setting;
        let (mut n, mut tau, mut lengths) = (None, 0.0, NO_LENGTHS);
        let (mut before, mut exit): (Option<Interface>, Option<DVec3>) = (None, None);
        for segment in world.trace(r, w, surface_point, &mut self.chords) {
            let material = &world.materials[segment.material];
            let mirror = material.bsdf == Bsdf::Mirror;
            if material.is_opaque() && !mirror {
                return Next::Opaque;
            }
            let n = *n.get_or_insert(material.n);
            let beyond = if mirror { n } else { material.n };
            if let Some(interface) = before {
                let along = || {
                    let normal = world.normal(interface, r + segment.start * w);
                    if normal.dot(w) < 0.0 { -normal } else { normal }
                };
                let exit = *exit.get_or_insert_with(along);
                if mirror || beyond != n {
                    return Next::Edge(Edge { distance: segment.start, interface, n, beyond, tau, lengths, exit });
                }
            } else if mirror {
                // Rounding put the start of the ray into it.
                return Next::Opaque;
            }
            if segment.interface.is_none() {
                return Next::Free(n);
            }
            if segment.material != 0 {
                let length = segment.end - segment.start;
                tau += material.mu_t() * length;
                count(shared, &mut lengths, segment.material, length);
            }
            before = segment.interface;
        }
        Next::Free(n.unwrap_or(1.0))
    }

    /// The index at r on the side of `w`, and how often it changes on the way along `w`; `None` where something opaque is in the way.
    fn edges(
        &mut self,
        r: DVec3,
        w: DVec3,
        surface_point: Option<SurfacePoint>,
        distance: f64,
    ) -> (f64, Option<usize>) {
        let world = self.setting.world;
        let (mut first, mut n, mut edges) = (None, 1.0, 0);
        for segment in world.trace(r, w, surface_point, &mut self.chords) {
            if segment.start >= distance {
                break;
            }
            let material = &world.materials[segment.material];
            if first.is_none() {
                (first, n) = (Some(material.n), material.n);
            }
            if material.is_opaque() {
                return (first.unwrap_or(n), None);
            }
            edges += usize::from(material.n != n);
            n = material.n;
        }
        (first.unwrap_or(n), Some(edges))
    }

    /// The refractive index around a point.
    pub(crate) fn index_around(&self, p: DVec3) -> f64 {
        let world = self.setting.world;
        world.bodies.iter().find(|body| body.solid.contains(p)).map_or(1.0, |body| world.materials[body.material].n)
    }
}

impl Edge {
    fn is_mirror(&self) -> bool {
        self.n == self.beyond
    }
}

#[cfg(test)]
mod tests;
