//! turbid calibrate.
