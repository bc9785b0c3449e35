//! From the numbers of a camera to radiance: gamma, dark and flat field, exposure, and the noise that goes with them.

use turbid_contract::payload::MaskReason;

use crate::decode::{Numbers, Picture};

/// Share of the mean response below which a pixel counts as dead: its gain would be more than 50.
const DEAD: f64 = 0.02;

/// What the camera is, as far as it is known.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// Radiance at the highest number (floating-point pictures: at 1) and exposure 0.
    pub full_scale: f64,
    /// number = level^(1 / gamma).
    pub gamma: f64,
    /// Share of the highest number from which on a pixel is saturated.
    pub saturation: f64,
    /// Where standard errors are wanted.
    pub electrons: Option<Electrons>,
    /// Electrons.
    pub read_noise: f64,
    /// Number that the camera writes without light, where no field tells.
    pub black_level: f64,
}

/// How many electrons a number stands for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Electrons {
    /// At the highest number (floating-point pictures: at 1).
    AtHighest(f64),
    PerNumber(f64),
}

impl Electrons {
    fn at_highest(self, highest: Option<f64>) -> f64 {
        match self {
            Self::AtHighest(electrons) => electrons,
            Self::PerNumber(electrons) => electrons * highest.unwrap_or(1.0),
        }
    }
}

/// One frame as radiance, pixel by pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct Corrected {
    pub value: Vec<f32>,
    /// Empty where the camera's noise is not known.
    pub variance: Vec<f64>,
    pub reasons: Vec<MaskReason>,
}

impl Corrected {
    /// Means of squares of `side` pixels with their new rows and columns; what is left at the right and below is dropped. A square has the first reason of
    /// its pixels.
    pub fn binned(self, (rows, columns): (usize, usize), side: usize) -> ((usize, usize), Self) {
        let size = (rows / side, columns / side);
        if side == 1 {
            return (size, self);
        }
        let squares = || (0..size.0).flat_map(|r| (0..size.1).map(move |c| (r * side, c * side)));
        let pixels =
            |(r, c): (usize, usize)| (r..r + side).flat_map(move |r| (c..c + side).map(move |c| r * columns + c));
        let count = (side * side) as f64;
        let mean = |at| (pixels(at).map(|i| f64::from(self.value[i])).sum::<f64>() / count) as f32;
        let variance = |at| pixels(at).map(|i| self.variance[i]).sum::<f64>() / (count * count);
        let reason =
            |at| pixels(at).map(|i| self.reasons[i]).find(|r| *r != MaskReason::Good).unwrap_or(MaskReason::Good);
        let binned = Self {
            value: squares().map(mean).collect(),
            variance: if self.variance.is_empty() { Vec::new() } else { squares().map(variance).collect() },
            reasons: squares().map(reason).collect(),
        };
        (size, binned)
    }
}

/// Levels, as shares of full scale.
#[derive(Clone, Debug)]
pub struct Field {
    levels: Vec<f64>,
}

impl Field {
    /// The mean of several.
    pub fn mean(fields: &[&Self]) -> Option<Self> {
        let (first, n) = (fields.first()?, fields.len() as f64);
        let at = |i: usize| fields.iter().map(|field| field.levels[i]).sum::<f64>() / n;
        Some(Self { levels: (0..first.levels.len()).map(at).collect() })
    }

    /// Pixels.
    #[allow(clippy::len_without_is_empty, reason = "pictures have pixels")]
    pub fn len(&self) -> usize {
        self.levels.len()
    }
}

impl Camera {
    fn level(&self, picture: &Picture, i: usize) -> f64 {
        self.level_of(picture, picture.values.at(i))
    }

    fn level_of(&self, picture: &Picture, number: f64) -> f64 {
        let share = number / picture.highest.unwrap_or(1.0);
        // What `pow` gives then, too.
        if self.gamma == 1.0 { share } else { libm::pow(share, self.gamma) }
    }

