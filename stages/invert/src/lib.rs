//! turbid invert.
