//! How a projector's light falls on a surface: irradiance, and spatial frequency along it.
//!
//! Irradiance E = I cos(theta) / D^2; the fringe cos(2 pi f_x u(r)), with u(r) the coordinate in the pattern's plane of the light that passes r, has the
//! frequency f_x |(1 - n n^T) grad u| along a surface of normal n.

use glam::DVec3;
use turbid_contract::payload::{Profile, Projector};
use turbid_geometry::projector_view;
use turbid_optics::view::{View, ViewError};

/// A projector and the direction in which its pattern varies.
#[derive(Clone, Debug)]
pub struct Lighting {
    projector: View,
    profile: Profile,
    /// Unit vector in the pattern's plane: its coordinate is u = r . along.
    along: DVec3,
}

/// Light at a point of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exposure {
    /// In units that are the same for all points.
    pub irradiance: f64,
    /// Spatial frequency along the surface over that of the pattern.
    pub stretch: f64,
    /// Cosine of the angle between the normal and the way to the projector.
    pub cos: f64,
}

impl Lighting {
    /// Error: the projector is no view; a checked scene holds no such projector.
    pub fn new(p: &Projector, orientation_deg: f64) -> Result<Self, ViewError> {
        let (sin, cos) = turbid_optics::elementary::sin_cos_turns(orientation_deg / 360.0);
        Ok(Self { projector: projector_view(p)?, profile: p.profile, along: DVec3::new(cos, sin, 0.0) })
    }

    /// World z of the pattern's plane.
    pub fn plane(&self) -> f64 {
        self.projector.look_at.z
    }

    /// What falls on a surface at `r` with the unit normal `n`, if nothing stands in the way; `None` outside the projector's field. Light from
    /// behind has a cosine <= 0, and an irradiance that means nothing.
    pub fn on(&self, r: DVec3, n: DVec3) -> Option<Exposure> {
        let away = self.projector.position - r;
        let (distance, towards) = (away.length(), away.normalize());
        let intensity = self.intensity(r, towards)?;
        let cos = n.dot(towards);
        // A thousandth of the distance: the mapping is a projection and a polynomial of the lens, smooth on the scale of the field.
        let step = 1e-3 * distance;
        let (a, b) = n.any_orthonormal_pair();
        let slope = |w: DVec3| {
            let u = |k: f64| self.coordinate(r + k * step * w);
            // To fourth order.
            let [near, far] = [1.0, 2.0].map(|k| Some(u(k)? - u(-k)?));
            Some((8.0 * near? - far?) / (12.0 * step))
        };
        let (u_a, u_b) = (slope(a)?, slope(b)?);
        let stretch = (u_a * u_a + u_b * u_b).sqrt();
        Some(Exposure { irradiance: intensity * cos / (distance * distance), stretch, cos })
    }

    /// Coordinate in the pattern's plane of the light that passes `r`.
    fn coordinate(&self, r: DVec3) -> Option<f64> {
        let (on_plane, _, held) = self.projector.through_lens(self.projector.project(r)?);
        held.then(|| on_plane.dot(self.along))
    }

