//! A solid bounded by a closed surface of triangles.
//!
//! Invariant: a line crosses the surface an even number of times, whatever edge or vertex it is aimed at. Which triangles it crosses
//! is decided in the plane across the line by the signs of 2 x 2 determinants of the projected vertices. A vertex is projected alike
//! for all its triangles, the signs are those of exact arithmetic, and where a determinant is exactly 0 the line counts as
//! shifted by an infinitesimal (e, e^2). So it crosses the projected triangles as in exact geometry a line crosses a closed surface.

mod line;

use std::cell::Cell;
use std::cmp::Ordering;
use std::sync::{Arc, OnceLock};

use fearless_simd::Simd;
use glam::DVec3;

use super::bvh::{Tree, Wide};
use super::crossing::Ends;
use super::facets::{Cells, ItemBuffer};
use super::memo::Memo;
use super::rounded::Rounded;
use super::specular_tree::{SpecularTree, Turn};
use super::{Chord, Start};
use line::Line;

/// Cells of the distance grid along the longest side.
const CELLS: f64 = 40.0;

/// What a closed, consistently oriented surface of triangles encloses: outward normals by the right-hand rule.
///
/// Faces are numbered in the order of its tree.
#[derive(Clone, Debug, PartialEq)]
pub struct Mesh {
    /// Corners are relative to this point, which keeps their digits.
    center: DVec3,
    corners: Vec<[DVec3; 3]>,
    normals: Vec<DVec3>,
    tree: Tree,
    /// The same for lines; `None` where it would be too deep for that.
    wide: Option<Wide>,
    /// Half the size of the bounding box.
    half: DVec3,
    /// Made when first asked for, as is what follows.
    grid: OnceLock<Grid>,
    specular: OnceLock<SpecularTree>,
    rounded: OnceLock<Rounded>,
    cells: OnceLock<Option<Cells>>,
    /// From the last points that were asked for: that of the light, that of the camera.
    item_buffers: Memo<DVec3, Option<Arc<ItemBuffer>>>,
}

/// What one thread has built so far of the parts of meshes that take long, for tests that count it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Built {
    pub trees: usize,
    pub cells: usize,
}

thread_local! {
    static BUILT: Cell<Built> = const { Cell::new(Built { trees: 0, cells: 0 }) };
}

impl Built {
    /// By this thread.
    pub fn here() -> Self {
        BUILT.get()
    }

    fn add(trees: usize, cells: usize) {
        let so_far = Self::here();
        BUILT.set(Self { trees: so_far.trees + trees, cells: so_far.cells + cells });
    }
}

/// The two forms in single precision may have so many bytes.
const CELLS_BYTES: usize = 40 << 20;
const ITEM_BUFFER_BYTES: usize = 12 << 20;

/// Distances from the surface at the middles of cubes that fill the bounding box, each found when first asked for.
#[derive(Clone, Debug, PartialEq)]
struct Grid {
    cell: f64,
    counts: [usize; 3],
    distances: Vec<OnceLock<f32>>,
}

/// Where a line crosses a triangle.
#[derive(Clone, Copy, Debug)]
struct Crossing {
    t: f64,
    face: u32,
    /// +1 into the solid, -1 out of it.
    turn: i32,
}

impl Mesh {
    /// The solid within triangles of vertices (mm) that are known to be closed and oriented.
    ///
    /// # Panics
    /// Without triangles, or with an index beyond the vertices.
    pub fn new(vertices: &[[f64; 3]], triangles: &[[u32; 3]]) -> Self {
        assert!(!triangles.is_empty(), "a mesh has triangles");
        Built::add(1, 0);
        let nowhere = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let at = |i: u32| DVec3::from(vertices[i as usize]);
        let used = triangles.iter().flatten();
        let (low, high) = used.fold(nowhere, |(low, high), &i| (low.min(at(i)), high.max(at(i))));
        let center = 0.5 * (low + high);
        let half = (high - center).max(center - low);
        let corners_of = |triangle: &[u32; 3]| triangle.map(|i| at(i) - center);
        let around = |[a, b, c]: [DVec3; 3]| (a.min(b).min(c), a.max(b).max(c));
        let boxes: Vec<_> = triangles.iter().map(|triangle| around(corners_of(triangle))).collect();
        let (tree, wide) = Tree::with_wide(&boxes);
        drop(boxes);
        let corners: Vec<[DVec3; 3]> = tree.order().iter().map(|&i| corners_of(&triangles[i as usize])).collect();
        let normals = corners.iter().map(|[a, b, c]| (b - a).cross(c - a).normalize_or_zero()).collect();
        Self {
            center,
            corners,
            normals,
            tree,
            wide,
            half,
            grid: OnceLock::new(),
            specular: OnceLock::new(),
            rounded: OnceLock::new(),
            cells: OnceLock::new(),
            item_buffers: Memo::default(),
        }
    }

