//! The stage `demodulate`: layers in, layers out, one fused pass over blocks of rows.

use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{Covariance, Frames, Modulation, Phase, Scene};
use turbid_contract::{
    Ctx, Error, Forms, ImageStack, Known, LayerInfo, Problems, Stage, StagePlan, in_ports, out_ports,
};

use crate::ambient;
use crate::diagnostics::Worst;
use crate::doubts::dark;
use crate::form::describe;
use crate::given::Noise;
use crate::layers::Group;
use crate::masked::measure_masked;
use crate::memory::memory;
use crate::params::{Filter, Method, Params, Steps};
use crate::pass::{Pass, Tally};
use crate::set::channels;
use crate::{joints, snapshot, speckled};

in_ports! {
    pub struct In {
        /// Camera frames: three phases or more for each f_x > 0, for f_x = 0 one or three and more.
        frames: parts Frames,
        /// Covariance behind the frames, where pixels of several frames share paths.
        covariance: optional Covariance,
        /// Camera whose pixels single_shot and speckle count in.
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

const NO_PHASE: &str = "speckle has no phase";

/// `use: demodulate`
pub struct Demodulate;

impl Stage for Demodulate {
    const NAME: &'static str = "demodulate";
    const VERSION: u32 = 9;
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
        if params.method != Method::PhaseShift && !sized {
            let hint = "connect the port `scene`, or give pixel_mm";
            let message = format!("{} counts in pixels and does not know their size", params.method.name());
            problems.push_with_hint("method", message, hint);
        }
        check_single_shot(params, problems);
        check_speckle(params, problems);
        if params.method == Method::Speckle && known.is_wanted("phase") {
            let hint = "take `method: phase_shift` or `single_shot` for who reads the output `phase`";
            problems.push_with_hint("method", NO_PHASE, hint);
        }
        if params.steps == Steps::Estimated {
            if params.method != Method::PhaseShift {
                problems.push("steps", format!("{} has no steps to estimate", params.method.name()));
            }
            if known.connected.iter().any(|port| port == "covariance") {
                let message = "the covariance is that of re and im of the given steps, not of estimated ones";
                problems.push_with_hint(
                    "steps",
                    message,
                    "leave the port `covariance` open: the frames have standard errors",
                );
            }
        }
        if let Some(level) = params.saturation {
            problems.require(level > 0.0 && level.is_finite(), "saturation", level, "", "be > 0 (unit of the frames)");
        }
        if problems.is_empty() {
            joints::check(params, known, problems);
        }
    }

    fn describe(params: &Params, known: &Known) -> Forms {
        describe(params, known)
    }

    fn plan(params: &Params, known: &Known) -> StagePlan {
        let covariance = known.connected.iter().any(|port| port == "covariance");
        // A window of speckle: measured with 12 frames; all else takes microseconds for a pixel.
        let camera = known.get::<Scene>("scene").and_then(|scene| scene.camera.clone());
        let windows = camera.filter(|_| params.method == Method::Speckle).zip(params.window).map(|(camera, window)| {
            let [columns, rows] = camera.pixels.map(f64::from);
            2.5e-6 * columns * rows * window.0 * columns / camera.field[0]
        });
        StagePlan {
            memory: memory(known, &describe(params, known), params.method == Method::PhaseShift),
            in_parts: if params.method == Method::PhaseShift { vec!["frames"] } else { Vec::new() },
            seconds: windows,
            method: Some(params.method.name().into()),
            left_out: if covariance { Vec::new() } else { vec!["covariance of the frames (not connected)".into()] },
            ..StagePlan::default()
        }
    }

    fn run(params: &Params, inputs: In<'_>, ctx: Ctx<'_>) -> Result<Out, Error> {
        if params.method != Method::PhaseShift {
            return whole(params, &inputs, ctx);
        }
        let head = inputs.frames.head();
        let conditions = inputs.frames.conditions()?.0;
        let wants_phase = ctx.wants("phase");
        let mut values = Group::default();
        let mut phases = Group::default();
        let (mut worst, mut all_good) = (Worst::default(), true);
        let layers: Vec<&LayerInfo> = head.layers.iter().collect();
        for (number, wavelength_nm) in channels(&layers)?.into_iter().map(|channel| channel.wavelength_nm).enumerate() {
            // Of the frames those of one wavelength are in memory.
            let part = inputs.frames.channel(wavelength_nm)?;
            let frames = &part.0;
            warn_of_darkness(frames, ctx);
            let infos: Vec<&LayerInfo> = frames.layers.iter().map(|layer| &layer.info).collect();
            let mut channel = channels(&infos)?.pop().expect("the frames of a wavelength are one channel");
            if params.steps == Steps::Estimated {
                channel.estimate_steps(frames, &mut worst)?;
            }
            channel.turn_even_light(frames, ctx);
            channel.check_frames(frames, params.saturation, ctx);
            channel.diagnose(frames, params.steps == Steps::Given, &mut worst, ctx);
            let noise = Noise::of_channel(&channel, &part, inputs.covariance.as_ref())?;
            let pass = Pass::new(&channel, noise.as_ref(), frames, params, wants_phase, ctx.simd());
            let dim = (frames.rows(), frames.columns());
            // Each of its own: a copy would write all its zeros.
            let mut planes: Vec<_> = (0..pass.plane_count()).map(|_| Array2::zeros(dim)).collect();
            let tiles = ctx.fill_planes(&mut planes, |pixels, planes| pass.run(pixels, planes))?;
            let mut tally = Tally::new(&channel);
            tiles.iter().for_each(|tile| tally.add(tile));
            tally.less(&pass.drop_weak(&mut planes, ctx)?);
            all_good &= tally.all_good();
            tally.report(&channel, noise.is_some(), &planes[planes.len() - 1], ctx);
            pass.describe(planes, &tally, (frames, number), &mut values, &mut phases);
            let mask = &values.masks.last().expect("each channel has one").1;
            let light = ambient::of_channel(&channel, frames, noise.as_ref(), mask, ctx);
            if let (Some(info), Some((light, errors))) = (ambient::info(&channel), light) {
                values.errors.extend(errors.map(|errors| (info.standard_error(), errors)));
                values.values.push((info, light));
            }
        }
        let stack = |group: Group<(LayerInfo, Array2<f32>)>| {
            let mut stack = ImageStack::new(head.rows, head.columns);
            stack.attributes = head.attributes.clone();
            group.into_iter_ordered().for_each(|(info, data)| stack.push(info, data));
            stack
        };
        worst.measure(ctx);
        let phase = wants_phase.then(|| Phase(stack(phases)));
        let mut modulation = stack(values);
        if all_good {
            ctx.measure("masked", 0.0, "%");
        } else {
            measure_masked(&modulation, ctx);
        }
        modulation.carry_conditions(&conditions);
        Ok(Out { modulation: Modulation(modulation), phase })
    }
}

fn warn_of_darkness(frames: &ImageStack, ctx: Ctx<'_>) {
    for light in dark(frames) {
        ctx.warn(format!(
            "the frames{light} are 0 in every pixel: no light comes to the camera; do projector and camera look at the same place, from the same side of the surface?"
        ));
    }
}

/// The methods that take a frame for more than its pixels.
fn whole(params: &Params, inputs: &In<'_>, ctx: Ctx<'_>) -> Result<Out, Error> {
    let frames = inputs.frames.whole()?;
    warn_of_darkness(&frames.0, ctx);
    let (mut modulation, phase) = match params.method {
        Method::Speckle if ctx.wants("phase") => return Err(Error::failed(NO_PHASE)),
        Method::Speckle => (speckled::run(params, &frames, inputs.scene.as_ref(), ctx)?, None),
        _ => snapshot::run(params, &frames, inputs.scene.as_ref(), ctx)?,
    };
    modulation.carry_conditions(&frames.0);
    Ok(Out { modulation: Modulation(modulation), phase: phase.map(Phase) })
}

/// What only single_shot has.
fn check_single_shot(params: &Params, problems: &mut Problems) {
    let single = params.method == Method::SingleShot;
    if !single && params.filter != Filter::default() {
        problems.push("filter", "only `method: single_shot` reads filter");
    }
    for (field, window) in [("window", params.window), ("mean_window", params.mean_window)] {
        let Some(window) = window.filter(|_| single) else { continue };
        problems.require(window.0 > 0.0, field, window.0, "mm", "be > 0");
        if params.filter != Filter::LeastSquares {
            let what =
                "the filters have widths of their own, a quarter or half of the carrier; only `least_squares` reads";
            problems.push(field, format!("{what} {field}"));
        }
    }
}

/// What speckle needs, and what only speckle has.
fn check_speckle(params: &Params, problems: &mut Problems) {
    if params.method != Method::Speckle {
        if !params.f_x.is_empty() {
            problems.push("f_x", "only `method: speckle` reads f_x");
        }
        for (field, window) in [("window", params.window), ("mean_window", params.mean_window)] {
            if window.is_some() && params.method != Method::SingleShot {
                problems.push(field, format!("only `method: single_shot` and `method: speckle` read {field}"));
            }
        }
        return;
    }
    if params.f_x.is_empty() {
        problems.push_with_hint("f_x", "speckle holds all f_x, and none is named", "f_x: [0.05, 0.1], for example");
    }
    let window = params.window.map_or(0.0, |w| w.0);
    if params.window.is_none() {
        problems.push_with_hint("window", "the width of the window around a pixel is missing", "30 mm, for example");
    }
    if let Some(mean) = params.mean_window {
        problems.require(mean.0 > 0.0, "mean_window", mean.0, "mm", "be > 0");
    }
    for (k, f_x) in params.f_x.iter().enumerate() {
        let field = format!("f_x.{k}");
        problems.require(f_x.0 > 0.0 && f_x.0.is_finite(), field.as_str(), f_x.0, "mm^-1", "be > 0");
        if params.window.is_some() && f_x.0 > 0.0 && window * f_x.0 < 2.0 {
            let message = format!("a window of {window} mm holds {:.2} periods of f_x = {f_x}", window * f_x.0);
            problems.push_with_hint(field, message, "two periods or more tell it from the mean: widen the window");
        }
    }
}
