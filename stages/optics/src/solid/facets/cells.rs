//! A grid of cells about a mesh: in each what lies there, near it how the surface runs, elsewhere how far it is.

use fearless_simd::Simd;
use fearless_simd::prelude::*;
use glam::{DVec3, Vec3};

use super::block::{Block, WIDE};
use super::lanes::{F, LANES, M, U, V, bits};

/// Cells along the longest side, at least (fewer only to save memory) and at most ...
const LEAST: f32 = 12.0;
const FEWEST: f32 = 48.0;
const MOST: f32 = 160.0;
/// ... and their width in between, in mean triangles (root of the mean area).
const WIDTH: f32 = 1.6;
/// Empty cells around the mesh, so that neighbours of cells near the surface exist.
const MARGIN: f32 = 3.0;
/// No clearance is said to be more cells than this.
const FARTHEST: u32 = 40;
/// A triangle belongs to cells that it comes this near to, in cells: what rounding may move a ray by.
const TOUCH: f32 = 2e-3;
/// Cells lie in memory in cubes of so many along each side, of which it is 2^2: what is near in space is near there.
const BRICK: usize = 4;
/// Marks the number of a [`Near`] among clearances, which are not negative.
const NEAR: u32 = 1 << 31;

/// Of the cells about a mesh, coordinates relative to its center, mm.
#[derive(Clone, Debug, PartialEq)]
pub struct Cells {
    pub(super) low: Vec3,
    pub(super) cell: f32,
    pub(super) counts: [usize; 3],
    /// Half the size of the mesh's bounding box.
    half: Vec3,
    pub(super) inverse: f32,
    /// mm; more than rounding makes of distances.
    pub(super) slack: f32,
    /// Of each cell: the clearance of all its points, or where to find its `Near`.
    values: Vec<u32>,
    near: Vec<Near>,
    blocks: Vec<Block>,
}

/// A cell that the surface runs through, or through one of its 26 neighbours. In one line of a cache.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(align(32))]
struct Near {
    /// In all 27 cells the surface has low <= p . normal <= high.
    normal: Vec3,
    low: f32,
    high: f32,
    /// Blocks of the cell itself.
    first: u32,
    count: u32,
}

/// What cells say of points in them, side by side.
pub(super) struct Known<S: Simd> {
    /// Of each cell, in cells.
    pub(super) corner: V<S>,
    /// Whether the surface is in it or beside it; else how far it is at least (mm).
    pub(super) near: M<S>,
    pub(super) clear: F<S>,
    /// As in [`Near`].
    pub(super) normal: V<S>,
    pub(super) low: F<S>,
    pub(super) high: F<S>,
    pub(super) first: [u32; LANES],
    pub(super) count: [u32; LANES],
}

impl Cells {
    /// About closed triangles, relative to the middle of their bounding box of half the size `half`. Where cells of the wanted width would need
    /// more than `most_bytes` they are made wider; `None` where that does not help.
    pub fn about(triangles: &[[DVec3; 3]], half: DVec3, most_bytes: usize) -> Option<Self> {
        let (mut cells, corners, lists) = Self::sized(triangles, half, most_bytes)?;
        cells.fill(&corners, &lists);
        Some(cells)
    }

    /// Whether [`about`](Self::about) makes them, for less than a tenth of its time.
    pub fn fit(triangles: &[[DVec3; 3]], half: DVec3, most_bytes: usize) -> bool {
        Self::sized(triangles, half, most_bytes).is_some()
    }

    /// Empty ones as wide as they have to be, the corners in their precision, and which triangles each has.
    fn sized(triangles: &[[DVec3; 3]], half: DVec3, most_bytes: usize) -> Option<(Self, Vec<[Vec3; 3]>, Lists)> {
        let corners: Vec<[Vec3; 3]> = triangles.iter().map(|t| t.map(|p| p.as_vec3())).collect();
        let area: f64 = triangles.iter().map(|[a, b, c]| 0.5 * (b - a).cross(c - a).length()).sum();
        let half = half.as_vec3();
        let longest = 2.0 * half.max_element();
        let width = WIDTH * (area / triangles.len() as f64).sqrt() as f32;
        if !(1e-15..1e15).contains(&longest) {
            return None;
        }
        let mut cell = width.clamp(longest / MOST, longest / FEWEST);
        while cell <= longest / LEAST {
            let cells = Self::empty(cell, half);
            let lists = cells.lists(&corners);
            let blocks: usize = lists.filled.iter().map(|&i| lists.of(i).len().div_ceil(WIDE)).sum();
            // Of the surface and beside it there are some five times as many as it fills.
            let near = 5 * lists.filled.len();
            if blocks * size_of::<Block>() + near * size_of::<Near>() + 4 * cells.count() <= most_bytes {
                return Some((cells, corners, lists));
            }
            cell *= 1.25;
        }
        None
    }

