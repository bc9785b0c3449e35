//! The pitch of an image's pixels: how much of the scene one pixel shows.

use serde_json::{Value, json};

use crate::artifact::ImageStack;
use crate::payload::{Camera, Projection};

/// Attribute: mm along a row and along a column from one pixel to the next, in the plane z = look_at.z.
pub const PIXEL_PITCH_MM: &str = "pixel_pitch_mm";
/// Attribute of a fisheye, which shows no plane: the same in rad.
pub const PIXEL_PITCH_RAD: &str = "pixel_pitch_rad";

impl Camera {
    /// Name and value of the attribute that says how much a pixel shows: mm in the plane z = look_at.z, of a fisheye rad. With a
    /// distorting lens this holds in the image's middle.
    pub fn pixel_pitch(&self) -> (&'static str, [f64; 2]) {
        let pitch = [0, 1].map(|k| self.field[k] / f64::from(self.pixels[k]));
        if self.projection != Projection::Fisheye {
            return (PIXEL_PITCH_MM, pitch);
        }
        let away: f64 = (0..3).map(|k| (self.look_at[k] - self.position[k]).powi(2)).sum();
        (PIXEL_PITCH_RAD, pitch.map(|mm| mm / away.sqrt()))
    }
}

impl ImageStack {
    /// mm from one pixel to the next, along a row and along a column, where that is known.
    pub fn pixel_pitch_mm(&self) -> Option<[f64; 2]> {
        self.pitch(PIXEL_PITCH_MM)
    }

    /// rad from one pixel to the next, along a row and along a column, of an image of a fisheye.
    pub fn pixel_pitch_rad(&self) -> Option<[f64; 2]> {
        self.pitch(PIXEL_PITCH_RAD)
    }

    fn pitch(&self, name: &str) -> Option<[f64; 2]> {
        let [x, y] = self.attributes.get(name)?.as_array()?.as_slice() else { return None };
        let positive = |v: &Value| v.as_f64().filter(|v| *v > 0.0 && v.is_finite());
        Some([positive(x)?, positive(y)?])
    }

    /// Says that these are pixels of `camera`.
    pub fn set_pixel_pitch(&mut self, camera: &Camera) {
        let (name, pitch) = camera.pixel_pitch();
        self.attributes.insert(name.to_owned(), json!(pitch));
    }

    /// Says that these are the pixels of another stack, whose pitch is taken over where it is known.
    pub fn take_pixel_pitch(&mut self, of: &ImageStack) {
        for name in [PIXEL_PITCH_MM, PIXEL_PITCH_RAD] {
            if let Some(pitch) = of.attributes.get(name) {
                self.attributes.insert(name.to_owned(), pitch.clone());
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(projection: Projection) -> Camera {
        Camera {
            position: [0.0, 30.0, 40.0],
            look_at: [0.0; 3],
            up: [0.0, 1.0, 0.0],
            field: [64.0, 30.0],
            pixels: [128, 40],
            specular: None,
            projection,
            distortion: None,
            aperture: None,
        }
    }

    /// Field over pixels; a fisheye's field is an angle at the distance of look_at (50 mm here).
    #[test]
    fn a_pixel_is_its_part_of_the_field() {
        let mut stack = ImageStack::new(1, 1);
        assert_eq!(stack.pixel_pitch_mm(), None);
        for projection in [Projection::Pinhole, Projection::Orthographic] {
            stack.set_pixel_pitch(&camera(projection));
            assert_eq!((stack.pixel_pitch_mm(), stack.pixel_pitch_rad()), (Some([0.5, 0.75]), None));
        }
        let mut other = ImageStack::new(1, 1);
        other.take_pixel_pitch(&stack);
        assert_eq!(other.attributes, stack.attributes);
        let mut round = ImageStack::new(1, 1);
        round.set_pixel_pitch(&camera(Projection::Fisheye));
        assert_eq!((round.pixel_pitch_mm(), round.pixel_pitch_rad()), (None, Some([0.01, 0.015])));
        for senseless in [json!([1.0]), json!([0.0, 1.0]), json!("1"), json!([1.0, "a"])] {
            stack.attributes.insert(PIXEL_PITCH_MM.to_owned(), senseless);
            assert_eq!(stack.pixel_pitch_mm(), None);
        }
    }
}
