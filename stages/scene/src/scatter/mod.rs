//! Random places of bodies that keep a distance: random sequential addition.

mod body;

use glam::DVec3;
use turbid_optics::philox::{key, philox4x32, unit_fine};

pub use body::Body;
use body::keep_apart;

/// Places that are tried for each body.
pub const TRIES: u32 = 1000;

/// Where a body may lie.
#[derive(Clone, Copy, Debug)]
pub enum Region {
    /// Wholly between two corners, anywhere.
    Within { low: DVec3, high: DVec3 },
    /// Seen from above wholly between two corners; its highest point at `depth` below `top`.
    Below { low: [f64; 2], high: [f64; 2], top: f64 },
}

/// A body to be placed; `depth` counts in [`Region::Below`].
#[derive(Clone, Copy, Debug)]
pub struct Wanted {
    pub body: Body,
    pub depth: f64,
}

/// What could not be placed: how many were, and whether the next one is too large for the region whatever else lies there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stuck {
    pub placed: usize,
    pub too_large: bool,
}

/// Middles of the bodies: one after the other, each at the first of [`TRIES`] random places, even over the region, at which it is `apart` mm or more from those
/// before it. Places are a function of the seed and the body's number, so that further bodies move none.
pub fn place(bodies: &[Wanted], region: &Region, apart: f64, seed: u64) -> Result<Vec<DVec3>, Stuck> {
    let mut places: Vec<DVec3> = Vec::with_capacity(bodies.len());
    for (i, Wanted { body, depth }) in bodies.iter().enumerate() {
        let (low, high) = range(body, *depth, region);
        let too_large = !low.cmple(high).all();
        let free =
            |p: &DVec3| bodies.iter().zip(&places).all(|(other, &at)| keep_apart((body, *p), (&other.body, at), apart));
        let tried = |n: u32| low + random(i as u32, n, seed) * (high - low);
        let found = (0..TRIES).map(tried).find(free).filter(|_| !too_large);
        places.push(found.ok_or(Stuck { placed: i, too_large })?);
    }
    Ok(places)
}

/// Where the middle of a body may be: nothing where a corner is not below the other.
fn range(body: &Body, depth: f64, region: &Region) -> (DVec3, DVec3) {
    let half = body.half();
    match *region {
        Region::Within { low, high } => (low + half, high - half),
        Region::Below { low, high, top } => {
            let z = top - depth - half.z;
            let corner = |[x, y]: [f64; 2], side: f64| DVec3::new(x + side * half.x, y + side * half.y, z);
            (corner(low, 1.0), corner(high, -1.0))
        }
    }
}

/// Three numbers in (0, 1) for a try of a body.
fn random(body: u32, n: u32, seed: u64) -> DVec3 {
    let bits = philox4x32([body, n, PLACES, 0], key(seed));
    let low = philox4x32([body, n, PLACES, 1], key(seed));
    DVec3::from([0, 1, 2].map(|i| unit_fine(bits[i], low[i])))
}

/// A number in (0, 1) for the `which`-th size of a body.
pub fn unit_of(body: u32, which: u32, seed: u64) -> f64 {
    let bits = philox4x32([body, which, SIZES, 0], key(seed));
    unit_fine(bits[0], bits[1])
}

/// Streams of one seed.
const PLACES: u32 = 0;
const SIZES: u32 = 1;

#[cfg(test)]
mod tests {
    use turbid_optics::solid::Frame;

    use super::*;

    fn balls(n: u32, radius: f64) -> Vec<Wanted> {
        let body = |_| Body::Ellipsoid { radii: DVec3::splat(radius), frame: Frame::turned(DVec3::ZERO, [0.0; 3]) };
        (0..n).map(|i| Wanted { body: body(i), depth: 0.5 }).collect()
    }

    const BOX: Region = Region::Within { low: DVec3::new(-10.0, -20.0, -5.0), high: DVec3::new(10.0, 0.0, 5.0) };

