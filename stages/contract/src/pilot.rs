//! What a small part of a stage's run tells of the whole.

/// A part of the work of an instance that was done for its time, and how much there is of it.
///
/// The whole takes as many CPU seconds more than the tiles of the pilot as it has more work, and `rest_s`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pilot {
    /// Work of the pilot, all of it in [`Ctx::map_tiles`](crate::Ctx::map_tiles); > 0.
    pub done: f64,
    /// Work of the run.
    pub whole: f64,
    /// The unit of both: the name of the measure by which a record says how much work its run was, such as `flights`.
    pub unit: &'static str,
    /// CPU seconds of the run for what the pilot leaves out, by the stage's own figures.
    pub rest_s: f64,
}
