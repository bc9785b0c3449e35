//! Where facets may refract or reflect light from one point to another: a tree of cones of normals, sixteen of them side by side.
//!
//! Light goes from the far end to the near one through a point p of a facet of unit normal m, if with the unit vectors a, b from p to both
//!
//! ```text
//! n_far a + n_near b = h  is along m,  and a . m and b . m have opposite signs;
//! ```
//!
//! it is reflected there if n_far = n_near and both have the same sign.
//!
//! Over a sphere full of facets a, b and m stay in cones, so h stays in one: where it does not meet that of the normals, or both ends are on one side of all
//! facets, or the light would have to turn by more than refraction can, nothing in the sphere turns it (Walter, Zhao, Holzschuch and Bala 2009). A facet's own
//! cone is its normal alone. Single precision decides only what is asked in double precision afterwards: its rounding makes cones wider.

use std::ops::Range;

use fearless_simd::prelude::*;
use fearless_simd::{Level, Simd};
use glam::DVec3;

use super::bvh::Tree;
use super::crossing::{Ends, Far};
use super::facets::{F, LANES, V, dot};
use crate::at_level;

/// In the list of what is in spheres: a facet, not a node.
const FACET: u32 = 1 << 31;
/// Rounding of single precision, each many times what it comes to: of directions and cosines (rad) ...
const ROUNDING: f32 = 2e-6;
/// ... and of places, half the size of the mesh being 1.
const SLACK: f64 = 4e-7;
/// An end farther than this is one at infinity, in the same unit.
const FAR: f64 = 1e7;

/// Over facets, which it knows by their places in the tree that it is made of.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct SpecularTree {
    nodes: Vec<Node>,
    /// Makes half the size of the mesh 1.
    scale: f64,
}

/// Up to sixteen spheres and the cones of the normals in them.
#[derive(Clone, Debug, PartialEq)]
#[repr(align(64))]
struct Node {
    center: [[f32; LANES]; 3],
    radius: [f32; LANES],
    axis: [[f32; LANES]; 3],
    /// Of half the opening of a cone; a cosine of -1 where normals differ by a right angle and more.
    cos: [f32; LANES],
    sin: [f32; LANES],
    /// A facet with `FACET`, or the number of a node.
    inside: [u32; LANES],
    count: u32,
}

/// One of a node's.
#[derive(Clone, Copy, Debug)]
struct Sphere {
    center: DVec3,
    radius: f64,
    axis: DVec3,
    cos: f64,
    inside: u32,
}

/// Light that is looked for.
#[derive(Clone, Copy, Debug)]
pub(super) enum Turn {
    Refraction,
    /// The indices of both ends are the same.
    Reflection,
}

/// The two ends as nodes are asked about them.
struct Question {
    far: End,
    near: End,
    /// Cosine and sine of the largest angle by which refraction turns light: where it grazes the side of less index. Reflection may turn it by any.
    turns: Option<(f32, f32)>,
    /// Of h . m, where a . m is positive.
    sign: f32,
    /// Of b . m, where a . m is positive.
    side: f32,
}

/// From p it is along `at` - `finite` p.
struct End {
    at: [f32; 3],
    /// 1, or 0 at infinity.
    finite: f32,
    n: f32,
}

impl SpecularTree {
    /// Over facets by their places in the leaves of a tree, in coordinates in which `size` mm from the origin is the farthest of all along an axis.
    pub fn over(tree: &Tree, corners: &[[DVec3; 3]], normals: &[DVec3], size: f64) -> Self {
        let mut made = Self { nodes: Vec::new(), scale: if size > f64::MIN_POSITIVE { 1.0 / size } else { 0.0 } };
        // What is in a branch: spheres, at most sixteen, and which facets.
        let leaf = |places: Range<usize>| {
            (places.clone().map(|place| Sphere::around_facet(corners, normals, place)).collect(), places)
        };
        let (top, _) = tree.join(&leaf, &mut |(mut some, low): (Vec<Sphere>, _), (mut others, high)| {
            // The larger part becomes a node, of at least nine spheres, so that few of its lanes are idle.
            while some.len() + others.len() > LANES {
                let (full, places) = if some.len() >= others.len() { (&mut some, &low) } else { (&mut others, &high) };
                let inside = made.push(full);
                *full = vec![Sphere { inside, ..Sphere::around(&corners[places.clone()], &normals[places.clone()]) }];
            }
            some.extend(others);
            (some, low.start..high.end)
        });
        made.push(&top);
        made.nodes.shrink_to_fit();
        made
    }

