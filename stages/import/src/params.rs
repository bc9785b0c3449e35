//! Params of `import_frames`: which file shows what.

mod check;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use turbid_contract::payload::CameraNoise;
use turbid_contract::{AngleDeg, Length, MaxFile, PerLength};

use crate::conditions::ConditionsParams;
use crate::correct::{Camera, Electrons};
use crate::decode::{Channel, Picture, Raw, Wanted, decode};
use crate::names::{self, Place};

/// Params of `import_frames`: `pattern` with `f_x` and `phases`, or `frames`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Params {
    /// File name, relative to the pipeline file, with {f_x}, {f_x_index}, {phase} (its number), {phase_deg}, {wavelength}, {wavelength_index} and {n}, the number of
    /// the file: by wavelength, f_x and phase. Numbers begin with 0; {phase:1} begins with 1, {n:02} has two digits, {n:02+1} both. Without a phase in the name
    /// the pages of a file are the phases.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pattern: Option<String>,
    /// Of `pattern`: spatial frequencies, mm^-1, written in names as they stand here.
    pub f_x: Vec<PerLength>,
    /// Of `pattern`: equal steps of 2 pi / phases at each f_x > 0.
    pub phases: u32,
    /// Of `pattern`: the same at f_x = 0, where three steps or more of even light make an amplitude without black level and room light; 1 is a frame
    /// without steps.
    pub phases_at_0: u32,
    /// Of `pattern`.
    pub wavelength_nm: Vec<f64>,
    /// Direction of the fringes.
    pub orientation_deg: AngleDeg,
    /// Files one by one.
    pub frames: Vec<FrameParams>,
    /// Exposure of all files of `pattern` in ms, or one for each of `wavelength_nm`: frames are divided by it, so that sample and reference may be exposed
    /// differently. Their unit is then ms^-1 where `full_scale` (then at 1 ms) is left out.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub exposure_ms: Vec<f64>,
    /// What the camera reads without light.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dark: Option<String>,
    /// Several of them, each for the frames of its wavelength and exposure, where it names these; those that are for the same frames are averaged.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub darks: Vec<DarkParams>,
    /// What the camera reads without light in every pixel, in the numbers of the file, where no picture tells.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub black_level: Option<f64>,
    /// An even surface under even light, in the same camera.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub flat: Option<String>,
    /// Which channel of coloured files.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub channel: Option<Channel>,
    /// Name of the array in files of NumPy (.npz) and MATLAB that hold several.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub variable: Option<String>,
    /// Part of each picture, px: left, top, width, height.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub crop: Option<[u32; 4]>,
    /// Square of so many pixels a side that becomes one: the mean of what was corrected; masked where one of them is.
    #[serde(skip_serializing_if = "is_one")]
    pub bin: u32,
    /// Files without a header: what they hold.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub raw: Option<Raw>,
    /// Of the camera, where its numbers fill only part of the file's (12 in a file of 16), or are counts in floating-point files, of which 1 is full scale
    /// without it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bits: Option<u32>,
    /// Radiance at the highest number (floating-point files: at 1) and exposure 0, W mm^-2 sr^-1; left out: frames have the unit 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub full_scale: Option<f64>,
    /// Of the camera's encoding: number = level^(1 / gamma).
    pub gamma: f64,
    /// Share of the highest number from which on a pixel is masked; floating-point files have none, and nothing of them is saturated.
    pub saturation: f64,
    /// Electrons at the highest number; gives frames standard errors.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub full_well: Option<f64>,
    /// Electrons.
    pub read_noise: f64,
    /// How the frames were taken: what a table that reads them has to share.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub conditions: Option<ConditionsParams>,
    /// Name of the bench that took the frames, with all its settings: frames of two names are not calibrated with each other.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rig: Option<String>,
    /// Size of a pixel of the files on the sample, mm: gives pictures and files of the frames, and of what is made from them, a scale.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pixel_mm: Option<Length>,
    /// MB (10^6 bytes) that an input file may have; 1 GiB where left out. Not in the key.
    #[serde(skip_serializing)]
    pub max_file_mb: MaxFile,
}

