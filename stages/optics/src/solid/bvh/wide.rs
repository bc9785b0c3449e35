//! The same tree for lines: eight boxes in a node of 80 bytes, in single precision (CWBVH; Ylitie, Karras and Laine 2017).

use glam::{DVec3, Vec3A};
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::bvh2_to_cwbvh::bvh2_to_cwbvh;
use obvhs::ray::Ray;

use super::clusters::Clusters;

/// obvhs's stack on its way down; it overwrites what is beyond, so no deeper tree is kept.
const DEEPEST: usize = 32;
/// Things in a leaf at most: as many as the form has room for.
const LEAF: u32 = 3;
/// Farther than anything from the center, half the size of all being 1: sqrt 3, and some.
const REACH: f64 = 1.8;
/// A ray starts so far before what it is asked about: obvhs takes nothing below 1e-4.
const BEFORE: f64 = 3e-4;
/// A line may be off by so much; the boxes have room for it.
const ROUNDING: f64 = 1e-6;

/// Invariant: no thing that a line meets is left out. Boxes, origin, direction and slabs, whose planes are at most 3.8 from the origin,
/// are rounded by 4e-6 in all (1.3e-6 of that because obvhs takes a direction along an axis for one 1.2e-7 off it); boxes are larger by 1e-5.
/// How large obvhs's steps of boxes are may differ between machines; what is left in the end, the things that are met themselves, does not.
#[derive(Clone, Debug, PartialEq)]
pub struct Wide {
    bvh: CwBvh,
    center: DVec3,
    scale: f64,
}

impl Wide {
    /// `None` where it would be too deep, or all is one point. `places` are those of the things in the other tree.
    pub(super) fn of(clusters: &Clusters, places: &[u32]) -> Option<Self> {
        let &Clusters { ref bvh, center, scale } = clusters;
        let mut bvh = bvh2_to_cwbvh(bvh, LEAF, false, false);
        if scale == 0.0 || depth(&bvh) > DEEPEST {
            return None;
        }
        bvh.nodes.shrink_to_fit();
        bvh.primitive_indices.iter_mut().for_each(|thing| *thing = places[*thing as usize]);
        Some(Self { bvh, center, scale })
    }

    /// Calls `met` with the places of all things whose box the line of a unit direction meets from `from` on, and of some others. False, and
    /// nothing is called, where `slack`, by which the line may be off, is too large for single precision.
    #[inline]
    pub fn visit(&self, origin: DVec3, direction: DVec3, from: f64, slack: f64, mut met: impl FnMut(usize)) -> bool {
        let origin = (origin - self.center) * self.scale;
        let fine = slack * self.scale <= ROUNDING;
        if !fine {
            return false;
        }
        let from = from * self.scale;
        let middle = -origin.dot(direction);
        let start = from.max(middle - REACH) - BEFORE;
        let near = origin + start * direction;
        // Farther off, or beyond it: nothing is met, and single precision would be too coarse to say so.
        if near.length_squared() <= 2.0 * (REACH + BEFORE) * (REACH + BEFORE) {
            // obvhs takes a direction of -0 for one and for the other.
            let ray = Ray::new_inf(near.as_vec3a(), direction.as_vec3a() + Vec3A::ZERO);
            self.bvh.ray_traverse_anyhit(ray, |_, i| met(self.bvh.primitive_indices[i] as usize));
        }
        true
    }
}

fn depth(bvh: &CwBvh) -> usize {
    let (mut deepest, mut open) = (0, vec![(0, 1)]);
    while let Some((i, depth)) = open.pop() {
        deepest = deepest.max(depth);
        let node = &bvh.nodes[i];
        let first = node.child_base_idx as usize;
        open.extend((first..first + node.imask.count_ones() as usize).map(|child| (child, depth + 1)));
    }
    deepest
}