    pub fn triangles(&self) -> usize {
        self.corners.len()
    }

    /// What [`Cells`] and [`ItemBuffer`] are relative to.
    pub fn center(&self) -> DVec3 {
        self.center
    }

    /// Its triangles in a grid, for many short questions; `None` where they would need too much memory.
    pub fn cells(&self) -> Option<&Cells> {
        let about = || {
            Built::add(0, 1);
            Cells::about(&self.corners, self.half, CELLS_BYTES)
        };
        self.cells.get_or_init(about).as_ref()
    }

    /// Whether [`cells`](Self::cells) are there for who asks; they are not made for that.
    pub fn has_cells(&self) -> bool {
        self.cells.get().map_or_else(|| Cells::fit(&self.corners, self.half, CELLS_BYTES), Option::is_some)
    }

    /// Its triangles as they lie on lines through a point, for many looks towards it; `None` where that is too near, or it
    /// would need too much memory.
    pub fn item_buffer(&self, eye: DVec3) -> Option<Arc<ItemBuffer>> {
        self.item_buffers.get(eye - self.center, |&eye| {
            ItemBuffer::from(eye, &self.corners, self.half, ITEM_BUFFER_BYTES).map(Arc::new)
        })
    }

    pub(super) fn bounds(&self) -> (DVec3, DVec3) {
        (self.center - self.half, self.center + self.half)
    }

    /// Outward, of a face.
    pub fn normal(&self, face: u32) -> DVec3 {
        self.normals[face as usize]
    }

    /// The product of that normal and the points of the face, relative to the [`center`](Self::center), mm.
    pub fn offset(&self, face: u32) -> f64 {
        self.normal(face).dot(self.corners[face as usize][0])
    }

    /// As [`Rounded::at`].
    pub(super) fn rounded(&self, face: u32, p: DVec3) -> (DVec3, impl Fn(DVec3) -> DVec3) {
        let rounded = self.rounded.get_or_init(|| Rounded::over(&self.corners, &self.normals));
        rounded.at(face, &self.corners[face as usize], self.normals[face as usize], p - self.center)
    }

    pub(super) fn contains(&self, p: DVec3) -> bool {
        if (p - self.center).abs().cmpgt(self.half).any() {
            return false;
        }
        // Any direction would do; this one lies in no plane that people draw.
        let direction = DVec3::new(0.436_436, 0.872_871, 0.218_218).normalize();
        let mut turns = 0;
        self.crossings(p, direction, 0.0, |c| turns -= if c.t > 0.0 { c.turn } else { 0 });
        turns > 0
    }

    /// What [`super::Solid::cut`] says of the ray from `eye`, by the item buffer from there: which triangles it crosses is decided in single precision,
    /// where it crosses them is not.
    #[inline(always)]
    pub fn cut_by_item_buffer<S: Simd>(
        &self,
        simd: S,
        (eye, buffer): (DVec3, &ItemBuffer),
        direction: DVec3,
        chords: &mut Vec<Chord>,
    ) {
        let from = eye - self.center;
        let size = self.half.length();
        // Behind all of it.
        let far = size - from.dot(direction);
        let mut found = Vec::new();
        buffer.towards(simd, (from + far * direction).as_vec3().to_array(), &mut found);
        let mut entered = None;
        for c in found.iter().rev() {
            let (n, a) = (self.normals[c.face as usize], self.corners[c.face as usize][0]);
            let t = n.dot(a - from) / n.dot(direction);
            // Aslant the plane is met anywhere.
            let near = far - f64::from(c.t);
            let t = if (t - near).abs() < 1e-4 * size { t } else { near };
            match entered {
                // Towards the eye it would leave.
                None if c.leaves => entered = Some((t, c.face)),
                Some((enter, into)) if !c.leaves => {
                    chords.push(Chord { enter, leave: t.max(enter), into, out_of: c.face });
                    entered = None;
                }
                _ => {}
            }
        }
    }

