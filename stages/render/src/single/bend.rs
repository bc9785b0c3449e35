//! Connections by one refraction: through one plane between the medium and the projector, in f32 lanes.
//!
//! `Walker::connect` for worlds in which that plane is all there is between what scatters and the light; `docs/theory/render.md` derives the irradiance.

use fearless_simd::prelude::*;
use glam::DVec3;
use turbid_optics::PhaseFunction;
use turbid_optics::refraction::refract;

use super::ground::Part;
use super::lane::{F, M, V, choose, splat};
use super::limits::DARK;
use crate::lengths::MOST_LENGTHS;
use crate::strata::{self, Bending};
use crate::walker::Walker;

/// A horizontal plane between a layer, in which everything lies that scatters, and the light's, of lower refractive index.
#[derive(Clone, Copy, Debug)]
pub struct Plane {
    /// mm, local.
    pub z: f32,
    /// 1 where the light is above it, -1 where it is below.
    up: f32,
    /// Distance of the light, mm.
    height: f32,
    /// n of the layer over that of the light's.
    m: f32,
    /// m^2 - 1.
    excess: f32,
    /// n of the layer.
    n: f32,
    /// World z of the plane and of both ends of the layer, mm.
    edge: f64,
    pub layer: [f64; 2],
    /// n of the light's layer and of the other.
    indices: [f64; 2],
    /// How far behind the plane paths are put that start on it, mm: so little of a free path that light does not see it.
    behind: f64,
    /// Whether light may come by reflections between the ends of the layer.
    pub scalar_connections: bool,
}

/// Where flights come to the plane from within the layer.
pub struct Meeting<S: Simd> {
    /// mm; any number for those that go away from it.
    pub distance: F<S>,
    pub towards: M<S>,
    /// Just below it.
    pub place: V<S>,
    /// Fresnel's, for unpolarised light.
    pub reflectance: F<S>,
}

/// A camera's ray that comes through the plane, or into a body.
pub enum Entrance {
    /// It goes on like this, from this place.
    In(DVec3, DVec3),
    /// It is reflected.
    Out,
}

/// How light comes to points.
pub struct Refraction<S: Simd> {
    /// Unit vector from the point against it.
    pub towards: V<S>,
    /// mm to the plane.
    pub length: F<S>,
    /// Where it comes through the plane.
    pub foot: V<S>,
    /// Irradiance of a surface that faces it at the point, over n^2, over that of one at the foot that faces the light.
    pub gain: F<S>,
}

/// Newton's method needs two or three steps, some more where the light is nearer to the plane than the point.
const MOST_STEPS: usize = 24;
/// It doubles the digits: after a step of so much of t, what is left is some 1e-8.
const ENOUGH: f32 = 1e-4;

