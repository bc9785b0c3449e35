//! Points from which the scalar walker finds connections that lanes do not know.

use glam::DVec3;

use super::frame::Frame;
use super::next_event::NextEvents;
use crate::walker::Walker;

/// Tries those that wait, in their order.
#[inline(never)]
pub fn make_scalar_connections(walker: &mut Walker<'_>, frame: &Frame<'_>, next_events: &mut NextEvents) {
    for scalar in next_events.scalar_connections.drain(..) {
        let mut r = frame.world(scalar.r);
        if let Some(plane) = &frame.plane {
            // Rounding must not put it into another layer.
            r.z = r.z.clamp(plane.layer[0].next_up(), plane.layer[1].next_down());
        }
        let e = DVec3::from(scalar.e.map(f64::from));
        walker.scalar_connection(&scalar, r, e, frame.unit);
    }
}
