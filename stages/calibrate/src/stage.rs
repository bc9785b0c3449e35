//! The stage `calibrate`: matches the layers of sample and reference by what they say, and calibrates each wavelength.

use turbid_contract::canonical::canonical_value;
use turbid_contract::layers::place;
use turbid_contract::payload::{
    CONDITIONS, Conditions, Convention, Modulation, PhaseFunction, REFERENCE_CONDITIONS, Reflectance,
};
use turbid_contract::{
    Attributes, Ctx, Error, Extents, FileUse, Forms, Head, ImageStack, Known, Layer, LayerInfo, LayerKind, Parts,
    Problems, Stage, StagePlan, Usual, in_ports, out_ports, serde_json,
};

use crate::form;
use crate::gauss::Gauss;
use crate::memory::memory;
use crate::model::{Model, Standard};
use crate::params::{NoiseBias, Params};
use crate::plane::Room;
use crate::quantity::{counterpart, lit, quantities, same_size, same_wavelengths};
use crate::ratio::{Arm, calibrate};
use crate::reference::TABLE;
use crate::resolve::{Resolved, resolve};
use crate::rigs::{SHARE, difference};
use crate::table::Table;

/// The widest smoothing that makes sense: beyond it the source profile no longer cancels.
const WIDEST_SMOOTHING_PX: f64 = 100.0;

