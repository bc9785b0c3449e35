//! The stage `compare`: maps against images of the truth, or a fit of media against what they are.

use turbid_contract::payload::{
    Concentrations, Errors, Estimate, Expected, Fit, Maps, Metrics, Payload, Readings, Truth,
};
use turbid_contract::{Ctx, Error, Forms, Known, Problems, Stage, in_ports, out_ports};

use crate::fit::{Media, compare_fit};
use crate::form;
use crate::joints;
use crate::maps::compare_maps;
use crate::params::Params;
use crate::written;

in_ports! {
    pub struct In {
        /// Maps or concentrations with standard errors and mask, or a fit of media.
        estimate: one Estimate,
        /// What the camera truly looks at, or maps of others that are taken for true, or the simulated readings that were fitted. Of concentrations it tells which
        /// pixel shows which object.
        truth: optional Expected,
    }
}

out_ports! {
    pub struct Out {
        /// One row for each region (or medium) and quantity.
        metrics: one Metrics,
        /// Estimate, truth and relative error side by side; of a fit a pixel for each medium, one below the other.
        errors: preview Errors,
    }
}

/// `use: compare`
pub struct Compare;

impl Stage for Compare {
    const NAME: &'static str = "compare";
    const VERSION: u32 = 6;
    const ABOUT: &'static str =
        "bias, RMS error and masked share against the truth: of maps for each region, of a fit for each medium";

    type Params = Params;
    type In = In<'static>;
    type Out = Out;

    fn check(params: &Params, known: &Known, problems: &mut Problems) {
        for (name, region) in &params.regions {
            region.check(&format!("regions.{name}"), problems);
        }
        for (name, medium) in &params.media {
            for (field, value) in [("mu_a", medium.mu_a), ("mu_s_prime", medium.mu_s_prime)] {
                problems.require(value.0 >= 0.0, format!("media.{name}.{field}"), value.0, "mm^-1", "be >= 0");
            }
        }
        written::check(&params.concentrations, problems);
        let truth = known.connected.iter().any(|port| port == "truth");
        let of_concentrations = known.payloads.get("estimate").map(String::as_str) == Some(Concentrations::NAME);
        match (of_concentrations, params.concentrations.is_empty()) {
            (true, true) => problems.push_with_hint(
                "concentrations",
                "the estimate is concentrations, and what they should be is not said",
                "concentrations: {OBJECT: {HbO2: 45, Hb: 15}}, by object of the scene, or `all`",
            ),
            (false, false) if known.is_connected("estimate") => problems.push(
                "concentrations",
                "the estimate is no concentrations: connect those of a `chromophores`, or leave `concentrations` out",
            ),
            _ => {}
        }
        match (truth, params.media.is_empty()) {
            _ if of_concentrations => {}
            (true, false) => problems.push("media", "the truth comes from the port and from `media`; give one of them"),
            (false, true) => problems.push_with_hint(
                "",
                "compare needs the input `truth`",
                "add `in: {truth: STAGE}`, or name the `media` of a fit",
            ),
            _ => {}
        }
        joints::check_compare(params, known, problems);
        let on = |port: &str| known.payloads.get(port).map(String::as_str);
        match (on("estimate"), on("truth")) {
            (Some(Maps::NAME), Some(Readings::NAME)) => {
                problems
                    .push("", "the estimate is maps, the truth is readings: maps need the port `truth` of a render, or other maps");
            }
            (Some(Fit::NAME), Some(Truth::NAME | Maps::NAME)) => {
                problems.push("", "the estimate is a fit, the truth is images: a fit needs its readings, or `media`");
            }
            (Some(Fit::NAME), _) if !params.regions.is_empty() => {
                problems.push("regions", "the estimate is a fit of media, which has no regions; leave them out");
            }
            (Some(Concentrations::NAME), Some(Readings::NAME | Maps::NAME)) => {
                problems.push("", "the estimate is concentrations, the truth tells no objects: connect the port `truth` of a render, or none");
            }
            (Some(Concentrations::NAME), _) if !params.media.is_empty() => {
                problems.push(
                    "media",
                    "the estimate is concentrations: `media` is the truth of a fit; write `concentrations`",
                );
            }
            (Some(Maps::NAME), None) if !params.media.is_empty() => {
                problems.push("media", "the estimate is maps: `media` is the truth of a fit; connect the port `truth`");
            }
            _ => {}
        }
    }

    fn describe(params: &Params, known: &Known) -> Forms {
        form::describe_compare(params, known)
    }

    fn run(params: &Params, inputs: In<'_>, ctx: Ctx<'_>) -> Result<Out, Error> {
        match (&inputs.estimate, &inputs.truth) {
            (Estimate::Maps(Maps(maps)), Some(Expected::Truth(Truth(truth)) | Expected::Maps(Maps(truth)))) => {
                let (metrics, errors) = compare_maps(params, maps, truth, ctx)?;
                Ok(Out { metrics, errors })
            }
            (Estimate::Concentrations(Concentrations(found)), Some(Expected::Truth(Truth(scene)))) => {
                let truth = written::images(&params.concentrations, found, Some(scene))?;
                let (metrics, errors) = compare_maps(params, found, &truth, ctx)?;
                Ok(Out { metrics, errors })
            }
            (Estimate::Concentrations(Concentrations(found)), None) => {
                let truth = written::images(&params.concentrations, found, None)?;
                let (metrics, errors) = compare_maps(params, found, &truth, ctx)?;
                Ok(Out { metrics, errors })
            }
            (Estimate::Fit(fit), Some(Expected::Readings(readings))) => {
                let (metrics, errors) = compare_fit(&fit.0, &Media::of(&readings.0)?, ctx)?;
                Ok(Out { metrics, errors })
            }
            (Estimate::Fit(fit), None) => {
                let (metrics, errors) = compare_fit(&fit.0, &Media::named(&params.media), ctx)?;
                Ok(Out { metrics, errors })
            }
            (Estimate::Maps(_), _) => {
                Err(Error::failed("maps are compared with the port `truth` of a render, or with other maps"))
            }
            (Estimate::Concentrations(_), _) => {
                Err(Error::failed("concentrations are compared with what the pipeline says, by object of a render"))
            }
            (Estimate::Fit(_), _) => Err(Error::failed("a fit is compared with its readings, or with `media`")),
        }
    }
}
