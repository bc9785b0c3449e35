//! A second medium that gives the same readings, where walls are so white that M_R hardly depends on mu_s' and folds back.
//!
//! M_T falls with mu_a, so each mu_s' has one mu_a with the M_T measured. Along these M_R is a function of mu_s' alone, and every medium with both
//! readings is a crossing of the M_R measured. Crossings lie between two points where M_R is on different sides of its reading; or, in pairs, about
//! an extremum between two points where it turns round.

use crate::experiment::{Experiment, Measurement};
use crate::inverse::{Fit, RESIDUAL, TABLE, table_entry};
use crate::spheres::Spheres;

/// A medium with the M_T measured.
#[derive(Clone, Copy)]
struct Point {
    /// (ln mu_a d, ln mu_s' d)
    x: [f64; 2],
    /// M_R beyond its reading, and how fast it grows with ln mu_s' at the same M_T.
    excess: f64,
    slope: f64,
}

impl<const N: usize> Experiment<N> {
    /// mu_a and mu_s', mm^-1, of a medium other than `fit` with the same readings.
    pub(crate) fn other(&self, fit: &Fit, measured: &Measurement) -> Option<[f64; 2]> {
        if self.instrument.spheres == Spheres::None || !self.may_fold(measured) {
            return None;
        }
        let d = self.inverse().plan().slab().thickness_mm;
        let own = [fit.mu_a_per_mm * d, fit.mu_s_prime_per_mm * d].map(libm::log);
        let curve = self.curve(measured);
        let from = |point: Point| {
            let other = self.full_root(point.x, measured);
            let found = [other.mu_a_per_mm, other.mu_s_prime_per_mm];
            let apart = [0, 1].map(|i| (libm::log(found[i] * d) - own[i]).abs());
            (other.residual <= RESIDUAL && apart[0].max(apart[1]) > 1e-3).then_some(found)
        };
        curve.windows(2).find_map(|ends| {
            let [low, high] = [ends[0]?, ends[1]?];
            if low.excess.signum() != high.excess.signum() {
                return from(self.crossing(low, high, measured));
            }
            let turn = self.beyond(low, high, measured)?;
            from(self.crossing(low, turn, measured)).or_else(|| from(self.crossing(turn, high, measured)))
        })
    }

    /// Whether the readings of the coarse model, as a map of the table of starts, are turned over anywhere about the M_T measured.
    fn may_fold(&self, measured: &Measurement) -> bool {
        let read: Vec<Option<[f64; 2]>> = self
            .starts
            .iter()
            .map(|state| Some(self.instrument.readings(&state.as_ref()?.seen, &measured.lost)))
            .collect();
        // Of a cell of the table: whether M_T is that measured in it, and the sign of its map.
        let cell = |a: usize, s: usize| -> Option<(bool, bool)> {
            let corner = |a: usize, s: usize| read[a * TABLE + s];
            let [here, next, beside, across] =
                [corner(a, s)?, corner(a + 1, s)?, corner(a, s + 1)?, corner(a + 1, s + 1)?];
            let below = [here, next, beside, across].map(|m| m[1] < measured.m_t);
            let by = |i: usize| [next[i] - here[i] + across[i] - beside[i], beside[i] - here[i] + across[i] - next[i]];
            let [r, t] = [by(0), by(1)];
            Some((below.contains(&true) && below.contains(&false), r[0] * t[1] > r[1] * t[0]))
        };
        let cells = TABLE - 1;
        let mut signs = [false; 2];
        for (a, s) in (0..cells * cells).map(|k| (k / cells, k % cells)) {
            if !cell(a, s).is_some_and(|(crossed, _)| crossed) {
                continue;
            }
            // The coarse model may be a cell off.
            for a in a.saturating_sub(1)..(a + 2).min(cells) {
                for s in s.saturating_sub(1)..(s + 2).min(cells) {
                    if let Some((_, sign)) = cell(a, s) {
                        signs[usize::from(sign)] = true;
                    }
                }
            }
        }
        signs == [true; 2]
    }

