//! The pass over the pixels: mu_a and mu_s' of all wavelengths in, concentrations, saturation and the power law out.

use std::borrow::Cow;
use std::ops::Range;

use fearless_simd::Level;
use turbid_contract::payload::MaskReason;
use turbid_contract::{ImageStack, Layer};

use crate::channels::Quantity;
use crate::form::{Doubt, Made};
use crate::least_squares::Noise;
use crate::oxygen::{saturation, total};
use crate::params::{Fit, Params};
use crate::resolve::Resolved;
use crate::scatter::{self, PowerLawFit};
use crate::unmix::lanes::{self, LANES, Lanes};
use crate::unmix::{self, Mixture, Unmixed};

/// A quantity of all wavelengths, ready to be read pixel by pixel.
struct Planes<'a> {
    values: Vec<Cow<'a, [f32]>>,
    errors: Option<Vec<Cow<'a, [f32]>>>,
    covariances: Vec<([usize; 2], Cow<'a, [f32]>)>,
    /// Flags of unknown errors.
    unknown: Vec<Cow<'a, [f32]>>,
}

/// Values of a pixel, with what is known of their noise.
#[derive(Default)]
struct Read {
    values: Vec<f64>,
    errors: Vec<f64>,
    covariance: Vec<f64>,
}

impl<'a> Planes<'a> {
    fn of(stack: &'a ImageStack, quantity: &Quantity) -> Self {
        let pixels = |&place: &usize| stack.layers[place].pixels();
        let flagged = |&place: &usize| stack.se_unknown(&stack.layers[place].info).map(Layer::pixels);
        Self {
            values: quantity.layers.iter().map(pixels).collect(),
            errors: quantity.errors.as_ref().map(|places| places.iter().map(pixels).collect()),
            covariances: quantity.covariances.iter().map(|(pair, place)| (*pair, pixels(place))).collect(),
            unknown: quantity.layers.iter().filter_map(flagged).collect(),
        }
    }

    /// Reads a pixel; `false` where it holds what is no finite number.
    fn read(&self, pixel: usize, into: &mut Read) -> bool {
        let count = self.values.len();
        let at = |planes: &[Cow<'_, [f32]>], into: &mut Vec<f64>| {
            into.clear();
            into.extend(planes.iter().map(|plane| f64::from(plane[pixel])));
            into.iter().all(|v| v.is_finite())
        };
        let mut finite = at(&self.values, &mut into.values);
        if let Some(errors) = &self.errors {
            finite &= at(errors, &mut into.errors);
        }
        into.covariance.clear();
        if !self.covariances.is_empty() && self.errors.is_some() {
            into.covariance.resize(count * count, 0.0);
            for (i, se) in into.errors.iter().enumerate() {
                into.covariance[i * count + i] = se * se;
            }
            for ([a, b], plane) in &self.covariances {
                let value = f64::from(plane[pixel]);
                finite &= value.is_finite();
                (into.covariance[a * count + b], into.covariance[b * count + a]) = (value, value);
            }
        }
        finite
    }

    /// Values and independent standard errors of the pixels from `first` on, wavelength by wavelength; `false` where that is not what there is.
    fn read_lanes(&self, first: usize, values: &mut Vec<Lanes>, errors: &mut Vec<Lanes>) -> bool {
        let Some(of_errors) = self.errors.as_ref().filter(|_| self.covariances.is_empty()) else { return false };
        let at = |planes: &[Cow<'_, [f32]>], into: &mut Vec<Lanes>| {
            into.clear();
            into.extend(planes.iter().map(|plane| {
                let pixels = &plane[first..first + LANES];
                let lanes: Lanes = std::array::from_fn(|l| f64::from(pixels[l]));
                lanes
            }));
        };
        at(&self.values, values);
        at(of_errors, errors);
        true
    }

    fn noise<'r>(&self, read: &'r Read) -> Noise<'r> {
        match &self.errors {
            None => Noise::Unknown,
            Some(_) if read.covariance.is_empty() => Noise::Independent(&read.errors),
            Some(_) => Noise::Full(&read.covariance),
        }
    }

    fn is_flagged(&self, pixel: usize) -> bool {
        self.unknown.iter().any(|plane| plane[pixel] != 0.0)
    }
}

/// How many planes of flags there are.
pub const DOUBTS: usize = 3;
/// Standard errors within which a haemoglobin that may not be negative is near its bound: StO2 then is near 0 or 1, and its error is not symmetric.
const NEAR: f64 = 1.0;
/// Standard errors of THb below which the ratio is too curved for an error of first order.
const CURVED: f64 = 3.0;

