//! The stage `demodulate`: layers in, layers out, one fused pass over blocks of rows.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{Covariance, Frames, Modulation, Phase, Scene};
use turbid_contract::{
    Ctx, Error, ImageStack, Known, LayerKind, Length, Problems, Stage, StagePlan, in_ports, out_ports,
};

use crate::pass::{Group, Pass, Tally};
use crate::set::{Noise, channels};
use crate::snapshot;

/// How fringes are separated from the mean.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// Least-squares sinusoid through N >= 3 frames with known phases.
    #[default]
    PhaseShift,
    /// One frame of each f_x: mean and fringe parted by filters along the line.
    SingleShot,
}

impl Method {
    fn name(self) -> &'static str {
        match self {
            Self::PhaseShift => "phase_shift",
            Self::SingleShot => "single_shot",
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

/// Params of `demodulate`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Params {
    pub method: Method,
    /// A pixel is masked where M_DC or M_AC of its 24 neighbours is in the mean not above this many of their standard
    /// errors; 0 masks only what is not above 0 itself.
    pub low_signal: f64,
    pub noise_bias: NoiseBias,
    /// A pixel is masked where a frame reaches this level (unit of the frames); frames may bring a mask of their own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub saturation: Option<f64>,
    /// single_shot: parts the spectrum by rectangles instead of Gaussians.
    pub rectangles: bool,
    /// single_shot: size of a pixel in the pattern's plane, where no scene is connected.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pixel_mm: Option<Length>,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            method: Method::PhaseShift,
            low_signal: 3.0,
            noise_bias: NoiseBias::Correct,
            saturation: None,
            rectangles: false,
            pixel_mm: None,
        }
    }
}

in_ports! {
    pub struct In {
        /// Camera frames: three phases or more for each f_x > 0, one for f_x = 0.
        frames: one Frames,
        /// Covariance behind the frames, where pixels of several frames share paths.
        covariance: optional Covariance,
        /// Camera whose pixels single_shot counts fringes in.
        scene: optional Scene,
    }
}

out_ports! {
    pub struct Out {
        /// M_DC and M_AC for each f_x, with standard errors and covariance where they are known.
        modulation: one Modulation,
        /// Wrapped phase for each f_x > 0.
        phase: optional Phase,
    }
}

/// `use: demodulate`
pub struct Demodulate;

impl Stage for Demodulate {
    const NAME: &'static str = "demodulate";
    const VERSION: u32 = 3;
    const ABOUT: &'static str =
        "M_DC, M_AC and phase of each pixel from frames of shifted sinusoids, with standard errors";

    type Params = Params;
    type In = In<'static>;
    type Out = Out;

    fn check(params: &Params, known: &Known, problems: &mut Problems) {
        let holds = params.low_signal >= 0.0 && params.low_signal.is_finite();
        problems.require(holds, "low_signal", params.low_signal, "", "be >= 0 (standard errors)");
        if let Some(pixel) = params.pixel_mm {
            problems.require(pixel.0 > 0.0, "pixel_mm", pixel.0, "mm", "be > 0");
        }
        let sized = params.pixel_mm.is_some() || known.connected.iter().any(|port| port == "scene");
        if params.method == Method::SingleShot && !sized {
            let hint = "connect the port `scene`, or give pixel_mm";
            problems.push_with_hint(
                "method",
                "single_shot counts fringes in pixels and does not know their size",
                hint,
            );
        }
        if let Some(level) = params.saturation {
            problems.require(level > 0.0 && level.is_finite(), "saturation", level, "", "be > 0 (unit of the frames)");
        }
    }

    fn plan(params: &Params, known: &Known) -> StagePlan {
        let covariance = known.connected.iter().any(|port| port == "covariance");
        StagePlan {
            method: Some(params.method.name().into()),
            left_out: if covariance { Vec::new() } else { vec!["covariance of the frames (not connected)".into()] },
            ..StagePlan::default()
        }
    }

    fn run(params: &Params, inputs: In<'_>, ctx: Ctx<'_>) -> Result<Out, Error> {
        if params.method == Method::SingleShot {
            let (modulation, phase) = snapshot::run(params, &inputs.frames, inputs.scene.as_ref(), ctx)?;
            return Ok(Out { modulation: Modulation(modulation), phase: phase.map(Phase) });
        }
        let frames = &inputs.frames.0;
        let sharing = frames.layers.iter().filter(|l| l.info.kind == LayerKind::Value).map(|l| frames.sharing(&l.info));
        let sharing = sharing.fold(frames.common_sharing(), f64::max);
        let wants_phase = ctx.wants("phase");
        let mut values = Group::default();
        let mut phases = Group::default();
        for channel in channels(&inputs.frames)? {
            channel.diagnose(frames, ctx);
            let noise = Noise::of_channel(&channel, &inputs.frames, inputs.covariance.as_ref())?;
            let pass = Pass::new(&channel, noise.as_ref(), frames, params, wants_phase, ctx.simd());
            let mut planes = vec![Array2::zeros((frames.rows(), frames.columns())); pass.plane_count()];
            let tiles = ctx.fill_planes(&mut planes, |pixels, planes| pass.run(pixels, planes))?;
            let mut tally = Tally::new(&channel);
            tiles.iter().for_each(|tile| tally.add(tile));
            tally.less(&pass.drop_weak(&mut planes, ctx)?);
            tally.report(&channel, noise.is_some(), ctx);
            pass.describe(planes, &tally, sharing, &mut values, &mut phases);
        }
        let stack = |group: Group| {
            let mut stack = ImageStack::new(frames.rows(), frames.columns());
            stack.attributes = frames.attributes.clone();
            group.into_iter_ordered().for_each(|(info, data)| stack.push(info, data));
            stack
        };
        let phase = wants_phase.then(|| Phase(stack(phases)));
        Ok(Out { modulation: Modulation(stack(values)), phase })
    }
}
