//! The truth tables as rows of numbers; an empty cell is NaN.

#![allow(dead_code, reason = "each test binary reads its own tables")]

use turbid_iad::{Slab, Slide};

pub const FORWARD: &str = include_str!("../reference/adding_doubling_forward.csv");
pub const INVERSE: &str = include_str!("../reference/iad_inverse_rt.csv");
pub const INVERSE_WITH_G: &str = include_str!("../reference/iad_inverse_rtu.csv");
pub const ROBUST: &str = include_str!("../reference/iad_robust_inputs.csv");
pub const CHANDRASEKHAR: &str = include_str!("../reference/chandrasekhar_isotropic.csv");
pub const INVERSE_DIS: &str = include_str!("../reference/iad_inverse_dis.csv");
pub const BALANCE: &str = include_str!("../reference/dis_energy_balance.csv");
pub const EXTREME: &str = include_str!("../reference/slab_extreme.csv");

pub fn rows(table: &str) -> Vec<Vec<f64>> {
    let number = |cell: &str| cell.parse().unwrap_or(f64::NAN);
    table.lines().skip(1).map(|line| line.split(',').map(number).collect()).collect()
}

/// A slab between two like slides, 1 mm thick.
pub fn slab(n: f64, g: f64, n_slide: f64) -> Slab {
    let slide = Slide::clear(n_slide);
    Slab { top: slide, bottom: slide, ..Slab::bare(n, g, 1.0) }
}

/// `name=value` in the text of a case.
pub fn named(text: &str, name: &str) -> Option<f64> {
    text.split(' ').find_map(|word| word.strip_prefix(name)?.strip_prefix('=')?.parse().ok())
}
