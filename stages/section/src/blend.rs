//! Shares of neighbouring sections: a ramp from one table to the next instead of a seam.

/// Whose tables hold at a place, and how much of the own one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Share {
    pub section: usize,
    /// The other section; the own one where it stands alone.
    pub neighbour: usize,
    /// Of the own section, in (0, 1].
    pub weight: f64,
}

/// The shares at arc length `s` for sections between these bounds (mm, increasing).
///
/// Across each bound the share passes linearly from the section before to that behind it, over the part `blend` of the half of either
/// that lies on its side. With blend = 1 that is from middle to middle: linear interpolation along the wall.
pub fn share(bounds: &[f64], blend: f64, s: f64) -> Share {
    let last = bounds.len() - 2;
    let section = bounds[1..=last].partition_point(|&b| b <= s);
    let half = |k: usize| 0.5 * blend * (bounds[k + 1] - bounds[k]);
    // The share of the section behind the bound.
    let passed = |bound: usize| {
        let (from, to) = (bounds[bound] - half(bound - 1), bounds[bound] + half(bound));
        ((s - from) / (to - from)).clamp(0.0, 1.0)
    };
    if section < last && s > bounds[section + 1] - half(section) {
        Share { section, neighbour: section + 1, weight: 1.0 - passed(section + 1) }
    } else if section > 0 && s < bounds[section] + half(section) {
        Share { section, neighbour: section - 1, weight: passed(section) }
    } else {
        Share { section, neighbour: section, weight: 1.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Shares of all sections as a function of s are continuous, add up to 1, and for blend = 1 reproduce any function that is linear
    /// between the middles of the sections; without blending there are none.
    #[test]
    fn shares_are_continuous_and_linear() {
        let bounds = [0.0, 10.0, 30.0, 90.0, 100.0];
        let middle = |k: usize| 0.5 * (bounds[k] + bounds[k + 1]);
        let value = |blend: f64, s: f64, of: &dyn Fn(usize) -> f64| {
            let own = share(&bounds, blend, s);
            assert!(own.weight > 0.0 && own.weight <= 1.0, "{s}: {own:?}");
            assert!(bounds[own.section] <= s && (s < bounds[own.section + 1] || own.section == 3));
            own.weight * of(own.section) + (1.0 - own.weight) * of(own.neighbour)
        };
        for i in 0..=2000 {
            let s = f64::from(i) * 0.05;
            let inside = s.clamp(middle(0), middle(3));
            assert!((value(1.0, s, &middle) - inside).abs() < 1e-12, "{s}");
            let step = value(0.2, s + 1e-9, &|k| k as f64) - value(0.2, s, &|k| k as f64);
            // The steepest ramp is 2 mm wide.
            assert!(step.abs() <= 1e-9, "{s}: {step}");
            assert_eq!(share(&bounds, 0.0, s).weight, 1.0);
        }
        assert_eq!(share(&[0.0, 5.0], 0.7, 3.0), Share { section: 0, neighbour: 0, weight: 1.0 });
    }
}
