//! One integrating sphere: wall, ports, baffle, and the short neck between its wall and the sample.

use glam::DVec3;

use crate::opening::{Opening, Outline};

/// What light may meet beside the wall.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Port {
    Sample,
    Entrance,
    Exit,
    Detector,
}

/// A thin round plate inside a sphere, white on both sides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Baffle {
    pub center: DVec3,
    /// Unit vector.
    pub normal: DVec3,
    pub radius: f64,
}

/// A hollow sphere about the origin; the sample lies below its port in the plane z = -`plane`. All diffuse surfaces obey the cosine law.
#[derive(Clone, Debug, PartialEq)]
pub struct Sphere {
    pub radius: f64,
    /// Of wall, neck and baffle; in [0, 1].
    pub reflectance: f64,
    /// Distance of the sample's face from the centre.
    pub plane: f64,
    pub sample: Opening,
    /// All other ports.
    pub ports: Vec<(Port, Opening)>,
    pub baffle: Option<Baffle>,
    /// Whether the detector takes light that comes straight from the sample or its neck.
    pub sees_sample: bool,
}

impl Sphere {
    /// Distance from the centre to the point of a port's rim that is farthest along its axis.
    pub fn rim(radius: f64, outline: Outline) -> f64 {
        let (Outline::Round { radius: near } | Outline::Square { half: near }) = outline;
        (radius * radius - near * near).sqrt()
    }

    /// Share of the sphere's surface that is wall.
    pub fn wall_fraction(&self) -> f64 {
        self.ports.iter().fold(1.0 - self.sample.fraction, |rest, (_, port)| rest - port.fraction)
    }

    pub fn port_fraction(&self, port: Port) -> f64 {
        if port == Port::Sample {
            return self.sample.fraction;
        }
        self.ports.iter().filter(|(name, _)| *name == port).fold(0.0, |sum, (_, opening)| sum + opening.fraction)
    }

    /// The detector's port.
    pub fn detector(&self) -> Option<&Opening> {
        self.ports.iter().find(|(name, _)| *name == Port::Detector).map(|(_, opening)| opening)
    }

    /// The port that holds the point `r` of the sphere.
    pub fn port_at(&self, r: DVec3) -> Option<Port> {
        if self.sample.holds(r) {
            return Some(Port::Sample);
        }
        self.ports.iter().find(|(_, opening)| opening.holds(r)).map(|(name, _)| *name)
    }

    /// Where a ray from a point inside meets the sphere.
    pub fn far(&self, r: DVec3, u: DVec3) -> DVec3 {
        let b = r.dot(u);
        let c = r.length_squared() - self.radius * self.radius;
        let met = r + (-b + (b * b - c).max(0.0).sqrt()) * u;
        // Back onto the sphere: rounding would drift over hundreds of bounces.
        met * (self.radius / met.length())
    }

    /// Distance to the baffle along a ray, below `within`.
    pub fn to_baffle(&self, r: DVec3, u: DVec3, within: f64) -> Option<f64> {
        let baffle = self.baffle.as_ref()?;
        let slope = u.dot(baffle.normal);
        let distance = (baffle.center - r).dot(baffle.normal) / slope;
        // A ray that starts on the baffle is at 0; NaN, for a ray in its plane, fails.
        if !(distance > 1e-9 * self.radius && distance < within) {
            return None;
        }
        ((r + distance * u - baffle.center).length_squared() < baffle.radius * baffle.radius).then_some(distance)
    }

    /// Whether nothing stands between two points inside.
    pub fn sees(&self, a: DVec3, b: DVec3) -> bool {
        let way = b - a;
        self.to_baffle(a, way, 1.0).is_none()
    }
}
