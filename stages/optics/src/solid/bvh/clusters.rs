//! Which boxes belong together: clusters of neighbours (PLOC; Meister and Bittner 2018) as obvhs finds them, in single precision. Only the
//! grouping is taken; reinsertion, which is to mend it, was measured and brings nothing here.

use glam::{DVec3, Vec3A};
use obvhs::Boundable;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::ploc::morton::morton_encode_u64_unorm;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};

use crate::philox::{philox4x32, unit};

/// Boxes are clustered by so many at a time, then the clusters: at worst a step joins but two neighbours, and takes as long as there are boxes.
const AT_ONCE: usize = 1 << 16;
/// Boxes count as larger by up to this part of their size, each by another: of equal ones in a row each is nearest to the next, and a step
/// joins but the last two.
const UNEQUAL: f64 = 0.05;
/// Below this depth what is left of a branch is halved by number, so that no tree of 2^32 things is 32 deeper than that.
pub const HALVED_BELOW: usize = 48;
/// Added to boxes on all sides, half the size of everything being 1: what `Wide` needs. Boxes without volume are told apart by it, too.
const SLACK: f32 = 1e-5;

/// Clusters of clusters down to single boxes, in coordinates (p - center) scale, which are within -1 and 1.
pub struct Clusters {
    pub bvh: Bvh2,
    pub center: DVec3,
    /// 0 where all boxes are one point.
    pub scale: f64,
}

#[derive(Clone, Copy)]
struct Thing {
    aabb: Aabb,
    number: u32,
}

impl Boundable for Thing {
    fn aabb(&self) -> Aabb {
        self.aabb
    }
}

impl Clusters {
    /// Over at least one box. The same whatever the machine: one thread, and nothing that IEEE 754 leaves open.
    pub fn over(boxes: &[(DVec3, DVec3)]) -> Self {
        assert!(boxes.iter().all(|(low, high)| low.is_finite() && high.is_finite()), "boxes have finite corners");
        let (low, high) = super::around(boxes.iter());
        let center = 0.5 * low + 0.5 * high;
        let size = (high - center).max(center - low).max_element();
        let scale = if size > f64::MIN_POSITIVE { 1.0 / size } else { 0.0 };
        let scaled = |p: DVec3| ((p - center) * scale).as_vec3a();
        let slack = Vec3A::splat(SLACK);
        let around = |&(low, high): &(DVec3, DVec3)| Aabb::new(scaled(low) - slack, scaled(high) + slack);
        let things = boxes.iter().zip(0..).map(|(b, number)| Thing { aabb: unequal(around(b), number), number });
        let mut bvh = clustered(things.collect());
        for node in bvh.nodes.iter_mut().filter(|node| node.is_leaf()) {
            node.set_aabb(around(&boxes[node.first_index as usize]));
        }
        bvh.refit_all();
        halve_deep(&mut bvh.nodes);
        Self { bvh, center, scale }
    }
}

/// A box that is larger by some of its own size, so that few are alike.
fn unequal(aabb: Aabb, number: u32) -> Aabb {
    let [low, high, ..] = philox4x32([number, 0, 0, 0], [0, 0]).map(|u| (UNEQUAL * unit(u)) as f32);
    let size = aabb.diagonal();
    Aabb::new(aabb.min - low * size, aabb.max + high * size)
}

/// By neighbourhood alone. Leaves hold the number of their thing.
fn clustered(mut things: Vec<Thing>) -> Bvh2 {
    let mut builder = PlocBuilder::new();
    let mut build = |things: &[Thing]| {
        let places = (0..things.len() as u32).collect();
        builder.build(PlocSearchDistance::Low, things, places, SortPrecision::U64, 0)
    };
    // Two fifths, for boxes that were made larger.
    things.sort_by_cached_key(|thing| morton_encode_u64_unorm(0.4 * thing.aabb.center().as_dvec3() + 0.5));
    let joints = 2 * things.len().div_ceil(AT_ONCE) - 1;
    let mut nodes = Vec::with_capacity(2 * things.len() - 1);
    nodes.resize(joints, Bvh2Node::default());
    let mut roots = Vec::new();
    for part in things.chunks(AT_ONCE) {
        // Its root goes where the clusters of parts have that part, its other nodes to the end.
        let begin = nodes.len() as u32 - 1;
        let mut moved = build(part).nodes.into_iter().map(|mut node| {
            let first = node.first_index;
            node.first_index = if node.is_leaf() { part[first as usize].number } else { first + begin };
            node
        });
        roots.extend(moved.next());
        nodes.extend(moved);
    }
    let parts: Vec<Thing> = roots.iter().map(|root| Thing { aabb: *root.aabb(), number: 0 }).collect();
    let mut all = build(&parts);
    for (node, joint) in nodes.iter_mut().zip(&all.nodes) {
        *node = if joint.is_leaf() { roots[joint.first_index as usize] } else { *joint };
    }
    all.nodes = nodes;
    all.primitive_indices = (0..things.len() as u32).collect();
    all
}

/// Halves what lies too deep.
fn halve_deep(nodes: &mut [Bvh2Node]) {
    let mut open = vec![(0, 0)];
    while let Some((i, depth)) = open.pop() {
        if nodes[i].is_leaf() {
            continue;
        }
        if depth == HALVED_BELOW {
            halve(nodes, i);
            continue;
        }
        let first = nodes[i].first_index as usize;
        open.extend([(first, depth + 1), (first + 1, depth + 1)]);
    }
}

/// Makes a branch as shallow as it can be, with its leaves in the order in which they are.
fn halve(nodes: &mut [Bvh2Node], top: usize) {
    let (mut leaves, mut pairs, mut open) = (Vec::new(), Vec::new(), vec![top]);
    while let Some(i) = open.pop() {
        let node = nodes[i];
        if node.is_leaf() {
            leaves.push(node);
        } else {
            pairs.push(node.first_index);
            open.extend([node.first_index as usize + 1, node.first_index as usize]);
        }
    }
    let mut open = vec![(top, 0..leaves.len())];
    while let Some((i, range)) = open.pop() {
        if range.len() == 1 {
            nodes[i] = leaves[range.start];
            continue;
        }
        let first = pairs.pop().expect("a tree of n leaves has n - 1 pairs");
        let middle = range.start + range.len() / 2;
        let around = leaves[range.clone()].iter().fold(Aabb::empty(), |all, leaf| all.union(leaf.aabb()));
        nodes[i] = Bvh2Node::new(around, 0, first);
        open.extend([(first as usize, range.start..middle), (first as usize + 1, middle..range.end)]);
    }
}
