//! Surface normals from heights: the plane of least squares through the points of a window of pixels.

use glam::DVec3;

/// The plane through the points around a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tangent {
    /// d z / d x and d z / d y.
    pub slope: [f64; 2],
    /// Covariance of the slopes (xx, xy, yy) for points whose z scatter by 1 mm independently, mm^-2.
    pub covariance: [f64; 3],
}

impl Tangent {
    /// The unit normal on the side of `to_viewer`.
    pub fn normal(&self, to_viewer: DVec3) -> DVec3 {
        normal_of(self.slope, to_viewer)
    }
}

/// The unit normal of a surface with these slopes d z / d x, d z / d y, on the side of `to_viewer`.
pub fn normal_of(slope: [f64; 2], to_viewer: DVec3) -> DVec3 {
    let normal = DVec3::new(-slope[0], -slope[1], 1.0).normalize();
    if normal.dot(to_viewer) < 0.0 { -normal } else { normal }
}

/// The plane around `pixel`, from the points up to `reach` pixels away; `None` with fewer than 6 good ones or points on one line.
///
/// `points` holds a world point of each good pixel.
pub fn tangent(points: &[Option<DVec3>], columns: usize, pixel: usize, reach: usize) -> Option<Tangent> {
    let own = points[pixel]?;
    let (row, column, rows) = (pixel / columns, pixel % columns, points.len() / columns);
    let window = |i: usize, n: usize| i.saturating_sub(reach)..(i + reach + 1).min(n);
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
    Some(Tangent { slope, covariance: [yy / det, -xy / det, xx / det] })
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
            let tangent = tangent(&points, columns, i, 2).unwrap();
            assert!((tangent.normal(DVec3::Z) - want).length() < 1e-12);
            assert!((tangent.normal(DVec3::NEG_Z) + want).length() < 1e-12);
        }
        assert_eq!(tangent(&points, columns, 10, 2), None);
        assert_eq!(tangent(&points[..7], columns, 3, 2), None);
    }

    /// One point raised moves the slopes by what the covariance says: for the whole window sum_i (d slope / d z_i)^2 is its diagonal.
    #[test]
    fn slopes_scatter_as_stated() {
        let columns = 5;
        let points = |raised: Option<usize>| -> Vec<Option<DVec3>> {
            let lift = |i: usize| if raised == Some(i) { 1.0 } else { 0.0 };
            (0..25).map(|i| Some(DVec3::new((i % 5) as f64, 1.5 * (i / 5) as f64, lift(i)))).collect()
        };
        let flat = tangent(&points(None), columns, 12, 2).unwrap();
        let mut sum = [0.0; 3];
        for i in 0..25 {
            let [p, q] = tangent(&points(Some(i)), columns, 12, 2).unwrap().slope;
            [p * p, p * q, q * q].iter().zip(&mut sum).for_each(|(x, sum)| *sum += x);
        }
        assert!(sum.iter().zip(flat.covariance).all(|(s, c)| (s - c).abs() < 1e-12), "{sum:?} for {flat:?}");
    }
}
