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
//! The noise of the camera may come from frames of a scene that does not change:
//! ```yaml
//! noise:
//!   use: photon_transfer
//!   with:
//!     bursts: [{files: [data/a1.tif, data/a2.tif]}, {files: [data/b.tif]}]    # of a file with pages each is a frame
//!     dark: {files: [data/dark1.tif, data/dark2.tif]}
//! lit:
//!   use: import_frames
//!   in: {transfer: noise}
//!   with: {pattern: "data/hand_{f_x}_{phase}.tif", f_x: [0, 0.1], phases: 3, dark: data/dark1.tif}
//! ```
//! What others found of their frames:
//! ```yaml
//! theirs:
//!   use: import_maps
//!   with:
//!     layers:
//!       - {quantity: mu_a, file: data/theirs.mat, variable: mua, unit: cm^-1}
//!       - {quantity: mu_s_prime, file: data/theirs.mat, variable: musp, unit: cm^-1}
//! judged: {use: compare, in: {estimate: maps, truth: theirs}}
//!
//! demodulated:
//!   use: import_modulation
//!   with:
//!     layers:
//!       - {quantity: m_dc, f_x: 0, file: data/dc.tif}
//!       - {quantity: m_ac, f_x: 0.1, file: data/ac.tif}
//!
//! calibrated:
//!   use: import_reflectance
//!   with:
//!     layers: [{quantity: r_d, f_x: 0, file: data/rd.csv, unit: "%"}, {quantity: r_d, f_x: 0.1, file: data/rd_ac.csv, unit: "%"}]
//!     convention: hemispherical_incident
//!     conditions: {g: 0.8, n: 1.4}
//! ```
//! PNG (8, 16 bit), TIFF and BigTIFF (8, 16, 32 bit, float; pages), EXR, BMP, PGM, NumPy's .npy and .npz, MATLAB's .mat, numbers in text and files without a header. Theory: `docs/theory/import_frames.md`.

mod answers;
mod answers_stage;
mod conditions;
mod correct;
mod decode;
mod form;
mod frame;
mod names;
mod params;
mod photon_transfer;
mod stage;
mod transfer;

pub use answers::{AnswerLayer, AnswerParams, AnswerUnit, ImageFile, Kind};
pub use answers_stage::{
    AnswerIn, ImportMaps, ImportModulation, ImportReflectance, MapsOut, ModulationOut, ReflectanceOut,
};
pub use conditions::ConditionsParams;
pub use correct::{Camera, Corrected, Electrons, Light};
pub use decode::{Channel, Numbers, Picture, Raw, RawType, Wanted, decode, pages};
pub use params::{DarkParams, FrameParams, Params, Shot};
pub use photon_transfer::{BurstParams, PhotonTransfer, TransferIn, TransferOut, TransferParams};
pub use stage::{ImportFrames, In, Out};
