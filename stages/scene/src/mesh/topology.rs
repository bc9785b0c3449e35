//! Which triangles meet at which edges, and which hang together.

use turbid_contract::payload::Mesh;

/// An edge and what is wrong with it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// One triangle only.
    Open,
    /// Two triangles that run along it the same way: their normals point to different sides.
    Turned,
    /// More than two.
    Crowded,
}

/// Edges with faults, by the lower vertex first; and for each triangle the number of the part that it belongs to.
pub struct Topology {
    pub faults: Vec<(Fault, [u32; 2])>,
    pub parts: Vec<u32>,
    pub part_count: usize,
}

pub fn topology(mesh: &Mesh) -> Topology {
    let mut edges: Vec<(u32, u32, u32, bool)> = Vec::with_capacity(3 * mesh.triangles.len());
    for (i, t) in mesh.triangles.iter().enumerate() {
        for k in 0..3 {
            let (a, b) = (t[k], t[(k + 1) % 3]);
            edges.push((a.min(b), a.max(b), i as u32, a < b));
        }
    }
    edges.sort_unstable();
    let mut parts: Vec<u32> = (0..mesh.triangles.len() as u32).collect();
    let mut faults = Vec::new();
    for same in edges.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
        let edge = [same[0].0, same[0].1];
        match same {
            [_] => faults.push((Fault::Open, edge)),
            [a, b] if a.3 == b.3 => faults.push((Fault::Turned, edge)),
            [_, _] => {}
            _ => faults.push((Fault::Crowded, edge)),
        }
        for pair in same.windows(2) {
            let (a, b) = (root(&mut parts, pair[0].2), root(&mut parts, pair[1].2));
            parts[a.max(b) as usize] = a.min(b);
        }
    }
    let roots: Vec<u32> = (0..parts.len() as u32).map(|i| root(&mut parts, i)).collect();
    let mut numbers: Vec<u32> = roots.clone();
    numbers.sort_unstable();
    numbers.dedup();
    let parts = roots.iter().map(|r| numbers.partition_point(|n| n < r) as u32).collect();
    Topology { faults, parts, part_count: numbers.len() }
}

/// The least triangle of a set, with the way to it halved (union-find).
fn root(parts: &mut [u32], mut i: u32) -> u32 {
    while parts[i as usize] != i {
        parts[i as usize] = parts[parts[i as usize] as usize];
        i = parts[i as usize];
    }
    i
}