impl Plane {
    /// `None` where light does not bend, or not like this.
    pub fn of(walker: &Walker<'_>, parts: &[Part], origin: DVec3) -> Option<Self> {
        let Bending::AtPlanes(layers) = &walker.bending else { return None };
        let visible = |i: usize| {
            let (low, high) = strata::visible_bounds(parts[..i].iter().map(|part| &part.solid), &parts[i].solid);
            (low.z, high.z)
        };
        let (low, high) = (0..parts.len())
            .filter(|&i| parts[i].open)
            .map(visible)
            .filter(|(low, high)| low < high)
            .fold((f64::INFINITY, f64::NEG_INFINITY), |ends, (low, high)| (ends.0.min(low), ends.1.max(high)));
        let lamp = walker.setting().light.view.position.z;
        let (layer, up) = (layers.layer(low, true), lamp > high);
        let (edge, next) = layers.onward(layer, up)?;
        let (n, n_light) = (layers.layers[layer].n, layers.layers[next].n);
        let outside = layers.layer(high, false) != layer || layers.layer(lamp, !up) != next;
        if low >= high || outside || layers.layers[next].opaque || n < n_light {
            return None;
        }
        let end = |up: bool| layers.onward(layer, up).map_or(if up { f64::MAX } else { f64::MIN }, |(edge, _)| edge);
        let stands = |i: usize| {
            let (low, high) = visible(i);
            parts[i].material != 0 && low < high && if up { high > edge } else { low < edge }
        };
        // Bodies on the light's side would have to be looked past twice.
        if (0..parts.len()).any(stands) {
            return None;
        }
        let filled = || parts.iter().map(|part| &walker.setting().world.materials[part.material]);
        let in_layer = || filled().filter(|m| !m.is_opaque() && m.n == n);
        let layer = [end(false), end(true)];
        let thinnest = in_layer().map(|m| m.mu_t()).fold(f64::INFINITY, f64::min);
        let shortest = in_layer().map(|m| 1.0 / m.mu_t()).fold(f64::INFINITY, f64::min);
        let sign = if up { 1.0 } else { -1.0 };
        // Also in f32, whose last digit may be more.
        let behind = (1e-6 * shortest).max(4.0 * f64::from(f32::EPSILON) * (edge - origin.z).abs());
        Some(Self {
            edge,
            indices: [n_light, n],
            behind: sign * behind,
            scalar_connections: thinnest * (layer[1] - layer[0]) < f64::from(DARK),
            z: (edge - origin.z) as f32,
            up: if up { 1.0 } else { -1.0 },
            height: (lamp - edge).abs() as f32,
            m: (n / n_light) as f32,
            excess: ((n - n_light) * (n + n_light) / (n_light * n_light)) as f32,
            n: n as f32,
            layer,
        })
    }

    /// Where rays from within the layer come to the plane.
    #[inline(always)]
    pub fn meet<S: Simd>(&self, simd: S, r: V<S>, w: V<S>) -> Meeting<S> {
        let distance = (self.z - r.z) / w.z;
        let (x, y) = (r.x + distance * w.x, r.y + distance * w.y);
        let cos = w.z.abs();
        let sin2 = w.x * w.x + w.y * w.y;
        let cos2 = 1.0 - sin2 * (self.m * self.m);
        let out = cos2.max(splat(simd, 0.0)).sqrt();
        let s = (cos * self.m - out) / (cos * self.m + out);
        let p = (out * self.m - cos) / (out * self.m + cos);
        // Totally reflected, both are 1.
        Meeting {
            distance,
            towards: (w.z * self.up).simd_gt(splat(simd, 0.0)),
            place: V { x, y, z: splat(simd, self.z - self.behind as f32) },
            reflectance: choose(cos2.simd_gt(splat(simd, 0.0)), (s * s + p * p) * 0.5, splat(simd, 1.0)),
        }
    }

    /// A ray from the light's side at the plane, by a uniform random number. `None` where it does not come there.
    pub fn enter(&self, from: DVec3, along: DVec3, random: f64) -> Option<Entrance> {
        let distance = (self.edge - from.z) / along.z;
        let up = f64::from(self.up);
        if (from.z - self.edge) * up <= 0.0 || along.z * up >= 0.0 {
            return None;
        }
        let refraction = refract(along, DVec3::Z, self.indices[0], self.indices[1]);
        let Some(refracted) = refraction.refracted.filter(|_| random >= refraction.reflectance) else {
            return Some(Entrance::Out);
        };
        let place = from + distance * along;
        Some(Entrance::In(place.with_z(self.edge - self.behind), refracted))
    }

