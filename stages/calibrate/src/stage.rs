//! The stage `calibrate`: matches the layers of sample and reference by what they say, and calibrates each wavelength.

use turbid_contract::payload::{CONDITIONS, Conditions, Convention, Modulation, REFERENCE_CONDITIONS, Reflectance};
use turbid_contract::{
    Attributes, Ctx, Error, Extents, Forms, ImageStack, Known, LayerInfo, LayerKind, Problems, Stage, StagePlan,
    in_ports, out_ports, serde_json,
};

use crate::form;
use crate::gauss::Gauss;
use crate::memory::memory;
use crate::model::{Model, Phantom};
use crate::params::{NoiseBias, Params};
use crate::quantity::{counterpart, lit, quantities, same_size, same_wavelengths};
use crate::ratio::{Arm, calibrate};
use crate::rigs::{SHARE, difference};

/// The widest smoothing that makes sense: beyond it the source profile no longer cancels.
const WIDEST_SMOOTHING_PX: f64 = 100.0;

in_ports! {
    pub struct In {
        /// Modulation of the sample.
        sample: one Modulation,
        /// Modulation of the reference phantom, same rig, same f_x.
        reference: one Modulation,
    }
}

out_ports! {
    pub struct Out {
        /// R_d for each f_x, with standard errors and covariance where both arms know theirs.
        reflectance: one Reflectance,
    }
}

/// `use: calibrate`
pub struct Calibrate;

impl Stage for Calibrate {
    const NAME: &'static str = "calibrate";
    const VERSION: u32 = 5;
    const ABOUT: &'static str = "reflectance of a sample from its modulation and that of a reference phantom";

    type Params = Params;
    type In = In<'static>;
    type Out = Out;

    fn check(params: &Params, known: &Known, problems: &mut Problems) {
        params.reference.check(problems);
        form::check(&params.reference, known, problems);
        if params.convention != Convention::Relative {
            compare_phantom(params, &known.fact("reference"), problems);
        }
        if let Some(what) = difference(params.rigs, &known.fact("sample"), &known.fact("reference")) {
            let (sample, reference) = (known.producer("sample"), known.producer("reference"));
            let message = format!("`{sample}` and `{reference}` were lit or seen by different rigs: {what}");
            problems.at_input("reference", message, SHARE);
        }
        for (field, smooth) in [("smooth", params.smooth), ("smooth_sample", params.smooth_sample)] {
            let rule = "lie in [0, 100]";
            problems.require((0.0..=WIDEST_SMOOTHING_PX).contains(&smooth), field, smooth, "px", rule);
        }
    }

    fn describe(params: &Params, known: &Known) -> Forms {
        let mut facts = known.fact("sample");
        facts.extend(said(params, &known.fact("reference")));
        Forms::from([("reflectance", form::reflectance(&params.reference, known).with(facts))])
    }

    fn plan(params: &Params, known: &Known) -> StagePlan {
        let arms = [(params.smooth, "smoothing of the reference"), (params.smooth_sample, "smoothing of the sample")];
        let left_out = arms.iter().filter(|(px, _)| *px == 0.0).map(|(_, what)| (*what).into()).collect();
        let method = match params.model {
            _ if params.convention == Convention::Relative => "relative: no model of the reference",
            Model::Rte => "rte",
            Model::Diffusion => "diffusion",
        };
        let f_x = known.form("sample").and_then(|form| form.f_x()).map(|list| list.len() as u64);
        let arms = known.extent("sample").zip(known.extent("reference"));
        let memory = arms.map(|(sample, reference)| memory(sample, reference, f_x));
        let (memory, makes) = memory.map_or((None, Extents::new()), |(bytes, makes)| (Some(bytes), makes));
        StagePlan { method: Some(method.into()), left_out, memory, makes, ..StagePlan::default() }
    }

    fn run(params: &Params, inputs: In<'_>, ctx: Ctx<'_>) -> Result<Out, Error> {
        let arms = [&inputs.sample.0.attributes, &inputs.reference.0.attributes];
        if let Some(what) = difference(params.rigs, arms[0], arms[1]) {
            let what = format!("the sample and the reference were lit or seen by different rigs: {what}");
            return Err(Error::failed_with_hint(what, SHARE));
        }
        let model = |phantom: &Phantom, f_x: f64| phantom.reflectance(params.model, params.convention, f_x);
        let mut stack = reflectance(&inputs.sample.0, &inputs.reference.0, params, model, ctx)?;
        stack.attributes.extend(said(params, &inputs.reference.0.attributes));
        stack.carry_conditions(&inputs.sample.0);
        Ok(Out { reflectance: Reflectance(stack) })
    }
}

/// What the reflectance says of itself beside what its sample says.
fn said(params: &Params, reference: &Attributes) -> Attributes {
    let relative = params.convention == Convention::Relative;
    let facts = [
        ("convention", serde_json::to_value(params.convention)),
        ("model", if relative { Ok("none".into()) } else { serde_json::to_value(params.model) }),
        ("g", serde_json::to_value(&params.reference.g)),
        ("n", serde_json::to_value(&params.reference.n)),
        ("reference", serde_json::to_value(&params.reference)),
    ];
    let said = facts.into_iter().map(|(name, value)| (name, value.expect("names and finite numbers are JSON")));
    let other = reference.get(CONDITIONS).map(|conditions| (REFERENCE_CONDITIONS, conditions.clone()));
    said.chain(other).map(|(name, value)| (name.to_owned(), value)).collect()
}

/// Properties of the phantom that differ by less than this of themselves are the same: rounding of mu_s (1 - g).
const SAME: f64 = 1e-6;

