//! What a trace asks of its sums while they grow: their error, where paths are needed, and where control variates pay.

use crate::moments::Moments;

/// What is made of sums while they grow: of those of all channels, and the paths of each pixel. By default every pixel has as many paths,
/// and no control variate.
pub trait StoppingCriterion: Sync {
    /// Relative error of the image; `None` where it is dark. `with_control`: the pixels whose paths are walked in their control variate, too.
    fn error(&self, sums: &[Moments], paths: &[u32], with_control: Option<&[bool]>) -> Option<f64>;

    /// How many paths the pixels need in proportion; see [`needs`](crate::allocation::needs).
    fn needs(&self, _sums: &[Moments], paths: &[u32], _with_control: Option<&[bool]>) -> Vec<f64> {
        vec![1.0; paths.len()]
    }

    /// In which pixels walking their control variate, too, is worth it. `flights` of a path in the scene and in a control variate.
    fn with_control(&self, _sums: &[Moments], paths: &[u32], _flights: [f64; 2]) -> Vec<bool> {
        vec![false; paths.len()]
    }

    /// The part of the time that may be spent on these paths.
    fn part(&self, _with_control: Option<&[bool]>) -> f64 {
        1.0
    }
}
