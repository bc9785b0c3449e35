//! `sensor`: what a camera makes of ideal frames, so that a design can be tried on the camera that it will have.
//!
//! ```yaml
//! seen:
//!   use: sensor
//!   in: {frames: frames, covariance: frames.covariance}
//!   with:
//!     bits: 8                  # 1 to 16; left out: no quantisation
//!     exposure: -1             # stops: 2^exposure times the light
//!     full_scale: 2e-5         # W mm^-2 sr^-1 that saturates at exposure 0; left out: the 99.9th percentile of the frames
//!     full_well: 10000         # electrons at full scale; left out: no shot noise
//!     read_noise: 8            # electrons, standard deviation
//!     black: 0.02              # level of darkness, share of full scale
//!     gamma: 2.2               # of the encoding; linearise: false leaves it in the frames
//!     defocus_px: 0.8          # standard deviation of the Gaussian point spread
//!     vignetting: 0.2          # share of the light that is lost in the corners
//!     response_spread: 0.01    # of the pixels, share of the mean; dark_spread: of their dark levels
//! ```
//! Frames come out as radiance again, so that every later stage reads them as it reads ideal ones. Theory: `docs/theory/sensor.md`.

mod blur;
mod camera;
mod covariance;
mod form;
mod noise;
mod params;
mod pixels;
mod stage;

pub use blur::Blur;
pub use camera::{Camera, Exposed};
pub use noise::{Draws, poisson};
pub use params::Params;
pub use pixels::Pixels;
pub use stage::{In, Out, Sensor};
