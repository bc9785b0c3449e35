//! What is said of each wrong joint.

use super::reason::Reason::{self, *};
use super::wrong::Wrong::{self, *};

/// A joint: what the check refuses, what it warns of, and what it lets pass for which reason.
pub struct Row {
    pub consumer: &'static str,
    pub producer: &'static str,
    pub refused: &'static [Wrong],
    pub warned: &'static [Wrong],
    pub passes: &'static [(&'static [Wrong], Reason)],
}

pub const JOINTS: [Row; 0] = [];
