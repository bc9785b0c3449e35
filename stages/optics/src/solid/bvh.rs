//! A tree of boxes over many things, for several questions: what a line may meet, what is nearest to a point, what shares a box, where light
//! may be refracted.
//!
//! Boxes are f64: they hold the things exactly, and one tree serves all of them.

mod clusters;
mod wide;

use std::ops::Range;

use glam::DVec3;
use obvhs::bvh2::node::Bvh2Node;

use clusters::{Clusters, HALVED_BELOW};
pub use wide::Wide;

/// Things in one leaf at most.
const LEAF: usize = 4;
/// Deeper than any tree of 2^32 things.
const DEEP: usize = HALVED_BELOW + 33;

#[derive(Clone, Copy, Debug, PartialEq)]
struct Node {
    low: DVec3,
    high: DVec3,
    /// The first thing of a leaf; of a branch the first of two neighbouring nodes.
    first: u32,
    /// 0 for a branch.
    count: u32,
}

/// A bounding volume hierarchy. The things keep their boxes; the tree knows them by their place in [`Tree::order`].
#[derive(Clone, Debug, PartialEq)]
pub struct Tree {
    nodes: Vec<Node>,
    order: Vec<u32>,
}

impl Tree {
    /// The tree over boxes (low, high). The same whatever the machine.
    pub fn over(boxes: &[(DVec3, DVec3)]) -> Self {
        Self::of(&Clusters::over(boxes), boxes)
    }

    /// With one for lines, where there is one.
    pub fn with_wide(boxes: &[(DVec3, DVec3)]) -> (Self, Option<Wide>) {
        let clusters = Clusters::over(boxes);
        let tree = Self::of(&clusters, boxes);
        let mut places = vec![0; tree.order.len()];
        for (place, &thing) in (0..).zip(&tree.order) {
            places[thing as usize] = place;
        }
        let wide = Wide::of(&clusters, &places);
        (tree, wide)
    }

    /// The clusters with boxes of their own, which hold the things exactly.
    fn of(clusters: &Clusters, boxes: &[(DVec3, DVec3)]) -> Self {
        let clusters = &clusters.bvh;
        let counts = counts(&clusters.nodes);
        let nothing = Node { low: DVec3::INFINITY, high: DVec3::NEG_INFINITY, first: 0, count: 0 };
        let (mut nodes, mut order, mut open) = (vec![nothing], Vec::with_capacity(boxes.len()), vec![(0, 0)]);
        while let Some((cluster, node)) = open.pop() {
            let first = order.len();
            if counts[cluster] as usize <= LEAF {
                order.extend(things(&clusters.nodes, cluster));
                let (low, high) = around(order[first..].iter().map(|&thing: &u32| &boxes[thing as usize]));
                nodes[node] = Node { low, high, first: first as u32, count: counts[cluster] };
                continue;
            }
            let [lower, upper] = children(&clusters.nodes, cluster);
            let pair = nodes.len();
            nodes[node].first = pair as u32;
            nodes.extend([nothing, nothing]);
            open.extend([(upper, pair + 1), (lower, pair)]);
        }
        // Branches stand before what is in them.
        for i in (0..nodes.len()).rev() {
            if nodes[i].count > 0 {
                continue;
            }
            let [a, b] = [0, 1].map(|k| nodes[nodes[i].first as usize + k]);
            (nodes[i].low, nodes[i].high) = (a.low.min(b.low), a.high.max(b.high));
        }
        Self { nodes, order }
    }

    /// Which thing stands at each place of the leaves.
    pub fn order(&self) -> &[u32] {
        &self.order
    }

    /// What `leaf` says of the places of each leaf, joined branch by branch: lower parts first.
    pub fn join<T>(&self, leaf: &impl Fn(Range<usize>) -> T, join: &mut impl FnMut(T, T) -> T) -> T {
        self.join_below(0, leaf, join)
    }

    fn join_below<T>(&self, i: usize, leaf: &impl Fn(Range<usize>) -> T, join: &mut impl FnMut(T, T) -> T) -> T {
        let node = &self.nodes[i];
        let first = node.first as usize;
        if node.count > 0 {
            return leaf(first..first + node.count as usize);
        }
        let (low, high) = (self.join_below(first, leaf, join), self.join_below(first + 1, leaf, join));
        join(low, high)
    }

