//! Ways of light to a point: what they bring, and of which stretches they are made.

use glam::DVec3;
use turbid_optics::refraction::Leg;

use crate::lengths::Lengths;

/// Light that reaches a point.
#[derive(Clone, Copy, Debug)]
pub struct Link {
    /// Unit vector from the point against the light.
    pub towards: DVec3,
    /// On a surface there that faces it, at pattern value 1, over n^2 (W mm^-2), without attenuation; over the probability of
    /// having looked at this link.
    pub irradiance: f64,
    /// Optical depth on the way.
    pub tau: f64,
    /// Normal, towards the light, of the first boundary on the way.
    pub exit: Option<DVec3>,
    /// Where the pattern's plane lies on the way.
    pub on_plane: DVec3,
    /// Whether it is inside the field.
    pub lit: bool,
    /// mm on the way in each medium that tells channels apart.
    pub lengths: Lengths,
}

/// A straight stretch of a way.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stretch {
    pub(crate) leg: Leg,
    pub(crate) up: bool,
    /// World z of its end.
    pub(crate) until: f64,
}

/// A way through parallel planes: stretches, and what happens between them.
#[derive(Clone, Debug, Default)]
pub(crate) struct Way {
    pub(crate) stretches: Vec<Stretch>,
    /// (n on the side where the light is, n on the other side, reflected).
    pub(crate) events: Vec<(f64, f64, bool)>,
    /// Scratch of the search: mm of height that it has passed in each layer.
    pub(crate) passed: Vec<f64>,
}

impl Way {
    pub(crate) fn clear(&mut self) {
        self.stretches.clear();
        self.events.clear();
    }

    pub(crate) fn go(&mut self, n: f64, from: f64, until: f64, up: bool) {
        self.stretches.push(Stretch { leg: Leg { n, depth: (until - from).abs() }, up, until });
    }

    /// Takes back the last [`Way::go`].
    pub(crate) fn undo(&mut self) {
        self.stretches.pop();
    }

    /// At the end of a stretch in index `n`.
    pub(crate) fn meet(&mut self, n: f64, beyond: f64, reflected: bool) {
        self.events.push((n, beyond, reflected));
    }

    /// Takes back the last [`Way::meet`].
    pub(crate) fn forget(&mut self) {
        self.events.pop();
    }

    /// How many planes are on it.
    pub(crate) fn turns(&self) -> usize {
        self.events.len()
    }

    /// Whether one of them reflects it.
    pub(crate) fn is_reflected(&self) -> bool {
        self.events.iter().any(|event| event.2)
    }

    /// Whether a plane is on it.
    pub(crate) fn is_bent(&self) -> bool {
        !self.events.is_empty()
    }
}

/// A way that need not be looked for.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Known {
    pub link: Link,
    /// Walls that turn it.
    pub(crate) events: usize,
}

/// Ways are one if their directions differ by less, rad.
pub(crate) const SAME: f64 = 1e-6;

impl Known {
    /// Whether it is the way that begins along `w`.
    pub(crate) fn is(&self, w: DVec3, events: usize) -> bool {
        self.events == events && (self.link.towards - w).length() < SAME
    }
}
