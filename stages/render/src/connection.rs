//! Light connections of a point: what they bring, and the specular chains that they follow.

use glam::DVec3;
use turbid_optics::refraction::Leg;

use crate::lengths::Lengths;

/// Light that reaches a point.
#[derive(Clone, Copy, Debug)]
pub struct Connection {
    /// Unit vector from the point against the light.
    pub towards: DVec3,
    /// On a surface there that faces it, at pattern value 1, over n^2 (W mm^-2), without attenuation; over the probability of
    /// having tried this connection.
    pub irradiance: f64,
    /// Optical depth on it.
    pub tau: f64,
    /// Normal, towards the light, of the first boundary on it.
    pub exit: Option<DVec3>,
    /// Where the pattern's plane lies on it.
    pub on_plane: DVec3,
    /// Whether it is inside the field.
    pub lit: bool,
    /// mm on it in each medium that tells channels apart.
    pub lengths: Lengths,
}

/// A straight stretch of a chain.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stretch {
    pub(crate) leg: Leg,
    pub(crate) up: bool,
    /// World z of its end.
    pub(crate) until: f64,
}

/// A specular chain through parallel planes: stretches, and what happens between them.
#[derive(Clone, Debug, Default)]
pub(crate) struct SpecularChain {
    pub(crate) stretches: Vec<Stretch>,
    /// (n on the side where the light is, n on the other side, reflected).
    pub(crate) events: Vec<(f64, f64, bool)>,
    /// Scratch of the search: mm of height that it has passed in each layer.
    pub(crate) passed: Vec<f64>,
}

impl SpecularChain {
    pub(crate) fn clear(&mut self) {
        self.stretches.clear();
        self.events.clear();
    }

    pub(crate) fn go(&mut self, n: f64, from: f64, until: f64, up: bool) {
        self.stretches.push(Stretch { leg: Leg { n, depth: (until - from).abs() }, up, until });
    }

    /// Takes back the last [`SpecularChain::go`].
    pub(crate) fn undo(&mut self) {
        self.stretches.pop();
    }

    /// At the end of a stretch in index `n`.
    pub(crate) fn meet(&mut self, n: f64, beyond: f64, reflected: bool) {
        self.events.push((n, beyond, reflected));
    }

    /// Takes back the last [`SpecularChain::meet`].
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

/// A connection that need not be searched.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Known {
    pub connection: Connection,
    /// Interfaces that turn it.
    pub(crate) events: usize,
}

/// Connections are one if their directions differ by less, rad.
pub(crate) const SAME: f64 = 1e-6;

/// A connection by one refraction so near (rad) to the one that lanes have found is that: where others are as near they are not sure of theirs.
pub(crate) const ABOUT: f64 = 1e-4;

impl Known {
    /// Whether it is the connection that begins along `w`.
    pub(crate) fn is(&self, w: DVec3, events: usize) -> bool {
        self.events == events && (self.connection.towards - w).length() < SAME
    }

    /// Whether it is the connection by one refraction that lanes have found along about `w`.
    pub(crate) fn is_about(&self, w: DVec3) -> bool {
        self.events == 1 && (self.connection.towards - w).length() < ABOUT
    }
}
