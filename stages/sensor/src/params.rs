//! Params of `sensor`, and everything that can be wrong with them.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use turbid_contract::Problems;

/// Params of `sensor`; every part of the camera is off until it is named.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Params {
    /// Stops: the camera gets 2^exposure times the light.
    pub exposure: f64,
    /// Radiance that saturates at exposure 0, W mm^-2 sr^-1; left out: the 99.9th percentile of all pixels of all frames.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub full_scale: Option<f64>,
    /// Electrons of a pixel at full scale; left out: no shot noise and no read noise.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub full_well: Option<f64>,
    /// Standard deviation of the read noise, electrons.
    pub read_noise: f64,
    /// Level at which the camera reads darkness, share of full scale.
    pub black: f64,
    /// Encoding: number = level^(1 / gamma).
    pub gamma: f64,
    /// Whether numbers are turned back through the gamma; a user who does not know of it has `false`.
    pub linearise: bool,
    /// Numbers 0 to 2^bits - 1; left out: not rounded.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bits: Option<u32>,
    /// Standard deviation of the Gaussian point spread, px.
    pub defocus_px: f64,
    /// Share of the light that the lens loses in the corners; it grows with the square of the distance from the middle.
    pub vignetting: f64,
    /// Standard deviation of the pixels' response to light, share of its mean.
    pub response_spread: f64,
    /// Standard deviation of the level at which pixels read darkness, share of the range.
    pub dark_spread: f64,
    /// Number of the camera: stages that say the same have the same pixels, whatever they look at.
    pub camera: u32,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            exposure: 0.0,
            full_scale: None,
            full_well: None,
            read_noise: 0.0,
            black: 0.0,
            gamma: 1.0,
            linearise: true,
            bits: None,
            defocus_px: 0.0,
            vignetting: 0.0,
            response_spread: 0.0,
            dark_spread: 0.0,
            camera: 0,
        }
    }
}

impl Params {
    /// Reports every mistake.
    pub fn check(&self, problems: &mut Problems) {
        let mut within = |name: &str, value: f64, low: f64, high: f64, unit: &str| {
            let rule = format!("lie in [{low}, {high}]");
            problems.require((low..=high).contains(&value), name, value, unit, &rule);
        };
        within("exposure", self.exposure, -30.0, 30.0, "stops");
        within("black", self.black, 0.0, 0.9, "");
        within("gamma", self.gamma, 0.1, 10.0, "");
        within("defocus_px", self.defocus_px, 0.0, 100.0, "px");
        within("read_noise", self.read_noise, 0.0, 1e6, "electrons");
        within("vignetting", self.vignetting, 0.0, 0.99, "");
        within("response_spread", self.response_spread, 0.0, 0.2, "");
        within("dark_spread", self.dark_spread, 0.0, 0.2, "");
        if let Some(full_well) = self.full_well {
            within("full_well", full_well, 1.0, 1e9, "electrons");
        }
        if let Some(bits) = self.bits {
            within("bits", f64::from(bits), 1.0, 24.0, "bits");
        }
        if let Some(full_scale) = self.full_scale {
            let holds = full_scale > 0.0 && full_scale.is_finite();
            problems.require(holds, "full_scale", full_scale, "W mm^-2 sr^-1", "be a finite number > 0");
        }
        if self.full_well.is_none() && self.read_noise > 0.0 {
            let message = "read_noise is in electrons, and how many fill the range is not given";
            problems.push_with_hint("read_noise", message, "give full_well, 10000 for example");
        }
        if !self.linearise && self.gamma == 1.0 {
            problems.warn("linearise", "there is no gamma that could be left in the frames");
        }
        if self.dark_spread > 0.0 && self.black < 2.0 * self.dark_spread {
            let message =
                "pixels that read darkness below the range are cut off at 0: black is less than twice their spread";
            problems.warn("black", message);
        }
        if self.read_noise > 0.0 && self.black == 0.0 {
            problems.warn(
                "black",
                "without a black level dark pixels lose the lower half of their read noise, and read too bright",
            );
        }
    }
}