/// Warns where the phantom that is seen is not the one that the model is asked of.
fn compare_phantom(params: &Params, reference: &Attributes, problems: &mut Problems) {
    let Some(Conditions { seen, .. }) = Conditions::of(reference, CONDITIONS) else { return };
    let Some(phantom) = seen.first() else { return };
    let lists = params.reference.unfit(1).next().is_some();
    let at = |name: &str, channel: usize| {
        if lists { format!("{name} of wavelength {}", channel + 1) } else { name.to_owned() }
    };
    let channels = phantom.mu_a.len().min(phantom.mu_s_prime.len());
    let pairs = (0..channels).filter_map(|channel| Some((channel, params.reference.at(channel)?))).flat_map(
        |(channel, taken)| {
            [
                ("mu_a", at("mu_a", channel), " mm^-1", Some(phantom.mu_a[channel]), taken.mu_a),
                (
                    "mu_s_prime",
                    at("mu_s_prime", channel),
                    " mm^-1",
                    Some(phantom.mu_s_prime[channel]),
                    taken.mu_s_prime,
                ),
                ("g", at("g", channel), "", phantom.g, taken.g),
                ("n", at("n", channel), "", phantom.n, taken.n),
            ]
        },
    );
    for (field, name, unit, seen, taken) in pairs {
        let Some(seen) = seen.filter(|seen| (seen - taken).abs() > SAME * seen.abs().max(taken.abs())) else {
            continue;
        };
        let size = (seen - taken).abs() / seen.abs().max(taken.abs());
        let message = format!(
            "the phantom that the reference shows (`{}`) has {name} = {}{unit}, `reference` says {taken}{unit}: reflectances are off by as much as the model differs",
            phantom.object,
            digits(seen),
        );
        let hint = format!("{name}: {}, or another phantom", digits(seen));
        problems.warn_ranked(size, format!("reference.{field}"), message, hint);
    }
}

/// A number without the rounding of products: six digits.
fn digits(x: f64) -> f64 {
    format!("{x:.5e}").parse().unwrap_or(x)
}

fn reflectance(
    sample: &ImageStack,
    reference: &ImageStack,
    params: &Params,
    model: impl Fn(&Phantom, f64) -> Result<f64, Error>,
    ctx: Ctx<'_>,
) -> Result<ImageStack, Error> {
    let size = |s: &ImageStack| [s.rows() as u64, s.columns() as u64];
    same_size(size(sample), size(reference))?;
    let (infos, reference_infos) = (sample.infos(), reference.infos());
    let wavelengths = lit(&infos, &params.reference)?;
    same_wavelengths(&infos, &reference_infos)?;
    let gauss = [params.smooth_sample, params.smooth].map(Gauss::new);
    let mut stack = ImageStack::new(sample.rows(), sample.columns());
    stack.attributes = sample.attributes.clone();
    let (mut values, mut errors, mut covariances, mut masks) = (vec![], vec![], vec![], vec![]);
    let mut unknown = vec![];
    let corrects = params.noise_bias == NoiseBias::Correct;
    for (channel, wavelength_nm) in wavelengths.into_iter().enumerate() {
        let phantom = params.reference.at(channel).expect("the lists are as long as the wavelengths are many");
        let quantities = quantities(&infos, wavelength_nm);
        let layers: Result<Vec<usize>, Error> =
            quantities.iter().map(|q| counterpart(&reference_infos, &infos[q.layer])).collect();
        let model: Result<Vec<f64>, Error> = quantities.iter().map(|q| model(&phantom, q.f_x_per_mm)).collect();
        let arm = |stack, layers| Arm { stack, layers, wavelength_nm };
        let sample_arm = arm(sample, quantities.iter().map(|q| q.layer).collect());
        let arms = [&sample_arm, &arm(reference, layers?)];
        let calibrated = calibrate(arms, &model?, gauss.each_ref(), corrects, ctx)?;
        if calibrated.se.is_empty() {
            ctx.warn("no standard errors: the sample or the reference does not know its own");
        }
        let first = values.len() as u32;
        let reasons = ctx.measure_masked(calibrated.mask.iter().copied());
        if calibrated.mask.iter().all(|&m| m != 0.0) {
            ctx.warn(format!("all pixels are masked: {reasons}"));
        }
        for ((mut info, data), q) in calibrated.r_d.into_iter().zip(&quantities) {
            info.f_x_per_mm = Some(q.f_x_per_mm);
            info.orientation_deg = sample.layers[q.layer].info.orientation_deg.filter(|_| q.f_x_per_mm > 0.0);
            values.push((info, data));
        }
        let described = values[first as usize..].iter().map(|(info, _)| info.standard_error());
        errors.extend(described.collect::<Vec<_>>().into_iter().zip(calibrated.se));
        let flagged = values[first as usize..].iter().zip(calibrated.unknown);
        unknown.extend(flagged.filter_map(|((info, _), flags)| Some((info.se_unknown(), flags?))));
        for ([a, b], data) in calibrated.covariances {
            let mut info = LayerInfo::new("cov", LayerKind::Covariance, "1");
            info.pair = Some([first + a as u32, first + b as u32]);
            info.wavelength_nm = wavelength_nm;
            covariances.push((info, data));
        }
        let mut info = LayerInfo::new("mask", LayerKind::Mask, "1");
        info.wavelength_nm = wavelength_nm;
        masks.push((info, calibrated.mask));
    }
    let layers = values.into_iter().chain(errors).chain(covariances).chain(masks).chain(unknown);
    layers.for_each(|(info, data)| stack.push(info, data));
    Ok(stack)
}
