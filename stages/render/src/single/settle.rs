//! What befalls a path where lanes cannot follow it: walked one by one until they can.

use super::frame::Frame;
use crate::random::SCOUT;
use crate::setting::Place;
use crate::walker::Walker;

/// Number of the last flight that is left to the scalar walker for it: lanes count no further.
pub const LATE: u32 = SCOUT - 2;

/// One odd flight, and those after it until the path is in a medium again, scored ahead, where lanes can go on; false where it
/// has ended.
pub fn settles(walker: &mut Walker<'_>, frame: &Frame<'_>, place: &mut Place) -> bool {
    loop {
        if !walker.step(place) {
            return false;
        }
        // In a medium, not at a wall; or through the plane, and not scattered yet.
        let ready = place.skin.is_none() || (!place.scattered && place.number == u64::from(frame.first));
        if place.ahead && ready && place.number < u64::from(LATE) {
            let mut inside = *place;
            if let (Some(walls), Some(skin)) = (&frame.walls, place.skin) {
                // Lanes know no skins: rounding must not put it outside.
                let normal = walker.setting().world.normal(skin.wall, place.r);
                inside.r += if skin.inside { -walls.behind } else { walls.behind } * normal;
            }
            if frame.body_at(&inside).is_some() {
                *place = inside;
                return true;
            }
        }
    }
}
