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
        for row in y..y + height {
            for column in x..x + width {
                self.set(column, row, colour);
            }
        }
    }

    /// A frame of one pixel around (outside) a box.
    pub fn frame(&mut self, x: i64, y: i64, width: i64, height: i64, colour: Rgb) {
        self.fill(x - 1, y - 1, width + 2, 1, colour);
        self.fill(x - 1, y + height, width + 2, 1, colour);
        self.fill(x - 1, y, 1, height, colour);
        self.fill(x + width, y, 1, height, colour);
    }

    pub fn paste(&mut self, x: i64, y: i64, picture: &Canvas) {
        for row in 0..picture.height {
            for column in 0..picture.width {
                if let Some(colour) = picture.get(column, row) {
                    self.set(x + column, y + row, colour);
                }
            }
        }
    }

    /// PNG file of the canvas: 8-bit RGB, the same bytes for the same canvas.
    pub fn to_png(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.width as u32, self.height as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
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

    #[test]
    fn drawing_outside_is_ignored() {
        let mut canvas = Canvas::new(2, 2);
        canvas.fill(-5, -5, 3, 20, INK);
        assert_eq!(canvas, Canvas::new(2, 2));
    }

    #[test]
    fn png_gives_the_pixels_back() {
        let mut canvas = Canvas::new(3, 2);
        canvas.set(1, 1, [1, 2, 3]);
        let bytes = canvas.to_png();
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        assert_eq!((info.width, info.height, pixels.as_slice()), (3, 2, canvas.pixels.as_slice()));
    }
}
