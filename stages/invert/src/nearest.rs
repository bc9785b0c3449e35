//! The nearest node of the look-up table.

use crate::forward::{Forward, inverse};

/// The nodes of the table in ln R, whitened, so that both f_x count by what they tell apart.
pub struct Nodes {
    /// Lower triangle W with W C W^T = 1 for the covariance C of ln R over the nodes.
    whiten: [f64; 3],
    nodes: Vec<Node>,
}

/// One node: where it is, its properties, and how they follow the reflectance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Node {
    at: [f64; 2],
    /// (ln mu_a, ln mu_s').
    pub p: [f64; 2],
    /// d p / d (ln R_0, ln R_1); `None` where the table is flat.
    pub gain: Option<[[f64; 2]; 2]>,
}

impl Nodes {
    pub fn new(forward: &Forward) -> Self {
        let [a, s] = forward.nodes();
        let p: Vec<[f64; 2]> = a.iter().flat_map(|&a| s.iter().map(move |&s| [a, s])).collect();
        let points: Vec<_> = p.iter().map(|&p| forward.at(p)).collect();
        let n = points.len() as f64;
        let mean = [0, 1].map(|k| points.iter().map(|x| x.ln_r[k]).sum::<f64>() / n);
        let c =
            |i: usize, j: usize| points.iter().map(|x| (x.ln_r[i] - mean[i]) * (x.ln_r[j] - mean[j])).sum::<f64>() / n;
        let (l_00, c_01) = (c(0, 0).sqrt(), c(0, 1));
        let l_10 = c_01 / l_00;
        let l_11 = (c(1, 1) - l_10 * l_10).sqrt();
        let whiten = [1.0 / l_00, -l_10 / (l_00 * l_11), 1.0 / l_11];
        let node = |(point, &p): (&crate::forward::Point, &[f64; 2])| Node {
            at: white(&whiten, point.ln_r),
            p,
            gain: inverse(&point.jacobian),
        };
        Self { whiten, nodes: points.iter().zip(&p).map(node).collect() }
    }

    /// The node nearest to the reflectances `r`, both > 0; of equally near ones the first.
    pub fn nearest(&self, r: [f64; 2]) -> &Node {
        let at = white(&self.whiten, r.map(libm::log));
        let mut best = (&self.nodes[0], f64::INFINITY);
        for node in &self.nodes {
            let d = [node.at[0] - at[0], node.at[1] - at[1]];
            let distance = d[0] * d[0] + d[1] * d[1];
            if distance < best.1 {
                best = (node, distance);
            }
        }
        best.0
    }
}

fn white(w: &[f64; 3], ln_r: [f64; 2]) -> [f64; 2] {
    [w[0] * ln_r[0], w[1] * ln_r[0] + w[2] * ln_r[1]]
}
