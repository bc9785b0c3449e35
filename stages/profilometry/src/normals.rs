//! Surface normals: the plane of least squares through the points of 5 x 5 pixels.

use glam::DVec3;

/// Pixels on each side.
const REACH: usize = 2;

/// The unit normal towards the camera at `pixel`; `None` with fewer than 6 good points or points on one line.
///
/// `points` holds a world point of each good pixel; `to_camera` points from the surface to the camera.
pub fn normal(points: &[Option<DVec3>], columns: usize, pixel: usize, to_camera: DVec3) -> Option<DVec3> {
    let own = points[pixel]?;
    let (row, column, rows) = (pixel / columns, pixel % columns, points.len() / columns);
    let window = |i: usize, n: usize| i.saturating_sub(REACH)..(i + REACH + 1).min(n);
    let (mut n, mut sum) = (0.0, DVec3::ZERO);
    let near: Vec<DVec3> = window(row, rows)
        .flat_map(|r| window(column, columns).map(move |c| r * columns + c))
        .filter_map(|i| points[i].map(|p| p - own))
        .collect();
    for p in &near {
        n += 1.0;
        sum += *p;
    }
    if n < 6.0 {
        return None;
    }
    let mean = sum / n;
    let (mut xx, mut xy, mut yy, mut xz, mut yz) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for p in &near {
        let d = *p - mean;
        xx += d.x * d.x;
        xy += d.x * d.y;
        yy += d.y * d.y;
        xz += d.x * d.z;
        yz += d.y * d.z;
    }
    let det = xx * yy - xy * xy;
    if det <= 1e-9 * (xx + yy) * (xx + yy) {
        return None;
    }
    let slope = [(xz * yy - yz * xy) / det, (yz * xx - xz * xy) / det];
    let normal = DVec3::new(-slope[0], -slope[1], 1.0).normalize();
    Some(if normal.dot(to_camera) < 0.0 { -normal } else { normal })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A tilted plane has its normal everywhere, corners and holes included; a line of pixels has none.
    #[test]
    fn a_plane_has_its_normal() {
        let (rows, columns) = (6, 7);
        let point = |i: usize| {
            let (x, y) = ((i % columns) as f64, -((i / columns) as f64));
            Some(DVec3::new(x, y, 3.0 + 0.2 * x - 0.5 * y))
        };
        let mut points: Vec<Option<DVec3>> = (0..rows * columns).map(point).collect();
        points[10] = None;
        let want = DVec3::new(-0.2, 0.5, 1.0).normalize();
        for i in (0..points.len()).filter(|&i| i != 10) {
            assert!((normal(&points, columns, i, DVec3::Z).unwrap() - want).length() < 1e-12);
            assert!((normal(&points, columns, i, DVec3::NEG_Z).unwrap() + want).length() < 1e-12);
        }
        assert_eq!(normal(&points, columns, 10, DVec3::Z), None);
        assert_eq!(normal(&points[..7], columns, 3, DVec3::Z), None);
    }
}
