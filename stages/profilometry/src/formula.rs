//! Heights over a reference plane from phase differences, as the literature writes them.

use std::f64::consts::TAU;

/// The set-up that the formula knows: both pupils at the height `l_0` over the plane, `d` apart along the fringes' direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Formula {
    /// mm.
    pub l_0: f64,
    /// Signed: projector minus camera, mm.
    pub d: f64,
    /// mm^-1 on the reference plane.
    pub f_0: f64,
}

impl Formula {
    /// h = l_0 dphi / (dphi - 2 pi f_0 d), mm towards the pupils, and d h / d dphi; `None` near the pole, where h is not known:
    /// |dphi - 2 pi f_0 d| < 0.1 |2 pi f_0 d|.
    ///
    /// Source: Takeda, Mutoh, Appl. Opt. 22, 3977 (1983).
    pub fn height(&self, dphi: f64) -> Option<(f64, f64)> {
        let pole = TAU * self.f_0 * self.d;
        let under = dphi - pole;
        if under.abs() < 0.1 * pole.abs() || pole == 0.0 {
            return None;
        }
        Some((self.l_0 * dphi / under, -self.l_0 * pole / (under * under)))
    }
}

/// Height over the plane where the camera (c, l_c high) sees at b what the projector (p, l_p high) would put at a; d h / d a.
///
/// Both rays at height h: b - h (b - c) / l_c = a - h (a - p) / l_p. With l_c = l_p = l_0 and s = a - b this is
/// h = l_0 s / (s - d).
pub fn of_shift(b: f64, a: f64, [c, l_c]: [f64; 2], [p, l_p]: [f64; 2]) -> Option<(f64, f64)> {
    let under = (b - c) / l_c - (a - p) / l_p;
    // As for the formula: the pole is where s = d.
    if under.abs() < 0.1 * ((p - c) / l_c).abs() {
        return None;
    }
    let h = (b - a) / under;
    Some((h, (-under + (b - a) / l_p) / (under * under)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A point at height h, seen at b and lit as a on the plane: the shift gives h back to rounding, for equal and unequal pupils.
    #[test]
    fn heights_come_back() {
        for (l_c, l_p) in [(500.0, 500.0), (400.0, 620.0)] {
            for h in [-30.0, -1e-6, 0.0, 5.0, 40.0] {
                for x in [-30.0, 0.0, 22.0] {
                    let ([c, p], h): ([f64; 2], f64) = ([2.0, 37.0], h);
                    let on_plane = |pupil: f64, l: f64| pupil + (x - pupil) * l / (l - h);
                    let (b, a) = (on_plane(c, l_c), on_plane(p, l_p));
                    let (got, slope) = of_shift(b, a, [c, l_c], [p, l_p]).unwrap();
                    assert!((got - h).abs() < 1e-10, "{got} for {h}");
                    let (up, _) = of_shift(b, a + 1e-4, [c, l_c], [p, l_p]).unwrap();
                    assert!(((up - got) / 1e-4 / slope - 1.0).abs() < 1e-5);
                    if l_c == l_p {
                        let formula = Formula { l_0: l_c, d: p - c, f_0: 0.1 };
                        let (same, per_rad) = formula.height(TAU * 0.1 * (a - b)).unwrap();
                        assert!((same - h).abs() < 1e-10);
                        assert!((per_rad * TAU * 0.1 / slope - 1.0).abs() < 1e-9);
                    }
                }
            }
        }
    }

    /// No height at the pole nor without a baseline.
    #[test]
    fn poles_give_no_height() {
        let formula = Formula { l_0: 500.0, d: 35.0, f_0: 0.1 };
        assert_eq!(formula.height(TAU * 3.5), None);
        assert_eq!(Formula { d: 0.0, ..formula }.height(1.0), None);
        assert_eq!(of_shift(1.0, 1.0 + 35.0, [0.0, 500.0], [35.0, 500.0]), None);
    }
}
