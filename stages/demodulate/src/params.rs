//! The params of `demodulate`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use turbid_contract::{Length, PerLength};

/// How fringes are separated from the mean.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// Least-squares sinusoid through N >= 3 frames with known phases.
    #[default]
    PhaseShift,
    /// One frame of each f_x: mean and fringe parted by filters along the line.
    SingleShot,
    /// Frames under random light (si-SFDI): amplitudes from the power of the speckle in a window.
    Speckle,
}

impl Method {
    /// As pipeline files spell it.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::PhaseShift => "phase_shift",
            Self::SingleShot => "single_shot",
            Self::Speckle => "speckle",
        }
    }
}

/// What becomes of the Rician bias s^2 / (2 M_AC), which noise of variance s^2 across the phasor adds to M_AC.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum NoiseBias {
    /// Taken off pixel by pixel; without standard errors nothing changes.
    #[default]
    Correct,
    /// Left in: M_AC is the amplitude of the sinusoid through the frames.
    Keep,
}

/// Whether the frames' phases are what they say.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Steps {
    /// As the frames say.
    #[default]
    Given,
    /// Found from the frames, near what they say; the first is kept.
    Estimated,
}

/// How single_shot parts the mean of a line from its fringe.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Filter {
    /// Mean and fringe of a pixel together, by least squares under a Gaussian window along the line.
    #[default]
    LeastSquares,
    /// Gaussians of sigma f_c / 4 around 0 and the carrier f_c; lines are mirrored at their ends.
    Gaussian,
    /// |f| < f_c / 2 and f_c / 2 .. 3 f_c / 2; lines are mirrored at their ends.
    Rectangle,
}

/// Params of `demodulate`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Params {
    pub method: Method,
    /// A pixel is masked where M_DC or M_AC of its 24 neighbours is in the mean not above this many of their standard
    /// errors; 0 masks only what is not above 0 itself.
    pub low_signal: f64,
    pub noise_bias: NoiseBias,
    /// phase_shift: whether the phase steps are known.
    pub steps: Steps,
    /// A pixel is masked where a frame reaches this level (unit of the frames); frames may bring a mask of their own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub saturation: Option<f64>,
    /// single_shot: how mean and fringe are parted.
    pub filter: Filter,
    /// speckle: spatial frequencies to read.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub f_x: Vec<PerLength>,
    /// Width of the window around a pixel, four standard deviations of its Gaussian; `amplitude_window` is another name of it. speckle: two periods of
    /// the lowest f_x or more; single_shot by least squares: one period or more, two if left out.
    #[serde(skip_serializing_if = "Option::is_none", alias = "amplitude_window")]
    pub window: Option<Length>,
    /// Width of the window of M_DC, if another. speckle, whose M_DC needs no band of frequencies: half of `window` if left out; single_shot by least
    /// squares: one period or more, that of the fringe if left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mean_window: Option<Length>,
    /// single_shot, speckle: size of a pixel in the pattern's plane, where no scene is connected.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pixel_mm: Option<Length>,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            method: Method::PhaseShift,
            low_signal: 3.0,
            noise_bias: NoiseBias::Correct,
            steps: Steps::Given,
            saturation: None,
            filter: Filter::LeastSquares,
            f_x: Vec::new(),
            window: None,
            mean_window: None,
            pixel_mm: None,
        }
    }
}