    /// The places of the things in each of its boxes, by the box's number.
    pub fn ranges(&self) -> Vec<Range<usize>> {
        let own = |node: &Node| node.first as usize..(node.first + node.count) as usize;
        let mut ranges: Vec<_> = self.nodes.iter().map(own).collect();
        // Branches stand before what is in them.
        for (i, node) in self.nodes.iter().enumerate().rev().filter(|(_, node)| node.count == 0) {
            let first = node.first as usize;
            ranges[i] = ranges[first].start..ranges[first + 1].end;
        }
        ranges
    }

    /// Calls `leaf` with the places of each leaf whose box, and all boxes around it, `meets` says yes to.
    #[inline]
    pub fn visit(&self, meets: impl Fn(DVec3, DVec3) -> bool, leaf: impl FnMut(Range<usize>)) {
        if meets(self.nodes[0].low, self.nodes[0].high) {
            self.visit_below(0, |_, low, high| meets(low, high), leaf);
        }
    }

    /// The same of what is in the box of that number, which is not asked about itself; `meets` is told the numbers of boxes, too.
    #[inline]
    pub fn visit_below(
        &self,
        root: u32,
        meets: impl Fn(usize, DVec3, DVec3) -> bool,
        mut leaf: impl FnMut(Range<usize>),
    ) {
        let mut stack = [0_u32; DEEP + 1];
        stack[0] = root;
        let mut top = 1;
        while top > 0 {
            top -= 1;
            let node = &self.nodes[stack[top] as usize];
            if node.count > 0 {
                leaf(node.first as usize..(node.first + node.count) as usize);
                continue;
            }
            for i in [node.first + 1, node.first] {
                let child = &self.nodes[i as usize];
                if meets(i as usize, child.low, child.high) {
                    stack[top] = i;
                    top += 1;
                }
            }
        }
    }

    /// The least of what `distance2` says of the things at a leaf's places, and of `least`; both are squares of distances to `p`.
    #[inline]
    pub fn nearest(&self, p: DVec3, mut least: f64, mut distance2: impl FnMut(Range<usize>) -> f64) -> f64 {
        let to_box = |node: &Node| (node.low - p).max(p - node.high).max(DVec3::ZERO).length_squared();
        let mut stack = [(0_u32, 0.0); DEEP + 1];
        stack[0] = (0, to_box(&self.nodes[0]));
        let mut top = 1;
        while top > 0 {
            top -= 1;
            let (node, away) = stack[top];
            if away >= least {
                continue;
            }
            let node = &self.nodes[node as usize];
            if node.count > 0 {
                least = least.min(distance2(node.first as usize..(node.first + node.count) as usize));
                continue;
            }
            let [a, b] = [node.first, node.first + 1].map(|i| (i, to_box(&self.nodes[i as usize])));
            let (near, far) = if a.1 <= b.1 { (a, b) } else { (b, a) };
            (stack[top], stack[top + 1]) = (far, near);
            top += 2;
        }
        least
    }
}

fn around<'a>(boxes: impl Iterator<Item = &'a (DVec3, DVec3)>) -> (DVec3, DVec3) {
    let nowhere = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    boxes.fold(nowhere, |(low, high), b| (low.min(b.0), high.max(b.1)))
}

/// Things in each cluster.
fn counts(clusters: &[Bvh2Node]) -> Vec<u32> {
    let mut counts: Vec<u32> = clusters.iter().map(|cluster| cluster.prim_count).collect();
    let (mut branches, mut open) = (Vec::new(), vec![0]);
    while let Some(i) = open.pop() {
        if !clusters[i].is_leaf() {
            branches.push(i);
            open.extend([clusters[i].first_index as usize, clusters[i].first_index as usize + 1]);
        }
    }
    for i in branches.into_iter().rev() {
        let first = clusters[i].first_index as usize;
        counts[i] = counts[first] + counts[first + 1];
    }
    counts
}

/// Both parts of a cluster, that first whose middle is lower along the axis along which they lie apart most.
fn children(clusters: &[Bvh2Node], cluster: usize) -> [usize; 2] {
    let first = clusters[cluster].first_index as usize;
    let apart = clusters[first + 1].aabb().center() - clusters[first].aabb().center();
    if apart[apart.abs().max_position()] < 0.0 { [first + 1, first] } else { [first, first + 1] }
}

/// The things of a small cluster, in the order of [`children`].
fn things(clusters: &[Bvh2Node], cluster: usize) -> impl Iterator<Item = u32> {
    let mut open = vec![cluster];
    std::iter::from_fn(move || {
        loop {
            let i = open.pop()?;
            if clusters[i].is_leaf() {
                return Some(clusters[i].first_index);
            }
            let [lower, upper] = children(clusters, i);
            open.extend([upper, lower]);
        }
    })
}

#[cfg(test)]
mod tests;
