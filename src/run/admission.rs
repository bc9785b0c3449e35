//! Which instances may be at work side by side: as many as fit into the memory that there is.

use std::collections::BTreeMap;

use crate::memory::SMALL;
use crate::plan::InstanceId;

/// What running instances take, and what there is.
#[derive(Clone, Debug, Default)]
pub struct Admission {
    /// Bytes; `None` where nobody knows.
    budget: Option<u64>,
    /// Bytes that instances take. What is not named takes little, or nobody knows how much.
    needs: BTreeMap<InstanceId, u64>,
    taken: u64,
}

impl Admission {
    pub fn new(budget: Option<u64>, needs: impl IntoIterator<Item = (InstanceId, u64)>) -> Self {
        Self { budget, needs: needs.into_iter().filter(|(_, bytes)| *bytes > SMALL).collect(), taken: 0 }
    }

    fn need(&self, id: InstanceId) -> u64 {
        self.needs.get(&id).copied().unwrap_or(0)
    }

    /// Whether an instance may begin now. Where none is at work it always may: what can never fit was told before the run, and an instance that
    /// has grown since then is better tried than waited for. The first in line is not overtaken, so each has its turn.
    pub fn admits(&self, id: InstanceId, any_at_work: bool) -> bool {
        let sum = self.taken.saturating_add(self.need(id));
        !any_at_work || self.need(id) == 0 || self.budget.is_none_or(|budget| sum <= budget)
    }

    pub fn begin(&mut self, id: InstanceId) {
        self.taken = self.taken.saturating_add(self.need(id));
    }

    pub fn end(&mut self, id: InstanceId) {
        self.taken = self.taken.saturating_sub(self.need(id));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::Id;

    const GB: u64 = 1_000_000_000;

    /// Two of 3 GB fit into 7 and a third does not; one of 9 GB waits until nothing is at work, then has its turn.
    #[test]
    fn what_fits_runs_side_by_side() {
        let [a, b, c, large, small, unknown] = [0, 1, 2, 3, 4, 99].map(InstanceId::new);
        let needs = [(a, 3 * GB), (b, 3 * GB), (c, 3 * GB), (large, 9 * GB), (small, 1000)];
        let mut admission = Admission::new(Some(7 * GB), needs);
        assert!(admission.admits(a, false));
        admission.begin(a);
        assert!(admission.admits(b, true));
        admission.begin(b);
        assert!(!admission.admits(c, true) && !admission.admits(large, true));
        assert!(
            admission.admits(small, true) && admission.admits(unknown, true),
            "small ones, and those that nothing is known of"
        );
        admission.end(a);
        assert!(admission.admits(c, true) && !admission.admits(large, true));
        admission.end(b);
        assert!(admission.admits(large, false));
        assert_eq!(admission.taken, 0);
        assert!(
            Admission::new(None, [(a, u64::MAX), (b, u64::MAX)]).admits(a, true),
            "where nobody knows what there is"
        );
    }
}
