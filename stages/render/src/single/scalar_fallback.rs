//! The scalar fallback: what befalls a path where lanes cannot follow it: walked one by one until they can.

use super::frame::Frame;
use crate::random::LIGHT_BRANCH;
use crate::setting::Place;
use crate::walker::Walker;

/// Number of the last flight that is left to the scalar walker for it: lanes count no further.
pub const LATE: u32 = LIGHT_BRANCH - 2;

/// One divergent flight, and those after it until the path is in a medium again, scored ahead, where lanes can go on; false where it
/// has ended.
pub fn scalar_fallback(walker: &mut Walker<'_>, frame: &Frame<'_>, place: &mut Place) -> bool {
    loop {
        if !walker.step(place) {
            return false;
        }
        // In a medium, not at an interface; or through the plane, and not scattered yet; or turned by an interface from behind which lanes go on.
        let entered = !place.scattered && place.number == u64::from(frame.first);
        let turned = place.scattered && frame.interfaces.is_some();
        let ready = place.surface_point.is_none() || entered || turned;
        if place.ahead && ready && place.number < u64::from(LATE) {
            let mut inside = *place;
            if let (Some(interfaces), Some(surface_point)) = (&frame.interfaces, place.surface_point) {
                // Lanes know no surface points: rounding must not put it outside.
                let normal = walker.setting().world.normal(surface_point.interface, place.r);
                inside.r += if surface_point.inside { -interfaces.behind } else { interfaces.behind } * normal;
            }
            if frame.body_at(&inside).is_some() {
                *place = inside;
                return true;
            }
        }
    }
}
