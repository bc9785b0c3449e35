//! turbid optics.
