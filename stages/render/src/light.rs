//! The projector: where it shines, how strongly, and the carriers that it projects.

use glam::DVec3;
use turbid_optics::elementary::sin_cos_turns;
use turbid_optics::view::{Lens, View};

/// How a pattern value of 1 is spread over the field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Emission {
    /// Radiant intensity, W/sr, the same in every direction.
    Intensity(f64),
    /// Irradiance, W mm^-2, the same all over the plane of the field.
    Irradiance(f64),
}

/// A pinhole light with a field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    pub view: View,
    pub emission: Emission,
}

/// Light that arrives at a point if nothing stands in its way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arrival {
    /// Unit vector towards the light.
    pub towards: DVec3,
    /// mm.
    pub distance: f64,
    /// On a surface that faces the light, at pattern value 1, W mm^-2.
    pub irradiance: f64,
    /// Where the line from the light through the point meets the pattern's plane: its pattern value holds.
    pub on_plane: DVec3,
}

impl Light {
    /// A light of `power` W inside its field.
    pub fn new(view: View, power: f64, flat: bool) -> Self {
        let emission = if flat {
            Emission::Irradiance(power / (view.field.x * view.field.y))
        } else {
            Emission::Intensity(power / view.solid_angle())
        };
        Self { view, emission }
    }

    /// One that gives no light, for scenes without a projector.
    pub fn none() -> Self {
        let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
        let view = View {
            position: z,
            look_at: DVec3::ZERO,
            field: glam::DVec2::ZERO,
            right: x,
            top: y,
            forward: -z,
            lens: Lens::Pinhole,
            distortion: None,
        };
        Self { view, emission: Emission::Intensity(0.0) }
    }

    pub fn shines(&self) -> bool {
        self.emission != Emission::Intensity(0.0)
    }

    /// Unit vector from `p` to the pinhole, and the distance.
    #[inline(always)]
    pub fn towards(&self, p: DVec3) -> (DVec3, f64) {
        let d = self.view.position - p;
        let distance = d.length();
        (d / distance, distance)
    }

    /// What arrives at `p`; `None` outside the field.
    #[inline]
    pub fn arrival(&self, p: DVec3) -> Option<Arrival> {
        let (arrival, lit) = self.arrives(p);
        lit.then_some(arrival)
    }

    /// The same without a branch: what it says means nothing where the second is false.
    #[inline(always)]
    pub fn arrives(&self, p: DVec3) -> (Arrival, bool) {
        let (ideal, ahead) = self.view.projects(p);
        let (towards, distance) = self.towards(p);
        // Distortion moves light with its flux: where the image is spread over more of the pattern there is more of it.
        let (on_plane, spread, held) = self.view.through_lens(ideal);
        let intensity = match self.emission {
            Emission::Intensity(i) => i,
            Emission::Irradiance(e) => {
                // On the plane E = I cos / R^2 with R = h / cos.
                let (h, cos) = (self.view.height(), towards.z.abs());
                e * h * h / (cos * cos * cos)
            }
        };
        let intensity =
            if self.view.distortion.is_some() { intensity * spread * self.moved(ideal, on_plane) } else { intensity };
        let arrival = Arrival { towards, distance, irradiance: intensity / (distance * distance), on_plane };
        (arrival, ahead & held & self.view.in_field(on_plane))
    }

    /// Intensity towards `ideal` over that which sends the same flux per area of the plane to `on_plane`, without distortion.
    fn moved(&self, ideal: DVec3, on_plane: DVec3) -> f64 {
        match self.emission {
            // E = I h / R^3 on the plane.
            Emission::Intensity(_) => {
                let ratio = (ideal - self.view.position).length() / (on_plane - self.view.position).length();
                ratio * ratio * ratio
            }
            Emission::Irradiance(_) => 1.0,
        }
    }
}

