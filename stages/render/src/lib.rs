//! turbid render.
