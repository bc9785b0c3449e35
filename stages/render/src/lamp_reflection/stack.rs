//! All specular chains through a stack of parallel planes, one after the other, until what is left of them is next to nothing.

use glam::DVec3;
use turbid_contract::Error;
use turbid_optics::fresnel::normal_reflectance;
use turbid_optics::refraction::{Crossing, Leg};

use crate::connect::Target;
use crate::connection::{Connection, SpecularChain};
use crate::lamp::Source;
use crate::strata::{Bending, Strata, clear};
use crate::walker::Walker;

/// Chains are followed no further once they carry less than this part of the light: their sum is below it times the number of planes
/// at each of which one ends.
const FAINT: f64 = 1e-10;
/// Planes met by all chains together, beyond which they are too many.
const MOST_EVENTS: usize = 1 << 24;

/// What the search shares.
struct Search<'a> {
    strata: &'a Strata,
    /// Of each layer, a bound of what it lets through.
    clear: &'a [f64],
    source: Source<'a>,
    target: Target,
    /// The layer in which the light is.
    last: usize,
    /// No chain is less steep.
    slope: Crossing,
    /// mm of height that the chain under search has passed in each layer.
    passed: Vec<f64>,
    from: DVec3,
    events: usize,
    connections: Vec<Connection>,
}

impl Walker<'_> {
    /// Every lit connection from a source to `r` that a plane turns; all of them with the probability 1.
    ///
    /// Error: they are too many, because hardly any light is lost between planes.
    pub(crate) fn chains_through_planes(&mut self, source: Source<'_>, r: DVec3) -> Result<Vec<Connection>, Error> {
        let Bending::AtPlanes(strata) = self.bending.clone() else { return Ok(Vec::new()) };
        let target = Target::of(source);
        let n_least = strata.layers.iter().map(|layer| layer.n).fold(f64::INFINITY, f64::min);
        let last = strata.layer(target.origin.z, !target.is_above(r.z));
        let first = self.layer(&strata, r, None, target.is_above(r.z));
        let across = target.towards.unwrap_or(target.origin - r);
        // Within a layer the least upright length of a chain is that by the nearer plane, else that of the straight line.
        let edges = [first.checked_sub(1), Some(first)].map(|i| i.and_then(|i| strata.edges.get(i)));
        let by_plane = edges.into_iter().flatten().map(|z| (r.z - z).abs() + (target.origin.z - z).abs());
        let depth = if first == last && target.towards.is_none() {
            by_plane.fold(f64::INFINITY, f64::min)
        } else {
            across.z.abs()
        };
        let leg = Leg { n: n_least, depth };
        // A beam along the planes meets none.
        let Some(slope) = Crossing::new([leg].into_iter(), across.truncate().length()) else { return Ok(Vec::new()) };
        let clear = clear(self.setting.world, &strata);
        let mut search = Search {
            strata: &strata,
            clear: &clear,
            source,
            target,
            last,
            slope,
            passed: vec![0.0; strata.layers.len()],
            from: r,
            events: 0,
            connections: Vec::new(),
        };
        let mut chain = SpecularChain::default();
        for up in [true, false] {
            let layer = self.layer(&strata, r, None, up);
            self.follow(&mut search, &mut chain, (layer, r.z, up))?;
        }
        Ok(search.connections)
    }

    /// Goes on from height z in a layer.
    fn follow(
        &mut self,
        search: &mut Search<'_>,
        chain: &mut SpecularChain,
        from: (usize, f64, bool),
    ) -> Result<(), Error> {
        let strata = search.strata;
        // What is still to be done, the next thing last: chains may be thousands of planes long.
        let mut tasks = vec![Task::Go(from, 1.0)];
        while let Some(task) = tasks.pop() {
            let ((layer, z, up), left) = match task {
                Task::Go(from, left) => (from, left),
                Task::Meet { indices: (n, beyond), reflected, on, left } => {
                    chain.meet(n, beyond, reflected);
                    tasks.extend([Task::Forget, Task::Go(on, left)]);
                    continue;
                }
                Task::Forget => {
                    chain.forget();
                    continue;
                }
                Task::Undo { layer, passed } => {
                    chain.undo();
                    search.passed[layer] = passed;
                    continue;
                }
            };
            if layer == search.last && up == search.target.is_above(z) && chain.is_bent() {
                search.events += chain.turns();
                chain.go(strata.layers[layer].n, z, search.target.origin.z, up);
                let connection = self.along(search.source, search.from, None, chain, 1.0);
                search.connections.extend(connection.filter(|connection| connection.lit));
                chain.undo();
            }
            let Some((edge, next)) = strata.onward(layer, up).filter(|&(_, next)| !strata.layers[next].opaque) else {
                continue;
            };
            search.events += 1;
            if search.events > MOST_EVENTS {
                return Err(Error::failed_with_hint(
                    "the lamp reflection comes by more chains between the planes than can be followed",
                    "write `specular: exclude`, or take layers out that hardly reflect",
                ));
            }
            let indices = (strata.layers[layer].n, strata.layers[next].n);
            tasks.push(Task::Undo { layer, passed: search.passed[layer] });
            search.passed[layer] += (edge - z).abs();
            // The farther it has come, the steeper it is.
            let here = (edge, layer, 0.0);
            let slope = search.target.least_steep(strata, &search.passed, here, (search.from, search.last));
            let reflectance = slope.unwrap_or(search.slope).reflectance(indices.0, indices.1);
            // From straight down to that slope the reflectance falls or grows, or falls and then grows.
            let normal = normal_reflectance(indices.0 / indices.1);
            let (most, least) = (reflectance.max(normal), reflectance.min(0.5 * normal));
            // The first stretch begins within its layer.
            let left = if chain.is_bent() { left * search.clear[layer] } else { left };
            chain.go(indices.0, z, edge, up);
            for (reflected, left) in [(true, left * most), (false, left * (1.0 - least))] {
                if left > FAINT {
                    let on = if reflected { (layer, edge, !up) } else { (next, edge, up) };
                    tasks.push(Task::Meet { indices, reflected, on, left });
                }
            }
        }
        Ok(())
    }
}

/// A step of the search.
enum Task {
    /// On from a height within a layer, up or down; with a bound of the light that is left.
    Go((usize, f64, bool), f64),
    /// At a plane, between these n.
    Meet { indices: (f64, f64), reflected: bool, on: (usize, f64, bool), left: f64 },
    /// Back before the plane ...
    Forget,
    /// ... and before the stretch to it.
    Undo { layer: usize, passed: f64 },
}
