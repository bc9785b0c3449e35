//! The params of `pattern` and `predistort`.

pub(crate) mod pattern;
pub(crate) mod predistort;

/// Layers of a fringe where nobody says how many.
fn three() -> u32 {
    3
}
