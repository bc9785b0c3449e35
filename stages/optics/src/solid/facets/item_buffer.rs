//! A mesh as a point sees it: its triangles by the direction in which they lie, so that a look towards the point asks one list.

use std::f64::consts::FRAC_1_SQRT_2;
use std::hint::black_box;

use fearless_simd::Simd;
use fearless_simd::prelude::*;
use glam::{DVec2, DVec3};

use super::block::{Block, Crossing, Line, WIDE};
use super::lanes::{Crossings, F, LANES, U, V, bits};

/// Texels along the longer side, at least and at most, and their width in mean projected triangles.
const LEAST: f64 = 4.0;
const MOST: f64 = 1024.0;
const WIDTH: f64 = 1.5;
/// A triangle belongs to texels that it comes this near to, in texels.
const TOUCH: f64 = 2e-3;

/// What lies on the lines through a point, all of whose mesh lies within 45 degrees of one direction.
///
/// The plane across that direction through the mesh's center is divided into texels. A point at depth z (from the eye) is projected to it, and
/// keeps the depth as z0 / z - 1: planes stay planes, and what is far has small numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct ItemBuffer {
    /// Unit vectors, the last from the eye to the mesh.
    axes: [[f32; 3]; 3],
    /// Depth of the mesh's center, mm.
    depth: f32,
    /// Of the plane's lower corner, and one over the width of a texel.
    low: [f32; 2],
    texel: f32,
    inverse: f32,
    counts: [usize; 2],
    slack: f32,
    /// One more than there are.
    texels: Vec<Texel>,
    blocks: Vec<Block>,
}

/// The list of a texel, nearest to the eye first.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Texel {
    /// Its first block.
    first: u32,
    /// All behind the first block is further from the eye than this (depths as kept).
    behind: f32,
}

