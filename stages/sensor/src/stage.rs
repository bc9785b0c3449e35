//! The stage `sensor`.

use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{Covariance, Frames, MaskReason, Rig};
use turbid_contract::{
    Ctx, Error, Extent, Forms, ImageStack, Known, Layer, LayerInfo, LayerKind, Problems, Stage, StagePlan, in_ports,
    out_ports,
};
use turbid_optics::philox;

use crate::blur::Blur;
use crate::camera::Camera;
use crate::covariance::covariance;
use crate::form::{self, mask, number_layer};
use crate::noise::Draws;
use crate::params::Params;
use crate::pixels::Pixels;

in_ports! {
    pub struct In {
        /// Ideal frames.
        frames: one Frames,
        /// Their covariance, where pixels of several frames share paths.
        covariance: optional Covariance,
    }
}

out_ports! {
    pub struct Out {
        /// Frames as the camera gives them, as radiance; saturated pixels are masked.
        frames: one Frames,
        /// Covariance behind them: that of the ideal frames and the camera's own.
        covariance: optional Covariance,
        /// What the camera writes: 0 to 2^bits - 1, or a share of the range; nothing corrected, nothing masked.
        numbers: optional Frames,
    }
}

/// Share of the pixels that may saturate where no full scale is given.
const BRIGHTEST: f64 = 0.001;

/// `use: sensor`
pub struct Sensor;

impl Stage for Sensor {
    const NAME: &'static str = "sensor";
    const VERSION: u32 = 3;
    const ABOUT: &'static str =
        "what a camera makes of ideal frames: exposure, defocus, noise, gamma, saturation, rounding";

    type Params = Params;
    type In = In<'static>;
    type Out = Out;

    fn draws(params: &Params) -> bool {
        params.full_well.is_some()
    }

    fn check(params: &Params, known: &Known, problems: &mut Problems) {
        params.check(problems);
        form::check(known, problems);
    }

    fn describe(_params: &Params, known: &Known) -> Forms {
        form::describe(known)
    }

    fn plan(params: &Params, known: &Known) -> StagePlan {
        let parts = [
            ("shot noise and read noise", params.full_well.is_some()),
            ("gamma", params.gamma != 1.0),
            ("rounding", params.bits.is_some()),
            ("defocus", params.defocus_px > 0.0),
            ("vignetting", params.vignetting > 0.0),
            ("pixels unlike each other", params.response_spread > 0.0 || params.dark_spread > 0.0),
        ];
        let named = |on: bool| parts.iter().filter(|p| p.1 == on).map(|p| p.0.to_owned()).collect();
        let mut plan = StagePlan { needs: named(true), left_out: named(false), ..StagePlan::default() };
        if let Some(frames) = known.extent("frames") {
            let covariance = known.extent("covariance").map_or(0, Extent::bytes);
            plan.memory = memory(frames.bytes() + covariance, known);
        }
        plan
    }

    fn run(params: &Params, inputs: In<'_>, ctx: Ctx<'_>) -> Result<Out, Error> {
        let Frames(ideal) = &inputs.frames;
        let values: Vec<&Layer> = ideal.layers.iter().filter(|l| l.info.kind == LayerKind::Value).collect();
        let full_scale = params.full_scale.map_or_else(|| brightest(ideal, &values), Ok)?;
        ctx.measure("full_scale", full_scale, "W mm^-2 sr^-1");
        let camera = Camera {
            full_scale: full_scale / libm::exp2(params.exposure),
            black: params.black,
            full_well: params.full_well,
            read_noise: params.read_noise,
            gamma: params.gamma,
            linearise: params.linearise,
            bits: params.bits,
        };
        let blur = Blur::new(params.defocus_px);
        let pixels = Pixels::new(params, ideal.rows(), ideal.columns());
        let key = philox::key(ctx.seed());
        let seen = ctx.map_tiles(values.len(), |k| see(ideal, values[k], k, &camera, &blur, &pixels, key))?;
        let bad = masks(ideal, &values, &seen);
        let mut frames = frames(ideal, &values, &seen, &bad, &pixels, &blur);
        frames.carry_conditions(ideal);
        let saturated = bad.iter().map(|b| b.reasons.iter().filter(|&&r| r == MaskReason::Saturated.code()).count());
        let all = (ideal.rows() * ideal.columns() * bad.len()) as f64;
        let share = 100.0 * saturated.sum::<usize>() as f64 / all;
        ctx.measure("saturated", share, "%");
        if share > 10.0 {
            ctx.warn(format!(
                "{share:.0} % of the pixels are saturated in some frame: lower exposure or raise full_scale"
            ));
        }
        let covariance = ctx.wants("covariance").then(|| {
            let infos: Vec<&LayerInfo> = values.iter().map(|l| &l.info).collect();
            let given = inputs.covariance.as_ref();
            given.map_or(Ok(()), |given| Rig::shared(&ideal.attributes, &given.0.attributes))?;
            let independent = |s: &Seen| if given.is_some() { s.added.clone() } else { s.variance() };
            let variances: Vec<Vec<f64>> = seen.iter().map(independent).collect();
            let any_bad: Vec<bool> =
                (0..ideal.rows() * ideal.columns()).map(|i| bad.iter().any(|b| b.reasons[i] != 0.0)).collect();
            let spread = blur.of_variances();
            covariance(
                &infos,
                &variances,
                &any_bad,
                (ideal.rows(), ideal.columns()),
                given.map(|g| (g, &spread, pixels.response.as_slice())),
            )
        });
        let covariance = covariance.transpose()?.map(|mut covariance| {
            covariance.0.take_pixel_pitch(ideal);
            covariance
        });
        let numbers = ctx.wants("numbers").then(|| Frames(numbers(ideal, &values, &seen)));
        Ok(Out { frames: Frames(frames), covariance, numbers })
    }
}

