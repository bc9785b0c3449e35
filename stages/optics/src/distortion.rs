//! Lens distortion after Brown and Conrady.
//!
//! Source: Brown, Photogrammetric Engineering 37, 855 (1971), in the notation of most calibration tools: x to the right, y down the image,
//! both relative to the axis and in units of the distance.

/// Where the light of the ideal image place (x, y), r^2 = x^2 + y^2, goes:
///
/// `x_d = x s + 2 p1 x y + p2 (r^2 + 2 x^2)`, `y_d = y s + p1 (r^2 + 2 y^2) + 2 p2 x y`, `s = 1 + k1 r^2 + k2 r^4 + k3 r^6`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Distortion {
    k: [f64; 3],
    p: [f64; 2],
    /// No light beyond this ideal radius reaches the image: there the polynomial may fold back.
    reach: f64,
}

/// Places along a line from the axis to the edge of the image at which the map is followed.
const STEPS: u32 = 32;
/// Places on each side of the image's edge.
const EDGE: u32 = 16;
/// Room beyond the ideal radius of the sampled edge.
const MARGIN: f64 = 1.02;

impl Distortion {
    /// For an image that reaches `half` = (x, y) to both sides of the axis.
    ///
    /// `None` where the image would fold over: then a place of it would show two directions, or none.
    pub fn new([k1, k2, p1, p2, k3]: [f64; 5], half: [f64; 2]) -> Option<Self> {
        let mut lens = Self { k: [k1, k2, k3], p: [p1, p2], reach: f64::INFINITY };
        let side = (0..=2 * EDGE).map(|i| f64::from(i) / f64::from(EDGE) - 1.0);
        let edge = side.flat_map(|t| [(t, 1.0), (t, -1.0), (1.0, t), (-1.0, t)]);
        let mut reach: f64 = 0.0;
        for (x, y) in edge {
            let mut place = (0.0, 0.0);
            for i in 1..=STEPS {
                let part = f64::from(i) / f64::from(STEPS);
                place = lens.newton((part * x * half[0], part * y * half[1]), place)?;
                if lens.spread(place.0, place.1) <= 0.0 {
                    return None;
                }
            }
            reach = reach.max((place.0 * place.0 + place.1 * place.1).sqrt());
        }
        lens.reach = MARGIN * reach;
        // Not folded anywhere on the disc, so that every place of the image has one direction on it.
        let grid = (0..=STEPS).flat_map(|i| (0..4 * EDGE).map(move |j| (i, j)));
        let mut spreads = grid.map(|(i, j)| {
            let (sin, cos) = crate::elementary::sin_cos_turns(f64::from(j) / f64::from(4 * EDGE));
            let r = lens.reach * f64::from(i) / f64::from(STEPS);
            lens.spread(r * cos, r * sin)
        });
        spreads.all(|spread| spread > 0.0).then_some(lens)
    }