impl ItemBuffer {
    /// From `eye`, relative to the mesh's center as all coordinates are. Where texels of the wanted width would need more than `most_bytes` they
    /// are made wider; `None` where that does not help, or the eye is too near.
    pub fn from(eye: DVec3, triangles: &[[DVec3; 3]], half: DVec3, most_bytes: usize) -> Option<Self> {
        let depth = eye.length();
        let along = (-eye).try_normalize()?;
        let across = along.any_orthonormal_vector();
        // Right-handed about the way to the eye.
        let axes = [across, across.cross(along), along];
        // Projected corners and their inverse depths.
        let mut projected = Vec::with_capacity(triangles.len());
        for corners in triangles {
            let mut image = [DVec3::ZERO; 3];
            for (to, &p) in image.iter_mut().zip(corners) {
                let z = depth + along.dot(p);
                if z < FRAC_1_SQRT_2 * (p - eye).length() {
                    return None;
                }
                *to = DVec3::new(axes[0].dot(p) * depth / z, axes[1].dot(p) * depth / z, -along.dot(p) / z);
            }
            projected.push(image);
        }
        let corners = || projected.iter().flatten();
        let (low, high) = corners().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), &p| (l.min(p), h.max(p)));
        let size = (high - low).truncate();
        let area: f64 = projected.iter().map(|[a, b, c]| 0.5 * (b - a).cross(c - a).z.abs()).sum();
        let longest = size.max_element();
        let width = WIDTH * (area / triangles.len() as f64).sqrt();
        if !(1e-15..1e15).contains(&longest) {
            return None;
        }
        let mut texel = width.clamp(longest / MOST, longest / LEAST);
        while texel <= longest / LEAST {
            let buffer = Self::with_texels(texel, (axes, depth), &projected, (low, size), half);
            if buffer.bytes() <= most_bytes {
                return Some(buffer);
            }
            texel *= 1.25;
        }
        None
    }

    fn with_texels(
        texel: f64,
        (axes, depth): ([DVec3; 3], f64),
        projected: &[[DVec3; 3]],
        (low, size): (DVec3, DVec2),
        half: DVec3,
    ) -> Self {
        let low = low.truncate() - 0.5 * texel;
        let counts = ((size / texel).ceil().as_u64vec2() + 2).to_array().map(|n| n as usize);
        let place = |p: DVec3| ((p.truncate() - low) / texel, p.z);
        let mut lists = vec![Vec::new(); counts[0] * counts[1]];
        for (face, image) in projected.iter().enumerate() {
            let [a, b, c] = image.map(|p| place(p).0);
            let (from, to) = (a.min(b).min(c) - TOUCH, a.max(b).max(c) + TOUCH);
            let clip = |x: f64, n: usize| (x.max(0.0) as usize).min(n - 1);
            for y in clip(from.y, counts[1])..=clip(to.y, counts[1]) {
                for x in clip(from.x, counts[0])..=clip(to.x, counts[0]) {
                    let middle = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
                    // Wholly beyond one of its sides?
                    let beyond = [(a, b, c), (b, c, a), (c, a, b)].into_iter().any(|(p, q, r)| {
                        let n = (q - p).perp();
                        let n = if n.dot(r - p) < 0.0 { -n } else { n };
                        n.dot(middle - p) < -(0.5 + TOUCH) * n.abs().element_sum() * (1.0 + 1e-9)
                    });
                    if !beyond {
                        lists[x + counts[0] * y].push(face as u32);
                    }
                }
            }
        }
        let mut buffer = Self {
            axes: axes.map(|axis| axis.as_vec3().to_array()),
            depth: depth as f32,
            low: low.as_vec2().to_array(),
            texel: texel as f32,
            inverse: (1.0 / texel) as f32,
            counts,
            slack: 1e-6 * half.max_element() as f32,
            texels: Vec::with_capacity(lists.len() + 1),
            blocks: Vec::new(),
        };
        let nearest = |&face: &u32| projected[face as usize].iter().fold(f64::NEG_INFINITY, |most, p| most.max(p.z));
        for (i, list) in lists.iter_mut().enumerate() {
            list.sort_by(|a, b| nearest(b).total_cmp(&nearest(a)));
            let behind = list.get(WIDE).map_or(f32::NEG_INFINITY, |face| nearest(face) as f32);
            buffer.texels.push(Texel { first: buffer.blocks.len() as u32, behind });
            // Relative to the texel's middle as the questions are, lest digits are lost.
            let [x, y] = buffer.middle([i % counts[0], i / counts[0]]).map(f64::from);
            for some in list.chunks(WIDE) {
                let images = some.iter().map(|&face| {
                    let image = projected[face as usize];
                    (face, image.map(|p| [(p.x - x) as f32, (p.y - y) as f32, p.z as f32]))
                });
                buffer.blocks.push(Block::of(images));
            }
        }
        buffer.texels.push(Texel { first: buffer.blocks.len() as u32, behind: 0.0 });
        buffer
    }

    pub fn bytes(&self) -> usize {
        self.blocks.len() * size_of::<Block>() + self.texels.len() * size_of::<Texel>()
    }

    #[inline(always)]
    fn middle(&self, place: [usize; 2]) -> [f32; 2] {
        [self.low[0] + (place[0] as f32 + 0.5) * self.texel, self.low[1] + (place[1] as f32 + 0.5) * self.texel]
    }

    /// What lies between p and the eye, nearest to p first; t in mm from p. A start that rounding put behind the surface counts as one on it.
    #[inline(always)]
    pub fn towards<S: Simd>(&self, simd: S, p: [f32; 3], found: &mut Vec<Crossing>) {
        found.clear();
        let [a, b, c] = self.axes;
        let along = |axis: [f32; 3]| axis[0] * p[0] + axis[1] * p[1] + axis[2] * p[2];
        let (x, y, z) = (along(a), along(b), along(c));
        let inverse = 1.0 / (self.depth + z);
        let at = [x * self.depth * inverse, y * self.depth * inverse];
        let scaled = [(at[0] - self.low[0]) * self.inverse, (at[1] - self.low[1]) * self.inverse];
        // Behind the eye, or beside the mesh.
        let within = |i: usize| scaled[i] >= 0.0 && scaled[i] < self.counts[i] as f32;
        if !(inverse > 0.0 && within(0) && within(1)) {
            return;
        }
        let place = [scaled[0] as usize, scaled[1] as usize];
        let middle = self.middle(place);
        let texel = place[0] + self.counts[0] * place[1];
        // mm on the way to the eye, of inverse depths.
        let far = (self.depth * self.depth + at[0] * at[0] + at[1] * at[1]).sqrt();
        let line = Line::upright(at[0] - middle[0], at[1] - middle[1]);
        self.within(simd, texel, line, -z * inverse, far, found);
    }

    /// The same of the points that are `asked`, by bits.
    #[inline(never)]
    pub fn all_towards<S: Simd>(&self, simd: S, asked: u64, p: &V<S>, found: &mut Crossings) {
        found.clear();
        found.list.reserve(2 * LANES);
        simd.vectorize(
            #[inline(always)]
            || {
                let [a, b, c] = self.axes;
                let along = |axis: [f32; 3]| p[0] * axis[0] + p[1] * axis[1] + p[2] * axis[2];
                let [x, y, z] = [along(a), along(b), along(c)];
                let inverse = 1.0 / (z + self.depth);
                let at = [x * self.depth * inverse, y * self.depth * inverse];
                let own = -z * inverse;
                let far = (at[0] * at[0] + self.depth * self.depth + at[1] * at[1]).sqrt();
                let (mut within, mut texel) = (inverse.simd_gt(0.0), U::splat(simd, 0));
                let mut from_middle = at;
                for (i, stride) in [(0, 1), (1, self.counts[0] as u32)] {
                    let scaled = (at[i] - self.low[i]) * self.inverse;
                    within &= scaled.simd_ge(0.0) & scaled.simd_lt(self.counts[i] as f32);
                    let place: U<S> = scaled.max(0.0).min((self.counts[i] - 1) as f32).to_int();
                    let whole: F<S> = place.to_float();
                    from_middle[i] = at[i] - ((whole + 0.5) * self.texel + self.low[i]);
                    texel += place * stride;
                }
                let asked = asked & within.to_bitmask();
                // Memory is asked for all of them at once, lists that are empty included.
                let last = self.blocks.len() - 1;
                let touched: f32 = bits(asked)
                    .map(
                        #[inline(always)]
                        |lane| {
                            let first = self.texels[texel.as_slice()[lane] as usize].first as usize;
                            self.blocks[first.min(last)].touch()
                        },
                    )
                    .sum();
                black_box(touched);
                for lane in 0..LANES {
                    if asked >> lane & 1 == 1 {
                        let line = Line::upright(from_middle[0].as_slice()[lane], from_middle[1].as_slice()[lane]);
                        let (own, far) = (own.as_slice()[lane], far.as_slice()[lane]);
                        self.within(simd, texel.as_slice()[lane] as usize, line, own, far, &mut found.list);
                    }
                    found.ends[lane] = found.list.len();
                }
            },
        );
    }

    /// Appends, in order, what lies on a line in a texel between a point of depth `own` and the eye.
    #[inline(always)]
    fn within<S: Simd>(&self, simd: S, texel: usize, line: Line, own: f32, far: f32, found: &mut Vec<Crossing>) {
        let start = found.len();
        let way = |depth: f32| far * (depth - own) / ((1.0 + own) * (1.0 + depth));
        let [Texel { first, behind }, next] = [self.texels[texel], self.texels[texel + 1]];
        let mut blocks = &self.blocks[first as usize..next.first as usize];
        if blocks.len() > 1 && way(behind) < -2.0 * self.slack {
            blocks = &blocks[..1];
        }
        for block in blocks {
            block.meet_upright(
                simd,
                &line,
                #[inline(always)]
                |c| {
                    let t = way(c.t);
                    if t > -self.slack {
                        found.push(Crossing { t: t.max(0.0), ..c });
                    }
                },
            );
        }
        sort(&mut found[start..]);
    }
}

/// By t; there are few.
#[inline(always)]
fn sort(list: &mut [Crossing]) {
    for i in 1..list.len() {
        let mut j = i;
        while j > 0 && list[j].t < list[j - 1].t {
            list.swap(j, j - 1);
            j -= 1;
        }
    }
}
