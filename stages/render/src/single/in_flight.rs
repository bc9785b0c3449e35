//! The state of sixteen paths that are walked side by side.

use fearless_simd::prelude::*;

use super::copies::Copies;
use super::frame::Frame;
use super::lane::LANES;
use super::light_branch::LightBranches;
use super::next_event::NextEvents;
use super::rows::{PathLanes, Paths};

/// The paths in flight.
pub(super) struct Packet<'a, S: Simd> {
    pub(super) simd: S,
    pub(super) frame: &'a Frame<'a>,
    pub(super) path: PathLanes<S>,
    /// By bits.
    pub(super) alive: u64,
    /// Flights that only ask how far they may go, by bits, and the lengths of all.
    pub(super) asking: u64,
    pub(super) steps: [f32; LANES],
    pub(super) next_events: NextEvents,
    /// For what goes through memory.
    pub(super) memory: Paths,
    /// Beside it, of paths that `next_event_singly` (in `walk.rs`) estimates: the unit vector along which they go on, the random number of the roulette, and how
    /// far (mm) from any surface they are.
    pub(super) singly: [[f32; LANES]; 5],
    /// Copies of paths, and memory for what is done with them.
    pub(super) copies: Copies,
    pub(super) aside: Paths,
    pub(super) light_branches: LightBranches,
    /// The paths that rest while light-directed branches fly, and by bits those that live.
    pub(super) resting: Paths,
    pub(super) resting_alive: u64,
    /// How many responses there are of each kind: after those of paths come those of light-directed branches where they end, and where they come in.
    pub(super) paths: u32,
}

impl<'a, S: Simd> Packet<'a, S> {
    #[inline(always)]
    pub(super) fn new(simd: S, frame: &'a Frame<'a>, paths: usize) -> Self {
        let counted = frame.counts;
        Self {
            simd,
            frame,
            path: PathLanes::zeros(simd),
            alive: 0,
            asking: 0,
            steps: [0.0; LANES],
            next_events: NextEvents::new(counted),
            memory: Paths::new(counted),
            singly: [[0.0; LANES]; 5],
            copies: Copies::default(),
            aside: Paths::new(counted),
            light_branches: LightBranches::new(counted),
            resting: Paths::new(counted),
            resting_alive: 0,
            paths: paths as u32,
        }
    }
}
