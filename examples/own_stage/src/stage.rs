//! The stage `modulation_depth`: its face to the engine.

use std::borrow::Cow;

use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{MaskReason, Modulation};
use turbid_contract::schemars::JsonSchema;
use turbid_contract::serde::{Deserialize, Serialize};
use turbid_contract::{
    Ctx, Error, Form, Forms, ImageStack, Known, Layer, LayerInfo, LayerKind, Problems, Ratio, Stage, StagePlan,
    in_ports, out_ports,
};

use crate::depth::{Noise, modulation_depth};
use crate::layers::{Fringe, fringes, mask, wavelengths};
use crate::payload::Depth;

/// Params of `modulation_depth`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(crate = "turbid_contract::serde", deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct Params {
    /// A pixel whose depth is below this is masked as too weak, at all f_x.
    #[serde(default = "nothing")]
    pub least: Ratio,
}

fn nothing() -> Ratio {
    Ratio(0.0)
}

in_ports! {
    pub struct In {
        /// M_DC and M_AC for each f_x; with standard errors, the depth has them too.
        modulation: one Modulation,
    }
}

out_ports! {
    pub struct Out {
        /// `modulation_depth` for each f_x > 0, with standard error and mask.
        depth: one Depth,
    }
}

/// `use: modulation_depth`
pub struct ModulationDepth;

impl Stage for ModulationDepth {
    const NAME: &'static str = "modulation_depth";
    const VERSION: u32 = 1;
    const ABOUT: &'static str = "M_AC / M_DC of each pixel, with its standard error";

    type Params = Params;
    type In = In<'static>;
    type Out = Out;

    fn check(params: &Params, known: &Known, problems: &mut Problems) {
        let least = params.least.0;
        problems.require((0.0..1.0).contains(&least), "least", least, "", "lie in [0, 1): no depth is above 1");
        let layers = known.form("modulation").and_then(|form| form.layers.as_ref());
        if layers.is_some_and(|layers| fringes(layers).is_empty()) {
            let message = format!("{} has no fringe of f_x > 0: there is no depth", known.producer("modulation"));
            problems.at_input("modulation", message, "render or measure frames at an f_x > 0");
        }
    }

    fn describe(_: &Params, known: &Known) -> Forms {
        let Some(from) = known.form("modulation") else { return Forms::new() };
        let mut form = Form { pixels: from.pixels, ..Form::default() };
        if let Some(layers) = &from.layers {
            let fringes = fringes(layers);
            let conditions = layers.iter().filter(|info| info.kind == LayerKind::Condition);
            let known = fringes.iter().filter(|q| q.noise.is_some()).map(|q| q.info.standard_error());
            let masks = wavelengths(&fringes).into_iter().map(mask);
            let values = fringes.iter().map(|q| q.info.clone());
            form.layers = Some(values.chain(known).chain(masks).chain(conditions.cloned()).collect());
            form.perhaps = fringes.iter().map(|q| q.info.se_unknown()).collect();
            form.perhaps.extend(from.perhaps.iter().filter(|info| info.kind == LayerKind::Condition).cloned());
        }
        Forms::from([("depth", form)])
    }

    fn plan(_: &Params, known: &Known) -> StagePlan {
        // The inputs, and as many planes at the most.
        let memory = known.extent("modulation").map(|modulation| 2 * modulation.bytes());
        StagePlan { memory, ..StagePlan::default() }
    }

