//! A convex solid with convex holes: tubes, hollow spheres with ports.

use glam::DVec3;

use super::{Chord, Solid, Start};

/// What lies in `whole` and in none of the holes. All of them are convex. Face 0 is the surface of `whole`, face k that of
/// the hole k - 1.
#[derive(Clone, Debug, PartialEq)]
pub struct Carved {
    pub whole: Solid,
    pub holes: Vec<Solid>,
}

impl Carved {
    pub(super) fn cut(&self, origin: DVec3, direction: DVec3, start: Option<Start>, chords: &mut Vec<Chord>) {
        let first = chords.len();
        let within = |face: u32, solid: &Solid| {
            // Inside a hole is outside the body.
            let own = start.filter(|s| s.face == face).map(|s| s.inside == (face == 0));
            solid.interval_from(own, origin, direction)
        };
        let Some((enter, leave)) = within(0, &self.whole) else { return };
        chords.push(Chord { enter, leave, into: 0, out_of: 0 });
        for (k, hole) in self.holes.iter().enumerate() {
            let face = k as u32 + 1;
            let Some((enter, leave)) = within(face, hole) else { continue };
            let mut i = first;
            while i < chords.len() {
                let chord = chords[i];
                if leave <= chord.enter || chord.leave <= enter {
                    i += 1;
                    continue;
                }
                let before = (chord.enter < enter).then_some(Chord { leave: enter, out_of: face, ..chord });
                let after = (leave < chord.leave).then_some(Chord { enter: leave, into: face, ..chord });
                chords.splice(i..=i, before.into_iter().chain(after));
                i += usize::from(before.is_some()) + usize::from(after.is_some());
            }
        }
    }

    pub(super) fn contains(&self, p: DVec3) -> bool {
        // A hole's surface is the body's.
        self.whole.contains(p) && !self.holes.iter().any(|hole| hole.contains(p) && hole.clearance(p) > 0.0)
    }

    /// The surface of a part is the body's only where it lies in the whole and in no other hole: from outside the whole or
    /// inside a hole, that is at least as far as their surfaces.
    pub(super) fn clearance(&self, p: DVec3) -> f64 {
        let to_whole = self.whole.clearance(p);
        let outside = if self.whole.contains(p) { 0.0 } else { to_whole };
        let mut least = to_whole.max(self.deepest(p, usize::MAX));
        for (k, hole) in self.holes.iter().enumerate() {
            let own = hole.clearance(p);
            if own < least {
                least = least.min(own.max(outside).max(self.deepest(p, k)));
            }
        }
        least
    }

    /// How deep in a hole other than `except` p lies at least.
    fn deepest(&self, p: DVec3, except: usize) -> f64 {
        let holes = self.holes.iter().enumerate().filter(|&(k, hole)| k != except && hole.contains(p));
        holes.map(|(_, hole)| hole.clearance(p)).fold(0.0, f64::max)
    }

    pub(super) fn normal(&self, face: u32, p: DVec3) -> DVec3 {
        if face == 0 { self.whole.normal(0, p) } else { -self.holes[face as usize - 1].normal(0, p) }
    }
}
