//! turbid compare.
