//! `import_frames`: measured frames, so that the pipelines that process rendered ones process real data too.
//!
//! ```yaml
//! frames:
//!   use: import_frames
//!   with:
//!     pattern: data/hand_{f_x}_{phase}.tif    # {f_x}, {phase} (its number), {wavelength}
//!     f_x: [0, 0.1]
//!     phases: 3
//!     dark: data/dark.tif                     # what the camera reads without light
//!     flat: data/flat.tif                     # an even surface under even light
//!     full_well: 10000                        # electrons; gives standard errors
//! ```
//! or, where the names follow no pattern,
//! ```yaml
//!     frames:
//!       - {file: a.png, f_x: 0}
//!       - {file: b.png, f_x: 0.1, phase_deg: 0, exposure: 1}
//! ```
//! PNG (8, 16 bit), TIFF and BigTIFF (8, 16, 32 bit, float; pages), EXR, BMP, PGM, NumPy's .npy and .npz, MATLAB's .mat, numbers in text and files without a header. Theory: `docs/theory/import_frames.md`.

mod conditions;
mod correct;
mod decode;
mod form;
mod names;
mod params;
mod stage;

pub use conditions::ConditionsParams;
pub use correct::{Camera, Corrected, Light};
pub use decode::{Channel, Numbers, Picture, Raw, RawType, Wanted, decode, pages};
pub use params::{DarkParams, FrameParams, Params, Shot};
pub use stage::{ImportFrames, In, Out};
