//! How much memory an instance takes, reckoned before anything is taken; and how much there is.

pub mod machine;

use std::collections::BTreeMap;

use turbid_contract::{Extent, StagePlan};

pub use machine::{Budget, Limit};

/// What goes with every instance: its thread, buffers of files and encoders.
const BESIDE: u64 = 8 << 20;
/// An instance that takes less is not reckoned with: that much goes into threads and tables of the program itself, and no machine lacks it.
pub const SMALL: u64 = 48 << 20;

/// Bytes that an instance takes at the most, whole: what its stage says of the run, or what is known of inputs and outputs where it says nothing, and what
/// the engine holds before and after. `None` where neither is known.
///
/// The most of three moments:
/// - reading: the inputs decoded, but for those that are held in parts, and a line of pixels; of a table or a record also its bytes as they are stored, no more than decoded;
/// - running: what the stage says, or twice its inputs and outputs;
/// - storing: the outputs decoded, and of one table or record at a time its encoded bytes. Images go to the disk line by line.
///
/// Of the artifacts on a port that takes many only one is held at a time, the largest.
pub fn need(plan: &StagePlan, inputs: &BTreeMap<String, Extent>) -> Option<u64> {
    let encoded = |extent: &Extent| if matches!(extent, Extent::Images { .. }) { 0 } else { extent.bytes() };
    let of = |extents: &mut dyn Iterator<Item = &Extent>| {
        let (mut bytes, mut stored) = (0_u64, 0_u64);
        for extent in extents {
            bytes = bytes.saturating_add(extent.bytes());
            stored = stored.max(encoded(extent));
        }
        (bytes, bytes.saturating_add(stored))
    };
    let whole = inputs.iter().filter(|(port, _)| !plan.in_parts.contains(&port.as_str()));
    let (taken, reading) = of(&mut whole.map(|(_, extent)| extent));
    let (made, storing) = of(&mut plan.makes.values());
    if plan.memory.is_none() && inputs.is_empty() && plan.makes.is_empty() {
        return None;
    }
    let running = plan.memory.unwrap_or_else(|| taken.saturating_add(made).saturating_mul(2));
    Some(reading.max(running).max(storing).saturating_add(BESIDE))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The largest of the three moments, and nothing of what nothing is known of.
    #[test]
    fn the_largest_moment_counts() {
        let inputs = BTreeMap::from([("frames".to_owned(), Extent::images(1000, 1000, 8))]);
        let mut plan = StagePlan::default();
        assert_eq!(need(&plan, &BTreeMap::new()), None);
        assert_eq!(need(&plan, &inputs), Some(64_000_000 + BESIDE));
        plan.memory = Some(1_000_000);
        assert_eq!(need(&plan, &inputs), Some(32_000_000 + BESIDE), "reading");
        plan.in_parts = vec!["frames"];
        assert_eq!(need(&plan, &inputs), Some(1_000_000 + BESIDE), "in parts");
        plan.in_parts.clear();
        plan.memory = Some(50_000_000);
        assert_eq!(need(&plan, &inputs), Some(50_000_000 + BESIDE), "running");
        plan.makes.insert("lut", Extent::Table { rows: 1_000_000, columns: 5 });
        assert_eq!(need(&plan, &inputs), Some(80_000_000 + BESIDE), "storing");
        plan.memory = Some(u64::MAX);
        assert_eq!(need(&plan, &inputs), Some(u64::MAX), "no sum wraps around");
    }
}
