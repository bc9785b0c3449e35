//! `calibrate_dis`: the double-integrating-sphere experiment, simulated.
//!
//! ```yaml
//! use: calibrate_dis
//! with:
//!   media:                            # as in `scene`; by name
//!     healthy: {A_rho: 25, S_rho: 4236, g: 0.8, n: 1.0}
//!   spheres:                          # two equal spheres, the sample between them
//!     diameter: 100                   # mm, inside
//!     wall_reflectance: 0.98
//!     ports:
//!       entrance: {square: {side: 10}}          # opposite the sample in the first sphere
//!       sample: {square: {side: 10}}            # or round: {diameter: 10}
//!       detector: {round: {diameter: 10}, polar_deg: 90, sees: wall}   # in either sphere; sees: all by default
//!       exit: {round: {diameter: 10}}           # default: none; opposite the sample in the second sphere
//!     neck: 0                         # default; mm from the rim of the sample port to the sample
//!     baffle: {diameter: 20, position: 0.5}     # default: none; between sample and detector
//!   sample: {thickness: 1, size: [10, 10], slides: 1.5}    # size default: without end; slides default: none
//!   beam: {collimated: {diameter: 1}} # or conical: {diameter: 1, half_angle_deg: 3}
//!   standard: {reflectance: 0.99}     # taken_as: what it is believed to be
//!   samples: 1000000                  # photons per reading
//!   method: auto                      # default; summed without a baffle, else traced
//! ```
//!
//! Source of the set-up: Pickering et al., Appl. Opt. 32, 399 (1993). Light is followed as `docs/theory/calibrate_dis.md` says.

mod assemble;
mod direction;
mod light;
mod opening;
mod params;
mod plate;
mod readings;
mod sphere;
mod stage;
mod stream;
mod tally;

pub use assemble::{Experiment, assemble};
pub use light::{Beam, Method, Setup, Target};
pub use opening::{Opening, Outline};
pub use params::Params;
pub use plate::{Passage, Plate, Ray};
pub use readings::{Loss, Measured, Normals};
pub use sphere::{Baffle, Port, Sphere};
pub use stage::{CalibrateDis, In, Out};
pub use stream::{Stream, of_medium};
pub use tally::{Entered, FATES, Fate, Score, TALLIED, Tally};
