//! Where sections end: places between rings of a profile.

use crate::profile::{Profile, Ring};

/// Bounds of sections: first ring of each, and the number of rings.
pub type Bounds = Vec<usize>;

/// A new section wherever the falling profile has come down by more than `step` since the last began.
pub fn by_step(falling: &[f64], step: f64) -> Bounds {
    let (mut bounds, mut start) = (vec![0], falling[0]);
    for (k, &value) in falling.iter().enumerate() {
        if start - value > step {
            bounds.push(k);
            start = value;
        }
    }
    bounds.push(falling.len());
    bounds
}

/// `count` sections in which the falling profile comes down by equal parts; several bounds at one place where it jumps.
pub fn by_parts(falling: &[f64], count: usize) -> Bounds {
    let (first, last) = (falling[0], falling[falling.len() - 1]);
    let bound = |k: usize| {
        let level = first + (last - first) * k as f64 / count as f64;
        falling.partition_point(|&value| value > level)
    };
    let inner = (1..count).map(bound);
    [0].into_iter().chain(inner).chain([falling.len()]).collect()
}

/// `count` sections of equal length.
pub fn by_length(rings: usize, count: usize) -> Bounds {
    (0..=count).map(|k| k * rings / count).collect()
}

/// The `count` sections within which ln M_DC and ln M_AC vary least: the least sum over all pixels of the squares of their distance
/// from the section's mean, of all ways to cut (dynamic programming). Each section has at least `least_pixels`.
///
/// `None` where there is no such cut.
pub fn optimal(profile: &Profile, count: usize, least_pixels: f64) -> Option<Bounds> {
    let n = profile.rings.len();
    let mut sums = vec![Ring::default()];
    for ring in &profile.rings {
        let mut sum = *sums.last().expect("not empty");
        sum.pixels += ring.pixels;
        for k in 0..2 {
            sum.logs[k] += ring.logs[k];
            sum.squares[k] += ring.squares[k];
        }
        sums.push(sum);
    }
    let cost = |from: usize, to: usize| {
        let (a, b) = (&sums[from], &sums[to]);
        let pixels = b.pixels - a.pixels;
        if pixels < least_pixels.max(1.0) {
            return f64::INFINITY;
        }
        let spread = |k: usize| {
            let sum = b.logs[k] - a.logs[k];
            // Rounding must not make it negative.
            (b.squares[k] - a.squares[k] - sum * sum / pixels).max(0.0)
        };
        spread(0) + spread(1)
    };
    // Least cost of the rings before `to` in so many sections, and where the last of them begins.
    let mut least: Vec<f64> = (0..=n).map(|to| cost(0, to)).collect();
    let mut starts: Vec<Vec<usize>> = Vec::new();
    for _ in 1..count {
        let mut next = vec![f64::INFINITY; n + 1];
        let mut start = vec![0; n + 1];
        for to in 0..=n {
            for (from, before) in least[..to].iter().enumerate() {
                let total = before + cost(from, to);
                if total < next[to] {
                    (next[to], start[to]) = (total, from);
                }
            }
        }
        least = next;
        starts.push(start);
    }
    if !least[n].is_finite() {
        return None;
    }
    let mut bounds = vec![n];
    for start in starts.iter().rev() {
        bounds.push(start[*bounds.last().expect("not empty")]);
    }
    bounds.push(0);
    bounds.reverse();
    Some(bounds)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_and_parts_follow_the_profile() {
        let falling: Vec<f64> = (0..100).map(|k| 100.0 - f64::from(k)).collect();
        // More than 24 below the start: the 25th ring.
        assert_eq!(by_step(&falling, 24.0), [0, 25, 50, 75, 100]);
        assert_eq!(by_step(&falling, 1e9), [0, 100]);
        // 99 levels in three.
        assert_eq!(by_parts(&falling, 3), [0, 33, 66, 100]);
        assert_eq!(by_length(256, 5), [0, 51, 102, 153, 204, 256]);
        // Where it jumps over a level a section stays without rings.
        assert_eq!(by_parts(&[9.0, 9.0, 0.0, 0.0], 3), [0, 2, 2, 4]);
    }

    /// Against all ways to cut twelve rings of uneven weight, one of them empty.
    #[test]
    fn no_other_cut_is_better() {
        let values = [0.9, 0.85, 0.8, 0.5, 0.45, 0.0, 0.4, 0.1, 0.11, 0.09, 0.3, 0.02];
        let rings: Vec<Ring> = values
            .iter()
            .enumerate()
            .map(|(i, &v)| {
                let pixels = if v == 0.0 { 0.0 } else { 3.0 + (7 * i % 5) as f64 };
                let logs = [v * 2.0, 1.0 - v * v];
                // Two kinds of pixels beside each other.
                let squares = logs.map(|l| pixels * (l * l + 0.01));
                Ring { pixels, m_dc: 0.0, logs: logs.map(|l| pixels * l), squares }
            })
            .collect();
        let profile = Profile { rings, ring_mm: 1.0 };
        let cost = |from: usize, to: usize| {
            let part = &profile.rings[from..to];
            let n: f64 = part.iter().map(|r| r.pixels).sum();
            let spread = |k: usize| {
                let mean = part.iter().map(|r| r.logs[k]).sum::<f64>() / n;
                part.iter().map(|r| r.squares[k] - 2.0 * mean * r.logs[k] + r.pixels * mean * mean).sum::<f64>()
            };
            if n < 6.0 { f64::INFINITY } else { spread(0) + spread(1) }
        };
        let mut best = (f64::INFINITY, Vec::new());
        for a in 1..12 {
            for b in a + 1..12 {
                for c in b + 1..12 {
                    let total = cost(0, a) + cost(a, b) + cost(b, c) + cost(c, 12);
                    if total < best.0 {
                        best = (total, vec![0, a, b, c, 12]);
                    }
                }
            }
        }
        let found = optimal(&profile, 4, 6.0).unwrap();
        let total: f64 = found.windows(2).map(|w| cost(w[0], w[1])).sum();
        // An empty ring may lie on either side of a bound.
        assert!((total - best.0).abs() < 1e-12, "{found:?} {total}, {best:?}");
        assert_eq!(optimal(&profile, 4, 30.0), None, "59 pixels are no four times 30");
    }
}