    /// With t the tangent on the light's side, H the light's height above the plane, d the point's depth below and m = n / n_light,
    /// the advance sideways is t (H + d / q), q^2 = m^2 + (m^2 - 1) t^2.
    #[inline(always)]
    pub fn refraction<S: Simd>(&self, simd: S, light: [f32; 3], p: V<S>) -> Refraction<S> {
        let (zero, height, m2) = (splat(simd, 0.0), self.height, self.m * self.m);
        let (x, y) = (light[0] - p.x, light[1] - p.y);
        let advance = (x * x + y * y).sqrt();
        let sideways = choose(advance.simd_gt(zero), 1.0 / advance, zero);
        let depth = ((self.z - p.z) * self.up).max(zero);
        let above = splat(simd, height);
        let t = tangent(simd, advance, (depth, above), self.m, self.excess);
        let (q, reach, slope) = advanced(t, (depth, above), (m2, self.excess));
        let inverse = 1.0 / (self.m * (t * t + 1.0).sqrt());
        let (sin, cos) = (t * inverse * sideways, q * inverse);
        // 1 - R from what passes of both polarisations, not from what is reflected: all digits at grazing angles.
        let (a, b) = (q + 1.0, q + m2);
        let transmitted = q * 2.0 * (1.0 / (a * a) + m2 / (b * b));
        let aside = depth * t / q * sideways;
        Refraction {
            towards: V { x: x * sin, y: y * sin, z: cos * self.up },
            length: depth / cos,
            foot: V { x: p.x + x * aside, y: p.y + y * aside, z: splat(simd, self.z) },
            gain: transmitted * (height * height * self.m / (self.n * self.n)) / (q * reach * slope),
        }
    }
}

/// q, the advance sideways over t, and its derivative by t; see [`Plane::refraction`].
#[inline(always)]
pub fn advanced<S: Simd>(t: F<S>, (depth, height): (F<S>, F<S>), (m2, excess): (f32, f32)) -> (F<S>, F<S>, F<S>) {
    let q2 = t * t * excess + m2;
    let q = q2.sqrt();
    let reach = depth / q;
    (q, reach + height, reach * m2 / q2 + height)
}

/// The tangent t on the light's side with which light advances so far sideways; see [`Plane::refraction`].
#[inline(always)]
pub fn tangent<S: Simd>(simd: S, advance: F<S>, (depth, height): (F<S>, F<S>), m: f32, excess: f32) -> F<S> {
    let mut t = advance / (depth * (1.0 / m) + height);
    let mut open = M::splat(simd, true);
    for _ in 0..MOST_STEPS {
        let (_, reach, slope) = advanced(t, (depth, height), (m * m, excess));
        let step = (advance - t * reach) / slope;
        // Each lane stops by itself: its neighbours must not show.
        t = choose(open, t + step, t);
        open &= step.abs().simd_gt(t * ENOUGH);
        if open.all_false() {
            break;
        }
    }
    t
}

/// A point for which the scalar walker finds connections that lanes do not know: those with reflections, or by several interfaces.
#[derive(Clone, Copy, Debug)]
pub struct ScalarConnection {
    /// Of the random numbers of its estimate.
    pub number: u32,
    pub sample: u32,
    pub pixel: u32,
    pub path: u32,
    pub r: [f32; 3],
    /// Unit vector along which the path comes to it.
    pub e: [f32; 3],
    pub phase: PhaseFunction,
    /// Of what is scattered there.
    pub fraction: f32,
    /// mm up to it in each medium that tells channels apart.
    pub lengths: [f32; MOST_LENGTHS + 1],
    /// Of the estimate on its ray.
    pub place: u32,
    pub found: FoundInLanes,
    /// With which probability it is tried, if one connection is known.
    pub others: f32,
}

/// What lanes know of the connections of a point.
#[derive(Clone, Copy, Debug)]
pub enum FoundInLanes {
    /// One by one refraction, or the best of them.
    Known(KnownConnection),
    /// None by one refraction; among facets none that they have looked for.
    Nothing,
    /// They do not know.
    Unsure,
}

/// Of a connection that lanes have found.
#[derive(Clone, Copy, Debug)]
pub struct KnownConnection {
    /// What it brings, in units of the projector's.
    pub strength: f32,
    /// Unit vectors: against it at the point, and out of its interface.
    pub towards: [f32; 3],
    pub normal: [f32; 3],
    /// Whether that is a facet: then lanes have looked for no other one, else for all but facets.
    pub by_facet: bool,
}

#[cfg(test)]
mod tests {
    use super::super::lane::LANES;
    use super::*;
    use fearless_simd::dispatch;
    use turbid_optics::refraction::{Crossing, Leg};

