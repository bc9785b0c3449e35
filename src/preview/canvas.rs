//! An RGB picture that can be drawn on.

/// Red, green, blue in 0..=255 (sRGB).
pub type Rgb = [u8; 3];

pub const INK: Rgb = [32, 32, 32];
pub const GREY: Rgb = [104, 104, 104];

/// Pixels from top left; drawing outside is ignored.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Canvas {
    width: i64,
    height: i64,
    pixels: Vec<u8>,
}

impl Canvas {
    /// A white canvas; width and height in pixels.
    pub fn new(width: i64, height: i64) -> Self {
        let (width, height) = (width.max(1), height.max(1));
        Self { width, height, pixels: vec![255; (3 * width * height) as usize] }
    }

    pub fn width(&self) -> i64 {
        self.width
    }

    pub fn height(&self) -> i64 {
        self.height
    }

    pub fn get(&self, x: i64, y: i64) -> Option<Rgb> {
        let at = self.offset(x, y)?;
        Some([self.pixels[at], self.pixels[at + 1], self.pixels[at + 2]])
    }

    pub fn set(&mut self, x: i64, y: i64, colour: Rgb) {
        if let Some(at) = self.offset(x, y) {
            self.pixels[at..at + 3].copy_from_slice(&colour);
        }
    }

    /// Lays `colour` over a pixel; `coverage` is 0 (nothing) to 255 (all of it).
    pub fn blend(&mut self, x: i64, y: i64, colour: Rgb, coverage: u8) {
        if let Some(at) = self.offset(x, y) {
            let a = u32::from(coverage);
            for (old, new) in self.pixels[at..at + 3].iter_mut().zip(colour) {
                *old = ((u32::from(*old) * (255 - a) + u32::from(new) * a + 127) / 255) as u8;
            }
        }
    }

    pub fn fill(&mut self, x: i64, y: i64, width: i64, height: i64, colour: Rgb) {
        let (left, right) = (x.clamp(0, self.width), (x + width).clamp(0, self.width));
        for row in y.max(0)..(y + height).min(self.height) {
            let (first, end) = (3 * (row * self.width + left), 3 * (row * self.width + right.max(left)));
            self.pixels[first as usize..end as usize].as_chunks_mut().0.fill(colour);
        }
    }

    /// A frame of one pixel around (outside) a box.
    pub fn frame(&mut self, x: i64, y: i64, width: i64, height: i64, colour: Rgb) {
        self.fill(x - 1, y - 1, width + 2, 1, colour);
        self.fill(x - 1, y + height, width + 2, 1, colour);
        self.fill(x - 1, y, 1, height, colour);
        self.fill(x + width, y, 1, height, colour);
    }

    /// Copies a picture to where its top left corner is to be.
    pub fn paste(&mut self, x: i64, y: i64, picture: &Canvas) {
        for row in 0..picture.height {
            for column in 0..picture.width {
                if let Some(colour) = picture.get(column, row) {
                    self.set(x + column, y + row, colour);
                }
            }
        }
    }

    /// The canvas turned by a quarter to the left: text then reads upwards.
    #[must_use]
    pub fn turned(&self) -> Self {
        let mut turned = Self::new(self.height, self.width);
        for (x, y) in (0..self.height).flat_map(|y| (0..self.width).map(move |x| (x, y))) {
            if let Some(colour) = self.get(x, y) {
                turned.set(y, self.width - 1 - x, colour);
            }
        }
        turned
    }

    /// A smooth line of the given width between two points (pixel centres lie at half numbers).
    pub fn line(&mut self, from: [f64; 2], to: [f64; 2], width: f64, colour: Rgb) {
        let d = [to[0] - from[0], to[1] - from[1]];
        let length2 = d[0] * d[0] + d[1] * d[1];
        let reach = width / 2.0 + 1.0;
        let low = |i: usize| (from[i].min(to[i]) - reach).floor() as i64;
        let high = |i: usize| (from[i].max(to[i]) + reach).ceil() as i64;
        for y in low(1).max(0)..=high(1).min(self.height - 1) {
            for x in low(0).max(0)..=high(0).min(self.width - 1) {
                let p = [x as f64 + 0.5 - from[0], y as f64 + 0.5 - from[1]];
                let t = if length2 > 0.0 { ((p[0] * d[0] + p[1] * d[1]) / length2).clamp(0.0, 1.0) } else { 0.0 };
                let r = [p[0] - t * d[0], p[1] - t * d[1]];
                let coverage = (width / 2.0 + 0.5 - (r[0] * r[0] + r[1] * r[1]).sqrt()).clamp(0.0, 1.0);
                self.blend(x, y, colour, (coverage * 255.0).round() as u8);
            }
        }
    }

    /// PNG file of the canvas: 8-bit RGB, with a text chunk (iTXt) for each keyword and text. The same canvas and texts give the same bytes.
    pub fn to_png(&self, texts: &[(&'static str, String)]) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.width as u32, self.height as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        for (keyword, text) in texts {
            let added = encoder.add_itxt_chunk((*keyword).to_owned(), text.clone());
            added.expect("keywords are short plain words");
        }
        encoder
            .write_header()
            .and_then(|mut writer| writer.write_image_data(&self.pixels))
            .expect("a canvas has a size and all its pixels, and memory takes every byte");
        bytes
    }

    fn offset(&self, x: i64, y: i64) -> Option<usize> {
        let inside = (0..self.width).contains(&x) && (0..self.height).contains(&y);
        inside.then(|| (3 * (y * self.width + x)) as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A line of width w and length l covers w l plus its two round caps, pi (w/2)^2; smooth edges keep the sum
    /// to within a pixel per 20 of length.
    #[test]
    fn a_line_covers_its_area() {
        for to in [[90.5, 10.5], [60.2, 70.9], [10.5, 90.5]] {
            let mut canvas = Canvas::new(100, 100);
            canvas.line([10.5, 10.5], to, 3.0, [0, 0, 0]);
            let ink: f64 = canvas.pixels.chunks(3).map(|p| 1.0 - f64::from(p[0]) / 255.0).sum();
            let length = ((to[0] - 10.5f64) * (to[0] - 10.5) + (to[1] - 10.5) * (to[1] - 10.5)).sqrt();
            let area = 3.0 * length + std::f64::consts::PI * 2.25;
            assert!((ink - area).abs() < 1.0 + length / 20.0, "to {to:?}: {ink} of {area}");
        }
    }

    #[test]
    fn drawing_outside_is_ignored() {
        let mut canvas = Canvas::new(2, 2);
        canvas.fill(-5, -5, 3, 20, INK);
        canvas.line([-50.0, -1.0], [-3.0, 900.0], 1.0, INK);
        assert_eq!(canvas, Canvas::new(2, 2));
    }

    #[test]
    fn png_gives_the_pixels_back() {
        let mut canvas = Canvas::new(3, 2);
        canvas.set(1, 1, [1, 2, 3]);
        let bytes = canvas.to_png(&[]);
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        assert_eq!((info.width, info.height, pixels.as_slice()), (3, 2, canvas.pixels.as_slice()));
    }
}