/// What is worked with at every pixel.
pub struct Pass<'a> {
    resolved: &'a Resolved,
    mixture: Mixture,
    law: Option<(PowerLawFit, Planes<'a>)>,
    mu_a: Planes<'a>,
    masks: Vec<Cow<'a, [f32]>>,
    non_negative: bool,
    /// How many planes hold values; standard errors follow, then a plane of flags for each [`Doubt`], then the mask.
    values: usize,
    errors: [bool; 2],
    level: Level,
}

/// Sums over pixels.
#[derive(Clone, Debug, Default)]
pub struct Tally {
    pub good: u64,
    /// Pixels with a concentration that is held at 0.
    pub held: u64,
    /// Sum of chi2 over pixels where nothing is held, and how many there are.
    pub chi2: f64,
    pub free: u64,
}

impl Tally {
    #[must_use]
    pub fn add(mut self, other: &Self) -> Self {
        self.good += other.good;
        self.held += other.held;
        self.chi2 += other.chi2;
        self.free += other.free;
        self
    }
}

/// Memory that is used again for each pixel.
#[derive(Default)]
struct Scratch {
    read: Read,
    unmix: unmix::Scratch,
    lanes: lanes::Scratch,
    values: Vec<Lanes>,
    errors: Vec<Lanes>,
    law: scatter::Scratch,
    /// Values, then standard errors.
    out: [Vec<f64>; 2],
}

/// What is said of a good pixel besides its values.
struct Said {
    /// For each [`Doubt`].
    unknown: [bool; DOUBTS],
    held: u32,
    chi2: Option<f64>,
}

impl<'a> Pass<'a> {
    pub fn of(params: &Params, resolved: &'a Resolved, stack: &'a ImageStack, made: &Made, level: Level) -> Self {
        let channels = &resolved.channels;
        let law = channels.mu_s_prime.as_ref();
        let mut masks: Vec<Cow<'a, [f32]>> = Vec::new();
        let mut seen: Vec<*const Layer> = Vec::new();
        for mask in channels.wavelengths_nm.iter().filter_map(|&nm| stack.mask(Some(nm))) {
            // A mask without a wavelength holds for all of them.
            if !seen.contains(&std::ptr::from_ref(mask)) {
                seen.push(std::ptr::from_ref(mask));
                masks.push(mask.pixels());
            }
        }
        Self {
            resolved,
            mixture: Mixture::new(&resolved.columns),
            law: law.map(|q| (PowerLawFit::new(&channels.wavelengths_nm), Planes::of(stack, q))),
            mu_a: Planes::of(stack, &channels.mu_a),
            masks,
            non_negative: params.fit == Fit::NonNegative,
            values: made.values().count(),
            errors: made.errors,
            level,
        }
    }

    /// Planes that [`run`](Self::run) fills.
    pub fn planes(&self, made: &Made) -> usize {
        self.values + made.with_errors().len() + DOUBTS + 1
    }

    /// Fills the planes of some pixels.
    pub fn run(&self, pixels: Range<usize>, planes: &mut [&mut [f32]]) -> Tally {
        let mut scratch = Scratch::default();
        let mut tally = Tally::default();
        for first in pixels.clone().step_by(LANES) {
            let mut solved = self.lanes(first, pixels.end, &mut scratch);
            for (pixel, solved) in (first..pixels.end).zip(&mut solved) {
                self.write(pixel, pixel - pixels.start, solved.take(), planes, &mut scratch, &mut tally);
            }
        }
        tally
    }

    /// What the pixels from `first` on are made of, where it was found for all of them at once.
    fn lanes(&self, first: usize, end: usize, scratch: &mut Scratch) -> [Option<Unmixed>; LANES] {
        let Scratch { lanes, values, errors, .. } = scratch;
        if first + LANES > end || !self.mu_a.read_lanes(first, values, errors) {
            return [const { None }; LANES];
        }
        for (mu_a, fixed) in values.iter_mut().zip(&self.resolved.fixed) {
            mu_a.iter_mut().for_each(|mu_a| *mu_a -= fixed);
        }
        self.mixture.unmix_lanes(self.level, values, errors, self.non_negative, lanes)
    }

