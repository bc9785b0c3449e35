//! Eight triangles against one line.

use fearless_simd::prelude::*;
use fearless_simd::{Simd, f32x8, u32x8};

/// Triangles of a block.
pub const WIDE: usize = 8;

/// Up to eight triangles, columns by corner and axis. In whole lines of a cache.
#[derive(Clone, Debug, PartialEq)]
#[repr(align(64))]
pub struct Block {
    corners: [[[f32; WIDE]; 3]; 3],
    faces: [u32; WIDE],
}

/// In place of a face where there are fewer than eight.
const NONE: u32 = u32::MAX;

/// Where a line crosses the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    pub t: f32,
    pub face: u32,
    /// Out of the solid, along the line.
    pub leaves: bool,
}

/// A line, and what is needed to project points across it (Woop, Benthin and Wald 2013).
#[derive(Clone, Copy, Debug)]
pub struct Line {
    origin: [f32; 3],
    /// x, y, z of the projection: z is the axis along which the line runs most, and the three are right-handed.
    axes: [usize; 3],
    shear: [f32; 3],
}

/// Twice what two rounded products and their difference may be off, relative to the products.
const SURE: f32 = 2.4e-7;

impl Line {
    #[inline(always)]
    pub fn new(origin: [f32; 3], along: [f32; 3]) -> Self {
        let size = along.map(f32::abs);
        let z = if size[0] >= size[1] && size[0] >= size[2] {
            0
        } else if size[1] >= size[2] {
            1
        } else {
            2
        };
        let (x, y) = ((z + 1) % 3, (z + 2) % 3);
        let axes = if along[z] < 0.0 { [y, x, z] } else { [x, y, z] };
        let inverse = 1.0 / along[z];
        Self { origin, axes, shear: [along[axes[0]] * inverse, along[axes[1]] * inverse, inverse] }
    }

    /// Parallel to the third axis, and along it.
    #[inline(always)]
    pub fn upright(x: f32, y: f32) -> Self {
        Self { origin: [x, y, 0.0], axes: [0, 1, 2], shear: [0.0, 0.0, 1.0] }
    }

    fn project(&self, p: [f32; 3]) -> [f32; 3] {
        let p = self.axes.map(|axis| p[axis] - self.origin[axis]);
        [p[0] - self.shear[0] * p[2], p[1] - self.shear[1] * p[2], self.shear[2] * p[2]]
    }

    /// Where it crosses a triangle; decided by exact signs.
    fn crosses(&self, corners: [[f32; 3]; 3]) -> Option<(f32, bool)> {
        let [a, b, c] = corners.map(|p| self.project(p));
        let sign = side(b, c);
        if sign == 0 || side(c, a) != sign || side(a, b) != sign {
            return None;
        }
        let [u, v, w] = [area(b, c), area(c, a), area(a, b)];
        let (low, high) = (a[2].min(b[2]).min(c[2]), a[2].max(b[2]).max(c[2]));
        let t = (u * a[2] + v * b[2] + w * c[2]) / (u + v + w);
        // Seen on edge: anywhere within it.
        let t = if t.is_nan() { 0.5 * (low + high) } else { t.clamp(low, high) };
        // Counterclockwise, seen along the line: its normal runs along it.
        Some((t, sign > 0))
    }
}

fn area(p: [f32; 3], q: [f32; 3]) -> f32 {
    p[0] * q[1] - p[1] * q[0]
}

/// The sign of the area of the triangle of the line, p and q: f64 holds products of f32 exactly.
fn side(p: [f32; 3], q: [f32; 3]) -> i32 {
    let [p, q] = [p, q].map(|p| p.map(f64::from));
    let (one, other) = (p[0] * q[1], p[1] * q[0]);
    // Where it is 0, of the line moved by (e, e^2).
    let tie = if p[1] == q[1] { sign(q[0] - p[0]) } else { sign(p[1] - q[1]) };
    if one == other { tie } else { sign(one - other) }
}

fn sign(x: f64) -> i32 {
    i32::from(x > 0.0) - i32::from(x < 0.0)
}

