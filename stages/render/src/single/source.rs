//! Lights that lanes connect to: the projector, and lamps where their light comes straight.

use fearless_simd::prelude::*;
use glam::DVec3;

use super::lane::{F, M, U, V, splat};
use super::limits::{FIRST, MOST_CHANNELS, TURNED};
use crate::lamp::{Lamp, Steady};
use crate::lengths::Shared;
use crate::light::{Emission, Light};
use crate::random::{ENTERED, WHETHER_PROJECTED, first_of_lamp, of_lamp};

/// A light about the local origin.
#[derive(Clone, Copy, Debug)]
pub struct Source {
    /// mm; of a beam the foot of its axis.
    pub position: [f32; 3],
    kind: Kind,
    /// mm^2, by the square of the distance the irradiance in units of that of its channel; of a beam that irradiance.
    strength: f32,
    /// Its number, as of `lamp::Source::place`: 0 is the projector.
    place: usize,
    /// Of the response of each channel that it is part of, over that of the first.
    pub scales: [f32; MOST_CHANNELS],
}

#[derive(Clone, Copy, Debug)]
enum Kind {
    Projector(Field),
    Point,
    /// Unit vector along its axis, sine and cosine of half its angle.
    Spot {
        axis: [f32; 3],
        half: [f32; 2],
    },
    /// Unit vector along it, mm along it from its foot to its disc, and the square of its radius.
    Beam {
        along: [f32; 3],
        start: f32,
        radius_squared: f32,
    },
}

/// What a projector lights.
#[derive(Clone, Copy, Debug)]
pub struct Field {
    /// z of its plane.
    plane: f32,
    /// Its centre, x and y.
    center: [f32; 2],
    /// Unit vectors along its sides, x and y, and half their lengths, mm.
    right: [f32; 2],
    top: [f32; 2],
    half: [f32; 2],
    /// Whether irradiance is even on the plane, not intensity.
    flat: bool,
}

/// What arrives at points if nothing stands in its way.
pub struct Arrival<S: Simd> {
    /// In units of its channel's.
    pub irradiance: F<S>,
    /// Whether they are inside field, cone or beam.
    pub lit: M<S>,
    /// Where on the pattern's plane, of a projector.
    pub x: F<S>,
    pub y: F<S>,
}

impl Source {
    /// The projector, and the irradiance (W mm^-2) that is its unit.
    pub fn projector(light: &Light, origin: DVec3) -> (Self, f64) {
        let view = &light.view;
        let (strength, flat) = match light.emission {
            Emission::Intensity(i) => (i, false),
            Emission::Irradiance(e) => (e * view.height() * view.height(), true),
        };
        let center = view.look_at - origin;
        let reach = (view.position - view.look_at).length_squared();
        let flat_unit = |v: DVec3| [v.x as f32, v.y as f32];
        let field = Field {
            plane: center.z as f32,
            center: flat_unit(center),
            right: flat_unit(view.right),
            top: flat_unit(view.top),
            half: [0.5 * view.field.x as f32, 0.5 * view.field.y as f32],
            flat,
        };
        let source = Self {
            position: (view.position - origin).as_vec3().to_array(),
            kind: Kind::Projector(field),
            strength: reach as f32,
            place: 0,
            // Its channels have units of their own.
            scales: [1.0; MOST_CHANNELS],
        };
        (source, strength / reach)
    }

    /// Lamps, and the irradiance (W mm^-2) that is the unit of all of them: what one estimate sees of them is one sum.
    pub fn lamps(steady: &Steady, shared: Option<&Shared>, origin: DVec3) -> (Vec<Self>, f64) {
        // (W mm^-2 there, mm^2), there being 1 mm away at least.
        let strength = |lamp: &Lamp| match *lamp {
            Lamp::Point { position, intensity } | Lamp::Spot { position, intensity, .. } => {
                let reach = (position - origin).length_squared().max(1.0);
                (intensity / reach, reach)
            }
            Lamp::Beam { irradiance, .. } => (irradiance, 1.0),
        };
        let unit = steady.lamps.iter().map(|lamp| strength(lamp).0).fold(f64::MIN_POSITIVE, f64::max);
        let of = |(i, lamp): (usize, &Lamp)| {
            let local = |p: DVec3| (p - origin).as_vec3().to_array();
            let (position, kind) = match *lamp {
                Lamp::Point { position, .. } => (local(position), Kind::Point),
                Lamp::Spot { position, axis, half: (sin, cos), .. } => {
                    (local(position), Kind::Spot { axis: axis.as_vec3().to_array(), half: [sin as f32, cos as f32] })
                }
                Lamp::Beam { center, along, radius, .. } => {
                    // Near the origin its axis keeps its digits, however far away it begins.
                    let foot = center - (center - origin).dot(along) * along;
                    let kind = Kind::Beam {
                        along: along.as_vec3().to_array(),
                        start: (center - foot).dot(along) as f32,
                        radius_squared: (radius * radius) as f32,
                    };
                    (local(foot), kind)
                }
            };
            let (irradiance, reach) = strength(lamp);
            let scale = |channel: usize| shared.and_then(|s| s.channels.get(channel)).map_or(1.0, |s| s.lamps[i]);
            Self {
                position,
                kind,
                strength: (reach * (irradiance / unit)) as f32,
                place: i + 1,
                scales: std::array::from_fn(|channel| scale(channel) as f32),
            }
        };
        (steady.lamps.iter().enumerate().map(of).collect(), unit)
    }