    /// Points with the M_T measured, by growing mu_s'; `None` where there is none, with the ends of the curve beside it.
    fn curve(&self, measured: &Measurement) -> Vec<Option<Point>> {
        let scattering = |s: usize| table_entry(0, s)[1];
        let mut points: Vec<Option<Point>> = vec![self.at(scattering(0), measured)];
        for s in 1..TABLE {
            let (before, here) = (points[points.len() - 1], self.at(scattering(s), measured));
            if before.is_some() != here.is_some() {
                points.push(self.end(scattering(s - 1), scattering(s), measured));
            }
            points.push(here);
        }
        points
    }

    /// Where, between two scatterings, even a slab that hardly absorbs begins to let less through.
    fn end(&self, low: f64, high: f64, measured: &Measurement) -> Option<Point> {
        let passes = |s: f64| self.brightest(s, measured).is_some_and(|m_t| m_t >= measured.m_t);
        let (mut inside, mut outside) = if passes(low) { (low, high) } else { (high, low) };
        for _ in 0..40 {
            let middle = 0.5 * (inside + outside);
            if passes(middle) {
                inside = middle;
            } else {
                outside = middle;
            }
        }
        self.at(inside, measured)
    }

    /// M_T at the least absorption of the table.
    fn brightest(&self, scattering: f64, measured: &Measurement) -> Option<f64> {
        let [absorption, _] = table_entry(0, 0);
        let (read, _) = self.readings_with_slopes([absorption, scattering].map(libm::exp), &measured.lost)?;
        Some(read[1])
    }

    /// The point at this ln mu_s' d: Newton's method on ln M_T between bounds, in ln mu_a d.
    fn at(&self, scattering: f64, measured: &Measurement) -> Option<Point> {
        const STEPS: usize = 60;
        self.brightest(scattering, measured).filter(|m_t| *m_t >= measured.m_t)?;
        let [mut low, mut high] = [0, TABLE - 1].map(|a| table_entry(a, 0)[0]);
        let mut x = 0.5 * (low + high);
        for _ in 0..STEPS {
            let depths = [x, scattering].map(libm::exp);
            let (read, [a, s]) = self.readings_with_slopes(depths, &measured.lost)?;
            let [a, s] = [a.map(|y| depths[0] * y), s.map(|y| depths[1] * y)];
            let miss = libm::log(read[1] / measured.m_t);
            if miss > 0.0 {
                low = x;
            } else {
                high = x;
            }
            if miss.abs() < 1e-12 || high - low < 1e-12 {
                return Some(Point {
                    x: [x, scattering],
                    excess: read[0] - measured.m_r,
                    slope: s[0] - a[0] * s[1] / a[1],
                });
            }
            let next = x - miss * read[1] / a[1];
            x = if next > low && next < high { next } else { 0.5 * (low + high) };
        }
        None
    }

    /// The crossing between two points on different sides, well enough for a start.
    fn crossing(&self, mut low: Point, mut high: Point, measured: &Measurement) -> Point {
        for _ in 0..8 {
            let Some(middle) = self.at(0.5 * (low.x[1] + high.x[1]), measured) else { break };
            if middle.excess.signum() == low.excess.signum() {
                low = middle;
            } else {
                high = middle;
            }
        }
        if low.excess.abs() < high.excess.abs() { low } else { high }
    }

    /// Between two points on one side a point on the other, if M_R turns round there and reaches it.
    fn beyond(&self, mut low: Point, mut high: Point, measured: &Measurement) -> Option<Point> {
        let side = low.excess.signum();
        // Towards the reading on the way in from either end.
        let turns = |low: &Point, high: &Point| low.slope * side < 0.0 && high.slope * side > 0.0;
        for _ in 0..30 {
            if !turns(&low, &high) {
                return None;
            }
            let middle = self.at(0.5 * (low.x[1] + high.x[1]), measured)?;
            if middle.excess.signum() != side {
                return Some(middle);
            }
            if middle.slope * side < 0.0 {
                low = middle;
            } else {
                high = middle;
            }
        }
        None
    }
}
