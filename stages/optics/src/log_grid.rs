//! A positive function of two positive variables, interpolated bicubically in log-log.

use crate::Error;

/// ln f over (ln x, ln y) as a C2 bicubic spline ("not-a-knot" ends) through a rectangular grid of nodes.
///
/// Reflectance over (mu_a, mu_s') is close to a polynomial in these variables: a few dozen nodes interpolate it
/// to better than 1e-3 where linear interpolation of raw values needs thousands.
#[derive(Clone, Debug, PartialEq)]
pub struct LogGrid {
    /// ln of the nodes, increasing.
    u: Vec<f64>,
    v: Vec<f64>,
    /// At node (i, j), index i * v.len() + j: ln f and its derivatives by u, v, and u and v.
    jets: Vec<[f64; 4]>,
}

/// The value of a [`LogGrid`] at one point: w = ln f with its derivatives by u = ln x and v = ln y.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LogJet {
    pub w: f64,
    pub w_u: f64,
    pub w_v: f64,
}

impl LogGrid {
    /// Nodes increasing and positive, at least two per axis; `values` positive, y running fastest.
    ///
    /// Errors: a node or a value that breaks these rules.
    pub fn new(x_nodes: &[f64], y_nodes: &[f64], values: &[f64]) -> Result<Self, Error> {
        assert_eq!(values.len(), x_nodes.len() * y_nodes.len(), "one value per node");
        let (u, v) = (log_nodes(x_nodes)?, log_nodes(y_nodes)?);
        for &value in values {
            Error::unless(value > 0.0 && value.is_finite(), "value", value, "", "be finite and > 0")?;
        }
        let (n_u, n_v) = (u.len(), v.len());
        let mut jets: Vec<[f64; 4]> = values.iter().map(|&f| [libm::log(f), 0.0, 0.0, 0.0]).collect();
        let column = |jets: &[[f64; 4]], j: usize, k: usize| (0..n_u).map(|i| jets[i * n_v + j][k]).collect::<Vec<_>>();
        for j in 0..n_v {
            for (i, slope) in spline_slopes(&u, &column(&jets, j, 0)).into_iter().enumerate() {
                jets[i * n_v + j][1] = slope;
            }
        }
        for row in jets.chunks_mut(n_v) {
            for k in [0, 1] {
                let values: Vec<f64> = row.iter().map(|jet| jet[k]).collect();
                for (jet, slope) in row.iter_mut().zip(spline_slopes(&v, &values)) {
                    jet[k + 2] = slope;
                }
            }
        }
        Ok(Self { u, v, jets })
    }

    /// f(x, y); `None` outside the nodes (or at NaN).
    pub fn value(&self, x: f64, y: f64) -> Option<f64> {
        self.log_jet(libm::log(x), libm::log(y)).map(|jet| libm::exp(jet.w))
    }

    /// ln f and its gradient at (u, v) = (ln x, ln y); `None` outside the nodes (or at NaN).
    pub fn log_jet(&self, u: f64, v: f64) -> Option<LogJet> {
        let (i, j) = (cell(&self.u, u)?, cell(&self.v, v)?);
        let (h_u, h_v) = (self.u[i + 1] - self.u[i], self.v[j + 1] - self.v[j]);
        let (a, da) = hermite((u - self.u[i]) / h_u, h_u);
        let (b, db) = hermite((v - self.v[j]) / h_v, h_v);
        let mut jet = LogJet { w: 0.0, w_u: 0.0, w_v: 0.0 };
        for (p, corner_u) in [0, 1].into_iter().enumerate() {
            for (q, corner_v) in [0, 1].into_iter().enumerate() {
                let [w, w_u, w_v, w_uv] = self.jets[(i + corner_u) * self.v.len() + j + corner_v];
                let along = |a: [f64; 4], b: [f64; 4]| {
                    a[p] * (b[q] * w + b[q + 2] * w_v) + a[p + 2] * (b[q] * w_u + b[q + 2] * w_uv)
                };
                jet.w += along(a, b);
                jet.w_u += along(da, b);
                jet.w_v += along(a, db);
            }
        }
        Some(jet)
    }