    /// One pixel, into the place `place` of the planes.
    fn write(
        &self,
        pixel: usize,
        place: usize,
        solved: Option<Unmixed>,
        planes: &mut [&mut [f32]],
        scratch: &mut Scratch,
        tally: &mut Tally,
    ) {
        let last = planes.len() - 1;
        let said = match self.pixel(pixel, solved, scratch) {
            Err(code) => return planes[last][place] = code,
            Ok(said) => said,
        };
        let [values, se] = &scratch.out;
        let all = values.iter().chain(se);
        // What is finite in f64 may not be in f32.
        if all.clone().any(|&v| !(v as f32).is_finite()) {
            planes[last][place] = MaskReason::NotFinite.code();
            return;
        }
        all.zip(planes.iter_mut()).for_each(|(&v, plane)| plane[place] = v as f32);
        for (flag, plane) in said.unknown.into_iter().zip(&mut planes[last - DOUBTS..last]) {
            plane[place] = f32::from(u8::from(flag));
        }
        tally.good += 1;
        tally.held += u64::from(said.held > 0);
        if let (0, Some(chi2)) = (said.held, said.chi2) {
            tally.chi2 += chi2;
            tally.free += 1;
        }
    }

    /// Values and standard errors into `scratch.out`; `solved`: what it is made of, where that is known. Error: the code of the reason against the pixel.
    fn pixel(&self, pixel: usize, solved: Option<Unmixed>, scratch: &mut Scratch) -> Result<Said, f32> {
        let Scratch { read, unmix, law, out: [values, errors], .. } = scratch;
        if let Some(carried) = self.masks.iter().map(|mask| mask[pixel]).find(|&code| code != 0.0) {
            return Err(carried);
        }
        values.clear();
        errors.clear();
        let not_finite = MaskReason::NotFinite.code();
        let found = match solved {
            Some(found) => found,
            None if !self.mu_a.read(pixel, read) => return Err(not_finite),
            None => {
                read.values.iter_mut().zip(&self.resolved.fixed).for_each(|(mu_a, fixed)| *mu_a -= fixed);
                let found = self.mixture.unmix(&read.values, self.mu_a.noise(read), self.non_negative, unmix);
                found.ok_or(MaskReason::NoFit.code())?
            }
        };
        let count = self.resolved.species.len();
        values.extend(&found.amounts[..count]);
        let variance = |k: usize| found.covariance.map(|c| c[k][k].max(0.0));
        errors.extend((0..count).filter_map(|k| variance(k).map(f64::sqrt)));
        let held = found.held > 0 || self.mu_a.is_flagged(pixel);
        let mut unknown = [held, held, false];
        if let Some([a, b]) = self.resolved.haemoglobin {
            let of_both = found.covariance.map(|c| [[c[a][a], c[a][b]], [c[b][a], c[b][b]]]);
            let (hbo2, hb) = (found.amounts[a], found.amounts[b]);
            let (thb, of_thb) = total(hbo2, hb, of_both);
            let (st_o2, of_st_o2) = saturation(hbo2, hb, of_both).ok_or(MaskReason::LowSignal.code())?;
            values.extend([thb, st_o2]);
            errors.extend([of_thb, of_st_o2].into_iter().flatten().map(|variance| variance.max(0.0).sqrt()));
            let within = |value: f64, errors: f64, variance: Option<f64>| {
                variance.is_some_and(|variance| value * value < errors * errors * variance)
            };
            let at_end = self.non_negative && [(hbo2, a), (hb, b)].iter().any(|&(x, k)| within(x, NEAR, variance(k)));
            unknown[Doubt::Saturation as usize] |= at_end || within(thb, CURVED, of_thb);
        }
        if let Some((fit, planes)) = &self.law {
            if !planes.read(pixel, read) {
                return Err(not_finite);
            }
            let found = fit.fit(&read.values, planes.noise(read), law).ok_or(MaskReason::NoFit.code())?;
            values.extend([found.a, found.b]);
            errors.extend(found.covariance.iter().flat_map(|c| [c[0][0].max(0.0).sqrt(), c[1][1].max(0.0).sqrt()]));
            unknown[Doubt::Scattering as usize] = planes.is_flagged(pixel);
        }
        values.push(found.residual);
        if self.non_negative {
            values.push(f64::from(found.held));
        }
        Ok(Said {
            unknown: std::array::from_fn(|k| unknown[k] && self.errors[usize::from(k == Doubt::Scattering as usize)]),
            held: found.held,
            chi2: found.chi2,
        })
    }
}
