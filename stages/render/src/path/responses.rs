//! What paths have brought: where it is summed.

use crate::walker::Walker;

impl Walker<'_> {
    /// Makes room for the responses of `paths` paths.
    pub fn clear_responses(&mut self, paths: usize) {
        self.paths = paths;
        let numbers = self.slots(2) * self.stride();
        self.responses.clear();
        self.responses.resize(numbers, 0.0);
        self.connected.clear();
        self.connected.resize(numbers, 0.0);
    }

    /// Responses of all paths, and where there are light-directed branches so many of each kind: what light-directed branches bring is summed apart, so that it does not matter
    /// when they go.
    fn slots(&self, kinds: usize) -> usize {
        if self.light_branches.is_empty() { self.paths } else { kinds * self.paths }
    }

    /// Completes the responses, once all paths have ended.
    pub fn gather(&mut self) {
        for (response, connected) in self.responses.iter_mut().zip(&self.connected) {
            *response += connected;
        }
        let own = self.paths * self.stride();
        let (sums, branched) = self.responses.split_at_mut(own);
        for (sum, branched) in sums.iter_mut().zip(branched) {
            *sum += *branched;
        }
        self.responses.truncate(own);
    }

    /// Zeros for the responses that come by f32 lanes; see [`Walker::add_single`].
    pub(crate) fn take_single(&mut self) -> Vec<f64> {
        let mut single = std::mem::take(&mut self.single);
        single.clear();
        // Those of light-directed branches where they end and where they come in.
        single.resize(self.slots(3) * self.stride(), 0.0);
        single
    }

    /// Adds what f32 lanes have seen.
    pub(crate) fn add_single(&mut self, single: Vec<f64>) {
        for kind in single.chunks(self.responses.len().max(1)) {
            for (response, single) in self.responses.iter_mut().zip(kind) {
                *response += single;
            }
        }
        self.single = single;
    }

    /// Of all its channels.
    pub fn response(&self, path: usize) -> &[f64] {
        &self.responses[path * self.stride()..][..self.stride()]
    }

    /// Of one channel, by its place in the group.
    pub fn response_in(&self, path: usize, channel: usize) -> &[f64] {
        let width = self.setting.layout().width();
        &self.response(path)[channel * width..][..width]
    }

    pub(crate) fn stride(&self) -> usize {
        self.setting.layout().width() * self.setting.channels()
    }
}