    /// Radiant intensity towards `r`, relative; `None` outside the field.
    fn intensity(&self, r: DVec3, towards: DVec3) -> Option<f64> {
        let ideal = self.projector.project(r)?;
        let (on_plane, spread, held) = self.projector.through_lens(ideal);
        if !(held && self.projector.in_field(on_plane)) {
            return None;
        }
        let far = |p: DVec3| (p - self.projector.position).length();
        Some(match self.profile {
            // A lens moves light with its flux; on the plane E = I h / R^3.
            Profile::UniformIntensity => {
                let moved = far(ideal) / far(on_plane);
                spread * moved * moved * moved
            }
            Profile::Flat => {
                let cos = towards.z.abs();
                spread / (cos * cos * cos)
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn projector(profile: Profile) -> Projector {
        Projector {
            position: [0.0, 35.0, 500.0],
            look_at: [0.0; 3],
            up: [0.0, 1.0, 0.0],
            field: [300.0, 300.0],
            power: vec![5.0],
            profile,
            pixels: None,
            distortion: None,
        }
    }

    /// On the pattern's plane fringes are f_x everywhere and a flat profile is flat; 1e-11 is rounding of the differences.
    #[test]
    fn the_patterns_plane_is_the_reference() {
        let lighting = Lighting::new(&projector(Profile::Flat), 30.0).unwrap();
        let middle = lighting.on(DVec3::ZERO, DVec3::Z).unwrap();
        for (x, y) in [(0.0, 0.0), (100.0, -70.0), (-145.0, 145.0)] {
            let here = lighting.on(DVec3::new(x, y, 0.0), DVec3::Z).unwrap();
            assert!((here.stretch - 1.0).abs() < 1e-11, "{here:?}");
            assert!((here.irradiance / middle.irradiance - 1.0).abs() < 1e-13, "{here:?} {middle:?}");
        }
        assert_eq!(lighting.on(DVec3::new(151.0, 0.0, 0.0), DVec3::Z), None);
        assert_eq!(lighting.on(DVec3::new(0.0, 0.0, 501.0), DVec3::Z), None);
    }

    /// A surface through the foot of the lamp, tilted by theta along the fringes' direction: with the line p = s (cos, sin) the coordinate is
    /// u = h s cos / (h - s sin), so that du/ds = h^2 cos / (h - s sin)^2; tilted across the fringes, du/dx = h / (h - height).
    #[test]
    fn tilted_planes_have_their_closed_form() {
        let (h, theta) = (500.0, 0.7_f64);
        let (sin, cos) = (libm::sin(theta), libm::cos(theta));
        let mut p = projector(Profile::UniformIntensity);
        p.position = [0.0, 0.0, h];
        let lighting = Lighting::new(&p, 0.0).unwrap();
        for s in [-60.0, 0.0, 80.0] {
            let (r, n) = (DVec3::new(s * cos, 0.0, s * sin), DVec3::new(-sin, 0.0, cos));
            let along = lighting.on(r, n).unwrap();
            let want = h * h * cos / ((h - s * sin) * (h - s * sin));
            assert!((along.stretch / want - 1.0).abs() < 1e-10, "{s}: {} for {want}", along.stretch);
            let (r, n) = (DVec3::new(0.0, s * cos, s * sin), DVec3::new(0.0, -sin, cos));
            let across = lighting.on(r, n).unwrap();
            let want = h / (h - s * sin);
            assert!((across.stretch / want - 1.0).abs() < 1e-10, "{s}: {} for {want}", across.stretch);
            // n . (P - r) / D^3
            let away = DVec3::new(0.0, -s * cos, h - s * sin);
            let want = n.dot(away) / (away.length() * away.length_squared());
            assert!((across.irradiance / want - 1.0).abs() < 1e-13, "{s}: {across:?} for {want}");
        }
    }

    /// Through a lens that distorts the flux stays: the irradiance over the area that is lit adds up to the field's solid angle (uniform
    /// intensity) or its area (flat), midpoint rule with 4 / n of the edge's cells.
    #[test]
    fn distortion_keeps_the_flux() {
        for profile in [Profile::UniformIntensity, Profile::Flat] {
            let mut flux = [0.0; 2];
            for (k, sum) in flux.iter_mut().enumerate() {
                let mut p = projector(profile);
                let lens = turbid_contract::payload::Distortion { k1: -0.2, k2: 0.05, p1: 1e-3, p2: -2e-3, k3: 0.0 };
                p.distortion = (k == 1).then_some(lens);
                let lighting = Lighting::new(&p, 0.0).unwrap();
                let (n, side) = (400, 400.0);
                for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
                    let at = |i: i32| side * ((f64::from(i) + 0.5) / f64::from(n) - 0.5);
                    let r = DVec3::new(at(i), at(j), 0.0);
                    *sum += lighting.on(r, DVec3::Z).map_or(0.0, |e| e.irradiance);
                }
            }
            assert!((flux[1] / flux[0] - 1.0).abs() < 4.0 / 400.0, "{profile:?}: {flux:?}");
        }
    }
}
