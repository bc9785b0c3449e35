//! A line and the triangles that it crosses, decided in exact geometry.

use glam::DVec3;

/// A line, with what is needed to project points across it (Woop, Benthin and Wald 2013).
pub struct Line {
    pub origin: DVec3,
    /// x, y, z of the projection: z is the axis along which the line runs most, and the three are right-handed.
    axes: [usize; 3],
    shear: DVec3,
    /// One over the direction, never infinite.
    inverse: DVec3,
    /// What rounding may move a projected point by.
    pub slack: f64,
}

impl Line {
    pub fn new(origin: DVec3, direction: DVec3, size: f64) -> Self {
        let along = direction.abs();
        let z = if along.x >= along.y && along.x >= along.z {
            0
        } else if along.y >= along.z {
            1
        } else {
            2
        };
        let (x, y) = ((z + 1) % 3, (z + 2) % 3);
        let axes = if direction[z] < 0.0 { [y, x, z] } else { [x, y, z] };
        let d = direction[z];
        let shear = DVec3::new(direction[axes[0]] / d, direction[axes[1]] / d, 1.0 / d);
        let inverse = DVec3::from(direction.to_array().map(|d| 1.0 / if d.abs() < 1e-200 { 1e-200 } else { d }));
        Self { origin, axes, shear, inverse, slack: 1e-14 * (origin.abs().max_element() + size) }
    }

    /// Whether the line from `from` on meets a box, or nearly.
    #[inline]
    pub fn may_meet(&self, low: DVec3, high: DVec3, from: f64) -> bool {
        let a = (low - self.origin - self.slack) * self.inverse;
        let b = (high - self.origin + self.slack) * self.inverse;
        let (near, far) = (a.min(b), a.max(b));
        let leaves = far.min_element();
        // What the slack is for a box, a little more of it is along the line.
        near.max_element() <= leaves && leaves >= from - 4.0 * self.slack
    }

    fn project(&self, p: DVec3) -> (f64, f64, f64) {
        let p = p - self.origin;
        let [x, y, z] = self.axes;
        (p[x] - self.shear.x * p[z], p[y] - self.shear.y * p[z], self.shear.z * p[z])
    }

    /// Where it crosses a triangle, and whether against its normal (+1) or along it (-1).
    #[inline]
    pub fn meets(&self, [a, b, c]: &[DVec3; 3]) -> Option<(f64, i32)> {
        let [a, b, c] = [a, b, c].map(|&p| self.project(p));
        let sign = side(b, c);
        if sign == 0 || side(c, a) != sign || side(a, b) != sign {
            return None;
        }
        let weights = [area(b, c), area(c, a), area(a, b)];
        let sum: f64 = weights.iter().sum();
        let (low, high) = (a.2.min(b.2).min(c.2), a.2.max(b.2).max(c.2));
        let t = if sum == 0.0 {
            // Seen on edge: anywhere within it.
            0.5 * (low + high)
        } else {
            ((weights[0] * a.2 + weights[1] * b.2 + weights[2] * c.2) / sum).clamp(low, high)
        };
        // Counterclockwise, seen along the line: its normal runs along it.
        Some((t, -sign))
    }
}

/// Twice the area of the triangle of the line, p and q, seen along the line.
#[inline]
fn area(p: (f64, f64, f64), q: (f64, f64, f64)) -> f64 {
    p.0 * q.1 - p.1 * q.0
}

/// Its exact sign. Products that differ after rounding differ alike before; where they do not, what rounding took away decides.
#[inline]
fn side(p: (f64, f64, f64), q: (f64, f64, f64)) -> i32 {
    let (one, other) = (p.0 * q.1, p.1 * q.0);
    if one > other {
        return 1;
    }
    if one < other {
        return -1;
    }
    let (lost, other_lost) = (libm::fma(p.0, q.1, -one), libm::fma(p.1, q.0, -other));
    // The line moved by (e, e^2), where the determinant is 0.
    let tie = if p.1 == q.1 { sign(q.0 - p.0) } else { sign(p.1 - q.1) };
    if lost == other_lost { tie } else { sign(lost - other_lost) }
}

fn sign(x: f64) -> i32 {
    i32::from(x > 0.0) - i32::from(x < 0.0)
}