    /// Second derivatives of ln f by (u, u), (u, v) and (v, v) at (u, v) = (ln x, ln y); `None` as in [`Self::log_jet`].
    pub fn log_curvature(&self, u: f64, v: f64) -> Option<[f64; 3]> {
        let (i, j) = (cell(&self.u, u)?, cell(&self.v, v)?);
        let (h_u, h_v) = (self.u[i + 1] - self.u[i], self.v[j + 1] - self.v[j]);
        let along = |t: f64, h: f64| {
            let (a, da) = hermite(t, h);
            [a, da, hermite_curvature(t, h)]
        };
        let (a, b) = (along((u - self.u[i]) / h_u, h_u), along((v - self.v[j]) / h_v, h_v));
        let mut curvature = [0.0; 3];
        for (p, corner_u) in [0, 1].into_iter().enumerate() {
            for (q, corner_v) in [0, 1].into_iter().enumerate() {
                let [w, w_u, w_v, w_uv] = self.jets[(i + corner_u) * self.v.len() + j + corner_v];
                for (sum, (a, b)) in curvature.iter_mut().zip([(a[2], b[0]), (a[1], b[1]), (a[0], b[2])]) {
                    *sum += a[p] * (b[q] * w + b[q + 2] * w_v) + a[p + 2] * (b[q] * w_u + b[q + 2] * w_uv);
                }
            }
        }
        Some(curvature)
    }

    /// ln of the nodes along x.
    pub fn u(&self) -> &[f64] {
        &self.u
    }

    /// ln of the nodes along y.
    pub fn v(&self) -> &[f64] {
        &self.v
    }
}

/// Cubic Hermite weights [value left, value right, slope left, slope right] at t in [0, 1] of a cell of width h,
/// and their derivatives by the coordinate.
fn hermite(t: f64, h: f64) -> ([f64; 4], [f64; 4]) {
    let s = 1.0 - t;
    (
        [s * s * (1.0 + 2.0 * t), t * t * (3.0 - 2.0 * t), h * t * s * s, -h * t * t * s],
        [-6.0 * t * s / h, 6.0 * t * s / h, s * (1.0 - 3.0 * t), t * (3.0 * t - 2.0)],
    )
}

/// Second derivatives by the coordinate of the weights of [`hermite`].
fn hermite_curvature(t: f64, h: f64) -> [f64; 4] {
    let bend = (12.0 * t - 6.0) / (h * h);
    [bend, -bend, (6.0 * t - 4.0) / h, (6.0 * t - 2.0) / h]
}

fn cell(nodes: &[f64], at: f64) -> Option<usize> {
    let last = nodes.len() - 1;
    if !(nodes[0] <= at && at <= nodes[last]) {
        return None;
    }
    Some(nodes.partition_point(|&node| node <= at).clamp(1, last) - 1)
}

fn log_nodes(nodes: &[f64]) -> Result<Vec<f64>, Error> {
    let count = nodes.len() as f64;
    Error::unless(nodes.len() >= 2, "number of nodes", count, "", "be at least 2")?;
    for (i, &node) in nodes.iter().enumerate() {
        Error::unless(node > 0.0 && node.is_finite(), "node", node, "", "be finite and > 0")?;
        Error::unless(i == 0 || nodes[i - 1] < node, "node", node, "", "be larger than the node before it")?;
    }
    Ok(nodes.iter().map(|&node| libm::log(node)).collect())
}

