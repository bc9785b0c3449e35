//! Flights to where paths are scattered next if they stay in their medium.

use fearless_simd::prelude::*;

use super::frame::Frame;
use super::ground::Passage;
use super::lane::{F, U, V, ln, philox, unit};
use super::rows::PathLanes;

/// What is drawn for a flight.
#[derive(Clone, Copy)]
pub struct Draw<S: Simd> {
    /// The free flight, two of the angles, and one that decides on reflection or on next-event estimation.
    pub random: [U<S>; 4],
    /// Optical free flight by scattering.
    pub tau: F<S>,
}

impl<S: Simd> Draw<S> {
    /// For the flight so many numbers after the next one of these paths.
    #[inline(always)]
    pub fn of(simd: S, frame: &Frame<'_>, after: u32, path: &PathLanes<S>) -> Self {
        let number = path.number + after;
        let random = philox(simd, number, U::splat(simd, frame.channel), path.sample, path.pixel, &frame.keys);
        Self { random, tau: -ln(unit(random[0])) }
    }
}

/// Such a flight.
#[derive(Clone, Copy)]
pub struct FreeFlight<S: Simd> {
    pub draw: Draw<S>,
    /// mm of it, and where it ends.
    pub s: F<S>,
    pub r: V<S>,
    pub passage: Passage<S>,
}

impl<S: Simd> FreeFlight<S> {
    #[inline(always)]
    pub fn of(frame: &Frame<'_>, start: &PathLanes<S>, draw: Draw<S>) -> Self {
        let s = draw.tau * start.free_path;
        let r = start.r.plus(s, start.w);
        let passage = frame.ground.pass(s.token(), start.body, start.r, start.w, s, r);
        Self { draw, s, r, passage }
    }
}
