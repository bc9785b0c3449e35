//! A tree of boxes over many things, for several questions: what a line may meet, what is nearest to a point, what shares a box, where light
//! may be refracted.
//!
//! Boxes are f64: they hold the things exactly, and one tree serves all of them.

use std::ops::Range;

use glam::DVec3;

/// Things in one leaf at most.
const LEAF: usize = 4;
/// Places at which a split is tried along each axis.
const BINS: usize = 16;
/// Deeper than any tree of 2^32 things that `Tree::over` builds: below this depth it splits in the middle.
const DEEP: usize = 64;

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
    /// The tree over boxes (low, high), split by the surface area heuristic. The same whatever the machine.
    pub fn over(boxes: &[(DVec3, DVec3)]) -> Self {
        let mut order: Vec<u32> = (0..boxes.len() as u32).collect();
        let all = Node { low: DVec3::ZERO, high: DVec3::ZERO, first: 0, count: boxes.len() as u32 };
        let mut nodes = vec![all];
        let mut open = vec![(0, 0)];
        while let Some((node, depth)) = open.pop() {
            let Node { first, count, .. } = nodes[node];
            let range = first as usize..(first + count) as usize;
            let (low, high) = around(boxes, &order[range.clone()]);
            (nodes[node].low, nodes[node].high) = (low, high);
            if range.len() <= LEAF {
                continue;
            }
            let left = split(boxes, &mut order[range.clone()], depth) as u32;
            let children = nodes.len();
            nodes.push(Node { low, high, first, count: left });
            nodes.push(Node { low, high, first: first + left, count: count - left });
            (nodes[node].first, nodes[node].count) = (children as u32, 0);
            open.extend([(children, depth + 1), (children + 1, depth + 1)]);
        }
        Self { nodes, order }
    }

    /// Which thing stands at each place of the leaves.
    pub fn order(&self) -> &[u32] {
        &self.order
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
        self.visit_numbered(|_, low, high| meets(low, high), leaf);
    }

    /// The same, where `meets` is told the number of the box, too.
    #[inline]
    pub fn visit_numbered(&self, meets: impl Fn(usize, DVec3, DVec3) -> bool, mut leaf: impl FnMut(Range<usize>)) {
        let mut stack = [0_u32; 2 * DEEP];
        let mut top = 1;
        while top > 0 {
            top -= 1;
            let i = stack[top] as usize;
            let node = &self.nodes[i];
            if !meets(i, node.low, node.high) {
                continue;
            }
            if node.count > 0 {
                leaf(node.first as usize..(node.first + node.count) as usize);
            } else {
                (stack[top], stack[top + 1]) = (node.first + 1, node.first);
                top += 2;
            }
        }
    }

    /// The least of what `distance2` says of the things at a leaf's places, and of `least`; both are squares of distances to `p`.
    #[inline]
    pub fn nearest(&self, p: DVec3, mut least: f64, mut distance2: impl FnMut(Range<usize>) -> f64) -> f64 {
        let to_box = |node: &Node| (node.low - p).max(p - node.high).max(DVec3::ZERO).length_squared();
        let mut stack = [(0_u32, 0.0); 2 * DEEP];
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

fn around(boxes: &[(DVec3, DVec3)], things: &[u32]) -> (DVec3, DVec3) {
    let nowhere = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    things.iter().map(|&i| boxes[i as usize]).fold(nowhere, |(low, high), b| (low.min(b.0), high.max(b.1)))
}

fn half_area(low: DVec3, high: DVec3) -> f64 {
    let d = high - low;
    d.x * d.y + d.y * d.z + d.z * d.x
}

/// Brings those of the left child to the front, and says how many they are; never none nor all.
fn split(boxes: &[(DVec3, DVec3)], things: &mut [u32], depth: usize) -> usize {
    let middle = |i: u32| boxes[i as usize].0 + boxes[i as usize].1;
    let nowhere = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (low, high) = things.iter().map(|&i| middle(i)).fold(nowhere, |(l, h), m| (l.min(m), h.max(m)));
    let scale = BINS as f64 / (high - low);
    let bin = |i: u32, axis: usize| (((middle(i)[axis] - low[axis]) * scale[axis]) as usize).min(BINS - 1);
    let mut best: Option<(f64, usize, usize)> = None;
    for axis in (0..3).filter(|&axis| high[axis] > low[axis] && scale[axis].is_finite()) {
        let mut bins = [(0_usize, nowhere.0, nowhere.1); BINS];
        for &i in things.iter() {
            let (count, low, high) = &mut bins[bin(i, axis)];
            *count += 1;
            (*low, *high) = (low.min(boxes[i as usize].0), high.max(boxes[i as usize].1));
        }
        // What the bins up to each place would cost, from either end.
        let grow = |sum: &mut (usize, DVec3, DVec3), b: &(usize, DVec3, DVec3)| {
            *sum = (sum.0 + b.0, sum.1.min(b.1), sum.2.max(b.2));
            if sum.0 > 0 { sum.0 as f64 * half_area(sum.1, sum.2) } else { 0.0 }
        };
        let mut left = [0.0; BINS];
        let mut sum = (0, nowhere.0, nowhere.1);
        for (cost, b) in left.iter_mut().zip(&bins) {
            *cost = grow(&mut sum, b);
        }
        let mut sum = (0, nowhere.0, nowhere.1);
        for place in (1..BINS).rev() {
            let cost = grow(&mut sum, &bins[place]) + left[place - 1];
            if sum.0 > 0 && sum.0 < things.len() && best.is_none_or(|(least, ..)| cost < least) {
                best = Some((cost, axis, place));
            }
        }
    }
    let halves = things.len() / 2;
    match best {
        Some((_, axis, place)) if depth < DEEP / 2 => {
            // In their order on either side.
            let (left, right): (Vec<u32>, Vec<u32>) = things.iter().partition(|&&i| bin(i, axis) < place);
            things[..left.len()].copy_from_slice(&left);
            things[left.len()..].copy_from_slice(&right);
            left.len()
        }
        _ => halves,
    }
}
