//! Points from which the scalar walker looks for ways of light that lanes do not know.

use glam::DVec3;

use super::frame::Frame;
use super::look::Looks;
use crate::walker::Walker;

/// Tries those that wait, in their order.
#[inline(never)]
pub fn try_detours(walker: &mut Walker<'_>, frame: &Frame<'_>, looks: &mut Looks) {
    for detour in looks.detours.drain(..) {
        let mut r = frame.world(detour.r);
        if let Some(plane) = &frame.plane {
            // Rounding must not put it into another layer.
            r.z = r.z.clamp(plane.layer[0].next_up(), plane.layer[1].next_down());
        }
        let e = DVec3::from(detour.e.map(f64::from));
        walker.try_detour(&detour, r, e, frame.unit);
    }
}