    fn empty(cell: f32, half: Vec3) -> Self {
        let inverse = 1.0 / cell;
        let counts = (2.0 * half * inverse + 2.0 * MARGIN).to_array();
        let counts = counts.map(|n| (n.ceil() as usize + 1).next_multiple_of(BRICK));
        let (low, slack) = (-half - MARGIN * cell, 2e-6 * half.max_element());
        Self { low, cell, counts, half, inverse, slack, values: Vec::new(), near: Vec::new(), blocks: Vec::new() }
    }

    fn count(&self) -> usize {
        self.counts.iter().product()
    }

    pub fn bytes(&self) -> usize {
        self.near.len() * size_of::<Near>() + self.blocks.len() * size_of::<Block>() + 4 * self.values.len()
    }

    /// Where a cell lies in memory.
    #[inline(always)]
    fn index(&self, place: [usize; 3]) -> usize {
        let ([x, y, z], [nx, ny, _]) = (place, self.counts);
        let brick = x / BRICK + nx / BRICK * (y / BRICK + ny / BRICK * (z / BRICK));
        x % BRICK + BRICK * (y % BRICK + BRICK * (z % BRICK + BRICK * brick))
    }

    /// Its number, row by row.
    fn number(&self, place: [usize; 3]) -> usize {
        place[0] + self.counts[0] * (place[1] + self.counts[1] * place[2])
    }

    /// The cell that lies there in memory.
    fn placed(&self, index: usize) -> [usize; 3] {
        let ([nx, ny, _], brick) = (self.counts, index / BRICK.pow(3));
        let corner = [brick % (nx / BRICK), brick / (nx / BRICK) % (ny / BRICK), brick / (nx / BRICK * (ny / BRICK))];
        let within = [index % BRICK, index / BRICK % BRICK, index / BRICK.pow(2) % BRICK];
        [0, 1, 2].map(|axis| BRICK * corner[axis] + within[axis])
    }

    /// Place of a point in units of cells.
    #[inline(always)]
    pub(super) fn scaled(&self, p: Vec3) -> Vec3 {
        (p - self.low) * self.inverse
    }

    /// The cell around it, or the nearest one.
    #[inline(always)]
    pub(super) fn place(&self, scaled: Vec3) -> [usize; 3] {
        // A negative number becomes 0.
        let [x, y, z] = self.counts;
        [(scaled.x as usize).min(x - 1), (scaled.y as usize).min(y - 1), (scaled.z as usize).min(z - 1)]
    }

    /// What the cells around some of these places know, or the nearest ones.
    #[inline(always)]
    pub(super) fn known<S: Simd>(&self, simd: S, asked: u64, scaled: &V<S>) -> Known<S> {
        let mut corner = *scaled;
        let mut place = [U::splat(simd, 0); 3];
        for ((place, corner), &n) in place.iter_mut().zip(&mut corner).zip(&self.counts) {
            *place = corner.max(0.0).min((n - 1) as f32).to_int();
            *corner = place.to_float();
        }
        // As in `index`.
        let [nx, ny] = [self.counts[0] / BRICK, self.counts[1] / BRICK].map(|n| n as u32);
        let [x, y, z] = place;
        let brick = (x >> 2) + ((y >> 2) + (z >> 2) * ny) * nx;
        let index = (x & 3) | ((y & 3) << 2) | ((z & 3) << 4) | (brick << 6);
        let (mut values, mut columns) = ([0; LANES], [[0.0; LANES]; 5]);
        let (mut first, mut count) = ([0; LANES], [0; LANES]);
        // Without a decision, so that memory is asked for all lanes at once.
        for lane in bits(asked) {
            let value = self.values[index.as_slice()[lane] as usize];
            values[lane] = value;
            let near = &self.near[if value & NEAR == 0 { 0 } else { (value & !NEAR) as usize }];
            for (column, x) in
                columns.iter_mut().zip([near.normal.x, near.normal.y, near.normal.z, near.low, near.high])
            {
                column[lane] = x;
            }
            (first[lane], count[lane]) = (near.first, near.count);
        }
        let values = U::load_array(simd, values);
        let near = values.simd_ge(NEAR);
        let [x, y, z, low, high] = columns;
        Known {
            corner,
            near,
            clear: F::from_bits(near.select(U::splat(simd, 0), values)),
            normal: [F::load_array(simd, x), F::load_array(simd, y), F::load_array(simd, z)],
            low: F::load_array(simd, low),
            high: F::load_array(simd, high),
            first,
            count,
        }
    }

