//! A frame on its way from the numbers of a camera to layers. Most are of 16 bits and have no dark level or response of single pixels: what becomes of
//! each number is then looked up, and no more than the numbers is held until the mask of all frames of a wavelength is known.

use turbid_contract::payload::MaskReason;

use crate::correct::{Corrected, Light, Pixel};

/// One frame.
pub enum Frame {
    Pixels(Corrected),
    Numbers { numbers: Vec<u16>, of: ByNumber },
}

/// What becomes of each number.
pub struct ByNumber {
    entries: Vec<Entry>,
    reasons: Vec<MaskReason>,
    /// Whether the camera's noise is known.
    noisy: bool,
}

#[derive(Clone, Copy)]
struct Entry {
    variance: f64,
    value: f32,
    /// As a layer holds it.
    se: f32,
}

impl ByNumber {
    /// Of what becomes of 0, 1, .., 65535.
    pub fn of(pixels: &[Pixel]) -> Self {
        let entry = |pixel: &Pixel| {
            let variance = pixel.variance.unwrap_or(0.0);
            Entry { variance, value: pixel.value, se: variance.sqrt() as f32 }
        };
        Self {
            entries: pixels.iter().map(entry).collect(),
            reasons: pixels.iter().map(|pixel| pixel.reason).collect(),
            noisy: pixels.iter().any(|pixel| pixel.variance.is_some()),
        }
    }
}

/// The layers of a frame.
pub struct Planes {
    pub value: Vec<f32>,
    /// Standard errors, and the sum of the variances of good pixels, where the camera's noise is known.
    pub errors: Option<(Vec<f32>, f64)>,
}

impl Frame {
    pub fn light(&self) -> Light {
        match self {
            Self::Pixels(corrected) => corrected.light(),
            Self::Numbers { numbers, of } => {
                let numbers = numbers.iter().map(|&number| usize::from(number));
                Light::of(numbers.map(|number| (of.entries[number].value, of.reasons[number])))
            }
        }
    }

    /// Writes the reasons against its pixels into a mask where none stands yet.
    pub fn mask(&self, mask: &mut [f32]) {
        let write = |(mask, reason): (&mut f32, MaskReason)| {
            if *mask == 0.0 {
                *mask = reason.code();
            }
        };
        match self {
            Self::Pixels(corrected) => mask.iter_mut().zip(corrected.reasons.iter().copied()).for_each(write),
            Self::Numbers { numbers, of } => {
                let reasons = || numbers.iter().map(|&number| of.reasons[usize::from(number)]);
                if reasons().any(|reason| reason != MaskReason::Good) {
                    mask.iter_mut().zip(reasons()).for_each(write);
                }
            }
        }
    }

    /// Its layers; 0 where `mask` is set.
    pub fn planes(self, mask: &[f32]) -> Planes {
        match self {
            Self::Pixels(mut corrected) => {
                corrected.value.iter_mut().zip(mask).filter(|(_, m)| **m != 0.0).for_each(|(value, _)| *value = 0.0);
                let variances = || corrected.variance.iter().zip(mask);
                let errors = (!corrected.variance.is_empty()).then(|| {
                    let se = variances().map(|(v, m)| if *m == 0.0 { v.sqrt() as f32 } else { 0.0 });
                    (se.collect(), variances().filter(|(_, m)| **m == 0.0).map(|(v, _)| v).sum())
                });
                Planes { value: corrected.value, errors }
            }
            Self::Numbers { numbers, of } => {
                let good = |m: f32, number: u16| (m == 0.0).then(|| of.entries[usize::from(number)]);
                if !of.noisy {
                    let value = numbers.iter().zip(mask).map(|(&n, &m)| good(m, n).map_or(0.0, |entry| entry.value));
                    return Planes { value: value.collect(), errors: None };
                }
                let (mut value, mut se, mut sum) = (vec![0.0; mask.len()], vec![0.0; mask.len()], 0.0);
                for ((value, se), (&n, &m)) in value.iter_mut().zip(&mut se).zip(numbers.iter().zip(mask)) {
                    if let Some(entry) = good(m, n) {
                        (*value, *se) = (entry.value, entry.se);
                        sum += entry.variance;
                    }
                }
                Planes { value, errors: Some((se, sum)) }
            }
        }
    }
}