/// Bytes that the run holds at the most, beside those of its inputs; `None` where the layers of the frames are not known.
///
/// Of each frame: value, noise of the light and of the camera, and number in f64, two flags; before that its pixels once more, to be sorted for the
/// full scale. Then the outputs.
fn memory(inputs: u64, known: &Known) -> Option<u64> {
    let forms = form::describe(known);
    let wanted = forms.iter().filter(|(port, _)| **port == "frames" || known.is_wanted(port));
    let made: u64 = wanted.map(|(_, form)| form.extent().map(Extent::bytes)).sum::<Option<u64>>()?;
    let numbers = forms.get("numbers")?.extent()?;
    Some(inputs + 38 * numbers.layers() * numbers.pixels() + made)
}

/// The radiance that all but 0.1 % of the pixels of all frames stay below.
fn brightest(stack: &ImageStack, values: &[&Layer]) -> Result<f64, Error> {
    let mut all: Vec<f32> = Vec::new();
    for layer in values {
        let mask = stack.mask(layer.info.wavelength_nm).map(Layer::pixels);
        let pixels = layer.pixels();
        let good =
            pixels.iter().enumerate().filter(|(i, v)| v.is_finite() && mask.as_ref().is_none_or(|m| m[*i] == 0.0));
        all.extend(good.map(|(_, &v)| v));
    }
    all.sort_by(f32::total_cmp);
    let at = ((1.0 - BRIGHTEST) * all.len() as f64) as usize;
    match all.get(at.min(all.len().saturating_sub(1))) {
        Some(&value) if value > 0.0 => Ok(f64::from(value)),
        _ => Err(Error::failed_with_hint("the frames are dark: no pixel is above 0", "look at the ideal frames")),
    }
}

/// One frame as the camera gives it.
struct Seen {
    value: Vec<f64>,
    /// Of the light, spread by the defocus; none where the ideal frame does not know its own.
    light: Option<Vec<f64>>,
    /// What the camera adds.
    added: Vec<f64>,
    number: Vec<f64>,
    saturated: Vec<bool>,
}

impl Seen {
    fn variance(&self) -> Vec<f64> {
        match &self.light {
            Some(light) => light.iter().zip(&self.added).map(|(a, b)| a + b).collect(),
            None => self.added.clone(),
        }
    }
}

fn see(
    stack: &ImageStack,
    layer: &Layer,
    frame: usize,
    camera: &Camera,
    blur: &Blur,
    pixels: &Pixels,
    key: [u32; 2],
) -> Seen {
    let columns = stack.columns();
    let mut ideal: Vec<f64> = layer.pixels().iter().map(|&v| if v.is_finite() { f64::from(v) } else { 0.0 }).collect();
    blur.apply(&mut ideal, columns);
    let light = stack.standard_error(&layer.info).map(|se| {
        let mut variance: Vec<f64> = se.pixels().iter().map(|&e| f64::from(e) * f64::from(e)).collect();
        blur.of_variances().apply(&mut variance, columns);
        variance.iter_mut().zip(&pixels.response).for_each(|(v, r)| *v *= r * r);
        variance
    });
    let mut seen = Seen { value: Vec::new(), light, added: Vec::new(), number: Vec::new(), saturated: Vec::new() };
    for (pixel, radiance) in ideal.into_iter().enumerate() {
        let radiance = radiance * pixels.response[pixel];
        let exposed = camera.expose(radiance, pixels.dark[pixel], &mut Draws::new(key, frame, pixel));
        seen.number.push(exposed.number);
        seen.value.push(exposed.value);
        seen.added.push(exposed.variance);
        seen.saturated.push(exposed.saturated);
    }
    seen
}

/// Why pixels of one wavelength are bad.
struct Mask {
    wavelength_nm: Option<f64>,
    reasons: Vec<f32>,
}