/// One file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FrameParams {
    /// Relative to the pipeline file.
    pub file: String,
    /// Of several pictures in the file: its number, from 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub page: Option<u32>,
    /// Spatial frequency of what is projected; 0 is even light.
    pub f_x: PerLength,
    /// Phase of the fringes, (1 + cos(2 pi f_x u + phase)) / 2; at f_x = 0 that of even light in steps.
    #[serde(default)]
    pub phase_deg: AngleDeg,
    /// Direction of the fringes, where it is not that of all.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub orientation_deg: Option<AngleDeg>,
    /// Of the light, where frames have channels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wavelength_nm: Option<f64>,
    /// Stops: taken with 2^exposure times the light.
    #[serde(default)]
    pub exposure: f64,
    /// The same in ms; the frame is divided by it. All frames say it, or none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exposure_ms: Option<f64>,
    /// Name of its array, where it is not that of all.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub variable: Option<String>,
}

/// A picture without light.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DarkParams {
    /// Relative to the pipeline file.
    pub file: String,
    /// Of several pictures in the file: its number, from 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub page: Option<u32>,
    /// Of the frames that it is for; left out: of any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wavelength_nm: Option<f64>,
    /// Of the frames that it is for; left out: of any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exposure_ms: Option<f64>,
}

impl DarkParams {
    pub fn is_for(&self, shot: &Shot) -> bool {
        let fits = |own: Option<f64>, of: Option<f64>| own.is_none() || own == of;
        fits(self.wavelength_nm, shot.wavelength_nm) && fits(self.exposure_ms, shot.exposure_ms)
    }
}

impl Default for Params {
    fn default() -> Self {
        Self {
            pattern: None,
            f_x: Vec::new(),
            phases: 3,
            phases_at_0: 1,
            wavelength_nm: Vec::new(),
            orientation_deg: AngleDeg(0.0),
            frames: Vec::new(),
            exposure_ms: Vec::new(),
            dark: None,
            darks: Vec::new(),
            black_level: None,
            flat: None,
            channel: None,
            variable: None,
            crop: None,
            bin: 1,
            raw: None,
            bits: None,
            full_scale: None,
            gamma: 1.0,
            saturation: 0.98,
            full_well: None,
            read_noise: 0.0,
            conditions: None,
            rig: None,
            pixel_mm: None,
            max_file_mb: MaxFile::default(),
        }
    }
}

/// One file, and what it shows.
#[derive(Clone, Debug, PartialEq)]
pub struct Shot {
    /// Field that names it.
    pub at: String,
    pub file: String,
    /// Of several pictures in it, from 0.
    pub page: Option<usize>,
    /// Of several arrays in it.
    pub variable: Option<String>,
    pub f_x: f64,
    /// `None` of even light that takes no steps.
    pub phase_rad: Option<f64>,
    pub orientation_deg: f64,
    pub wavelength_nm: Option<f64>,
    /// Stops.
    pub exposure: f64,
    pub exposure_ms: Option<f64>,
}

impl Shot {
    /// How many times the light of exposure 0, or of 1 ms.
    pub fn light(&self) -> f64 {
        self.exposure_ms.unwrap_or(1.0) * libm::exp2(self.exposure)
    }
}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde asks so")]
fn is_one(n: &u32) -> bool {
    *n == 1
}

/// Files that hold one picture, by the end of their names.
const ONE_PICTURE: [&str; 6] = [".png", ".exr", ".bmp", ".pgm", ".csv", ".txt"];

/// Files of frames that a stage reads.
const MOST_FILES: u64 = 10_000;

impl Params {
    fn phases_of(&self, f_x: PerLength) -> u32 {
        if f_x.0 == 0.0 { self.phases_at_0 } else { self.phases }
    }

    /// How many files of frames are named.
    fn count(&self) -> u64 {
        let phases = |f_x: &PerLength| u64::from(self.phases_of(*f_x));
        let of_pattern: u64 = match self.pattern {
            Some(_) => self.f_x.iter().map(phases).sum::<u64>().saturating_mul(self.wavelength_nm.len().max(1) as u64),
            None => 0,
        };
        of_pattern.saturating_add(self.frames.len() as u64)
    }

