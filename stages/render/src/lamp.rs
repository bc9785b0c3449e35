//! Steady lights: what no pattern modulates, and every frame gets in full.

use std::f64::consts::PI;

use glam::DVec3;
use turbid_optics::elementary::sin_cos_turns;

use crate::light::{Arrival, Light};

/// A light at a place or in a direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Lamp {
    /// `intensity` in W/sr.
    Point { position: DVec3, intensity: f64 },
    /// The same inside a cone; sine and cosine of its half angle.
    Spot { position: DVec3, axis: DVec3, half: (f64, f64), intensity: f64 },
    /// A parallel beam along `along` that starts on a disc; `irradiance` across it, W mm^-2.
    Beam { center: DVec3, along: DVec3, radius: f64, irradiance: f64 },
}

/// All steady lights of a channel.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Steady {
    pub lamps: Vec<Lamp>,
    /// Radiance that comes in from infinity, W mm^-2 sr^-1.
    pub ambient: f64,
}

impl Steady {
    pub const NONE: Self = Self { lamps: Vec::new(), ambient: 0.0 };

    /// Whether there is any.
    pub fn shines(&self) -> bool {
        !self.lamps.is_empty() || self.ambient > 0.0
    }
}

impl Lamp {
    pub fn point(position: DVec3, power: f64) -> Self {
        Self::Point { position, intensity: power / (4.0 * PI) }
    }

    /// A cone of the full angle `angle_deg` in (0, 360) around the direction `axis`, a unit vector.
    pub fn spot(position: DVec3, axis: DVec3, angle_deg: f64, power: f64) -> Self {
        let (sin_quarter, _) = sin_cos_turns(angle_deg / 1440.0);
        // 2 pi (1 - cos(half)), also right for narrow cones.
        let solid_angle = 4.0 * PI * sin_quarter * sin_quarter;
        Self::Spot { position, axis, half: sin_cos_turns(angle_deg / 720.0), intensity: power / solid_angle }
    }

    /// A beam of `power` W through the disc around `center`, along the unit vector `along`.
    pub fn beam(center: DVec3, along: DVec3, diameter: f64, power: f64) -> Self {
        let radius = 0.5 * diameter;
        Self::Beam { center, along, radius, irradiance: power / (PI * radius * radius) }
    }

    /// Unit vector from `p` to the light, and how far away it is, mm.
    #[inline]
    pub fn towards(&self, p: DVec3) -> (DVec3, f64) {
        match *self {
            Self::Point { position, .. } | Self::Spot { position, .. } => {
                let d = position - p;
                let distance = d.length();
                (d / distance, distance)
            }
            Self::Beam { center, along, .. } => (-along, (p - center).dot(along)),
        }
    }

    /// What arrives at `p` if nothing stands in the way; `None` outside cone and beam.
    #[inline]
    pub fn arrival(&self, p: DVec3) -> Option<Arrival> {
        let (towards, distance) = self.towards(p);
        let (lit, irradiance) = match *self {
            Self::Point { intensity, .. } => (true, intensity / (distance * distance)),
            Self::Spot { axis, half: (sin_half, cos_half), intensity, .. } => {
                // sin(theta - half) <= 0, with all digits for narrow cones and right for those wider than a half-space.
                let (sin, cos) = (towards.cross(axis).length(), -towards.dot(axis));
                (sin * cos_half <= cos * sin_half, intensity / (distance * distance))
            }
            Self::Beam { center, along, radius, irradiance } => {
                let off = p - center;
                ((off - off.dot(along) * along).length() <= radius, irradiance)
            }
        };
        // No pattern plane; false for a point at the light itself, too.
        (lit && distance > 0.0).then_some(Arrival { towards, distance, irradiance, on_plane: p })
    }
}

