//! Where a mesh goes in the world.

use std::collections::hash_map::RandomState;
use std::hash::BuildHasher;

use glam::DVec3;
use turbid_contract::payload::Mesh;
use turbid_optics::solid::Frame;

use super::Soup;

/// Its file's lengths times `scale` are mm, then it is turned about the file's origin, then moved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placing {
    pub scale: f64,
    pub rotation_deg: [f64; 3],
    pub position: [f64; 3],
}

/// Brings a mesh into the world. Vertices at the same place, to the last bit, become one; they are counted in the order in which
/// triangles name them, so that all formats give the same mesh.
pub fn place(soup: &Soup, placing: &Placing) -> Mesh {
    let frame = Frame::turned(placing.position.into(), placing.rotation_deg);
    let straight = placing.rotation_deg == [0.0; 3];
    let (mut places, mut vertices) = (Places::new(&soup.vertices), Vec::new());
    let mut index = |i: u32| {
        let (number, new) = places.number(i);
        if let Some(v) = new {
            let p = placing.scale * DVec3::from(v);
            let p = if straight { DVec3::from(placing.position) + p } else { frame.point_out(p) };
            vertices.push(p.to_array().map(|x| x + 0.0));
        }
        number
    };
    let triangles = soup.triangles.iter().map(|t| t.map(&mut index)).collect();
    Mesh { vertices, triangles }
}

/// Numbers for places in the order in which they are first asked for: a hash table that holds nothing but numbers, an eighth of
/// what one with the coordinates takes.
struct Places<'a> {
    vertices: &'a [[f64; 3]],
    /// The first vertex at each place.
    first: Vec<u32>,
    /// 1 + the number of a place, 0 where there is none; a power of two of them.
    slots: Vec<u32>,
    /// With a key that no file knows: chosen coordinates could else all meet in one slot.
    hash: RandomState,
}

impl<'a> Places<'a> {
    fn new(vertices: &'a [[f64; 3]]) -> Self {
        Self { vertices, first: Vec::new(), slots: vec![0; 16], hash: RandomState::new() }
    }

    /// The number of the place of a vertex, and its coordinates where it is the first there.
    fn number(&mut self, vertex: u32) -> (u32, Option<[f64; 3]>) {
        let v = self.at(vertex);
        let slot = self.slot(v);
        if self.slots[slot] > 0 {
            return (self.slots[slot] - 1, None);
        }
        self.first.push(vertex);
        self.slots[slot] = self.first.len() as u32;
        if 2 * self.first.len() > self.slots.len() {
            self.grow();
        }
        (self.first.len() as u32 - 1, Some(v))
    }

    fn at(&self, vertex: u32) -> [f64; 3] {
        // -0.0 and 0.0 are the same place.
        self.vertices[vertex as usize].map(|x| x + 0.0)
    }

    /// Where the number of a place stands, or would.
    fn slot(&self, v: [f64; 3]) -> usize {
        let last = self.slots.len() - 1;
        let mut slot = self.hash.hash_one(v.map(f64::to_bits)) as usize & last;
        while self.slots[slot] > 0 && self.at(self.first[self.slots[slot] as usize - 1]) != v {
            slot = (slot + 1) & last;
        }
        slot
    }

    fn grow(&mut self) {
        self.slots = vec![0; 4 * self.slots.len()];
        for i in 0..self.first.len() {
            let slot = self.slot(self.at(self.first[i]));
            self.slots[slot] = i as u32 + 1;
        }
    }
}