    /// Every file of frames, in order; none where they are too many, which `check` reports.
    pub fn shots(&self) -> Vec<Shot> {
        if self.count() > MOST_FILES {
            return Vec::new();
        }
        let Some(pattern) = &self.pattern else { return self.listed() };
        let pages = !names::has_phase(pattern);
        let mut shots = Vec::new();
        let wavelengths: Vec<Option<f64>> = match &self.wavelength_nm[..] {
            [] => vec![None],
            list => list.iter().copied().map(Some).collect(),
        };
        for (wavelength_index, wavelength_nm) in wavelengths.into_iter().enumerate() {
            for (f_x_index, &PerLength(f_x)) in self.f_x.iter().enumerate() {
                let count = self.phases_of(PerLength(f_x));
                for phase in 0..count {
                    let n = shots.len();
                    let place = Place { f_x, f_x_index, phase, phases: count, wavelength_nm, wavelength_index, n };
                    let turn = 2.0 * std::f64::consts::PI * f64::from(phase) / f64::from(count);
                    shots.push(Shot {
                        at: format!("pattern.{n}"),
                        // What cannot be written is reported by `check`.
                        file: names::fill(pattern, &place).unwrap_or_else(|_| pattern.clone()),
                        page: (pages && count > 1).then_some(phase as usize),
                        f_x,
                        phase_rad: (f_x > 0.0 || count > 1).then_some(turn),
                        orientation_deg: self.orientation_deg.0,
                        wavelength_nm,
                        exposure: 0.0,
                        exposure_ms: self.exposure_ms.get(wavelength_index).or(self.exposure_ms.first()).copied(),
                        variable: self.variable.clone(),
                    });
                }
            }
        }
        shots
    }

    fn listed(&self) -> Vec<Shot> {
        // Even light without steps has no phase.
        let steps = |f: &FrameParams| {
            f.f_x.0 > 0.0
                || self
                    .frames
                    .iter()
                    .any(|o| o.f_x.0 == 0.0 && o.wavelength_nm == f.wavelength_nm && o.phase_deg.0 != 0.0)
        };
        let shot = |(k, f): (usize, &FrameParams)| Shot {
            at: format!("frames.{k}.file"),
            file: f.file.clone(),
            page: f.page.map(|page| page.saturating_sub(1) as usize),
            f_x: f.f_x.0,
            phase_rad: steps(f).then(|| f.phase_deg.0 * (2.0 * std::f64::consts::PI) / 360.0),
            orientation_deg: f.orientation_deg.unwrap_or(self.orientation_deg).0,
            wavelength_nm: f.wavelength_nm,
            exposure: f.exposure,
            exposure_ms: f.exposure_ms,
            variable: f.variable.clone().or_else(|| self.variable.clone()),
        };
        self.frames.iter().enumerate().map(shot).collect()
    }

    /// The picture that is meant of a file of frames, or of a dark or flat field.
    ///
    /// Error: what is wrong with the file.
    pub fn read(&self, bytes: &[u8], page: Option<usize>, variable: Option<&str>) -> Result<Picture, String> {
        let wanted = Wanted { channel: self.channel, page, variable, raw: self.raw };
        let picture = decode(bytes, wanted)?.of_bits(self.bits)?.cropped(self.crop)?;
        let Picture { rows, columns, .. } = picture;
        if rows.min(columns) < self.bin as usize {
            return Err(format!("it has {columns} x {rows} pixels, fewer than bin = {} a side", self.bin));
        }
        Ok(picture)
    }

    /// The picture of the field that names its file.
    ///
    /// Error: what is wrong with the file.
    pub fn read_at(&self, shots: &[Shot], at: &str, bytes: &[u8]) -> Result<Picture, String> {
        if let Some(shot) = shots.iter().find(|shot| shot.at == at) {
            return self.read(bytes, shot.page, shot.variable.as_deref());
        }
        let dark = names::place_in(at, "darks").and_then(|k| self.darks.get(k));
        let page = dark.and_then(|dark| dark.page).map(|page| page.saturating_sub(1) as usize);
        self.read(bytes, page, self.variable.as_deref())
    }

    /// With the noise that a photon transfer found, where there is one.
    pub fn camera(&self, noise: Option<&CameraNoise>) -> Camera {
        let own = self.full_well.map(Electrons::AtHighest);
        let found = noise.map(|noise| Electrons::PerNumber(noise.electrons_per_number));
        Camera {
            full_scale: self.full_scale.unwrap_or(1.0),
            gamma: self.gamma,
            saturation: self.saturation,
            electrons: found.or(own),
            read_noise: noise.map_or(self.read_noise, |noise| noise.read_noise),
            black_level: self.black_level.unwrap_or(0.0),
        }
    }
}
