//! What f32 and the lanes hold, and how the random numbers of next-event estimation are marked.

use crate::world::World;

/// Overlaps are resolved for so many bodies at most.
pub const MOST_BODIES: usize = 16;

/// Of so many at most where they turn light: each of their faces is asked for a connection.
pub const MOST_TURNING: usize = 4;

/// The number of an estimate along a camera's ray, whose lower bits say in which segment of it, among those that scatter.
pub const FIRST: u32 = 1 << 31;

/// The number of an estimate from where a flight, by its block of random numbers, comes into a medium from elsewhere. Others have the (odd) block behind
/// their flight's.
pub const ENTRY: u32 = 1 << 30;

/// The same of an estimate along a flight that an interface has turned.
pub const TURNED: u32 = 1 << 29;

/// Optical depth (optical distance to the light) beyond which it counts as none: e^-80 of it.
pub const DARK: f32 = 80.0;

/// The most channels whose next-event estimation goes in lanes together.
pub const MOST_CHANNELS: usize = 16;

/// Coordinates up to so many mean free paths: their last digit is 2^-12 of one, and the error made by it, of either sign from
/// flight to flight, stays below 1e-4.
pub const RANGE: f64 = 4096.0;

/// How far (mm) from its origin f32 holds a world: [`RANGE`] of the shortest mean free paths.
pub fn range(world: &World) -> f64 {
    let most = world.materials.iter().map(|m| m.mu_s).fold(0.0, f64::max);
    (RANGE / most).min(LARGEST)
}

/// Cycles of a carrier across the field, beyond which its phase loses 1e-4 rad.
pub const CYCLES: f64 = 256.0;

/// Coefficients (mm^-1) and lengths (mm) beyond these leave too little of the exponents of f32.
pub const LARGEST: f64 = 1e9;

/// Of the bodies together: worlds of more are left to the scalar walker.
pub const MOST_FACES: usize = 8;

/// Of a ray's coordinates, and of its length to there: some last digits of them. What lies between bodies and is thinner is not there.
pub const SLIVER: f32 = 4.8e-7;
