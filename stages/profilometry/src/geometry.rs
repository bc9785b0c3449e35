//! Where light of a known pattern coordinate, seen by a known pixel, was: rays of the camera against planes of the projector.

use glam::DVec3;
use turbid_contract::payload::Scene;
use turbid_geometry::{camera_view, projector_view};
use turbid_optics::view::{View, ViewError};

/// A camera, a projector and the direction in which the pattern varies.
pub struct Rig {
    pub camera: View,
    pub projector: View,
    pub columns: usize,
    pub rows: usize,
    /// Unit vector in the plane of the pattern: its coordinate is u = x . along.
    pub along: DVec3,
}

/// A place on a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    pub r: DVec3,
    /// d z / d u at fixed pixel.
    pub dz_du: f64,
    /// Sine of the angle between the camera's ray and the projector's plane of constant u.
    pub sine: f64,
}

impl Rig {
    /// Error: what the scene lacks.
    pub fn new(scene: &Scene, orientation_deg: f64) -> Result<Self, String> {
        let lacks = |what: &str| format!("the scene has no {what}: heights are read from a camera and a projector");
        let c = scene.camera.as_ref().ok_or_else(|| lacks("camera"))?;
        let p = scene.projector.as_ref().ok_or_else(|| lacks("projector"))?;
        let named = |what: &str, e: ViewError| format!("the {what} of the scene is no view: {e:?}");
        let (sin, cos) = turbid_optics::elementary::sin_cos_turns(orientation_deg / 360.0);
        Ok(Self {
            camera: camera_view(c).map_err(|e| named("camera", e))?,
            projector: projector_view(p).map_err(|e| named("projector", e))?,
            columns: c.pixels[0] as usize,
            rows: c.pixels[1] as usize,
            along: DVec3::new(cos, sin, 0.0),
        })
    }

    /// Signed baseline along the pattern's direction, mm.
    pub fn baseline(&self) -> f64 {
        (self.projector.position - self.camera.position).dot(self.along)
    }

    /// Distance between camera and projector across world z, mm: the baseline of the best orientation.
    pub fn apart(&self) -> f64 {
        (self.projector.position - self.camera.position).truncate().length()
    }

    /// World z of the pattern's plane.
    pub fn plane(&self) -> f64 {
        self.projector.look_at.z
    }

    /// Origin and unit vector of the ray through a pixel's centre.
    pub fn ray(&self, pixel: usize) -> (DVec3, DVec3) {
        let (column, row) = ((pixel % self.columns) as f64, (pixel / self.columns) as f64);
        self.camera.ray((column + 0.5) / self.columns as f64, (row + 0.5) / self.rows as f64)
    }

    /// The point of the plane world z = `height` that the pixel sees; `None` where its ray does not reach it.
    pub fn on_plane(&self, pixel: usize, height: f64) -> Option<DVec3> {
        let (origin, w) = self.ray(pixel);
        let t = (height - origin.z) / w.z;
        (t > 0.0 && t < f64::INFINITY).then(|| origin + t * w)
    }

    /// The pattern's coordinate u (mm in its plane) of the light that reaches `r`.
    pub fn coordinate(&self, r: DVec3) -> Option<f64> {
        let (on_plane, _, held) = self.projector.through_lens(self.projector.project(r)?);
        held.then(|| on_plane.dot(self.along))
    }

    /// Where the ray of `pixel` meets light of the coordinate `u`; `None` where it never does.
    pub fn triangulate(&self, pixel: usize, u: f64) -> Option<Place> {
        let (origin, w) = self.ray(pixel);
        let mut ideal = u;
        let mut place = self.pinhole(origin, w, ideal)?;
        if self.projector.distortion.is_some() {
            // The plane bends with the lens: what the pinhole's plane lacks is added until the coordinate is right.
            for _ in 0..20 {
                let error = u - self.coordinate(place.r)?;
                if error.abs() < 1e-10 * (1.0 + u.abs()) {
                    break;
                }
                ideal += error;
                place = self.pinhole(origin, w, ideal)?;
            }
        }
        Some(place)
    }

    /// Light of the coordinate u lies in the plane through the projector P with the normal
    /// n = (z_0 - P.z) e - (u - e.P) z, so that t = n.(P - origin) / n.w.
    fn pinhole(&self, origin: DVec3, w: DVec3, u: f64) -> Option<Place> {
        let p = self.projector.position;
        let n = (self.plane() - p.z) * self.along - (u - self.along.dot(p)) * DVec3::Z;
        let (across, toward) = (n.dot(w), n.dot(p - origin));
        let t = toward / across;
        if !(t > 0.0 && t < f64::INFINITY) {
            return None;
        }
        // d n / d u = -z.
        let dt_du = (-(p - origin).z * across + toward * w.z) / (across * across);
        let r = origin + t * w;
        // Light travels away from the projector: towards its own plane.
        let ahead = (r.z - p.z) * (self.plane() - p.z) > 0.0;
        ahead.then(|| Place { r, dz_du: w.z * dt_du, sine: (across / n.length()).abs() })
    }
}
