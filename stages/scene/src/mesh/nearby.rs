//! The triangles of a mesh in a tree of boxes, in axes in which these boxes are small.

use std::cell::{Cell, OnceCell};
use std::ops::{ControlFlow, Range};

use glam::{DMat3, DVec3};
use turbid_contract::payload::Mesh;
use turbid_optics::solid::bvh::Tree;

type Box = (DVec3, DVec3);

/// Boxes along the mesh's own axes are taken where they have less than this part of the area of those along x, y and z.
const BETTER: f64 = 0.5;
/// After so many boxes for each triangle, their stacks are looked at too. A mesh that is fit to be rendered has some 40.
const MANY: usize = 200;
/// What turning a corner may round, as a part of its coordinates.
const ROUNDING: f64 = 1e-14;

pub struct Nearby<'a> {
    pub mesh: &'a Mesh,
    /// From the world's axes into those of the boxes.
    pub into: DMat3,
    /// The largest coordinate, mm.
    pub reach: f64,
    boxes: Vec<Box>,
    tree: Tree,
    /// Of each box of the tree, once many share points: what lies in stacks aslant is told apart by them.
    stacks: OnceCell<Vec<Stack>>,
}

/// Where triangles lie along their mean normal.
struct Stack {
    normal: DVec3,
    low: f64,
    high: f64,
}

impl<'a> Nearby<'a> {
    /// Along x, y and z, or along the mesh's own axes where that makes its boxes small: those of long or flat things that stand aslant
    /// share nearly everything else, and each would be compared with all.
    pub fn of(mesh: &'a Mesh) -> Self {
        let area = |into| {
            let half_area = |(low, high): Box| {
                let d = high - low;
                d.x * d.y + d.y * d.z + d.z * d.x
            };
            boxes(mesh, into).map(half_area).sum::<f64>()
        };
        let own = own_axes(mesh);
        let into = if area(own) < BETTER * area(DMat3::IDENTITY) { own } else { DMat3::IDENTITY };
        let boxes: Vec<Box> = boxes(mesh, into).collect();
        let tree = Tree::over(&boxes);
        let reach = mesh.vertices.iter().flatten().fold(0.0, |most: f64, x| most.max(x.abs()));
        Self { mesh, into, reach, boxes, tree, stacks: OnceCell::new() }
    }

    pub fn corners(&self, triangle: usize) -> [DVec3; 3] {
        self.mesh.triangles[triangle].map(|i| self.mesh.vertices[i as usize].into())
    }

    /// Calls `near` with each pair of triangles, the lower first, that may have a point in common, until it breaks. Whether all were
    /// asked about before `most` pairs of boxes with a point in common were looked at.
    pub fn pairs(&self, most: u64, mut near: impl FnMut(usize, usize) -> ControlFlow<()>) -> bool {
        let mut shared = 0;
        let (stopped, visited) = (Cell::new(false), Cell::new(0));
        for (i, (low, high)) in self.boxes.iter().enumerate() {
            // Shells in shells, or sheets aslant: all share their boxes, and few their heights.
            if visited.get() > MANY * self.boxes.len() && self.stacks.get().is_none() {
                let _ =
                    self.stacks.set(self.tree.ranges().into_iter().map(|r| self.stack(self.triangles(r))).collect());
            }
            let (stacks, corners) = (self.stacks.get(), self.corners(i));
            let own = stacks.map(|_| self.stack(std::iter::once(i)));
            let shares = |l: DVec3, h: DVec3| l.cmple(*high).all() && low.cmple(h).all();
            let meets = |node: usize, l: DVec3, h: DVec3| {
                visited.set(visited.get() + 1);
                !stopped.get() && shares(l, h) && stacks.is_none_or(|stacks| stacks[node].may_hold(&corners))
            };
            self.tree.visit_below(0, meets, |places| {
                for j in self.triangles(places) {
                    if j > i && !stopped.get() && shares(self.boxes[j].0, self.boxes[j].1) {
                        shared += 1;
                        let apart = || own.as_ref().is_some_and(|own| !own.may_hold(&self.corners(j)));
                        stopped.set(shared > most || (!apart() && near(i, j).is_break()));
                    }
                }
            });
            if stopped.get() {
                break;
            }
        }
        shared <= most
    }

    /// Calls `near` with each triangle in a leaf whose box, and all boxes around it, `meets` says yes to; in the boxes' axes.
    pub fn visit(&self, meets: impl Fn(DVec3, DVec3) -> bool, mut near: impl FnMut(usize)) {
        self.tree.visit(meets, |places| self.triangles(places).for_each(&mut near));
    }

    fn triangles(&self, places: Range<usize>) -> impl Iterator<Item = usize> + Clone {
        self.tree.order()[places].iter().map(|&i| i as usize)
    }

