//! A smooth curve through points.

use glam::DVec3;

/// A centripetal Catmull-Rom spline, piece by piece: between neighbours a cubic, with one tangent where two meet.
///
/// Knots lie the square root of the chord apart, so that no piece has a cusp or meets itself. At both ends it runs along the chord.
/// Source: Yuksel, Schaefer and Keyser, "Parameterization and applications of Catmull-Rom curves", Comput. Aided Des. 43, 747 (2011).
pub struct Spline {
    pieces: Vec<Piece>,
}

/// A cubic c0 + c1 s + c2 s^2 + c3 s^3, s in [0, 1].
struct Piece([DVec3; 4]);

impl Spline {
    /// Through two points or more, of which no neighbours are the same.
    pub fn through(points: &[DVec3]) -> Self {
        let knot = |from: DVec3, to: DVec3| libm::sqrt((to - from).length());
        // As if the points went on straight.
        let point = |i: usize| match i {
            0 => 2.0 * points[0] - points[1],
            i if i <= points.len() => points[i - 1],
            _ => 2.0 * points[points.len() - 1] - points[points.len() - 2],
        };
        let slope = |i: usize| {
            let (a, b, c) = (point(i - 1), point(i), point(i + 1));
            let (before, behind) = (knot(a, b), knot(b, c));
            (b - a) / before - (c - a) / (before + behind) + (c - b) / behind
        };
        let piece = |i: usize| {
            let (from, to) = (point(i), point(i + 1));
            let width = knot(from, to);
            let (u, v, step) = (width * slope(i), width * slope(i + 1), to - from);
            Piece([from, u, 3.0 * step - 2.0 * u - v, u + v - 2.0 * step])
        };
        Self { pieces: (1..points.len()).map(piece).collect() }
    }

    pub fn pieces(&self) -> usize {
        self.pieces.len()
    }

    /// The place, the velocity and the acceleration at s in [0, 1] of a piece.
    pub fn at(&self, piece: usize, s: f64) -> [DVec3; 3] {
        let [a, b, c, d] = self.pieces[piece].0;
        [a + s * (b + s * (c + s * d)), b + s * (2.0 * c + 3.0 * s * d), 2.0 * c + 6.0 * s * d]
    }

    /// Unit vector; only where the velocity is not 0.
    pub fn tangent(&self, piece: usize, s: f64) -> DVec3 {
        self.at(piece, s)[1].normalize_or_zero()
    }

    /// Radius of curvature; infinite where it is straight, 0 where it turns on the spot.
    pub fn radius(&self, piece: usize, s: f64) -> f64 {
        let [_, v, a] = self.at(piece, s);
        let (speed, bend) = (v.length(), v.cross(a).length());
        // A millionth of the piece's mean speed is a turn on the spot but for rounding.
        let mean = (self.at(piece, 1.0)[0] - self.at(piece, 0.0)[0]).length();
        if speed <= 1e-6 * mean {
            return 0.0;
        }
        if bend == 0.0 { f64::INFINITY } else { speed * speed * speed / bend }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BENT: [DVec3; 5] = [
        DVec3::new(-20.0, 0.0, -2.0),
        DVec3::new(0.0, 4.0, -3.0),
        DVec3::new(3.0, 5.0, -3.0),
        DVec3::new(9.0, -5.0, 1.0),
        DVec3::new(20.0, 0.0, -2.0),
    ];

    /// It goes through its points with one tangent on both sides, and what it says of itself are its differences.
    #[test]
    fn it_is_smooth_and_goes_through_its_points() {
        let spline = Spline::through(&BENT);
        for (i, ends) in BENT.windows(2).enumerate() {
            assert!(
                (spline.at(i, 0.0)[0] - ends[0]).length() < 1e-13 && (spline.at(i, 1.0)[0] - ends[1]).length() < 1e-13
            );
            for s in [0.1, 0.5, 0.9] {
                let (before, [_, v, a], behind) = (spline.at(i, s - 1e-4), spline.at(i, s), spline.at(i, s + 1e-4));
                assert!(((behind[0] - before[0]) / 2e-4 - v).length() < 1e-5);
                assert!(((behind[1] - before[1]) / 2e-4 - a).length() < 1e-5);
            }
        }
        for i in 1..spline.pieces() {
            assert!((spline.tangent(i - 1, 1.0) - spline.tangent(i, 0.0)).length() < 1e-13, "knot {i}");
        }
        let straight = Spline::through(&[DVec3::ZERO, DVec3::X, 3.0 * DVec3::X]);
        assert!((0..=10).all(|i| straight.at(1, f64::from(i) / 10.0)[0].cross(DVec3::X) == DVec3::ZERO));
        assert_eq!(straight.radius(0, 0.3), f64::INFINITY);
        // There and back again.
        assert_eq!(Spline::through(&[DVec3::ZERO, DVec3::X, DVec3::ZERO]).radius(0, 1.0), 0.0);
    }

    /// Through many points of a circle it is the circle, whose radius it has.
    #[test]
    fn points_of_a_circle_give_its_radius() {
        let points: Vec<DVec3> =
            (0..40).map(|i| f64::from(i) * 0.1).map(|t| 7.0 * DVec3::new(t.cos(), t.sin(), 0.0)).collect();
        let spline = Spline::through(&points);
        for piece in 5..30 {
            for s in [0.0, 0.3, 0.7] {
                assert!((spline.at(piece, s)[0].length() / 7.0 - 1.0).abs() < 1e-5);
                assert!((spline.radius(piece, s) / 7.0 - 1.0).abs() < 0.01, "{}", spline.radius(piece, s));
            }
        }
    }
}