    /// Level of a pixel without light.
    fn darkness<'a>(&self, picture: &Picture, dark: Option<&'a Field>) -> impl Fn(usize) -> f64 + use<'a> {
        let black = self.level_of(picture, self.black_level);
        move |i| dark.map_or(black, |field| field.levels[i])
    }

    /// Dark level of each pixel.
    pub fn dark(&self, picture: &Picture) -> Field {
        Field { levels: (0..picture.values.len()).map(|i| self.level(picture, i)).collect() }
    }

    /// Response of each pixel to even light, mean 1 over the pixels that respond.
    ///
    /// Error: none does.
    pub fn response(&self, flat: &Picture, dark: Option<&Field>) -> Result<Field, String> {
        let darkness = self.darkness(flat, dark);
        let mut levels: Vec<f64> = (0..flat.values.len()).map(|i| self.level(flat, i) - darkness(i)).collect();
        let bright: Vec<f64> = levels.iter().copied().filter(|&l| l > 0.0 && l.is_finite()).collect();
        if bright.is_empty() {
            return Err("no pixel of it is brighter than the dark field".to_owned());
        }
        let mean = bright.iter().sum::<f64>() / bright.len() as f64;
        levels.iter_mut().for_each(|l| *l /= mean);
        Ok(Field { levels })
    }

    /// The frame, taken with `light` times the light.
    pub fn correct(&self, frame: &Picture, dark: Option<&Field>, response: Option<&Field>, light: f64) -> Corrected {
        let pixels = frame.values.len();
        let variances = if self.electrons.is_some() { pixels } else { 0 };
        let mut corrected = Corrected {
            value: Vec::with_capacity(pixels),
            variance: Vec::with_capacity(variances),
            reasons: Vec::with_capacity(pixels),
        };
        for pixel in self.pixels(frame, dark, response, light) {
            corrected.reasons.push(pixel.reason);
            corrected.value.push(pixel.value);
            corrected.variance.extend(pixel.variance);
        }
        corrected
    }

    /// What becomes of each number of 16 bits where no pixel has a dark level or a response of its own, with the numbers of the frame: `None` where
    /// pixels differ, and of a frame that has fewer pixels than there are numbers.
    pub fn of_numbers<'p>(
        &self,
        frame: &'p Picture,
        dark: Option<&Field>,
        response: Option<&Field>,
        light: f64,
    ) -> Option<(&'p [u16], Vec<Pixel>)> {
        let alike = dark.is_none() && response.is_none();
        let numbers = frame.values.of_16_bits().filter(|numbers| alike && numbers.len() > 1 << 16)?;
        let all = Numbers::U16((0..=u16::MAX).collect());
        let each = Picture { rows: 1, columns: 1 << 16, values: all, highest: frame.highest };
        Some((numbers, self.pixels(&each, None, None, light).collect()))
    }

    /// How much of the frame is light, without the frame.
    pub fn light(&self, frame: &Picture, dark: Option<&Field>, response: Option<&Field>, light: f64) -> Light {
        let seen = |pixel: &Pixel| (pixel.value, pixel.reason);
        match self.of_numbers(frame, dark, response, light) {
            Some((numbers, of)) => Light::of(numbers.iter().map(|&number| seen(&of[usize::from(number)]))),
            None => Light::of(self.pixels(frame, dark, response, light).map(|pixel| seen(&pixel))),
        }
    }

    fn pixels(
        &self,
        frame: &Picture,
        dark: Option<&Field>,
        response: Option<&Field>,
        light: f64,
    ) -> impl Iterator<Item = Pixel> {
        let scale = self.full_scale / light;
        let darkness = self.darkness(frame, dark);
        (0..frame.values.len()).map(move |i| {
            let level = self.level(frame, i);
            let above = level - darkness(i);
            let gain = response.map_or(1.0, |r| r.levels[i]);
            let value = above / gain * scale;
            // Images hold f32: what overflows there is infinite too.
            let finite = level.is_finite() && above.is_finite() && gain.abs() != f64::INFINITY;
            let reason = if !finite || gain > DEAD && !(value as f32).is_finite() {
                MaskReason::NotFinite
            } else if frame.highest.is_some_and(|highest| frame.values.at(i) >= self.saturation * highest) {
                MaskReason::Saturated
            } else if gain.is_nan() || gain <= DEAD {
                MaskReason::LowSignal
            } else {
                MaskReason::Good
            };
            let good = reason == MaskReason::Good;
            let variance = self.electrons.map(|electrons| {
                let full_well = electrons.at_highest(frame.highest);
                let read = self.read_noise / full_well;
                // One number is a step of gamma level^(1 - 1 / gamma) / highest; rounding spreads evenly over it.
                let share = level.max(0.0);
                let step = frame.highest.map_or(0.0, |highest| {
                    let share = share.max(1.0 / highest);
                    // What `pow` gives then, too.
                    let steep = if self.gamma == 1.0 { 1.0 } else { libm::pow(share, 1.0 - 1.0 / self.gamma) };
                    self.gamma * steep / highest
                });
                let variance = above.max(0.0) / full_well + read * read + step * step / 12.0;
                let factor = scale / gain;
                if good { variance * factor * factor } else { 0.0 }
            });
            Pixel { value: if good { value as f32 } else { 0.0 }, variance, reason }
        })
    }
}

/// What becomes of a pixel.
pub struct Pixel {
    pub value: f32,
    /// Where the camera's noise is known.
    pub variance: Option<f64>,
    pub reason: MaskReason,
}

/// How much of a frame can be used.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Light {
    pub pixels: usize,
    pub saturated: usize,
    /// Pixels above darkness.
    pub bright: usize,
}

impl Light {
    pub fn of(pixels: impl Iterator<Item = (f32, MaskReason)>) -> Self {
        pixels.fold(Self::default(), |all, (value, reason)| Self {
            pixels: all.pixels + 1,
            saturated: all.saturated + usize::from(reason == MaskReason::Saturated),
            bright: all.bright + usize::from(value > 0.0),
        })
    }
}

impl Corrected {
    pub fn light(&self) -> Light {
        Light::of(self.value.iter().copied().zip(self.reasons.iter().copied()))
    }
}