    #[inline(always)]
    pub(super) fn blocks(&self, first: u32, count: u32) -> &[Block] {
        &self.blocks[first as usize..][..count as usize]
    }

    /// A distance (mm, >= 0) within which of `p` there is no point of the surface.
    #[inline(always)]
    pub fn clearance(&self, p: [f32; 3]) -> f32 {
        let p = Vec3::from(p);
        let outside = (p.abs() - self.half).max(Vec3::ZERO);
        if outside.max_element() > MARGIN * self.cell {
            return (outside.length() - self.slack).max(0.0);
        }
        let scaled = self.scaled(p);
        let place = self.place(scaled);
        let value = self.values[self.index(place)];
        let within = scaled - Vec3::new(place[0] as f32, place[1] as f32, place[2] as f32);
        // From the wall of the cell.
        let deep = within.min(1.0 - within).min_element().max(0.0) * self.cell;
        let clear = if value & NEAR == 0 {
            f32::from_bits(value) + deep
        } else {
            let near = &self.near[(value & !NEAR) as usize];
            let height = near.normal.dot(p);
            (near.low - height).max(height - near.high).min(self.cell + deep)
        };
        (clear - self.slack).max(0.0)
    }

    /// Triangles of the cell around a point.
    pub fn faces_about(&self, p: Vec3) -> impl Iterator<Item = u32> + '_ {
        let within = (p.abs() - self.half).max_element() <= MARGIN * self.cell;
        let value = if within { self.values[self.index(self.place(self.scaled(p)))] } else { 0 };
        let near = &self.near[if value & NEAR == 0 { 0 } else { (value & !NEAR) as usize }];
        self.blocks(near.first, near.count).iter().flat_map(Block::faces)
    }

    /// Whether nothing of the surface lies between two points, as far as the cell of the first one knows.
    #[inline(always)]
    pub fn is_free(&self, from: [f32; 3], to: [f32; 3]) -> bool {
        let (from, to) = (Vec3::from(from), Vec3::from(to));
        if (from.abs() - self.half).max_element() > MARGIN * self.cell {
            return false;
        }
        let place = self.place(self.scaled(from));
        let value = self.values[self.index(place)];
        let middle = Vec3::new(place[0] as f32, place[1] as f32, place[2] as f32) + 0.5;
        // Both among its neighbours, or nearly at their far side.
        let away = (self.scaled(to) - middle).abs().max((self.scaled(from) - middle).abs());
        if value & NEAR == 0 || away.max_element() > 1.5 - TOUCH {
            return false;
        }
        let near = &self.near[(value & !NEAR) as usize];
        let (one, other) = (near.normal.dot(from), near.normal.dot(to));
        one.max(other) < near.low - self.slack || one.min(other) > near.high + self.slack
    }

    /// Which triangles each cell has.
    fn lists(&self, corners: &[[Vec3; 3]]) -> Lists {
        let touched = |corners: &[Vec3; 3], met: &mut dyn FnMut(usize)| {
            let [a, b, c] = corners.map(|p| self.scaled(p));
            let (from, to) = (self.place(a.min(b).min(c) - TOUCH), self.place(a.max(b).max(c) + TOUCH));
            let normal = (b - a).cross(c - a);
            // Half the width of a cell along the normal.
            let reach = (0.5 + TOUCH) * normal.abs().element_sum() * (1.0 + 1e-5);
            for z in from[2]..=to[2] {
                for y in from[1]..=to[1] {
                    for x in from[0]..=to[0] {
                        let middle = Vec3::new(x as f32, y as f32, z as f32) + 0.5;
                        if normal.dot(middle - a).abs() <= reach {
                            met(self.number([x, y, z]));
                        }
                    }
                }
            }
        };
        let mut starts = vec![0_u32; self.count() + 1];
        for triangle in corners {
            touched(triangle, &mut |cell| starts[cell + 1] += 1);
        }
        let filled = (0..self.count()).filter(|&cell| starts[cell + 1] > 0).collect();
        for cell in 0..self.count() {
            starts[cell + 1] += starts[cell];
        }
        let mut next = starts.clone();
        let mut things = vec![0; *starts.last().expect("one more than cells") as usize];
        for (i, triangle) in corners.iter().enumerate() {
            touched(triangle, &mut |cell| {
                things[next[cell] as usize] = i as u32;
                next[cell] += 1;
            });
        }
        Lists { starts, things, filled }
    }

    fn fill(&mut self, corners: &[[Vec3; 3]], lists: &Lists) {
        let gaps = gaps(self.counts, &lists.filled);
        let normal = |i: &u32| {
            let [a, b, c] = corners[*i as usize];
            (b - a).cross(c - a)
        };
        let [width, rows, _] = self.counts;
        self.values = Vec::with_capacity(gaps.len());
        // What cells that are not near may be taken to say.
        self.near.push(Near::default());
        for index in 0..gaps.len() {
            let cell = self.number(self.placed(index));
            let gap = gaps[cell];
            if gap > 0 {
                self.values.push((self.cell * (gap as f32).sqrt() * (1.0 - 1e-6)).to_bits());
                continue;
            }
            // Its neighbours exist: the margin is wider than one cell.
            let around = || {
                let steps = (0..27).map(|k| (k % 3, k / 3 % 3, k / 9));
                steps.map(|(x, y, z)| cell + x + width * (y + rows * z) - (1 + width * (1 + rows)))
            };
            let sum: Vec3 = around().flat_map(|c| lists.of(c).iter().map(normal)).sum();
            let normal = sum.normalize_or(Vec3::Z);
            let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
            for &i in around().flat_map(|c| lists.of(c)) {
                for corner in corners[i as usize] {
                    let height = normal.dot(corner);
                    (low, high) = (low.min(height), high.max(height));
                }
            }
            let first = self.blocks.len() as u32;
            for some in lists.of(cell).chunks(WIDE) {
                let triangles = some.iter().map(|&i| (i, corners[i as usize].map(|p| p.to_array())));
                self.blocks.push(Block::of(triangles));
            }
            self.values.push(NEAR | self.near.len() as u32);
            self.near.push(Near { normal, low, high, first, count: self.blocks.len() as u32 - first });
        }
    }
}