    /// Balls keep their distance and stay inside; a place is a function of the seed and the number, not of how many follow.
    #[test]
    fn balls_keep_their_distance() {
        for seed in 0..50 {
            let places = place(&balls(60, 1.0), &BOX, 0.5, seed).unwrap();
            for (i, p) in places.iter().enumerate() {
                assert!((*p - DVec3::new(0.0, -10.0, 0.0)).abs().cmple(DVec3::new(9.0, 9.0, 4.0)).all(), "{p}");
                for q in &places[..i] {
                    assert!((*p - *q).length() >= 2.5, "seed {seed}: {p} and {q}");
                }
            }
            assert_eq!(place(&balls(20, 1.0), &BOX, 0.5, seed).unwrap(), places[..20]);
            assert_ne!(place(&balls(20, 1.0), &BOX, 0.5, seed + 50).unwrap(), places[..20]);
        }
        let below = Region::Below { low: [0.0, 0.0], high: [30.0, 20.0], top: 3.0 };
        assert!(place(&balls(9, 1.0), &below, 0.0, 1).unwrap().iter().all(|p| p.z == 1.5));
        assert_eq!(place(&[], &BOX, 0.0, 1), Ok(Vec::new()));
    }

    /// Single places are even over the region: mean and mean square of each coordinate in units of half its range, within 4.5 standard
    /// errors (1/3 and 4/45 are the variances of u and u^2).
    #[test]
    fn places_are_even() {
        let n = 4000;
        let places: Vec<DVec3> = (0..n).map(|seed| place(&balls(1, 1.0), &BOX, 0.0, seed).unwrap()[0]).collect();
        let scaled = places.iter().map(|p| (*p - DVec3::new(0.0, -10.0, 0.0)) / DVec3::new(9.0, 9.0, 4.0));
        let (sum, square) = scaled.fold((DVec3::ZERO, DVec3::ZERO), |(sum, square), u| (sum + u, square + u * u));
        let n = n as f64;
        assert!((sum / n).abs().max_element() < 4.5 * (1.0 / 3.0 / n).sqrt(), "{}", sum / n);
        assert!((square / n - 1.0 / 3.0).abs().max_element() < 4.5 * (4.0 / 45.0 / n).sqrt(), "{}", square / n);
    }

    /// A full box says how many it holds; what is wider than the region has no place at all.
    #[test]
    fn what_does_not_fit_is_said() {
        let full = place(&balls(900, 1.0), &BOX, 0.0, 1).unwrap_err();
        // The jammed state of random sequential addition holds 38 % of a large volume; walls and 1000 tries leave less.
        let share = full.placed as f64 * 4.0 / 3.0 * std::f64::consts::PI / 4000.0;
        assert!(!full.too_large && (0.2..0.38).contains(&share), "{full:?}: {share}");
        assert_eq!(place(&balls(3, 6.0), &BOX, 0.0, 1), Err(Stuck { placed: 0, too_large: true }));
    }

    /// Turned spheroids and rods: no point of a surface lies in another body, nor nearer than the distance (looked at from 400 sides).
    #[test]
    fn other_bodies_keep_their_distance() {
        let body = |i: u32| {
            let u = |k: u32| unit_of(i, k, 5);
            let frame = Frame::turned(DVec3::ZERO, [360.0 * u(0), 360.0 * u(1), 0.0]);
            if i.is_multiple_of(2) {
                Body::Ellipsoid { radii: DVec3::new(0.5 + u(2), 1.0, 2.0), frame }
            } else {
                Body::Cylinder { radius: 0.7, half_length: 1.0 + u(2), axis: frame.direction_out(DVec3::Z) }
            }
        };
        let bodies: Vec<Wanted> = (0..30).map(|i| Wanted { body: body(i), depth: 0.0 }).collect();
        let places = place(&bodies, &BOX, 0.3, 9).unwrap();
        let sides: Vec<DVec3> = (0..400)
            .map(|i| {
                let (z, turn) = (1.0 - (2.0 * f64::from(i) + 1.0) / 400.0, 2.399_963 * f64::from(i));
                DVec3::new(turn.cos(), turn.sin(), 0.0) * (1.0 - z * z).sqrt() + DVec3::new(0.0, 0.0, z)
            })
            .collect();
        for (i, (a, p)) in bodies.iter().zip(&places).enumerate() {
            for (b, q) in bodies.iter().zip(&places).take(i) {
                // The gap between two convex bodies is the largest over all directions.
                let gap = |n: &DVec3| (*q - *p).dot(*n) - a.body.farthest(*n).dot(*n) + b.body.farthest(-*n).dot(*n);
                let gap = sides.iter().map(gap).fold(f64::NEG_INFINITY, f64::max);
                // Directions are 0.1 rad from the best one at most: that takes up to 1 - cos(0.1) of 10 mm.
                assert!(gap > 0.3 - 0.05, "{p} and {q}: {gap} mm");
            }
        }
    }
}
