//! The phase function of a medium as something that can be evaluated and sampled.

use turbid_contract::payload;
use turbid_optics::PhaseFunction;

/// Of what a scene's record says.
pub fn phase_function(phase: &payload::PhaseFunction) -> PhaseFunction {
    match *phase {
        payload::PhaseFunction::HenyeyGreenstein(g) => PhaseFunction::HenyeyGreenstein { g },
        payload::PhaseFunction::TwoTermHenyeyGreenstein { g_forward, g_backward, forward } => {
            PhaseFunction::TwoTermHenyeyGreenstein { g_forward, g_backward, forward }
        }
    }
}