/// Slopes at the nodes of the cubic spline through (x, y) with "not-a-knot" ends; a parabola through three nodes, a
/// line through two.
fn spline_slopes(x: &[f64], y: &[f64]) -> Vec<f64> {
    let n = x.len();
    let h = |i: usize| x[i + 1] - x[i];
    let d = |i: usize| (y[i + 1] - y[i]) / h(i);
    if n == 2 {
        return vec![d(0); 2];
    }
    if n == 3 {
        let bend = (d(1) - d(0)) / (x[2] - x[0]);
        return vec![d(0) - bend * h(0), d(0) + bend * h(0), d(1) + bend * h(1)];
    }
    // Tridiagonal system for the slopes s: continuity of the second derivative inside, of the third at the ends.
    let (mut diagonal, mut upper, mut right) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    let end = |h0: f64, h1: f64, d0: f64, d1: f64| ((h0 + 2.0 * (h0 + h1)) * h1 * d0 + h0 * h0 * d1) / (h0 + h1);
    diagonal[0] = h(1);
    upper[0] = h(0) + h(1);
    right[0] = end(h(0), h(1), d(0), d(1));
    for i in 1..n {
        let (lower, own, next, value) = if i + 1 < n {
            (h(i), 2.0 * (h(i - 1) + h(i)), h(i - 1), 3.0 * (h(i) * d(i - 1) + h(i - 1) * d(i)))
        } else {
            (h(n - 2) + h(n - 3), h(n - 3), 0.0, end(h(n - 2), h(n - 3), d(n - 2), d(n - 3)))
        };
        let factor = lower / diagonal[i - 1];
        diagonal[i] = own - factor * upper[i - 1];
        upper[i] = next;
        right[i] = value - factor * right[i - 1];
    }
    let mut slopes = vec![0.0; n];
    slopes[n - 1] = right[n - 1] / diagonal[n - 1];
    for i in (0..n - 1).rev() {
        slopes[i] = (right[i] - upper[i] * slopes[i + 1]) / diagonal[i];
    }
    slopes
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(n_u: usize, n_v: usize, f: impl Fn(f64, f64) -> f64) -> (Vec<f64>, Vec<f64>, LogGrid) {
        // Uneven spacing, so that a slip in a width shows.
        let nodes =
            |n: usize| (0..n).map(|i| libm::exp(0.7 * i as f64 + 0.03 * (i * i) as f64 - 2.0)).collect::<Vec<_>>();
        let (x, y) = (nodes(n_u), nodes(n_v));
        let values: Vec<f64> = x.iter().flat_map(|&x| y.iter().map(move |&y| (x, y))).map(|(x, y)| f(x, y)).collect();
        let grid = LogGrid::new(&x, &y, &values).unwrap();
        (x, y, grid)
    }

    /// Bicubics in log-log come back exactly, value, gradient and curvature, to rounding (1e-11 for values of some 100).
    #[test]
    fn bicubics_are_reproduced() {
        let w = |u: f64, v: f64| 0.3 + u - 0.2 * u * u * v + 0.05 * u * u * u * v * v * v - v * v;
        let w_u = |u: f64, v: f64| 1.0 - 0.4 * u * v + 0.15 * u * u * v * v * v;
        let w_v = |u: f64, v: f64| -0.2 * u * u + 0.15 * u * u * u * v * v - 2.0 * v;
        let (_, _, grid) = grid(5, 6, |x, y| libm::exp(w(libm::log(x), libm::log(y))));
        for (u, v) in [(-2.0, -2.0), (-1.3, 0.4), (0.9, 1.7), (0.0, -1.9)] {
            let jet = grid.log_jet(u, v).unwrap();
            assert!((jet.w - w(u, v)).abs() < 1e-11, "{jet:?} {}", w(u, v));
            assert!((jet.w_u - w_u(u, v)).abs() < 1e-11, "{jet:?} {}", w_u(u, v));
            assert!((jet.w_v - w_v(u, v)).abs() < 1e-11, "{jet:?} {}", w_v(u, v));
            let want = [-0.4 * v + 0.3 * u * v * v * v, -0.4 * u + 0.45 * u * u * v * v, 0.3 * u * u * u * v - 2.0];
            let curvature = grid.log_curvature(u, v).unwrap();
            assert!(curvature.iter().zip(want).all(|(c, w)| (c - w).abs() < 1e-10), "{curvature:?} for {want:?}");
        }
    }

    /// Power laws are straight lines in log-log: exact however few the nodes.
    #[test]
    fn power_laws_are_exact_on_two_and_three_nodes() {
        for (n_u, n_v) in [(2, 2), (3, 2), (2, 4), (3, 3)] {
            let (_, _, grid) = grid(n_u, n_v, |x, y| 2.0 * x * x / y);
            let (x, y) = (0.2, 0.21);
            let value = grid.value(x, y).unwrap();
            assert!((value / (2.0 * x * x / y) - 1.0).abs() < 1e-13, "{n_u} x {n_v} nodes: {value}");
        }
    }

    /// The nodes belong to the grid, corners included; outside and at NaN there is no value.
    #[test]
    fn the_hull_is_closed() {
        let (x, y, grid) = grid(4, 5, |x, y| x + y);
        for &x in &x {
            for &y in &y {
                assert!((grid.log_jet(libm::log(x), libm::log(y)).unwrap().w - libm::log(x + y)).abs() < 1e-14);
            }
        }
        assert!(grid.value(x[0] * 0.999, y[0]).is_none());
        assert!(grid.value(x[0], y[4] * 1.001).is_none());
        assert!(grid.value(f64::NAN, y[0]).is_none());
    }

    #[test]
    fn bad_nodes_are_named() {
        assert!(LogGrid::new(&[1.0], &[1.0, 2.0], &[1.0, 1.0]).is_err());
        assert!(LogGrid::new(&[2.0, 1.0], &[1.0, 2.0], &[1.0; 4]).is_err());
        assert!(LogGrid::new(&[0.0, 1.0], &[1.0, 2.0], &[1.0; 4]).is_err());
        let error = LogGrid::new(&[1.0, 2.0], &[1.0, 2.0], &[1.0, 1.0, f64::NAN, 1.0]).unwrap_err();
        assert_eq!(error.to_string(), "value = NaN must be finite and > 0");
    }
}
