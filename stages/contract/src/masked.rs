//! Which pixels of an image are left out, and why: shares of a mask by reason.

use crate::ctx::Ctx;
use crate::payload::MaskReason;

impl MaskReason {
    /// The reason that a mask's value stands for; `None` where it stands for none that is known.
    pub fn of_code(code: f32) -> Option<Self> {
        Self::ALL.into_iter().find(|reason| reason.code() == code)
    }

    /// Whether geometry alone decides: which pixels such a reason leaves out does not depend on what was measured there, so
    /// that the mean of the others is not moved. All other reasons look at the measured value, and so at its noise.
    pub fn is_structural(self) -> bool {
        matches!(
            self,
            Self::Background
                | Self::NoHeight
                | Self::OutsideReference
                | Self::BeyondProjector
                | Self::OutsideSections
                | Self::TooSteep
        )
    }
}

impl Ctx<'_> {
    /// Measures which share of the pixels is masked (`masked`, %) and how much of it each reason makes (`masked: REASON`, %).
    ///
    /// Returns the reasons in words for a message, the most frequent first: `12 % signal too weak, 3 % background`; empty
    /// where nothing is masked. Without pixels nothing is measured.
    pub fn measure_masked(&self, mask: impl IntoIterator<Item = f32>) -> String {
        let (mut counts, mut others, mut all) = ([0_u64; MaskReason::ALL.len()], 0_u64, 0_u64);
        for code in mask {
            all += 1;
            // Most pixels of most images.
            if code == 0.0 {
                continue;
            }
            match MaskReason::ALL.iter().position(|reason| reason.code() == code) {
                Some(reason) => counts[reason] += 1,
                None => others += 1,
            }
        }
        if all == 0 {
            return String::new();
        }
        let percent = |count: u64| 100.0 * count as f64 / all as f64;
        let reasons = MaskReason::ALL.iter().zip(counts).filter(|(reason, _)| **reason != MaskReason::Good);
        let mut found: Vec<(u64, &str)> = reasons.map(|(reason, count)| (count, reason.text())).collect();
        found.push((others, "a reason without a name"));
        found.retain(|&(count, _)| count > 0);
        // Stable: reasons of equal count stay in their order.
        found.sort_by_key(|&(count, _)| std::cmp::Reverse(count));
        self.measure("masked", percent(found.iter().map(|&(count, _)| count).sum()), "%");
        found.iter().for_each(|&(count, text)| self.measure(&format!("masked: {text}"), percent(count), "%"));
        let words = found.iter().map(|&(count, text)| format!("{} % {text}", rounded(percent(count))));
        words.collect::<Vec<_>>().join(", ")
    }
}

/// Two digits that count, for a message.
fn rounded(percent: f64) -> String {
    if percent >= 9.95 { format!("{percent:.0}") } else { format!("{percent:.2}") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kit::MemoryHost;

    /// Shares by reason add up to the whole share, good pixels have none, and no pixel at all says nothing.
    #[test]
    fn reasons_are_counted() {
        let host = MemoryHost::default();
        let [low, dark] = [MaskReason::LowSignal, MaskReason::BelowTable].map(MaskReason::code);
        let said = Ctx::new(&host).measure_masked([0.0, dark, low, 0.0, 0.0, low, 0.0, 99.0]);
        let measures = host.measures.lock().expect("nobody panicked");
        let of = |name: &str| measures[name];
        assert_eq!(
            (of("masked"), of("masked: signal too weak"), of("masked: darker than the table")),
            (50.0, 25.0, 12.5)
        );
        assert_eq!(measures.len(), 4);
        assert_eq!(said, "25 % signal too weak, 12 % darker than the table, 12 % a reason without a name");
        drop(measures);
        let empty = MemoryHost::default();
        assert_eq!(Ctx::new(&empty).measure_masked([]), "");
        assert_eq!(Ctx::new(&empty).measure_masked([0.0]), "");
        assert_eq!(empty.measures.lock().expect("nobody panicked")["masked"], 0.0);
    }

    /// Codes and reasons belong together.
    #[test]
    fn codes_come_back() {
        assert!(MaskReason::ALL.into_iter().all(|reason| MaskReason::of_code(reason.code()) == Some(reason)));
        assert_eq!(MaskReason::of_code(0.5), None);
        assert!(MaskReason::Background.is_structural() && !MaskReason::BelowTable.is_structural());
    }
}
