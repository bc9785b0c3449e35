//! The closed form for a straight tube and a projector on its axis.
//!
//! Light that leaves at the radius rho of the plane h below the pinhole meets the wall of radius R at the drop h R / rho: the pattern is
//! of concentric rings, whose local frequency is f h R / rho^2.

use std::f64::consts::PI;

use turbid_contract::payload::Profile;
use turbid_optics::elementary::sin_cos_turns;
use turbid_optics::solid::Solid;

use crate::sample::Sample;
use crate::screen::Screen;

/// A bore seen from its axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bore {
    radius: f64,
    /// Of the pinhole over the mouth, mm.
    over_mouth: f64,
    length: f64,
    /// Of the pinhole over the pattern's plane.
    height: f64,
    /// The plane's point on the axis.
    middle: glam::DVec3,
}

impl Bore {
    /// Error: the wall is not the bore of an upright tube, or the projector is not on its axis and above it.
    pub fn of(solid: &Solid, screen: &Screen) -> Result<Self, String> {
        let tube = match solid {
            Solid::Carved(carved) => match (&carved.whole, carved.holes.as_slice()) {
                (&Solid::Cylinder { bottom, top, .. }, &[Solid::Cylinder { axis, radius, .. }]) => {
                    Some((axis, radius, bottom, top))
                }
                _ => None,
            },
            // A void that is cut into something.
            &Solid::Cylinder { axis, radius, bottom, top } => Some((axis, radius, bottom, top)),
            _ => None,
        };
        let (axis, radius, bottom, top) = tube.ok_or("the formula is that of a straight tube along z")?;
        let view = &screen.view;
        let off = (view.position.truncate() - axis).length().max((view.look_at.truncate() - axis).length());
        if off > 1e-9 * radius {
            return Err(format!(
                "the formula wants the projector on the tube's axis, looking along it; it is {off} mm off"
            ));
        }
        if view.distortion.is_some() {
            return Err("the formula knows no lens distortion".to_owned());
        }
        let over_mouth = view.position.z - top;
        if over_mouth <= 0.0 || view.forward.z >= 0.0 {
            return Err("the formula wants the projector above the mouth, looking down".to_owned());
        }
        let height = view.position.z - view.look_at.z;
        Ok(Self { radius, over_mouth, length: top - bottom, height, middle: view.look_at })
    }

    /// The sample of a pixel; `None` where its centre's light does not meet the wall.
    pub fn sample(&self, screen: &Screen, f_x: &[f64], pixel: usize) -> Option<Sample> {
        let from_middle = (screen.on_plane(pixel, 0.5, 0.5) - self.middle).truncate();
        let rho = from_middle.length();
        let drop = self.height * self.radius / rho;
        let s = drop - self.over_mouth;
        if !(s >= 0.0 && s <= self.length) {
            return None;
        }
        // Along x and y of the image the coordinate changes by this, mm per pixel.
        let [px, py] = screen.pitch();
        let steep = drop / rho;
        let slopes = [
            from_middle.dot(screen.view.right.truncate()) / rho * steep * px,
            from_middle.dot(screen.view.top.truncate()) / rho * steep * py,
        ];
        let phasors = f_x.iter().map(|f| {
            let (sin, cos) = sin_cos_turns(f * s);
            // The mean of a plane wave over the pixel.
            let kept = sinc(f * slopes[0]) * sinc(f * slopes[1]);
            (kept * cos, kept * sin)
        });
        let square = self.radius * self.radius + drop * drop;
        // cos / d^2 = R / d^3; an even irradiance of the plane wants 1 / cos^3 with cos = drop / d.
        let intensity = match screen.profile {
            Profile::UniformIntensity => 1.0,
            Profile::Flat => (square / (drop * drop)) * (square.sqrt() / drop),
        };
        Some(Sample {
            s,
            phasors: phasors.collect(),
            slope: slopes[0].abs().max(slopes[1].abs()),
            whole: true,
            irradiance: intensity * self.radius / (square * square.sqrt()),
        })
    }
}

/// sin(pi x) / (pi x).
fn sinc(x: f64) -> f64 {
    if x.abs() < 1e-8 { 1.0 } else { sin_cos_turns(0.5 * x).0 / (PI * x) }
}
