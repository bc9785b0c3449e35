//! A mesh as a point sees it: its triangles by the direction in which they lie, so that a look towards the point asks one list.

use std::f64::consts::FRAC_1_SQRT_2;

use fearless_simd::Simd;
use glam::{DVec2, DVec3};

use super::block::{Block, Crossing, Line, WIDE};

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
pub struct Seen {
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
    /// Where the blocks of each texel begin; one more than texels.
    starts: Vec<u32>,
    blocks: Vec<Block>,
}

impl Seen {
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
            let seen = Self::with_texels(texel, (axes, depth), &projected, (low, size), half);
            if seen.bytes() <= most_bytes {
                return Some(seen);
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
        let mut seen = Self {
            axes: axes.map(|axis| axis.as_vec3().to_array()),
            depth: depth as f32,
            low: low.as_vec2().to_array(),
            texel: texel as f32,
            inverse: (1.0 / texel) as f32,
            counts,
            slack: 1e-6 * half.max_element() as f32,
            starts: Vec::with_capacity(lists.len() + 1),
            blocks: Vec::new(),
        };
        for (i, list) in lists.iter().enumerate() {
            seen.starts.push(seen.blocks.len() as u32);
            // Relative to the texel's middle as the questions are, lest digits are lost.
            let [x, y] = seen.middle([i % counts[0], i / counts[0]]).map(f64::from);
            for some in list.chunks(WIDE) {
                let images = some.iter().map(|&face| {
                    let image = projected[face as usize];
                    (face, image.map(|p| [(p.x - x) as f32, (p.y - y) as f32, p.z as f32]))
                });
                seen.blocks.push(Block::of(images));
            }
        }
        seen.starts.push(seen.blocks.len() as u32);
        seen
    }

    pub fn bytes(&self) -> usize {
        self.blocks.len() * size_of::<Block>() + 4 * self.starts.len()
    }

    fn middle(&self, place: [usize; 2]) -> [f32; 2] {
        [0, 1].map(|i| self.low[i] + (place[i] as f32 + 0.5) * self.texel)
    }

    /// Appends what lies between p and the eye, nearest to p first; t in mm from p. A start that rounding put behind the surface counts as one on it.
    #[inline(always)]
    pub fn towards<S: Simd>(&self, simd: S, p: [f32; 3], found: &mut Vec<Crossing>) {
        found.clear();
        let [x, y, z] = self.axes.map(|axis| axis[0] * p[0] + axis[1] * p[1] + axis[2] * p[2]);
        let inverse = 1.0 / (self.depth + z);
        let at = [x * self.depth * inverse, y * self.depth * inverse];
        let scaled = [0, 1].map(|i| (at[i] - self.low[i]) * self.inverse);
        // Behind the eye, or beside the mesh.
        if !(inverse > 0.0 && (0..2).all(|i| scaled[i] >= 0.0 && scaled[i] < self.counts[i] as f32)) {
            return;
        }
        let place = scaled.map(|x| x as usize);
        let middle = self.middle(place);
        let texel = place[0] + self.counts[0] * place[1];
        let own = -z * inverse;
        // mm on the way to the eye, of inverse depths.
        let far = (self.depth * self.depth + at[0] * at[0] + at[1] * at[1]).sqrt();
        let line = Line::upright(at[0] - middle[0], at[1] - middle[1]);
        for block in &self.blocks[self.starts[texel] as usize..self.starts[texel + 1] as usize] {
            block.meet(
                simd,
                &line,
                #[inline(always)]
                |c| {
                    let t = far * (c.t - own) / ((1.0 + own) * (1.0 + c.t));
                    if t > -self.slack {
                        found.push(Crossing { t: t.max(0.0), ..c });
                    }
                },
            );
        }
        found.sort_by(|a, b| a.t.total_cmp(&b.t));
    }
}
