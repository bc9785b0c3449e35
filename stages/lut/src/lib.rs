//! turbid lut.