    pub(super) fn cut(&self, origin: DVec3, direction: DVec3, start: Option<Start>, chords: &mut Vec<Chord>) {
        let mut crossings = Vec::new();
        // What lies so near to a start on the surface is rounding.
        let near = start.map_or(0.0, |_| 1e-12 * (self.half.max_element() + self.center.abs().max_element()));
        let (mut about, mut beyond) = (0, 0);
        self.crossings(origin, direction, -near, |c| {
            if c.t > -near && start.is_none_or(|s| s.face != c.face) {
                beyond += if c.t > near { c.turn } else { 0 };
                about += usize::from(c.t <= near);
                crossings.push(c);
            }
        });
        if crossings.is_empty() && start.is_none_or(|s| !s.inside) {
            return;
        }
        crossings.sort_unstable_by(|a, b| a.t.total_cmp(&b.t).then(a.face.cmp(&b.face)));
        // From the inside a ray leaves once more often than it enters. What is far away tells whether anything near is real.
        let mut inside = start.map_or(beyond < 0, |s| s.inside);
        if about > 0 {
            let wanted = -i32::from(inside) - beyond;
            let real = crossings[..about].iter().find(|c| c.turn == wanted).map(|c| Crossing { t: c.t.max(0.0), ..*c });
            crossings.splice(..about, real);
        }
        let mut enter = Chord { enter: f64::NEG_INFINITY, leave: f64::INFINITY, into: 0, out_of: 0 };
        for c in crossings {
            if c.turn < 0 && inside {
                chords.push(Chord { leave: c.t, out_of: c.face, ..enter });
                inside = false;
            } else if c.turn > 0 && !inside {
                enter = Chord { enter: c.t, into: c.face, ..enter };
                inside = true;
            }
        }
    }

    /// Every crossing of the line from `from` on, and some before that.
    #[inline]
    fn crossings(&self, origin: DVec3, direction: DVec3, from: f64, mut met: impl FnMut(Crossing)) {
        let line = Line::new(origin - self.center, direction, self.half.max_element());
        let mut look = |place: usize| {
            if let Some((t, turn)) = line.meets(&self.corners[place]) {
                met(Crossing { t, face: place as u32, turn });
            }
        };
        let wide = self.wide.as_ref();
        if wide.is_none_or(|wide| !wide.visit(line.origin, direction, from, line.slack, &mut look)) {
            self.tree.visit(|low, high| line.may_meet(low, high, from), |places| places.for_each(&mut look));
        }
    }

    /// The plane of the facet about a point that comes nearest to it: its unit normal outwards, and its height (mm) above the point along that; `None` where no
    /// facet is about, or there are no [`cells`](Self::cells). It does not depend on the order of the triangles.
    pub fn plane_near(&self, p: DVec3) -> Option<(DVec3, f64)> {
        let q = p - self.center;
        let plane = |face: u32| {
            let normal = self.normals[face as usize];
            (normal, normal.dot(self.corners[face as usize][0] - q))
        };
        let order = |(n, h): &(DVec3, f64), (m, other): &(DVec3, f64)| {
            let by_normal = || n.to_array().into_iter().zip(m.to_array()).map(|(a, b)| a.total_cmp(&b));
            h.abs().total_cmp(&other.abs()).then_with(|| by_normal().find(|o| o.is_ne()).unwrap_or(Ordering::Equal))
        };
        self.cells()?.faces_about(q.as_vec3()).map(plane).min_by(order)
    }

    /// Points of its facets at which Snell's law takes light from the far end to the near one; those on an edge may come twice.
    pub fn refractions(&self, ends: &Ends, found: &mut dyn FnMut(DVec3)) {
        self.turns(ends, Turn::Refraction, Ends::through_facet, found);
    }

    /// The same of the law of reflection, on either side of them.
    pub fn reflections(&self, ends: &Ends, found: &mut dyn FnMut(DVec3)) {
        self.turns(ends, Turn::Reflection, Ends::by_facet, found);
    }

