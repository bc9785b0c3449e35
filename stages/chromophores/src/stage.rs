//! The stage `chromophores`: its face to the engine.

use turbid_contract::canonical::canonical_value;
use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{Concentrations, Maps};
use turbid_contract::serde_json::Value;
use turbid_contract::sharing::Sharing;
use turbid_contract::{
    Ctx, Error, Extent, Extents, FileUse, Forms, ImageStack, Known, LayerInfo, LayerKind, Problems, Stage, StagePlan,
    in_ports, out_ports,
};
use turbid_optics::level::named;

use crate::channels::listed;
use crate::design::Wavelengths;
use crate::form::{Doubt, Made, attributes, describe, mask};
use crate::params::{Fit, Params};
use crate::pass::{DOUBTS, Pass, Tally};
use crate::resolve::{Resolved, resolve};

in_ports! {
    pub struct In {
        /// mu_a at two or more wavelengths, and mu_s' where scattering is fitted; with standard errors, the concentrations have them too.
        maps: parts Maps,
    }
}

out_ports! {
    pub struct Out {
        /// Each chromophore, total haemoglobin, oxygen saturation, the power law of scattering, with standard errors and mask.
        concentrations: one Concentrations,
        /// Which of the wavelengths give oxygen saturation with the least standard error.
        design: optional Wavelengths,
    }
}

/// Mean of chi2 over its degrees of freedom, above which the spectra do not explain what was measured.
const UNEXPLAINED: f64 = 4.0;
/// CPU seconds for a pixel at a wavelength, and for a choice of wavelengths (measured).
const PER_VALUE: f64 = 8e-8;
const PER_CHOICE: f64 = 4e-7;

/// `use: chromophores`
pub struct Chromophores;

impl Stage for Chromophores {
    const NAME: &'static str = "chromophores";
    const VERSION: u32 = 3;
    const ABOUT: &'static str = "concentrations of what absorbs, oxygen saturation and the power law of scattering from maps of several wavelengths";

    type Params = Params;
    type In = In<'static>;
    type Out = Out;

    fn files(params: &Params) -> Vec<FileUse> {
        let named = params.spectra.iter().enumerate();
        named.map(|(k, from)| FileUse::new(format!("spectra.{k}.file"), &from.file, params.max_file_mb)).collect()
    }

    fn canonical(params: &Params) -> Result<Value, String> {
        let mut params = params.clone();
        for from in &mut params.spectra {
            // Where the file lies does not matter: its content and name are in the key.
            from.file = from.file.rsplit(['/', '\\']).next().unwrap_or_default().to_owned();
        }
        canonical_value(&params)
    }

    fn check(params: &Params, known: &Known, problems: &mut Problems) {
        resolved(params, known, problems);
    }

    fn describe(params: &Params, known: &Known) -> Forms {
        describe(params, resolved(params, known, &mut Problems::default()).as_ref(), known)
    }

    fn plan(params: &Params, known: &Known) -> StagePlan {
        let mut plan = StagePlan { method: Some(method(params.fit).to_owned()), ..StagePlan::default() };
        let Some(resolved) = resolved(params, known, &mut Problems::default()) else { return plan };
        let names: Vec<&str> = resolved.species.iter().map(|s| s.name.as_str()).collect();
        let at = listed(&resolved.channels.wavelengths_nm);
        let of = format!("{} at {at} nm: condition number {:.3}", names.join(", "), resolved.condition);
        plan.method = Some(format!("{} ({of})", method(params.fit)));
        let form = describe(params, Some(&resolved), known).remove("concentrations");
        let made = form.and_then(|form| form.extent());
        let maps = known.extent("maps");
        let wavelengths = resolved.channels.wavelengths_nm.len() as f64;
        let choices =
            resolved.design.as_ref().filter(|_| known.is_wanted("design")).map_or(0, |design| design.choices());
        plan.seconds = maps.map(|maps| PER_VALUE * maps.pixels() as f64 * wavelengths + PER_CHOICE * choices as f64);
        // Of the maps what is read of them, beside the output planes of flags.
        let layers = known.form("maps").and_then(|form| form.layers.as_deref());
        let held = layers.map(|layers| kept(&resolved, layers).len() as u64);
        plan.memory = maps.zip(made).map(|(maps, made)| {
            let held = held.unwrap_or(maps.layers()) + DOUBTS as u64;
            made.bytes() + 4 * held * made.pixels()
        });
        plan.in_parts = vec!["maps"];
        plan.makes = made.map_or_else(Extents::new, |made: Extent| Extents::from([("concentrations", made)]));
        plan
    }

    fn run(params: &Params, inputs: In<'_>, ctx: Ctx<'_>) -> Result<Out, Error> {
        let (infos, mut problems) = (&inputs.maps.head().layers, Problems::default());
        let resolved = resolve(params, &|at| ctx.file(at), Some((infos, "maps")), ctx.wants("design"), &mut problems);
        let Some(mut resolved) = resolved else {
            let first = problems.into_parts().0.into_iter().next();
            return Err(first.map_or_else(|| Error::failed("a file of spectra was not handed over"), Error::Invalid));
        };
        ctx.measure("condition_number", resolved.condition, "1");
        let kept = kept(&resolved, infos);
        resolved.channels = resolved.channels.within(&kept);
        let Maps(stack) = inputs.maps.part(&|place, _| kept.contains(&place))?;
        let concentrations = concentrations(params, &resolved, &stack, ctx)?;
        let design = match &resolved.design {
            Some(design) if ctx.wants("design") => Some(design.table(ctx)?),
            _ => None,
        };
        Ok(Out { concentrations: Concentrations(concentrations), design })
    }
}