impl Block {
    /// Numbers of its triangles.
    pub fn faces(&self) -> impl Iterator<Item = u32> + '_ {
        self.faces.iter().copied().filter(|&face| face != NONE)
    }

    /// Of one to eight triangles and their numbers.
    pub fn of(triangles: impl ExactSizeIterator<Item = (u32, [[f32; 3]; 3])>) -> Self {
        let count = triangles.len();
        assert!((1..=WIDE).contains(&count), "a block holds 1 to {WIDE} triangles, not {count}");
        let mut block = Self { corners: [[[0.0; WIDE]; 3]; 3], faces: [NONE; WIDE] };
        for (i, (face, corners)) in triangles.enumerate() {
            block.faces[i] = face;
            for (columns, corner) in block.corners.iter_mut().zip(corners) {
                for (column, x) in columns.iter_mut().zip(corner) {
                    column[i] = x;
                }
            }
        }
        block
    }

    fn triangle(&self, i: usize) -> [[f32; 3]; 3] {
        self.corners.map(|columns| columns.map(|column| column[i]))
    }

    /// Something of each of its lines in the cache: to have asked for all of them, sum it up.
    #[inline(always)]
    pub fn touch(&self) -> f32 {
        self.corners[0][0][0]
            + self.corners[0][2][0]
            + self.corners[1][1][0]
            + self.corners[2][0][0]
            + self.corners[2][2][0]
    }

    /// Calls `met` for every triangle that the line crosses.
    #[inline(always)]
    pub fn meet<S: Simd>(&self, simd: S, line: &Line, met: impl FnMut(Crossing)) {
        let mut corners = [[f32x8::splat(simd, 0.0); 3]; 3];
        for (to, columns) in corners.iter_mut().zip(&self.corners) {
            // No `map`: what is not inlined loses the vector instructions.
            let [i, j, k] = line.axes;
            let x = f32x8::from_slice(simd, &columns[i]) - line.origin[i];
            let y = f32x8::from_slice(simd, &columns[j]) - line.origin[j];
            let z = f32x8::from_slice(simd, &columns[k]) - line.origin[k];
            *to = [x - z * line.shear[0], y - z * line.shear[1], z * line.shear[2]];
        }
        self.meet_projected(simd, corners, line, met);
    }

    /// The same for lines along the third axis.
    #[inline(always)]
    pub fn meet_upright<S: Simd>(&self, simd: S, line: &Line, met: impl FnMut(Crossing)) {
        let mut corners = [[f32x8::splat(simd, 0.0); 3]; 3];
        for (to, [x, y, z]) in corners.iter_mut().zip(&self.corners) {
            *to = [
                f32x8::from_slice(simd, x) - line.origin[0],
                f32x8::from_slice(simd, y) - line.origin[1],
                f32x8::from_slice(simd, z),
            ];
        }
        self.meet_projected(simd, corners, line, met);
    }

    #[inline(always)]
    fn meet_projected<S: Simd>(
        &self,
        simd: S,
        [a, b, c]: [[f32x8<S>; 3]; 3],
        line: &Line,
        mut met: impl FnMut(Crossing),
    ) {
        let zero = f32x8::splat(simd, 0.0);
        // Twice the areas, and whether their signs may be wrong.
        let mut areas = [zero; 3];
        let (mut positive, mut negative) = (zero.simd_gt(zero), zero.simd_gt(zero));
        let mut unsure = positive;
        for (area, (p, q)) in areas.iter_mut().zip([(b, c), (c, a), (a, b)]) {
            let (one, other) = (p[0] * q[1], p[1] * q[0]);
            *area = one - other;
            let doubt = (one.abs() + other.abs()) * SURE;
            let sure = area.abs().simd_gt(doubt);
            positive |= sure & area.simd_gt(zero);
            negative |= sure & area.simd_lt(zero);
            unsure |= !sure;
        }
        // With one sure sign of either kind the line passes by, whatever the third.
        let here = (!u32x8::from_slice(simd, &self.faces).simd_eq(NONE)).to_bitmask();
        let by = (positive & negative).to_bitmask();
        let unsure = unsure.to_bitmask() & !by & here;
        let mut hits = here & !by & !unsure;
        if hits != 0 {
            let [u, v, w] = areas;
            let low = a[2].min(b[2]).min(c[2]);
            let high = a[2].max(b[2]).max(c[2]);
            let t = ((u * a[2] + v * b[2] + w * c[2]) / (u + v + w)).max(low).min(high).to_array();
            let positive = positive.to_bitmask();
            while hits != 0 {
                let i = hits.trailing_zeros() as usize;
                hits &= hits - 1;
                met(Crossing { t: t[i], face: self.faces[i], leaves: positive >> i & 1 == 1 });
            }
        }
        let mut rest = unsure;
        while rest != 0 {
            let i = rest.trailing_zeros() as usize;
            rest &= rest - 1;
            if let Some((t, leaves)) = line.crosses(self.triangle(i)) {
                met(Crossing { t, face: self.faces[i], leaves });
            }
        }
    }
}