    fn stack(&self, triangles: impl Iterator<Item = usize> + Clone) -> Stack {
        let (slack, mut normal) = (ROUNDING * self.reach, DVec3::ZERO);
        for i in triangles.clone() {
            let [a, b, c] = self.corners(i);
            let own = (b - a).cross(c - a);
            // Of shells in shells each is turned against the next.
            normal += if own.dot(normal) < 0.0 { -own } else { own };
        }
        let normal = normal.normalize_or_zero();
        let (low, high) = triangles
            .map(|i| span(normal, &self.corners(i)))
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), (l, h)| (low.min(l), high.max(h)));
        Stack { normal, low: low - slack, high: high + slack }
    }
}

impl Stack {
    fn may_hold(&self, corners: &[DVec3; 3]) -> bool {
        let (low, high) = span(self.normal, corners);
        low <= self.high && self.low <= high
    }
}

/// Lowest and highest corner along a direction.
fn span(along: DVec3, corners: &[DVec3; 3]) -> (f64, f64) {
    let [a, b, c] = corners.map(|corner| along.dot(corner));
    (a.min(b).min(c), a.max(b).max(c))
}

/// Around each triangle, along axes that `into` leads to.
fn boxes(mesh: &Mesh, into: DMat3) -> impl Iterator<Item = Box> {
    let rounding = if into == DMat3::IDENTITY { 0.0 } else { ROUNDING };
    mesh.triangles.iter().map(move |t| {
        let [a, b, c] = t.map(|i| into * DVec3::from(mesh.vertices[i as usize]));
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        let slack = rounding * low.abs().max(high.abs()).max_element();
        (low - slack, high + slack)
    })
}

/// The principal axes of the edges, the longest first: rods run along the first, plates lie across the last. Rows of a rotation.
fn own_axes(mesh: &Mesh) -> DMat3 {
    let mut sum = [[0.0; 3]; 3];
    for t in &mesh.triangles {
        let corners = t.map(|i| DVec3::from(mesh.vertices[i as usize]));
        for k in 0..3 {
            let edge = (corners[(k + 1) % 3] - corners[k]).to_array();
            // The longest edges are what boxes are made large by.
            let weight = edge.iter().map(|x| x * x).sum::<f64>();
            for (row, x) in sum.iter_mut().zip(edge) {
                row.iter_mut().zip(edge).for_each(|(sum, y)| *sum += weight * x * y);
            }
        }
    }
    rotation(sum).transpose()
}

/// Unit eigenvectors of a symmetric matrix as columns (Jacobi's method; Golub and Van Loan, Matrix Computations, 8.5).
fn rotation(mut m: [[f64; 3]; 3]) -> DMat3 {
    let mut axes = [DVec3::X, DVec3::Y, DVec3::Z];
    // Each sweep doubles the digits; six are more than f64 has.
    for (p, q) in [(0, 1), (0, 2), (1, 2)].repeat(6) {
        if m[p][q] == 0.0 {
            continue;
        }
        let theta = (m[q][q] - m[p][p]) / (2.0 * m[p][q]);
        let t = 1.0 / (theta.abs() + (theta * theta + 1.0).sqrt()) * if theta < 0.0 { -1.0 } else { 1.0 };
        let c = 1.0 / (t * t + 1.0).sqrt();
        let s = t * c;
        for row in &mut m {
            (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
        }
        let (row_p, row_q) = (m[p], m[q]);
        m[p] = std::array::from_fn(|k| c * row_p[k] - s * row_q[k]);
        m[q] = std::array::from_fn(|k| s * row_p[k] + c * row_q[k]);
        (axes[p], axes[q]) = (c * axes[p] - s * axes[q], s * axes[p] + c * axes[q]);
    }
    DMat3::from_cols(axes[0].normalize(), axes[1].normalize(), axes[2].normalize())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A rod along any direction has its longest axis there, and its boxes become as thin as it is.
    #[test]
    fn rods_aslant_have_thin_boxes() {
        for along in [DVec3::X, DVec3::new(1.0, 1.0, 1.0), DVec3::new(-0.3, 0.9, 0.2), DVec3::new(0.0, 1e-9, 1.0)] {
            let along = 100.0 * along.normalize();
            let (x, y) = along.normalize().any_orthonormal_pair();
            let vertices: Vec<[f64; 3]> = [DVec3::ZERO, x, y, along].map(|v| v.to_array()).to_vec();
            let mesh = Mesh { vertices, triangles: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]] };
            let axes = own_axes(&mesh);
            assert!((axes * axes.transpose()).abs_diff_eq(DMat3::IDENTITY, 1e-14), "{axes}");
            let most = |into| {
                boxes(&mesh, into)
                    .map(|(low, high)| (high - low).to_array())
                    .map(|mut d| {
                        d.sort_by(f64::total_cmp);
                        d[1]
                    })
                    .fold(0.0, f64::max)
            };
            // A corner that is 1 off an axis of 100 leans it by 0.01.
            assert!(most(axes) < 2.5, "{along}: {}", most(axes));
        }
    }
}
