//! A mesh in single precision, prepared for lines from the camera and to the light.

use std::sync::Arc;

use fearless_simd::prelude::*;
use glam::DVec3;
pub use turbid_optics::solid::facets::bits;
use turbid_optics::solid::facets::{Cells, Crossings, ItemBuffer, Rays};
use turbid_optics::solid::{Chord, Mesh};

use super::lane::{F, V};

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
}

/// Points towards or from which many lines run.
pub struct Eyes {
    pub camera: DVec3,
    /// `None` where there is no projector.
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
        Some(Self { body: body as u32, mesh: mesh.clone(), from_light: None, from_camera: None, center, normals })
    }

    /// Makes its cells, and what is seen of it from the eyes; a plan does without, and it takes as long as all the rest.
    pub fn prepare(&mut self, eyes: &Eyes) {
        self.mesh.cells();
        self.from_light = eyes.light.and_then(|eye| self.mesh.item_buffer(eye));
        self.from_camera = self.mesh.item_buffer(eyes.camera);
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