/// Triangles by cell.
struct Lists {
    starts: Vec<u32>,
    things: Vec<u32>,
    /// Cells that have any.
    filled: Vec<usize>,
}

impl Lists {
    fn of(&self, cell: usize) -> &[u32] {
        &self.things[self.starts[cell] as usize..self.starts[cell + 1] as usize]
    }
}

/// The square of the distance, in cells, between every cell and the nearest filled one: 0 for neighbours.
///
/// Per axis two cells i apart have a gap of max(i - 1, 0): the least over the other cells of gap^2 + what the axes before say.
fn gaps(counts: [usize; 3], filled: &[usize]) -> Vec<u32> {
    let mut squares = vec![FARTHEST * FARTHEST; counts.iter().product()];
    filled.iter().for_each(|&cell| squares[cell] = 0);
    let strides = [1, counts[0], counts[0] * counts[1]];
    for axis in 0..3 {
        let (n, stride) = (counts[axis], strides[axis]);
        let mut column = vec![0; n];
        for start in 0..squares.len() {
            if start / stride % n != 0 {
                continue;
            }
            for (i, x) in column.iter_mut().enumerate() {
                *x = squares[start + i * stride];
            }
            for i in 0..n {
                let mut least = column[i];
                // Nothing that is further than the least so far can be less.
                for away in 1..n as u32 {
                    let gap = (away - 1) * (away - 1);
                    if gap >= least {
                        break;
                    }
                    let (before, behind) = (i.checked_sub(away as usize), i + away as usize);
                    let nearest = before.map_or(least, |j| column[j]).min(*column.get(behind).unwrap_or(&least));
                    least = least.min(nearest + gap);
                }
                squares[start + i * stride] = least;
            }
        }
    }
    squares
}
