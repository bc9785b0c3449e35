//! Which triangles meet at which edges, and which hang together.

use turbid_contract::payload::Mesh;

/// Edges with the same fault: how many, and the first, by its vertices.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Edges {
    pub count: usize,
    pub first: [u32; 2],
}

impl Edges {
    fn add(&mut self, edge: [u32; 2]) {
        if self.count == 0 {
            self.first = edge;
        }
        self.count += 1;
    }
}

/// Edges with faults; and for each triangle the number of the part that it belongs to.
#[derive(Default)]
pub struct Topology {
    /// One triangle only.
    pub open: Edges,
    /// Two triangles that run along it the same way: their normals point to different sides.
    pub turned: Edges,
    /// More than two.
    pub crowded: Edges,
    /// Parts are counted in the order of their first triangles.
    pub parts: Vec<u32>,
    pub part_count: usize,
}

pub fn topology(mesh: &Mesh) -> Topology {
    // The lower vertex, the higher one, and twice the triangle, plus 1 where it runs upwards.
    let mut edges: Vec<[u32; 3]> = Vec::with_capacity(3 * mesh.triangles.len());
    for (i, t) in mesh.triangles.iter().enumerate() {
        for k in 0..3 {
            let (a, b) = (t[k], t[(k + 1) % 3]);
            edges.push([a.min(b), a.max(b), 2 * i as u32 + u32::from(a < b)]);
        }
    }
    edges.sort_unstable();
    let mut found = Topology { parts: (0..mesh.triangles.len() as u32).collect(), ..Topology::default() };
    for same in edges.chunk_by(|a, b| a[..2] == b[..2]) {
        let edge = [same[0][0], same[0][1]];
        match same {
            [_] => found.open.add(edge),
            [a, b] if (a[2] ^ b[2]) & 1 == 0 => found.turned.add(edge),
            [_, _] => {}
            _ => found.crowded.add(edge),
        }
        for pair in same.windows(2) {
            let [a, b] = [0, 1].map(|k| root(&mut found.parts, pair[k][2] / 2));
            found.parts[a.max(b) as usize] = a.min(b);
        }
    }
    // A root is the least triangle of its part: it has its number before the others ask for it.
    let roots: Vec<u32> = (0..found.parts.len() as u32).map(|i| root(&mut found.parts, i)).collect();
    for (i, &root) in roots.iter().enumerate() {
        if root as usize == i {
            found.parts[i] = found.part_count as u32;
            found.part_count += 1;
        } else {
            found.parts[i] = found.parts[root as usize];
        }
    }
    found
}

/// The least triangle of a set, with the way to it halved (union-find).
fn root(parts: &mut [u32], mut i: u32) -> u32 {
    while parts[i as usize] != i {
        parts[i as usize] = parts[parts[i as usize] as usize];
        i = parts[i as usize];
    }
    i
}
