//! A smooth surface through the values at scattered points: tensor products of Chebyshev polynomials.

/// The highest degree of one variable: phantoms are few, and a higher one swings between them.
const HIGHEST: usize = 4;
/// The most that an error of the values may grow by (Lebesgue's constant over the places where the surface is read).
const LARGEST_GAIN: f64 = 10.0;
/// Columns that keep less of their length beside the others are no information but rounding.
const DEPENDENT: f64 = 1e-9;

/// How a surface reads its values at one place: the weight of each point.
pub type Weights = Vec<f64>;

/// Least-squares polynomial of degrees (`degrees`) in two variables; passes through the points where they are as many as coefficients.
#[derive(Clone, Debug)]
pub struct Surface {
    centre: [f64; 2],
    half_width: [f64; 2],
    pub degrees: [usize; 2],
    /// Points x coefficients, orthonormal columns.
    q: Vec<Vec<f64>>,
    /// Upper triangle, r[column][row].
    r: Vec<Vec<f64>>,
    /// Largest sum of |weights| where it is to be read.
    pub gain: f64,
}

impl Surface {
    /// The surface of most coefficients that `points` determine with a gain of at most 10 at all `places`.
    ///
    /// `None` where not even a bilinear one is: too few points, or points on a line.
    pub fn through(points: &[[f64; 2]], places: &[[f64; 2]]) -> Option<Self> {
        let mut degrees: Vec<[usize; 2]> = (1..=HIGHEST).flat_map(|a| (1..=HIGHEST).map(move |b| [a, b])).collect();
        degrees.retain(|d| (d[0] + 1) * (d[1] + 1) <= points.len());
        // Most coefficients first; of equally many the most even.
        degrees.sort_by_key(|&[a, b]| (usize::MAX - (a + 1) * (b + 1), a.abs_diff(b), a));
        degrees.into_iter().find_map(|degrees| Self::of_degrees(points, places, degrees))
    }

