//! The stage `compare`: maps against images of the truth, or a fit of media against what they are.

use turbid_contract::payload::{Errors, Estimate, Expected, Fit, Maps, Metrics, Payload, Readings, Truth};
use turbid_contract::{Ctx, Error, Forms, Known, Problems, Stage, in_ports, out_ports};

use crate::fit::{Media, compare_fit};
use crate::form;
use crate::joints;
use crate::maps::compare_maps;
use crate::params::Params;

in_ports! {
    pub struct In {
        /// Maps with standard errors and mask, or a fit of media.
        estimate: one Estimate,
        /// What the camera truly looks at, or the simulated readings that were fitted.
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
    const VERSION: u32 = 3;
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
        let truth = known.connected.iter().any(|port| port == "truth");
        match (truth, params.media.is_empty()) {
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
                    .push("", "the estimate is maps, the truth is readings: maps need the port `truth` of a render");
            }
            (Some(Fit::NAME), Some(Truth::NAME)) => {
                problems.push("", "the estimate is a fit, the truth is images: a fit needs its readings, or `media`");
            }
            (Some(Fit::NAME), _) if !params.regions.is_empty() => {
                problems.push("regions", "the estimate is a fit of media, which has no regions; leave them out");
            }
            (Some(Maps::NAME), None) if !params.media.is_empty() => {
                problems.push("media", "the estimate is maps: `media` is the truth of a fit; connect the port `truth`");
            }
            _ => {}
        }
    }

    fn describe(_: &Params, known: &Known) -> Forms {
        form::describe_compare(known)
    }

    fn run(params: &Params, inputs: In<'_>, ctx: Ctx<'_>) -> Result<Out, Error> {
        match (&inputs.estimate, &inputs.truth) {
            (Estimate::Maps(maps), Some(Expected::Truth(truth))) => {
                let (metrics, errors) = compare_maps(params, &maps.0, &truth.0, ctx)?;
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
            (Estimate::Maps(_), _) => Err(Error::failed("maps are compared with the port `truth` of a render")),
            (Estimate::Fit(_), _) => Err(Error::failed("a fit is compared with its readings, or with `media`")),
        }
    }
}