    /// Calls `found` with the places of all facets that turn light between two ends, and of some others.
    pub fn visit(&self, ends: &Ends, turn: Turn, mut found: impl FnMut(usize)) {
        let question = Question::new(ends, turn, self.scale);
        let mut facets = Vec::new();
        at_level!(Level::new(), simd => self.collect(simd, &question, &mut facets));
        facets.into_iter().for_each(|facet| found(facet as usize));
    }

    #[inline(always)]
    fn collect<S: Simd>(&self, simd: S, question: &Question, facets: &mut Vec<u32>) {
        let mut open = Vec::with_capacity(4 * LANES);
        open.push(self.nodes.len() as u32 - 1);
        simd.vectorize(
            #[inline(always)]
            || {
                while let Some(i) = open.pop() {
                    let node = &self.nodes[i as usize];
                    let mut left = node.may_turn_light(simd, question);
                    while left != 0 {
                        let inside = node.inside[left.trailing_zeros() as usize];
                        left &= left - 1;
                        if inside & FACET == 0 {
                            open.push(inside);
                        } else {
                            facets.push(inside & !FACET);
                        }
                    }
                }
            },
        );
    }

    fn push(&mut self, spheres: &[Sphere]) -> u32 {
        let nothing = [0.0; LANES];
        let mut node = Node {
            center: [nothing; 3],
            radius: nothing,
            axis: [nothing; 3],
            cos: nothing,
            sin: nothing,
            inside: [0; LANES],
            count: spheres.len() as u32,
        };
        for (i, sphere) in spheres.iter().enumerate() {
            for axis in 0..3 {
                node.center[axis][i] = (self.scale * sphere.center[axis]) as f32;
                node.axis[axis][i] = sphere.axis[axis] as f32;
            }
            node.radius[i] = (self.scale * sphere.radius + SLACK) as f32;
            node.cos[i] = sphere.cos as f32;
            node.sin[i] = (1.0 - sphere.cos * sphere.cos).max(0.0).sqrt() as f32;
            node.inside[i] = sphere.inside;
        }
        self.nodes.push(node);
        self.nodes.len() as u32 - 1
    }
}

impl Sphere {
    fn around_facet(corners: &[[DVec3; 3]], normals: &[DVec3], place: usize) -> Self {
        Self { inside: FACET | place as u32, ..Self::around(&corners[place..=place], &normals[place..=place]) }
    }

    /// Around some facets.
    fn around(corners: &[[DVec3; 3]], normals: &[DVec3]) -> Self {
        let points = || corners.iter().flatten();
        let (low, high) = points().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), &p| (l.min(p), h.max(p)));
        let center = 0.5 * (low + high);
        let square = points().map(|p| (p - center).length_squared()).fold(0.0, f64::max);
        let axis = normals.iter().sum::<DVec3>().try_normalize();
        let cos = axis.map(|axis| normals.iter().map(|m| m.dot(axis)).fold(1.0, f64::min)).filter(|cos| *cos > 0.0);
        Self { center, radius: square.sqrt(), axis: axis.unwrap_or(DVec3::Z), cos: cos.unwrap_or(-1.0), inside: 0 }
    }
}

impl Question {
    fn new(ends: &Ends, turn: Turn, scale: f64) -> Self {
        let (far, near) = (End::of(ends.far, ends.n_far, scale), End::of(Far::Point(ends.near), ends.n_near, scale));
        match turn {
            Turn::Reflection => Self { far, near, turns: None, sign: 1.0, side: 1.0 },
            Turn::Refraction => {
                let (less, more) = (ends.n_far.min(ends.n_near), ends.n_far.max(ends.n_near));
                let cos = less / more;
                let turns = Some((cos as f32, (1.0 - cos * cos).max(0.0).sqrt() as f32));
                Self { far, near, turns, sign: (ends.n_far - ends.n_near).signum() as f32, side: -1.0 }
            }
        }
    }
}