/// exp(i 2 pi f_x u), u along world x turned by the orientation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Carrier {
    f_x: f64,
    orientation_deg: f64,
    /// Cycles per mm along world x and y.
    along: (f64, f64),
}

impl Carrier {
    pub fn new(f_x: f64, orientation_deg: f64) -> Self {
        let (sin, cos) = sin_cos_turns(orientation_deg / 360.0);
        Self { f_x, orientation_deg, along: (f_x * cos, f_x * sin) }
    }

    /// mm^-1.
    pub fn f_x(&self) -> f64 {
        self.f_x
    }

    pub fn orientation_deg(&self) -> f64 {
        self.orientation_deg
    }

    /// Cycles per mm along world x and y.
    pub fn along(&self) -> (f64, f64) {
        self.along
    }

    /// (sin, cos) of the carrier's phase at a point of the pattern's plane.
    #[inline(always)]
    pub fn at(&self, on_plane: DVec3) -> (f64, f64) {
        sin_cos_turns(self.along.0 * on_plane.x + self.along.1 * on_plane.y)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec2;

    /// The same through a lens that distorts: over all of the plane that is lit, whose edge cells make an error of 4 / n of their share
    /// of the flux; and the pattern's place is that of the distorted image.
    #[test]
    fn distortion_keeps_the_power() {
        let view = View::new(DVec3::new(5.0, -4.0, 60.0), DVec3::new(1.0, 2.0, 3.0), DVec3::Y, DVec2::new(50.0, 40.0));
        for lens in [[-0.35, 0.1, 2e-3, -3e-3, 0.0], [0.25, 0.0, 0.0, 1e-2, 0.0]] {
            let view = view.unwrap().distorted(lens).unwrap();
            for flat in [false, true] {
                let light = Light::new(view, 5.0, flat);
                let (n, side) = (800, 100.0);
                let mut flux = 0.0;
                for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
                    let at = |i: i32| side * ((f64::from(i) + 0.5) / f64::from(n) - 0.5);
                    let p = view.look_at + DVec3::new(at(i), at(j), 0.0);
                    if let Some(arrival) = light.arrival(p) {
                        flux += arrival.irradiance * arrival.towards.z * (side / f64::from(n)).powi(2);
                    }
                }
                assert!((flux / 5.0 - 1.0).abs() < 1e-3, "{lens:?}, flat {flat}: {flux} W");
                // The image position of the lit point and the place of the pattern are one.
                let (_, w) = view.ray(0.2, 0.9);
                let arrival = light.arrival(view.position + 40.0 * w).unwrap();
                assert!((arrival.on_plane - view.plane_point(0.2, 0.9)).length() < 1e-11);
            }
        }
    }

    /// The flux through the plane of the field is the power, for both profiles: midpoint rule on 300 x 300 cells, relative
    /// error below (cell / h)^2 = 1e-5.
    #[test]
    fn the_field_carries_the_power() {
        let view =
            View::new(DVec3::new(35.0, -20.0, 60.0), DVec3::new(1.0, 2.0, 3.0), DVec3::Y, DVec2::new(50.0, 40.0));
        let view = view.unwrap();
        for flat in [false, true] {
            let light = Light::new(view, 5.0, flat);
            let n = 300;
            let mut flux = 0.0;
            for i in 0..n * n {
                let (x, y) = (f64::from(i % n) + 0.5, f64::from(i / n) + 0.5);
                let p = view.plane_point(x / f64::from(n), y / f64::from(n));
                let arrival = light.arrival(p).unwrap();
                flux += arrival.irradiance * arrival.towards.z * view.field.x * view.field.y / f64::from(n * n);
            }
            assert!((flux / 5.0 - 1.0).abs() < 1e-5, "flat {flat}: {flux} W");
        }
        let light = Light::new(view, 5.0, true);
        assert!(light.arrival(view.plane_point(-0.001, 0.5)).is_none());
        assert!(light.arrival(view.position + DVec3::Z).is_none());
    }
}
