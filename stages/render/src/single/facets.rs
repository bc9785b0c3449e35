//! A mesh in single precision, prepared for lines from the camera and to the light.

use std::sync::Arc;

use fearless_simd::prelude::*;
use glam::DVec3;
pub use turbid_optics::solid::facets::bits;
use turbid_optics::solid::facets::{Cells, Crossings, ItemBuffer, Rays};
use turbid_optics::solid::{Chord, Mesh};

use super::lane::{F, LANES, M, V};

/// A mesh in single precision.
#[derive(Clone, Debug)]
pub struct Facets {
    /// Which body it is.
    pub body: u32,
    pub(super) mesh: Arc<Mesh>,
    /// From where light comes; `None` where it stands too near.
    pub(super) from_light: Option<Arc<ItemBuffer>>,
    /// The same from where the camera stands.
    pub(super) from_camera: Option<Arc<ItemBuffer>>,
    /// Local coordinates of its center.
    pub(super) center: [f32; 3],
    /// Of its faces.
    pub(super) normals: Vec<[f32; 3]>,
    /// See [`Mesh::offset`].
    pub(super) offsets: Vec<f32>,
}

/// Where rays leave a mesh.
pub(super) struct WayOut<S: Simd> {
    /// Which do.
    pub met: M<S>,
    /// mm.
    pub distance: F<S>,
    /// Of the plane of the facet: its unit normal outwards, and the product of that with its points, in coordinates about the center of the mesh.
    pub normal: V<S>,
    pub offset: F<S>,
    pub face: [u32; LANES],
}

/// Points towards or from which many lines run, if they do.
pub struct Eyes {
    pub camera: Option<DVec3>,
    pub light: Option<DVec3>,
}

impl Facets {
    /// Not [prepared](Self::prepare) for lines yet; `None` where there is no room for its cells.
    pub fn of(mesh: &Arc<Mesh>, body: usize, origin: DVec3) -> Option<Self> {
        if !mesh.has_cells() {
            return None;
        }
        let center = (mesh.center() - origin).as_vec3().to_array();
        let normals = (0..mesh.triangles() as u32).map(|face| mesh.normal(face).as_vec3().to_array()).collect();
        let offsets = (0..mesh.triangles() as u32).map(|face| mesh.offset(face) as f32).collect();
        Some(Self {
            body: body as u32,
            mesh: mesh.clone(),
            from_light: None,
            from_camera: None,
            center,
            normals,
            offsets,
        })
    }

    /// Makes its cells, and what is seen of it from the eyes; a plan does without, and it takes as long as all the rest.
    pub fn prepare(&mut self, eyes: &Eyes) {
        self.mesh.cells();
        self.from_light = eyes.light.and_then(|eye| self.mesh.item_buffer(eye));
        self.from_camera = eyes.camera.and_then(|eye| self.mesh.item_buffer(eye));
    }

    /// Where the camera's ray is in it; false where it has to be asked otherwise.
    #[inline(always)]
    pub fn cut_from_camera<S: Simd>(&self, simd: S, eye: DVec3, along: DVec3, chords: &mut Vec<Chord>) -> bool {
        let Some(from_camera) = &self.from_camera else { return false };
        self.mesh.cut_by_item_buffer(simd, (eye, from_camera), along, chords);
        true
    }

    #[inline(always)]
    pub(super) fn cells(&self) -> &Cells {
        self.mesh.cells().expect("there is room for them, or it would not have been made")
    }

    #[inline(always)]
    pub(super) fn local(&self, p: [f32; 3]) -> [f32; 3] {
        [p[0] - self.center[0], p[1] - self.center[1], p[2] - self.center[2]]
    }

    #[inline(always)]
    pub(super) fn local_lanes<S: Simd>(&self, p: V<S>) -> [F<S>; 3] {
        [p.x - self.center[0], p.y - self.center[1], p.z - self.center[2]]
    }
}

impl Facets {
    /// The plane of the nearest facet in the cell of the point of each lane that is asked, where there is one: its unit normal outwards, and how far below it the point is.
    #[inline(always)]
    pub(super) fn planes_near<S: Simd>(&self, simd: S, asked: M<S>, p: V<S>) -> (M<S>, V<S>, F<S>) {
        let (mut near, mut normal, mut height) = (0, [[0.0; LANES]; 3], [0.0; LANES]);
        let p = self.local_lanes(p);
        for lane in bits(asked.to_bitmask()) {
            let p =
                DVec3::new(p[0].as_slice()[lane].into(), p[1].as_slice()[lane].into(), p[2].as_slice()[lane].into());
            if let Some((n, h)) = self.mesh.plane_near(self.mesh.center() + p) {
                near |= 1 << lane;
                height[lane] = h as f32;
                normal.iter_mut().zip(n.as_vec3().to_array()).for_each(|(axis, n)| axis[lane] = n);
            }
        }
        let [x, y, z] = normal.map(|axis| F::load_array(simd, axis));
        (M::from_bitmask(simd, near), V { x, y, z }, F::load_array(simd, height))
    }

    /// Where rays from within leave it first.
    #[inline(always)]
    pub(super) fn way_out<S: Simd>(&self, simd: S, asked: M<S>, r: V<S>, w: V<S>) -> WayOut<S> {
        let (mut met, mut distance, mut normal) = (0, [0.0; LANES], [[0.0; LANES]; 3]);
        let (mut offset, mut face) = ([0.0; LANES], [u32::MAX; LANES]);
        let rays = Rays { p: self.local_lanes(r), w: [w.x, w.y, w.z] };
        let first = self.cells().first(simd, asked.to_bitmask(), &rays, u64::MAX, &F::splat(simd, f32::INFINITY));
        for (lane, crossing) in first.iter().enumerate() {
            if let Some(crossing) = crossing {
                let i = crossing.face as usize;
                met |= 1 << lane;
                (distance[lane], offset[lane], face[lane]) = (crossing.t, self.offsets[i], crossing.face);
                normal.iter_mut().zip(self.normals[i]).for_each(|(axis, n)| axis[lane] = n);
            }
        }
        let [x, y, z] = normal.map(|axis| F::load_array(simd, axis));
        WayOut {
            met: M::from_bitmask(simd, met),
            distance: F::load_array(simd, distance),
            normal: V { x, y, z },
            offset: F::load_array(simd, offset),
            face,
        }
    }

    /// What lies between points and the light.
    #[inline(always)]
    pub(super) fn between<S: Simd>(
        &self,
        simd: S,
        asked: u64,
        (r, to, distance): (V<S>, V<S>, &F<S>),
        found: &mut Crossings,
    ) {
        match &self.from_light {
            Some(seen) => seen.all_towards(simd, asked, &self.local_lanes(r), found),
            None => {
                let rays = Rays { p: self.local_lanes(r), w: [to.x, to.y, to.z] };
                self.cells().crossings(simd, asked, &rays, distance, found);
            }
        }
    }
}