/// A pixel that is saturated in one frame is bad in all of its wavelength: no sinusoid goes through a clipped value.
fn masks(stack: &ImageStack, values: &[&Layer], seen: &[Seen]) -> Vec<Mask> {
    let mut masks: Vec<Mask> = Vec::new();
    for (layer, seen) in values.iter().zip(seen) {
        let wavelength_nm = layer.info.wavelength_nm;
        let k = masks.iter().position(|m| m.wavelength_nm == wavelength_nm).unwrap_or_else(|| {
            let carried = stack.mask(wavelength_nm).map(|m| m.pixels().to_vec());
            let reasons = carried.unwrap_or_else(|| vec![0.0; stack.rows() * stack.columns()]);
            masks.push(Mask { wavelength_nm, reasons });
            masks.len() - 1
        });
        let pixels = layer.pixels();
        for (i, reason) in masks[k].reasons.iter_mut().enumerate().filter(|(_, r)| **r == 0.0) {
            if !pixels[i].is_finite() {
                *reason = MaskReason::NotFinite.code();
            } else if seen.saturated[i] {
                *reason = MaskReason::Saturated.code();
            }
        }
    }
    masks
}

/// The largest share of a blurred pixel that may come from pixels without a known error while its own counts as known.
const LARGEST_SHARE: f64 = 0.1;

/// 1 at good pixels whose light comes from where the ideal frame does not know its standard error; `None` where it knows it everywhere.
fn se_unknown(ideal: &ImageStack, info: &LayerInfo, blur: &Blur, good: impl Fn(usize) -> bool) -> Option<Vec<f32>> {
    let flags = ideal.se_unknown(info)?.pixels();
    let mut share: Vec<f64> = flags.iter().map(|&flag| f64::from(u8::from(flag != 0.0))).collect();
    blur.apply(&mut share, ideal.columns());
    let flags: Vec<f32> = (0..share.len()).map(|i| f32::from(u8::from(good(i) && share[i] > LARGEST_SHARE))).collect();
    flags.contains(&1.0).then_some(flags)
}

fn frames(
    ideal: &ImageStack,
    values: &[&Layer],
    seen: &[Seen],
    masks: &[Mask],
    pixels: &Pixels,
    blur: &Blur,
) -> ImageStack {
    let (rows, columns) = (ideal.rows(), ideal.columns());
    let squares: f64 = pixels.response.iter().map(|r| r * r).sum();
    let response = (squares / (rows * columns) as f64).sqrt();
    let plane = |pixels: Vec<f32>| Array2::from_shape_vec((rows, columns), pixels).expect("one number per pixel");
    let mut stack = ImageStack::new(rows, columns);
    stack.attributes = ideal.attributes.clone();
    let (mut errors, mut unknown) = (Vec::new(), Vec::new());
    for (layer, seen) in values.iter().zip(seen) {
        let mask =
            masks.iter().find(|m| m.wavelength_nm == layer.info.wavelength_nm).expect("a mask for each wavelength");
        let good = |i: usize| mask.reasons[i] == 0.0;
        let variance = seen.variance();
        let n = (0..rows * columns).filter(|&i| good(i)).count() as f64;
        let added: f64 = (0..rows * columns).filter(|&i| good(i)).map(|i| seen.added[i]).sum();
        let mut info = layer.info.clone();
        // Pixels of the light may share paths; the camera's noise they do not share.
        let shared = response * info.mean_se.unwrap_or(0.0);
        info.mean_se = (n > 0.0 && (info.mean_se.is_some() || seen.light.is_none()))
            .then(|| (shared * shared + added / (n * n)).sqrt());
        let or_zero = |i: usize, v: f64| if good(i) { v as f32 } else { 0.0 };
        let value = seen.value.iter().enumerate().map(|(i, &v)| or_zero(i, v)).collect();
        let se = variance.iter().enumerate().map(|(i, &v)| or_zero(i, v.sqrt())).collect();
        errors.push((info.standard_error(), plane(se)));
        unknown.extend(se_unknown(ideal, &layer.info, blur, good).map(|flags| (info.se_unknown(), plane(flags))));
        stack.push(info, plane(value));
    }
    errors.into_iter().for_each(|(info, data)| stack.push(info, data));
    for mask in masks.iter().filter(|m| m.reasons.iter().any(|&r| r != 0.0)) {
        stack.push(self::mask(mask.wavelength_nm), plane(mask.reasons.clone()));
    }
    unknown.into_iter().for_each(|(info, data)| stack.push(info, data));
    stack
}

/// What a memory card would hold.
fn numbers(ideal: &ImageStack, values: &[&Layer], seen: &[Seen]) -> ImageStack {
    let (rows, columns) = (ideal.rows(), ideal.columns());
    let mut stack = ImageStack::new(rows, columns);
    stack.take_pixel_pitch(ideal);
    for (layer, seen) in values.iter().zip(seen) {
        let info = number_layer(&layer.info);
        let plane = Array2::from_shape_fn((rows, columns), |(r, c)| seen.number[r * columns + c] as f32);
        stack.push(info, plane);
    }
    stack
}