    /// The image place of an ideal one.
    #[inline(always)]
    pub fn apply(&self, x: f64, y: f64) -> (f64, f64) {
        let ([k1, k2, k3], [p1, p2]) = (self.k, self.p);
        let r2 = x * x + y * y;
        let s = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        (x * s + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x), y * s + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y)
    }

    /// Whether light of an ideal place can reach the image.
    #[inline(always)]
    pub fn holds(&self, x: f64, y: f64) -> bool {
        x * x + y * y <= self.reach * self.reach
    }

    /// Image area over ideal area: the determinant of the map's derivative.
    #[inline(always)]
    pub fn spread(&self, x: f64, y: f64) -> f64 {
        let [[a, b], [c, d]] = self.derivative(x, y);
        a * d - b * c
    }

    #[inline(always)]
    fn derivative(&self, x: f64, y: f64) -> [[f64; 2]; 2] {
        let ([k1, k2, k3], [p1, p2]) = (self.k, self.p);
        let r2 = x * x + y * y;
        let s = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        // d s / d (r^2), twice.
        let t = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * r2 * k3));
        let mixed = x * y * t + 2.0 * p1 * x + 2.0 * p2 * y;
        [[s + x * x * t + 2.0 * p1 * y + 6.0 * p2 * x, mixed], [mixed, s + y * y * t + 6.0 * p1 * y + 2.0 * p2 * x]]
    }

    /// The ideal place of one in the image, to rounding.
    pub fn undo(&self, x: f64, y: f64) -> (f64, f64) {
        // Far out the place itself may lie beyond the fold: then from the axis outwards.
        let near = self.newton((x, y), (x, y)).filter(|p| self.holds(p.0, p.1));
        near.unwrap_or_else(|| {
            let mut place = (0.0, 0.0);
            for i in 1..=STEPS {
                let part = f64::from(i) / f64::from(STEPS);
                let next = self.newton((part * x, part * y), place);
                place = next.unwrap_or_else(|| panic!("no direction for the image place ({x}, {y}): {self:?}"));
            }
            place
        })
    }

    /// Newton's method for the ideal place of (x, y), its steps halved until they help.
    fn newton(&self, (x, y): (f64, f64), start: (f64, f64)) -> Option<(f64, f64)> {
        let off = |p: (f64, f64)| {
            let (a, b) = self.apply(p.0, p.1);
            (x - a, y - b)
        };
        let scale = 1.0 + x.abs() + y.abs();
        let (mut place, mut rest) = (start, off(start));
        for _ in 0..50 {
            if rest.0.abs() + rest.1.abs() <= 4.0 * f64::EPSILON * scale {
                return Some(place);
            }
            let [[a, b], [c, d]] = self.derivative(place.0, place.1);
            let determinant = a * d - b * c;
            let (dx, dy) = ((d * rest.0 - b * rest.1) / determinant, (a * rest.1 - c * rest.0) / determinant);
            let mut step = 1.0;
            loop {
                let next = (place.0 + step * dx, place.1 + step * dy);
                let left = off(next);
                if left.0.abs() + left.1.abs() < rest.0.abs() + rest.1.abs() {
                    (place, rest) = (next, left);
                    break;
                }
                step *= 0.5;
                // Rounding has the last word, or there is no way on (NaN, too).
                if step < 1e-6 {
                    let settled = rest.0.abs() + rest.1.abs() <= 1e-13 * scale;
                    return settled.then_some(place);
                }
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LENSES: [[f64; 5]; 5] = [
        [0.0; 5],
        [-0.28, 0.09, 1e-3, -7e-4, -0.01],
        [0.2, 0.05, -2e-3, 3e-3, 0.0],
        // A wide-angle lens, near its fold.
        [-0.3, 0.0, 0.0, 0.0, 0.0],
        [-0.05, 0.8, 0.0, 0.01, -0.9],
    ];

    fn places() -> impl Iterator<Item = (f64, f64)> {
        (0..=20).flat_map(|i| (0..=20).map(move |j| (0.05 * f64::from(i) - 0.5, 0.04 * f64::from(j) - 0.4)))
    }

    /// Applying undoes undoing; 1e-14 is rounding, where the task of a camera of 1e4 pixels would be content with 1e-13.
    #[test]
    fn undo_undoes() {
        for lens in LENSES {
            let lens = Distortion::new(lens, [0.5, 0.4]).unwrap();
            for (x, y) in places() {
                let (u, v) = lens.undo(x, y);
                let (a, b) = lens.apply(u, v);
                assert!((a - x).abs() + (b - y).abs() < 1e-14 && lens.holds(u, v), "{lens:?}: ({x}, {y}) {a} {b}");
            }
        }
    }

    /// Against central differences, whose error at a step of 1e-5 is about 1e-10.
    #[test]
    fn spread_is_the_determinant_of_the_derivative() {
        for lens in LENSES {
            let lens = Distortion::new(lens, [0.5, 0.4]).unwrap();
            for (x, y) in places() {
                let h = 1e-5;
                let (right, left, up, down) =
                    (lens.apply(x + h, y), lens.apply(x - h, y), lens.apply(x, y + h), lens.apply(x, y - h));
                let (a, c) = ((right.0 - left.0) / (2.0 * h), (right.1 - left.1) / (2.0 * h));
                let (b, d) = ((up.0 - down.0) / (2.0 * h), (up.1 - down.1) / (2.0 * h));
                assert!((a * d - b * c - lens.spread(x, y)).abs() < 1e-9, "{lens:?} at ({x}, {y})");
            }
        }
    }

    /// r (1 - r^2 / 3) has its fold at r = 1, where the image's radius is 2/3.
    #[test]
    fn folds_are_refused() {
        let barrel = [-1.0 / 3.0, 0.0, 0.0, 0.0, 0.0];
        let half = |r: f64| [0.8 * r, 0.6 * r];
        assert!(Distortion::new(barrel, half(0.66)).is_some());
        assert!(Distortion::new(barrel, half(0.67)).is_none());
        assert!(Distortion::new([f64::NAN, 0.0, 0.0, 0.0, 0.0], half(0.1)).is_none());
        let lens = Distortion::new(barrel, half(0.6)).unwrap();
        // Beyond the fold the polynomial comes back to 0 at r = sqrt 3.
        assert!(lens.apply(1.7, 0.0).0 < 0.1 && !lens.holds(1.7, 0.0));
    }
}