    fn run(params: &Params, inputs: In<'_>, ctx: Ctx<'_>) -> Result<Out, Error> {
        let stack = &inputs.modulation.0;
        let infos: Vec<LayerInfo> = stack.layers.iter().map(|layer| layer.info.clone()).collect();
        let fringes = fringes(&infos);
        if fringes.is_empty() {
            return Err(Error::failed("the modulation has no fringe of f_x > 0: there is no depth"));
        }
        if fringes.iter().any(|q| q.noise.is_none()) {
            ctx.warn("no standard errors: the modulation does not know the covariance of its M_DC and M_AC");
        }
        let (mut values, mut errors, mut masks, mut flags) = (vec![], vec![], vec![], vec![]);
        for wavelength_nm in wavelengths(&fringes) {
            let of: Vec<&Fringe> = fringes.iter().filter(|q| q.info.wavelength_nm == wavelength_nm).collect();
            let planes = depths(&of, stack, params.least.0, ctx)?;
            let masked = planes[2 * of.len()].clone();
            ctx.measure_masked(masked.iter().copied());
            for (q, planes) in of.iter().zip(planes.chunks_exact(2)) {
                let unknown = flagged(q, stack, &masked);
                let mut info = q.info.clone();
                if q.noise.is_some() {
                    info.mean_se = mean_error(q, stack, &planes[1], &masked).filter(|_| unknown.is_none());
                    errors.push((info.standard_error(), planes[1].clone()));
                }
                flags.extend(unknown.map(|unknown| (info.se_unknown(), unknown)));
                values.push((info, planes[0].clone()));
            }
            masks.push((mask(wavelength_nm), masked));
        }
        let mut depth = ImageStack::new(stack.rows(), stack.columns());
        values.into_iter().chain(errors).chain(masks).chain(flags).for_each(|(info, data)| depth.push(info, data));
        depth.take_pixel_pitch(stack);
        depth.carry_conditions(stack);
        Ok(Out { depth: Depth(depth) })
    }
}

/// For the depths of one wavelength: value and standard error of each, and the mask of all. Masked pixels hold 0.
fn depths(of: &[&Fringe], stack: &ImageStack, least: f64, ctx: Ctx<'_>) -> Result<Vec<Array2<f32>>, Error> {
    let pixels: Vec<Cow<'_, [f32]>> = stack.layers.iter().map(Layer::pixels).collect();
    let at = |layer: usize, pixel: usize| f64::from(pixels[layer][pixel]);
    let mut planes = vec![Array2::zeros((stack.rows(), stack.columns())); 2 * of.len() + 1];
    ctx.fill_planes(&mut planes, |range, planes| {
        for (place, pixel) in range.enumerate() {
            let carried = of[0].mask.map_or(0.0, |mask| pixels[mask][pixel]);
            let found: Option<Vec<[f64; 2]>> = of
                .iter()
                .map(|q| {
                    let noise = |[dc, ac, pair]: [usize; 3]| Noise {
                        m_dc: at(dc, pixel) * at(dc, pixel),
                        m_ac: at(ac, pixel) * at(ac, pixel),
                        covariance: at(pair, pixel),
                    };
                    let noise = q.noise.map_or(Noise { m_dc: 0.0, m_ac: 0.0, covariance: 0.0 }, noise);
                    modulation_depth(at(q.m_dc, pixel), at(q.m_ac, pixel), noise).filter(|[d, _]| *d >= least)
                })
                .collect();
            let (depths, mask) = planes.split_at_mut(2 * of.len());
            match found.filter(|_| carried == 0.0) {
                Some(found) => {
                    for (planes, found) in depths.chunks_exact_mut(2).zip(found) {
                        (planes[0][place], planes[1][place]) = (found[0] as f32, found[1] as f32);
                    }
                }
                None => mask[0][place] = if carried == 0.0 { MaskReason::LowSignal.code() } else { carried },
            }
        }
    })?;
    Ok(planes)
}

/// Standard error of the mean over the good pixels: where pixels of the modulation share paths, those of the depth do.
fn mean_error(q: &Fringe, stack: &ImageStack, se: &Array2<f32>, masked: &Array2<f32>) -> Option<f64> {
    let [of_dc, of_ac] = [q.m_dc, q.m_ac].map(|layer| stack.sharing(&stack.layers[layer].info));
    let [se, masked] = [se, masked].map(|plane| plane.as_slice().expect("planes are row-major"));
    of_dc.or(of_ac).mean_se(se, |i| masked[i] == 0.0)
}

/// Good pixels at which a standard error that went in is not known; `None` where there are none.
fn flagged(q: &Fringe, stack: &ImageStack, masked: &Array2<f32>) -> Option<Array2<f32>> {
    let mut flags = Array2::zeros(masked.dim());
    for &layer in &q.unknown {
        flags.zip_mut_with(&stack.layers[layer].data, |flag: &mut f32, &unknown| *flag = flag.max(unknown));
    }
    flags.zip_mut_with(masked, |flag, &mask| *flag = if mask == 0.0 { *flag } else { 0.0 });
    flags.iter().any(|&flag| flag != 0.0).then_some(flags)
}