    /// What `on` finds on facets.
    fn turns(
        &self,
        ends: &Ends,
        turn: Turn,
        on: impl Fn(&Ends, &[DVec3; 3], DVec3) -> Option<DVec3>,
        found: &mut dyn FnMut(DVec3),
    ) {
        let ends = ends.moved(|p| p - self.center, |w| w);
        let over_all = || SpecularTree::over(&self.tree, &self.corners, &self.normals, self.half.max_element());
        let mut all = Vec::new();
        self.specular.get_or_init(over_all).visit(&ends, turn, |place| {
            all.extend(on(&ends, &self.corners[place], self.normals[place]).map(|p| p + self.center));
        });
        // Sums over them are rounded alike whatever the tree.
        all.sort_unstable_by(|p, q| {
            let axes = [0, 1, 2].map(|axis| p[axis].total_cmp(&q[axis]));
            axes[0].then(axes[1]).then(axes[2])
        });
        all.into_iter().for_each(found);
    }

    /// At most the distance from the surface: exact near it, from the grid elsewhere.
    pub(super) fn clearance(&self, p: DVec3) -> f64 {
        let q = p - self.center;
        let outside = (q.abs() - self.half).max(DVec3::ZERO).length();
        // 1e-14 of the coordinates is more than what these differences round.
        let rounding = 1e-14 * (p.abs().max_element() + self.center.abs().max_element());
        if outside > self.half.max_element() {
            return (outside - rounding).max(0.0);
        }
        let grid = self.grid.get_or_init(|| Grid::over(self.half));
        let (bound, at_most) = grid.at(q, self);
        let clear = if bound > grid.cell { bound } else { self.distance(q, at_most).max(bound) };
        (clear.max(outside) - rounding).max(0.0)
    }

    /// Distance of a point (relative to the center) from the surface, known to be at most `at_most`.
    fn distance(&self, q: DVec3, at_most: f64) -> f64 {
        let square = self.tree.nearest(q, at_most * at_most * (1.0 + 1e-12), |places| {
            self.corners[places].iter().map(|corners| distance_squared(q, corners)).fold(f64::INFINITY, f64::min)
        });
        square.sqrt()
    }
}

impl Grid {
    fn over(half: DVec3) -> Self {
        let cell = 2.0 * half.max_element() / CELLS;
        let counts = (2.0 * half / cell).to_array().map(|n| (n.ceil() as usize).max(1));
        Self { cell, counts, distances: vec![OnceLock::new(); counts.iter().product()] }
    }

    fn middle(&self, place: [usize; 3], half: DVec3) -> DVec3 {
        DVec3::from(place.map(|i| i as f64 + 0.5)) * self.cell - half
    }

    /// Bounds of the distance from the surface at `q`: at least, at most.
    #[inline]
    fn at(&self, q: DVec3, mesh: &Mesh) -> (f64, f64) {
        let scaled = (q + mesh.half) / self.cell;
        // A negative number becomes 0.
        let place = [0, 1, 2].map(|axis| (scaled[axis] as usize).min(self.counts[axis] - 1));
        let index = place[0] + self.counts[0] * (place[1] + self.counts[1] * place[2]);
        let middle = self.middle(place, mesh.half);
        let distance = *self.distances[index].get_or_init(|| mesh.distance(middle, f64::INFINITY) as f32);
        let (distance, away) = (f64::from(distance), (q - middle).length());
        // f32 rounds by 6e-8.
        (distance * (1.0 - 1e-7) - away, distance * (1.0 + 1e-7) + away)
    }
}

/// The square of the distance of a point from a triangle (Ericson, Real-Time Collision Detection, 5.1.5).
pub fn distance_squared(p: DVec3, &[a, b, c]: &[DVec3; 3]) -> f64 {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return ap.length_squared();
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return bp.length_squared();
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return (ap - d1 / (d1 - d3) * ab).length_squared();
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return cp.length_squared();
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return (ap - d2 / (d2 - d6) * ac).length_squared();
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        let along = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return (bp - along * (c - b)).length_squared();
    }
    let normal = ab.cross(ac);
    let height = ap.dot(normal);
    height * height / normal.length_squared()
}

#[cfg(test)]
mod tests;
