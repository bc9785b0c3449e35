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

    const GB: u64 = 1_000_000_000;

    /// Two of 3 GB fit into 7 and a third does not; one of 9 GB waits until nothing is at work, then has its turn.
    #[test]
    fn what_fits_runs_side_by_side() {
        let mut admission =
            Admission::new(Some(7 * GB), [(0, 3 * GB), (1, 3 * GB), (2, 3 * GB), (3, 9 * GB), (4, 1000)]);
        assert!(admission.admits(0, false));
        admission.begin(0);
        assert!(admission.admits(1, true));
        admission.begin(1);
        assert!(!admission.admits(2, true) && !admission.admits(3, true));
        assert!(
            admission.admits(4, true) && admission.admits(99, true),
            "small ones, and those that nothing is known of"
        );
        admission.end(0);
        assert!(admission.admits(2, true) && !admission.admits(3, true));
        admission.end(1);
        assert!(admission.admits(3, false));
        assert_eq!(admission.taken, 0);
        assert!(
            Admission::new(None, [(0, u64::MAX), (1, u64::MAX)]).admits(0, true),
            "where nobody knows what there is"
        );
    }
}