    fn plane(height: f32, up: f32, m: f32) -> Plane {
        let excess = (f64::from(m) * f64::from(m) - 1.0) as f32;
        Plane {
            z: 0.25,
            up,
            height,
            m,
            excess,
            n: m,
            edge: 0.25,
            layer: [0.0; 2],
            indices: [1.0, f64::from(m)],
            behind: 0.0,
            scalar_connections: true,
        }
    }

    /// Of each lane: direction, length, foot, gain.
    #[inline(always)]
    fn refractions<S: Simd>(simd: S, plane: Plane, light: [f32; 3], points: [[f32; 3]; LANES]) -> [[f32; 8]; LANES] {
        let axis = |i: usize| F::load_array(simd, points.map(|p| p[i]));
        let refraction = plane.refraction(simd, light, V { x: axis(0), y: axis(1), z: axis(2) });
        let (towards, foot) = (refraction.towards, refraction.foot);
        let columns = [towards.x, towards.y, towards.z, refraction.length, foot.x, foot.y, foot.z, refraction.gain];
        std::array::from_fn(|lane| columns.map(|column| column.as_slice()[lane]))
    }

    /// Against the f64 solution for the same f32 inputs, from the plane to far below it, upright to grazing, light far and near, up and
    /// down: direction to 5e-7, foot to as much of the advance, gain to 2e-6 (some ten roundings of 6e-8 each, and 1e-8 of Newton's).
    #[test]
    fn connections_are_those_of_the_scalar_walker() {
        let depths = [0.0, 1e-4, 0.03, 0.7, 5.0, 40.0, 900.0, 5e3];
        for (m, height, up) in [1.0_f32, 1.01, 1.4, 2.5]
            .into_iter()
            .flat_map(|m| [500.0, 20.0, 0.5].into_iter().flat_map(move |height| [1.0, -1.0].map(|up| (m, height, up))))
        {
            for advance in [0.0_f32, 1e-3, 0.4, 35.0, 600.0, 2e4] {
                let position = [3.0, -2.0, 0.25 + up * height];
                let plane = plane(height, up, m);
                let points: [[f32; 3]; LANES] = std::array::from_fn(|i| {
                    let turn = i as f32;
                    [3.0 + advance * turn.cos(), -2.0 + advance * turn.sin(), 0.25 - up * depths[i % depths.len()]]
                });
                let found = dispatch!(crate::level::named(""), simd => simd.vectorize(
                    #[inline(always)]
                    || refractions(simd, plane, position, points)
                ));
                for (p, found) in points.iter().zip(found) {
                    let [x, y] = [0, 1].map(|i| f64::from(position[i]) - f64::from(p[i]));
                    let (depth, rho) = (f64::from((0.25 - p[2]) * up), x.hypot(y));
                    let (height, m) = (f64::from(height), f64::from(m));
                    let legs = [Leg { n: m, depth }, Leg { n: 1.0, depth: height }];
                    let refraction = Crossing::new(legs.into_iter(), rho).expect("it gets there");
                    let along = if rho > 0.0 { [x / rho, y / rho] } else { [0.0; 2] };
                    let (sin, cos) = (refraction.sin(m), refraction.cos(m));
                    let aside = depth * refraction.tan(m);
                    let distance = height / refraction.cos(1.0);
                    let gain = distance * distance * refraction.spread(1.0, m) * (1.0 - refraction.reflectance(m, 1.0))
                        / (m * m);
                    let case = format!("m {m}, height {height}, up {up}, point {p:?}: {found:?}");
                    let near = |i: usize, expected: f64, tolerance: f64| {
                        assert!((f64::from(found[i]) - expected).abs() <= tolerance, "{case}: {i} is {expected}");
                    };
                    near(0, sin * along[0], 5e-7);
                    near(1, sin * along[1], 5e-7);
                    near(2, cos * f64::from(up), 5e-7);
                    near(3, depth / cos, 1e-6 * depth / cos);
                    near(4, f64::from(p[0]) + aside * along[0], 5e-7 * (aside + f64::from(p[0].abs())));
                    near(5, f64::from(p[1]) + aside * along[1], 5e-7 * (aside + f64::from(p[1].abs())));
                    near(7, gain, 2e-6 * gain);
                }
            }
        }
    }
}