in_ports! {
    pub struct In {
        /// Modulation of the sample.
        sample: parts Modulation,
        /// Modulation of the reference phantom, same rig, same f_x.
        reference: parts Modulation,
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
    const VERSION: u32 = 7;
    const ABOUT: &'static str = "reflectance of a sample from its modulation and that of a reference phantom";

    type Params = Params;
    type In = In<'static>;
    type Out = Out;

    fn files(params: &Params) -> Vec<FileUse> {
        params.reference.table.iter().map(|file| FileUse::new(TABLE, file, params.max_file_mb)).collect()
    }

    fn canonical(params: &Params) -> Result<serde_json::Value, String> {
        let mut params = params.clone();
        // Where the file lies does not matter: its content is in the key.
        if let Some(file) = &mut params.reference.table {
            *file = file.rsplit(['/', '\\']).next().unwrap_or_default().to_owned();
        }
        canonical_value(&params)
    }

    fn check(params: &Params, known: &Known, problems: &mut Problems) {
        params.reference.check(problems);
        check_plate(params, problems);
        form::check(known, problems);
        check_reference(params, known, problems);
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
        let resolved = resolved(params, known).and_then(Result::ok).flatten();
        facts.extend(said(params, resolved.as_ref(), &known.fact("reference")));
        Forms::from([("reflectance", form::reflectance(known).with(facts))])
    }

    fn plan(params: &Params, known: &Known) -> StagePlan {
        let arms = [(params.smooth, "smoothing of the reference"), (params.smooth_sample, "smoothing of the sample")];
        let left_out = arms.iter().filter(|(px, _)| *px == 0.0).map(|(_, what)| (*what).into()).collect();
        let method = match params.model {
            _ if params.convention == Convention::Relative => "relative: no model of the reference",
            _ if params.reference.reflectance.is_some() => "plate: no model of the reference",
            Model::Rte => "rte",
            Model::Diffusion => "diffusion",
        };
        let f_x = known.form("sample").and_then(|form| form.f_x()).map(|list| list.len() as u64);
        let smoothed = [params.smooth, params.smooth_sample].iter().filter(|px| **px > 0.0).count() as u64;
        let arms = known.extent("sample").zip(known.extent("reference"));
        let memory = arms.map(|(sample, reference)| memory(sample, reference, f_x, smoothed));
        let in_parts = vec!["sample", "reference"];
        let (memory, makes) = memory.map_or((None, Extents::new()), |(bytes, makes)| (Some(bytes), makes));
        StagePlan { method: Some(method.into()), left_out, memory, in_parts, makes, ..StagePlan::default() }
    }

    fn run(params: &Params, inputs: In<'_>, ctx: Ctx<'_>) -> Result<Out, Error> {
        let arms = [&inputs.sample.head().attributes, &inputs.reference.head().attributes];
        if let Some(what) = difference(params.rigs, arms[0], arms[1]) {
            let what = format!("the sample and the reference were lit or seen by different rigs: {what}");
            return Err(Error::failed_with_hint(what, SHARE));
        }
        let wavelengths = lit(&inputs.sample.head().layers)?;
        let resolved = resolve(&params.reference, &wavelengths, arms[1], &|at| ctx.file(at))?;
        let lost =
            || Error::invalid("reference", "what the reference is, is not said, or its file was not handed over");
        let resolved = resolved.ok_or_else(lost)?;
        conventional(params, &resolved)?;
        let model = |standard: &Standard, f_x: f64| standard.reflectance(params.model, params.convention, f_x);
        let both = [&inputs.sample, &inputs.reference];
        let mut stack = reflectance(both, (&wavelengths, &resolved.at), params, model, ctx)?;
        stack.attributes.extend(said(params, Some(&resolved), arms[1]));
        stack.carry_conditions(&inputs.sample.conditions()?.0);
        Ok(Out { reflectance: Reflectance(stack) })
    }
}

/// The reference at the wavelengths of the sample; `None` where these are not known yet.
fn resolved(params: &Params, known: &Known) -> Option<Result<Option<Resolved>, Error>> {
    let layers = known.form("sample").and_then(|form| form.layers.as_deref())?;
    let wavelengths = lit(layers).ok()?;
    Some(resolve(&params.reference, &wavelengths, &known.fact("reference"), &|at| known.files.get(at)))
}

/// A plate says what light comes back of what falls in; of what enters a sample it knows nothing.
fn check_plate(params: &Params, problems: &mut Problems) {
    if params.reference.reflectance.is_some()
        && let Some((message, way_out)) = plate_unfit(params.convention)
    {
        problems.push_with_hint("convention", message, way_out);
    }
}

fn plate_unfit(convention: Convention) -> Option<(&'static str, &'static str)> {
    match convention {
        Convention::Camera | Convention::HemisphericalIncident => None,
        Convention::HemisphericalEntered => Some((
            "beside a plate R_d is over the light that falls in, and what of it enters the sample is not known",
            "take `camera` for a Lambertian plate seen by a camera, or `hemispherical_incident`",
        )),
        Convention::Relative => {
            Some(("a relative reflectance knows no R_d of its reference", "take `camera`, or leave `reflectance` out"))
        }
    }
}

/// The same once the file is read.
fn conventional(params: &Params, resolved: &Resolved) -> Result<(), Error> {
    let plate = resolved.at.iter().any(|standard| matches!(standard, Standard::Plate(_)));
    match plate_unfit(params.convention).filter(|_| plate) {
        Some((message, way_out)) => Err(Error::failed_with_hint(message, way_out)),
        None => Ok(()),
    }
}

/// Reports what is wrong with the reference at the wavelengths of the sample, and warns where it is not the one that is seen.
fn check_reference(params: &Params, known: &Known, problems: &mut Problems) {
    let Some(found) = resolved(params, known) else {
        // The file tells its own mistakes, whatever the sample is.
        if let (Some(_), Some(bytes)) = (&params.reference.table, known.files.get(TABLE))
            && let Err(Error::Invalid(problem)) = Table::read(&params.reference, &bytes)
        {
            problems.push_with_hint(
                problem.path,
                problem.message,
                problem.hint.unwrap_or_else(|| TABLE_HINT.to_owned()),
            );
        }
        return;
    };
    let resolved = match found {
        Ok(Some(resolved)) => resolved,
        Ok(None) => return,
        Err(Error::Invalid(problem)) if problem.path == TABLE => {
            let way_out = problem.hint.unwrap_or_else(|| TABLE_HINT.to_owned());
            return problems.push_with_hint(problem.path, problem.message, way_out);
        }
        Err(error) => {
            let port = if params.reference.object.is_some() { "reference" } else { "sample" };
            return problems.unfit(known, port, error);
        }
    };
    let relative = params.convention == Convention::Relative;
    if params.reference.table.is_some()
        && let Err(error) = conventional(params, &resolved)
    {
        problems.unfit(known, "reference", error);
    }
    if let Some(Ok(wavelengths)) = known.form("sample").and_then(|form| form.layers.as_deref()).map(lit) {
        check_f_x(params, known, &wavelengths, &resolved, problems);
    }
    for standard in resolved.at.iter().filter(|_| params.reference.table.is_some()) {
        if let Standard::Medium(phantom) = standard {
            problems.doubt(&Usual::MU_A, TABLE, phantom.mu_a);
            problems.doubt(&Usual::MU_S_PRIME, TABLE, phantom.mu_s_prime);
        }
    }
    if !relative && params.reference.object.is_none() {
        compare_phantom(&resolved.at, &known.fact("reference"), problems);
    }
}

/// The R_d of a plate is known at each f_x of the sample.
fn check_f_x(
    params: &Params,
    known: &Known,
    wavelengths: &[Option<f64>],
    resolved: &Resolved,
    problems: &mut Problems,
) {
    let Some(layers) = known.form("sample").and_then(|form| form.layers.as_deref()) else { return };
    for (standard, &wavelength_nm) in resolved.at.iter().zip(wavelengths) {
        if !matches!(standard, Standard::Plate(_)) {
            continue;
        }
        let f_x = quantities(layers, wavelength_nm).into_iter().map(|q| q.f_x_per_mm);
        let lacks = f_x.map(|f_x| standard.reflectance(params.model, params.convention, f_x)).find_map(Result::err);
        if let Some(error) = lacks {
            return problems.unfit(known, "sample", error);
        }
    }
}

const TABLE_HINT: &str = "a table of text is wanted: `wavelength_nm, mu_a, mu_s_prime, g, n` in mm^-1, or `wavelength_nm, reflectance`, then a row for each wavelength, rising";

/// What the reflectance says of itself beside what its sample says.
fn said(params: &Params, resolved: Option<&Resolved>, reference: &Attributes) -> Attributes {
    let relative = params.convention == Convention::Relative;
    let plate = resolved.is_some_and(|resolved| resolved.at.iter().any(|s| matches!(s, Standard::Plate(_))));
    let json = |value: Result<serde_json::Value, serde_json::Error>| value.expect("names are JSON");
    let mut facts = vec![
        ("convention", json(serde_json::to_value(params.convention))),
        ("model", if relative || plate { "none".into() } else { json(serde_json::to_value(params.model)) }),
    ];
    facts.extend(resolved.into_iter().flat_map(|resolved| resolved.said.clone()));
    let other = reference.get(CONDITIONS).map(|conditions| (REFERENCE_CONDITIONS, conditions.clone()));
    facts.into_iter().chain(other).map(|(name, value)| (name.to_owned(), value)).collect()
}

/// Properties of the phantom that differ by less than this of themselves are the same: rounding of mu_s (1 - g).
const SAME: f64 = 1e-6;

/// Warns where the phantom that is seen is not the one that the model is asked of.
fn compare_phantom(taken: &[Standard], reference: &Attributes, problems: &mut Problems) {
    let Some(Conditions { seen, .. }) = Conditions::of(reference, CONDITIONS) else { return };
    let Some(phantom) = seen.first() else { return };
    let one_g = match phantom.phase {
        Some(PhaseFunction::HenyeyGreenstein(g)) => Some(g),
        Some(PhaseFunction::TwoTermHenyeyGreenstein { .. }) => {
            let of_one_g = taken.iter().any(|taken| matches!(taken, Standard::Medium(_)));
            let message = format!(
                "the phantom that the reference shows (`{}`) has the phase function two_term, `reference` is taken to scatter by one g: reflectances are off by as much as the model differs",
                phantom.object
            );
            let hint = "give the `reflectance` of the phantom, or take one that scatters by one g";
            if of_one_g {
                problems.warn_ranked(1.0, "reference.g", message, hint);
            }
            None
        }
        None => None,
    };
    let at = |name: &str, channel: usize| {
        if taken.len() > 1 { format!("{name} of wavelength {}", channel + 1) } else { name.to_owned() }
    };
    let channels = taken.iter().zip(phantom.mu_a.iter().zip(&phantom.mu_s_prime)).enumerate();
    let pairs = channels.flat_map(|(channel, (taken, (&mu_a, &mu_s_prime)))| {
        let Standard::Medium(taken) = taken else { return Vec::new() };
        vec![
            ("mu_a", at("mu_a", channel), " mm^-1", Some(mu_a), taken.mu_a),
            ("mu_s_prime", at("mu_s_prime", channel), " mm^-1", Some(mu_s_prime), taken.mu_s_prime),
            ("g", at("g", channel), "", one_g, taken.g),
            ("n", at("n", channel), "", phantom.n, taken.n),
        ]
    });
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

/// A reference that is darker than its dark frame, in the mean of its good pixels, is none: all would be masked, or worse. Warns where no pixel is good.
fn lit_at_all(reference: &ImageStack, layer: usize, wavelength_nm: Option<f64>, ctx: Ctx<'_>) -> Result<(), Error> {
    let (values, mask) = (reference.layers[layer].pixels(), reference.mask(wavelength_nm).map(Layer::pixels));
    let is_good = |i: &usize| mask.as_ref().is_none_or(|mask| mask[*i] == 0.0);
    let good = (0..values.len()).filter(is_good).map(|i| f64::from(values[i]));
    let (sum, count) = good.fold((0.0, 0_u64), |(sum, count), value| (sum + value, count + 1));
    let info = &reference.layers[layer].info;
    let at = place(info);
    let way_out = "see whether dark and reference were exchanged, and whether both were taken with the exposure and gain of the dark frame";
    if count == 0 {
        ctx.warn(format!("no pixel of the reference is good at {at}: {way_out}"));
        return Ok(());
    }
    let mean = sum / count as f64;
    if mean <= 0.0 {
        let (name, unit) = (&info.name, &info.unit);
        let what =
            format!("the reference is darker than its dark: the mean of its {name} is {} {unit} at {at}", digits(mean));
        return Err(Error::failed_with_hint(what, way_out));
    }
    Ok(())
}

/// A number without the rounding of products: six digits.
fn digits(x: f64) -> f64 {
    format!("{x:.5e}").parse().unwrap_or(x)
}

fn reflectance(
    [sample, reference]: [&Parts<'_, Modulation>; 2],
    (wavelengths, standards): (&[Option<f64>], &[Standard]),
    params: &Params,
    model: impl Fn(&Standard, f64) -> Result<f64, Error>,
    ctx: Ctx<'_>,
) -> Result<ImageStack, Error> {
    let [own, others] = [sample.head(), reference.head()];
    let size = |head: &Head| [head.rows as u64, head.columns as u64];
    same_size(size(own), size(others))?;
    same_wavelengths(&own.layers, &others.layers)?;
    let gauss = [params.smooth_sample, params.smooth].map(Gauss::new);
    let mut stack = ImageStack::new(own.rows, own.columns);
    stack.attributes = own.attributes.clone();
    let (mut values, mut errors, mut covariances, mut masks) = (vec![], vec![], vec![], vec![]);
    let mut unknown = vec![];
    let corrects = params.noise_bias == NoiseBias::Correct;
    let room = Room::new(own.rows, own.columns, ctx);
    for (&wavelength_nm, standard) in wavelengths.iter().zip(standards) {
        let quantities = quantities(&own.layers, wavelength_nm);
        let layers: Result<Vec<usize>, Error> =
            quantities.iter().map(|q| counterpart(&others.layers, &own.layers[q.layer])).collect();
        let layers = layers?;
        // Of each arm the layers of one wavelength are in memory.
        let sample = Arm::of(sample, quantities.iter().map(|q| q.layer).collect(), wavelength_nm)?;
        let reference = Arm::of(reference, layers, wavelength_nm)?;
        if let Some(&layer) = reference.layers.first() {
            lit_at_all(&reference.stack, layer, wavelength_nm, ctx)?;
        }
        let model: Result<Vec<f64>, Error> = quantities.iter().map(|q| model(standard, q.f_x_per_mm)).collect();
        let arms = [&sample, &reference];
        let calibrated = calibrate(arms, &model?, gauss.each_ref(), corrects, &room, ctx)?;
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
            info.orientation_deg = own.layers[q.layer].orientation_deg.filter(|_| q.f_x_per_mm > 0.0);
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
