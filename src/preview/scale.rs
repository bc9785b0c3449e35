//! How large things in an image are: a bar of a round length, for images whose pixels' pitch is known.

use turbid_contract::ImageStack;

use super::number::{number, short};
use super::panel::{Note, Swatch};
use super::pixels::Pixels;

/// The bar takes up to this part of the image's width.
const MOST: f64 = 0.4;

/// What a stack knows of the size of its pixels.
struct Pitch {
    /// Along a row and along a column.
    sizes: [f64; 2],
    unit: &'static str,
    place: &'static str,
}

fn pitch(stack: &ImageStack) -> Option<Pitch> {
    if let Some(sizes) = stack.pixel_pitch_mm() {
        return Some(Pitch { sizes, unit: " mm", place: " in the plane that the camera looks at" });
    }
    let sizes = stack.pixel_pitch_rad()?.map(f64::to_degrees);
    Some(Pitch { sizes, unit: "°", place: "" })
}

/// The bar under an image, which `pixels` shows.
pub fn bar(stack: &ImageStack, pixels: &Pixels) -> Option<Note> {
    let pitch = pitch(stack)?;
    let screen_per_unit = pixels.zoom as f64 / (pixels.step as f64 * pitch.sizes[0]);
    let most = MOST * (pixels.columns * pixels.zoom) as f64 / screen_per_unit;
    let length = round_below(most)?;
    let swatch = Swatch::Length(((length * screen_per_unit).round() as i64).max(1));
    Some(Note { swatch: Some(swatch), text: number(length, 1).then(pitch.unit) })
}

/// ` of 1 × 1 mm in the plane that the camera looks at`; empty where nothing is known.
pub fn of_pixels(stack: &ImageStack) -> String {
    let Some(Pitch { sizes, unit, place }) = pitch(stack) else { return String::new() };
    let [x, y] = sizes.map(short);
    format!(" of {x} × {y}{unit}{place}")
}

/// The largest of 1, 2, 5 times a power of ten that is not above `most`.
fn round_below(most: f64) -> Option<f64> {
    if !(most > 0.0 && most.is_finite()) {
        return None;
    }
    let power = super::number::exponent_of(most);
    let lengths = [5, 2, 1].map(|digit| format!("{digit}e{power}").parse::<f64>().expect("a digit with an exponent"));
    lengths.into_iter().find(|length| *length <= most)
}

#[cfg(test)]
mod tests {
    use ndarray::Array2;
    use serde_json::json;

    use super::super::pixels::{Reduce, fit};
    use super::*;

    /// The bar's pixels times the pitch are what it says, to half a pixel of the screen, and it fits the image.
    #[test]
    fn a_bar_is_as_long_as_it_says() {
        for (columns, pitch) in [(64, 1.0), (200, 0.102), (1, 64.0), (2048, 0.003), (33, 300.0)] {
            let mut stack = ImageStack::new(2, columns);
            stack.attributes.insert("pixel_pitch_mm".into(), json!([pitch, 2.0 * pitch]));
            let image = Array2::zeros((2, columns));
            let pixels = fit(&image, &image.mapv(|_: f32| true), 288, Reduce::Mean);
            let note = bar(&stack, &pixels).unwrap();
            let Some(Swatch::Length(long)) = note.swatch else { panic!("no bar") };
            let text = note.text.letters();
            let said: f64 = text.strip_suffix(" mm").unwrap().parse().unwrap();
            let per_mm = pixels.zoom as f64 / (pixels.step as f64 * pitch);
            assert!((long as f64 - said * per_mm).abs() <= 0.5, "{columns} x {pitch}: {text} on {long} pixels");
            assert!(long as usize <= pixels.columns * pixels.zoom / 2, "{columns} x {pitch}: {long}");
        }
        let nothing = ImageStack::new(2, 2);
        assert!(
            bar(&nothing, &fit(&Array2::zeros((2, 2)), &Array2::from_elem((2, 2), true), 9, Reduce::Mean)).is_none()
        );
    }

    #[test]
    fn pixels_say_their_size() {
        let mut stack = ImageStack::new(2, 2);
        assert_eq!(of_pixels(&stack), "");
        stack.attributes.insert("pixel_pitch_mm".into(), json!([0.5, 1.0 / 3.0]));
        assert_eq!(of_pixels(&stack), " of 0.5 × 0.3333 mm in the plane that the camera looks at");
        let mut fisheye = ImageStack::new(2, 2);
        fisheye.attributes.insert("pixel_pitch_rad".into(), vec![std::f64::consts::PI / 180.0; 2].into());
        assert_eq!(of_pixels(&fisheye), " of 1 × 1°");
    }
}