    pub fn is_lamp(&self) -> bool {
        self.place > 0
    }

    /// Unit vectors from points against the light, and how far off it is.
    #[inline(always)]
    pub fn towards<S: Simd>(&self, p: V<S>) -> (V<S>, F<S>) {
        let simd = p.x.token();
        if let Kind::Beam { along, start, .. } = self.kind {
            let [x, y, z] = along.map(|x| splat(simd, -x));
            let against = V { x, y, z };
            return (against, -against.dot(p.from(self.position)) - start);
        }
        let d = p.from(self.position).times(splat(simd, -1.0));
        let distance = d.dot(d).sqrt();
        (d.times(1.0 / distance), distance)
    }

    #[inline(always)]
    pub fn arrives<S: Simd>(&self, simd: S, p: V<S>) -> Arrival<S> {
        let (towards, distance) = self.towards(p);
        let strength = splat(simd, self.strength);
        let even = strength / (distance * distance);
        let (zero, apart) = (splat(simd, 0.0), distance.simd_gt(0.0));
        match &self.kind {
            Kind::Projector(field) => {
                // Along the ray from the light by what the plane is away from p: no digits are lost where that is little.
                let d = p.from(self.position);
                let f = (field.plane - p.z) / d.z;
                let (x, y) = (p.x + f * d.x, p.y + f * d.y);
                let (u, v) = field.place(x, y);
                let inside = u.abs().simd_le(field.half[0]) & v.abs().simd_le(field.half[1]);
                // Behind the light 1 + f < 0.
                let ahead = (1.0 + f).simd_gt(0.0) & f.abs().simd_lt(f32::INFINITY);
                let strength = if field.flat {
                    // On the plane E = I cos / R^2 with R = h / cos.
                    let cos = towards.z.abs();
                    strength / (cos * cos * cos)
                } else {
                    strength
                };
                Arrival { irradiance: strength / (distance * distance), lit: ahead & inside, x, y }
            }
            Kind::Point => Arrival { irradiance: even, lit: apart, x: zero, y: zero },
            &Kind::Spot { axis: [a, b, c], half: [sin_half, cos_half] } => {
                // sin(theta - half) <= 0, right for narrow cones and for those wider than a half-space.
                let cross = V {
                    x: towards.y * c - towards.z * b,
                    y: towards.z * a - towards.x * c,
                    z: towards.x * b - towards.y * a,
                };
                let (sin, cos) = (cross.dot(cross).sqrt(), -(towards.x * a + towards.y * b + towards.z * c));
                let inside = (sin * cos_half).simd_le(cos * sin_half);
                Arrival { irradiance: even, lit: inside & apart, x: zero, y: zero }
            }
            Kind::Beam { radius_squared, start, .. } => {
                let off = p.from(self.position).plus(distance + *start, towards);
                let inside = off.dot(off).simd_le(*radius_squared);
                Arrival { irradiance: strength, lit: inside & apart, x: zero, y: zero }
            }
        }
    }

    /// Where random numbers of connections to it stand, number and word without the channel (`random.rs`): of such as are `first` along a camera's ray, whose
    /// number is `start`, such as are from where a flight comes in, and all others.
    #[inline(always)]
    pub fn numbers<S: Simd>(&self, simd: S, number: U<S>, start: u32, first: M<S>, entry: M<S>) -> (U<S>, U<S>) {
        let (word, low) = (|x: u32| U::splat(simd, x), number & (TURNED - 1));
        if self.place == 0 {
            let ahead = entry.select(word(ENTERED), word(0));
            return (first.select(word(start), low), first.select(number & (FIRST - 1), ahead));
        }
        let lamp = self.place - 1;
        (low, first.select(word(first_of_lamp(lamp)), word(of_lamp(lamp))))
    }
}

/// Word without the channel of the numbers that say whether more connections to the projector are tried, at a place on a ray.
#[inline(always)]
pub fn whether_projected<S: Simd>(simd: S, place: U<S>) -> U<S> {
    (place << 8) | U::splat(simd, WHETHER_PROJECTED)
}

impl Field {
    /// mm from its centre along its sides.
    #[inline(always)]
    pub fn place<S: Simd>(&self, x: F<S>, y: F<S>) -> (F<S>, F<S>) {
        let (u, v) = (x - self.center[0], y - self.center[1]);
        (u * self.right[0] + v * self.right[1], u * self.top[0] + v * self.top[1])
    }
}