impl End {
    fn of(far: Far, n: f64, scale: f64) -> Self {
        let (at, finite) = match far {
            Far::Point(p) if scale * p.length() <= FAR => (scale * p, 1.0),
            Far::Point(p) => (p.normalize(), 0.0),
            Far::Direction(towards) => (towards, 0.0),
        };
        Self { at: at.as_vec3().to_array(), finite, n: n as f32 }
    }

    /// Unit vectors towards it from the middles of a node's spheres, and the sine of half the cone of those from the points of each: at least 1 if it is within or near.
    #[inline(always)]
    fn seen_from<S: Simd>(&self, simd: S, node: &Node) -> (V<S>, F<S>) {
        let [x, y, z] = &node.center;
        let finite = F::splat(simd, self.finite);
        let x = F::splat(simd, self.at[0]) - finite * F::load_array(simd, *x);
        let y = F::splat(simd, self.at[1]) - finite * F::load_array(simd, *y);
        let z = F::splat(simd, self.at[2]) - finite * F::load_array(simd, *z);
        let inverse = F::splat(simd, 1.0) / (x * x + y * y + z * z).sqrt();
        let sin = F::load_array(simd, node.radius) * (finite * inverse) + ROUNDING;
        ([x * inverse, y * inverse, z * inverse], sin)
    }
}