/// Places of the layers of maps that a run holds: those that are read, masks, and how the surface lies to the light.
fn kept(resolved: &Resolved, infos: &[LayerInfo]) -> Vec<usize> {
    let read: Vec<usize> = resolved.channels.places().collect();
    let beside = |info: &LayerInfo| matches!(info.kind, LayerKind::Mask | LayerKind::Condition);
    infos.iter().enumerate().filter(|(k, info)| read.contains(k) || beside(info)).map(|(k, _)| k).collect()
}

fn method(fit: Fit) -> &'static str {
    match fit {
        Fit::NonNegative => "weighted least squares, not negative",
        Fit::Linear => "weighted least squares",
    }
}

fn resolved(params: &Params, known: &Known, problems: &mut Problems) -> Option<Resolved> {
    let layers = known.form("maps").and_then(|form| form.layers.as_deref());
    let layers = layers.map(|layers| (layers, known.producer("maps")));
    resolve(params, &|at| known.files.get(at), layers, known.is_wanted("design"), problems)
}

fn concentrations(params: &Params, resolved: &Resolved, stack: &ImageStack, ctx: Ctx<'_>) -> Result<ImageStack, Error> {
    let made = Made::of(params, resolved);
    if !made.errors[0] {
        ctx.warn(
            "the maps state no standard errors of mu_a: all wavelengths count alike, and nothing is known of the errors of concentrations; \
             standard errors come from frames that have them",
        );
    }
    let pass = Pass::of(params, resolved, stack, &made, named(ctx.simd()));
    let size = (stack.rows(), stack.columns());
    let mut planes: Vec<Array2<f32>> = (0..pass.planes(&made)).map(|_| Array2::zeros(size)).collect();
    let tiles = ctx.fill_planes(&mut planes, |pixels, planes| pass.run(pixels, planes))?;
    let tally = tiles.iter().fold(Tally::default(), Tally::add);
    let mask_plane = planes.pop().expect("the last plane is the mask");
    tell(resolved, &tally, &mask_plane, ctx);
    let flags = planes.split_off(planes.len() - DOUBTS);
    let flags: Vec<Option<Array2<f32>>> =
        flags.into_iter().map(|plane| plane.iter().any(|&flag| flag != 0.0).then_some(plane)).collect();
    let sharing = |quantity: &[usize]| {
        let of = quantity.iter().map(|&place| stack.sharing(&stack.layers[place].info));
        of.fold(Sharing::NONE, Sharing::or)
    };
    let channels = &resolved.channels;
    let of_mu_a = sharing(&channels.mu_a.layers);
    let of_mu_s_prime = channels.mu_s_prime.as_ref().map_or(Sharing::NONE, |q| sharing(&q.layers));
    let with_errors = made.with_errors();
    let mut out = ImageStack::new(stack.rows(), stack.columns());
    out.attributes = attributes(stack.attributes.clone(), resolved);
    let values: Vec<&LayerInfo> = made.values().collect();
    let of_means: Vec<Option<f64>> = with_errors
        .iter()
        .zip(&planes[values.len()..])
        .map(|((_, doubt), se)| {
            let sharing = if *doubt == Doubt::Scattering { &of_mu_s_prime } else { &of_mu_a };
            let [se, mask] = [se, &mask_plane].map(|plane| plane.as_slice().expect("planes are row-major"));
            sharing.mean_se(se, |i| mask[i] == 0.0)
        })
        .collect();
    let mut planes = planes.into_iter();
    let mut next = || planes.next().expect("as many planes as there are layers");
    for info in values {
        let place = with_errors.iter().position(|(other, _)| other.name == info.name);
        let of_mean = place.filter(|&k| flags[with_errors[k].1 as usize].is_none()).and_then(|k| of_means[k]);
        out.push(LayerInfo { mean_se: of_mean, ..info.clone() }, next());
    }
    with_errors.iter().for_each(|(info, _)| out.push(info.standard_error(), next()));
    out.push(mask(), mask_plane);
    for (info, doubt) in with_errors {
        if let Some(plane) = &flags[doubt as usize] {
            out.push(info.se_unknown(), plane.clone());
        }
    }
    out.carry_conditions(stack);
    Ok(out)
}

/// What the pass showed: masked pixels, concentrations at 0, residuals beyond the noise.
fn tell(resolved: &Resolved, tally: &Tally, mask: &Array2<f32>, ctx: Ctx<'_>) {
    let reasons = ctx.measure_masked(mask.iter().copied());
    if tally.good == 0 {
        return ctx.warn(format!("all pixels are masked: {reasons}"));
    }
    let share = 100.0 * tally.held as f64 / tally.good as f64;
    ctx.measure("at_bound", share, "%");
    if share > 10.0 {
        ctx.warn(format!(
            "in {share:.0} % of the pixels a concentration is held at 0 (layer `at_bound`), where standard errors are unknown and means are off; \
             `fit: linear` lets noise take it below 0 and keeps means unbiased, and what is not there may be left out of `chromophores`"
        ));
    }
    let freedom = resolved.channels.wavelengths_nm.len() - resolved.species.len();
    if tally.free > 0 && freedom > 0 {
        let reduced = tally.chi2 / (tally.free as f64 * freedom as f64);
        ctx.measure("reduced_chi2", reduced, "1");
        if reduced > UNEXPLAINED {
            ctx.warn(format!(
                "the chromophores do not explain mu_a: residuals are {:.1} times what the standard errors of the maps let expect; something else absorbs, \
                 or mu_a is off at a wavelength (layer `residual`), and standard errors of concentrations count noise alone",
                reduced.sqrt()
            ));
        }
    }
}
