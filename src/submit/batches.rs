//! How many shards work is cut into.

/// CPU seconds that each thread of a task is at work for at the least, unless the user says otherwise: to start a task takes
/// an engine about 0.1 s, and the program some 0.05 s.
pub const LEAST_S: f64 = 5.0;
/// More tasks than this only if somebody asks for them: Slurm takes arrays of 1000 tasks unless its administrator says otherwise.
const USUAL_MOST: u32 = 1000;
/// So many times more shards than tasks are tried, where few of the points are stale.
const FINEST: u32 = 64;

/// How many tasks there should be.
///
/// `cpu_s`: what is stale takes that many CPU seconds; `least_s`: CPU seconds of a task; `most`: what the user said.
pub fn tasks(cpu_s: f64, least_s: f64, most: Option<u32>) -> u32 {
    let long_enough = (cpu_s / least_s).floor().max(1.0);
    // A number of any size fits: the cast ends at the largest.
    (long_enough as u32).min(most.unwrap_or(USUAL_MOST)).max(1)
}

/// Into how many shards a plan is split, so that at most `tasks` of them have something to do: many more than that where most
/// points are up to date.
///
/// `stale` tells how many of so many shards have something to do.
pub fn shards(tasks: u32, stale: impl Fn(u32) -> usize) -> u32 {
    if stale(tasks) >= tasks as usize {
        return tasks;
    }
    let finer = std::iter::successors(Some(FINEST), |by| Some(by / 2)).take_while(|by| *by > 1);
    let fits = |of: &u32| stale(*of) <= tasks as usize;
    finer.filter_map(|by| tasks.checked_mul(by)).find(fits).unwrap_or(tasks)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each task takes the least time, unless there is less work than that; the user's number is never exceeded.
    #[test]
    fn tasks_are_long_enough_and_no_more_than_asked_for() {
        for (cpu_s, least_s, most, wanted) in [
            (0.0, 5.0, None, 1),
            (4.0, 5.0, Some(8), 1),
            (40.0, 5.0, Some(8), 8),
            (40.0, 5.0, Some(64), 8),
            (40.0, 20.0, Some(64), 2),
            (1e4, 5.0, None, 1000),
            (1e6, 5.0, Some(5000), 5000),
            (4.0, 0.0, Some(7), 7),
            (f64::NAN, 5.0, Some(7), 1),
        ] {
            assert_eq!(tasks(cpu_s, least_s, most), wanted, "{cpu_s} s, {least_s} s a task, {most:?}");
        }
    }

    /// Of 100 points in blocks: all stale, the last ten, one, every tenth.
    #[test]
    fn few_stale_points_are_dealt_out_too() {
        let stale_of = |places: Vec<usize>| {
            move |of: u32| {
                let shards: std::collections::BTreeSet<usize> =
                    places.iter().map(|place| place * of as usize / 100).collect();
                shards.len()
            }
        };
        assert_eq!(shards(8, stale_of((0..100).collect())), 8);
        assert_eq!(shards(4, stale_of(vec![10, 30, 60, 90])), 4, "no shard is empty");
        let last_ten = stale_of((90..100).collect());
        let of = shards(8, &last_ten);
        assert!(of > 8 && (5..=8).contains(&last_ten(of)), "{of}: {}", last_ten(of));
        assert!(shards(8, stale_of(vec![50])) >= 8);
        let spread = stale_of((0..100).step_by(10).collect());
        assert!(spread(shards(4, &spread)) <= 4);
    }
}
