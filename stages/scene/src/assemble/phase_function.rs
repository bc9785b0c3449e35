//! Phase functions: by g alone, or of another kind.

use turbid_contract::Problems;
use turbid_contract::payload::PhaseFunction;

use crate::params::{MediumParams, PhaseParams};

/// What stands at `here`, the place of a medium; where that is none, isotropic scattering beside the mistake.
pub fn phase_function(here: &str, m: &MediumParams, problems: &mut Problems) -> PhaseFunction {
    match (m.g, m.phase) {
        (Some(g), None) => {
            henyey_greenstein(here, g.0, problems);
            PhaseFunction::HenyeyGreenstein(g.0)
        }
        (None, Some(PhaseParams::TwoTerm { g_forward, g_backward, forward })) => {
            let (g_forward, g_backward, forward) = (g_forward.0, g_backward.0, forward.0);
            let at = |field: &str| format!("{here}.phase.two_term.{field}");
            problems.require(g_forward.abs() < 1.0, at("g_forward"), g_forward, "", "lie in (-1, 1)");
            problems.require(g_backward.abs() < 1.0, at("g_backward"), g_backward, "", "lie in (-1, 1)");
            if g_backward >= g_forward && g_backward.abs() < 1.0 {
                let message = format!("g_backward = {g_backward} must be less than g_forward = {g_forward}");
                let way_out =
                    "exchange the two, and write `forward` for the share of the other; equal ones are `g` alone";
                problems.push_with_hint(at("g_backward"), message, way_out);
            }
            if !(forward > 0.0 && forward < 1.0) {
                let message = format!("forward = {forward} must lie in (0, 1), the share of the forward term");
                let way_out = "one term alone is written as `g`; if per cent are meant, write `95 %`";
                problems.push_with_hint(at("forward"), message, way_out);
            }
            PhaseFunction::TwoTermHenyeyGreenstein { g_forward, g_backward, forward }
        }
        (given, _) => {
            const BOTH: &str = "`phase` stands beside `g`, which is a phase function, too";
            let (field, message) = if given.is_some() { ("phase", BOTH) } else { ("g", "`g` is missing") };
            let way_out = "write either `g: 0.8`, Henyey and Greenstein's function, or \
                           `phase: {two_term: {g_forward: 0.9, g_backward: -0.3, forward: 0.95}}`";
            problems.push_with_hint(format!("{here}.{field}"), message, way_out);
            PhaseFunction::HenyeyGreenstein(0.0)
        }
    }
}

fn henyey_greenstein(here: &str, g: f64, problems: &mut Problems) {
    let at = format!("{here}.g");
    if (2.0..100.0).contains(&g) {
        let meant = format!("if per cent are meant, write `{g} %`");
        problems.push_with_hint(at, format!("g = {g} must lie in (-1, 1)"), meant);
    } else {
        problems.require(g.abs() < 1.0, at, g, "", "lie in (-1, 1)");
    }
}