impl Node {
    /// Which spheres may hold a facet that turns light from one end to the other. What has no answer, as of an end in the middle of a sphere, may.
    #[inline(always)]
    fn may_turn_light<S: Simd>(&self, simd: S, question: &Question) -> u64 {
        let one = F::splat(simd, 1.0);
        let Question { far, near, turns, sign, side } = question;
        let (a, a_sin) = far.seen_from(simd, self);
        let (b, b_sin) = near.seen_from(simd, self);
        let m =
            [F::load_array(simd, self.axis[0]), F::load_array(simd, self.axis[1]), F::load_array(simd, self.axis[2])];
        let (m_cos, m_sin) = (F::load_array(simd, self.cos), F::load_array(simd, self.sin));
        let known = a_sin.simd_lt(one) & b_sin.simd_lt(one) & m_cos.simd_gt(F::splat(simd, 0.0));

        // The cone of h = n_far a + n_near b: a chord of a cone is less than this for sines up to 1.
        let chords = (a_sin * far.n) * (a_sin * a_sin * 0.415 + 1.0) + (b_sin * near.n) * (b_sin * b_sin * 0.415 + 1.0);
        let h = [a[0] * far.n + b[0] * near.n, a[1] * far.n + b[1] * near.n, a[2] * far.n + b[2] * near.n];
        let length = dot(&h, &h).sqrt();
        let h_sin = chords / length;
        // That and the cone of the normals, opened by each other.
        let opened = (one - h_sin * h_sin).sqrt() * m_cos - h_sin * m_sin;
        let least = (h_sin.simd_lt(one).select(opened, -one) - ROUNDING) * length;
        let along = dot(&h, &m) * *sign;
        // sin x + sin y is no less than sin(x + y), and below 1 only for x + y below a right angle.
        let (a_up, b_up) = (dot(&a, &m), dot(&b, &m) * *side);
        let (a_low, b_low) = (a_sin + m_sin, b_sin + m_sin);
        let (a_clear, b_clear) = (a_low.simd_lt(one), b_low.simd_lt(one));
        // By light on the outer side, and on the inner one.
        let not_out = along.simd_lt(least) | (a_clear & a_up.simd_lt(-a_low)) | (b_clear & b_up.simd_lt(-b_low));
        let not_in = (-along).simd_lt(least) | (a_clear & a_up.simd_gt(a_low)) | (b_clear & b_up.simd_gt(b_low));
        let mut excluded = not_out & not_in;

        if let Some((cos, sin)) = turns {
            // The largest turn, and both cones.
            let (a_cos, b_cos) = ((one - a_sin * a_sin).sqrt(), (one - b_sin * b_sin).sqrt());
            let with_a = (a_cos * *cos - a_sin * *sin, a_cos * *sin + a_sin * *cos);
            let with_both = (with_a.0 * b_cos - with_a.1 * b_sin, with_a.1 * b_cos + with_a.0 * b_sin);
            // Beyond two right angles it excludes nothing.
            let below = with_both.1.simd_ge(F::splat(simd, 0.0));
            excluded |= below & (-dot(&a, &b)).simd_lt(with_both.0 - 2.0 * ROUNDING);
        }
        !(excluded & known).to_bitmask() & ((1 << self.count) - 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::level::named;
    use crate::philox::{philox4x32, unit};

    /// Facets about the origin, small and large, in no order.
    fn facets(count: u32) -> Vec<[DVec3; 3]> {
        let cube = |i: u32| {
            let [a, b, c, _] = philox4x32([i, 0, 0, 0], [8, 9]).map(|u| 2.0 * unit(u) - 1.0);
            DVec3::new(a, b, c)
        };
        let around = |i| [1, 2, 3].map(|k| cube(4 * i) + [0.01, 0.1, 1.0][i as usize % 3] * cube(4 * i + k));
        (0..count).map(around).collect()
    }

    fn over(corners: &[[DVec3; 3]]) -> (SpecularTree, Vec<[DVec3; 3]>, Vec<DVec3>) {
        let boxes: Vec<_> = corners.iter().map(|[a, b, c]| (a.min(*b).min(*c), a.max(*b).max(*c))).collect();
        let tree = Tree::over(&boxes);
        let corners: Vec<_> = tree.order().iter().map(|&i| corners[i as usize]).collect();
        let normals: Vec<_> = corners.iter().map(|[a, b, c]| (b - a).cross(c - a).normalize()).collect();
        (SpecularTree::over(&tree, &corners, &normals, 2.0), corners, normals)
    }

    /// With any instructions the same facets are asked about, all that turn light are among them, and few others.
    #[test]
    fn facets_that_turn_light_are_asked_about_at_every_level() {
        let (tree, corners, normals) = over(&facets(3000));
        let (mut turned, mut asked) = (0, 0);
        for i in 0..300 {
            let [near, far] = [0, 1].map(|k| facets(1 + 2 * i + k)[(2 * i + k) as usize][0]);
            let (n_far, n_near) = [(1.0, 1.4), (1.5, 1.0)][i as usize % 2];
            let ends = Ends { far: Far::Point(3.0 * far), n_far, near, n_near };
            let question = Question::new(&ends, Turn::Refraction, tree.scale);
            let lists = ["baseline", "v3", "best"].map(|name| {
                let mut list = Vec::new();
                at_level!(named(name), simd => tree.collect(simd, &question, &mut list));
                list
            });
            assert!(lists.iter().all(|list| *list == lists[0]), "{i}");
            for place in 0..corners.len() {
                if ends.through_facet(&corners[place], normals[place]).is_some() {
                    assert!(lists[0].contains(&(place as u32)), "{i}: {place}");
                    turned += 1;
                }
            }
            asked += lists[0].len();
        }
        assert!(turned > 1000 && asked < 20 * turned, "{turned} turned, {asked} asked");
    }

    /// Every node but the one above all others has nine spheres or more, whatever is where: memory follows from that.
    #[test]
    fn nodes_are_full() {
        for count in [1, 16, 17, 1000, 3000] {
            let (tree, ..) = over(&facets(count));
            let others = &tree.nodes[..tree.nodes.len() - 1];
            assert!(others.iter().all(|node| (9..=16).contains(&node.count)), "{count}");
            assert!(tree.nodes.len() <= 1 + count as usize / 8, "{count}: {}", tree.nodes.len());
        }
        assert_eq!(size_of::<Node>(), 704);
    }
}
