//! Whether, and how well, a table can be inverted: noise gains, the Jacobian's sign, the hull.

use turbid_contract::LayerInfo;
use turbid_optics::LogGrid;

/// What an inversion of the table has to expect.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// At each node (mu_a outermost): relative error of mu_a and of mu_s' per relative error of every reflectance,
    /// errors independent. 0 where the Jacobian vanishes and no gain exists.
    pub noise_gain: Vec<[f64; 2]>,
    /// At each node: sign of det d(ln R_first, ln R_last) / d(ln mu_a, ln mu_s'), first and last spatial frequency.
    pub sign: Vec<f64>,
    /// Places, nodes and cell centres, whose sign differs from that of most.
    pub folded: usize,
    /// Whether the image of the table's boundary crosses itself: two media far apart then look the same.
    pub hull_crosses: bool,
}

impl Report {
    pub fn invertible(&self) -> bool {
        self.folded == 0 && !self.hull_crosses
    }
}

/// The layers that show a report as images; `section` where there are several.
pub fn layers(section: Option<usize>) -> Vec<LayerInfo> {
    let named = |name: &str| section.map_or_else(|| name.to_owned(), |section| format!("{name}_{section}"));
    ["noise_gain_mu_a", "noise_gain_mu_s_prime", "jacobian_sign"].map(|name| LayerInfo::value(named(name), "1")).into()
}

/// Examines a table of at least two spatial frequencies, given as its interpolants.
pub fn examine(grids: &[LogGrid]) -> Report {
    let (u, v) = (grids[0].u(), grids[0].v());
    let last = grids.len() - 1;
    let jacobian = |u: f64, v: f64| -> Vec<[f64; 2]> {
        let jet = |grid: &LogGrid| grid.log_jet(u, v).expect("nodes and cell centres lie inside the table");
        grids.iter().map(|grid| (jet(grid).w_u, jet(grid).w_v)).map(|(a, b)| [a, b]).collect()
    };
    let sign_of = |rows: &[[f64; 2]]| {
        let det = rows[0][0] * rows[last][1] - rows[0][1] * rows[last][0];
        if det > 0.0 {
            1.0
        } else if det < 0.0 {
            -1.0
        } else {
            0.0
        }
    };
    let (mut noise_gain, mut sign) = (Vec::new(), Vec::new());
    for &u in u {
        for &v in v {
            let rows = jacobian(u, v);
            sign.push(sign_of(&rows));
            noise_gain.push(gains(&rows));
        }
    }
    let mut all = sign.clone();
    for cell_u in u.windows(2) {
        for cell_v in v.windows(2) {
            all.push(sign_of(&jacobian(0.5 * (cell_u[0] + cell_u[1]), 0.5 * (cell_v[0] + cell_v[1]))));
        }
    }
    let positive = all.iter().filter(|&&s| s > 0.0).count();
    let negative = all.iter().filter(|&&s| s < 0.0).count();
    let folded = all.len() - positive.max(negative);
    Report { noise_gain, sign, folded, hull_crosses: crosses_itself(&boundary(grids)) }
}

/// Square roots of the diagonal of (J^T J)^-1: the gains of the least-squares inversion with equal weights.
fn gains(rows: &[[f64; 2]]) -> [f64; 2] {
    let sum = |i: usize, j: usize| rows.iter().map(|row| row[i] * row[j]).sum::<f64>();
    let (aa, ab, bb) = (sum(0, 0), sum(0, 1), sum(1, 1));
    let det = aa * bb - ab * ab;
    // Below this the two columns are parallel to rounding: a gain of 1e7 says that there is no answer.
    if det > 1e-14 * aa * bb { [(bb / det).sqrt(), (aa / det).sqrt()] } else { [0.0; 2] }
}

/// The table's boundary, node by node, in the plane (ln R_first, ln (R_last / R_first)).
fn boundary(grids: &[LogGrid]) -> Vec<[f64; 2]> {
    let (u, v) = (grids[0].u(), grids[0].v());
    let (first, last) = (&grids[0], &grids[grids.len() - 1]);
    let image = |&[u, v]: &[f64; 2]| {
        let w = |grid: &LogGrid| grid.log_jet(u, v).expect("a node lies inside the table").w;
        [w(first), w(last) - w(first)]
    };
    let (u_end, v_end) = (u[u.len() - 1], v[v.len() - 1]);
    let bottom = u.iter().map(|&u| [u, v[0]]);
    let right = v.iter().skip(1).map(|&v| [u_end, v]);
    let top = u.iter().rev().skip(1).map(|&u| [u, v_end]);
    let left = v.iter().rev().skip(1).map(|&v| [u[0], v]);
    bottom.chain(right).chain(top).chain(left).collect::<Vec<_>>().iter().map(image).collect()
}

/// Whether two edges of the closed polygon that are not neighbours meet (the last point repeats the first).
fn crosses_itself(points: &[[f64; 2]]) -> bool {
    let edges: Vec<[[f64; 2]; 2]> = points.windows(2).map(|p| [p[0], p[1]]).collect();
    let side = |[a, b]: [[f64; 2]; 2], p: [f64; 2]| (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]);
    let n = edges.len();
    (0..n).any(|i| {
        (i + 2..n).filter(|&j| (j + 1) % n != i).any(|j| {
            let (e, f) = (edges[i], edges[j]);
            side(e, f[0]) * side(e, f[1]) < 0.0 && side(f, e[0]) * side(f, e[1]) < 0.0
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grids(f: [fn(f64, f64) -> f64; 2]) -> Vec<LogGrid> {
        let x: Vec<f64> = (0..9).map(|i| libm::exp(0.25 * i as f64)).collect();
        let grid = |f: fn(f64, f64) -> f64| {
            let values: Vec<f64> = x.iter().flat_map(|&a| x.iter().map(move |&b| f(a, b))).collect();
            LogGrid::new(&x, &x, &values).unwrap()
        };
        f.map(grid).into()
    }

    /// Power laws have a constant Jacobian [[1, 2], [3, 1]], det -5: gains sqrt(1 + 4) / 5 and sqrt(9 + 1) / 5.
    #[test]
    fn power_laws_have_known_gains() {
        let report = examine(&grids([|x, y| x * y * y, |x, y| x * x * x * y]));
        assert!(report.invertible(), "{report:?}");
        assert!(report.sign.iter().all(|&s| s == -1.0));
        for gain in report.noise_gain {
            assert!((gain[0] - 5f64.sqrt() / 5.0).abs() < 1e-12 && (gain[1] - 10f64.sqrt() / 5.0).abs() < 1e-12);
        }
    }

    /// A table that turns back on itself halfway is found out, and so is one whose frequencies say the same.
    #[test]
    fn folds_are_found() {
        let fold = |x: f64| libm::exp(-(libm::log(x) - 1.0) * (libm::log(x) - 1.0));
        let report = examine(&grids([|x, y| libm::exp(-(libm::log(x) - 1.0) * (libm::log(x) - 1.0)) * y, |_, y| y]));
        assert!(fold(1.0) < 1.0 && report.folded > 0 && !report.invertible());
        let same = examine(&grids([|x, y| x * y, |x, y| x * y]));
        assert!(!same.invertible());
        assert!(same.noise_gain.iter().all(|g| *g == [0.0; 2]));
    }

    #[test]
    fn polygons_that_cross_are_found() {
        assert!(!crosses_itself(&[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.0, 0.0]]));
        assert!(crosses_itself(&[[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0], [0.0, 0.0]]));
    }
}