/// A light to connect to.
#[derive(Clone, Copy, Debug)]
pub enum Source<'a> {
    Projector(&'a Light),
    /// With its place in [`Steady::lamps`].
    Lamp(usize, &'a Lamp),
}

impl Source<'_> {
    /// A number for each.
    pub fn place(&self) -> usize {
        match self {
            Self::Projector(_) => 0,
            Self::Lamp(i, _) => i + 1,
        }
    }

    /// Where it is, and its direction where that is the same everywhere.
    pub fn origin(&self) -> (DVec3, Option<DVec3>) {
        match self {
            Self::Projector(light) => (light.view.position, None),
            Self::Lamp(_, Lamp::Point { position, .. } | Lamp::Spot { position, .. }) => (*position, None),
            Self::Lamp(_, Lamp::Beam { center, along, .. }) => (*center, Some(*along)),
        }
    }

    #[inline]
    pub fn towards(&self, p: DVec3) -> (DVec3, f64) {
        match self {
            Self::Projector(light) => light.towards(p),
            Self::Lamp(_, lamp) => lamp.towards(p),
        }
    }

    #[inline]
    pub fn arrival(&self, p: DVec3) -> Option<Arrival> {
        match self {
            Self::Projector(light) => light.arrival(p),
            Self::Lamp(_, lamp) => lamp.arrival(p),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The flux through a large sphere (point, spot) or across the beam is the power: midpoint rule in cos(theta) and phi around a
    /// point off the axes. What the rule misses is the part of a cell that a cone's edge cuts: 4 / n for n = 400 rings.
    #[test]
    fn the_flux_is_the_power() {
        let (at, axis) = (DVec3::new(1.0, -2.0, 3.0), DVec3::new(2.0, 3.0, -6.0) / 7.0);
        let lamps = [Lamp::point(at, 2.0), Lamp::spot(at, axis, 40.0, 2.0), Lamp::spot(at, axis, 250.0, 2.0)];
        let n = 400;
        for lamp in lamps {
            let mut flux = 0.0;
            for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
                let (cos, turns) = (2.0 * (f64::from(i) + 0.5) / f64::from(n) - 1.0, f64::from(j) / f64::from(n));
                let (s, c) = sin_cos_turns(turns);
                let w = DVec3::new((1.0 - cos * cos).sqrt() * c, (1.0 - cos * cos).sqrt() * s, cos);
                let arrival = lamp.arrival(at + 50.0 * w);
                flux += arrival.map_or(0.0, |a| a.irradiance) * 2500.0 * 4.0 * PI / f64::from(n * n);
            }
            assert!((flux / 2.0 - 1.0).abs() < 4.0 / f64::from(n), "{lamp:?}: {flux} W");
        }
        let beam = Lamp::beam(at, axis, 4.0, 2.0);
        let arrival = beam.arrival(at + 30.0 * axis).expect("on its axis");
        assert!((arrival.irradiance * PI * 4.0 - 2.0).abs() < 1e-14);
        assert!((arrival.distance - 30.0).abs() < 1e-12 && (arrival.towards + axis).length() < 1e-15);
        let across = axis.any_orthonormal_vector();
        assert!(
            beam.arrival(at + axis + 1.999 * across).is_some() && beam.arrival(at + axis + 2.001 * across).is_none()
        );
        assert!(beam.arrival(at - axis).is_none(), "behind its disc");
    }

    /// The edge of a cone of one milliradian lies where it should to 1e-9 of its width.
    #[test]
    fn narrow_cones_keep_their_edge() {
        let angle_deg = 0.1;
        let lamp = Lamp::spot(DVec3::ZERO, DVec3::Z, angle_deg, 1.0);
        let edge = libm::tan((0.5 * angle_deg).to_radians());
        for (factor, lit) in [(1.0 - 1e-9, true), (1.0 + 1e-9, false)] {
            assert_eq!(lamp.arrival(DVec3::new(0.0, 1000.0 * edge * factor, 1000.0)).is_some(), lit, "{factor}");
        }
    }
}