    fn of_degrees(points: &[[f64; 2]], places: &[[f64; 2]], degrees: [usize; 2]) -> Option<Self> {
        let ends = |k: usize| {
            let all = points.iter().map(|p| p[k]);
            all.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], x| [low.min(x), high.max(x)])
        };
        let [u, v] = [ends(0), ends(1)];
        let mut surface = Self {
            centre: [0.5 * (u[0] + u[1]), 0.5 * (v[0] + v[1])],
            half_width: [0.5 * (u[1] - u[0]), 0.5 * (v[1] - v[0])],
            degrees,
            q: Vec::new(),
            r: Vec::new(),
            gain: 0.0,
        };
        if surface.half_width.iter().any(|&w| w <= 0.0) {
            return None;
        }
        let rows: Vec<Vec<f64>> = points.iter().map(|&p| surface.basis(p)).collect();
        for k in 0..rows[0].len() {
            let mut column: Vec<f64> = rows.iter().map(|row| row[k]).collect();
            let length = norm(&column);
            let mut r = vec![0.0; k + 1];
            // Twice: Gram-Schmidt alone loses digits where columns are nearly parallel.
            for _ in 0..2 {
                for (j, q) in surface.q.iter().enumerate() {
                    let along = dot(q, &column);
                    r[j] += along;
                    column.iter_mut().zip(q).for_each(|(c, q)| *c -= along * q);
                }
            }
            r[k] = norm(&column);
            if r[k] <= DEPENDENT * length {
                return None;
            }
            column.iter_mut().for_each(|c| *c /= r[k]);
            surface.q.push(column);
            surface.r.push(r);
        }
        let gain = |&p: &[f64; 2]| surface.weights(p).iter().map(|w| w.abs()).sum::<f64>();
        surface.gain = places.iter().map(gain).fold(0.0, f64::max);
        (surface.gain <= LARGEST_GAIN).then_some(surface)
    }

    /// Products of Chebyshev polynomials of the scaled place, the second variable running fastest.
    fn basis(&self, place: [f64; 2]) -> Vec<f64> {
        let chebyshev = |k: usize| {
            let x = (place[k] - self.centre[k]) / self.half_width[k];
            let mut t = vec![1.0, x];
            for i in 2..=self.degrees[k] {
                t.push(2.0 * x * t[i - 1] - t[i - 2]);
            }
            t
        };
        let [a, b] = [chebyshev(0), chebyshev(1)];
        a.iter().flat_map(|a| b.iter().map(move |b| a * b)).collect()
    }

    /// The weight of each point's value at `place`; they sum to 1.
    pub fn weights(&self, place: [f64; 2]) -> Weights {
        // R^T y = basis, weights = Q y.
        let mut y = self.basis(place);
        for k in 0..y.len() {
            let known: f64 = (0..k).map(|j| self.r[k][j] * y[j]).sum();
            y[k] = (y[k] - known) / self.r[k][k];
        }
        (0..self.q[0].len()).map(|i| self.q.iter().zip(&y).map(|(q, y)| q[i] * y).sum()).collect()
    }

    /// The surface through `values` at `place`.
    pub fn value(&self, values: &[f64], place: [f64; 2]) -> f64 {
        dot(&self.weights(place), values)
    }

    /// Its slopes by both variables, from central differences over 1e-4 of the width (exact to 1e-8 for a polynomial of degree 4).
    pub fn slopes(&self, values: &[f64], place: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|k| {
            let step = 1e-4 * self.half_width[k];
            let at = |sign: f64| {
                let mut moved = place;
                moved[k] += sign * step;
                self.value(values, moved)
            };
            (at(1.0) - at(-1.0)) / (2.0 * step)
        })
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn norm(a: &[f64]) -> f64 {
    dot(a, a).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(u: &[f64], v: &[f64]) -> Vec<[f64; 2]> {
        u.iter().flat_map(|&u| v.iter().map(move |&v| [u, v])).collect()
    }

    /// Nine points carry a biquadratic, also skewed ones: any biquadratic comes back exactly, with its slopes.
    #[test]
    fn polynomials_come_back() {
        let f = |[u, v]: [f64; 2]| 1.0 - 2.0 * u + 0.3 * v * v + u * u * v - 0.1 * u * u * v * v;
        let slopes = |[u, v]: [f64; 2]| [-2.0 + 2.0 * u * v - 0.2 * u * v * v, 0.6 * v + u * u - 0.2 * u * u * v];
        let mut points = grid(&[-6.9, -3.0, -2.3], &[0.0, 0.9, 1.4]);
        points.iter_mut().enumerate().for_each(|(i, p)| p[0] += 0.05 * (i * i % 5) as f64);
        let places = grid(&[-6.0, -4.0, -2.5], &[0.1, 0.7, 1.2]);
        let surface = Surface::through(&points, &places).unwrap();
        assert_eq!(surface.degrees, [2, 2]);
        let values: Vec<f64> = points.iter().map(|&p| f(p)).collect();
        for &place in places.iter().chain(&points) {
            assert!((surface.value(&values, place) - f(place)).abs() < 1e-10);
            let (found, true_slopes) = (surface.slopes(&values, place), slopes(place));
            assert!((0..2).all(|k| (found[k] - true_slopes[k]).abs() < 1e-5), "{found:?} {true_slopes:?}");
            assert!((surface.weights(place).iter().sum::<f64>() - 1.0).abs() < 1e-12);
        }
    }

    /// Two rows of five points carry degree 1 across and 4 along; points on a line carry nothing.
    #[test]
    fn degrees_follow_the_points() {
        let points = grid(&[0.0, 1.0], &[0.0, 1.0, 2.0, 3.0, 4.0]);
        assert_eq!(Surface::through(&points, &points).unwrap().degrees, [1, 4]);
        let line: Vec<[f64; 2]> = (0..9).map(|i| [f64::from(i), 2.0 * f64::from(i)]).collect();
        assert!(Surface::through(&line, &line).is_none());
        assert!(Surface::through(&points[..3], &points[..3]).is_none());
        assert!(Surface::through(&points[..5], &points[..5]).is_none());
    }
}
